"""No name, and not that nothing is missing, where the ship that fits is not the ship that was given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.estimation.map_estimate import Estimate
from diagnosis.findings import EstimatedParameter, NamedEffect
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.inputs import DiagnosisOptions, diagnosable_trials, diagnosis_store, parted
from diagnosis.judgement.judged_search import JudgedSearch, believed, beyond_reported, deviations
from mmg.errors import Missing, TooFewData
from tests.diagnosis.judgement.test_verdict import RUNS, ready
from tests.support.diagnosis_cases import FEW, candidate, pushed_trials


def off(fit: Estimate, *p: float) -> Estimate:
    """The fit with its first coefficients so many prior standard deviations off, the others at their priors."""
    return replace(fit, p=np.array([*p, *np.zeros(len(fit.p) - len(p))]))


def judged(verdict: str, null: Estimate, final: Estimate, left: float = -1.0, held: object = None) -> JudgedSearch:
    """A search with this verdict; left: by how much what is left is beyond chance."""
    unnamed = SimpleNamespace(beyond_chance=left, log_bayes=left)
    effects = (candidate("current"),) if verdict == "named" else ()
    null = null if effects else final
    return JudgedSearch(Selection(effects, null, final, ()), unnamed, unnamed, held, verdict, (), None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("verdict", "far"), [("named", 5.2), ("none", 8.5)])
def test_a_ship_that_is_another_one_has_no_verdict(verdict: str, far: float) -> None:
    """Priors that are too narrow by half are no other ship, where nothing is named."""
    null = off(ready().null)
    assert believed(judged(verdict, null, off(null, 2.0, -1.0)), ready()) == (verdict, [], "")
    together = off(null, 3.5, -3.0, 3.0, 3.2)
    assert believed(judged("none", null, together), ready())[0] == "none"
    for final in (off(null, 0.0, -far), *([together] if verdict == "named" else [off(null, 8.6)])):
        result, (reason,), _sentence = believed(judged(verdict, null, final), ready())
        assert result == "unknown" and reason.code == "not_described"
    assert f"{null.free.symbols[0]} (+{3.5 if verdict == 'named' else 8.6})" in reason


def test_what_has_no_verdict_stays_so() -> None:
    null = off(ready().null, 9.0)
    assert believed(judged("unknown", null, null), ready()) == ("unknown", [], "")


def test_a_name_that_leaves_a_ship_far_off_unexplained_needs_test_trials() -> None:
    null, final = off(ready().null, 4.5), off(ready().null, 1.0)
    confirming = SimpleNamespace(interval_90=(0.2, 0.4), reduction=0.3)
    by_steps = SimpleNamespace(interval_90=(-0.01, 0.7), reduction=0.3, likelihood_interval_90=(5.0, 80.0))
    unsure = SimpleNamespace(interval_90=(-0.01, 0.7), reduction=0.3, likelihood_interval_90=(-5.0, 80.0))
    assert believed(judged("named", null, final), ready())[0] == "named"
    assert believed(judged("named", null, final, left=2.0), ready())[0] == "unknown"
    assert believed(judged("named", null, final, left=2.0, held=confirming), ready())[0] == "named"
    assert believed(judged("named", null, final, left=2.0, held=by_steps), ready())[0] == "named"
    assert believed(judged("named", null, final, left=2.0, held=unsure), ready())[0] == "unknown"
    assert believed(judged("named", off(null, 3.5), final, left=2.0), ready())[0] == "named"


def test_a_calibration_is_measured_by_the_priors_before_it() -> None:
    null = off(ready().null, 8.0)
    symbol, std = null.free.symbols[0], null.free.std[0]
    ship = ready().full.ship
    wider = ship.with_coefficients({symbol: ship.coefficients[symbol].with_(prior_std=4 * std, prior_value=0.0)})
    assert deviations(null, ship)[symbol] == pytest.approx(8.0)
    assert deviations(null, wider)[symbol] == pytest.approx(2.0)


def test_trials_that_tell_nothing_are_refused_and_copies_count_once() -> None:
    one, other = pushed_trials(1, runs=RUNS)
    copy = replace(one, name="again")
    kept, (message,) = diagnosable_trials([one, copy, other])
    assert [t.name for t in kept] == [one.name, other.name] and message.code == "copies_left_out"
    still = {name: np.full_like(one[name], one[name][0]) for name in ("n", "delta")}
    with pytest.raises(TooFewData):
        diagnosable_trials([replace(one, columns={**one.columns, **still})])
    with pytest.raises(Missing):
        diagnosable_trials([])


def test_trials_that_trials_toml_keeps_for_tests_take_no_part(tmp_path: Path) -> None:
    first, second = pushed_trials(1, runs=RUNS)
    kept, tests, (message,) = parted([replace(first, role="train"), replace(second, role="validate")], [first])
    assert [t.name for t in kept] == [first.name] and [t.name for t in tests] == [first.name, second.name]
    assert message.code == "role_held_out" and second.name in message
    with pytest.raises(Missing):
        parted([replace(first, role="test")], [second])
    roles = [first, replace(second, role="test")]
    assert list(parted(roles, [], "role")[0]) == roles
    stores = [diagnosis_store(tmp_path, FEW, trials, [], DiagnosisOptions(), "") for trials in ([first, second], roles)]
    assert stores[0].about != stores[1].about, "parts of one would be resumed by the other"


@pytest.mark.parametrize(("share", "std", "said"), [(1.5, 0.2, True), (1.5, 0.3, False), (0.9, 0.01, False)])
def test_more_fouling_than_any_ship_had_is_not_all_fouling(share: float, std: float, said: bool) -> None:
    size = EstimatedParameter(share, std, "")
    other = NamedEffect("current", {"x": EstimatedParameter(9.0, 0.1, "m/s")}, 0.0, 10.0, 0.1)
    rows = beyond_reported([other, NamedEffect("fouling", {"share": size}, 0.0, 10.0, 0.1)], ready().full.ship)
    assert [row.code for row in rows] == ["beyond_reported"] * said
    assert all("1.5" in row and "(1)" in row for row in rows)
