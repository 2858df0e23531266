"""From the fits of a diagnosis to its results: the ship with the named effects, their sizes, the ranking."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.evidence.tails import chi2_tail
from cases.shipfiles.effects import parameters
from diagnosis.estimation.candidates import TIMES, Candidate, FullModel, neutral
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.findings import EstimatedParameter, InstrumentFault, NamedEffect, RankedCandidate
from diagnosis.hypotheses.forward_selection import RefittedEffect, Search, Selection
from diagnosis.hypotheses.own_currents import OwnCurrents
from diagnosis.hypotheses.score_test import SHOWS
from mmg.effects import EFFECTS
from mmg.ship import Ship

SHOWN = 1e-3  # Probability by chance below which a fault of an instrument is reported. Set by hand.


def fitted_ship(
    ship: Ship, full: FullModel, fit: Estimate, effects: Sequence[Candidate], time_error: float = 0.0
) -> Ship:
    """``ship`` with the coefficients of a ``fit`` of the ``full`` model and with these ``effects``. time_error: as of
    ``parameters_of``."""
    at = dict(zip(full.ship.symbols, fit.theta, strict=True))
    after, names = ship, [c.effect for c in effects]
    for name in names:
        after = after.with_effect(name, {p.symbol: float(at[f"{name}.{p.symbol}"]) for p in parameters(ship, name)})
    changed = {}
    for s in dict.fromkeys(fit.free.symbols):
        if s in after.coefficients:
            c = after.coefficients[s]
            keep = s.split(".")[0] in names or c.prior_std is not None
            prior = {} if keep else {"prior_value": c.value, "prior_std": c.std}
            by_trials = estimated(fit, s)
            std = _with_form(after, s, by_trials, time_error).std if "." in s else by_trials.std
            changed[s] = c.with_(value=float(at[s]), std=std, fixed=False, source="mmg diagnose", **prior)
    return after.with_coefficients(changed)


def estimated(fit: Estimate, symbol: str, unit: str = "") -> EstimatedParameter:
    """The parameter ``symbol`` [``unit``] of a ``fit`` with the standard error."""
    return EstimatedParameter(fit.value(symbol), fit.std(symbol), unit)


def parameters_of(
    full: FullModel, fit: Estimate, candidate: Candidate, time_error: float = 0.0
) -> dict[str, EstimatedParameter]:
    """The parameters of a ``candidate`` in a ``fit`` of the ``full`` model, by name; time_error: standard uncertainty
    of the time of the actuators [s]."""
    units = {f"{candidate.effect}.{p.symbol}": p.unit for p in parameters(full.ship, candidate.effect)}
    rows = dict.fromkeys(candidate.symbols)
    return {s.split(".", 1)[1]: _with_form(full.ship, s, estimated(fit, s, units[s]), time_error) for s in rows}


def _with_form(ship: Ship, symbol: str, by_trials: EstimatedParameter, time_error: float) -> EstimatedParameter:
    """The estimate of an effect's parameter with the uncertainty of the effect's formula beside that by the trials, and
    of a time of the actuators with the ``time_error`` of these."""
    name, parameter = symbol.split(".", 1)
    off = by_trials.value - neutral(ship, name, parameter)
    late = time_error if TIMES.get(name) == parameter else 0.0
    return replace(by_trials, std=math.hypot(by_trials.std, EFFECTS[name].form_error * off, late))


def _named_in(selection: Selection, candidate: Candidate) -> tuple[Search, RefittedEffect]:
    """The search in which an effect was named."""
    return next((s, s.converged or s.best) for s in selection.searches if s.best and s.best.candidate == candidate)


def turning_current(currents: OwnCurrents) -> NamedEffect:
    """The result on ``currents`` that runs have of their own: their mean with its standard error."""
    found, values = currents.found, np.array([*currents.training.values()])  # (R, 2)
    error = values.std(axis=0, ddof=1) / math.sqrt(len(values))
    pairs = zip(("x", "y"), values.mean(axis=0).tolist(), error.tolist(), strict=True)
    sizes = {name: EstimatedParameter(mean, std, "m/s") for name, mean, std in pairs}
    return NamedEffect(found.candidate.effect, sizes, found.p_value, found.delta_bic, 0.0, found.evidence)


def fit_with(selection: Selection, candidate: Candidate) -> Estimate:
    """The fit in which ``selection`` first refitted an effect in the form of ``candidate``."""
    wanted = candidate.effect, candidate.form
    every = (r for s in selection.searches for r in s.refitted)
    return next(r.fit for r in every if (r.candidate.effect, r.candidate.form) == wanted)


def named_effect(full: FullModel, selection: Selection, candidate: Candidate, time_error: float = 0.0) -> NamedEffect:
    """The result on a named effect: ``candidate`` of the ``selection`` with the ``full`` model; time_error: as of
    ``parameters_of``."""
    search, refitted = _named_in(selection, candidate)
    sizes = parameters_of(full, selection.final, candidate, time_error)
    absorbed = search.score(candidate).absorbed
    return NamedEffect(candidate.effect, sizes, refitted.p_value, refitted.delta_bic, absorbed, refitted.evidence)


def without_exact_gyro(ship: Ship, given: Ship, faults: Sequence[InstrumentFault]) -> Ship:
    """The ``ship`` without the gyro's gain that a diagnosis freed: not in ``given``, none of the ``faults``."""
    freed = "gyro" not in given.effects and "gyro" not in (fault.name for fault in faults)
    return ship.without_effect("gyro") if freed else ship


def instrument_faults(full: FullModel, fit: Estimate) -> tuple[InstrumentFault, ...]:
    """Faults of instruments that a ``fit`` of the ``full`` model shows, be they effects of the ship as given or not."""
    faults = []
    for name in (e for e in full.ship.effects if EFFECTS[e].measures):
        rows = [p for p in parameters(full.ship, name) if f"{name}.{p.symbol}" in fit.free.symbols]
        sizes = {p.symbol: estimated(fit, f"{name}.{p.symbol}", p.unit) for p in rows}
        off = [(sizes[p.symbol].value - p.neutral) / sizes[p.symbol].std for p in rows]
        chance = chi2_tail(float(np.sum(np.square(off))), len(rows)) if rows else 1.0
        for p in (p for p in parameters(full.ship, name) if p.choice):
            sizes[p.symbol] = EstimatedParameter(full.ship.coefficients[f"{name}.{p.symbol}"].value, 0.0, p.unit)
        if chance < SHOWN:
            faults.append(InstrumentFault(name, sizes, chance))
    return tuple(faults)


def equivalence_class(selection: Selection) -> tuple[str, ...]:
    """Effects that the data cannot tell from the first one selected in ``selection``."""
    near = dict.fromkeys(c.effect for c in _named_in(selection, selection.effects[0])[0].indistinguishable)
    named = {c.effect for c in selection.effects}
    return tuple(n for n in near if n not in named)


def visible_from(first: Search, effect: str) -> dict[str, float]:
    """Parameter -> size, off neutral, from which these trials would show an ``effect`` in any form, by the ``first``
    search; without parameters that never show."""
    sizes: dict[str, float] = {}
    for s in first.scores:
        c = s.candidate
        if c.effect == effect:
            sizes |= dict(zip((x.split(".", 1)[1] for x in c.symbols), SHOWS * s.errors * c.typical, strict=True))
    return {parameter: float(size) for parameter, size in sizes.items() if np.isfinite(size)}


def ranking(full: FullModel, first: Search) -> tuple[RankedCandidate, ...]:
    """All candidates of ``full`` by the ``first`` search, once each: those refitted first, then the others by score."""
    rows: dict[str, RankedCandidate] = {}
    for r in first.refitted:
        s, name = first.score(r.candidate), r.candidate.effect
        if name not in rows:
            sizes, visible = parameters_of(full, r.fit, r.candidate), visible_from(first, name)
            by_score = (name, s.T, r.p_value, r.delta_bic, True, s.absorbed)
            rows[name] = RankedCandidate(*by_score, sizes, visible, r.evidence)
    for s in first.scores:
        name = s.candidate.effect
        visible = visible_from(first, name)
        rows.setdefault(name, RankedCandidate(name, s.T, s.p_value, None, s.excited, s.absorbed, {}, visible))
    return tuple(rows.values())
