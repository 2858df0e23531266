"""Figures of a calibration: one function per plot, each takes a part of a result and returns a matplotlib Figure.

``write_figures`` writes those of a run folder. The look is in ``plot_style``; tracks are in ``plot_tracks``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.trial import Trial
from fitting.identifiability.analysis import DETERMINED, KINDS, PARTLY
from fitting.prediction.predict import predict_all
from fitting.prediction.score import PAPER_WINDOW
from fitting.record import CoefficientRow, FitRecord
from fitting.report.plot_style import (
    AFTER,
    ALARM,
    BEFORE,
    GREY,
    FigureFolder,
    dress,
    new_figure,
    placed_axes,
    room_for_labels,
)
from fitting.report.plot_tracks import error_growth_plot, trajectory_plot
from mmg.components.catalogue import ROLES, coefficient_table
from mmg.rollout import Simulator
from mmg.ship import Ship

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRACKS = 4
"""Trials whose track is drawn: one of each kind of manoeuvre in the usual campaign."""
GROUPS = ("mass", *ROLES, "effects", "other")


def component_of(ship: Ship) -> dict[str, str]:
    """Component each coefficient of ``ship`` belongs to: "mass", the role of its force model, or "effects"."""
    found = dict.fromkeys(coefficient_table({}, ship.particulars), "mass")
    for role, name in ship.components.items():
        for symbol in coefficient_table({role: name}, ship.particulars):
            found.setdefault(symbol, role)
    found |= dict.fromkeys(ship.monomials, "expansion")
    own = tuple(f"{name}." for name in ship.effects)
    return found | dict.fromkeys((s for s in ship.coefficients if s.startswith(own)), "effects")


def grouped(rows: Mapping[str, Any], components: Mapping[str, str]) -> list[tuple[str, list[str]]]:
    """(component, symbols in their order) for each component that has any of ``rows``; components: by symbol."""
    groups: dict[str, list[str]] = {g: [] for g in GROUPS}
    for symbol in rows:
        groups.setdefault(components.get(symbol, "other"), []).append(symbol)
    return [(group, symbols) for group, symbols in groups.items() if symbols]


def determination(share: float | None) -> str:
    """ "determined", "partly", "prior" or "unknown": what decided a coefficient, from the prior's ``share``."""
    if share is None or not np.isfinite(share):
        return "unknown"
    return "determined" if share < DETERMINED else "partly" if share < PARTLY else "prior"


def kinds_of(result: Mapping[str, Any]) -> dict[str, str]:
    """Kind of finding (``fitting.identifiability.analysis.KINDS``) by symbol in ``result``, content of result.json."""
    found = result.get("identifiability") or {}
    return {symbol: str(row.get("kind", "")) for symbol, row in found.get("coefficients", {}).items()}


MARKS = {
    "determined": {"marker": "o", "color": AFTER, "mfc": AFTER, "label": KINDS["determined"]},
    "partly": {"marker": "o", "color": AFTER, "mfc": "white", "label": KINDS["partly"]},
    "shared": {"marker": "D", "color": BEFORE, "mfc": "white", "label": KINDS["shared"]},
    "prior": {"marker": "s", "color": GREY, "mfc": "white", "label": KINDS["prior"]},
    "silent": {"marker": "^", "color": GREY, "mfc": "white", "label": KINDS["silent"]},
    "strained": {"marker": "v", "color": ALARM, "mfc": ALARM, "label": KINDS["strained"]},
    "bound": {"marker": "o", "color": GREY, "mfc": "white", "label": ""},
    "unknown": {"marker": "x", "color": GREY, "mfc": GREY, "label": "uncertainty not available"},
}
"""Marker of a coefficient by the kind of finding; one at a bound gets another one around it."""


def _columns(lines: list[tuple[str, str | None]]) -> list[list[tuple[str, str | None]]]:
    """One or two columns of rows; a component that the break divides gets its heading again."""
    if len(lines) <= 24:
        return [lines]
    half = -(-len(lines) // 2)
    heads = [i for i, line in enumerate(lines) if line[1] is None and abs(i - half) <= 4]
    if heads:
        half = min(heads, key=lambda i: abs(i - half))
        return [lines[:half], lines[half:]]
    return [lines[:half], [(f"{lines[half][0]} (continued)", None), *lines[half:]]]


def coefficient_plot(
    rows: Mapping[str, CoefficientRow], components: Mapping[str, str], kinds: Mapping[str, str] | None = None
) -> Figure:
    """Shift of every free coefficient from its prior in prior standard deviations, with its standard error.

    rows: by symbol, as of ``FitResult.coefficients``; components: symbol -> component, see ``component_of``; kinds:
    symbol -> kind of finding, see ``kinds_of``; default by the prior's share alone.
    """
    known = kinds or {}
    lines: list[tuple[str, str | None]] = []
    for group, symbols in grouped(rows, components):
        lines += [(group, None), *((group, symbol) for symbol in symbols)]
    parts = _columns(lines)
    longest = max(len(part) for part in parts)
    across = 0.12 + room_for_labels((s for _, s in lines if s), 8)
    figure, grid = placed_axes(
        1.1 + 0.185 * longest, (1, len(parts)), (across, 0.12, 0.5, 0.4), (across, 0.0), sharex=True
    )
    used: dict[str, Any] = {}
    extent = 2.2
    axes = grid[0]
    for ax, part in zip(axes, parts, strict=True):
        dress(ax, "(estimate - prior) / prior standard deviation [-]")
        ax.axvspan(-1, 1, color="#EFF3F6", zorder=0)
        ax.axvline(0, color=GREY, linewidth=0.8, zorder=1)
        points: dict[str, list[tuple[float, int, float]]] = {}
        for height, (group, symbol) in enumerate(part):
            if symbol is None:
                where = ax.get_yaxis_transform()
                ax.text(0.01, height, group, transform=where, fontsize=9, fontweight="bold", va="center")
                continue
            ax.text(-0.02, height, symbol, transform=ax.get_yaxis_transform(), fontsize=8, va="center", ha="right")
            row = rows[symbol]
            prior_std = row.prior_std or np.nan
            shift = (row.value - (row.prior_value or 0.0)) / prior_std
            std = row.std / prior_std if row.std is not None else np.nan
            kind = known.get(symbol) or determination(row.prior_share)
            points.setdefault(kind, []).append((shift, height, std if np.isfinite(std) else np.nan))
            if np.isfinite(shift):
                extent = max(extent, abs(shift) + (std if np.isfinite(std) else 0) + 0.2)
            if row.at_bound:
                sign = "<" if row.at_bound == "lower" else ">"
                (used["limit"],) = ax.plot(shift, height, sign, color=ALARM, ms=9, mfc="none", mew=1.4, zorder=4)
        for kind, some in points.items():
            look, (x, y, width) = MARKS[kind], np.transpose(some)
            used[kind] = ax.errorbar(
                x, y, xerr=width, fmt=look["marker"], ls="none", color=look["color"], mfc=look["mfc"], ms=4.2, lw=1.2,
                zorder=3,
            )  # fmt: skip
        ax.set_ylim(longest - 0.4, -0.8)
        ax.yaxis.set_visible(False)  # a tick is five artists, a text one
    axes[0].set_xlim(-extent, extent)
    names = {kind: str(look["label"]) for kind, look in MARKS.items() if kind in used} | {"limit": "at a bound"}
    shown = {name: used[kind] for kind, name in names.items() if kind in used and name}
    figure.legend(shown.values(), shown, loc="upper center", ncols=5, fontsize=8, frameon=False)
    return figure


def convergence_plot(history: Sequence[tuple[float, float]]) -> Figure:
    """Objective and constraint violation over the iterations of a solve, of which ``history`` has both."""
    figure, grid = placed_axes(3.2, (1, 2), (0.75, 0.12, 0.5, 0.35), (0.85, 0.0))
    left, right = grid[0]
    values = np.array(history, dtype=float).reshape(-1, 2)
    steps = np.arange(len(values))
    dress(left, "iteration [-]", "objective [-]", "objective")
    left.plot(steps, values[:, 0], "o-", color=AFTER, ms=3)
    dress(right, "iteration [-]", "largest defect, scaled [-]", "gaps between shooting intervals")
    right.plot(steps, np.maximum(values[:, 1], 1e-16), "o-", color=AFTER, ms=3)
    right.set_yscale("log")
    right.yaxis.set_major_formatter(lambda value, _: f"{value:.0e}")  # as a formula it takes long to set
    right.minorticks_off()
    if len(values) and values[:, 0].min() > 0 and values[:, 0].max() > 20 * values[:, 0].min():
        left.set_yscale("log")
    return figure


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
        ax.plot(fine, 0.5 * ((fine - estimate) / std) ** 2, color=GREY, lw=1, label="parabola of the standard error")
        ax.axvline(estimate, color=GREY, lw=0.8)
    for height, name in ((0.5, "68 %"), (1.92, "95 %")):
        ax.axhline(height, color=ALARM, lw=0.8, ls="--")
        ax.text(1.005, height, name, transform=ax.get_yaxis_transform(), fontsize=7.5, va="center", color=ALARM)
    ax.set_ylim(0, max(3.0, min(12.0, 1.05 * float(rise.max(initial=0.0)))))
    ax.legend(fontsize=8, frameon=False)
    return figure


def _shown(trials: Sequence[Trial], validation: Sequence[Trial], most: int) -> list[tuple[Trial, bool]]:
    """Up to ``most`` (trial, held out) to draw: the longest of each kind, held-out ones first."""
    chosen: dict[str, tuple[Trial, bool]] = {}
    for held_out, pool in ((True, validation), (False, trials)):
        for trial in sorted(pool, key=lambda t: -t.duration):
            chosen.setdefault(trial.kind or trial.name, (trial, held_out))
    return list(chosen.values())[:most]


def _position_rms(trial: Trial, windows: Sequence) -> float:
    """Rms distance [m] between predicted and measured positions over all windows, NaN when there are none."""
    if not windows or not trial.has_position:
        return float("nan")
    errors = [w.error(trial.states)[:, :2] for w in windows]
    return float(np.sqrt(np.nanmean((np.vstack(errors) ** 2).sum(axis=1))))


def write_figures(
    written: FigureFolder,
    record: FitRecord,
    models: tuple[Simulator, Simulator],
    trials: Sequence[Trial],
    validation: Sequence[Trial] = (),
    history: Sequence[tuple[float, float]] = (),
) -> None:
    """Write the figures of a calibration, in the order of a report.

    written: where to; record: what it found; models: the ship before and after; trials, validation: calibrated on, and
    held out; history: objective and largest gap at each iteration, drawn where the solver did not converge.
    """
    before, after = models
    if judged := validation or trials:
        written.write(
            "error_growth", partial(error_growth_plot, {"before": before, "after": after}, judged),
            "How errors grow with the length of the prediction",
            f"Rms errors over windows of the {'held-out' if validation else 'training (none was held out)'} trials, "
            "each started from the measured state and from there on driven by the measured rudder, revolutions and "
            "wind alone. Shaded: one standard error, by leaving out one trial (of a single one, one window) after the "
            "other.",
        )  # fmt: skip
    shown = _shown(trials, validation, TRACKS)
    windows = [predict_all(model, [trial for trial, _ in shown], PAPER_WINDOW, PAPER_WINDOW) for model in models]
    for number, (trial, held_out) in enumerate(shown):
        earlier, later = (side[number][0] for side in windows)
        rms = [_position_rms(trial, some) for some in (earlier, later)]
        words = f"Rms position error {rms[0]:.3g} m before, {rms[1]:.3g} m after." if np.isfinite(rms).all() else ""
        written.write(
            f"track_{number + 1}", partial(trajectory_plot, trial, earlier, later, after.ship.particulars["L"]),
            f"{trial.name} ({'held out' if held_out else 'used in the calibration'})",
            f"Predictions restart from the measured state every {PAPER_WINDOW:g} s (dots and ship outlines on the "
            f"track; dotted lines below). {words}",
        )  # fmt: skip
    kinds = kinds_of(vars(record))
    written.write(
        "coefficients", partial(coefficient_plot, record.coefficients, component_of(after.ship), kinds),
        "Coefficients: shift from the prior",
        "Point: estimate; bar: its standard error; both in prior standard deviations. Shaded: one prior "
        "standard deviation. A short bar means that the trials decided, a bar as wide as the shading that the "
        "prior did.",
    )  # fmt: skip
    if history and not record.converged:
        written.write(
            "convergence", partial(convergence_plot, history), "Iterations of the last solve",
            "Objective and largest gap between shooting intervals at each iteration.",
        )  # fmt: skip
    for row in record.profiles or ():
        known = record.coefficients[row["symbol"]]
        written.write(
            f"identifiability_profile_{row['symbol']}", partial(profile_plot, row, known.std, known.unit),
            f"Profile of {row['symbol']}",
            "Objective, minimised over all other coefficients and states, above its minimum and divided by the "
            f"dispersion of {row['dispersion']:.3g} (how much more the runs scatter than modelled): below the "
            "dashed lines the coefficient may lie. A parabola is what its standard error stands for.",
        )  # fmt: skip
