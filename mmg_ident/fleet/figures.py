"""Figures over the ships of a fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.report.plot_style import AFTER, ALARM, GREY, dress, literal, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mmg_ident.fleet.run import SisterGroup

MOST_COLUMNS, MOST_PANELS = 24, 9


def moved_symbols(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Coefficients that moved in any ship of ``rows``, those that moved in most ships first."""
    count: dict[str, int] = {}
    for row in rows:
        for symbol in row["moved"]:
            count[symbol] = count.get(symbol, 0) + 1
    return sorted(count, key=lambda s: -count[s])[:MOST_COLUMNS]


def moved_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """By how many standard deviations of the start each of the ``moved_symbols`` moved in each ship of ``rows``."""
    symbols = moved_symbols(rows)
    values = np.array([[_number(row["coefficients"].get(s, {}).get("moved")) for s in symbols] for row in rows])
    figure = new_figure(0.24 * len(rows) + 1.7)
    ax = figure.subplots()
    image = ax.imshow(np.clip(values, -3, 3), cmap="RdBu_r", vmin=-3, vmax=3, aspect="auto")
    for i, row in enumerate(rows):
        for k, symbol in enumerate(symbols):
            if symbol in row["moved"]:
                ax.plot(k, i, ".", color="black", markersize=4)
    dress(ax)
    ax.grid(False)
    ax.set_xticks(range(len(symbols)), [literal(s) for s in symbols], rotation=60, ha="right", fontsize=7.5)
    ax.set_yticks(range(len(rows)), [literal(row["name"]) for row in rows], fontsize=8)
    bar = figure.colorbar(image, ax=ax, fraction=0.03, pad=0.01)
    bar.ax.tick_params(labelsize=8)
    bar.set_label("std of the start", fontsize=8)
    return figure


def sister_figure(group: SisterGroup) -> Figure:
    """Estimates of the sisters of ``group`` for the coefficients that differ most, with the mean and the width."""
    w = group.widths
    order = np.argsort(-w.width)[:MOST_PANELS]
    columns = 3
    lines = -(-len(order) // columns)
    figure = new_figure((0.17 * len(group.ships) + 0.75) * lines)
    axes = np.atleast_1d(figure.subplots(lines, columns, sharey=True, squeeze=False)).ravel()
    place = np.arange(len(group.ships))[::-1]
    for ax, i in zip(axes, order, strict=False):
        centre, unit = w.centre[i], w.unit[i]
        mean, width = centre + unit * w.mean[i], unit * w.width[i]
        ax.axvspan(mean - width, mean + width, color="#DDE3E8", linewidth=0)
        ax.axvline(mean, color=GREY, linewidth=1.0)
        values, errors = centre + unit * w.estimate[:, i], unit * w.std[:, i]
        ax.errorbar(values, place, xerr=errors, fmt="none", ecolor=AFTER, elinewidth=1.1)
        far = np.abs(w.from_others[:, i]) > 3
        ax.scatter(values, place, s=16, c=np.where(far, ALARM, AFTER), zorder=3)
        dress(ax, "", "", w.symbols[i])
        ax.set_yticks(place, [literal(name) for name in group.ships], fontsize=7.5)
        ax.locator_params(axis="x", nbins=4)
    for ax in axes[len(order) :]:
        ax.set_visible(False)
    return figure


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)
