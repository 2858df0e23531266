"""Cost of PD gains by the true ship, by one member and by the worst particle: Fig. 9 of Wakita et al. (2025)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from benchmarks.ensembles.heading_keeping import Judgement
from fitting.report.plot_style import ALARM, dress, new_figure


def judgement_plot(judgements: Mapping[str, Judgement], kp: np.ndarray, kd: np.ndarray) -> Figure:
    """A row per ensemble; gains as ``grid(kp, kd)``. Circle: the best. Cross: promised 5 % less than the true cost."""
    figure = new_figure(0.4 + 2.6 * len(judgements))
    axes = figure.subplots(len(judgements), 3, squeeze=False, sharex=True, sharey=True)
    costs = np.degrees(np.concatenate([[j.true, j.worst, j.particles[0]] for j in judgements.values()]))
    norm = LogNorm(float(costs.min()), float(costs.max()))
    for i, (name, j) in enumerate(judgements.items()):
        panels = {"true ship": j.true, "one network": j.particles[0], f"worst of {len(j.particles)}": j.worst}
        for k, (title, cost) in enumerate(panels.items()):
            ax, last = axes[i, k], i == len(judgements) - 1
            dress(ax, "K_d [s]" if last else "", f"{name}: K_p" if k == 0 else "", title).grid(False)
            image = ax.pcolormesh(kd, kp, np.degrees(cost).reshape(len(kp), len(kd)), norm=norm, shading="nearest")
            ax.set_xscale("log")
            ax.set_yscale("log")
            over = cost < 0.95 * j.true
            ax.plot(j.gains[over, 1], j.gains[over, 0], "x", color=ALARM, markersize=4)
            best = np.argmin(cost)
            ax.plot(j.gains[best, 1], j.gains[best, 0], "o", markerfacecolor="none", color="white", markersize=8)
    bar = figure.colorbar(image, ax=axes, shrink=0.8, format="%g")
    bar.ax.yaxis.set_minor_formatter("{x:g}")
    bar.ax.tick_params(which="both", labelsize=8)
    bar.set_label("rms heading error [deg]", fontsize=9)
    return figure
