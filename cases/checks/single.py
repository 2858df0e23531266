"""What one trial says by itself: sampling, the sign of its rudder, wind, how a ship moves, what its inputs excite.

How she moves tells of states that were derived from one another, as integrals cannot: she makes headway with
revolutions ahead. On straight legs both ways her sway is a share of her surge where the heading is off, and an
earth-fixed vector where there is a current; in turns it is against the turn, -x r at a distance x abaft the pivot
point (Yasukawa & Yoshimura 2015). A true wind does not turn with her. The coefficients that may be excited are those of
the low-speed four-quadrant model (Yoshimura 2009 hull, Hachii 2004 propeller, Yasukawa & Yoshimura 2015 rudder).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cases.checks.breaks import PROPELLERS, runs
from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, CheckReport, Found
from cases.evidence.competition import COST
from cases.evidence.shifts import SIGMAS
from cases.evidence.signals import MAD, PIECES, independent, jackknife
from cases.inputs import is_sampled
from cases.trial import REQUIRED, Trial
from mmg.errors import UserError
from mmg.messages import Message, has_code
from mmg.motion.flow import INPUTS
from mmg.motion.frames import apparent_wind
from mmg.ship import Ship

# A stretch without complete required columns that is longer than this many median steps is a gap.
GAP = 3.0  # set by hand (0, 1)
VELOCITIES = ("u", "v", "r")
# A spike differs from the mean of its neighbours by so many times the usual difference, and by this share of the range
# of the column (5 to 95 %); its neighbours agree with each other. Set by hand.
SPIKE, SPIKE_RANGE = 12.0, 0.5
STATES_AGREE = 0.5  # Neighbours of a spike differ by less than this share of its height. Set by hand.
COARSE = 0.2  # More than this [rad] a ship does not turn between samples that show how she turns. Set by hand.


def spikes(values: np.ndarray) -> int:
    """How many single samples of ``values`` (N,) stand far off both neighbours, which agree."""
    off = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:])) if len(values) > 2 else np.empty(0)
    if np.isfinite(off).sum() < 10:
        return 0
    changes = off[off > 0]  # a held value says nothing of what is usual
    usual = MAD * float(np.nanmedian(changes)) if len(changes) else 0.0
    low, high = np.nanquantile(values, (0.05, 0.95))
    agree = np.abs(values[2:] - values[:-2]) < STATES_AGREE * off
    return int(np.sum((off > SPIKE * usual) & (off > SPIKE_RANGE * (high - low)) & agree))


def sampling(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: rows, duration and sampling interval; uneven steps, gaps, missing samples, spikes of velocities,
    and too coarse a step."""
    steps = np.diff(trial.t)
    dt = float(np.median(steps))
    uneven = float(np.mean(np.abs(steps - dt) > 0.1 * dt))
    complete = np.flatnonzero(np.all([np.isfinite(trial[c]) for c in REQUIRED if c in trial], axis=0))
    t, between = trial.t[complete], np.diff(trial.t[complete])
    gaps = [(float(between[i]), float(t[i])) for i in np.flatnonzero(between > GAP * dt)]
    gaps = gaps if len(complete) > 1 else [(trial.duration, float(trial.t[0]))]
    longest, at = max(gaps, default=(0.0, 0.0))
    missing = {c: float(np.mean(~np.isfinite(v))) for c, v in trial.columns.items() if np.isnan(v).any()}
    spiky = {c: count for c in VELOCITIES if c in trial and (count := spikes(trial[c]))}
    turned = _turned_per_step(trial)
    numbers = {"rows": len(trial), "duration_s": trial.duration, "dt_s": dt}
    words = ", ".join(f"{count} in {c}" for c, count in spiky.items())
    holes = ", ".join(f"{c} {share:.0%}" for c, share in missing.items() if share > 0.05)
    coarse = (
        f"Coarse sampling: the heading turns by up to {np.degrees(turned):.0f} deg from one sample to the next, "
        f"{dt:.3g} s later; what the ship and her rudder do in between is not known, log faster."
    )
    off = f"Spikes: single samples far off both neighbours ({words}); leave these cells empty."
    lost = f"{len(gaps)} gap(s) in the states; the longest lasts {longest:.3g} s from t = {at:.6g} s."
    steps_off = f"Uneven sampling: {uneven:.0%} of the steps differ by more than 10 % from {dt:.4g} s."
    rows: list[tuple[Any, Found]] = [
        (spiky, (DOUBTFUL, "spikes", off)),
        (turned > COARSE, (DOUBTFUL, "coarse_sampling", coarse)),
        (gaps, (DOUBTFUL, "gaps", lost)),
        (uneven > 0.01, (INFO, "uneven_sampling", steps_off)),
        (holes, (DOUBTFUL, "missing_samples", f"Missing samples: {holes}.")),
        (trial.duration < 20 * dt, (DOUBTFUL, "short", f"Very short: {len(trial)} rows, {trial.duration:.3g} s.")),
    ]
    return numbers, [found for so, found in rows if so]


def _turned_per_step(trial: Trial) -> float:
    """How far [rad] the heading of ``trial`` turns from one sample to the next, but for the quickest twentieth."""
    rates = np.abs(trial["r"][np.isfinite(trial["r"])])
    return trial.dt * float(np.quantile(rates, 0.95)) if len(rates) else 0.0


# Heading passed in a sample [rad] from which on it matters whether a rudder is held over it: half of it is the error of
# an overshoot. Set by hand.
TURNED = math.radians(1.0)
# Change of a rudder that is no noise: it is logged to a tenth of a degree. Set by hand.
RUDDER_STEP = math.radians(0.1)


def held_rudder(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """A note where the heading of ``trial`` turns by TURNED and more over a sample in which the rudder is taken as
    held, though it moves over several."""
    if is_sampled(trial) is not None or "delta" not in trial:
        return {}, []
    turned = _turned_per_step(trial)
    moves = np.abs(np.diff(np.nan_to_num(trial["delta"]))) > RUDDER_STEP
    several = float((moves[1:] & moves[:-1]).sum())  # moves that last over more than one sample
    if turned < TURNED or several < 0.5 * moves.sum() or not several:
        return {}, []
    text = (
        f"Held rudder: the heading turns by up to {math.degrees(turned):.1f} deg from one sample to the next, and the "
        "rudder, which moves over several samples, is taken as held in between; if it is the angle at the sample, say "
        'inputs = "sampled" in trials.toml, else "held".'
    )
    return {}, [(INFO, "held_rudder", text)]


def following(trial: Trial, least: float = 0.02) -> tuple[float | None, float]:
    """Correlation in ``trial`` of r with the low-passed rudder angle while going ahead, and the time constant [s].

    Of several time constants the one with the strongest correlation counts: a Nomoto response T r' + r = K delta + c.
    The mean of both is taken off, as a wind turns a ship too; but not where she turns round, as a wind turns her only
    to the heading at which its moment vanishes. Ahead is where u is large, or, where u says nothing of that, the
    speed. None when the ship hardly goes ahead with rudder, of ``least`` [rad] at its greatest.
    """
    delta, r, u, n = trial.rudder, trial["r"], trial["u"], trial.revolutions
    good = np.isfinite(delta) & np.isfinite(r) & np.isfinite(u) & np.isfinite(n)
    if good.sum() < 50:
        return None, 0.0
    t, delta, r, u, n = trial.t[good], delta[good], r[good], u[good], n[good]
    speed = np.hypot(u, np.nan_to_num(trial["v"][good]))
    ahead = u if float(np.mean(u)) > 0.5 * float(np.mean(speed)) else speed  # u in a wrong frame is no headway
    fast = (ahead > 0.4 * max(float(np.percentile(ahead, 95)), 1e-6)) & ((n > 0) | (np.abs(n).max() == 0))
    if fast.sum() < 50 or float(np.abs(delta[fast]).max()) < least:
        return None, 0.0
    best, constant = 0.0, 0.0
    share = 0.0 if abs(float(r[fast].sum())) * trial.dt > 2 * math.pi else 1.0  # of the means that are taken off
    turn = r[fast] - share * r[fast].mean()
    for T in np.geomspace(2 * trial.dt, max(trial.duration / 6, 4 * trial.dt), 7):
        slow = _low_pass(t, delta, float(T))[fast]
        slow = slow - share * slow.mean()
        size = float(np.sqrt((slow @ slow) * (turn @ turn)))
        value = float(slow @ turn) / size if size > 0 else 0.0
        if abs(value) > abs(best):
            best, constant = value, float(T)
    return best, constant


def _low_pass(t: np.ndarray, values: np.ndarray, T: float) -> np.ndarray:
    """First-order low-pass of time constant T [s], starting at the first value; uneven steps allowed."""
    from scipy.linalg import solve_banded  # a tenth of a second that most calls of a short command do without

    keep = np.exp(-np.diff(t) / T)
    # y[k] = keep y[k-1] + (1 - keep) x[k], a bidiagonal system: one call instead of a loop over the samples
    inputs = np.concatenate([values[:1], (1 - keep) * values[1:]])
    return np.asarray(solve_banded((1, 0), np.stack([np.ones(len(t)), np.append(-keep, 0.0)]), inputs))


def wind(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """The ratio of the mean true wind of a ``trial`` to the ship's speed, and how well true and apparent columns agree:
    a derived true wind does so by construction and is not compared."""
    if not trial.has_wind:
        return {"ratio_to_ship_speed": None}, []
    speed, through, air = trial["wind_speed"], np.hypot(trial["u"], trial["v"]), trial.wind_vector
    if not all(np.isfinite(values).any() for values in (speed, through, air[:, 0])):
        return {"ratio_to_ship_speed": None}, []  # never known together
    ship, mean, findings = float(np.nanmean(through)), float(np.nanmean(speed)), list[Found]()
    if ship > 1e-6 and mean > 3 * ship:  # forces go with the square of the speed; set by hand
        text = f"The wind ({mean:.2f} m/s) is {mean / ship:.1f} times the ship's speed ({ship:.2f} m/s): "
        findings.append((INFO, "strong_wind", text + "a first-order force here, do not leave it out."))
    if float(np.nanmin(speed)) < 0:
        findings.append((DOUBTFUL, "negative_wind_speed", "The wind speed is negative at times; check the column."))
    measured = "apparent_wind_speed" in trial and "apparent_wind_direction" in trial
    if measured and not has_code(trial.notices, "true_wind_derived"):
        findings += _consistency(trial, mean)
    return {"ratio_to_ship_speed": mean / ship if ship > 1e-6 else None}, findings


# RMS difference of true and apparent wind above which they disagree: share of the mean wind, and at least so much
# [m/s]. Set by hand.
DIFFER, LEAST_DIFFERENCE = 0.15, 0.02
BETTER = 0.4  # Share of the difference as logged below which another reading explains it. Set by hand.


def _consistency(trial: Trial, mean: float) -> list[Found]:
    """Whether the apparent wind that follows from the true one, u, v and psi is not the logged one, by the RMS of their
    difference as vectors."""
    logged = trial["apparent_wind_speed"] * np.exp(1j * trial["apparent_wind_direction"])
    misfit = {}
    for turned, angle in (("as logged", 0.0), ("reversed", math.pi)):
        speed, direction = apparent_wind(
            trial["wind_speed"], trial["wind_direction"] + angle, trial["psi"], trial["u"], trial["v"]
        )
        misfit[turned] = math.sqrt(float(np.nanmean(np.abs(logged - speed * np.exp(1j * direction)) ** 2)))
    earth = trial["wind_speed"] * np.exp(1j * trial["wind_direction"])
    misfit["the same column twice"] = math.sqrt(float(np.nanmean(np.abs(logged - earth) ** 2)))
    if misfit["as logged"] <= max(DIFFER * mean, LEAST_DIFFERENCE):
        return []
    if misfit["reversed"] < BETTER * misfit["as logged"]:
        level, why = CONTRADICTORY, "the directions differ by 180 deg: one of them says where the wind goes to"
    elif misfit["the same column twice"] < BETTER * misfit["as logged"]:
        level, why = DOUBTFUL, "the apparent direction is not counted from the bow but equals the true one"
    else:
        level, why = DOUBTFUL, "check directions, heading and units"
    text = f"True wind, u, v and psi give an apparent wind {misfit['as logged']:.2f} m/s off the logged one; {why}."
    return [(level, "wind_direction", text)]


# Share of the greatest speed from which a ship goes ahead, and share of the time that counts as most of it. Set by
# hand, as STRAIGHT and MOSTLY: they choose rows, and no verdict hangs on a row.
AHEAD = 0.5
STRAIGHT = 0.2  # Share of the greatest turn rate within which a ship goes straight. Set by hand.
# Least eigenvalue of the correlations of surge, turn and heading, from which an offset is no current: about that of
# legs in directions a quarter turn apart. Set by hand.
APART = 0.1
MOSTLY = 0.9  # Share of the rows at speed, with revolutions ahead, in which sternway is no manoeuvre. Set by hand.
# Share of the greatest speed (95 %) from which a ship is at speed: what she has left when she is stopped is none. Set
# by hand, as SLOW, which leaves out speeds at which a drift angle is noise.
FAST = 0.8
# Turn of the heading, ahead, from which the sway tells where the pivot point lies: a wind alone turns no ship as far,
# and where it turns her, her bow drifts off. Set by hand.
TURNING = math.radians(90.0)
SLOW = 0.1  # Share of the greatest speed from which a drift angle is one of a ship that goes ahead. Set by hand.
# Share of the surge that the sway of a ship in such a turn exceeds: a degree of drift, where 3 to 20 are usual.
LEAST_DRIFT = 0.02  # set by hand
OFFSET = math.radians(2.0)  # A compass is right within it (IMO A.424: 1 deg times the secant of the latitude)
# Comparison -> what would make it, and what does not show without.
WOULD = {
    "track": "a speed log, or a receiver of its own for course and speed over ground, and runs in both directions "
    "would check it; an offset of the heading or a late receiver would not show",
    "turn": "a rate gyro would check it",
}


def not_checked(trial: Trial) -> list[Found]:
    """A note for each comparison of ``trial`` whose sides are relatives, and what would check them."""
    out: list[Found] = []
    for comparison, rest, of in (("track", "positions", ("u", "v")), ("turn", "heading", ("r",))):
        if independent(trial, comparison) or (comparison == "track" and not trial.has_position):
            continue
        made = [name for name in (*of, "x", "y", "psi") if name in trial.ancestors]
        roots = sorted({root for name in made for root in trial.roots(name)} - set(of))
        come = f"{', '.join(made)} come from {', '.join(roots)}" if roots else f"{', '.join(made)} were assumed"
        text = f"Not checked: {', '.join(of)} against the {rest}, as {come}; {WOULD[comparison]}."
        out.append((INFO, "not_checked", text))
    return out


def _ahead(trial: Trial, most: float = math.inf, least: float = AHEAD) -> np.ndarray:
    """Rows (M,) of ``trial`` in which the ship goes ahead, faster than ``least`` of the greatest speed and at a turn
    rate of at ``most`` so much of the greatest."""
    u, v, r = trial["u"], trial["v"], trial["r"]
    good = np.isfinite(u) & np.isfinite(v) & np.isfinite(r) & np.isfinite(trial["psi"])
    if good.any():
        good &= np.nan_to_num(u) > least * float(np.quantile(np.hypot(u[good], v[good]), 0.95))
        good &= np.abs(np.nan_to_num(r)) <= most * float(np.nanquantile(np.abs(r), 0.95))  # 95 %: spikes are no maximum
        good &= ~(trial["n"] < 0) if "n" in trial else True  # a reversed propeller pushes the stern aside
    return np.flatnonzero(good)


def _turns(trials: Sequence[Trial], least: float) -> list[tuple[Trial, np.ndarray]]:
    """Those of ``trials`` that turn by TURNING and more ahead, faster than ``least`` of the greatest speed, with these
    rows."""
    pairs = [(trial, rows) for trial in trials if len(rows := _ahead(trial, least=least)) > 1]
    return [(trial, rows) for trial, rows in pairs if np.ptp(trial.psi_unwrapped[rows]) > TURNING]


def _regressed(trials: Sequence[Trial], most: float = math.inf) -> tuple[np.ndarray, np.ndarray, float]:
    """Offset, pivot and current (north, east), (4,), their standard errors, and the least eigenvalue of what they are
    regressed on, over the rows of ``_ahead``; NaN without any."""
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    for trial in trials:
        psi = trial["psi"]
        A = np.stack([trial["u"], -trial["r"], -np.sin(psi), np.cos(psi)], axis=1)
        for rows in np.array_split(_ahead(trial, most), PIECES):
            blocks.append((A[rows].T @ A[rows], A[rows].T @ trial["v"][rows]))
    N, h = (np.stack(some) for some in zip(*blocks, strict=True))
    if not N.any():
        return np.full(4, math.nan), np.full(4, math.nan), 0.0
    # columns of unit length: the eigenvalues are then those of their correlations, whatever their units
    size = np.sqrt(np.diag(N.sum(axis=0))) + 1e-12
    N, h = N / np.outer(size, size), h / size
    flat = 1e-6 * np.eye(4)  # keeps the system regular where the ship runs on one heading
    values, std = jackknife(N, h, flat)
    return values / size, std / size, float(np.linalg.eigvalsh(N.sum(axis=0))[0])


def sway_findings(trials: Sequence[Trial]) -> list[Found]:
    """Doubts about heading and reference point, from what the sway of ``trials`` of one ship going ahead is together:
    v = offset u - pivot r + a current across, the offset [rad] where she goes straight, the pivot [m] in turns."""
    out: list[Found] = []
    if not trials:
        return out
    values, std, least = _regressed(trials, STRAIGHT)
    off, error = float(values[0]), float(std[0])
    if least > APART and abs(off) > max(SIGMAS * error, OFFSET):
        side = "starboard" if off > 0 else "port"
        text = (
            f"On all headings the ship goes {abs(math.degrees(off)):.1f} deg to {side} of hers (standard error "
            f"{math.degrees(error):.1g}): the heading is off, by a mounting or by a variation"
        )
        out.append((DOUBTFUL, "heading_offset", text))
    turns = _turns(trials, SLOW)
    if not turns:
        return out
    v, u = (np.concatenate([trial[name][rows] for trial, rows in turns]) for name in "vu")
    drift = math.sqrt(np.sum(v**2) / np.sum(u**2))
    if drift < LEAST_DRIFT:
        text = (
            f"The ship does not drift in turns (sway is {drift:.1%} of surge): psi is the course over ground, or "
            "velocities are those of an antenna at the pivot point (reference_point)"
        )
        out.append((DOUBTFUL, "course_heading", text))
        return out
    turns = _turns(trials, AHEAD)
    if not turns:
        return out
    values, std, _ = _regressed([trial for trial, _ in turns])
    ahead, error = float(values[1]), float(std[1])
    if -ahead > SIGMAS * error:
        text = (
            f"The stern does not swing out: sway goes with the turn, as {-ahead:.3g} m ahead of the pivot point "
            f"(standard error {error:.1g}): velocities or positions are those of an antenna far forward "
            "(reference_point), or v has the other sign"
        )
        out.append((DOUBTFUL, "lever_arm", text))
    return out


def headway(trial: Trial) -> list[Found]:
    """A doubt where the ship of ``trial`` goes astern while, at her speed, her propellers push her ahead."""
    u = trial["u"]
    speed = np.hypot(u, trial["v"])
    if not np.isfinite(speed).any():
        return []
    fast = speed > FAST * np.nanquantile(speed, 0.95)
    thrust = _pushed(trial)
    driven = fast & (thrust > 0.1 * np.nanmax(np.abs(thrust), initial=1e-9))
    if driven.sum() < max(PIECES, AHEAD * fast.sum()) or np.mean(u[driven] < 0) < MOSTLY:
        return []
    text = (
        "At speed, with revolutions ahead, the ship goes astern: n is positive astern, u is, or the heading is turned "
        "by 180 deg"
    )
    return [(DOUBTFUL, "u_sign", text)]


def _pushed(trial: Trial) -> np.ndarray:
    """Revolutions (N,) [1/s] of all propellers of ``trial`` as they push ahead, those of a pod by the cosine of its
    angle."""
    thrust = np.zeros(len(trial))
    for name in trial.columns:
        if name in PROPELLERS:
            thrust = thrust + trial[name]
        elif name.startswith("n_azimuth") and (angle := name.removeprefix("n_")) in trial:
            thrust = thrust + trial[name] * np.cos(trial[angle])
    return thrust


# Revolutions astern over which a ship loses way: a crash stop takes 200 to 1000, as 15 ship lengths (IMO MSC.137(76))
# are some 400 propeller diameters. Set by hand.
ASTERN = 300.0
# Share of her speed that she loses from the second to the last third of them; a tanker that needs 1000 loses a tenth.
LOST = 0.1  # set by hand


def revolutions_sign(trials: Sequence[Trial]) -> list[list[Found]]:
    """For each of ``trials`` of one ship: a contradiction where revolutions astern push her at speed, half of her
    greatest in any of them, if in one of them she then goes on ahead for long. Of a controllable pitch or pods the
    revolutions do not tell."""
    speeds = [np.hypot(trial["u"], trial["v"]) for trial in trials]
    greatest = max((float(np.nanquantile(s, 0.95)) for s in speeds if np.isfinite(s).any()), default=0.0)
    kept, pushed_back = [(0.0, 0.0, "n")], []  # revolutions astern, speed after them, shaft; share of the rows at speed
    for trial in trials:
        names, u = [name for name in PROPELLERS if name in trial], trial["u"]
        told = names and "pitch" not in trial and not any(name.startswith("n_azimuth") for name in trial.columns)
        name = min(names, key=lambda shaft: float(np.nanmean(trial[shaft])), default="n")  # of two, either may be wrong
        n = trial[name] if told else np.zeros(len(trial))
        fast = u > AHEAD * greatest
        astern = fast & (n < -0.1 * np.nanmax(np.abs(n), initial=0.0))
        pushed_back.append(float(astern.sum()) / max(float(fast.sum()), 1.0))
        for first, last in runs(astern):
            made, third = -float(n[first:last].sum()) * trial.dt, (last - first) // 3
            if made > ASTERN and third:
                end = float(np.mean(u[last - third : last]))
                kept += [(made, end, name)] if end > (1 - LOST) * np.mean(u[last - 2 * third : last - third]) else []
    made, end, name = max(kept)
    text = (
        f"Under revolutions astern the ship goes on ahead, at {end:.3g} m/s after {made:.0f} of them, which would stop "
        f"her: {name} is positive astern, or u is, as where the heading is turned by 180 deg"
    )
    said: list[Found] = [(CONTRADICTORY, "revolutions_sign", text)]
    return [said if made and share > MOSTLY else [] for share in pushed_back]


def turning_wind(trial: Trial) -> list[Found]:
    """A doubt where the true wind of ``trial`` is steadier in another reading than as it is, as the ship turns."""
    if not trial.has_wind:
        return []
    air, turn = trial.wind_vector @ [1.0, 1j], np.exp(1j * trial["psi"])
    readings = {
        "": air,
        "its direction is counted from the bow": air * turn,
        "it is the apparent wind": air * turn + (trial["u"] + 1j * trial["v"]) * turn,
        "it turns with the ship: its direction, or the angle of the apparent wind it was derived from, has another "
        "sign or zero": air * turn.conj(),
    }
    valid = np.isfinite(list(readings.values())).all(axis=0)
    if valid.sum() < 10 * PIECES:
        return []
    spread = {words: float(np.var(w[valid])) + 1e-12 for words, w in readings.items()}
    words = min(spread, key=lambda words: spread[words])
    nats = PIECES * math.log(spread[""] / spread[words])  # log likelihood ratio of normal vectors, one a piece
    if nats < COST or spread[words] > 0.5 * spread[""]:
        return []
    return [(DOUBTFUL, "wind_direction", f"The true wind would be steadier if {words} (log odds {nats:.0f})")]


# s; a group excited for less than this is weakly excited (or 2 % of the trial, if that is longer). Set by hand. (1, 1).
ENOUGH = 20.0
# Group of coefficients -> what must happen for it to matter, and the pattern of the symbols.
GROUPS = {
    "hull_ahead": ("headway (u > 0)", r"X_0F?|R_0"),
    "hull_astern": ("sternway (u < 0)", r"X_0A"),
    "cross_flow": ("drift beyond 30 deg or turning nearly on the spot", r"C_D|C_rY|C_rN"),
    "sway_yaw_linear": ("sway and yaw at headway", r"Y_v|Y_r|N_v|N_r|X_vr"),
    "propeller_ahead": ("n > 0 with u > 0", r"k_[0-2]|t_P|w_P0|tau|C_P"),
    "propeller_ahead_astern_motion": ("n > 0 with u < 0", r"[AB]_[678]"),
    "propeller_reversed": ("n < 0", r"C_(3|6|7|10)|[AB]_[1-5]"),
    "rudder_ahead": ("rudder angles with n > 0 and u > 0", r"t_R|a_H|x_H|ell_R|gamma_[PN]|k_x|epsilon"),
    "rudder_reversed_flow": ("rudder angles with n < 0 and u > 0, or u < 0", r"k_xR|C_PR"),
    "wind": ("true wind above the ship's speed from changing sides", r"[XYN]_A\d+"),
}
# Keys of the quadrants in the numbers -> the words for them.
QUADRANTS = {
    "u+ n+": "ahead with n > 0",
    "u+ n-": "ahead with n < 0",
    "u- n+": "astern with n > 0",
    "u- n-": "astern with n < 0",
    "n 0": "propeller stopped",
    "u 0": "no way on",
}


def excitation(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: seconds per coefficient group and range of revolutions, findings about what is not excited."""
    u, v, r, n, delta = trial["u"], trial["v"], trial["r"], trial.revolutions, trial.rudder
    good = np.isfinite(u) & np.isfinite(v) & np.isfinite(r) & np.isfinite(n) & np.isfinite(delta)
    seconds = np.minimum(np.gradient(trial.t), 3 * trial.dt)  # that a row stands for: a gap belongs to none
    total = float(seconds[good].sum())
    if total <= 0:
        text = "No row holds u, v, r, n and delta together: nothing to identify."
        return {}, [(DOUBTFUL, "nothing_to_identify", text)]
    # below a fiftieth of her speed a ship has no way on; set by hand, as the other thresholds here
    still = 0.02 * max(float(np.percentile(np.hypot(u[good], v[good]), 95)), 1e-9)
    ahead, astern = good & (u > still), good & (u < -still)
    forward, reverse, stopped = good & (n > 1e-6), good & (n < -1e-6), good & (np.abs(n) <= 1e-6)
    quadrants = {
        "u+ n+": ahead & forward, "u+ n-": ahead & reverse,
        "u- n+": astern & forward, "u- n-": astern & reverse,
        "n 0": stopped, "u 0": good & ~ahead & ~astern & ~stopped,
    }  # fmt: skip
    beta = np.abs(np.arctan2(v, np.abs(u)))
    steered = np.abs(delta) > math.radians(2.0)
    moving = np.hypot(u, v) > still
    turning = np.abs(r) > 0.25 * max(float(np.percentile(np.abs(r[good]), 95)), 1e-9)
    excited = {
        "hull_ahead": ahead,
        "hull_astern": astern,
        "cross_flow": (good & moving & (beta > math.radians(30))) | (good & ~moving & turning),
        "sway_yaw_linear": ahead & turning & (np.abs(r) > 1e-4),
        "propeller_ahead": ahead & forward,
        "propeller_ahead_astern_motion": astern & forward,
        "propeller_reversed": reverse,
        "rudder_ahead": ahead & forward & steered,
        "rudder_reversed_flow": steered & ((ahead & reverse) | astern),
        "wind": _windy(trial, good),
    }
    shares = {name: float(seconds[mask].sum()) / total for name, mask in quadrants.items()}
    group_seconds = {name: float(seconds[mask].sum()) for name, mask in excited.items()}
    n_range = [float(n[good].min()), float(n[good].max())]
    numbers = {"group_seconds": group_seconds, "seconds": total, "n_range_rps": n_range}
    nothing = (DOUBTFUL, "nothing_to_identify", "No actuator ever changes: nothing to identify.")
    of_time = ", ".join(f"{QUADRANTS[name]} {share:.0%}" for name, share in shares.items() if share >= 0.005)
    rest = [(INFO, "not_excited", text) for text in _missing(group_seconds, total)]
    return numbers, [*[nothing] * inputs_are_constant(trial), (INFO, "quadrants", f"Share of time: {of_time}."), *rest]


def inputs_are_constant(trial: Trial) -> bool:
    """True when in ``trial`` no actuator ever changes: nothing to identify."""
    names = [c for c in INPUTS if c in trial and np.isfinite(trial[c]).any()]
    spans = [float(np.nanmax(trial[c]) - np.nanmin(trial[c])) for c in names]
    return all(span < 1e-9 for span in spans)


def pooled(reports: Iterable[CheckReport], ship: Ship | None = None) -> tuple[dict[str, float], list[str]]:
    """Seconds per coefficient group over all ``reports``, and sentences about groups that are not excited. ship: whose
    coefficients are named in these sentences; groups of which it has none are left out."""
    excited = [numbers for report in reports if (numbers := report.numbers.get("excitation"))]
    seconds = {name: sum((numbers["group_seconds"][name] for numbers in excited), 0.0) for name in GROUPS}
    return seconds, _missing(seconds, sum(numbers["seconds"] for numbers in excited), ship)


def _missing(seconds: dict[str, float], total: float, ship: Ship | None = None) -> list[str]:
    """Never excited: one sentence per group; hardly excited: one sentence for all of them."""
    free = list(ship.free) if ship else []
    symbols = {name: [s for s in free if re.fullmatch(pattern, s)] for name, (_, pattern) in GROUPS.items()}
    wanted_inputs = [name for name in seconds if ship is None or symbols[name]]
    never = [name for name in wanted_inputs if seconds[name] <= 0]
    few = [name for name in wanted_inputs if 0 < seconds[name] < max(ENOUGH, 0.02 * min(total, 2000.0))]
    listed = {name: ", ".join(found) for name, found in symbols.items()}
    behind = {name: f": {found} cannot be determined" if found else "" for name, found in listed.items()}
    sentences = [f"Never {GROUPS[name][0]}{behind[name]}." for name in never]
    if few:
        hardly = [f"{GROUPS[k][0]} {seconds[k]:.1f} s{f' ({listed[k]})' if listed[k] else ''}" for k in few]
        sentences.append(f"Hardly excited: {'; '.join(hardly)}.")
    return sentences


def _windy(trial: Trial, good: np.ndarray) -> np.ndarray:
    """Rows with a true wind stronger than the ship's speed, if it comes from more than a 60 deg sector."""
    if not trial.has_wind:
        return np.zeros(len(trial), bool)
    angle = trial["wind_direction"] - trial["psi"]
    strong = good & np.isfinite(angle) & (trial["wind_speed"] > np.hypot(trial["u"], trial["v"]))
    sectors = np.unique(np.floor((angle[strong] % (2 * math.pi)) / math.radians(30)))
    return strong & (len(sectors) > 2)  # a third sector of 30 deg lies beyond any 60 deg


# Rudder angle [rad] and r L/U within which a ship goes about straight ahead. Set by hand.
STRAIGHT_RUDDER, STRAIGHT_TURN = math.radians(5.0), 0.1
# Share of her greatest speed from which she is under way; share by which speed and revolutions may change over half a
# ship length; ship lengths that must be made so. Set by hand.
FASTEST, STEADY, LEAST = 0.5, 0.03, 0.5
# Ratio of the revolutions that the ship needs to those that were logged, or the other way round, from which they do not
# fit: wider than fouling, wind and a poor guess of the resistance make it. Set by hand, to find a gear or a unit.
TWICE = 1.6


def steady_ahead(trial: Trial, length: float) -> tuple[float, float] | None:
    """Median revolutions [1/s] and speed [m/s] of a ``trial`` where the ship of this ``length`` [m] goes straight ahead
    at a steady speed, or None."""
    delta, n, u, r = trial.rudder, trial.revolutions, trial["u"], trial["r"]
    if not np.isfinite(u).any():
        return None
    fast = max(FASTEST * float(np.nanquantile(u, 0.95)), 1e-3)
    rows = max(1, round(0.5 * FASTEST * length / fast / trial.dt))
    ahead = (np.abs(delta) < STRAIGHT_RUDDER) & (u > fast) & (n > 0) & (np.abs(r) * length < STRAIGHT_TURN * u)
    for values in (u, n):
        later = np.concatenate([values[rows:], np.full(min(rows, len(values)), np.nan)])
        ahead &= np.abs(later - values) < STEADY * values
    if float(u[ahead].sum()) * trial.dt < LEAST * length:
        return None
    return float(np.median(n[ahead])), float(np.median(u[ahead]))


def doubtful_revolutions(ship: Ship, trials: Sequence[Trial]) -> list[Message]:
    """A sentence, code "revolutions", where the revolutions of ``trials`` do not give their speeds with the propeller
    of the ``ship``; or none."""
    from cases.maneuvers.self_propulsion import revolutions_for  # CasADi, which a check without a ship does without

    if "n" not in ship.actuators:
        return []
    able = [trial for trial in trials if "n" in trial and ("delta" in trial or "delta_port" in trial)]
    ratios: list[tuple[float, float, float, float]] = []  # ratio, speed, revolutions needed and logged
    for n, u in filter(None, (steady_ahead(trial, float(ship.particulars["L"])) for trial in able)):
        with suppress(UserError):
            needed = revolutions_for(ship, u)
            ratios.append((needed / n, u, needed, n))
    if not ratios or 1 / TWICE < np.median([ratio for ratio, *_ in ratios]) < TWICE:
        return []
    _, u, needed, n = sorted(ratios)[len(ratios) // 2]
    words = (
        f"the propeller does not fit: at {u:.3g} m/s straight ahead {ship.name} needs {needed:.3g} "
        f"revolutions per second, the trials have {n:.3g}; check the unit of n, a gear ratio, D_P and pitch_ratio"
    )
    return [Message(words, "revolutions")]
