"""Trials on which no random force acts, of ships that lack nothing: what the first tests of a diagnosis say of them.

python -m benchmarks.quiet_trials [--ships 20] [--record]

Coefficients are drawn about the library ship's with 0.4 standard deviations of her prior. Her trials are simulated with
sensor noise and in steady wind, and read without a sidecar: their actuators are held from sample to sample, or are as
they are at each sample of a motion that was simulated in ten steps between. Seeds are the numbers of the ships.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.fleet import moved
from benchmarks.record import record, table
from cases.criteria.simulated_trial import simulated_trial
from cases.shipfiles.ship_file import load_ship
from cases.simulation.sensors import SensorNoise, add_noise
from cases.trial import Trial
from diagnosis.hypotheses.score_test import score_tests, slopes
from diagnosis.prepare import prepare
from mmg.motion.froude import time_scale
from mmg.ship import Ship

MANEUVERS = ("turning:35", "zigzag:20/20", "turning:-20", "zigzag:-20/10")
SAMPLES = (0.1, 0.2, 0.5)
"""Sampling times [s of a 3 m model]."""
FINER = 10
LEVEL = 0.05


def trials_of(ship: Ship, held: bool, sample: float, seed: int) -> list[Trial]:
    """Runs of ``ship`` every ``sample`` [s], of an even ``seed`` two, of an odd one four."""
    found = []
    for k, words in enumerate(MANEUVERS if seed % 2 else MANEUVERS[:2]):
        dt = sample if held else sample / FINER
        wind = f"1.5:{(40 * seed + 70 * k) % 360}" if "wind" in ship.components else None
        run = simulated_trial(ship, words, None, wind, False, 100 * seed + k, dt)
        every = 1 if held else FINER
        run = replace(run, columns={name: x[::every] for name, x in run.columns.items()}, name=f"run_{k}")
        found.append(add_noise(run, SensorNoise.for_length(ship.particulars["L"]), 100 * seed + k))
    return found


def judged(start: Ship, held: bool, sample: float, seeds: Sequence[int]) -> list[str]:
    """A row on ships drawn about ``start``."""
    values, wrong, least = [], 0, np.inf
    for seed in seeds:
        truth = moved(start, np.random.default_rng([77, seed]), 0.4)
        ready = prepare(start, trials_of(truth, held, sample * time_scale(start.particulars["L"]), seed))
        p = ready.problem
        tests = score_tests(slopes(p.steps, p.data, ready.null, ready.full.candidates), ready.full.candidates)
        values.append(tests[0].p_value)
        wrong += ready.reading.straight is held
        least = min(least, ready.reading.gain or 0.0)
    below = int((np.array(values) < LEVEL).sum())
    return [start.name, "held" if held else "sampled", f"{sample:g}", str(len(values)), f"{below}",
            f"{min(values):.2g}", f"{wrong}", f"{least:.1f}"]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ships", type=int, default=20)
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    rows = []
    for name in ("esso_osaka_3m", "kvlcc2_l7"):
        for held in (True, False):
            for sample in SAMPLES:
                rows.append(judged(load_ship(name), held, sample, range(given.ships)))
                print(rows[-1], flush=True)
    header = ["ship", "actuators are", "sample [s of a 3 m model]", "ships", f"with a candidate below {LEVEL:.0%}",
              "least chance", "read the other way", "least gain in log likelihood"]  # fmt: skip
    lines = table(header, rows)
    if given.record:
        record(
            "Quiet trials of ships that lack nothing", f"python -m benchmarks.quiet_trials --ships {given.ships}", lines
        )


if __name__ == "__main__":
    main()
