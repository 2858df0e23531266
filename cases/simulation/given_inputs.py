"""Inputs that a program gives, as numbers, arrays or functions of time, as a trial that a ship can follow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cases.io.toml_file import unknown
from cases.trial import Trial
from mmg.errors import BadValue, Missing, UnknownName
from mmg.ship import Ship
from mmg.states import STATES

WIND = ("wind_speed", "wind_direction")
"""Columns of the true wind [m/s, rad that it comes from]."""


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
    first = _numbers("x0", np.zeros(6) if start is None else start)
    if first.shape != (6,):
        raise BadValue(f"x0: shape {first.shape}; give {', '.join(STATES)}")
    known = (*ship.actuators, *WIND)
    for name in given:
        if name not in known:
            raise UnknownName(f"{ship.name}: {unknown('input', name, known)}")
    lacking = [name for name in ship.actuators if name not in given]
    lacking += [name for name in WIND if len(set(WIND) & set(given)) == 1 and name not in given]
    if lacking:
        raise Missing(f"{lacking[0]}: missing; {ship.name} has {', '.join(ship.actuators)}")
    columns = {"t": clock, **{name: np.full(len(clock), value) for name, value in zip(STATES, first, strict=True)}}
    columns |= {name: _column(name, values, clock) for name, values in given.items()}
    return Trial("simulated", columns)


def _column(name: str, values: Any | Callable[[float], float], t: np.ndarray) -> np.ndarray:
    found = _numbers(name, [values(float(time)) for time in t] if callable(values) else values)
    if found.ndim > 1 or found.size not in (1, len(t)):
        raise BadValue(f"{name}: shape {found.shape}; give a number, {len(t)} numbers (as t has), or a function of t")
    return np.array(np.broadcast_to(found, t.shape))


def _numbers(name: str, values: Any) -> np.ndarray:
    """``values`` as finite numbers."""
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise BadValue(f"{name}: holds what is no number") from None
    if not np.isfinite(found).all():
        raise BadValue(f"{name}: holds {int((~np.isfinite(found)).sum())} values that are not finite")
    return found
