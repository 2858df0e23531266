"""Does the ship turn to starboard when delta says so? A first-order yaw response, going ahead."""

from __future__ import annotations

from typing import Any

import numpy as np

from cases.checks.report import CONTRADICTORY, Found
from cases.trial import Trial


def rudder_sign(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Correlation (without mean) in ``trial`` of r with the low-passed rudder angle while going ahead.

    Of several time constants the one with the strongest correlation counts: a Nomoto response T r' + r = K delta. Below
    -0.5 the sign of the rudder, or of the whole frame, is wrong. None when the ship hardly goes ahead with rudder.
    """
    delta, r, u, n = trial.rudder, trial["r"], trial["u"], trial["n"]
    good = np.isfinite(delta) & np.isfinite(r) & np.isfinite(u) & np.isfinite(n)
    nothing: dict[str, Any] = {"correlation": None, "time_constant_s": None, "samples": 0}
    if good.sum() < 50:
        return nothing, []
    t, delta, r, u, n = trial.t[good], delta[good], r[good], u[good], n[good]
    fast = (u > 0.4 * max(float(np.percentile(u, 95)), 1e-6)) & ((n > 0) | (np.abs(n).max() == 0))
    if fast.sum() < 50 or float(np.abs(delta[fast]).max()) < 0.02 or u[fast].mean() <= 0:
        return nothing, []
    best, constant = 0.0, 0.0
    for T in np.geomspace(2 * trial.dt, max(trial.duration / 8, 4 * trial.dt), 7):
        slow = _low_pass(t, delta, float(T))[fast]
        size = float(np.sqrt((slow @ slow) * (r[fast] @ r[fast])))
        value = float(slow @ r[fast]) / size if size > 0 else 0.0
        if abs(value) > abs(best):
            best, constant = value, float(T)
    numbers = {"correlation": best, "time_constant_s": constant, "samples": int(fast.sum())}
    if best > -0.5:
        return numbers, []
    text = (
        f"Going ahead the ship turns to port when delta is positive (correlation {best:.2f}): the rudder is "
        'positive to port (rudder_positive = "port" in trials.toml), or y, v, psi and r are mirrored '
        "(sign = { y = -1, v = -1, psi = -1, r = -1 })."
    )
    return numbers, [(CONTRADICTORY, "rudder_sign", text)]


def _low_pass(t: np.ndarray, values: np.ndarray, T: float) -> np.ndarray:
    """First-order low-pass of time constant T [s], starting at the first value; uneven steps allowed."""
    keep, out = np.exp(-np.diff(t) / T).tolist(), [float(values[0])]
    for a, x in zip(keep, values[1:].tolist(), strict=True):
        out.append(a * out[-1] + (1 - a) * x)
    return np.array(out)
