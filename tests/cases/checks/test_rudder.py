"""The turn rate against the low-passed rudder: the response is that of the equation, whatever the steps."""

from __future__ import annotations

import numpy as np
import pytest

from cases.checks.rudder import following
from cases.trial import Trial

T, SHARE = 4.0, 0.12
"""Time constant [s] and gain [1/s] of the ship's response."""


def turning(t: np.ndarray) -> Trial:
    """A ship at the times ``t`` whose turn rate follows a rudder that is put over every 15 s."""
    delta = 0.3 * np.where(np.floor(t / 15.0) % 2 == 0, 1.0, -1.0)
    r = np.zeros(len(t))
    for k, step in enumerate(np.diff(t)):
        left = np.exp(-step / T)
        r[k + 1] = left * r[k] + (1 - left) * SHARE * delta[k]
    still = np.zeros(len(t))
    columns = {"t": t, "x": 2.0 * t, "y": still, "psi": still, "u": still + 2.0, "v": still, "r": r}
    return Trial("turning", columns | {"n": still + 10.0, "delta": delta})


def clocks() -> dict[str, np.ndarray]:
    """Even, uneven and broken clocks [s]."""
    even = np.round(np.arange(0.0, 300.0, 0.2), 9)
    rng = np.random.default_rng(3)
    uneven = np.cumsum(np.concatenate([[0.0], rng.uniform(0.05, 0.4, 1400)]))
    return {"even": even, "uneven": uneven, "gap": np.concatenate([even[:700], even[700:] + 900.0])}


@pytest.mark.parametrize("name", clocks())
def test_the_correlation_is_that_of_the_recursion(name: str) -> None:
    trial = turning(clocks()[name])
    found = following(trial)
    low, delta = np.zeros(len(trial)), trial["delta"]
    low[0] = delta[0]
    for k, step in enumerate(np.diff(trial.t)):
        left = np.exp(-step / found["time_constant_s"])
        low[k + 1] = left * low[k] + (1 - left) * delta[k + 1]
    expected = low @ trial["r"] / np.sqrt((low @ low) * (trial["r"] @ trial["r"]))
    assert found["samples"] == len(trial)
    assert found["correlation"] == pytest.approx(expected, rel=1e-12)
    assert found["correlation"] > 0.95 and T / 3 < found["time_constant_s"] < 3 * T
