"""Sampling of a trial: rate, unevenness, gaps, missing samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from cases.checks.report import DOUBTFUL, INFO, Found
from cases.trial import REQUIRED, Trial

GAP = 3.0
"""A stretch without complete required columns that is longer than this many median steps is a gap."""


def sampling(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: rows, duration, sampling interval, share of uneven steps, gaps, NaN share per column."""
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
    findings = []
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
