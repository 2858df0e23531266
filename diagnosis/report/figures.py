"""Figures of a diagnosis: ranking of the candidates, error on the test trials, missing force by channel and band.

A panel is drawn by a function of the findings and an axes; figures of several panels are put together from those. Those
of where the gap lies are in ``diagnosis.report.where_figures``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from diagnosis.findings import Findings, HeldOut, RankedCandidate
from diagnosis.report.where_figures import state_figure, track_figure, unexplained_figure
from diagnosis.report.where_words import places
from fitting.report.plot_style import AFTER, ALARM, BEFORE, GREY, HATCH, MEASURED, dress, new_figure

COLOURS = {"named": AFTER, "class": "#7FB8D8", "": "#C4C9CE"}
"""Of the candidates, by their role."""
HATCHES = {"named": "", "class": HATCH, "": ""}
"""Of their bars."""
BAND_COLOURS = ("#262626", "#4F4580", "#0072B2", "#4FA6DC", "#A5D3EE", "#ECECEC")
"""From the mean of a run to the fastest band, ever lighter in grey too."""
EDGE: dict[str, Any] = {"edgecolor": "white", "linewidth": 0}
"""Of bars: the colour of their hatches."""
SHOWN = 14
"""Candidates in the ranking."""


def _shown(d: Findings) -> list[RankedCandidate]:
    """The best candidates, the best last, as bars are stacked."""
    return list(d.candidates[:SHOWN])[::-1]


def _looks(d: Findings) -> dict[str, Any]:
    """Colours and hatches of the bars of the candidates."""
    roles = [d.role(c.name) for c in _shown(d)]
    return {"color": [COLOURS[r] for r in roles], "hatch": [HATCHES[r] for r in roles], **EDGE}


def plot_scores(d: Findings, ax: Axes) -> None:
    """Score tests of the candidates of ``d`` at the fit without effects, into ``ax``."""
    rows = _shown(d)
    at = np.arange(len(rows))
    dress(ax, "chi-squared of the score test (square-root scale)", title="Score test, without any effect")
    ax.barh(at, [max(row.score, 0.0) for row in rows], **_looks(d), height=0.66)
    ax.set_xscale("function", functions=(lambda x: np.sqrt(np.maximum(x, 0)), np.square))
    ax.set_yticks(at, [row.name.replace("_", " ") for row in rows], fontsize=8.5)
    top = max([row.score for row in rows] + [1.0])
    ax.set_xlim(0, 1.45 * top)
    ax.set_xticks(sorted({float(f"{x:.1g}") for x in top * np.linspace(0, 1, 5) ** 2}))
    for i, row in enumerate(rows):
        ax.text(max(row.score, 0.0), i, f"  {p_words(row)}", va="center", fontsize=7.5, color="#444444")


def plot_gains(d: Findings, ax: Axes) -> None:
    """Gain in BIC of the candidates of ``d`` that were refitted, into ``ax``; of a second effect: beside the first."""
    rows = _shown(d)
    dress(ax, "gain in BIC (symmetric-log scale)", title="Gain in BIC after the refit")
    known = {e.name: e.delta_bic for e in d.effects}
    gains = [known.get(row.name, row.delta_bic) for row in rows]
    ax.barh(np.arange(len(rows)), [g if g is not None else 0.0 for g in gains], **_looks(d), height=0.66)
    ax.axvline(0, color=MEASURED, lw=0.8)
    ax.set_xscale("symlog", linthresh=10.0)
    reach = [g for g in gains if g is not None] or [0.0]
    ax.set_xlim(min(-12.0, 2.5 * min(reach)), max(12.0, 4.0 * max(reach)))
    for i, gain in enumerate(gains):
        words = "  not refitted" if gain is None else f"  {gain:+.0f}".replace("-", "−")
        words += " beside the first" if rows[i].name in list(known)[1:] else ""
        ax.text(max(gain or 0.0, 0.0), i, words, va="center", fontsize=7.5, color="#444444" if gain else GREY)


def ranking_figure(d: Findings) -> Figure:
    """``plot_scores`` and ``plot_gains`` of ``d`` side by side."""
    figure = new_figure(1.3 + 0.27 * len(_shown(d)))
    left, right = figure.subplots(1, 2, sharey=True)
    plot_scores(d, left)
    plot_gains(d, right)
    other = "other candidates" if d.effects else "candidates, none of them named"
    items = [("named", bool(d.effects)), ("class", bool(d.equivalence_class)), ("", True)]
    names = {"named": "named", "class": "cannot be told from it", "": other}
    handles = [
        Patch(facecolor=COLOURS[role], hatch=HATCHES[role], label=names[role], **EDGE) for role, used in items if used
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8.5, frameon=False)
    return figure


def p_words(row: RankedCandidate) -> str:
    """The probability of a candidate's test in a few words; row: of the ranking."""
    if not row.excited:
        return "not excited"
    if row.p_value >= 0.01:
        return f"p = {row.p_value:.2f}"
    return f"p = {row.p_value:.4f}" if row.p_value >= 1e-4 else "p < 0.0001"


def held_out_figure(d: Findings) -> Figure:
    """Error on the test trials of ``d`` before and after, by trial; and by length of the prediction."""
    held = d.held_out
    assert held is not None
    figure = new_figure(1.5 + 0.34 * max(len(held.by_run) + 1, 4))
    left, right = figure.subplots(1, 2, width_ratios=[1.6, 1.0])
    plot_test_trials(held, left)
    plot_horizons(held, right)
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=2, fontsize=8.5, frameon=False)
    return figure


def plot_test_trials(held: HeldOut, ax: Axes) -> None:
    """Error of each test trial of ``held`` and of all, before and after, joined by a line, into ``ax``."""
    rows = held.all_runs[::-1]
    dress(ax, "mean squared error of 30 s windows", title="By test trial")
    for i, (_, (before, after)) in enumerate(rows):
        look = {"color": AFTER, "ls": "-"} if after <= before else {"color": ALARM, "ls": (0, (2, 1))}
        ax.plot([before, after], [i, i], lw=2.0, zorder=1, **look)
    errors, at = np.array([pair for _, pair in rows]), np.arange(len(rows))  # (rows, 2)
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
    ax.axhline(0.5, color=GREY, lw=0.8)
    change, high, low = (f"{-100 * x:+.{places(x)}f}" for x in (held.reduction, *held.interval_90))
    words = f"all: {change} % [{low}, {high}]".replace("-", "−")
    ax.text(0.99, 0.02, words, transform=ax.transAxes, ha="right", va="bottom", fontsize=8.5, fontweight="bold")


def plot_horizons(held: HeldOut, ax: Axes) -> None:
    """Error after by error before of the test trials ``held``, for one step, 30 s and whole runs, into ``ax``."""
    horizons = held.horizons
    dress(ax, "error after / before", title="By length of the prediction")
    if not horizons:
        ax.axis("off")
        return
    names = list(horizons)[::-1]
    shares = [horizons[n][1] / max(horizons[n][0], 1e-300) for n in names]
    looks = [(AFTER, "") if s <= 1 else (ALARM, HATCH) for s in shares]
    colours, hatches = ([look[k] for look in looks] for k in (0, 1))
    ax.barh(names, shares, color=colours, hatch=hatches, **EDGE, height=0.4)
    ax.set_ylim(-0.7, len(names) - 0.3)
    for i, share in enumerate(shares):
        ax.text(share, i, f"  {share:.2f}", va="center", fontsize=8.5)
    ax.axvline(1.0, color=MEASURED, lw=1.0)
    ax.set_xlim(0, max(1.25, 1.2 * max(shares)))


def share_figure(d: Findings) -> Figure:
    """Energy of the missing force of ``d`` by channel and band, and below it what is left after."""
    channels = d.where["channels"]
    later = any("force_rms_after" in row for row in channels.values())
    figure = new_figure(2.6 if later else 2.1)
    ax = dress(figure.subplots(), "share of the energy of the missing force [%]")
    labels: set[str] = set()
    for i, name in enumerate(list(channels)[::-1]):
        row = channels[name]
        for part, shift in (("force_rms", 0.2 if later else 0.0), ("force_rms_after", -0.2)):
            if part not in row:
                continue
            start, scale = 0.0, 100 * row["share"] / row["force_rms"] ** 2 if row["force_rms"] > 0 else 0.0
            bands = [b for b in d.where["bands"] if b["channel"] == name]
            for b, colour in zip(bands, BAND_COLOURS, strict=False):
                width, words = scale * b[part] ** 2, band_words(b)
                label = "_" if words in labels else words
                ax.barh(
                    i + shift,
                    width,
                    0.34 if later else 0.5,
                    left=start,
                    color=colour,
                    label=label,
                    edgecolor="#555555",
                    linewidth=0.4,
                )
                labels.add(words)
                start += width
            text = f" {row[part]:.2g} {row['unit']}" + (" after" if part.endswith("after") else "")
            ax.text(start, i + shift, text, va="center", fontsize=8)
    ax.set_yticks(range(len(channels)), list(channels)[::-1], fontsize=9)
    ax.set_xlim(0, max(100 * row["share"] for row in channels.values()) * 1.2)
    figure.legend(loc="outside upper center", ncols=3, fontsize=8.5, frameon=False)
    return figure


def band_words(band: dict) -> str:
    """A row ``band`` of where["bands"] by its periods."""
    if band["words"]:
        return "constant through a run"
    slow, fast = (1 / band[key] if band[key] > 0 else np.inf for key in ("from_hz", "to_hz"))
    return f"periods of {fast:.2g} to {slow:.3g} s"


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the report: name of its file, title, caption, and the function that draws it."""

    name: str
    title: str
    caption: str
    draw: Callable[[Findings], Figure]


def figures_for(d: Findings) -> tuple[ReportFigure, ...]:
    """Figures that ``d`` can have: that of the test trials only with an effect named, that of the tracks only with the
    fit, which a diagnosis read from a folder has not."""
    where, fitted = bool(d.where), d.null is not None and d.data is not None
    every = (
        (
            d.unexplained_force is not None and bool(d.unexplained_force.times) and fitted, "unexplained_force",
            "The unexplained force", unexplained_figure,
            "Left: the force that motion, inputs, wind and place explain in an unnamed way, with its 90 % band, in the "
            "trial in which it is largest (shaded), and in grey the whole latent force of the fit, chance included. "
            "Right: its mean over the variable that it follows most.",
        ),
        (
            where and fitted, "where_on_track", "The missing force on the track", track_figure,
            "Tracks from above, north up. A dot marks the start, outlines show the ship. Arrows: the surge and sway "
            "force that the calibrated ship lacks (smoothed latent force); all panels have one scale. Colour of the "
            "track: the missing yaw moment. The trials with the largest missing force are shown.",
        ),
        (
            where, "where_in_state", "What the missing force depends on", state_figure,
            "Missing force averaged in bins; positive: ahead, to starboard, bow to starboard. Bars: two standard "
            "errors. The panels are in order of the share of the mean square that the average explains beyond chance.",
        ),
        (
            bool(d.candidates), "ranking", "Candidates", ranking_figure,
            "Left: score test of each effect at the fit without any effect. p is the probability that chance alone "
            "makes the best of all candidates score as high. Right: gain in BIC when coefficients, effect, missing "
            "force and noise are fitted together. Above 0 the effect is worth its parameters; a difference of 6 is "
            "strong.",
        ),
        (
            d.held_out is not None and d.verdict == "named", "held_out", "Test trials, without and with the effect",
            held_out_figure,
            "Open-loop predictions of trials that took no part, by the ship refitted without and with the named "
            "effects. Brackets: 90 % interval, by drawing trials again.",
        ),
        (
            where, "shares", "Which channel, which frequencies", share_figure,
            "Energy of the missing force. Surge, sway and yaw are compared by the kinetic energy that each would give "
            "to the free ship in the same time. The rms stands at the ends of the bars.",
        ),
    )  # fmt: skip
    return tuple(ReportFigure(name, title, words, draw) for there, name, title, draw, words in every if there)
