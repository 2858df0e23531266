"""Whether what was found is likelier with the actuators read the other way.

How samples of the actuators are read is chosen by the fits without any effect. Held samples act half a sample later
than joined ones, so that an effect which makes the ship answer late passes there for held samples. Where such an effect
is needed anyway, most trials cannot tell held samples from a delay that is half a sample longer. Nothing holds an angle
that moves from sample to sample (``possible_readings``): it is joined then, unless the trials say otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.trial import Trial
from diagnosis.estimation.candidates import TIMES, Column
from diagnosis.estimation.first_fit import fit_without_effects
from diagnosis.estimation.gusts import trials_in_gusts
from diagnosis.hypotheses.forward_selection import LEVEL, Selection
from diagnosis.hypotheses.refit import refit
from diagnosis.hypotheses.score_test import SHOWS, score_tests, slopes
from diagnosis.prepare import CLEAR, InputReading, Prepared
from mmg.errors import UserError
from mmg.messages import Message


def as_shown(ready: Prepared, found: Selection) -> Prepared:
    """The problem ``ready`` with the shortest delay of the actuators that its trials show, by the search that gave
    ``found``: by the tests of each step, and by the errors of delays and lags that were found."""
    tests = [s for search in found.searches for s in search.scores if s.candidate.effect == "control_delay"]
    errors = [float(s.errors[0] * s.candidate.typical[0]) for s in tests if not s.candidate.by_run]
    late = [f"{c.effect}.{TIMES[c.effect]}" for c in found.effects if c.effect in TIMES and not c.by_run]
    errors += [found.final.std(symbol) for symbol in late]
    reading = replace(ready.reading, visible=SHOWS * min(errors, default=np.inf))
    return replace(ready, reading=reading, notices=_said_anew(ready, reading))


def _said_anew(ready: Prepared, reading: InputReading) -> tuple[Message, ...]:
    """The notices of ``ready`` with those of its new ``reading``."""
    return *(m for m in ready.notices if m.code != "coarse_samples"), *reading.notices


def read_otherwise(ready: Prepared, trials: Sequence[Trial], found: Selection) -> Prepared | None:
    """The problem with the actuators read the other way, where the effects ``found`` are clearly likelier so; joined
    already where something makes them late and that is not clearly less likely.

    ready: the problem as it was read; trials: as they were logged. Returns None where that is not so, or where there
    was no choice, half a sample does not matter, or the ship cannot be followed with the actuators read so.
    """
    if not found.effects or not ready.reading.is_doubtful:
        return None
    p, straight = ready.problem, not ready.reading.straight
    late = [Column(f"{name}.{time}") for name, time in TIMES.items() if name in {c.effect for c in found.effects}]
    start = {x: found.final.value(*x) for c in found.effects for x in c.columns}
    for x in late[:1]:
        start[x] = max(start[x] + 0.5 * ready.reading.sample * (1.0 if straight else -1.0), 0.0)
    try:
        data = trials_in_gusts(p.steps, trials, straight).thinned(ready.gap)
        gain = found.final.nll - refit(p.steps, data, p.base, found.final, found.effects, start).nll
    except (UserError, np.linalg.LinAlgError):
        return None
    return other_reading(ready, trials, gain) if gain > (-CLEAR if late and straight else CLEAR) else None


def read_joined(ready: Prepared, trials: Sequence[Trial]) -> Prepared | None:
    """The problem with held actuators joined, where something makes them late then; to be searched where held ones
    leave something without a name.

    ready: the problem as it was read; trials: as they were logged. Returns None where they are joined already, where
    there was no choice, where half a sample does not matter, where the ship cannot be followed so, or where neither
    a delay nor a lag would explain more than chance.
    """
    if not ready.reading.is_doubtful or ready.reading.straight:
        return None
    other = other_reading(ready, trials, ready.reading.gain or 0.0)
    if other is None:
        return None
    p, late = other.problem, [c for c in other.problem.candidates if c.effect in TIMES]
    tests = score_tests(slopes(p.steps, p.data, other.null, late), late) if late else []
    return other if any(t.p_value < LEVEL for t in tests) else None


def other_reading(ready: Prepared, trials: Sequence[Trial], gain: float) -> Prepared | None:
    """The problem ``ready`` of ``trials`` with the actuators read the other way, which is likelier by ``gain``
    (logarithm); None where the ship cannot be followed so."""
    p, straight = ready.problem, not ready.reading.straight
    grid = trials_in_gusts(p.steps, trials, straight)
    try:
        data, null, _, _, line = fit_without_effects(
            p.steps, grid, ready.null.theta, p.base, ready.null.noise, ready.gap
        )
    except (UserError, np.linalg.LinAlgError):
        return None
    reading = replace(ready.reading, straight=straight, gain=abs(gain))
    notices, problem = _said_anew(ready, reading), replace(p, data=data)
    return replace(ready, problem=problem, null=null, line=line, reading=reading, notices=notices)


def explains_lateness(held: Selection, joined: Selection) -> bool:
    """Whether what was found with ``joined`` actuators makes them late, and is clearly likelier than what was found
    with ``held`` ones: these are half a sample late already, which leaves a smaller lag without a name."""
    named = {c.effect for c in joined.effects}
    return bool(named & TIMES.keys()) and held.final.nll - joined.final.nll > CLEAR
