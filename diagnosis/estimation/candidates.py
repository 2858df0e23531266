"""Effects that a diagnosis may name, and the ship that carries all of them at their neutral values (the full model)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cases.shipfiles.effects import parameters
from cases.trial import Trial
from mmg.effects import EFFECTS, Parameter
from mmg.ship import Ship

LOCAL = ("current", "wind_sensor_bias", "tow")  # Effects of the surroundings that may differ from run to run
# Faults of instruments that belong into the measurement model before the dynamics are tested.
FITTED_ALONG = ("velocity_filter", "gyro")
# Effects that half a sample of the actuators looks like, and their time.
TIMES = {"control_delay": "tau", "rudder_lag": "T"}


class Column(NamedTuple):
    """A free parameter: its symbol among the ship's coefficients, and the run that it belongs to (None: all runs)."""

    symbol: str
    run: int | None = None


@dataclass(frozen=True)
class Candidate:
    """An effect that the ship's model may lack. Two candidates are equal if effect and form are.

    form: another form of the effect, with parameters of its own ("" for the usual one); columns: its p free parameters,
    those of a run together; neutral, lower, upper: (p,) value without effect and bounds [unit of the parameter];
    typical: (p,) sizes that show in a trial; start: (p,) first values of a refit, or None.
    """

    effect: str
    form: str
    columns: tuple[Column, ...] = field(compare=False)
    neutral: np.ndarray = field(compare=False, repr=False)
    typical: np.ndarray = field(compare=False, repr=False)
    lower: np.ndarray = field(compare=False, repr=False)
    upper: np.ndarray = field(compare=False, repr=False)
    start: np.ndarray | None = field(default=None, compare=False, repr=False)

    @property
    def label(self) -> str:
        """Its name for people."""
        return f"{self.effect} {self.form}".rstrip()

    @property
    def measures(self) -> bool:
        """Whether it is a fault of an instrument, not of the ship or her surroundings."""
        return self.effect in EFFECTS and EFFECTS[self.effect].measures

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbol of each column (p,) among the ship's coefficients."""
        return tuple(c.symbol for c in self.columns)

    def in_each(self, runs: Iterable[int]) -> Candidate:
        """The candidate with parameters of its own in each of these ``runs``."""
        columns = tuple(Column(s, r) for r in runs for s in self.symbols)
        count = len(columns) // len(self.columns)
        sizes = (np.tile(x, count) for x in (self.neutral, self.typical, self.lower, self.upper))
        return Candidate(self.effect, self.form, columns, *sizes)


def find(candidates: Iterable[Candidate], effect: str, form: str = "") -> Candidate:
    """The one of the ``candidates`` with this ``effect`` and ``form``. Raises KeyError without it."""
    for c in candidates:
        if (c.effect, c.form) == (effect, form):
            return c
    raise KeyError((effect, form))


@dataclass(frozen=True)
class FullModel:
    """ship: with all effects at their neutral values; candidates: those that may be named; left_out: effect -> why it
    is none."""

    ship: Ship
    candidates: tuple[Candidate, ...]
    left_out: dict[str, str]

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbols of the parameters of all candidates."""
        return tuple(s for c in self.candidates for s in c.symbols)


def neutral(ship: Ship, name: str, parameter: str) -> float:
    """Neutral value of the ``parameter`` of the effect ``name`` of a ``ship`` [unit of the parameter]."""
    return next(p.neutral for p in parameters(ship, name) if p.symbol == parameter)


def _candidate(effect: str, form: str, free: list[Parameter], start: Mapping[str, float] | None = None) -> Candidate:
    """A candidate that frees these parameters of an effect."""
    columns = tuple(Column(f"{effect}.{p.symbol}") for p in free)
    sizes = [np.array([getattr(p, k) for p in free]) for k in ("neutral", "typical", "lower", "upper")]
    first = [np.array([start.get(p.symbol, p.neutral) for p in free])] if start else []
    return Candidate(effect, form, columns, *sizes, *first)


def ship_with_all_effects(
    ship: Ship,
    trials: Sequence[Trial] | None = None,
    site: Mapping[str, Mapping[str, float]] | None = None,
    start: Mapping[str, Mapping[str, float]] | None = None,
    names: Collection[str] | None = None,
) -> FullModel:
    """The ``ship`` with all effects it lacks, and the candidates among them: those that its force models and the
    ``trials`` allow (None: trials with all columns).

    site: known parameters of effects of the place, by effect and parameter (cases.io.site); start: roughly known ones,
    from which a refit starts. Both [unit of the parameter]. names: of the effects that are put in, None for all; with
    few of them the equations are a fraction.
    """
    candidates: list[Candidate] = []
    left_out, full = {}, ship
    has_wind = trials is None or any(t.has_wind for t in trials)
    known = site or {}
    for name in EFFECTS:  # not items(): the file of an effect is read when it is looked up
        if name in ship.effects or (names is not None and name not in names):
            continue
        if lacking := EFFECTS[name].lacking(ship.components):
            left_out[name] = f"the ship lacks {lacking}"
            continue
        if name in ("wind_force", "wind_sensor_bias") and not has_wind:
            left_out[name] = "no trial has wind columns"
        elif name == "bank" and "bank" not in known:
            left_out[name] = "no bank line is known (site.toml)"
        rows = parameters(ship, name)
        held = {p.symbol: known.get(name, {}).get(p.symbol, p.neutral) for p in rows if p.held}
        full = full.with_effect(name, held)
        if name in left_out:
            continue
        candidates.append(_candidate(name, "", [p for p in rows if not p.held], (start or {}).get(name)))
        for form in dict.fromkeys(p.form for p in rows if p.form):
            candidates.append(_candidate(name, form, [p for p in rows if p.form == form]))
    return FullModel(full, tuple(candidates), left_out)
