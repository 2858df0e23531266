"""Naming effects: a strong one and only it, none by chance, no name for what the library lacks, and the last word."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from benchmarks.disturbed_trials import drawn_ship
from diagnosis.estimation.candidates import Candidate, Column
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Trajectory
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.parameters import Priors
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import (
    AGREE,
    LEVEL,
    SAME_CLASS,
    RefittedEffect,
    Search,
    Selection,
    select_effects,
)
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.unnamed import SIZES, log_bayes, unnamed_forms
from diagnosis.judgement.verdict import (
    BESIDE_INSTRUMENT_FAULT,
    CERTAIN,
    CONFIRMING_REDUCTION,
    LARGE_GROWTH,
    NOTED_GROWTH,
    RARE,
    SMALL_GROWTH,
    STRICT_RATIO,
    UNEXPLAINED_RATIO,
    decide,
    supports,
)
from tests.support.diagnosis_cases import FEW, candidate, problem_of, pushed_trials, pushed_windows

NOISE = NoiseModel(np.ones(3), 5.0, np.ones(6), np.zeros(6), 4.0)
LIMIT = 1.1
"""What the unnamed forms hardly exceed by chance."""
NAMES = {
    "current": {"x": 0.03, "y": -0.02},
    "antenna_offset": {"x": 0.3, "y": -0.2},
    "heading_bias": {"psi": -0.03},
}


def held(
    reduction: float, interval: tuple[float, float], gain: float | None = 0.0, sure: tuple[float, float] | None = None
) -> HeldOut:
    return HeldOut(1.0, 1.0 - reduction, reduction, interval, 8, {}, gain, sure)


def text_of(name: str, values: dict[str, float]) -> str:
    return f"{name}:" + ",".join(f"{k}={v}" for k, v in values.items())


def assert_sizes(found: Selection, name: str, values: dict[str, float]) -> None:
    """Within four standard errors, and no error larger than the value."""
    for k, v in values.items():
        std = found.final.std(f"{name}.{k}")
        assert abs(found.final.value(f"{name}.{k}") - v) < 4 * std < 4 * abs(v), (name, k)


@pytest.mark.parametrize("name", NAMES)
def test_a_strong_effect_is_named_and_only_it(name: str) -> None:
    problem, null = problem_of(pushed_trials(1, [text_of(name, NAMES[name])]))
    found = select_effects(problem, null)
    assert found.effects == (candidate(name),) == found.searches[0].indistinguishable
    assert found.robust[candidate(name)] < AGREE and found.searches[0].significant
    assert_sizes(found, name, NAMES[name])
    assert found.final.nll < found.null.nll - 20
    left = unnamed_forms(problem.steps, problem.data, found.final)
    assert decide(found, 99.0, left.log_bayes, left.limit, None) == ("named", [])


@pytest.mark.parametrize("seed", [2, 3])
def test_none_is_named_by_chance(seed: int) -> None:
    problem, null = problem_of(pushed_trials(seed, ship=drawn_ship(FEW, seed)))
    found = select_effects(problem, null)
    assert found.effects == () and found.final is null and len(found.searches) == 1
    assert found.robust == {}
    before = unnamed_forms(problem.steps, problem.data, null)
    assert decide(found, before.beyond_chance, before.log_bayes, before.limit, None) == ("none", [])


@pytest.mark.parametrize(
    ("test", "expected"),
    [
        (held(0.01, (-0.1, 0.1), 0.5, (-2.0, 3.0)), True),
        (held(-0.07, (-0.1, -0.02), 0.5, (-2.0, 3.0)), False),
        (held(-0.07, (-0.1, -0.02), 9.0, (2.0, 16.0)), True),
        (held(-0.01, (-0.1, 0.1), 9.0, None), False),
        (held(-0.01, (-0.1, 0.1), 0.5, (-2.0, 3.0)), True),
        (held(-0.01, (-0.1, 0.1), -0.5, (-3.0, 2.0)), False),
    ],
)
def test_a_further_effect_must_predict_test_trials_better(test: HeldOut, expected: bool) -> None:
    assert supports(test, found_with(12.0, "bank")) is expected


def test_two_effects_are_both_named() -> None:
    truth = {"current": {"x": 0.03, "y": -0.02}, "rudder_offset": {"delta": 0.1}}
    problem, null = problem_of(pushed_trials(2, [text_of(*e) for e in truth.items()]))
    found = select_effects(problem, null)
    assert {c.label for c in found.effects} == set(truth)
    assert found.effects[0] == found.searches[0].refitted[0].candidate
    for name, values in truth.items():
        assert_sizes(found, name, values)
    assert len(found.searches) == 3  # the last one finds nothing more
    one = found.without_last(problem)
    assert one.effects == found.effects[:1] and found.null.nll > one.final.nll > found.final.nll + 9
    assert {c.symbol for c in one.final.free.columns if "." in c.symbol} == set(one.effects[0].symbols)


@pytest.mark.parametrize("truth", ["rudder_lag:T=0.4", "control_delay:tau=0.4"])
def test_what_looks_alike_is_in_one_class(truth: str) -> None:
    """A rudder behind its record and a delay of both actuators, here hardly to be told apart."""
    problem, null = problem_of(pushed_trials(2, [truth], runs=(("zigzag:20/20", 60.0), ("turning:-20", 60.0))))
    s = select_effects(problem, null).searches[0]
    assert s.significant and {"rudder_lag", "control_delay"} <= {c.label for c in s.indistinguishable}
    assert s.indistinguishable[0] == s.refitted[0].candidate and candidate("current") not in s.indistinguishable


def a_fit(nll: float) -> Estimate:
    """A fit of which only the likelihood matters."""
    zero = np.zeros(0)
    path = Trajectory(np.zeros((2, 1, 6)), np.zeros((2, 1, 3)))
    return Estimate(zero, Priors((), zero, zero, zero, zero), zero, path, NOISE, np.zeros((0, 0)), nll, 1, True)


def made_up(label: str) -> Candidate:
    """A candidate of this label without parameters."""
    effect, form = (*label.removesuffix(" by run").split(" "), "")[:2]
    return Candidate(effect, form, label.endswith(" by run"), (), *4 * [np.zeros(0)])


def tried(name: str, delta_bic: float, p_value: float = 1e-6) -> RefittedEffect:
    return RefittedEffect(made_up(name), a_fit(0.0), 0.5 * delta_bic, delta_bic, p_value)


def test_a_class_is_what_lies_within_the_odds_of_the_best() -> None:
    rows = (
        tried("a", 20.0),
        tried("b", 20.1 - SAME_CLASS),
        tried("c", 19.9 - SAME_CLASS),
        tried("d", -3.0),
    )
    assert Search((), rows, a_fit(0.0)).indistinguishable == (made_up("a"), made_up("b"))
    assert Search((), (), a_fit(0.0)).indistinguishable == () and Search((), (), a_fit(0.0)).best is None


@pytest.mark.parametrize(
    ("best", "is_significant"),
    [
        (tried("a", 5.0, 0.5 * LEVEL), True),
        (tried("a", 5.0, 2.0 * LEVEL), False),
        (tried("a", -0.1, 1e-9), False),
        (None, False),
    ],
)
def test_more_than_chance_needs_a_small_probability_and_a_gain(
    best: RefittedEffect | None, is_significant: bool
) -> None:
    assert Search((), (best,) if best else (), a_fit(0.0)).significant is is_significant


def covariance(count: int, seed: int = 0) -> np.ndarray:
    A = np.random.default_rng(seed).standard_normal((count, count))
    return 20.0 * (A @ A.T + 0.3 * np.eye(count))


def test_log_bayes_is_the_ratio_of_the_marginal_likelihoods() -> None:
    """Slopes g = S b + chance of covariance S, with b of covariance a^2 or none."""
    S = covariance(4)
    g = np.random.default_rng(1).standard_normal(4) @ np.linalg.cholesky(S).T + S @ np.array([0.3, 0.0, -0.2, 0.1])
    some = np.array([True, False, True, True])
    g3, S3 = g[some], S[np.ix_(some, some)]
    likely = [multivariate_normal(np.zeros(3), S3 + a**2 * S3 @ S3).pdf(g3) for a in SIZES]
    expected = np.log(np.mean(likely)) - multivariate_normal(np.zeros(3), S3).logpdf(g3)
    assert log_bayes(g, S, some) == pytest.approx(expected, rel=1e-9)


def test_log_bayes_speaks_against_more_columns_under_chance_and_for_them_where_something_is() -> None:
    S, every = covariance(8), np.ones(8, dtype=bool)
    root, rng = np.linalg.cholesky(S), np.random.default_rng(2)
    by_chance = np.array([log_bayes(root @ rng.standard_normal(8), S, every) for _ in range(500)])
    assert by_chance.mean() < 0 and np.median(by_chance) < 0
    assert (by_chance > LIMIT).mean() < np.exp(-LIMIT)  # never wrong more often than the odds say
    there = np.array([log_bayes(S @ np.full(8, 0.8) + root @ rng.standard_normal(8), S, every) for _ in range(50)])
    assert there.min() > 10
    assert log_bayes(np.zeros(8), S, every) < 0
    assert log_bayes(np.zeros(8), np.zeros((8, 8)), every) == pytest.approx(0.0, abs=1e-12)


@pytest.fixture(scope="module")
def runs() -> SearchProblem:
    return problem_of(pushed_trials(1))[0]


@pytest.mark.parametrize(("sin_2", "low", "high"), [(0.0, -np.inf, 0.0), (0.4, 0.0, np.inf)])
def test_a_force_that_no_effect_of_the_library_has_is_seen(
    runs: SearchProblem, sin_2: float, low: float, high: float
) -> None:
    problem = replace(runs, data=pushed_windows(runs, 4, 2, "sin 2", sin_2))
    steps, data = problem.steps, problem.data
    start = initial_point(steps, data, steps.ship.values, problem.base, initial_noise(steps.ship))
    null = estimate(steps, data, start, iterations=12)
    found = unnamed_forms(steps, data, null)
    assert low < found.beyond_chance < high
    logs = list(found.by_kind.values())
    assert found.log_bayes == pytest.approx(np.log(np.mean(np.exp(logs))), rel=1e-6)
    if sin_2:
        assert max(found.by_kind, key=lambda kind: found.by_kind[kind]) == "yaw force"


@pytest.mark.parametrize(
    ("column", "by", "kind"),
    [("r", 0.002, "sensor of r"), pytest.param("v", 0.015, "sensor of v", marks=pytest.mark.slow)],
)
def test_a_fault_of_a_sensor_without_a_name_is_unknown(column: str, by: float, kind: str) -> None:
    """A constant error of turn rate or sway velocity is no effect of the library."""
    trials = [t.with_columns(**{column: t[column] + by}) for t in pushed_trials(2)]
    problem, null = problem_of(trials)
    before = unnamed_forms(problem.steps, problem.data, null)
    assert before.log_bayes > 20 and max(before.by_kind, key=lambda k: before.by_kind[k]) == kind
    found = select_effects(problem, null)
    after = unnamed_forms(problem.steps, problem.data, found.final)
    assert decide(found, before.beyond_chance, after.log_bayes, after.limit, None)[0] == "unknown"


def found_with(drop: float, *effects: str, p: float = 1e-4) -> Selection:
    """A search that ended with these effects, ``drop`` of log likelihood below the start."""
    named = tuple(made_up(e) for e in effects)
    return Selection(named, a_fit(100.0), a_fit(100.0 - drop), (), dict.fromkeys(named, p))


def test_nothing_named_is_none_or_unknown_by_the_dictionary() -> None:
    nothing = found_with(0.0)
    assert decide(nothing, -0.01, -1.0, LIMIT, None) == ("none", [])
    assert decide(nothing, 0.01, -1.0, LIMIT, None) == ("unknown", [])
    assert decide(nothing, -0.01, -1.0, LIMIT, held(0.0, (0.0, 0.0))) == ("none", [])


@pytest.mark.parametrize(
    ("p_value", "beyond", "verdict"), [(2, -0.1, "none"), (0.5, -0.1, "unknown"), (2, 0.1, "unknown")]
)
def test_a_name_withdrawn_that_may_be_chance_leaves_nothing(p_value: float, beyond: float, verdict: str) -> None:
    first = Search((), (tried("bank", 3.0, p_value * RARE),), a_fit(100.0))
    found = replace(found_with(12.0, "bank", p=1.1 * AGREE), searches=(first,))
    assert decide(found, beyond, -1.0, LIMIT, None)[0] == verdict


@pytest.mark.parametrize(
    "test",
    [
        None,
        held(0.3, (0.1, 0.4), 20.0, (5.0, 30.0)),
        held(0.0, (-0.1, 0.1), 1.0, (-2.0, 4.0)),
        held(-0.9 * SMALL_GROWTH, (-0.1, 0.05), -1.0, (-4.0, 1.0)),  # a little worse in both, well within chance
        held(
            -0.9 * LARGE_GROWTH, (-0.2, -0.05), 12.0, (3.0, 20.0)
        ),  # longer predictions worse, one-step ones surely better
    ],
)
def test_a_name_stands_where_nothing_speaks_against_it(test: HeldOut | None) -> None:
    assert decide(found_with(12.0, "current"), 9.0, -1.0, LIMIT, test) == ("named", [])


@pytest.mark.parametrize(
    ("test", "verdict"),
    [
        (None, "unknown"),
        (held(2 * CONFIRMING_REDUCTION, (0.01, 0.2), 3.0, (1.0, 5.0)), "named"),
        (held(0.9 * CONFIRMING_REDUCTION, (0.01, 0.2), 3.0, (1.0, 5.0)), "unknown"),
        (held(2 * CONFIRMING_REDUCTION, (-0.01, 0.2), 3.0, (1.0, 5.0)), "unknown"),
    ],
)
def test_a_name_that_explains_less_than_is_left_needs_support_by_test_trials(
    test: HeldOut | None, verdict: str
) -> None:
    found, reasons = decide(found_with(6.0, "draft", "tow"), 9.0, 6.1, LIMIT, test)
    assert found == verdict and bool(reasons) == (verdict == "unknown")
    if reasons:
        assert "draft and tow would explain a part" in reasons[0] and "withdrawn" in reasons[0]
    less = decide(found_with(6.0, "draft", "tow"), 9.0, 5.9, LIMIT, test)[0]
    assert less == ("named" if test is None else verdict)  # test trials that are there must support it
    assert (
        decide(found_with(6.0 / UNEXPLAINED_RATIO, "draft", "tow"), 9.0, 5.9, LIMIT, test)[0] == "named"
    )  # a remainder, no more
    assert decide(found_with(0.5, "draft"), 9.0, LIMIT - 0.01, LIMIT, test)[0] == "named"


@pytest.mark.parametrize(("value", "verdict"), [(4.9, "named"), (5.0, "unknown")])
def test_a_name_that_needs_the_end_of_what_is_possible_is_withdrawn(value: float, verdict: str) -> None:
    free = Priors(
        (Column("X_0F"), Column("fouling.share")), np.zeros(2), np.ones(2), np.array([0.0, -0.6]), np.array([9.0, 5.0])
    )
    final = replace(a_fit(80.0), free=free, p=np.array([0.0, value]))  # a coefficient of the ship's own may be there
    found = Selection((made_up("fouling"),), a_fit(100.0), final, (), {made_up("fouling"): 1e-4})
    got, reasons = decide(found, 9.0, -1.0, LIMIT, None)
    assert got == verdict and bool(reasons) == (verdict == "unknown")
    assert not reasons or "fouling.share = 5 at the end of what is possible" in reasons[0]
    assert decide(found, 9.0, -1.0, LIMIT, held(0.3, (0.1, 0.4), 20.0, (5.0, 30.0)))[0] == "named"


def test_where_longer_predictions_become_worse_less_may_be_left_without_a_name() -> None:
    for reduction, share in (
        (-0.9 * SMALL_GROWTH, UNEXPLAINED_RATIO),
        (-1.1 * SMALL_GROWTH, STRICT_RATIO),
    ):
        test = held(reduction, (-0.2, 0.1), 20.0, (5.0, 30.0))
        for left, verdict in ((0.9, "named"), (1.1, "unknown")):
            assert decide(found_with(100.0, "rudder_lag"), 99.0, left * share * 100.0, LIMIT, test)[0] == verdict


def test_where_test_trials_show_no_gain_at_all_nothing_may_be_left_without_a_name() -> None:
    """Real records without their wind: a memory of the hull fitted them, and the test trials were no better with it."""
    for test, verdict in (
        (held(0.06, (-0.06, 0.14), 2.0, (-3.0, 7.0)), "unknown"),
        (held(0.06, (-0.06, 0.14), 9.0, (2.0, 16.0)), "named"),
        (held(0.06, (0.01, 0.14), 2.0, (-3.0, 7.0)), "named"),
        (None, "named"),
    ):
        assert decide(found_with(100.0, "hull_memory"), 99.0, 1.1 * LIMIT, LIMIT, test)[0] == verdict
        assert decide(found_with(100.0, "hull_memory"), 99.0, 0.9 * LIMIT, LIMIT, test)[0] == "named"


def test_a_fault_of_one_instrument_alone_leaves_little_over() -> None:
    """Whatever the test trials say: they have the same fault, and a neighbour of it predicts them better, too."""
    support = held(0.3, (0.1, 0.4), 20.0, (5.0, 30.0))
    for drop, left in ((30.0, BESIDE_INSTRUMENT_FAULT[0]), (200.0, 200.0 * BESIDE_INSTRUMENT_FAULT[1])):
        for test in (None, support):
            assert decide(found_with(drop, "heading_bias alone"), 99.0, left - 0.1, LIMIT, test)[0] == "named"
            verdict, reasons = decide(found_with(drop, "heading_bias alone"), 99.0, left + 0.1, LIMIT, test)
            assert verdict == "unknown" and "leaves little over" in reasons[0]
        assert decide(found_with(drop, "heading_bias"), 99.0, left + 0.1, LIMIT, support)[0] == "named"


def test_a_name_on_which_the_runs_do_not_agree_is_withdrawn() -> None:
    verdict, reasons = decide(found_with(12.0, "bank", p=1.1 * AGREE), 9.0, -1.0, LIMIT, None)
    assert verdict == "unknown" and reasons == [
        f"the runs do not agree on bank (p = {1.1 * AGREE:.2g}): the name is withdrawn"
    ]
    assert decide(found_with(12.0, "bank", p=0.9 * AGREE), 9.0, -1.0, LIMIT, None)[0] == "named"
    support = held(2 * CONFIRMING_REDUCTION, (0.01, 0.2), 3.0, (1.0, 5.0))
    assert decide(found_with(12.0, "bank", p=1.1 * AGREE), 9.0, -1.0, LIMIT, support)[0] == "named"


@pytest.mark.parametrize(
    ("after", "test", "verdict"),
    [
        (-1.0, None, "named"),
        (2 * LIMIT, None, "unknown"),
        (-1.0, held(0.01, (-0.1, 0.1), 3.0, (1.0, 5.0)), "unknown"),
        (2 * LIMIT, held(2 * CONFIRMING_REDUCTION, (0.01, 0.2), 3.0, (1.0, 5.0)), "named"),
    ],
)
def test_an_effect_with_values_of_its_own_in_each_run_needs_support(
    after: float, test: HeldOut | None, verdict: str
) -> None:
    found, reasons = decide(found_with(40.0, "current by run"), 9.0, after, LIMIT, test)
    assert found == verdict and bool(reasons) == (verdict == "unknown")
    if reasons:
        assert "current could differ from run to run" in reasons[0]


@pytest.mark.parametrize(
    "test",
    [
        held(
            -1.1 * LARGE_GROWTH, (-0.3, -0.01), 12.0, (3.0, 20.0)
        ),  # clearly worse over 30 s, whatever the single steps do
        held(-0.5 * LARGE_GROWTH, (-0.2, -0.01), 12.0, (-3.0, 20.0)),  # worse, and single steps not surely better
        held(-0.5 * LARGE_GROWTH, (-0.2, -0.01), None, None),
        held(-1.1 * NOTED_GROWTH, (-0.2, 0.1), 3.0, (-3.0, 8.0)),  # worse by more than a little, and no gain elsewhere
        held(-1.1 * SMALL_GROWTH, (-0.2, 0.1), -0.1, (-3.0, 2.0)),  # a little worse in both
        held(0.01, (-0.1, 0.1), -3.1, (-6.0, -1.0)),  # single steps worse, no gain over 30 s
    ],
)
def test_a_name_that_test_trials_contradict_is_withdrawn(test: HeldOut) -> None:
    verdict, reasons = decide(found_with(12.0, "fouling"), 9.0, -1.0, LIMIT, test)
    assert verdict == "unknown" and len(reasons) == 1
    assert "fouling fits the training trials but does not predict the test trials better" in reasons[0]


@pytest.mark.parametrize(
    ("test", "verdict"),
    [
        (held(-1.1 * SMALL_GROWTH, (-0.2, 0.1), -0.1, (-3.0, 2.0)), "named"),  # a little worse in both, by chance
        (held(0.01, (-0.1, 0.1), -3.1, (-6.0, 1.0)), "named"),
        (held(0.01, (-0.1, 0.1), -3.1, (-6.0, -1.0)), "unknown"),  # single steps surely worse
        (held(-1.1 * NOTED_GROWTH, (-0.2, -0.01), 3.0, (-3.0, 8.0)), "unknown"),  # windows surely worse
        (held(0.01, (-0.1, 0.1), -3.1, None), "unknown"),  # what chance does cannot be told
    ],
)
def test_a_name_that_no_chance_explains_must_surely_be_contradicted(test: HeldOut, verdict: str) -> None:
    sure, unsure = (Search((), (tried("fouling", 3.0, f * CERTAIN),), a_fit(100.0)) for f in (0.5, 2.0))
    name = found_with(12.0, "fouling")
    assert decide(replace(name, searches=(sure,)), 9.0, -1.0, LIMIT, test)[0] == verdict
    assert decide(replace(name, searches=(unsure,)), 9.0, -1.0, LIMIT, test)[0] == "unknown"
    two = replace(found_with(12.0, "bank", "fouling"), searches=(unsure, sure))
    assert decide(two, 9.0, -1.0, LIMIT, test)[0] == "unknown"
    assert supports(test, two) == (verdict == "named" or test.reduction > 0)


@pytest.mark.parametrize(
    ("name", "sure", "verdict"),
    [
        ("gnss_delay", (20.0, 60.0), "named"),
        ("gnss_delay", (-3.0, 60.0), "unknown"),
        ("fouling", (20.0, 60.0), "unknown"),
    ],
)
def test_windows_that_begin_at_a_late_row_do_not_speak_against_a_late_sensor(
    name: str, sure: tuple[float, float], verdict: str
) -> None:
    """A window begins at a logged row, which is itself late: its error grows, though the delay is right."""
    test = held(-0.41, (-0.6, -0.2), 40.0, sure)
    assert decide(found_with(108.0, name), 99.0, -1.0, LIMIT, test)[0] == verdict


@pytest.mark.parametrize(("name", "verdict"), [("heading_bias", "unknown"), ("fouling", "named")])
def test_nor_do_they_speak_for_a_fault_of_an_instrument_that_single_steps_contradict(name: str, verdict: str) -> None:
    """Two runs, one of them for training: a compass was said to be off, whose windows gained 0.6 %, single steps -40."""
    test = held(0.006, (0.001, 0.01), -40.0, None)
    assert decide(found_with(12.0, name), 9.0, -1.0, LIMIT, test)[0] == verdict
