"""Work that is timed inside a process: each function prints what it measured as one line of JSON."""

from __future__ import annotations

import json
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.speed import best_of
from mmg.progress import Progress


def _said(**values: Any) -> None:
    print(json.dumps(values))


def scipy_ratio() -> None:
    """Times of scipy's least_squares, until the same objective within 1e-5, over that of the calibration's solver until
    it has converged; the note also says when that one was within 1e-5."""
    from benchmarks.optimisers import problems, scipy_time
    from fitting.solvers.leading import solve_led

    problem, one = problems()
    solve_led(problem, problem.start(), 1e-6, 300, None, None, "")  # code is compiled
    found = [_timed(lambda: solve_led(problem, problem.start(), 1e-6, 300, None, None, "")) for _ in range(5)]
    seconds, ours = sorted(found, key=lambda pair: pair[0])[2]
    goal, began, near = ours.objective * (1 + 1e-5), time.perf_counter(), [seconds]

    def at_iterate(at: Progress) -> None:
        if at.values["objective"] <= goal and at.values["violation"] < 1e-4:
            near.append(time.perf_counter() - began)

    solve_led(problem, problem.start(), 1e-6, 300, None, at_iterate, "")
    took, value = scipy_time(one, goal, limit=300 * seconds)
    reached = "reached" if value <= goal else "not reached"
    words = f"{took:.1f} s ({reached}) over {seconds:.2f} s, objective {ours.objective:.6f}"
    _said(value=took / seconds, note=f"{words}; within 1e-5 after {min(near):.2f} s")


def _timed(work: Any) -> tuple[float, Any]:
    began = time.perf_counter()
    value = work()
    return time.perf_counter() - began, value


def bootstrap_refits(count: str) -> None:
    """Seconds of ``count`` refits of Train-TZRB to runs drawn with replacement, on two processes."""
    from cases.io.read import read_trials
    from cases.published_splits import TRAIN_TZRB, find
    from cases.shipfiles.ship_file import load_ship
    from fitting.calibration import estimate_coefficients
    from fitting.uncertainty.bootstrap import bootstrap

    found = estimate_coefficients(load_ship("esso_osaka_3m"), read_trials(find(TRAIN_TZRB)))
    seconds, made = _timed(lambda: bootstrap(found.information, int(count), 0, found.problem, found.solution.x, 2))
    _said(value=seconds, note=f"{len(made.failures)} failed")


def blind_cases(folder: str) -> None:
    """Median seconds of one case of the blind benchmark in ``folder``.

    The first case is solved once before it counts, for what a process prepares once.
    """
    from benchmarks.blind.solve import answered, cases_of

    cases = cases_of(Path(folder))
    answered(cases[0])
    clock, processor = [], []
    for case in cases:
        began = time.process_time()
        clock.append(_timed(lambda case=case: answered(case))[0])
        processor.append(time.process_time() - began)
    _said(
        value=statistics.median(clock), runs=len(cases), processor=statistics.median(processor),
        note=f"{min(clock):.1f} to {max(clock):.1f} s",
    )  # fmt: skip


def right_hand_side(points: str) -> None:
    """Nanoseconds of one right-hand side of ESSO OSAKA among ``points`` in one call, one thread."""
    from cases.shipfiles.ship_file import load_ship
    from mmg.rollout import Simulator

    count, rng = int(points), np.random.default_rng(0)
    state = rng.normal(size=(6, count)) * np.array([[1], [1], [1], [0.3], [0.1], [0.05]])
    controls = np.vstack([rng.uniform(-15, 15, count), rng.normal(size=count) * 0.3, rng.normal(size=(2, count))])
    simulator = Simulator(load_ship("esso_osaka_3m"))
    simulator.rates(state, controls)
    seconds = best_of(200, lambda: simulator.rates(state, controls))
    _said(value=1e9 * seconds / count, runs=200, note=simulator.interpreted_because or "best of 200")


def scattered_turnings(count: str) -> None:
    """Seconds of ``count`` turnings of KVLCC2 with coefficients scattered by 5 %, on two threads."""
    from benchmarks.turning import SHIP, SPREAD, STEP, maneuver
    from cases.shipfiles.ship_file import load_ship
    from cases.simulation.simulate_batch import simulate_batch
    from mmg.rollout import Simulator

    ship = load_ship(SHIP)
    simulator, plan, rng = Simulator(ship), maneuver(ship), np.random.default_rng(0)
    theta = ship.values[:, None] * (1 + SPREAD * rng.standard_normal((len(ship.values), int(count))))
    seconds = best_of(7, lambda: simulate_batch(simulator, plan, theta, STEP, threads=2))
    _said(value=seconds, runs=7, note="best of 7")
