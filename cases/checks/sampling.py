"""Sampling of a trial: rate, unevenness, gaps, missing samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from cases.checks.report import DOUBTFUL, INFO, Found
from cases.trial import REQUIRED, Trial

GAP = 3.0
"""A stretch without complete required columns that is longer than this many median steps is a gap."""
VELOCITIES = ("u", "v", "r")
SPIKE, SPIKE_RANGE = 12.0, 0.5
"""A spike differs from the mean of its neighbours by so many times the usual difference, and by this share of the range
of the column (5 to 95 %); its neighbours agree with each other."""
COARSE = 0.2
"""More than this [rad] a ship does not turn between samples that show how she turns."""


def spikes(values: np.ndarray) -> int:
    """How many single samples of ``values`` (N,) stand far off both neighbours, which agree."""
    off = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:])) if len(values) > 2 else np.empty(0)
    if np.isfinite(off).sum() < 10:
        return 0
    moved = off[off > 0]
    usual = 1.4826 * float(np.nanmedian(moved)) if len(moved) else 0.0
    low, high = np.nanquantile(values, (0.05, 0.95))
    beside = np.abs(values[2:] - values[:-2])
    return int(np.sum((off > SPIKE * usual) & (off > SPIKE_RANGE * (high - low)) & (beside < 0.5 * off)))


def sampling(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: rows, duration, sampling interval, share of uneven steps, gaps, NaN share per column, spikes per
    velocity, and how far the heading turns within a step."""
    steps = np.diff(trial.t)
    dt = float(np.median(steps))
    uneven = float(np.mean(np.abs(steps - dt) > 0.1 * dt))
    whole = np.flatnonzero(np.all([np.isfinite(trial[c]) for c in REQUIRED if c in trial], axis=0))
    t, between = trial.t[whole], np.diff(trial.t[whole])
    gaps = [(float(t[i]), float(between[i])) for i in np.flatnonzero(between > GAP * dt)]
    gaps = gaps if len(whole) > 1 else [(float(trial.t[0]), trial.duration)]
    missing = {c: float(np.mean(~np.isfinite(v))) for c, v in trial.columns.items() if np.isnan(v).any()}
    numbers = {
        "rows": len(trial),
        "duration_s": trial.duration,
        "dt_s": dt,
        "dt_min_s": float(steps.min()),
        "dt_max_s": float(steps.max()),
        "uneven_share": uneven,
        "gaps": len(gaps),
        "longest_gap_s": max((length for _, length in gaps), default=0.0),
        "nan_share": missing,
    }
    spiky = {c: count for c in VELOCITIES if c in trial and (count := spikes(trial[c]))}
    numbers["spikes"] = spiky
    rates = trial["r"][np.isfinite(trial["r"])]
    numbers["turn_per_step_rad"] = turned = dt * float(np.quantile(np.abs(rates), 0.95)) if len(rates) else 0.0
    findings = []
    if spiky:
        words = ", ".join(f"{count} in {c}" for c, count in spiky.items())
        text = f"Spikes: single samples far off both neighbours ({words}); leave these cells empty."
        findings.append((DOUBTFUL, "spikes", text))
    if turned > COARSE:
        text = (
            f"Coarse sampling: the heading turns by up to {np.degrees(turned):.0f} deg from one sample to the next, "
            f"{dt:.3g} s later; what the ship and her rudder do in between is not known, log faster."
        )
        findings.append((DOUBTFUL, "coarse_sampling", text))
    if gaps:
        at, length = max(gaps, key=lambda gap: gap[1])
        text = f"{len(gaps)} gap(s) in the states; the longest lasts {length:.3g} s from t = {at:.6g} s."
        findings.append((DOUBTFUL, "gaps", text))
    if uneven > 0.01:
        text = f"Uneven sampling: {uneven:.0%} of the steps differ by more than 10 % from {dt:.4g} s."
        findings.append((INFO, "uneven_sampling", text))
    worst = [c for c in missing if missing[c] > 0.05]
    if worst:
        text = "Missing samples: " + ", ".join(f"{c} {missing[c]:.0%}" for c in worst) + "."
        findings.append((DOUBTFUL, "missing_samples", text))
    if trial.duration < 20 * dt:
        findings.append((DOUBTFUL, "short", f"Very short: {len(trial)} rows, {trial.duration:.3g} s."))
    return numbers, findings
