"""What one file says by itself of its sampling, of the sign of its rudder and of its wind."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, Found
from cases.inputs import is_sampled
from cases.trial import REQUIRED, Trial
from mmg.messages import has_code
from mmg.motion.frames import apparent_wind

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


TURNED = math.radians(1.0)
"""Heading passed in a sample from which on it matters whether a rudder is held over it: half of it is the error of an
overshoot."""


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
    """First-order low-pass of time constant T [s], starting at the first value; uneven steps allowed."""
    from scipy.linalg import solve_banded  # a tenth of a second that most calls of a short command do without

    keep = np.exp(-np.diff(t) / T)
    inputs = np.concatenate([values[:1], (1 - keep) * values[1:]])
    return np.asarray(solve_banded((1, 0), np.stack([np.ones(len(t)), np.append(-keep, 0.0)]), inputs))


def wind(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: mean true wind, its ratio to the ship's speed, and how well true and apparent columns agree.

    consistency_m_s is the RMS vector difference between the logged apparent wind and the one that follows
    from the true wind, u, v and psi; derived true wind agrees by construction and is not compared.
    """
    names = ("mean_m_s", "std_m_s", "ratio_to_ship_speed", "steadiness", "consistency_m_s")
    numbers: dict[str, Any] = dict.fromkeys(names)
    if not trial.has_wind:
        return numbers, []
    speed, through, air = trial["wind_speed"], np.hypot(trial["u"], trial["v"]), trial.wind_vector
    if not all(np.isfinite(values).any() for values in (speed, through, air[:, 0])):
        return numbers, []  # never known together
    ship, mean, vector = float(np.nanmean(through)), float(np.nanmean(speed)), np.nanmean(air, axis=0)
    numbers.update(
        mean_m_s=mean,
        std_m_s=float(np.nanstd(speed)),
        ratio_to_ship_speed=mean / ship if ship > 1e-6 else None,
        steadiness=float(np.hypot(*vector)) / mean if mean > 1e-9 else None,
    )
    findings = []
    if ship > 1e-6 and mean > 3 * ship:
        text = f"The wind ({mean:.2f} m/s) is {mean / ship:.1f} times the ship's speed ({ship:.2f} m/s): "
        findings.append((INFO, "strong_wind", text + "a first-order force here, do not leave it out."))
    if float(np.nanmin(speed)) < 0:
        findings.append((DOUBTFUL, "negative_wind_speed", "The wind speed is negative at times; check the column."))
    measured = "apparent_wind_speed" in trial and "apparent_wind_direction" in trial
    if measured and not has_code(trial.notices, "true_wind_derived"):
        findings += _consistency(trial, mean, numbers)
    return numbers, findings


def _consistency(trial: Trial, mean: float, numbers: dict[str, Any]) -> list[Found]:
    """Adds consistency_m_s to the numbers and says when the two descriptions of the wind disagree."""
    logged = trial["apparent_wind_speed"] * np.exp(1j * trial["apparent_wind_direction"])
    misfit = {}
    for turned, angle in (("as logged", 0.0), ("reversed", math.pi)):
        speed, direction = apparent_wind(
            trial["wind_speed"], trial["wind_direction"] + angle, trial["psi"], trial["u"], trial["v"]
        )
        misfit[turned] = math.sqrt(float(np.nanmean(np.abs(logged - speed * np.exp(1j * direction)) ** 2)))
    earth = trial["wind_speed"] * np.exp(1j * trial["wind_direction"])
    misfit["the same column twice"] = math.sqrt(float(np.nanmean(np.abs(logged - earth) ** 2)))
    numbers["consistency_m_s"] = misfit["as logged"]
    if misfit["as logged"] <= max(0.15 * mean, 0.02):
        return []
    if misfit["reversed"] < 0.4 * misfit["as logged"]:
        level, why = CONTRADICTORY, "the directions differ by 180 deg: one of them says where the wind goes to"
    elif misfit["the same column twice"] < 0.4 * misfit["as logged"]:
        level, why = DOUBTFUL, "the apparent direction is not counted from the bow but equals the true one"
    else:
        level, why = DOUBTFUL, "check directions, heading and units"
    text = f"True wind, u, v and psi give an apparent wind {misfit['as logged']:.2f} m/s off the logged one; {why}."
    return [(level, "wind_direction", text)]
