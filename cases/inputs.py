"""The inputs that a ship's model takes: from the columns of a trial, or as a program gives them, as numbers, arrays or
functions of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from cases.quantities import wraps
from cases.trial import Trial
from mmg.errors import BadValue, Conflict, Missing, as_array, in_order
from mmg.messages import Message
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS, STATES

if TYPE_CHECKING:
    from mmg.ship import Ship

# Inputs of a single-screw, single-rudder ship [1/s, rad, m/s, m/s]
STANDARD = ("n", "delta", "wind_north", "wind_east")
# Value of ``inputs`` in a sidecar: actuators are as they are at each sample, not held from there to the next.
SAMPLED = "sampled"
_STAND_INS = {"delta_port": "delta", "delta_starboard": "delta", "n_2": "n"}
# Actuators that a trial may leave out: they follow another column, or are taken to be at rest.
_AT_REST = tuple(name for name in INPUTS if name in ("n_bow", "n_stern") or "azimuth" in name)


def actuator_columns(trial: Trial, actuators: Sequence[str]) -> tuple[np.ndarray, list[Message]]:
    """Columns (N, A) of the ``actuators`` of a model from a ``trial``, and notices on what was assumed.

    They are held from each sample to the next; of a file with ``inputs = "sampled"`` they are means from each to the
    next.

    Raises UserError when the trial lacks one for which nothing can stand in, or all that drive the ship, or moves one
    that the model does not have.
    """
    used = {*actuators, *(_STAND_INS[name] for name in actuators if name in _STAND_INS and name not in trial)}
    _check_driven(trial, actuators)
    columns, notices = [], []
    for name in actuators:
        other = _STAND_INS.get(name, "")
        if name in trial:
            columns.append(trial.unwrapped(name) if wraps(name) else trial[name])  # means go the short way round
        elif other in trial:
            columns.append(trial[other])
            notices.append(Message(f"{trial.name}: no column {name}, so {name} = {other}", "stand_in"))
        elif name in _AT_REST:
            columns.append(np.zeros(len(trial)))
            text = f"{trial.name}: no column {name}, so it is taken to be at rest"
            notices.append(Message(text, "at_rest"))
        else:
            words, unit = INPUTS[name]
            why = f" [{unit}] ({words}), which the ship's model needs"
            if name == "delta" and "delta_port" in trial:
                why = "; its twin rudders need a ship model with two rudders"
            raise Missing(f"{trial.name}: no column {name}{why}")
    _check_unused(trial, used)
    ignored = [name for name in INPUTS if name in trial and name not in used and np.nan_to_num(trial[name]).any()]
    if ignored:
        text = f"{trial.name}: {', '.join(ignored)}: the ship's model has no such input, so it is ignored"
        notices.append(Message(text, "input_ignored"))
    array = np.column_stack([*columns]) if columns else np.empty((len(trial), 0))
    return (_over_each_sample(array) if is_sampled(trial) else array), notices


def is_sampled(trial: Trial) -> bool | None:
    """Whether the actuators of a ``trial`` are logged as they are at each sample, by its sidecar (``inputs``); None
    where it does not say."""
    said = trial.meta.get("inputs", "")
    return said == SAMPLED if said else None


def _over_each_sample(values: np.ndarray) -> np.ndarray:
    """Means (N, A) from each sample of ``values`` (N, A) to the next, which a straight line joins. Where the next
    sample is missing, it is held."""
    change = np.diff(values, axis=0, append=values[-1:])
    return values + 0.5 * np.nan_to_num(change)


def _check_driven(trial: Trial, actuators: Sequence[str]) -> None:
    """Raises UserError where all that drives the model would be taken to be at rest, as the file has none of it."""
    driving = [name for name in actuators if INPUTS[name][1] == "rps"]
    if driving and set(driving) <= set(_AT_REST) and not set(driving) & set(trial.columns):
        there = ", ".join(name for name in INPUTS if name in trial) or "no actuator"
        raise Missing(
            f"{trial.name}: no column {' or '.join(driving)}, which drive the ship's model (the file has {there}); "
            "name them in trials.toml (columns), or take a ship that has the file's actuators"
        )


def _check_unused(trial: Trial, used: set[str]) -> None:
    """Raises UserError for a propeller, rudder or thruster that moves but is not among the inputs ``used``; revolutions
    that hold do not where the model has none, as its polynomial is that of the hull with her propeller."""
    steered = bool(used & set(trial.columns) & set(RUDDERS))
    driven = any(INPUTS[name][1] == "rps" for name in used)
    for name in INPUTS:
        followed = name == "n_2" and name in trial and np.array_equal(trial[name], trial["n"], equal_nan=True)
        idle = name == "pitch" or (name.startswith("azimuth") and f"n_{name}" in trial) or (name in RUDDERS and steered)
        holds = name in PROPELLERS and not driven and name in trial and _holds(trial[name])
        if name in used or name not in trial or followed or idle or holds:
            continue
        most = float(np.nanmax(np.abs(trial[name]), initial=0.0))
        if most > 0:
            reaches = f"{most:g} rps" if INPUTS[name][1] == "rps" else f"{math.degrees(most):.3g} deg"
            raise Conflict(
                f"{trial.name}: {name} reaches {reaches}, but the ship's model has no such actuator; "
                "add it to the ship file ([model]) or remove the column"
            )


def _holds(revolutions: np.ndarray) -> bool:
    """Whether ``revolutions`` (N,) are those of one state of the engine: they fall in a hard turn, by no half."""
    return bool(np.nanmin(revolutions, initial=np.inf) >= 0.5 * np.nanmax(revolutions, initial=0.0))


class ModelInputs(NamedTuple):
    """The inputs of a model at the samples of a trial: array (N, C), and notices on what was assumed."""

    array: np.ndarray
    notices: tuple[Message, ...]


# Trials do not change, and each solve, score and check asks for their inputs; a trial that is gone frees them.
_KNOWN: WeakKeyDictionary[Trial, dict[tuple[str, ...], ModelInputs]] = WeakKeyDictionary()


def model_inputs(trial: Trial, inputs: Sequence[str] = STANDARD) -> ModelInputs:
    """The inputs of a right-hand side at the samples of a ``trial``, made once per trial. inputs: C names in the order
    of ``Ship.inputs``. Raises UserError as ``actuator_columns`` does."""
    cached = _KNOWN.setdefault(trial, {})
    names = tuple(inputs)
    if names not in cached:
        actuators, notices = actuator_columns(trial, [name for name in names if name in INPUTS])
        clock = [(trial.t - trial.t[0])[:, None]] if "time" in names else []
        array = np.column_stack([actuators, trial.wind_vector, *clock])
        array.flags.writeable = False  # shared by all who ask
        cached[names] = ModelInputs(array, tuple(notices))
    return cached[names]


def assumed(trials: Sequence[Trial], inputs: Sequence[str]) -> list[Message]:
    """What a model with these ``inputs``, as of ``Ship.inputs``, assumes of ``trials`` or ignores, each message once.
    Raises UserError as ``actuator_columns`` does."""
    notices = [note for trial in trials for note in model_inputs(trial, inputs).notices]
    if names := ", ".join(t.name for t in trials if not t.has_wind):
        notices.append(Message(f"calm air is assumed in {names} (no complete wind columns)", "no_wind"))
    return list(dict.fromkeys(notices))


def step_means(t: np.ndarray, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Mean over each step of samples that are held until the next one. t: times (N,) [s]; values: samples (N, C);
    edges: times (K + 1,) [s] between which steps lie. Returns (K, C)."""
    widths = np.diff(t)[:, None]
    integral = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values[:-1] * widths, axis=0)])
    at = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 1)  # sample that holds at each edge
    until = integral[at] + values[at] * (edges - t[at])[:, None]
    return np.diff(until, axis=0) / np.diff(edges)[:, None]


def straight_means(t: np.ndarray, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """As ``step_means``, with samples joined by straight lines, with ``corners`` between samples. t: times (N,) [s];
    values: samples (N, C); edges: times (K + 1,) [s] between which steps lie. Returns (K, C)."""
    until = np.column_stack([_integral_until(*with_corners(t, column), edges) for column in values.T])
    return np.diff(until, axis=0) / np.diff(edges)[:, None]


def integral(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral (N,) of ``values`` (N,) from the first of the times ``t`` (N,) [s] on, by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))])


def _integral_until(t: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The integral until each time of ``at`` (K,) [s] of a line through ``values`` (N,) at the times t (N,) [s]."""
    integrals = integral(t, values)
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, max(len(t) - 2, 0))
    into, slope = at - t[i], np.diff(values)[i] / np.diff(t)[i]  # s into the interval, and slope of the line there
    return np.asarray(integrals[i] + values[i] * into + 0.5 * slope * into**2)


# Share of an actuator's largest rate within which rates may be its limit; the least share by which rates are told from
# that limit and from none; how often it must have it, and in which share of the samples in the middle of its moves. Set
# by hand.
NEAR, LEAST, FEW, MOSTLY = 0.1, 0.01, 5, 0.8


def with_corners(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a line through the samples of an actuator that moves at a limited rate or stands.

    t: times (N,) [s]; values: samples (N,). Between two samples of which it stands at one and moves at the other, or
    turns round, the corner lies where the lines from both sides meet. An actuator whose rates have no limit that
    most of its moves reach is joined by straight lines.
    """
    rate = np.diff(values) / np.diff(t)
    if len(rate) < FEW or not np.isfinite(rate).all():
        return t, values
    size, way = np.abs(rate), np.sign(rate)
    most = float(size.max())
    limited = size > (1 - NEAR) * most
    if most == 0 or limited.sum() < FEW:
        return t, values
    limit = float(np.median(size[limited]))
    scatter = float(np.median(np.abs(size[limited] - limit))) / limit
    apart = float(np.clip(5 * scatter, LEAST, NEAR))
    # of each interval: whether it has the limiting rate all the time, and to which side it moves (0: it stands)
    full, moves = size > (1 - apart) * limit, np.where(size > apart * limit, way, 0.0)
    inner = (moves[1:-1] != 0) & (moves[:-2] == moves[1:-1]) & (moves[2:] == moves[1:-1])
    if not (inner & full[1:-1]).sum() > MOSTLY * inner.sum():
        return t, values
    part = (moves[1:-1] != 0) & ~full[1:-1]  # intervals with a corner: they move for part of the time
    sides = []  # rates before and after each: the limit, none, or NaN where a neighbour has a corner as well
    for near, is_full in ((moves[:-2], full[:-2]), (moves[2:], full[2:])):
        defined = (near == 0) | (near == moves[1:-1]) | is_full
        sides.append(np.where(defined, near * limit, np.nan))
    before, after = sides
    k = 1 + np.flatnonzero(part & np.isfinite(before) & np.isfinite(after) & (before != after))
    before, after = before[k - 1], after[k - 1]
    # x[k] + before into + after (dt - into) = x[k+1]: s into the interval at which both lines meet
    into = (values[k + 1] - values[k] - after * (t[k + 1] - t[k])) / (before - after)
    good = (into > 0) & (into < t[k + 1] - t[k])
    k, into, before = k[good], into[good], before[good]
    return np.insert(t, k + 1, t[k] + into), np.insert(values, k + 1, values[k] + before * into)


WIND = ("wind_speed", "wind_direction")  # Columns of the true wind [m/s, rad that it comes from]


def given_inputs(ship: Ship, t: Any, given: Mapping[str, Any], start: Any = None) -> Trial:
    """What a ``ship`` is to follow.

    t: times (N,) [s], increasing; given: by name of her actuators (n [1/s], delta [rad], ...), and wind_speed [m/s] and
    wind_direction [rad] that it comes from: a number, an array (N,), or a function of the time [s]; start: (6,) x, y
    [m], psi [rad], u, v [m/s], r [rad/s], default at rest in the origin. Raises UserError with the name of what is
    missing, unknown, of another shape or no number.
    """
    clock = _numbers("t", t)
    if clock.ndim != 1 or len(clock) < 2 or not (np.diff(clock) > 0).all():
        raise BadValue(f"t: {clock.shape} values; give two or more times [s] in one dimension, increasing")
    first = _numbers("x0", np.zeros(6) if start is None else in_order("x0", start, STATES))
    if first.shape != (6,):
        raise BadValue(f"x0: shape {first.shape}; give {', '.join(STATES)}")
    no_wind = not {*WIND} & {*given}  # of its two columns none or both
    in_order(ship.name, given, (*ship.actuators, *WIND), WIND if no_wind else ())
    columns = {"t": clock, **{name: np.full(len(clock), value) for name, value in zip(STATES, first, strict=True)}}
    columns |= {name: _column(name, values, clock) for name, values in given.items()}
    return Trial("simulated", columns)


def _column(name: str, values: Any | Callable[[float], float], t: np.ndarray) -> np.ndarray:
    numbers = _numbers(name, [values(float(time)) for time in t] if callable(values) else values)
    if numbers.ndim > 1 or numbers.size not in (1, len(t)):
        raise BadValue(f"{name}: shape {numbers.shape}; give a number, {len(t)} numbers (as t has), or a function of t")
    return np.array(np.broadcast_to(numbers, t.shape))


def _numbers(name: str, values: Any) -> np.ndarray:
    """``values`` as finite numbers."""
    numbers: np.ndarray = as_array(name, values)
    if not np.isfinite(numbers).all():
        raise BadValue(f"{name}: holds {int((~np.isfinite(numbers)).sum())} values that are not finite")
    return numbers
