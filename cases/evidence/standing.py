"""Columns that stand still over a whole record while others say that they must not."""

from __future__ import annotations

import numpy as np

from cases.inputs import integral
from cases.trial import Trial

TURNED = 0.1
"""rad; a heading turns at least so far before its own column, or that of the turn rate, must have shown it."""

VARIED = 0.05
"""Share of the speed by which the velocity of the track varies before u must have shown it; half of it for v."""

STANDS = 0.98
"""Share of the rows with one value, from which a column stands still."""


def standing(trial: Trial) -> dict[str, str]:
    """Column -> what says that it must have moved, of ``trial``, in words."""
    psi, r = trial.psi_unwrapped, trial["r"]
    still = {name for name in ("psi", "u", "v", "r", "x", "y") if name in trial and _stands(trial[name])}
    out: dict[str, str] = {}
    if not still or len(trial) < 20:
        return out
    turned, integrated = _range(psi), _range(integral(trial.t, np.nan_to_num(r)))
    if "r" in still and turned > TURNED:
        out["r"] = f"the heading turns by {turned:.2g} rad"
    if "psi" in still and integrated > TURNED:
        out["psi"] = f"the turn rate makes {integrated:.2g} rad"
    speed = float(np.sqrt(np.nanmean(trial["u"] ** 2 + trial["v"] ** 2)))
    if {"x", "y"} <= still and speed * trial.duration > 1.0:
        out |= dict.fromkeys(("x", "y"), f"the ship runs at {speed:.2g} m/s")
    elif "x" in trial and "y" in trial and not {"x", "y", "psi"} & still:
        track = _track(trial)
        size = float(np.sqrt(np.mean(np.abs(track) ** 2)))
        if "u" in still and float(np.std(track.real)) > VARIED * size:
            out["u"] = f"the speed of the track varies by {float(np.ptp(track.real)):.2g} m/s"
        if "v" in still and float(np.std(track.imag)) > 0.5 * VARIED * size:
            out["v"] = f"the track drifts by up to {float(np.abs(track.imag).max()):.2g} m/s"
    return out


def _stands(values: np.ndarray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.mean(known == np.median(known))) >= STANDS


def _range(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _track(trial: Trial) -> np.ndarray:
    """Velocity of the track in body axes (M,), of pieces of a fiftieth of the record."""
    place, psi = trial["x"] + 1j * trial["y"], trial.psi_unwrapped
    good = np.isfinite(place) & np.isfinite(psi)
    t, place, psi = trial.t[good], place[good], psi[good]
    rows = max(len(t) // 50, 1)
    middle = psi[rows // 2 : rows // 2 + len(t) - rows]
    return np.asarray((place[rows:] - place[:-rows]) / (t[rows:] - t[:-rows]) * np.exp(-1j * middle))
