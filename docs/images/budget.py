"""Draws budget.svg: where the prediction error comes from after a year, by the diagnosis of ``mmg demo``.

Run from the repository root: python docs/images/budget.py (about half a minute).
"""

from pathlib import Path

import matplotlib.pyplot as plt

import mmg_ident as mi
from cases.simulation.demo_trials import demo_trials

CURRENT = "current:x=0.08,y=-0.05"
"""What the second campaign has and the model has not."""

plt.rcParams["svg.hashsalt"] = "budget"
ship = mi.calibrate("esso_osaka_3m", demo_trials(1)[0]).ship
train, held_out = demo_trials(1001, effects=[CURRENT])
budget = mi.diagnose(ship, train, held_out).budget
gap = budget.before - budget.floor
parts = [
    *((p.name, p.share * gap, p.interval_90) for p in (*budget.parts, budget.unexplained)),
    ("floor", budget.floor, None),
]
figure, ax = plt.subplots(figsize=(9, 1.5), layout="constrained")
left = 0.0
for (name, size, interval), color in zip(parts, ("#1b5e9b", "#a05a00", "#8b949c"), strict=False):
    words = f"{name} {100 * size / gap:.0f} % [{100 * interval[0]:.0f}, {100 * interval[1]:.0f}]" if interval else name
    ax.barh(0, size, left=left, color=color, label=words)
    left += max(size, 0.0)
ax.set(xlabel="mean squared scaled error of 30 s predictions of the test trials", yticks=[], xlim=(0, left))
ax.legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
figure.savefig(Path(__file__).with_suffix(".svg"), metadata={"Date": None})
