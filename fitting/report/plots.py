"""Figures of a calibration: the track of a trial with its histories, profiles; a function per plot.

``write_figures`` writes those of a run folder; ``FitAxes`` draws on axes, for notebooks, and writes no file. The look
is in ``plot_style``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cases.quantities import UNITS
from cases.trial import Trial
from fitting.prediction.bands import NORMAL
from fitting.prediction.envelope import DEGREES
from fitting.prediction.predict import Window, forces_along, predict_all
from fitting.prediction.score import PAPER_WINDOW
from fitting.record import FitObjects, FitRecord
from fitting.report.plot_style import (
    AFTER,
    ALARM,
    BEFORE,
    DASHES,
    GREY,
    GRID,
    MEASURED,
    STYLES,
    FigureFolder,
    dress,
    new_figure,
    own_axes,
)
from mmg.errors import Missing, OutOfRange, UnknownName, refusing, unknown
from mmg.motion.flow import STATES
from mmg.rollout import Simulator
from mmg.ship import Ship

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

T = TypeVar("T")
# State number, label and factor of each time history; the heading is seen on the track.
HISTORIES = ((3, "u [m/s]", 1.0), (4, "v [m/s]", 1.0), (5, "r [deg/s]", DEGREES))

# Outline of a ship of unit length: forward, starboard. Drawn by hand.
OUTLINE = np.array([[0.5, 0], [0.32, 0.08], [-0.5, 0.08], [-0.5, -0.08], [0.32, -0.08], [0.5, 0]])

# Colour and line of each input of one kind.
INPUTS = (("#555555", "-"), ("#555555", "--"), ("#A0A0A0", "-"), ("#A0A0A0", "--"))


def trajectory_plot(
    trial: Trial, before: Sequence[Window], after: Sequence[Window], length: float | None = None
) -> Figure:
    """Track of one trial, measured against open-loop windows, north up; beside it states and inputs over time: measured
    in black, before in orange and dashed, after in blue. A bar is the scale of the track; axes would cost a fifth more.

    before, after: windows of ``predict``; length: of the ship [m], to draw its outline where windows start.
    """
    t, states, first = trial.t - trial.t[0], trial.states, [w.first for w in after]
    runs = [(*_joined(trial, some), style) for some, style in zip((before, after), STYLES, strict=False)]
    strips: dict[str, list[tuple]] = {}
    for i, label, factor in HISTORIES:
        strips[label] = [(t, states[:, i] * factor, {"color": MEASURED, "lw": 1.0})]
        strips[label] += [(clock, z[:, i] * factor, {"lw": 1.2, **style}) for clock, z, style in runs]
    for label, rows in _inputs(trial).items():  # inputs of one kind share a strip
        looks = [{"color": color, "ls": dashes, "lw": 1.0} for (color, dashes), _ in zip(cycle(INPUTS), rows)]
        words = label if len(rows) == 1 else f"{label}: {', '.join(rows)}"
        strips[words] = [(t, values, look) for values, look in zip(rows.values(), looks, strict=True)]
    figure, left = new_figure(3.6, layout=None), 0.07
    if trial.has_position:
        track = figure.add_axes((0.0, 0.02, 0.42, 0.96))
        _track(track, states, [(z, style) for _, z, style in runs], first, length)
        left = 0.49
    ax = dress(figure.add_axes((left, 0.12, 0.985 - left, 0.86)), "time from the first sample [s]")
    ax.set_xlim(0, max(t[-1], 1e-9))
    _draw_strips(ax, strips, t[first])
    return figure


def _draw_strips(ax: Axes, strips: Mapping[str, list[tuple]], starts: np.ndarray) -> None:
    """Draw the lines (times, values, look) of each quantity, by label, below one another on ``ax``, each over the
    height 1: axes of their own cost five times as much. The first and last line of a strip lead its scale, which a
    run-away prediction between them must not. starts: times of the windows, dotted."""
    from matplotlib.ticker import MaxNLocator  # late: slow to import

    across, marks = ax.get_yaxis_transform(), []
    for row, (label, lines) in zip(reversed(range(len(strips))), strips.items(), strict=True):
        values = np.concatenate([y for _, y, _ in lines])
        low, high = _near(values, np.concatenate([lines[0][1], lines[-1][1]]), 0.6)
        scale = 0.76 / max(high - low, 1e-9)  # of the height 1: 0.06 below, the label above
        zero = row + 0.06 - scale * low
        for x, y, look in lines:
            ax.plot(x, np.clip(zero + scale * y, row, row + 1), **look)
        for tick in MaxNLocator(3).tick_values(low, high):
            if row + 0.04 < (height := zero + scale * tick) < row + 0.9:
                marks.append(height)
                words = f"{tick:.6g}".replace("-", "−")
                ax.text(-0.01, height, words, transform=across, fontsize=8, ha="right", va="center")
        ax.text(0.006, row + 0.98, label, transform=across, fontsize=8, va="top", color="#333333")
    ax.set_ylim(0, len(strips))
    ax.yaxis.set_visible(False)
    ax.hlines(marks, 0, 1, transform=across, color=GRID, linewidth=0.6, zorder=0)
    ax.hlines(range(len(strips)), 0, 1, transform=across, color=GREY, linewidth=0.8, zorder=0)
    ax.vlines(starts, 0, len(strips), color="#C8C8C8", linewidth=0.7, linestyle=":", zorder=0)


def _inputs(trial: Trial) -> dict[str, dict[str, np.ndarray]]:
    """What moves the ship, by the label of its axis: angles, then revolutions, by column; none that rests."""
    angles = {c: np.degrees(trial[c]) for c in trial.columns if c.startswith(("delta", "azimuth"))}
    turns = {c: trial[c] for c in trial.columns if c == "n" or c.startswith("n_")}
    labels = ("delta [deg]" if list(angles) == ["delta"] else "angles [deg]", "n [1/s]")
    moving = [{c: x for c, x in rows.items() if np.any(x)} for rows in (angles, turns)]
    shown = moving if any(moving) else [angles, turns]
    return {label: rows for label, rows in zip(labels, shown, strict=True) if rows}


def _joined(trial: Trial, windows: Sequence[Window]) -> tuple[np.ndarray, np.ndarray]:
    """Time from the first sample (rows,) and states (rows, 6) of all windows, a row of NaN between them."""
    if not windows:
        return np.empty(0), np.empty((0, 6))
    gap = np.full((1, 6), np.nan)  # where matplotlib interrupts a line
    t = [np.append(trial.t[w.first : w.last + 1] - trial.t[0], np.nan) for w in windows]
    return np.concatenate(t), np.vstack([part for w in windows for part in (w.states, gap)])


def _near(drawn: np.ndarray, values: np.ndarray, room: float) -> tuple[float, float]:
    """Limits of what is ``drawn`` (m,) no further than ``room`` spans from the ``values`` (n,): a run-away prediction
    must not flatten the rest; 0 and 1 for no numbers."""
    values, drawn = values[np.isfinite(values)], drawn[np.isfinite(drawn)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    span = room * max(high - low, 1e-9)
    return max(float(drawn.min()), low - span), min(float(drawn.max()), high + span)


def _track(
    ax: Axes, states: np.ndarray, runs: list[tuple[np.ndarray, dict]], first: list[int], length: float | None
) -> None:
    ax.plot(states[:, 1], states[:, 0], color=MEASURED, lw=1.3, zorder=2)
    for z, style in runs:
        ax.plot(z[:, 1], z[:, 0], lw=1.3, zorder=3, **style)
    ax.plot(states[first, 1], states[first, 0], ".", color=MEASURED, ms=6, zorder=4)
    if length:
        for x, y, psi in states[first, :3]:
            ahead, side = (length * OUTLINE).T
            ax.fill(y + ahead * np.sin(psi) + side * np.cos(psi), x + ahead * np.cos(psi) - side * np.sin(psi),
                    fc="none", ec=MEASURED, lw=0.8, zorder=4)  # fmt: skip
    drawn, near = np.vstack([states, *(z for z, _ in runs)]), np.vstack([states, runs[-1][0]])
    # led by what was measured and by the last prediction, as _draw_strips; (east and north, low and high)
    limits = np.array([_near(drawn[:, i], near[:, i], 0.3) for i in (1, 0)])
    half = 0.55 * np.ptp(limits, axis=1).max() + 0.5 * (length or 0.0)
    (east, north), bar = limits.mean(axis=1), 10.0 ** np.floor(np.log10(half))
    ax.set(xlim=(east - half, east + half), ylim=(north - half, north + half), aspect="equal")
    ax.plot([east - 0.95 * half, east - 0.95 * half + bar], [north - 0.9 * half] * 2, color=GREY, lw=2.5)
    ax.text(east - 0.95 * half, north - 0.88 * half, f"{bar:g} m", fontsize=8, color="#333333", va="bottom")
    ax.set_axis_off()


def profile_plot(row: Mapping[str, Any], std: float | None = None, unit: str = "") -> Figure:
    """Profile likelihood of one coefficient: the best objective over all others at each of its values.

    row: of "profiles" in result.json; std [unit]: the standard error, whose parabola is drawn too. Where the curve is
    flat below the dashed lines the data do not bound it.
    """
    good = np.array([rise is not None and np.isfinite(rise) for rise in row["increase"]])
    values = np.array(row["values"], dtype=float)[good]
    rise = np.array(row["increase"], dtype=float)[good] / row["dispersion"]
    rise = rise - rise.min(initial=np.inf)
    figure = new_figure(3.0)
    ax = dress(figure.subplots(), f"{row['symbol']} [{unit or '-'}]", "objective above its minimum [-]")
    ax.plot(values, rise, "o-", color=AFTER, ms=3.5, label="profile")
    if len(values) and std:
        estimate, fine = float(values[np.argmin(rise)]), np.linspace(values.min(), values.max(), 200)
        parabola = 0.5 * ((fine - estimate) / std) ** 2
        ax.plot(fine, parabola, color=GREY, lw=1, label="parabola of the standard error")
        ax.axvline(estimate, color=GREY, lw=0.8)
    for height, name in ((0.5, "68 %"), (1.92, "95 %")):  # half of chi^2 with one degree of freedom
        ax.axhline(height, color=ALARM, lw=0.8, ls="--")
        across = ax.get_yaxis_transform()
        ax.text(1.005, height, name, transform=across, fontsize=7.5, va="center", color=ALARM)
    ax.set_ylim(0, max(3.0, min(12.0, 1.05 * float(rise.max(initial=0.0)))))
    ax.legend(fontsize=8, frameon=False)
    return figure


WHOLE = ("turning", "zigzag")  # Kinds of trials that are drawn first, and predicted from their begin to their end


def write_figures(
    written: FigureFolder,
    record: FitRecord,
    models: tuple[Simulator, Simulator],
    trials: Sequence[Trial],
    validation: Sequence[Trial] = (),
) -> None:
    """Write the figures of a calibration, in the order of a report. written: where to; record: what it found; models:
    the ship before and after; trials, validation: calibrated on, and held out."""
    # the longest trial of each kind, held-out ones and turning circles or zigzags first
    chosen: dict[str, tuple[Trial, bool]] = {}
    for held_out, pool in ((True, validation), (False, trials)):
        for trial in sorted(pool, key=lambda t: (t.kind not in WHOLE, -t.duration)):
            chosen.setdefault(trial.kind or trial.name, (trial, held_out))
    # four set by hand: one of each kind of manoeuvre in the usual campaign
    for number, (trial, held_out) in enumerate(list(chosen.values())[:4]):
        length = trial.duration if trial.kind in WHOLE else PAPER_WINDOW
        earlier, later = (predict_all(model, [trial], length, length)[0][0] for model in models)
        words = ""
        if earlier and later and trial.has_position:
            errors = (np.vstack([w.error(trial.states)[:, :2] for w in some]) for some in (earlier, later))
            rms = [np.sqrt(2 * np.nanmean(error**2)) for error in errors]  # x^2 + y^2: twice the mean over both
            words = f"Rms position error {rms[0]:.3g} m before, {rms[1]:.3g} m after."
        written.write(
            f"track_{number + 1}", partial(trajectory_plot, trial, earlier, later, models[1].ship.particulars["L"]),
            f"{trial.name} ({'held out' if held_out else 'used in the calibration'})",
            "Black: measured; orange and dashed: predicted before, blue: after the calibration, from measured states "
            f"(dots and ship outlines; dotted lines) over {length:.0f} s. North is up. {words}",
        )  # fmt: skip
    for row in record.profiles or ():
        estimate = record.estimates[row["symbol"]]
        written.write(
            f"identifiability_profile_{row['symbol']}", partial(profile_plot, row, estimate.std, estimate.unit),
            f"Profile of {row['symbol']}",
            "Objective, minimised over all other coefficients and states, above its minimum and divided by the "
            f"dispersion of {row['dispersion']:.3g} (how much more the runs scatter than modelled): below the "
            "dashed lines the coefficient may lie. A parabola is what its standard error stands for.",
        )  # fmt: skip


COMPONENTS = {"X": (0, "X [N]"), "Y": (1, "Y [N]"), "N": (2, "N [N m]")}  # Column and label of each force
# Number and label of each state.
CHANNELS = {state: (number, f"{state} [{UNITS[state]}]") for number, state in enumerate(STATES)}


@refusing
@dataclass(frozen=True, repr=False)
class FitAxes:
    """The figures of a calibration: its ``record``, the ship before (``start``) and after, ``objects`` behind it, None
    where it was read. Those along a trial take its name, its number among those that it was calibrated on, or a trial;
    ax: where to draw, None: new axes."""

    record: FitRecord
    start: Ship
    ship: Ship
    objects: FitObjects | None

    def tracks(self, ax: Axes | None = None, trial: str | int | Trial = 0, window: float = 30.0) -> Axes:
        """The measured track, north up, and open-loop predictions of ``window`` [s] from measured states, before and
        after the calibration; 0: of the whole run. Raises UserError for a trial without positions."""
        run = self._trial(trial)
        if not run.has_position:
            raise Missing(f"{run.name}: has no positions, so there is no track to draw")
        ax = dress(own_axes(ax), "y, east [m]", "x, north [m]", run.name)
        states = run.states
        ax.plot(states[:, 1], states[:, 0], color=MEASURED, lw=1.3, label="measured")
        for one, look in self._predictions(run, window or run.duration):
            ax.plot(one.states[:, 1], one.states[:, 0], lw=1.2, **look)
        ax.set_aspect("equal", adjustable="datalim")
        ax.legend(fontsize=8, frameon=False)
        return ax

    def residuals(
        self, ax: Axes | None = None, channel: str = "r", trial: str | int | Trial = 0, window: float = 30.0
    ) -> Axes:
        """Measured minus predicted ``channel`` (x, y, psi, u, v, r) over time, in windows of ``window`` [s] from
        measured states, before and after the calibration. Raises UserError for another channel."""
        number, label = _known("channel", channel, CHANNELS)
        run = self._trial(trial)
        ax = dress(own_axes(ax), "time from the first sample [s]", f"measured - predicted {label}", run.name)
        for one, look in self._predictions(run, window):
            t = run.t[one.first : one.last + 1] - run.t[0]
            ax.plot(t, one.error(run.states)[:, number], lw=1.0, **look)
        ax.axhline(0.0, color=GREY, lw=0.7)
        ax.legend(fontsize=8, frameon=False)
        return ax

    def forces(self, ax: Axes | None = None, component: str = "N", trial: str | int | Trial = 0) -> Axes:
        """Force of each part of the calibrated ship along the measured motion: ``component`` X, Y [N] or N [N m], body
        axes at midship. Raises UserError for another component."""
        column, label = _known("component", component, COMPONENTS)
        run = self._trial(trial)
        ax = dress(own_axes(ax), "time from the first sample [s]", label, run.name)
        for (role, force), dashes in zip(forces_along(Simulator(self.ship), run).items(), DASHES * 3, strict=False):
            ax.plot(run.t - run.t[0], force[:, column], lw=1.1, ls=dashes, label=role)
        ax.legend(fontsize=8, frameon=False)
        return ax

    def coefficients(self, ax: Axes | None = None) -> Axes:
        """Each free coefficient in standard deviations of its prior: the prior as a grey bar, the estimate with its 90
        % interval."""
        rows = {s: c for s, c in self.record.estimates.items() if c.prior_std and c.prior_value is not None}
        ax = dress(own_axes(ax, height=1.0 + 0.2 * len(rows)), "from the prior [prior standard deviations]")
        places = np.arange(len(rows))[::-1]  # the first one on top
        at = [(c.value - float(c.prior_value or 0)) / float(c.prior_std or 1) for c in rows.values()]
        half = [NORMAL * (c.std or 0.0) / float(c.prior_std or 1) for c in rows.values()]  # 90 % of a normal
        ax.axvspan(-NORMAL, NORMAL, color=GREY, alpha=0.15, lw=0)
        ax.errorbar(at, places, xerr=half, fmt="o", ms=3.5, lw=1.1, color=AFTER)
        ax.set_yticks(places, list(rows))
        return ax

    def correlation(self, ax: Axes | None = None) -> Axes:
        """Correlation of the estimates: blue positive, orange negative. Raises UserError where none is known."""
        from matplotlib.colors import LinearSegmentedColormap  # late: slow to import

        symbols, matrix = self.record.correlation.symbols, np.array(self.record.correlation.matrix, dtype=float)
        if not matrix.size:
            raise Missing(f"{self.ship.title}: no correlation of the estimates is known")
        side = 1.5 + 0.2 * len(symbols)
        ax = dress(own_axes(ax, side + 1.0, side))
        colours = LinearSegmentedColormap.from_list("correlation", [BEFORE, "white", AFTER])
        image = ax.imshow(matrix, cmap=colours, vmin=-1, vmax=1)
        ax.grid(False)
        size = min(8.0, 260.0 / len(symbols))  # points: a row of axes 4 inch high holds one line each
        ax.set_xticks(range(len(symbols)), symbols, rotation=90, fontsize=size)
        ax.set_yticks(range(len(symbols)), symbols, fontsize=size)
        ax.figure.colorbar(image, ax=ax, shrink=0.8)
        return ax

    def _predictions(self, run: Trial, length: float) -> Iterator[tuple[Window, dict[str, Any]]]:
        """Windows of ``length`` [s] of a ``run`` by the ship before and after, and how their lines look."""
        for ship, name, style in zip((self.start, self.ship), ("before", "calibrated"), STYLES, strict=False):
            for k, one in enumerate(predict_all(Simulator(ship), [run], length, length, short_last=True)[0][0]):
                yield one, {"label": None if k else name, **style}  # one entry of the legend for all windows

    def _trial(self, wanted: str | int | Trial) -> Trial:
        """A trial as it is given, or of those of the calibration: by name, or by number, held-out ones last."""
        if isinstance(wanted, Trial):
            return wanted
        if self.objects is None:
            raise Missing("trial: the result was read from its folder, which has no trials; give one of read_trials")
        trials: Sequence[Trial] = (*self.objects.trials, *self.objects.validation)
        if isinstance(wanted, int):
            if not 0 <= wanted < len(trials):
                raise OutOfRange(f"trial: {wanted} is none of 0 to {len(trials) - 1}")
            return trials[wanted]
        return _known("trial", wanted, {one.name: one for one in trials})


def _known(what: str, name: str, table: Mapping[str, T]) -> T:
    """What stands for ``name`` in a ``table``."""
    if name not in table:
        raise UnknownName(unknown(what, name, table))
    return table[name]
