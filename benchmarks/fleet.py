"""A fleet of 20 ships with 10 runs each: time of ``mmg fleet`` with two processes, what is planted and found, sisters.

python -m benchmarks.fleet time [--ships 20] [--record]       fit, score, diagnosis and page on two processes
python -m benchmarks.fleet sisters [--record]                 what a shared prior brings to ships with few runs

Half of the ships are of the package's equations (the 3 m tanker with other coefficients), half of a generator that
shares nothing with it (``benchmarks.file_faults.plant``, by ``benchmarks.foreign_figures``). In the first half some
ships are fouled in their second campaign, and some have a gyro that shows too much in it. Seeds: numbers of the ships.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.file_faults.plant import Hull, Order, Plant, Weather, circle, run, zigzag
from benchmarks.foreign_figures import drawn_hull, start_ship
from cases.criteria.simulated_trial import simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.ship import Ship

MANEUVERS = ("turning:35", "zigzag:20/20", "turning:-20", "zigzag:-10/10", "zigzag:10/5")
CIRCLES = (("zigzag", 20.0, 20.0), ("turning", 35.0, 0.0), ("zigzag", -10.0, 10.0), ("turning", -20.0, 0.0),
           ("zigzag", 10.0, 5.0))  # fmt: skip
FOULED, GYRO = (1, 6), (3, 8)
"""Ships that are fouled by 25 % in their second campaign, and whose gyro shows 6 % too much in it."""
WIDTH = {"Y_v": 0.6, "N_r": 0.6, "N_v": 0.6, "X_0": 0.6, "t_P": 0.6, "w_P0": 0.6, "ell_R": 0.6, "gamma_R": 0.6}
"""Standard deviations of coefficients between sisters, in those of the start's prior; nothing else differs."""


def moved(ship: Ship, rng: np.random.Generator, widths: dict[str, float] | float, mean: Ship | None = None) -> Ship:
    """``ship`` with coefficients drawn about those of ``mean`` (default: her own). widths: in standard deviations of
    her prior, of all or by symbol."""
    rows, about = dict(ship.coefficients), (mean or ship).coefficients
    for symbol in ship.free:
        size = widths if isinstance(widths, float) else widths.get(symbol, 0.0)
        c, draw = rows[symbol], float(rng.normal())
        rows[symbol] = c.with_(value=float(np.clip(about[symbol].value + size * c.std * draw, c.lower, c.upper)))
    return replace(ship, coefficients=rows)


def own_runs(
    truth: Ship, folder: Path, effects: Sequence[str], seed: int, maneuvers: Sequence[str] = MANEUVERS
) -> None:
    """Noisy runs of ``maneuvers`` of the ship ``truth`` with ``effects``, written to ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    ship = with_effects(truth, effects)
    for k, words in enumerate(maneuvers):
        plan = parse_maneuver(words, ship, seed=seed, duration=150.0)
        trial = simulated_trial(ship, plan, None, f"1.5:{(40 * seed + 70 * k) % 360}", True, 100 * seed + k, 0.2)
        write_trial(trial, folder / f"{k}_{words.replace(':', '_').replace('/', '_')}.csv")


def foreign_runs(hull: Hull, folder: Path, seed: int) -> None:
    """Noisy runs of CIRCLES of the plant with this ``hull``, written to ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    unit = hull.length / hull.speed
    for k, (kind, rudder, heading) in enumerate(CIRCLES):
        rng = np.random.default_rng([63, seed, k])
        weather = Weather(0.4 * hull.speed, float(rng.uniform(-math.pi, math.pi)), 0.3)
        begin = 4 * unit
        order: Order = circle(rudder, 0.0, begin) if kind == "turning" else zigzag(rudder, 0.0, begin, heading)
        columns = run(Plant(hull, weather, rng), order, 30 * unit, 0.05 * unit, 0.0)
        count = len(columns["t"])
        sizes = {"x": 5e-4 * hull.length, "y": 5e-4 * hull.length, "psi": 2e-3, "u": 4e-3 * hull.speed,
                 "v": 4e-3 * hull.speed, "r": 2e-3 / unit}  # fmt: skip
        for name, size in sizes.items():
            columns[name] = columns[name] + size * rng.standard_normal(count)
        columns |= {"n": np.full(count, hull.revolutions), "wind_speed": np.full(count, weather.wind)}
        columns["wind_direction"] = np.full(count, weather.direction % (2 * math.pi))
        write_trial(Trial(f"{k}_{kind}", columns, kind=kind), folder / f"{k}_{kind}.csv")


def made_fleet(folder: Path, ships: int) -> Path:
    """A plan of so many ``ships``, half of each generator, with its trials in ``folder``."""
    start, lines = load_ship("esso_osaka_3m"), ["[fleet]", 'name = "benchmark"', ""]
    mean = moved(start, np.random.default_rng(7), 0.3)
    own = (ships + 1) // 2
    for number in range(ships):
        name, rng = f"ship_{number:02d}", np.random.default_rng([8, number])
        where = folder / name
        if number < own:
            truth = moved(start, rng, WIDTH, mean) if number < own // 2 else moved(start, rng, 0.3)
            later = ["fouling:share=0.25"] * (number in FOULED) + ["gyro:share=0.06"] * (number in GYRO)
            own_runs(truth, where / "first", (), 2 * number)
            own_runs(truth, where / "second", later, 2 * number + 1)
            line = 'ship = "esso_osaka_3m"'
        else:
            hull = drawn_hull(number)
            foreign_runs(hull, where / "first", 2 * number)
            foreign_runs(hull, where / "second", 2 * number + 1)
            (where / "start.toml").write_text(dump_ship(start_ship(hull)), encoding="utf-8")
            line = f'ship = "{name}/start.toml"'
        campaigns = "\n".join(f'{c} = ["{name}/{c}/[0-3]_*.csv"]' for c in ("first", "second"))
        held_out = f'held_out = ["{name}/*/4_*.csv"]'
        lines += [f"[ships.{name}]", line, held_out, f"[ships.{name}.campaigns]", campaigns, ""]
    names = ", ".join(f'"ship_{k:02d}"' for k in range(own // 2))
    lines += ["[sisters]", f"tankers = [{names}]"] if own // 2 > 1 else []
    plan = folder / "plan.toml"
    plan.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return plan


def measured(plan: Path, out: Path, workers: int) -> tuple[float, float, int]:
    """Seconds, processor seconds and exit code of ``mmg fleet``, its processes and compilers among them."""
    import resource

    shutil.rmtree(out, ignore_errors=True)
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    words = [sys.executable, "-m", "mmg_ident", "fleet", str(plan), "--out", str(out), "--workers", str(workers)]
    code = subprocess.run(words, check=False).returncode
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began, used, code


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("time", "sisters"))
    parser.add_argument("--ships", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "mmg_fleet")
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    timed(given.work, given.ships, given.workers, given.record)


def timed(work: Path, ships: int, workers: int, keep: bool) -> None:
    """Make the fleet in ``work`` and measure ``mmg fleet`` on it; keep: in RESULTS.md."""
    folder = work / f"fleet_{ships}"
    plan = folder / "plan.toml"
    if not plan.exists():
        plan = made_fleet(folder, ships)
    print(f"load before: {os.getloadavg()[0]:.1f}", flush=True)
    wall, used, code = measured(plan, work / f"out_{ships}", workers)
    print(wall, used, code, f"load after: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
