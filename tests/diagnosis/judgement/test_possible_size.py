"""A name holds only for a size that the effect can have: a stall that gains lift, or a depth below nothing, is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.diagnose import diagnose
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import priors_of_effects
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.inputs import DiagnosisOptions
from diagnosis.judgement import judged_search
from diagnosis.judgement.judged_search import believed, impossible_size
from mmg.effects import EFFECTS
from tests.diagnosis.judgement.test_believable import judged, off
from tests.diagnosis.judgement.test_verdict import ready
from tests.support.diagnosis_cases import FEW, candidate, full_model, pushed_trials

SIZES = [
    ("rudder_stall", (-0.144,), 0.02, True),
    ("rudder_stall", (-0.03,), 0.02, False),
    ("rudder_stall", (0.4,), 0.02, False),
    ("rudder_stall", (1.1,), 0.02, True),
    ("shallow_water", (-0.3,), 0.05, True),
    ("shallow_water", (-0.3,), 0.24, False),
    ("wind_force", (1.0, -0.5, 1.0), 0.1, True),
    ("wind_force", (1.0, 1.0, -0.5), 0.1, False),
    ("antenna_offset", (1.8, 0.0), 0.1, True),
    ("antenna_offset", (-1.4, 0.2), 0.01, False),
    ("fouling", (-0.3,), 0.1, True),
    ("fouling", (-0.15,), 0.1, False),
    ("draft", (-0.3,), 0.01, False),
    ("current", (-0.3, 0.2), 0.01, False),
]
"""Effect, its parameters, their standard error, and whether no such effect is possible; for a ship of 3 m."""


def fit_with(effects: list[Candidate], values: list[float], std: float) -> Estimate:
    """A fit in which these parameters of the ``effects`` have these values, each with this standard error."""
    own, null = priors_of_effects(effects, 1.0), off(ready().null)
    covariance = np.diag([*np.zeros(len(null.p)), *(std / own.std) ** 2])
    p = np.array([*null.p, *(np.array(values) - own.mean) / own.std])
    return replace(null, free=null.free + own, p=p, covariance=covariance)


@pytest.mark.parametrize(("effect", "values", "std", "expected"), SIZES)
def test_no_effect_is_surely_outside_what_it_can_be(
    effect: str, values: tuple[float, ...], std: float, expected: bool
) -> None:
    c = candidate(effect)
    fit = fit_with([c], list(values), std)
    assert bool(impossible_size(full_model(), fit, c)) is expected
    result = replace(judged("named", ready().null, fit), found=Selection((c,), off(ready().null), fit, ()))
    verdict, reasons, sentence = believed(result, ready())
    assert verdict == ("unknown" if expected else "named")
    assert [m.code for m in reasons] == ["impossible_size"] * expected
    assert (f"acts like {effect} (" in sentence) is expected


@pytest.mark.parametrize(("share", "expected"), [(-0.45, False), (-0.75, True)])
def test_a_calibrated_ship_may_have_lost_the_fouling_that_she_had(share: float, expected: bool) -> None:
    ship = full_model().ship
    symbol = ship.free[0]
    row = ship.coefficients[symbol].with_(prior_std=1.0, prior_value=0.0)
    full, c = replace(full_model(), ship=ship.with_coefficients({symbol: row})), candidate("fouling")
    assert bool(impossible_size(full, fit_with([c], [share], 0.1), c)) is expected


def test_every_effect_can_be_absent() -> None:
    ship = full_model().ship
    for name, effect in EFFECTS.items():
        for p in effect.parameters(ship.namespace, dict(ship.components)):
            assert p.held or max(p.least, p.lower) <= p.neutral <= min(p.most, p.upper), (name, p.symbol)


def test_a_second_effect_of_a_size_that_it_cannot_have_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    current, stall, null = candidate("current"), candidate("rudder_stall"), ready().null
    both = Selection((current, stall), null, fit_with([current, stall], [0.03, 0.02, -0.3], 0.01), ())
    one = Selection((current,), null, replace(fit_with([current], [0.03, 0.02], 0.01), nll=null.nll - 50.0), ())
    monkeypatch.setattr(judged_search, "select_effects", lambda *_: both)
    monkeypatch.setattr(Selection, "without_last", lambda *_: one)
    result = judged_search.judged_search(ready(), None, DiagnosisOptions(), None)
    assert result.found is one
    assert [m.code for m in result.beside] == ["impossible_size"] and "rudder_stall" in result.beside[0]


@pytest.mark.slow
def test_a_rudder_that_gains_at_large_angles_is_no_stall() -> None:
    """As in nine zigzags of a KVLCC2 in a basin, where a stall of -0.14 was named."""
    runs = (("zigzag:20/20", 100.0), ("zigzag:-30/20", 100.0), ("turning:35", 100.0), ("zigzag:35/35", 100.0))
    others = (("zigzag:-20/20", 100.0), ("turning:-35", 100.0), ("zigzag:30/30", 100.0))
    gains = ["rudder_stall:loss=-0.4"]
    trials, tests = pushed_trials(1, gains, runs), pushed_trials(9, gains, others)
    d = diagnose(FEW, trials, tests, options=DiagnosisOptions(step=1.0, learn=False))
    assert d.verdict == "unknown" and d.effects == () and d.candidates[0].name == "rudder_stall"
    assert "rudder_stall" in d.sentence
    assert "impossible_size" in [row["code"] for row in d.to_dict()["messages"]]
