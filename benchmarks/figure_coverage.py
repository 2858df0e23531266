"""Do the 90 % intervals of manoeuvring figures hold the truth? Fits of synthetic trials, two ships, 50 seeds.

The ships are drawn from their priors. The trials are as bad as real ones (benchmarks/disturbed_trials.py: forces that
remember, gusty wind, late velocities, coloured noise), with another numerical scheme than that of the fit. They hold
two zigzags and two turnings, no stop: a crash stop lies outside. With "foreign" the truth is a plant that shares
nothing with the package (benchmarks/foreign_figures.py), and the start a ship made from its particulars. A row per fit
is appended to the file that is given, and fits that are in it are not made again.

Run from the repository root: python -m benchmarks.figure_coverage ROWS.jsonl [seeds] [foreign]
"""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.disturbed_trials import Disturbed, disturbed_trials, drawn_ship
from benchmarks.foreign_figures import HULLS, drawn_hull, foreign_trials, machinery_of, start_ship, true_figures
from benchmarks.record import record, table
from cases.criteria.assessment import imo_figures
from cases.shipfiles.ship_file import load_ship
from cases.simulation.sensors import SensorNoise
from cases.trial import Trial
from fitting.pipeline import FitOptions, calibrate
from fitting.prediction.figure_intervals import with_intervals
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.ship import Ship

RUNS = (("zigzag:20/20", 120.0), ("zigzag:-10/10", 110.0), ("turning:35", 140.0), ("turning:-20", 140.0))
SHIPS = {"esso_osaka_3m": 3.0, "kvlcc2_l7": 7.0}
FOREIGN = "foreign"
FIRST, DRAWS = 500, 200
"""First seed, and draws of each interval."""


def one(name: str, seed: int) -> dict[str, Any]:
    """Figures of the truth and intervals of a fit, by run and figure."""
    base, size = load_ship(name), SHIPS[name] / 3.0
    rate = math.sqrt(size)
    plain = Disturbed()
    how = replace(plain, X=plain.X * size**3, Y=plain.Y * size**3, N=plain.N * size**4, tau=plain.tau * rate,
                  noise=SensorNoise.for_length(SHIPS[name]),
                  defects=(f"velocity_filter:tau={0.7 * rate}",))  # fmt: skip
    runs = [(text, duration * rate) for text, duration in RUNS]
    for attempt in range(10):
        true = drawn_ship(base, seed + 1000 * attempt)
        try:
            trials = disturbed_trials(true, runs, seed, how, dt=0.1 * rate)
            speed = float(np.mean([np.median(trial["u"][:40]) for trial in trials]))  # that of the approaches
            truth = imo_figures(true, speed)
            if len(truth.runs) < 7:
                continue
            break
        except UserError:
            continue
    at = {(row.run, row.figure): row.value for row in truth.rows}
    return {"ship": name, **judged_fit(base, trials, rate, speed, at, seed)}


def foreign(seed: int) -> dict[str, Any]:
    """Figures of a foreign plant and intervals of a fit to its trials, by run and figure."""
    hull = drawn_hull(seed)
    rate, machinery = math.sqrt(hull.length / 3.0), machinery_of(hull, seed)
    at = true_figures(hull, machinery)
    trials = foreign_trials(hull, machinery, seed)
    made = judged_fit(start_ship(hull, machinery), trials, rate, hull.speed, at, seed)
    return {"ship": FOREIGN, "length": hull.length, **made}


def judged_fit(
    base: Ship, trials: list[Trial], rate: float, speed: float, at: dict[tuple[str, str], float | None], seed: int
) -> dict[str, Any]:
    """A fit of ``base`` on ``trials``, and the interval of each figure beside the truth ``at`` (run, figure).

    rate: of time of the ship by that of a 3 m model; speed: of the manoeuvres [m/s]; seed: of the draws.
    """
    began = time.perf_counter()
    settings = Settings()
    found = calibrate(base, trials, (), settings, FitOptions(next_trial=False))
    fitted = time.perf_counter() - began
    judged = with_intervals(imo_figures(found.ship, speed), found.ship, found.to_dict(), DRAWS, seed).assessment
    rows = [
        [r.run, r.figure, at.get((r.run, r.figure)), r.value, *(r.interval_90 or (None, None)), bool(r.extrapolated)]
        for r in judged.rows
    ]
    return {"seed": seed, "converged": bool(found.converged), "seconds": fitted, "rows": rows}


def summary(made: list[dict[str, Any]]) -> list[str]:
    """Lines of the table: coverage by figure, inside and outside of the trials."""
    cells: dict[tuple[str, str], dict[bool, list[bool]]] = {}
    width: dict[tuple[str, str], list[float]] = {}
    for fit in made:
        for run, figure, true, value, low, high, outside in fit["rows"]:
            if None in (true, value, low):
                continue
            kind = run.split(":")[0] + (":" + run.split(":")[1].lstrip("-") if ":" in run else "")
            for ship in (str(fit.get("length", fit["ship"])), "both"):
                cells.setdefault((f"{kind} {figure}", ship), {}).setdefault(outside, []).append(low <= true <= high)
            width.setdefault((f"{kind} {figure}", "both"), []).append((high - low) / max(abs(value), 1e-9))
    rows, ships = [], sorted({str(fit.get("length", fit["ship"])) for fit in made})
    for (words, ship), found in sorted(cells.items()):
        if ship == "both":
            inside, out = (found.get(key, []) for key in (False, True))
            by_ship = [
                np.mean([hit for hits in cells.get((words, name), {}).values() for hit in hits] or [math.nan])
                for name in ships
            ]
            rows.append([words, *(f"{np.mean(x):.2f} ({len(x)})" if x else "-" for x in (inside, out)),
                         *(f"{x:.2f}" for x in by_ship), f"{100 * np.median(width[words, ship]):.0f} %"])  # fmt: skip
    whole = {key: [hit for (_, ship), found in cells.items() if ship == "both" for hit in found.get(key, [])]
             for key in (False, True)}  # fmt: skip
    all_ = [f"{np.mean(x):.3f} ({len(x)})" if x else "-" for x in whole.values()]
    rows.append(["all", *all_, *([""] * len(ships)), ""])
    return table(["figure", "inside the trials", "outside", *ships, "width of the interval, median"], rows)


def main() -> None:
    path, count = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 50
    strange = FOREIGN in sys.argv[3:]
    made = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    known = {(fit["ship"], fit["seed"]) for fit in made}
    for k in range(count):
        name, seed = FOREIGN if strange else list(SHIPS)[k % 2], FIRST + k
        if (name, seed) in known:
            continue
        made.append(foreign(seed) if strange else one(name, seed))
        with path.open("a") as stream:
            stream.write(json.dumps(made[-1]) + "\n")
        print(name, seed, f"{made[-1]['seconds']:.0f} s", flush=True)
    who = f"foreign plants of {', '.join(f'{h.length:g} m' for h in HULLS)}" if strange else " and ".join(SHIPS)
    lines = [
        f"{len(made)} fits, seeds {FIRST} to {FIRST + count - 1}, {who} in turn; "
        f"{sum(fit['converged'] for fit in made)} converged; {DRAWS} draws each. Share of 90 % intervals of the ship's "
        "figure that hold that of the true ship (number of intervals).",
        "",
        *summary(made),
    ]
    title = "Intervals of manoeuvring figures" + (": foreign plants" if strange else "")
    record(title, f"python -m benchmarks.figure_coverage ROWS.jsonl {count}" + " foreign" * strange, lines)


if __name__ == "__main__":
    main()
