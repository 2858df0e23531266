"""Draws held_out.svg: synthetic runs that took no part, predicted before and after calibration.

Run from the repository root: python docs/images/held_out.py (about a minute).
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import mmg_ident as mi
from cases.simulation.demo_trials import demo_trials

SHIP, WINDOW = "esso_osaka_3m", 100.0
"""Start of the calibration; seconds after which a prediction begins anew at the measured state."""

plt.rcParams["svg.hashsalt"] = "held_out"
train, held_out = demo_trials(1)
models = {"captive model tests": SHIP, "calibrated": mi.calibrate(SHIP, train)}
figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for ax, run in zip(axes, held_out, strict=False):
    thin = slice(None, None, round(1.0 / run.dt))  # a point a second
    ax.plot(run["y"][thin], run["x"][thin], color="0.55", lw=4, alpha=0.6, label="measured")
    for (words, model), color in zip(models.items(), ("#c1440e", "#1b5e9b"), strict=True):
        (prediction,) = mi.predict(model, run, window=WINDOW, stride=WINDOW, adapt=0)
        gap = np.full((1, 6), np.nan)
        states = np.vstack([part for w in prediction.windows for part in (w.states[thin], gap)])
        ax.plot(states[:, 1], states[:, 0], color=color, lw=1.3, label=words)
    ax.set(xlabel="east [m]", ylabel="north [m]", title=run.kind)
    ax.set_aspect("equal", adjustable="datalim")
axes[0].legend(frameon=False, fontsize=8)
figure.savefig(Path(__file__).with_suffix(".svg"), metadata={"Date": None})
