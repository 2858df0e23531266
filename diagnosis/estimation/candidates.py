"""The wide ship: a ship that carries every effect that can be screened, at its neutral value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cases.trial import Trial
from mmg.effects import EFFECTS, Parameter
from mmg.ship import Ship

LOCAL = ("current", "wind_sensor_bias", "tow")
"""Effects of the surroundings that may differ from run to run."""
BY_RUN, AT = " by run", "@"
"""What marks the name of such a candidate, and the symbol of a parameter in one run."""
NEVER = ("disturbance",)
"""Effects that are no hypothesis: the latent force itself."""
PRIOR_WIDTH = 10.0
"""Prior standard deviation of an effect's parameter, in typical sizes of it."""


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing: its name and the symbols of its parameters that are freed.

    typical: (p,) sizes of the parameters that show in a trial; neutral: (p,); start: (p,) where a refit begins, if
    something is known of it, or None.
    """

    name: str
    symbols: tuple[str, ...]
    neutral: np.ndarray
    typical: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    start: np.ndarray | None = None


@dataclass(frozen=True)
class FullModel:
    """ship: with every candidate at its neutral value; candidates: by name; left_out: why others are none."""

    ship: Ship
    candidates: dict[str, Candidate]
    left_out: dict[str, str]


def stem(symbol: str) -> str:
    """The symbol of the ship behind that of a parameter in one run."""
    return symbol.partition(AT)[0]


def effect_of(name: str) -> str:
    """The effect behind the name of a candidate, which may be another form of it, or differ by run."""
    return name.partition(" ")[0]


def all_runs(name: str) -> str:
    """The candidate with the same values in all runs behind one that differs by run."""
    return name.removesuffix(BY_RUN)


def by_run(c: Candidate, runs: Sequence[int]) -> Candidate:
    """The candidate with parameters of its own in each of these runs; those of a run stand together."""
    symbols = tuple(f"{s}{AT}{r}" for r in runs for s in c.symbols)
    tiled = {k: np.tile(getattr(c, k), len(runs)) for k in ("neutral", "typical", "lower", "upper")}
    return Candidate(c.name + BY_RUN, symbols, **tiled)


def parameters(ship: Ship, name: str) -> tuple[Parameter, ...]:
    """Parameters of an effect of a ship."""
    return EFFECTS[name].parameters(ship.namespace, dict(ship.components))


def neutral(ship: Ship, name: str, parameter: str) -> float:
    """Neutral value of a parameter of one of the ship's effects."""
    return next(p.neutral for p in parameters(ship, name) if p.symbol == parameter)


def _candidate(called: str, name: str, free: list[Parameter], start: Mapping[str, float] | None = None) -> Candidate:
    """A candidate that frees these parameters of an effect."""
    array: dict[str, Any] = {
        k: np.array([getattr(p, k) for p in free]) for k in ("neutral", "typical", "lower", "upper")
    }
    array["start"] = np.array([start.get(p.symbol, p.neutral) for p in free]) if start else None
    return Candidate(called, tuple(f"{name}.{p.symbol}" for p in free), **array)


def ship_with_all_effects(
    ship: Ship,
    trials: list[Trial] | None = None,
    site: Mapping[str, Mapping[str, float]] | None = None,
    start: Mapping[str, Mapping[str, float]] | None = None,
) -> FullModel:
    """The ship with all candidates: effects it does not have yet and that its force models and the trials allow.

    site: parameters of effects that are known of the place, by effect and parameter (cases.io.site); start: others of
    which it is known about how large they are.
    """
    candidates, left_out, full = {}, {}, ship
    windy = trials is None or any(t.has_wind for t in trials)
    known = site or {}
    for name, e in EFFECTS.items():
        if name in NEVER or name in ship.effects:
            continue
        missing = [role for role in e.needs if role not in ship.components]
        if missing:
            left_out[name] = f"the ship has no {' or '.join(missing)} model"
        elif name in ("wind_force", "wind_sensor_bias") and not windy:
            left_out[name] = "no trial has wind columns"
        elif name == "bank" and "bank" not in known:
            left_out[name] = "no bank line is known (site.toml)"
        rows = parameters(ship, name)
        held = {p.symbol: known.get(name, {}).get(p.symbol, p.neutral) for p in rows if p.held}
        full = full.with_effect(name, held)
        if name in left_out:
            continue
        begin = (start or {}).get(name)
        candidates[name] = _candidate(name, name, [p for p in rows if not p.held], begin)
        for form in dict.fromkeys(p.form for p in rows if p.form):
            called = f"{name} {form}"
            candidates[called] = _candidate(called, name, [p for p in rows if p.form == form])
    return FullModel(full, candidates, left_out)
