"""Figures of what trials say about coefficients: one function per plot, each returns its figure.

``write_identifiability_figures`` writes those of a run folder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.design.next_trial import HELPS, NextTrial
from fitting.identifiability.analysis import DETERMINED, KINDS, PARTLY, CoefficientFinding, Identifiability
from fitting.identifiability.clusters import CORRELATED
from fitting.record import FitObjects, FitRecord
from fitting.report.plot_style import (
    AFTER,
    ALARM,
    BEFORE,
    GREY,
    WIDTH,
    FigureFolder,
    dress,
    new_figure,
    placed_axes,
    room_for_labels,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {
    "determined": AFTER, "partly": "#7FB8D9", "shared": BEFORE, "prior": "#B8BEC4", "silent": "#5F6770",
    "bound": ALARM, "unknown": "white", "strained": ALARM,
}  # fmt: skip
HATCHES = {
    "partly": "....",
    "shared": "////",
    "prior": "xxxx",
    "silent": "\\\\\\\\",
    "bound": "----",
    "strained": "++++",
}
"""Hatches of the bars beside their colours, so that they can be told apart in grey."""
BAR = 0.95
"""Margin [inches] for the bar of colours, its figures and its label."""
SHOWN = 0.5
"""Absolute correlation from which a coefficient appears in the correlation plot."""


def correlation_plot(found: Identifiability, most: int = 36) -> Figure:
    """Posterior correlations ``found``: correlated coefficients beside each other, clusters framed.

    Only coefficients with a correlation of at least 0.5 with another, the ``most`` most correlated ones.
    """
    from matplotlib.patches import Rectangle  # late: slow to import

    strongest = np.abs(found.correlation - np.eye(len(found.order))).max(axis=1, initial=0.0)
    chosen = set(np.argsort(-np.nan_to_num(strongest))[:most].tolist())
    order = [k for k in found.order if k in chosen and strongest[k] >= SHOWN]
    names = [found.findings[k].symbol for k in order]
    if not order:
        return _empty(3.0, f"no two estimates are correlated by {SHOWN:g} or more")
    room = room_for_labels(names, 7.5)
    side = min(WIDTH - room - BAR, 2.0 + 0.17 * len(order))
    beside = 0.5 * (WIDTH - room - BAR - side)
    figure, axes = placed_axes(side + room + 0.14, (1, 1), (room + beside, BAR + beside, room + 0.06, 0.08))
    ax = dress(axes[0, 0])
    ax.grid(visible=False)
    shown = found.correlation[np.ix_(order, order)]
    image = ax.imshow(shown, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="none")
    for row, column in np.argwhere(shown <= -SHOWN):  # red and blue are one in grey
        ax.text(column, row, "−", color="white", fontsize=6, ha="center", va="center")
    ax.set_xticks(range(len(order)), names, rotation=90, fontsize=7.5)
    ax.set_yticks(range(len(order)), names, fontsize=7.5)
    for cluster in found.clusters:
        where = sorted(names.index(s) for s in cluster.symbols if s in names)
        if where and where[-1] - where[0] == len(where) - 1:
            corner, size = (where[0] - 0.5, where[0] - 0.5), len(where)
            ax.add_patch(Rectangle(corner, size, size, fill=False, edgecolor="black", linewidth=1.4))
    _colour_bar(ax, image, f"correlation of the estimates [-]; framed: {CORRELATED:g} or more", 0.7)
    return figure


def _empty(height: float, words: str) -> Figure:
    figure = new_figure(height)
    ax = figure.subplots()
    ax.set_axis_off()
    ax.text(0.5, 0.5, words, ha="center")
    return figure


def _colour_bar(ax: Axes, image: Any, label: str, share: float = 1.0) -> None:
    """What the colours of ``image`` in ``ax`` stand for, in the margin BAR on the right of it, along a ``share`` of its
    height."""
    box, thin, gap = ax.get_position(), 0.22 / WIDTH, 0.14 / WIDTH
    place = (box.x1 + gap, box.y0 + 0.5 * (1 - share) * box.height, thin, share * box.height)
    bar = ax.figure.colorbar(image, cax=ax.figure.add_axes(place))
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=8)


def share_plot(findings: Sequence[CoefficientFinding]) -> Figure:
    """Prior's share of the variance of each of ``findings`` as bars, largest last.

    Black ticks: the share if all others were known.
    """
    rows = sorted((f for f in findings if np.isfinite(f.share)), key=lambda f: f.share)
    left = 0.1 + room_for_labels((f.symbol for f in rows), 7.5)
    figure, axes = placed_axes(0.9 + 0.155 * len(rows), (1, 1), (left, 0.12, 0.5, 0.12))
    ax = dress(axes[0, 0], "prior's share of the variance [-]: 0 the trials decided, 1 they said nothing")
    heights = range(len(rows))
    for kind, words in KINDS.items():
        if some := [(k, min(f.share, 1)) for k, f in enumerate(rows) if f.kind == kind]:
            at, shares = zip(*some, strict=True)
            look: dict[str, Any] = {
                "color": COLOURS[kind],
                "hatch": HATCHES.get(kind),
                "edgecolor": "white",
                "linewidth": 0,
            }
            ax.barh(at, shares, 0.72, label=words, **look)
    alone = [f.alone for f in rows]
    ax.plot(alone, heights, "|", color="black", ms=6, mew=1.3, label="share if all others were known")
    for line in (DETERMINED, PARTLY):
        ax.axvline(line, color=GREY, lw=0.8, ls="--")
    ax.set_yticks(heights, [f.symbol for f in rows], fontsize=7.5)
    ax.set_ylim(len(rows) - 0.3, -0.7)
    ax.set_xlim(0, 1.02)
    ax.grid(axis="y", visible=False)
    ax.legend(fontsize=8, frameon=True, edgecolor="none", loc="upper right")
    return figure


def next_trial_plot(trial: NextTrial, findings: Sequence[CoefficientFinding], most: int = 16) -> Figure:
    """What each option of ``trial`` would take off the standard errors, the ``most`` best ones on top.

    findings: by coefficient; those that the data determine already, or that no option helps, are left out.
    """
    open_ = np.array([i for i, f in enumerate(findings) if f.kind != "determined" and trial.best(i)], dtype=int)
    needed = {int(np.argmin(trial.left[:, i])) for i in open_}
    ranked = sorted(range(len(trial.total)), key=lambda k: (k not in needed, trial.total[k]))[:most]
    rows = np.array(sorted(ranked, key=lambda k: trial.total[k]), dtype=int)
    height = 1.7 + 0.2 * max(len(rows), 3)
    if not len(open_):
        return _empty(
            height, f"no trial of the library would take {HELPS:.0%} off the variance of any open coefficient"
        )
    symbols, names = [findings[i].symbol for i in open_], [trial.options[k].name for k in rows]
    left, below = room_for_labels(names, 8), room_for_labels(symbols, 7.5) + 0.06
    figure, axes = placed_axes(height, (1, 1), (left, BAR, below, 0.08))
    ax = dress(axes[0, 0])
    ax.grid(visible=False)
    percent = 100 * (1 - np.sqrt(trial.left[np.ix_(rows, open_)]))
    image = ax.imshow(percent, cmap="Blues", vmin=0, vmax=max(20.0, percent.max()), aspect="auto", interpolation="none")
    ax.set_xticks(range(len(open_)), symbols, rotation=90, fontsize=7.5)
    ax.set_yticks(range(len(rows)), names, fontsize=8)
    for j in range(len(open_)):
        i = int(np.argmax(percent[:, j]))
        dark = percent[i, j] > 0.6 * image.get_clim()[1]
        ax.text(j, i, f"{percent[i, j]:.0f}", ha="center", va="center", fontsize=7, color="white" if dark else "black")
    _colour_bar(ax, image, "off the standard error [%]")
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


def write_identifiability_figures(written: FigureFolder, record: FitRecord, objects: FitObjects) -> None:
    """Write the figures of what trials determine, none where that is not known.

    written: where to; record: what the calibration found; objects: what stands behind it.
    """
    found, trial = objects.calibration.identifiability, objects.next_trial
    if all(f.kind == "unknown" for f in found.findings):
        return
    written.write(
        "identifiability_share", partial(share_plot, found.findings),
        "Who decided: prior's share of each coefficient's variance",
        "Bars: posterior by prior variance. Black tick: what it would be if all other coefficients were known; a long "
        "bar with a tick far to its left is a coefficient that trials excite but cannot separate from others.",
    )  # fmt: skip
    written.write(
        "identifiability_correlation", partial(correlation_plot, found), "Coefficients that trials cannot separate",
        "Correlation of the estimates, prior included; red: both may rise together, blue: one may rise when the other "
        "falls. Only coefficients with a correlation of at least 0.5.",
    )  # fmt: skip
    if trial and trial.options:
        written.write(
            "identifiability_next_trial", partial(next_trial_plot, trial, found.findings),
            "The trial that would determine most",
            f"Predicted fall of the standard errors when {trial.duration:.0f} s of a trial are added, best trial on "
            "top (by the mean prior's share); numbers at the best trial of each coefficient.",
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
