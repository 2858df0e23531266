"""From the fits of a diagnosis to what is told: the ship with what was found, effects with sizes, the ranking."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.estimation.candidates import Candidate, FullModel, parameters
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import mean_over_windows
from diagnosis.findings import EstimatedParameter, NamedEffect, RankedCandidate
from diagnosis.hypotheses.forward_selection import Found, Problem, Search, Tried
from mmg.ship import Ship


def fitted_ship(problem: Problem, ship: Ship, full: FullModel, found: Estimate, effects: Sequence[Candidate]) -> Ship:
    """The ship with the coefficients of a fit and with these effects; one that differs by run as in their mean."""
    at = dict(zip(full.ship.symbols, mean_over_windows(found.theta), strict=True))
    after, names = ship, [c.effect for c in effects]
    for name in names:
        values = {p.symbol: float(at[f"{name}.{p.symbol}"]) for p in parameters(ship, name)}
        after = after.with_effect(name, values)
    changed = {}
    for s in dict.fromkeys(found.free.symbols):
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
    i = [j for j, s in enumerate(found.free.symbols) if s == symbol]
    weight = found.free.std[i] / len(i)
    value = float(np.mean([found.value(*found.free.columns[j]) for j in i]))
    return EstimatedParameter(value, float(np.sqrt(weight @ found.covariance[np.ix_(i, i)] @ weight)), unit)


def values(problem: Problem, full: FullModel, found: Estimate, candidate: Candidate) -> dict[str, EstimatedParameter]:
    """The parameters of a candidate in a fit."""
    units = {p.symbol: p.unit for p in parameters(full.ship, candidate.effect)}
    return {
        s.split(".", 1)[1]: estimated(found, s, units[s.split(".", 1)[1]]) for s in dict.fromkeys(candidate.symbols)
    }


def by_run(problem: Problem, found: Estimate, candidate: Candidate) -> dict[str, dict[str, float]]:
    """The parameters run by run, of a candidate that differs by run."""
    told: dict[str, dict[str, float]] = {}
    for symbol, run in candidate.columns:
        if run is not None:
            told.setdefault(problem.data.trials[run], {})[symbol.split(".", 1)[1]] = found.value(symbol, run)
    return told


def _tried(found: Found, candidate: Candidate) -> tuple[Search, Tried]:
    """The search in which an effect was named."""
    for s in found.searches:
        if s.best is not None and s.best.candidate == candidate:
            return s, s.best
    raise KeyError(candidate.label)


def fit_with(found: Found, candidate: Candidate) -> Estimate:
    """The fit in which an effect was first tried, and came best."""
    wanted = candidate.effect, candidate.form
    every = (t for s in found.searches for t in s.tried)
    return next(t.found for t in every if (t.candidate.effect, t.candidate.form) == wanted)


def named(problem: Problem, full: FullModel, found: Found, candidate: Candidate) -> NamedEffect:
    """An effect as it is told."""
    s, t = _tried(found, candidate)
    sizes, runs = values(problem, full, found.final, candidate), by_run(problem, found.final, candidate)
    return NamedEffect(candidate.effect, sizes, t.p_value, t.delta_bic, s.score(candidate).absorbed, runs)


def same(found: Found) -> tuple[str, ...]:
    """What the data cannot tell from the first named effect (contract)."""
    near = dict.fromkeys(c.effect for c in _tried(found, found.effects[0])[0].same)
    named = {c.effect for c in found.effects}
    return tuple(n for n in near if n not in named)


SHOWS = 3.0
"""Standard errors from which an effect would show."""


def visible(problem: Problem, first: Search, name: str) -> dict[str, float]:
    """Sizes, off neutral, from which these trials would show the parameters of an effect, in all its forms; those they
    show at all."""
    sizes: dict[str, float] = {}
    for s in first.scores:
        c = s.candidate
        if c.effect == name and not c.by_run:
            sizes |= dict(zip((x.split(".", 1)[1] for x in c.symbols), SHOWS * s.errors * c.typical, strict=True))
    return {parameter: float(size) for parameter, size in sizes.items() if np.isfinite(size)}


def ranking(problem: Problem, full: FullModel, found: Found) -> tuple[RankedCandidate, ...]:
    """All candidates: those refitted first, the others behind them by their score; each effect once."""
    first = found.searches[0]
    rows: dict[str, RankedCandidate] = {}
    for t in first.tried:
        s, name = first.score(t.candidate), t.candidate.effect
        if name not in rows:
            sizes, seen = values(problem, full, t.found, t.candidate), visible(problem, first, name)
            rows[name] = RankedCandidate(name, s.T, t.p_value, t.delta_bic, True, s.absorbed, sizes, seen)
    for s in sorted(first.scores, key=lambda s: s.candidate.by_run):
        name = s.candidate.effect
        seen = visible(problem, first, name)
        rows.setdefault(name, RankedCandidate(name, s.T, s.p_value, None, s.excited, s.absorbed, {}, seen))
    return tuple(rows.values())
