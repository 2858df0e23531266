"""Diagnosis of the sim-to-real gap: the one function that ``mmg diagnose`` calls.

Fit without any effect; screen all effects at once; refit the short list; name one after the other while that is more
than chance; test what is left against a dictionary without names; check on trials that took no part.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cases.effects import freeing_effects
from cases.trial import Trial
from diagnosis.data import arrange, moving
from diagnosis.dictionary import unnamed
from diagnosis.held_out import compare
from diagnosis.hypotheses import AGREE, LEVEL, ODDS, SAME, Found, Problem, Search, Tried, explain
from diagnosis.kinematics import Kinematics, consistency
from diagnosis.latent import Estimate, Priors, echo, estimate, first_noise, with_memory_time
from diagnosis.next_test import next_test
from diagnosis.result import Diagnosis, HeldOut, Named, Parameter, Screened
from diagnosis.steps import Steps
from diagnosis.where import where
from diagnosis.wide import Wide, parameters, widened
from diagnosis.words import sentence_of
from mmg.errors import UserError
from mmg.memory import MODEL_LENGTH
from mmg.ship import Ship

ECHO, APART, LEAST = 0.25, 5.0, 100
"""Correlation of neighbouring whitened residuals from which samples APART seconds [of a 3 m model] are compared, if
at least LEAST grid times are left. On the records of the 3 m tanker the correlation is .65 and the latent force three
times what it is at 3, 5 or 10 s, with worse predictions; with white errors it is below .05."""
SUPPORTED = 0.05
"""Share by which predictions of the test trials must become better, with an interval above zero, for a name to stand
although more is left than it explains."""
SLIGHTLY, WORSE = 0.02, 0.15
"""Shares by which predictions of the test trials may become worse: whatever their one-step likelihood does, and if that
becomes better."""
MAX_FITS = 12
"""Linearisations of the first fit."""
COARSE = 0.2
"""Sampling time [s of a 3 m model] from which it matters whether inputs are held or joined by lines."""
Report = Callable[[str], None]


@dataclass(frozen=True)
class Prepared:
    """The problem, the fit without any effect, and what was learnt on the way."""

    problem: Problem
    wide: Wide
    null: Estimate
    straight: bool
    gap: int
    notices: tuple[str, ...]


def priors_before(ship: Ship, unseen: bool = False) -> Priors:
    """The priors that a calibrated ship started from, or those that an uncalibrated one states.

    unseen: it was calibrated on other trials than these, so that its estimates are what is known before these.
    """
    rows = [ship.coefficients[s] for s in ship.free]
    known = [not unseen and c.prior_value is not None and c.prior_std is not None for c in rows]
    mean = np.array([c.prior_value if k else c.value for c, k in zip(rows, known, strict=True)], dtype=float)
    std = np.array([c.prior_std if k else c.std for c, k in zip(rows, known, strict=True)], dtype=float)
    lower, upper = (np.array([getattr(c, k) for c in rows]) for k in ("lower", "upper"))
    usable = std > 0
    symbols = tuple(s for s, u in zip(ship.free, usable, strict=True) if u)
    return Priors(symbols, *(a[usable] for a in (mean, std, lower, upper)))


def prepare(
    ship: Ship,
    trials: Sequence[Trial],
    site: Mapping[str, Mapping[str, float]] | None = None,
    step: float | None = None,
    unseen: bool = False,
    say: Report = lambda words: None,
) -> Prepared:
    """Arrange the trials, choose how inputs lie between samples, and fit without any effect."""
    wide = widened(ship, list(trials), {k: dict(v) for k, v in (site or {}).items()})
    base = priors_before(ship, unseen)
    if not base.symbols:
        raise UserError(f"{ship.name}: every coefficient is fixed, so nothing is known of how far each may be off")
    length = float(ship.particulars["L"])
    notices: list[str] = []
    straight = moving(trials)
    if max(t.dt for t in trials) > COARSE * (length / MODEL_LENGTH) ** 0.5:
        how = "joined by straight lines" if straight else "held until the next one"
        notices.append(
            f"samples of the actuators are taken as {how}; a delay of half a sample cannot be told from the other way"
        )
    data = arrange(trials, wide.ship.inputs, length, step, straight)
    steps = Steps(wide.ship, [*base.symbols, *(s for c in wide.candidates.values() for s in c.symbols)], data.h)
    p = (np.array([ship.coefficients[s].value for s in base.symbols]) - base.mean) / base.std
    null = estimate(steps, data, wide.ship.values, base, first_noise(wide.ship, data), p=p, iterations=MAX_FITS)
    gap = max(1, round(APART * (length / MODEL_LENGTH) ** 0.5 / data.h))
    heard = echo(steps, data, null)
    if not (heard > ECHO and data.thinned(gap).samples >= LEAST):
        gap = 1
    if gap > 1:
        data = data.thinned(gap)
        notices.append(
            f"what remains of neighbouring samples is alike (correlation {heard:.2f}), as of filtered instruments: one "
            f"sample every {gap * data.h:g} s is compared"
        )
        null = estimate(steps, data, wide.ship.values, base, first_noise(wide.ship, data), p=p, iterations=MAX_FITS)
    null = with_memory_time(steps, data, null)
    say(f"fitted without any effect: {len(data.trials)} runs, {data.samples} samples")
    notices += list(data.dropped)
    if not null.converged:
        notices.append("the fit without any effect has not quite settled")
    return Prepared(
        Problem(steps, data, base, wide.candidates), wide, null, straight, gap if heard > ECHO else 1, tuple(notices)
    )


FILTERS = ("velocity_lag", "gyro")
"""Faults of instruments that belong into the model of the measurement before anything is asked of the dynamics."""


def with_sensor_faults(ship: Ship, sensors: Kinematics) -> tuple[Ship, list[str]]:
    """The ship with those faults of FILTERS that the kinematics show, their sizes free, and a sentence on them."""
    faults = [name for name in sensors.effects() if name in FILTERS and name not in ship.effects]
    if not faults:
        return ship, []
    words = f"the logged columns disagree with each other: {' and '.join(faults)} was put into the model of the sensors"
    return freeing_effects(ship, faults), [words]


def diagnose(
    ship: Ship,
    trials: Sequence[Trial],
    tests: Sequence[Trial] = (),
    site: Mapping[str, Mapping[str, float]] | None = None,
    step: float | None = None,
    seed: int = 0,
    workers: int = 1,
    unseen: bool = False,
    say: Report = lambda words: None,
) -> Diagnosis:
    """Say which effect the ship's model lacks, judged by trials.

    ship: calibrated (its priors before the calibration count, unless these trials are ``unseen`` by it) or not; site:
    what is known of the place, by effect and parameter. Raises UserError for input from which nothing can be concluded.
    """
    began = time.perf_counter()
    sensors = consistency(trials, ship)
    given, (ship, mended) = ship, with_sensor_faults(ship, sensors)
    ready = prepare(ship, trials, site, step, unseen, say)
    timings = {"fit": time.perf_counter() - began}
    p = ready.problem
    before = unnamed(p.steps, p.data, ready.null)
    found = explain(p, ready.null, seed, workers)
    after = unnamed(p.steps, p.data, found.final) if found.effects else before
    timings["screen and refits"] = time.perf_counter() - began - timings["fit"]
    say("screened and refitted: " + (", ".join(found.effects) or "no effect stands out"))
    ship_before = fitted_ship(ship, ready.wide, ready.null, ())
    ship_after = fitted_ship(ship, ready.wide, found.final, found.effects)
    held = None
    if tests:
        test_data = arrange(tests, ready.wide.ship.inputs, float(ship.particulars["L"]), p.data.h, ready.straight)
        test_data = test_data.thinned(ready.gap)
        held = compare(p.steps, test_data, found.null, found.final, seed)
    verdict, reasons = decide(found, before.log_bayes, after.log_bayes, held)
    say("looking at where the gap lies and what to test next")
    effects = tuple(_named(ready, found, name) for name in found.effects) if verdict == "named" else ()
    final = found.final if verdict == "named" else found.null
    same = _same(found) if verdict == "named" else ()
    names = ([found.effects[0], *(n for n in same if n not in found.effects)]) if verdict == "named" else _rivals(found)
    advice = next_test(p, found, names, ship_after) if names else ""
    place = where(p.steps.model.controls, p.data, found.null, ship, final if verdict == "named" else None)
    timings["total"] = time.perf_counter() - began
    remainder = bool(verdict == "named" and after.log_bayes > ODDS)
    return Diagnosis(
        verdict=verdict,
        sentence=sentence_of(verdict, effects, same, remainder, held, found),
        effects=effects,
        equivalence_class=same,
        remainder=remainder,
        candidates=_ranking(ready, found),
        where=place,
        held_out=held,
        next_test=advice,
        warnings=(*mended, *ready.notices, *reasons, *_cautions(ready, found, trials, tests), *sensors.warnings),
        left_out=ready.wide.left_out,
        ship=given,
        before=ship_before,
        after=ship_after if verdict == "named" else ship_before,
        null=ready.null,
        final=final,
        data=p.data,
        states=p.steps.model.states,
        unnamed_before={"all": before.log_bayes, **before.by_kind},
        unnamed_after={"all": after.log_bayes, **after.by_kind},
        kinematics=tuple(r.sentence for r in sensors.found),
        timings=timings,
    )


def _rivals(found: Found) -> list[str]:
    """What a next test should tell apart where nothing was named: the best two that were more than chance."""
    first = found.searches[0]
    return [t.name for t in first.tried[:2] if t.p_value < LEVEL and t.delta_bic > 0]


def decide(found: Found, before: float, after: float, held: HeldOut | None) -> tuple[str, list[str]]:
    """The verdict, and why a name was withdrawn.

    before, after: log Bayes factors of the dictionary without names at the fit without effects and with those named.
    """
    if not found.effects:
        return ("unknown" if before > ODDS else "none"), []
    drop = found.null.nll - found.final.nll
    supported = held is not None and held.interval_90[0] > 0 and held.reduction > SUPPORTED
    if after > max(ODDS, drop) and not supported:
        names = " and ".join(found.effects)
        return "unknown", [
            f"{names} would explain a part (log likelihood {drop:.0f}), but effects without a name explain more of "
            f"what is left ({after:.0f}): the name is withdrawn"
        ]
    apart = [f"{n} (p = {p:.2g})" for n, p in found.robust.items() if p > AGREE]
    if apart:
        return "unknown", [f"the runs do not agree on {' and '.join(apart)}: the name is withdrawn"]
    if held is not None and _contradicted(held):
        return "unknown", [
            f"{' and '.join(found.effects)} fits the training trials but does not predict the test trials better: the "
            "name is withdrawn"
        ]
    return "named", []


def _contradicted(held: HeldOut) -> bool:
    """Whether the test trials speak against the named effects: longer predictions become clearly worse, or neither
    those nor the likelihood of one-step predictions becomes better."""
    gain, sure = held.likelihood_gain or 0.0, held.likelihood_interval_90
    worse = held.interval_90[1] < 0 and (held.reduction < -WORSE or not (sure is not None and sure[0] > 0))
    return worse or (gain < 0 and held.reduction < -SLIGHTLY) or (gain < -3 and held.interval_90[0] <= 0)


def fitted_ship(ship: Ship, wide: Wide, found: Estimate, effects: Sequence[str]) -> Ship:
    """The ship with the coefficients of a fit and with these effects."""
    at = {s: float(v) for s, v in zip(wide.ship.symbols, found.theta, strict=True)}
    after = ship
    for name in effects:
        values = {p.symbol: at[f"{name}.{p.symbol}"] for p in parameters(ship, name)}
        after = after.with_effect(name, values)
    changed = {}
    for s in found.free.symbols:
        if s in after.coefficients:
            c = after.coefficients[s]
            prior = (
                {}
                if s.split(".")[0] in effects or c.prior_std is not None
                else {"prior_value": c.value, "prior_std": c.std}
            )
            changed[s] = c.with_(value=at[s], std=found.std(s), fixed=False, source="mmg diagnose", **prior)
    return after.with_coefficients(changed)


def _values(ready: Prepared, found: Estimate, name: str) -> dict[str, Parameter]:
    units = {p.symbol: p.unit for p in parameters(ready.wide.ship, name)}
    return {
        s.split(".", 1)[1]: Parameter(found.value(s), found.std(s), units[s.split(".", 1)[1]])
        for s in ready.problem.candidates[name].symbols
    }


def _tried(found: Found, name: str) -> tuple[Search, Tried]:
    """The search in which an effect was named."""
    for s in found.searches:
        if s.best is not None and s.best.name == name:
            return s, s.best
    raise KeyError(name)


def _named(ready: Prepared, found: Found, name: str) -> Named:
    s, t = _tried(found, name)
    return Named(name, _values(ready, found.final, name), t.p_value, t.delta_bic, s.score(name).absorbed)


def _same(found: Found) -> tuple[str, ...]:
    """What the data cannot tell from the first named effect (contract)."""
    first = found.searches[0]
    return tuple(t.name for t in first.tried[1:] if first.best and t.delta_bic > first.best.delta_bic - SAME)


def _ranking(ready: Prepared, found: Found) -> tuple[Screened, ...]:
    """All candidates: those refitted by BIC, the others behind them by their score."""
    first = found.searches[0]
    rows = []
    for t in first.tried:
        s = first.score(t.name)
        rows.append(Screened(t.name, s.T, t.p_value, t.delta_bic, True, s.absorbed, _values(ready, t.found, t.name)))
    done = {t.name for t in first.tried}
    rest = sorted((s for s in first.scores if s.name not in done), key=lambda s: s.degrees * ready.problem.cost - s.T)
    rows += [Screened(s.name, s.T, s.p_value, None, s.excited, s.absorbed) for s in rest]
    return tuple(rows)


def _cautions(ready: Prepared, found: Found, trials: Sequence[Trial], tests: Sequence[Trial]) -> list[str]:
    """What cannot be concluded from this input."""
    words = []
    first = found.searches[0]
    quiet = [s.name for s in first.scores if not s.excited]
    if quiet:
        words.append(f"not excited by these trials, so neither found nor excluded: {', '.join(quiet)}")
    hidden = [s.name for s in first.scores if s.excited and s.absorbed > 0.9]
    if hidden:
        words.append(
            "absorbed by calibration, visible through the priors only (over 90 % of the information): "
            + ", ".join(hidden)
        )
    unplaced = [t.name for t in trials if not t.has_position]
    if unplaced:
        words.append(
            f"no positions in {', '.join(unplaced)}: effects of place and of satellite sensors are hardly seen there"
        )
    calm = [t.name for t in trials if not t.has_wind]
    if calm and ready.wide.ship.components.get("wind"):
        words.append(
            f"no wind columns in {', '.join(calm)}: calm air is assumed, so wind would be taken for something else"
        )
    if len({t.kind for t in trials}) == 1 and len(trials) > 1:
        words.append(f"all trials are of one kind ({trials[0].kind}): many effects look alike in them")
    if not tests:
        words.append("no --test trials: how far the gap closes was not checked on trials that took no part")
    return words
