"""Figures of a calibration on axes, for notebooks: each function returns the axes, and none writes a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cases.io.toml_file import unknown
from cases.trial import Trial
from fitting.prediction.band_calibration import NORMAL
from fitting.prediction.predict import Window, forces_along, predict_all
from fitting.record import FitObjects, FitRecord
from fitting.report.plot_style import AFTER, BEFORE, DASHES, GREY, MEASURED, STYLES, dress, own_axes
from mmg.errors import Missing, OutOfRange, UnknownName
from mmg.rollout import Simulator
from mmg.ship import Ship

if TYPE_CHECKING:
    from matplotlib.axes import Axes

T = TypeVar("T")

COMPONENTS = {"X": (0, "X [N]"), "Y": (1, "Y [N]"), "N": (2, "N [N m]")}  # Column and label of each force
# State number and label of each state.
CHANNELS = {"x": (0, "x [m]"), "y": (1, "y [m]"), "psi": (2, "psi [rad]"), "u": (3, "u [m/s]"), "v": (4, "v [m/s]"),
            "r": (5, "r [rad/s]")}  # fmt: skip


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
        known: Sequence[Trial] = (*self.objects.trials, *self.objects.validation)
        if isinstance(wanted, int):
            if not 0 <= wanted < len(known):
                raise OutOfRange(f"trial: {wanted} is none of 0 to {len(known) - 1}")
            return known[wanted]
        return _known("trial", wanted, {one.name: one for one in known})


def _known(what: str, name: str, table: Mapping[str, T]) -> T:
    """What stands for ``name`` in a ``table``."""
    if name not in table:
        raise UnknownName(unknown(what, name, table))
    return table[name]
