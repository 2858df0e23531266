"""The mission in small: hidden effects are named, nothing is named where there is nothing."""

from __future__ import annotations

import pytest

from diagnosis.diagnose import DiagnosisOptions, diagnose
from diagnosis.result import Diagnosis
from mmg.effects import EFFECTS
from tests.support.diagnosis_cases import ASTERN, FEW, RUNS, pushed_trials
from tests.support.disturbed_trials import drawn_ship

HIDDEN = {
    "current": "current:x=-0.02,y=0.02",
    "rudder_offset": "rudder_offset:delta=-0.07",
    "log_scale": "log_scale:share=0.03",
    "propeller_side_force": "propeller_side_force:factor=2.5",
    "antenna_offset": "antenna_offset:x=-0.2,y=0.15",
}
"""Of about one typical size; the size of each is compared with what was put in."""


def diagnosed(seed: int, *effects: str, astern: bool = False) -> Diagnosis:
    """A ship drawn from the prior, pushed by random forces, diagnosed from three runs and checked on two others."""
    ship, runs = drawn_ship(FEW, seed), ASTERN if astern else RUNS
    others = (("zigzag:-10/10", 80.0), runs[2])
    trials, tests = (pushed_trials(s, effects, r, ship) for s, r in ((seed, runs), (seed + 500, others)))
    return diagnose(FEW, trials, tests, options=DiagnosisOptions(step=0.5, learn=False))


@pytest.mark.slow
def test_five_hidden_effects_are_named_and_nothing_else() -> None:
    answers = {}
    for seed, (name, text) in enumerate(HIDDEN.items(), start=300):
        d = diagnosed(seed, text, astern=name == "propeller_side_force")
        faults = [f for f in d.instruments if f.name in HIDDEN]
        answers[name] = (d.verdict, tuple(e.name for e in (*d.effects, *faults)))
        values = dict(pair.split("=") for pair in text.split(":")[1].split(","))
        for e in (*d.effects, *faults)[:1]:
            for k, value in values.items():
                estimate = e.parameters[k]
                assert abs(estimate.value - float(value)) < 4 * estimate.std, (name, k, estimate)
        assert d.held_out is not None and d.held_out.reduction > 0, name
    verdicts = {name: "none" if EFFECTS[name].measures else "named" for name in HIDDEN}
    assert answers == {name: (verdicts[name], (name,)) for name in HIDDEN}


@pytest.mark.slow
def test_three_ships_without_any_effect_get_no_name() -> None:
    answers = [diagnosed(seed) for seed in (200, 201, 202)]
    assert [(d.effects, d.remainder) for d in answers] == [((), False)] * 3
    assert [d.verdict for d in answers].count("none") >= 2
    assert all(d.ship is d.before for d in answers)
