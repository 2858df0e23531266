"""The decision on a residual: what trains, stops and judges is apart, and chance is not taken for a gain."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import torch

from cases.trial import Trial
from fitting.nlp.windows import Stretch, pieces_of
from mmg.errors import TooFewData
from mmg.ship import Ship
from residual.decide import BLOCK, decide, judged_by_whole_runs
from residual.hybrid import HYBRID_KIND
from residual.pipeline import train
from residual.settings import TrainSettings
from residual.splits import FOLDS, GAP, Split, split_pieces
from residual.system import TrainableSystem
from residual.train import Outcome, tasks_of, train_one
from residual.windows import Scales
from tests.support import hybrids

ON_SECONDS = TrainSettings(step=1.0)


@lru_cache(maxsize=8)
def pieces(runs: int, seconds: int) -> list[Stretch]:
    return pieces_of(hybrids.trials(hybrids.ship(), runs, seconds), 1.0, hybrids.ship().inputs)


def rows(part: list[Stretch]) -> set[tuple[int, int]]:
    """Rows of pieces, by run."""
    return {(p.run, k) for p in part for k in range(p.first, p.last + 1)}


def test_whole_runs_take_turns_where_there_are_enough_and_later_rounds_stop_by_others() -> None:
    given = pieces(8, 40)
    turns = [split_pieces(given, turn, ON_SECONDS, 30.0) for turn in range(2 * FOLDS)]
    for turn, split in enumerate(turns):
        train_runs, stop, judge = ({p.run for p in part} for part in split[:3])
        assert train_runs | stop | judge == set(range(8)) and len(train_runs) + len(stop) + len(judge) == 8
        assert 1 <= len(stop) <= 2 and split.fold == turn % FOLDS
        assert judge == {k for k in range(8) if k % FOLDS == turn % FOLDS}
        assert turn < FOLDS or not rows(split.stop) & rows(turns[turn - FOLDS].stop)


@pytest.mark.slow
@pytest.mark.parametrize("turn", range(6))
@pytest.mark.parametrize(("runs", "seconds"), [(1, 400), (3, 400), (2, 1000)])
def test_blocks_that_serve_differently_are_apart_in_time(runs: int, seconds: int, turn: int) -> None:
    split = split_pieces(pieces(runs, seconds), turn, ON_SECONDS, 30.0)
    every = [(p, number) for number, side in enumerate(split[:3]) for p in side]
    for p, one in every:
        for q, other in every:
            if p.run == q.run and one != other:
                assert max(p.first - q.last, q.first - p.last) >= GAP
    assert all(any(p.steps >= 30 for p in part) for part in split[:3])


def test_blocks_all_judge_once() -> None:
    given = pieces(2, 800)
    judged = [p for turn in range(FOLDS) for p in split_pieces(given, turn, ON_SECONDS, 30.0).judge]
    assert len(judged) == len({(p.run, p.first) for p in judged}) == 10


@pytest.mark.parametrize("runs", [3, 4])
def test_of_three_or_four_runs_a_whole_one_judges(runs: int) -> None:
    given = pieces(runs, 400)
    turns = [split_pieces(given, turn, ON_SECONDS, 30.0) for turn in range(runs)]
    for turn, split in enumerate(turns):
        assert rows(split.judge) == {(turn, k) for k in range(401)}
        trained, stopped = rows(split.train), rows(split.stop)
        assert {run for run, _ in trained | stopped} == set(range(runs)) - {turn} and stopped
        assert not trained & stopped and min(abs(a - b) for r, a in stopped for q, b in trained if r == q) >= GAP


def test_with_validation_only_a_part_to_stop_by_is_taken_away() -> None:
    split = split_pieces(pieces(5, 40), 3, ON_SECONDS, 30.0, judge=False)
    assert [p.run for p in split.stop] == [3] and len(split.train) == 4 and not split.judge


class Ballast(TrainableSystem):
    """Predicts no motion at all but a learned drift in x, which memorises nothing and knows nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.w = torch.nn.Parameter(torch.zeros(1, dtype=torch.float64))

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return torch.cat([self.w.expand(1, z.shape[1]), torch.zeros_like(z[1:])])


def ballast(ship: Ship, scales: Scales, training: TrainSettings, seed: int) -> TrainableSystem:
    return Ballast()


BALLAST = HYBRID_KIND._replace(build=ballast)
DRIFT = TrainSettings(seeds=2, step=1.0, epochs=30, rate=2e-2, penalty=0.0, curriculum=((10.0, 1.0),))


def drifting(runs: int, speeds: list[float]) -> list[Trial]:
    """Runs that only drift in x; the other columns, constant in each run, give the scales."""
    made = []
    for k, trial in enumerate(hybrids.trials(hybrids.ship(), runs, 60)):
        still = {c: 0 * trial[c] + 1e-3 * k for c in ("y", "psi", "u", "v", "r")}
        made.append(replace(trial.with_columns(x=speeds[k] * trial["t"], **still), name=f"drift{k}"))
    return made


@pytest.mark.slow
def test_what_judges_is_neither_trained_on_nor_stopped_by() -> None:
    """Four runs drift forward and the judging one backward: whoever had looked at it would not go forward."""
    ship = hybrids.ship()
    trials = drifting(5, [-0.3, 0.3, 0.3, 0.3, 0.3])
    (task,) = tasks_of(BALLAST, ship, trials, replace(DRIFT, seeds=1))
    found = train_one(task)
    assert {int(run) for run in found.judged[:, 0]} == {0}
    assert found.state["w"][0] == pytest.approx(0.3, abs=0.05)
    assert min(row[3] for row in found.history) < 0.2 * found.history[0][3], "the stop windows saw a gain"
    assert found.after[0] > 2 * found.before[0], "the judged windows must tell that it is worse"
    assert not decide([found]).kept
    np.testing.assert_allclose(found.judged[:, 2:].mean(axis=0), [found.before[0], found.after[0]])


@pytest.mark.slow
def test_validation_trials_judge_and_do_not_stop() -> None:
    ship = hybrids.ship()
    trials = drifting(6, [0.3, 0.3, 0.3, 0.3, 0.3, -0.3])
    for task in tasks_of(BALLAST, ship, trials[:5], DRIFT, trials[5:]):
        found = train_one(task)
        assert found.after[0] > 2 * found.before[0] and found.state["w"][0] == pytest.approx(0.3, abs=0.05)
    (task, _) = tasks_of(BALLAST, ship, trials[:5], DRIFT, trials[5:], judged_apart=False)
    assert train_one(task).after[0] <= train_one(task).before[0], "without `judged_apart` it stops by them"


def test_validation_needs_something_to_stop_by() -> None:
    ship = hybrids.ship()
    short, long = hybrids.trials(ship, 1, 60), hybrids.trials(ship, 1, 300, seed=5)
    with pytest.raises(TooFewData):
        train(ship, short, long, TrainSettings(step=1.0))


NO_RESTART = float("nan")
"""Error of 100 s restarts where none fits."""
EVEN = [(1.0, 0.9), (1.0, 0.91), (1.0, 0.89), (1.0, 0.92), (1.0, 0.88)]
"""Errors of runs before and after that all become about a tenth better."""


def outcome(
    window: float, restart: float = 1.0, fold: int = 0, status: str = "finished", before: float = 1.0, runs: object = ()
) -> Outcome:
    judged = np.array([(run, 0, *pair) for run, pair in enumerate(runs)]).reshape(-1, 4)  # type: ignore[arg-type, var-annotated]
    errors = (before, float("nan") if restart is NO_RESTART else 1.0), (before * window, restart)
    return Outcome(0, status, *errors, (), {}, 1e-3, 0, 1.0, 10, 10, judged, fold)


@pytest.mark.parametrize(
    ("outcomes", "kept"),
    [
        ([outcome(0.9), outcome(0.91), outcome(0.89)], True),
        ([outcome(0.7), outcome(0.99), outcome(1.0)], False),  # within the spread
        ([outcome(0.995), outcome(0.996), outcome(0.994)], False),  # too little
        ([outcome(0.9, 1.2), outcome(0.91, 1.21), outcome(0.89, 1.19)], False),  # restarts suffer
        ([outcome(0.9, 1.05), outcome(0.91, 0.97), outcome(0.89, 1.01)], True),  # restarts within their error
        ([outcome(0.9, 1.04), outcome(0.91, 1.00), outcome(0.89, 1.05)], False),  # beyond std / sqrt(3), not std
        ([outcome(0.9, NO_RESTART), outcome(0.91, NO_RESTART)], True),
        ([outcome(0.9), outcome(0.91, float("inf")), outcome(0.89)], False),  # restarts diverge
        ([outcome(0.9), outcome(0.91, float("-nan")), outcome(0.89)], False),
        ([outcome(0.9), outcome(float("nan")), outcome(0.89)], False),
        ([outcome(1.0, status="diverged")] * 2, False),
        ([outcome(0.9), outcome(1.5, before=1e-3), outcome(0.91)], True),  # worse where there is next to no error
    ],
)
def test_the_decision(outcomes: list[Outcome], kept: bool) -> None:
    assert decide(outcomes).kept is kept


def test_100_s_predictions_that_become_worse_within_what_runs_differ_by_are_no_harm() -> None:
    for worse, kept in (([0.9, 0.95, 1.0, 1.15, 1.05], True), ([1.04, 1.05, 1.06, 1.05, 1.05], False)):
        rows = np.array([(run, 0, 1.0, error) for run, error in enumerate(worse)])
        one = replace(outcome(0.9, float(np.mean(worse)), runs=EVEN), restarts_judged=rows)
        assert decide([one, one]).kept is kept


def test_a_gain_that_one_run_makes_is_no_gain() -> None:
    single = [(1.0, 0.4), (1.0, 1.02), (1.0, 1.03), (1.0, 1.02), (1.0, 1.03)]
    for runs, kept in ((EVEN, True), (single, False)):
        found = decide([outcome(0.9, runs=runs), outcome(0.9, runs=runs)])
        assert found.kept is kept, found.words
    assert found.runs_error == pytest.approx(np.std([0.6, -0.02, -0.03, -0.02, -0.03], ddof=1) / np.sqrt(5))


def test_few_runs_need_a_larger_gain_than_many() -> None:
    """0.1 +- 0.05: three runs leave it to chance (Student's t with 2 degrees of freedom), twelve do not."""
    errors = np.sqrt([3, 12]) * 0.05
    for count, error, kept in ((3, errors[0], False), (12, errors[1], True)):
        gains = np.linspace(-1, 1, count)
        gains = 0.1 + error * gains / np.std(gains, ddof=1)
        found = decide([outcome(0.9, runs=[(1.0, 1 - gain) for gain in gains])] * 2)
        assert found.runs_error == pytest.approx(0.05) and found.kept is kept and found.groups == count
    assert found.lowest == pytest.approx(0.1 - 1.7959 * 0.05, abs=1e-4)
    assert found.highest == pytest.approx(0.1 + 1.7959 * 0.05, abs=1e-4)


@pytest.mark.slow
def test_parts_of_runs_that_were_trained_on_decide_nothing() -> None:
    found = decide([outcome(0.9, runs=EVEN)] * 2, whole_runs=False)
    assert not found.kept
    trials = hybrids.trials(hybrids.lacking(), 2, 300)
    trained = train(hybrids.ship(), trials, settings=TrainSettings(seeds=1, step=1.0, epochs=1))
    assert trained.decision and not trained.decision.kept
    tasks = tasks_of(HYBRID_KIND, hybrids.ship(), hybrids.trials(hybrids.ship(), 3, 400), ON_SECONDS)
    assert judged_by_whole_runs(tasks)


def test_a_single_run_judges_by_blocks_of_its_windows() -> None:
    rng = np.random.default_rng(3)
    judged = np.column_stack([np.zeros((60, 2)), np.ones(60), 0.9 + 0.02 * rng.standard_normal(60)])
    one = replace(outcome(0.9), judged=judged)
    assert decide([one]).kept and decide([one]).groups == 60 // BLOCK
    short = replace(outcome(0.9), judged=judged[:BLOCK])
    assert not decide([short]).kept


def test_split_are_empty_where_the_data_are_too_few() -> None:
    split = split_pieces(pieces(1, 70), 0, ON_SECONDS, 30.0)
    assert isinstance(split, Split) and not (split.stop and split.judge)
