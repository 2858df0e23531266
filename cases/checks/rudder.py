"""Does the ship turn to starboard when delta says so? A first-order yaw response, going ahead."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cases.checks.report import INFO, Found
from cases.inputs import is_sampled
from cases.trial import Trial

TURNED = math.radians(1.0)
"""Heading passed in a sample from which on it matters whether a rudder is held over it: half of it is the error of an
overshoot."""

BLOCK, LONGEST = 32, 30.0
"""Steps of a low-pass that are taken together, and time constants that they may last: what is left of a block's start
must be more than rounding."""


def rudder_sign(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """What ``following`` gives of ``trial``; all files of a folder decide together whether a sign is wrong.

    A rudder that is taken as held although it moves over several samples is told of where that matters.
    """
    return following(trial), _held(trial)


def _held(trial: Trial) -> list[Found]:
    """Whether the heading turns by TURNED and more over a sample in which the rudder on its way is held."""
    if is_sampled(trial) is not None or "delta" not in trial:
        return []
    delta, rate = np.nan_to_num(trial["delta"]), trial["r"][np.isfinite(trial["r"])]
    turned = trial.dt * float(np.quantile(np.abs(rate), 0.95)) if len(rate) else 0.0
    moves = np.abs(np.diff(delta)) > math.radians(0.1)
    several = float((moves[1:] & moves[:-1]).sum())
    if turned < TURNED or several < 0.5 * moves.sum() or not several:
        return []
    text = (
        f"Held rudder: the heading turns by up to {math.degrees(turned):.1f} deg from one sample to the next, and the "
        "rudder, which moves over several samples, is taken as held in between; if it is the angle at the sample, say "
        'inputs = "sampled" in trials.toml, else "held".'
    )
    return [(INFO, "held_rudder", text)]


def following(trial: Trial, least: float = 0.02) -> dict[str, Any]:
    """Correlation in ``trial`` of r with the low-passed rudder angle while going ahead.

    Of several time constants the one with the strongest correlation counts: a Nomoto response T r' + r = K delta + c.
    The mean of both is taken off, as a wind turns a ship too; but not where she turns round, as a wind turns her only
    to the heading at which its moment vanishes. Ahead is where u is large, or, where u says nothing of that, the
    speed. None when the ship hardly goes ahead with rudder, of ``least`` [rad] at its greatest.
    """
    delta, r, u, n = trial.rudder, trial["r"], trial["u"], trial["n"]
    good = np.isfinite(delta) & np.isfinite(r) & np.isfinite(u) & np.isfinite(n)
    nothing: dict[str, Any] = {"correlation": None, "time_constant_s": None, "samples": 0}
    if good.sum() < 50:
        return nothing
    t, delta, r, u, n = trial.t[good], delta[good], r[good], u[good], n[good]
    speed = np.hypot(u, np.nan_to_num(trial["v"][good]))
    ahead = u if float(np.mean(u)) > 0.5 * float(np.mean(speed)) else speed
    fast = (ahead > 0.4 * max(float(np.percentile(ahead, 95)), 1e-6)) & ((n > 0) | (np.abs(n).max() == 0))
    if fast.sum() < 50 or float(np.abs(delta[fast]).max()) < least:
        return nothing
    best, constant = 0.0, 0.0
    share = 0.0 if abs(float(r[fast].sum())) * trial.dt > 2 * math.pi else 1.0
    turn = r[fast] - share * r[fast].mean()
    for T in np.geomspace(2 * trial.dt, max(trial.duration / 6, 4 * trial.dt), 7):
        slow = _low_pass(t, delta, float(T))[fast]
        slow = slow - share * slow.mean()
        size = float(np.sqrt((slow @ slow) * (turn @ turn)))
        value = float(slow @ turn) / size if size > 0 else 0.0
        if abs(value) > abs(best):
            best, constant = value, float(T)
    return {"correlation": best, "time_constant_s": constant, "samples": int(fast.sum())}


def _low_pass(t: np.ndarray, values: np.ndarray, T: float) -> np.ndarray:
    """First-order low-pass of time constant T [s], starting at the first value; uneven steps allowed.

    In blocks of BLOCK steps: what a block's inputs leave, all blocks side by side, and what is left of its start. (A
    banded solver would do, but scipy takes longer to read than a folder to check.)
    """
    passed = np.diff(t) / T
    blocks = -(-len(passed) // BLOCK)
    if not blocks or float(passed.max()) * BLOCK > LONGEST:
        return _step_by_step(t, values, T)
    steps, inputs = (np.zeros((blocks, BLOCK)) for _ in range(2))
    steps.flat[: len(passed)], inputs.flat[: len(passed)] = passed, values[1:]
    left = np.exp(-np.cumsum(steps, axis=1))
    own = left * np.cumsum((1 - np.exp(-steps)) * inputs / left, axis=1)
    starts, now = np.empty(blocks), float(values[0])
    for k, (kept, added) in enumerate(zip(left[:, -1].tolist(), own[:, -1].tolist(), strict=True)):
        starts[k], now = now, kept * now + added
    return np.concatenate([values[:1], (own + left * starts[:, None]).ravel()[: len(passed)]])


def _step_by_step(t: np.ndarray, values: np.ndarray, T: float) -> np.ndarray:
    """The same where steps are as long as T or longer."""
    keep, out = np.exp(-np.diff(t) / T).tolist(), [float(values[0])]
    for a, x in zip(keep, values[1:].tolist(), strict=True):
        out.append(a * out[-1] + (1 - a) * x)
    return np.array(out)
