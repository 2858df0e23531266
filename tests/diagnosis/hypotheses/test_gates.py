"""What a name must pass: nothing superfluous, no chance by standard errors, agreement, no form without a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import norm

import diagnosis.hypotheses.forward_selection as hypotheses
from cases.trial import Trial
from diagnosis.estimation.candidates import Candidate, Column, find
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Trajectory
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.hypotheses.forward_selection import (
    AGREE,
    IMMATERIAL,
    NEUTRAL,
    RefittedEffect,
    ScoreTest,
    Search,
    Selection,
    select_effects,
)
from diagnosis.hypotheses.found_again import CERTAIN
from diagnosis.hypotheses.refit import BLOCK, SPARE, clusters, refit, robust_p, wald_p
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.unnamed import unnamed_forms
from tests.support.diagnosis_cases import full_steps, problem_of, pushed_by, pushed_trials, short_data

H = 1.0
NOISE = NoiseModel(np.ones(3), 5.0, np.ones(6), np.zeros(6), 4.0)


def candidate(name: str, degrees: int = 1, neutral: float = 0.0) -> Candidate:
    zero = np.zeros(degrees)
    columns = tuple(Column(f"{name}.{j}") for j in range(degrees))
    return Candidate(name, "", columns, zero + neutral, zero + 1.0, zero - np.inf, zero + np.inf)


def fit_of(effects: Sequence[Candidate], nll: float, values: Sequence[float] | None = None) -> Estimate:
    """A fit of which only its values and its likelihood matter."""
    columns = tuple(x for c in effects for x in c.columns)
    n = len(columns)
    free = Priors(columns, np.zeros(n), np.ones(n), np.full(n, -np.inf), np.full(n, np.inf))
    path = Trajectory(np.zeros((2, 1, 6)), np.zeros((2, 1, 3)))
    p = np.zeros(n) if values is None else np.array(values)
    return Estimate(np.zeros(n), free, p, path, NOISE, 0.01 * np.eye(n), nll, 1, True)


EFFECTS = {"a": candidate("a"), "b": candidate("b", 2)}


@dataclass(frozen=True)
class Refit:
    """A call of ``refit``."""

    names: tuple[str, ...]
    before: Estimate
    start: Mapping[Column, float]


@dataclass
class Fits:
    """Fits that the tests make up, by the effects in them: the negative log likelihood that ``refit`` ends at, and the
    probability of each effect by its standard errors."""

    problem: SearchProblem
    nll: dict[str, float]
    wald: dict[str, float]
    calls: list[Refit]

    def prune(self, named: str, nll: float, again: float = 0.0) -> tuple[str, Estimate]:
        """The names that remain, and the fit, from one with ``named`` at ``nll``; again: what test trials gain by b."""
        effects = [EFFECTS[n] for n in named]
        now = fit_of(effects, nll, [0.5 + i for i in range(sum(len(e.columns) for e in effects))])
        kept, found = hypotheses.pruned(self.problem, effects, now, {EFFECTS["b"]: again})
        return "".join(c.label for c in kept), found


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> Fits:
    made = Fits(
        SearchProblem(full_steps(H), short_data(H), Priors((), *4 * [np.zeros(0)]), tuple(EFFECTS.values())), {}, {}, []
    )

    def refitted(
        steps: object,
        data: object,
        base: object,
        before: Estimate,
        effects: Sequence[Candidate],
        start: dict[Column, float],
    ) -> Estimate:
        names = tuple(e.label for e in effects)
        made.calls.append(Refit(names, before, start))
        return fit_of(effects, made.nll["".join(names)])

    monkeypatch.setattr(hypotheses, "refit", refitted)
    monkeypatch.setattr(hypotheses, "gained", lambda fewer, kept, more, every: fewer.nll - more.nll)
    monkeypatch.setattr(hypotheses, "wald_p", lambda found, effect: made.wald.get(effect.label, 1e-9))
    monkeypatch.setattr(SearchProblem, "without", lambda self, found, kept: found)
    return made


@pytest.mark.parametrize(
    ("name", "size", "p_value", "material"),
    [
        ("log_scale", 0.9 * IMMATERIAL, 2 * CERTAIN, False),
        ("log_scale", -1.1 * IMMATERIAL, 2 * CERTAIN, True),
        ("log_scale", 0.9 * IMMATERIAL, 0.5 * CERTAIN, True),  # small, but beyond chance
        ("fouling", 0.1 * IMMATERIAL, 2 * CERTAIN, True),  # no instrument
    ],
)
def test_a_small_fault_of_an_instrument_is_none_unless_chance_is_excluded(
    name: str, size: float, p_value: float, material: bool
) -> None:
    c = candidate(name, neutral=0.5)
    one = RefittedEffect(c, fit_of([c], 90.0, [0.5 + size]), 9.0, 5.0, p_value)
    assert one.size == pytest.approx([size]) and one.is_material is material


def test_an_effect_that_only_helped_the_fit_to_a_better_place_goes_although_it_is_the_newest(fits: Fits) -> None:
    """With the older one alone the fit was far worse, but not if it begins where the fit with both ended."""
    fits.nll = {"a": 60.1, "b": 100.0, "": 120.0}
    kept, found = fits.prune("ab", 60.0)
    assert kept == "a" and found.nll == 60.1
    without_b = next(c for c in fits.calls if c.names == ("a",))
    assert without_b.before.nll == 60.0 and without_b.start == {Column("a.0"): 0.5}


def test_an_effect_that_test_trials_show_again_is_not_pruned_for_what_the_training_trials_gain(fits: Fits) -> None:
    fits.nll = {"a": 61.0, "b": 100.0, "": 120.0}
    assert fits.prune("ab", 60.0)[0] == "a" and fits.prune("ab", 60.0, 2 * fits.problem.cost)[0] == "ab"


def test_an_older_effect_that_a_new_one_makes_superfluous_goes(fits: Fits) -> None:
    fits.nll = {"a": 100.0, "b": 60.5, "": 120.0}
    kept, found = fits.prune("ab", 60.0)
    assert kept == "b" and found.nll == 60.5
    assert fits.calls[0].names == ("b",) and fits.calls[0].start == {Column("b.0"): 1.5, Column("b.1"): 2.5}


def test_effects_that_are_both_needed_stay(fits: Fits) -> None:
    fits.nll = {"a": 100.0, "b": 100.0}
    kept, found = fits.prune("ab", 60.0)
    assert kept == "ab" and found.nll == 60.0 and len(fits.calls) == 2


def test_nothing_stays_where_none_is_needed_at_the_end(fits: Fits) -> None:
    fits.nll = {"a": 60.1, "b": 60.1, "": 60.2}
    assert fits.prune("ab", 60.0)[0] == ""
    assert fits.prune("ab", 60.0)[1].nll == 60.2


@pytest.mark.parametrize(("name", "degrees"), [("a", 1), ("b", 2)])
def test_an_effect_stays_if_what_is_lost_without_it_pays_for_its_parameters(
    fits: Fits, name: str, degrees: int
) -> None:
    """Twice the loss of log likelihood against ln N by parameter, as in the BIC."""
    worth = 0.5 * degrees * fits.problem.cost
    assert fits.problem.cost == pytest.approx(np.log(fits.problem.data.samples))
    fits.nll = {"": 60.0 + 0.99 * worth}
    assert fits.prune(name, 60.0)[0] == ""
    fits.nll = {"": 60.0 + 1.01 * worth}
    assert fits.prune(name, 60.0)[0] == name


@pytest.mark.parametrize(("p", "kept"), [(1.1 * NEUTRAL, "b"), (0.9 * NEUTRAL, "ab")])
def test_an_effect_that_is_neutral_within_its_standard_errors_goes_whatever_it_helped(
    fits: Fits, p: float, kept: str
) -> None:
    fits.nll, fits.wald = {"a": 100.0, "b": 100.0, "": 150.0}, {"a": p}
    assert fits.prune("ab", 60.0)[0] == kept


def test_a_better_place_without_any_effect_is_where_the_search_goes_on(
    fits: Fits, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first effect goes again: what came of it is the fit without effects that all else is compared with."""
    fits.nll = {"": 60.1}
    null, begun = fit_of([], 100.0), []
    row = ScoreTest(EFFECTS["a"], 80.0, 1, 1e-9, 1e-9, np.ones(1), 0.0, True)
    first = RefittedEffect(EFFECTS["a"], fit_of([EFFECTS["a"]], 60.0, [1.0]), 40.0, 75.0, 1e-9)

    def searched(problem: SearchProblem, before: Estimate, named: Sequence[str], **more: object) -> Search:
        begun.append((before.nll, tuple(named)))
        return Search((row,), (first,) if before is null else (), before)

    monkeypatch.setattr(hypotheses, "search", searched)
    found = select_effects(fits.problem, null)
    assert begun == [(100.0, ()), (60.1, ())]
    assert found.effects == () and found.null.nll == 60.1 and found.final is found.null and found.robust == {}


def test_probability_by_standard_errors_is_that_of_a_normal_law() -> None:
    e = candidate("a", neutral=1.0)
    free = Priors(
        (Column("Y_v"), Column("a.0")),
        np.array([3.0, 2.0]),
        np.array([1.0, 5.0]),
        *np.array([[-np.inf] * 2, [np.inf] * 2]),
    )
    covariance = np.array([[0.3, 0.05], [0.05, 0.04]])  # of (value - mean) / prior std
    found = replace(fit_of([], 0.0), free=free, p=np.array([4.0, 0.3]), covariance=covariance)
    assert (found.value("a.0"), found.std("a.0")) == pytest.approx((3.5, 1.0))
    assert wald_p(found, e) == pytest.approx(2 * norm.sf(2.5), rel=1e-9)
    assert wald_p(replace(found, p=np.array([4.0, -0.2])), e) == pytest.approx(1.0)  # neutral


def test_probability_of_two_parameters_together_minds_their_correlation() -> None:
    """exp(-x^2 / 2) with two degrees of freedom, x^2 = (m^2 + n^2 - 2 c m n) / (1 - c^2)."""
    e = candidate("b", 2)
    free = Priors(e.columns, np.zeros(2), np.array([2.0, 3.0]), np.full(2, -np.inf), np.full(2, np.inf))
    c, m, n = -0.6, 1.5, 2.0
    covariance = 0.01 * np.array([[1.0, c], [c, 1.0]])
    found = replace(fit_of([], 0.0), free=free, p=np.array([0.1 * m, 0.1 * n]), covariance=covariance)
    square = (m**2 + n**2 - 2 * c * m * n) / (1 - c**2)
    assert wald_p(found, e) == pytest.approx(np.exp(-0.5 * square), rel=1e-9)
    along = replace(found, p=np.array([0.1 * m, -0.1 * n]))  # as their correlation has it
    assert wald_p(along, e) > 5 * wald_p(found, e)


def windows(seconds: float, runs: Sequence[int], h: float = 1.0) -> GriddedTrials:
    """Windows of these runs with nothing in them."""
    K, R = round(seconds / h), len(runs)
    t = np.repeat(h * np.arange(K + 1)[:, None], R, axis=1)
    nothing, good = np.zeros((K + 1, R, 6)), np.ones((K + 1, R, 6), dtype=bool)
    held = np.zeros((K, R, 2))
    return GriddedTrials(
        h, t, nothing, good, good, held, np.full(R, K), np.array(runs), tuple(str(r) for r in set(runs))
    )


def test_runs_are_clusters_where_they_are_enough_and_blocks_of_time_else() -> None:
    q = 2
    enough = list(range(q + SPARE))
    data = windows(50.0, [*enough, 0])  # two windows of the first run
    np.testing.assert_array_equal(clusters(data, q, 3.0), np.broadcast_to(data.run, (51, len(enough) + 1)))
    few = clusters(windows(50.0, enough[:-1]), q, 3.0)
    assert len(np.unique(few)) == 3 * len(enough[:-1])
    for r in range(few.shape[1]):
        np.testing.assert_array_equal(np.diff(few[:, r]).nonzero()[0] + 1, [BLOCK, 2 * BLOCK])
    large = clusters(windows(50.0, [0], 0.5), q, 12.0)  # a ship of four times the length: blocks of twice the time
    np.testing.assert_array_equal(np.diff(large[:, 0]).nonzero()[0] + 1, [2 * BLOCK / 0.5])


@pytest.fixture(scope="module")
def one_run() -> tuple[SearchProblem, Estimate]:
    return problem_of(pushed_trials(3, runs=(("random:11", 160.0),)), H)


def log_off(problem: SearchProblem, null: Estimate, begin: float, end: float) -> tuple[float, float]:
    """Probability by standard errors and by agreement of a wrong log, where it is wrong from begin to end [s]."""
    data = problem.data
    wrong = np.where((data.t >= begin) & (data.t <= end), 1.05, 1.0)[..., None]
    y = np.concatenate([data.y[..., :3], wrong * data.y[..., 3:5], data.y[..., 5:]], axis=2)
    data, effect = replace(data, y=y), find(problem.candidates, "log_scale")
    found = refit(problem.steps, data, problem.base, null, [effect], {Column("log_scale.share"): 0.01})
    return wald_p(found, effect), robust_p(problem.steps, data, found, effect)


def test_stretches_of_one_run_agree_on_what_is_always_there_and_not_on_what_comes_once(
    one_run: tuple[SearchProblem, Estimate],
) -> None:
    always, agreed = log_off(*one_run, 0.0, 1e9)
    once, doubted = log_off(*one_run, 20.0, 40.0)
    assert always < 1e-6 and agreed < 0.1 * AGREE
    assert once < 0.05  # its standard errors alone would let it pass
    assert doubted > AGREE


def test_too_few_stretches_cannot_disagree() -> None:
    """Of 40 s there are two: as many as are needed for a scatter at all are three."""
    problem, null = problem_of(pushed_trials(3, runs=(("random:11", 39.0),)), H)
    assert log_off(problem, null, 15.0, 25.0)[1] == 0.0


@pytest.fixture(scope="module")
def runs() -> SearchProblem:
    return problem_of(pushed_trials(1), H)[0]


def test_no_single_form_is_seen_by_chance(runs: SearchProblem) -> None:
    found = np.array([unnamed_forms(*pushed_by(runs, seed, 0, "cos", 0.0)).single for seed in range(3)])
    assert found.max() < 2.0 and np.median(found) < 0.0


@pytest.mark.parametrize(("axis", "form", "size"), [(1, "nn", 0.5), (2, "cos", 0.4)])
def test_a_single_form_that_the_ship_lacks_is_seen(runs: SearchProblem, axis: int, form: str, size: float) -> None:
    found = unnamed_forms(*pushed_by(runs, 1, axis, form, size))
    assert found.single > found.single_limit + 4.0
    largest = max(found.by_kind, key=lambda k: found.by_kind[k])
    assert largest.startswith(("surge force", "sway force", "yaw force")[axis])


def ramp(dt: float) -> Trial:
    """A rudder that moves steadily."""
    trial = pushed_trials(1, runs=(("zigzag:20/20", 40.0),))[0]
    every = round(dt / trial.dt)
    cut = replace(trial, columns={k: v[::every] for k, v in trial.columns.items()})
    return cut.with_columns(delta=0.004 * (cut.t - cut.t[0]))


def test_inputs_are_held_or_joined_as_they_are_read() -> None:
    steps = full_steps(H)
    for straight, late in ((False, 0.05), (True, 0.0)):
        data = grid_trials([ramp(0.1)], steps.ship.inputs, 3.0, H, straight=straight)
        delta = data.inputs[:, 0, steps.ship.inputs.index("delta")]
        middle = 0.5 * (data.t[1:, 0] + data.t[:-1, 0]) - data.t[0, 0]
        np.testing.assert_allclose(delta, 0.004 * (middle - late), rtol=1e-6, atol=1e-9)
        assert data.straight is straight


def test_a_search_that_finds_nothing_leaves_the_fit_as_it_is(fits: Fits, monkeypatch: pytest.MonkeyPatch) -> None:
    null = fit_of([], 100.0)
    monkeypatch.setattr(hypotheses, "search", lambda problem, before, named, **more: Search((), (), before))
    found: Selection = select_effects(fits.problem, null)
    assert found.effects == () and found.final is null and found.null is null and not fits.calls
