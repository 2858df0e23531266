"""Do intervals hold as much of the truth as they say? Coefficients, bands, manoeuvring figures, a diagnosis' budget.

python -m benchmarks.coverage PART ... [--seeds N] [--workers N] [--record], PART being one or more of

* intervals: 95 % intervals of the coefficients of ships drawn from the prior, on trials as bad as real ones
  (tests/support/disturbed_trials.py): those that ``mmg fit`` reports, those of the model alone;
* figures: 90 % intervals of the figures of a 3 m and a 7 m ship in turn, fitted to two zigzags and two turnings; a
  crash stop lies outside of them;
* bands: 90 % prediction bands of manoeuvres of another kind: turnings predicted from zigzags and random runs (records),
  and circles from zigzags alone (``benchmarks/file_faults/plant.py``, whose equations are not the package's);
* budget: 90 % intervals of the unexplained share of a diagnosis, in cases of ``benchmarks/blind`` whose complete model
  is known: that of the same trials with nothing hidden.

Those of records left out are in benchmarks/accuracy.py. Each calibration is what ``mmg fit`` does by default.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np

from benchmarks.accuracy import SHIP, inside_bands, mean_bands, trials_of
from benchmarks.blind.cases import folders, question
from benchmarks.blind.generator.world import WORLDS
from benchmarks.blind.generator.write import generate
from benchmarks.file_faults.plant import Hull, Plant, Weather, circle, run, zigzag
from benchmarks.record import Figure, done, parser_of, report
from cases.criteria.imo import imo_figures
from cases.io import published_splits as splits
from cases.shipfiles.effects import freeing_effects, with_effects
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import TRAIN
from cases.simulation.simulate import SensorNoise
from cases.trial import Trial
from fitting.calibrate import FitOptions
from fitting.calibration import estimate_coefficients
from fitting.prediction.figure_intervals import with_intervals
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.ship import Ship
from mmg_ident.api import calibrate
from tests.support.disturbed_trials import DEFECTS, Disturbed, disturbed_trials, drawn_ship

FIRST = 100
"""First seed of the intervals."""
EFFECTS = ("velocity_filter", "gyro", "antenna_offset")
DRAWS = 200
"""Of the interval of a figure."""
RUNS = (("zigzag:20/20", 120.0), ("zigzag:-10/10", 110.0), ("turning:35", 140.0), ("turning:-20", 140.0))
"""Manoeuvres and durations [s] of a 3 m ship whose figures are judged."""
BUDGET_WORLDS, BUDGET_KINDS, COUNT = ("pond", "sea", "kvlcc2"), ("library", "pair", "strangers"), 4
"""Worlds and kinds of the cases whose budget is judged, and cases of each by seed."""
R, T = TypeVar("R"), TypeVar("T")


def spread(work: Callable[[T], R], seeds: Iterable[T], workers: int) -> list[R]:
    """What ``work`` makes of each of ``seeds``, on so many processes, in any order."""
    return [made for _, made in done(work, [(seed, (seed,)) for seed in seeds], workers)]


# Intervals of coefficients


def disturbed_errors(seed: int) -> np.ndarray:
    """Errors of the coefficients of a drawn ship, fitted to disturbed trials, by their standard errors: those of the
    model alone, and those that are reported (2, P). Of another one where the ship cannot hold her course."""
    base = load_ship(SHIP)
    for attempt in range(10):
        try:
            true = drawn_ship(base, seed + 1000 * attempt)
            trials = disturbed_trials(true, TRAIN, seed, Disturbed())
            break
        except UserError:
            continue
    start = freeing_effects(base, EFFECTS)
    truth = {**start.coefficients, **with_effects(true, DEFECTS).coefficients}
    found = estimate_coefficients(start, trials, Settings(step=1.0, window=50.0))
    prior = found.prior
    p = (np.array([truth[s].value for s in prior.symbols]) - prior.mean) / prior.std
    several = (found.spread.model, found.covariance)
    return np.array([(found.p - p) / np.sqrt(np.diag(covariance)) for covariance in several])


def intervals(given: argparse.Namespace) -> dict[str, Figure]:
    """Coverage of the reported intervals; prints that of those of the model alone."""
    found = spread(disturbed_errors, range(FIRST, FIRST + given.seeds), given.workers)
    model, reported = np.moveaxis(np.abs(found) < 1.96, 1, 0).mean(axis=2)
    print(f"intervals of the model alone, disturbed trials: {model.mean():.1%}")
    error = float(reported.std(ddof=1) / math.sqrt(len(found)))
    what = "true coefficients inside reported 95 % intervals, disturbed trials"
    return {"coverage_disturbed": Figure(what, float(reported.mean()), "%", error, note=f"{len(found)} seeds")}


# Manoeuvring figures


def figure_hits(seed: int) -> tuple[list[bool], list[bool]]:
    """Whether each interval of a figure holds that of the true ship: where the trials went, and outside of that."""
    name, length = ((SHIP, 3.0), ("kvlcc2_l7", 7.0))[seed % 2]
    base, size, rate = load_ship(name), length / 3.0, math.sqrt(length / 3.0)
    plain = Disturbed()
    how = replace(plain, X=plain.X * size**3, Y=plain.Y * size**3, N=plain.N * size**4, tau=plain.tau * rate,
                  noise=SensorNoise.for_length(length), defects=(f"velocity_filter:tau={0.7 * rate}",))  # fmt: skip
    for attempt in range(10):
        true = drawn_ship(base, seed + 1000 * attempt)
        try:
            trials = disturbed_trials(true, [(r, t * rate) for r, t in RUNS], seed, how, dt=0.1 * rate)
            speed = float(np.mean([np.median(trial["u"][:40]) for trial in trials]))  # that of the approaches
            truth = imo_figures(true, speed)
        except UserError:
            continue
        if len(truth.runs) == 7:
            break
    known = {(row.run, row.figure): row.value for row in truth.rows}
    found = calibrate(base, trials, (), None, FitOptions(next_trial=False))
    judged = with_intervals(imo_figures(found.ship, speed), found.ship, found.to_dict(), DRAWS, seed)
    hits: tuple[list[bool], list[bool]] = [], []
    for row in judged.rows:
        value = known.get((row.run, row.figure))
        if value is not None and row.interval_90 is not None:
            hits[bool(row.extrapolated)].append(row.interval_90[0] <= value <= row.interval_90[1])
    return hits


def figures(given: argparse.Namespace) -> dict[str, Figure]:
    """Coverage of manoeuvring figures, inside and outside of the motions of the trials."""
    found = spread(figure_hits, range(500, 500 + given.seeds), given.workers)
    made = {}
    for outside, (name, words) in enumerate((("coverage_figures", "inside"), ("coverage_figures_outside", "outside"))):
        hits = [hit for each in found for hit in each[outside]]
        what = f"true manoeuvring figures inside their 90 % interval, {words} of the motions of the trials"
        made[name] = Figure(what, float(np.mean(hits)), "%", note=f"{len(hits)} intervals of {len(found)} fits")
    return made


# Prediction bands


def plant_trials(seed: int) -> tuple[Ship, list[Trial], list[Trial]]:
    """A start ship, zigzags and circles of a plant that is not the package's."""
    rng, hull = np.random.default_rng(seed), Hull(7.0, 1.27, 0.46, 0.81, 1.2, 10.0, 0.2)
    sets: list[list[Trial]] = []
    for orders in ([(zigzag, a) for a in (10, -10, 20, -20, 15)], [(circle, 35), (circle, -35)]):
        made = []
        for number, (order, angle) in enumerate(orders):
            heading = float(rng.uniform(-math.pi, math.pi))
            weather = Weather(1.0, float(rng.uniform(-math.pi, math.pi)), 0.3)
            true = run(Plant(hull, weather, rng), order(angle, heading, 15.0), 180.0, 0.2, heading)
            noise = {"x": 0.02, "y": 0.02, "psi": 1.7e-3, "u": 0.005, "v": 0.005, "r": 0.9e-3}
            true |= {name: true[name] + sd * rng.standard_normal(len(true["t"])) for name, sd in noise.items()}
            true["n"] = np.full(len(true["t"]), hull.revolutions)
            made.append(Trial(f"{order.__name__}_{number}", true, kind="zigzag" if order is zigzag else "turning"))
        sets.append(made)
    return new_ship("plant", {"L": 7.0, "B": 1.27, "d": 0.46, "C_b": 0.81, "U_0": 1.2}), sets[0], sets[1]


def manoeuvres() -> dict[str, Figure]:
    """Manoeuvres of a kind that the calibration did not have."""
    options = FitOptions(next_trial=False)
    trials = trials_of([n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT])
    found = calibrate(SHIP, [t for t in trials if t.kind in ("zigzag", "random")], (), None, options)
    records = inside_bands(found, [t for t in trials if t.kind == "turning"])
    plants = {"30": np.zeros(2), "100": np.zeros(2)}
    for seed in (41, 42, 43):
        ship, zigzags, circles = plant_trials(seed)
        for length, rows in inside_bands(calibrate(ship, zigzags, (), None, options), circles).items():
            plants[length] += rows
    made = mean_bands("turnings from zigzags and random runs", "turnings", records)
    return made | mean_bands("circles of a plant from zigzags", "plant", plants)


# Budget of a diagnosis


def rest_inside(task: tuple[str, str, int]) -> list[bool]:
    """Whether the true unexplained share lies in its interval, for COUNT cases of a world, kind and seed that have one.

    The true floor is the error in the tests of the twins, without what is hidden, by the fit to their training trials.
    """
    world, kind, seed = task
    inside = []
    with TemporaryDirectory() as scratch:
        hidden, twins = (Path(scratch) / name for name in ("hidden", "twins"))
        for folder in (hidden, twins):
            generate(folder, COUNT, seed, kind, WORLDS[world], twins=folder == twins)
        for case in folders(hidden):
            budget, complete = (question(folder / case.name)().budget for folder in (hidden, twins))
            if budget is None or complete is None or budget.unexplained is None:
                continue
            floor = min(complete.before, budget.after)
            if budget.before > floor:
                rest, (low, high) = (budget.after - floor) / (budget.before - floor), budget.unexplained.interval_90
                inside.append(low - 1e-6 <= rest <= high + 1e-6)
    return inside


def budget(given: argparse.Namespace) -> dict[str, Figure]:
    """Intervals of the unexplained shares."""
    tasks = [(w, k, s) for s in range(FIRST, FIRST + given.seeds) for w in BUDGET_WORLDS for k in BUDGET_KINDS]
    hits = [hit for found in spread(rest_inside, tasks, given.workers) for hit in found]
    words = "true unexplained shares of a diagnosis inside their 90 % interval"
    return {"coverage_budget": Figure(words, sum(hits), of=len(hits))}


def main() -> None:
    """Measures the parts that are named."""
    parts: dict[str, Callable[[argparse.Namespace], dict[str, Figure]]] = {
        "intervals": intervals,
        "figures": figures,
        "bands": lambda given: manoeuvres(),
        "budget": budget,
    }
    parser = parser_of("coverage", __doc__)
    parser.add_argument("parts", nargs="+", choices=tuple(parts))
    parser.add_argument("--seeds", type=int, default=20, help="synthetic ships")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    for part in given.parts:
        options = f" --seeds {given.seeds}" if part != "bands" else ""
        report(parts[part](given), f"coverage {part}{options}", given.record)


if __name__ == "__main__":
    main()
