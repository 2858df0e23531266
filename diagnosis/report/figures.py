"""Figures of a diagnosis: the ranking of the candidates, what the gap is on test trials, shares by channel and band.

Those of where the gap lies are in ``diagnosis.report.where_figures``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from diagnosis.findings import Findings, RankedCandidate
from diagnosis.report.where_figures import state_figure, track_figure
from fitting.report.plot_style import AFTER, ALARM, BEFORE, GREY, MEASURED, dress, new_figure

CLASS = "#7FB8D8"
"""What cannot be told from the named effect."""
BAND_COLOURS = ("#3B3B3B", "#6B5B95", "#0072B2", "#56B4E9", "#B9DDF0", "#DDDDDD")
"""From the mean of a run to the fastest band."""


def ranking_figure(d: Findings, most: int = 14) -> Figure:
    """Candidates: score of the test at the fit without effects, and gain in BIC of those that were refitted."""
    rows = list(d.candidates[:most])[::-1]
    figure = new_figure(1.3 + 0.27 * len(rows))
    left, right = figure.subplots(1, 2, sharey=True)
    at = np.arange(len(rows))
    colours = [_colour(d, row) for row in rows]
    dress(left, "chi-squared of the test (square-root scale)", title="How loudly each asks to be in the model")
    left.barh(at, [max(row.score, 0.0) for row in rows], color=colours, height=0.66)
    left.set_xscale("function", functions=(lambda x: np.sqrt(np.maximum(x, 0)), np.square))
    left.set_yticks(at, [row.name.replace("_", " ") for row in rows], fontsize=8.5)
    top = max([row.score for row in rows] + [1.0])
    left.set_xlim(0, 1.45 * top)
    left.set_xticks([t for t in _ticks(top)])
    for i, row in enumerate(rows):
        left.text(max(row.score, 0.0), i, f"  {p_words(row)}", va="center", fontsize=7.5, color="#444444")
    dress(right, "gain in BIC when refitted (symmetric-log scale)", title="What it gains when all is refitted")
    known = {e.name: e.delta_bic for e in d.effects}  # of a second one: beside the first
    gains = [known.get(row.name, row.delta_bic) for row in rows]
    right.barh(at, [g if g is not None else 0.0 for g in gains], color=colours, height=0.66)
    right.axvline(0, color=MEASURED, lw=0.8)
    right.set_xscale("symlog", linthresh=10.0)
    reach = [g for g in gains if g is not None] or [0.0]
    right.set_xlim(min(-12.0, 2.5 * min(reach)), max(12.0, 4.0 * max(reach)))
    for i, gain in enumerate(gains):
        words = "  not refitted" if gain is None else f"  {gain:+.0f}".replace("-", "−")
        words += " beside the first" if rows[i].name in list(known)[1:] else ""
        right.text(max(gain or 0.0, 0.0), i, words, va="center", fontsize=7.5, color="#444444" if gain else GREY)
    _legend(figure, d)
    return figure


def _ticks(top: float) -> Iterable[float]:
    """A few round numbers from zero, evenly spaced by their roots."""
    wanted = top * np.linspace(0, 1, 5) ** 2
    return sorted({float(f"{x:.1g}") for x in wanted})


def _colour(d: Findings, row: RankedCandidate) -> str:
    named = {e.name for e in d.effects}
    return AFTER if row.name in named else CLASS if row.name in d.equivalence_class else "#C4C9CE"


def _legend(figure: Figure, d: Findings) -> None:
    """Which colour is what; only colours that occur."""
    items = [("named", AFTER, bool(d.effects)), ("cannot be told from it", CLASS, bool(d.equivalence_class))]
    items.append(("other candidates" if d.effects else "candidates, none of them named", "#C4C9CE", True))
    shown = [(words, color) for words, color, used in items if used]
    handles = [Patch(color=color) for _, color in shown]
    names = [words for words, _ in shown]
    figure.legend(handles, names, loc="outside lower center", ncols=3, fontsize=8.5, frameon=False)


def p_words(row: RankedCandidate) -> str:
    """The probability of a candidate's test in a few words."""
    if not row.excited:
        return "not excited"
    if row.p_value >= 0.01:
        return f"p = {row.p_value:.2f}"
    return f"p = {row.p_value:.4f}" if row.p_value >= 1e-4 else "p < 0.0001"


def held_out_figure(d: Findings) -> Figure:
    """Error on the test trials before and after, by trial with the total; and by length of the prediction."""
    held = d.held_out
    assert held is not None
    rows = [*held.by_run.items(), ("all windows", (held.mse_before, held.mse_after))][::-1]
    figure = new_figure(1.5 + 0.34 * max(len(rows), 4))
    left, right = figure.subplots(1, 2, width_ratios=[1.6, 1.0])
    dress(left, "mean squared error of 30 s windows", title="By test trial")
    _pairs(left, rows)
    left.axhline(0.5, color=GREY, lw=0.8)
    low, high = (-100 * x for x in held.interval_90[::-1])
    words = f"all: {-100 * held.reduction:+.0f} % [{low:+.0f}, {high:+.0f}]".replace("-", "−")
    left.text(0.99, 0.02, words, transform=left.transAxes, ha="right", va="bottom", fontsize=8.5, fontweight="bold")
    dress(right, "error after / before", title="By length of the prediction")
    if held.horizons:
        names = list(held.horizons)[::-1]
        shares = [held.horizons[n][1] / max(held.horizons[n][0], 1e-300) for n in names]
        right.barh(names, shares, color=[AFTER if s <= 1 else ALARM for s in shares], height=0.4)
        right.set_ylim(-0.7, len(names) - 0.3)
        for i, share in enumerate(shares):
            right.text(share, i, f"  {share:.2f}", va="center", fontsize=8.5)
        right.axvline(1.0, color=MEASURED, lw=1.0)
        right.set_xlim(0, max(1.25, 1.2 * max(shares)))
    else:
        right.axis("off")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=2, fontsize=8.5, frameon=False)
    return figure


def _pairs(ax: Axes, rows: list[tuple[str, tuple[float, float]]]) -> None:
    """A line from before to after for each row, on a logarithmic scale."""
    for i, (_, (before, after)) in enumerate(rows):
        ax.plot([before, after], [i, i], color=AFTER if after <= before else ALARM, lw=2.0, zorder=1)
    errors = np.array([pair for _, pair in rows])  # (rows, 2)
    at = np.arange(len(rows))
    ax.plot(errors[:, 0], at, "o", color=BEFORE, ms=6, ls="", label="without the effect", zorder=2)
    ax.plot(errors[:, 1], at, "s", color=AFTER, ms=6, ls="", label="with it", zorder=3)
    least, top = float(errors.min()), float(errors.max())
    if least > 0 and top > 15 * least:
        ax.set_xscale("log")
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    else:
        ax.set_xlim(0, 1.08 * top)
    ax.set_yticks(at, [name for name, _ in rows], fontsize=8.5)
    ax.get_yticklabels()[0].set_fontweight("bold")
    ax.set_ylim(-0.7, len(rows) - 0.3)


def share_figure(d: Findings) -> Figure:
    """Energy of the missing force by channel and, within, by how fast it changes; below it what is left after."""
    channels = d.where["channels"]
    later = any("force_rms_after" in row for row in channels.values())
    names = list(channels)
    figure = new_figure(2.6 if later else 2.1)
    ax = dress(figure.subplots(), "share of the energy of the missing force [%]")
    labels: list[str] = []
    for i, name in enumerate(names[::-1]):
        rows = [b for b in d.where["bands"] if b["channel"] == name]
        square = channels[name]["force_rms"] ** 2
        for part, shift in (("force_rms", 0.2 if later else 0.0), ("force_rms_after", -0.2)):
            if part not in channels[name]:
                continue
            start = 0.0
            for b, colour in zip(rows, BAND_COLOURS, strict=False):
                width = 100 * channels[name]["share"] * b[part] ** 2 / square if square > 0 else 0.0
                ax.barh(
                    i + shift,
                    width,
                    0.34 if later else 0.5,
                    left=start,
                    color=colour,
                    label=_once(labels, band_words(b)),
                )
                start += width
            text = f" {channels[name][part]:.2g} {channels[name]['unit']}" + (
                " after" if part.endswith("after") else ""
            )
            ax.text(start, i + shift, text, va="center", fontsize=8)
    ax.set_yticks(range(len(names)), names[::-1], fontsize=9)
    ax.set_xlim(0, max(100 * row["share"] for row in channels.values()) * 1.2)
    figure.legend(loc="outside upper center", ncols=3, fontsize=8.5, frameon=False)
    return figure


def _once(labels: list[str], words: str) -> str:
    """The words, or no label where they were used already."""
    if words in labels:
        return "_"
    labels.append(words)
    return words


def band_words(band: dict) -> str:
    """A band by its periods."""
    if band["words"]:
        return "constant through a run"
    slow, fast = (1 / band[key] if band[key] > 0 else np.inf for key in ("from_hz", "to_hz"))
    return f"periods of {fast:.2g} to {slow:.3g} s"


@dataclass(frozen=True)
class Drawn:
    """A figure of the report: name of its file, title, caption, and the function that draws it."""

    name: str
    title: str
    caption: str
    draw: Callable[[Findings], Figure]


TRACK = Drawn(
    "where_on_track", "The missing force on the track",
    "Seen from above, north up; a dot marks the start, outlines the ship. Arrows: surge and sway force that the "
    "calibrated ship without any further effect lacks (smoothed latent force), one scale for all panels. Colour of the "
    "track: the missing yaw moment. Trials with the largest missing force.",
    track_figure,
)  # fmt: skip
RANKING = Drawn(
    "ranking", "Candidates",
    "Left: score test of each effect at the fit without any; p is that of the largest of all candidates under chance "
    "alone. Right: gain in BIC when coefficients, effect, missing force and noise are fitted together (above 0: worth "
    "its parameters; 6 is a strong difference).",
    ranking_figure,
)  # fmt: skip
HELD_OUT = Drawn(
    "held_out", "Test trials, without and with the effect",
    "Open-loop predictions of trials that took no part, by the ship refitted without and with what was named. "
    "Brackets: 90 % interval, by drawing trials again.",
    held_out_figure,
)  # fmt: skip
STATE = Drawn(
    "where_in_state", "What the missing force follows",
    "Missing force averaged in bins, positive ahead, to starboard, bow to starboard. Bars: two standard errors. Panels "
    "by how much of the mean square the average explains, less what chance would explain.",
    state_figure,
)  # fmt: skip
SHARE = Drawn(
    "shares", "Which channel, how fast",
    "Surge, sway and yaw are compared by the kinetic energy that each would give to the free ship in the same time; "
    "rms at the ends of the bars.",
    share_figure,
)  # fmt: skip


def figures_for(d: Findings) -> tuple[Drawn, ...]:
    """Figures that this diagnosis can have; the one of the test trials only where there are any, that of the tracks
    only with the fit."""
    held = (HELD_OUT,) if d.held_out is not None and d.verdict == "named" else ()
    track = (TRACK,) if d.null is not None and d.data is not None else ()
    return (*track, STATE, RANKING, *held, SHARE) if d.where else (RANKING, *held)
