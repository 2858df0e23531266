"""From the fits of a diagnosis to what is told: the ship with what was found, effects with sizes, the ranking."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.estimation.candidates import AT, BY_RUN, FullModel, all_runs, effect_of, parameters, stem
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import get_values
from diagnosis.findings import EstimatedParameter, NamedEffect, RankedCandidate
from diagnosis.hypotheses.forward_selection import Found, Problem, Search, Tried
from mmg.ship import Ship


def fitted_ship(problem: Problem, ship: Ship, full: FullModel, found: Estimate, effects: Sequence[str]) -> Ship:
    """The ship with the coefficients of a fit and with these effects; one that differs by run as in their mean."""
    at = dict(zip(full.ship.symbols, get_values(full.ship, problem.data, found.theta, full.ship.symbols), strict=True))
    after, names = ship, [effect_of(n) for n in effects]
    for name in names:
        values = {p.symbol: float(at[f"{name}.{p.symbol}"]) for p in parameters(ship, name)}
        after = after.with_effect(name, values)
    changed = {}
    for s in dict.fromkeys(stem(s) for s in found.free.symbols):
        if s in after.coefficients:
            c = after.coefficients[s]
            prior = (
                {}
                if s.split(".")[0] in names or c.prior_std is not None
                else {"prior_value": c.value, "prior_std": c.std}
            )
            std = estimated(found, s).std
            changed[s] = c.with_(value=float(at[s]), std=std, fixed=False, source="mmg diagnose", **prior)
    return after.with_coefficients(changed)


def estimated(found: Estimate, symbol: str, unit: str = "") -> EstimatedParameter:
    """A parameter, or the mean over the runs of one that differs by run."""
    own = [s for s in found.free.symbols if stem(s) == symbol]
    i = [found.free.symbols.index(s) for s in own]
    weight = found.free.std[i] / len(i)
    value = float(np.mean([found.value(s) for s in own]))
    return EstimatedParameter(value, float(np.sqrt(weight @ found.covariance[np.ix_(i, i)] @ weight)), unit)


def values(problem: Problem, full: FullModel, found: Estimate, name: str) -> dict[str, EstimatedParameter]:
    """The parameters of a candidate in a fit."""
    units = {p.symbol: p.unit for p in parameters(full.ship, effect_of(name))}
    symbols = dict.fromkeys(stem(s) for s in problem.candidates[name].symbols)
    return {s.split(".", 1)[1]: estimated(found, s, units[s.split(".", 1)[1]]) for s in symbols}


def by_run(problem: Problem, found: Estimate, name: str) -> dict[str, dict[str, float]]:
    """The parameters run by run, of a candidate that differs by run."""
    told: dict[str, dict[str, float]] = {}
    for s in problem.candidates[name].symbols:
        if AT in s:
            run = problem.data.trials[int(s.partition(AT)[2])]
            told.setdefault(run, {})[stem(s).split(".", 1)[1]] = found.value(s)
    return told


def _tried(found: Found, name: str) -> tuple[Search, Tried]:
    """The search in which an effect was named."""
    for s in found.searches:
        if s.best is not None and s.best.name == name:
            return s, s.best
    raise KeyError(name)


def fit_with(found: Found, name: str) -> Estimate:
    """The fit in which an effect was first tried, and came best."""
    return next(t.found for s in found.searches for t in s.tried if name in (t.name, all_runs(t.name)))


def named(problem: Problem, full: FullModel, found: Found, name: str) -> NamedEffect:
    """An effect as it is told."""
    s, t = _tried(found, name)
    sizes, runs = values(problem, full, found.final, name), by_run(problem, found.final, name)
    return NamedEffect(effect_of(name), sizes, t.p_value, t.delta_bic, s.score(name).absorbed, runs)


def same(found: Found) -> tuple[str, ...]:
    """What the data cannot tell from the first named effect (contract)."""
    near = dict.fromkeys(effect_of(n) for n in _tried(found, found.effects[0])[0].same)
    named = {effect_of(n) for n in found.effects}
    return tuple(n for n in near if n not in named)


SHOWS = 3.0
"""Standard errors from which an effect would show."""


def visible(problem: Problem, first: Search, name: str) -> dict[str, float]:
    """Sizes, off neutral, from which these trials would show the parameters of an effect, in all its forms; those they
    show at all."""
    sizes: dict[str, float] = {}
    for s in first.scores:
        if effect_of(s.name) == name and not s.name.endswith(BY_RUN):
            c = problem.candidates[s.name]
            sizes |= dict(zip((x.split(".", 1)[1] for x in c.symbols), SHOWS * s.errors * c.typical, strict=True))
    return {parameter: float(size) for parameter, size in sizes.items() if np.isfinite(size)}


def ranking(problem: Problem, full: FullModel, found: Found) -> tuple[RankedCandidate, ...]:
    """All candidates: those refitted first, the others behind them by their score; each effect once."""
    first = found.searches[0]
    rows: dict[str, RankedCandidate] = {}
    for t in first.tried:
        s, name = first.score(t.name), effect_of(t.name)
        if name not in rows:
            sizes, seen = values(problem, full, t.found, t.name), visible(problem, first, name)
            rows[name] = RankedCandidate(name, s.T, t.p_value, t.delta_bic, True, s.absorbed, sizes, seen)
    for s in sorted(first.scores, key=lambda s: s.name.endswith(BY_RUN)):
        name = effect_of(s.name)
        seen = visible(problem, first, name)
        rows.setdefault(name, RankedCandidate(name, s.T, s.p_value, None, s.excited, s.absorbed, {}, seen))
    return tuple(rows.values())
