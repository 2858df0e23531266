"""Does a planned trial teach as much as the best two manoeuvres of the library together? Checked by refits.

Ships whose coefficients are 5 to 10 % off the starting ship's are calibrated on two zigzags with sensor noise. A trial
is planned; it, and the best two manoeuvres of the library, each of the same length, are simulated with the true ship
and sensor noise, and the ship is fitted again with them. A row per ship and seed is appended to the file that is
given, and what is in it is not made again.

Run from the repository root: python -m benchmarks.plan ROWS.jsonl [seeds]
"""

from __future__ import annotations

import json
import math
import resource
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.record import record, table
from cases.io.controls import read_controls
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate, simulate_controls
from cases.trial import Trial
from fitting.design.wanted import coefficients_wanted
from fitting.pipeline import FitOptions, calibrate
from fitting.report.planned_trial import Wish, plan_trial
from fitting.result import FitResult, read_fit
from fitting.settings import Settings
from mmg.motion.froude import time_scale
from mmg.ship import Ship

SHIPS = ("esso_osaka_3m", "kvlcc2_l7")
FIRST = (("zigzag:20/20", 90.0), ("zigzag:-10/10", 90.0))
SECONDS, LENGTH, WIDTH = 180.0, 60.0, 25.0
"""Of a 3 m model."""
SEED = 900


def true_ship(ship: Ship, seed: int) -> Ship:
    """The ship with every free coefficient 5 to 10 % larger or smaller, within its bounds. seed: of the draw."""
    rng = np.random.default_rng([19, seed])
    values = {}
    for symbol in ship.free:
        c = ship.coefficients[symbol]
        off = rng.uniform(0.05, 0.10) * rng.choice([-1, 1])
        values[symbol] = float(np.clip(c.value * (1 + off), c.lower, c.upper))
    return replace(ship.with_values(values), name="true")


def refit(base: Ship, true: Ship, trials: Sequence[Trial], settings: Settings) -> dict[str, float]:
    """Mean log variance of the hull's coefficients fitted on trials, and their error to the truth in prior std."""
    found = calibrate(base, list(trials), (), settings, FitOptions(next_trial=False, instruments=()))
    rows = found.coefficients
    hull = coefficients_wanted(base, tuple(found.correlation.symbols), ("hull",))
    std = np.array([rows[s].std for s in hull], dtype=float)
    errors = [(found.ship.coefficients[s].value - true.coefficients[s].value) / float(rows[s].prior_std) for s in hull]
    return {
        "log_variance": float(2 * np.log(std).mean()),
        "error": float(np.sqrt(np.mean(np.square(errors)))),
        "converged": bool(found.converged),
    }


def calibrated(base: Ship, trials: Sequence[Trial], settings: Settings, folder: Path) -> FitResult:
    """The first calibration, written to a folder and read again as ``mmg plan`` does."""
    calibrate(base, list(trials), (), settings, FitOptions(instruments=())).save(folder)
    return read_fit(folder)


def one(name: str, seed: int) -> dict[str, Any]:
    """Refits of a ship's calibration with the planned trial and with the best two of the library. seed: of all."""
    base = load_ship(name)
    k, size = time_scale(base.particulars["L"]), base.particulars["L"] / 3.0
    true, noise = true_ship(base, seed), SensorNoise.for_length(base.particulars["L"])
    settings = Settings(window=50.0 * k)  # a coarser step than the default adds errors of its own to the noise

    def run(text: str, seconds: float, number: int, speed: float | None = None, n: float | None = None) -> Trial:
        trial = simulate(true, parse_maneuver(text, true, n=n, speed=speed, duration=seconds), 0.2 * k)
        return add_noise(trial, noise, 100 * seed + number)

    first = [run(text, seconds * k, i) for i, (text, seconds) in enumerate(FIRST)]
    with TemporaryDirectory() as scratch:
        result = calibrated(base, first, settings, Path(scratch) / "run")
        began = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        wish = Wish(f"{LENGTH * size:g}x{WIDTH * size:g}", SECONDS * k, seed=seed)
        planned = plan_trial(result.ship, result.to_dict(), wish)
        spent = resource.getrusage(resource.RUSAGE_SELF).ru_utime - began
        planned.write(Path(scratch) / "next.csv")
        designed = simulate_controls(true, read_controls(Path(scratch) / "next.csv"))
    content = planned.to_dict()
    row: dict[str, Any] = {"ship": name, "seed": seed, "cpu_s": spent, "planned": content["mean_log_variance"]}
    row["refit"] = {
        "first": refit(base, true, first, settings),
        "designed": refit(base, true, [*first, add_noise(designed, noise, 100 * seed + 10)], settings),
    }
    for key, pair in content["best_two_of_the_library"].items():
        chosen = [r.option for name_ in pair["names"] for r in planned.found.rows if r.option.name == name_]
        more = [run(o.maneuver, SECONDS * k, 20 + i, o.speed, o.n) for i, o in enumerate(chosen)]
        row[key] = pair
        row["refit"][key] = refit(base, true, [*first, *more], settings)
    return row


def main() -> None:
    """Make the rows that are missing and record the table."""
    path, seeds = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 2
    made = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    for seed in range(SEED, SEED + seeds):
        for name in SHIPS:
            if any(r["ship"] == name and r["seed"] == seed for r in made):
                continue
            made.append(one(name, seed))
            print(json.dumps(made[-1]), flush=True)
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(made[-1]) + "\n")
    head = [
        "ship",
        "seed",
        "fitted on the zigzags and",
        "log variance",
        "by the plan",
        "error [prior std]",
        "search CPU [s]",
    ]
    rows = []
    for r in made:
        for key, fit in r["refit"].items():
            expected = {"first": 0.0, "designed": r["planned"]}.get(
                key, r.get(key, {}).get("mean_log_variance", math.nan)
            )
            gain = fit["log_variance"] - r["refit"]["first"]["log_variance"]
            words = {"first": "nothing", "designed": "the planned trial"}.get(
                key, " + ".join(r.get(key, {}).get("names", []))
            )
            error = f"{fit['error']:.3f}" + ("" if fit["converged"] else " (not converged)")
            numbers = [f"{gain:+.3f}", f"{expected:+.3f}", error, f"{r['cpu_s']:.0f}"]
            rows.append([r["ship"], str(r["seed"]), f"{words} ({key})", *numbers])
    lines = ["Mean log variance of the hull's coefficients (robust covariance) less that of the zigzags alone.", ""]
    record(
        "A planned trial against two of the library",
        f"python -m benchmarks.plan ROWS.jsonl {seeds}",
        lines + table(head, rows),
    )


if __name__ == "__main__":
    main()
