"""A fleet of 20 ships with 10 runs each: time of ``mmg fleet`` with two processes, what is planted and found, sisters.

python -m benchmarks.fleet time [--ships 20] [--record]       fit, score, diagnosis and page on two processes
python -m benchmarks.fleet sisters [--record]                 what a shared prior brings to ships with few runs

Half of the ships are of the package's equations (the 3 m tanker with other coefficients), half of a generator that
shares nothing with it (``benchmarks.foreign_figures``, with propellers whose diameter and pitch are known). In the
first half some ships are fouled in their second campaign, and some have a gyro that shows too much in it. Seeds:
numbers of the ships.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.file_faults.plant import Hull, Order, Weather, circle, run, zigzag
from benchmarks.foreign_figures import DrivenPlant, Machinery, drawn_hull, machinery_of, start_ship
from benchmarks.record import record, table
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
WIDTH = {"Y_v": 0.6, "N_r": 0.6, "N_v": 0.6, "t_P": 0.6, "w_P0": 0.6, "ell_R": 0.6}
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


def foreign_runs(hull: Hull, machinery: Machinery, folder: Path, seed: int) -> None:
    """Noisy runs of CIRCLES of the plant with this ``hull`` and ``machinery``, written to ``folder``: its rudder is
    logged as it is at each sample."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trials.toml").write_text('[default]\ninputs = "sampled"\n', encoding="utf-8")
    unit = hull.length / hull.speed
    for k, (kind, rudder, heading) in enumerate(CIRCLES):
        rng = np.random.default_rng([63, seed, k])
        weather = Weather(0.4 * hull.speed, float(rng.uniform(-math.pi, math.pi)), 0.3)
        begin = 4 * unit
        order: Order = circle(rudder, 0.0, begin) if kind == "turning" else zigzag(rudder, 0.0, begin, heading)
        plant = DrivenPlant(hull, weather, rng, machinery)
        columns = run(plant, order, 30 * unit, 0.05 * unit, 0.0)
        count = len(columns["t"])
        sizes = {"x": 5e-4 * hull.length, "y": 5e-4 * hull.length, "psi": 2e-3, "u": 4e-3 * hull.speed,
                 "v": 4e-3 * hull.speed, "r": 2e-3 / unit}  # fmt: skip
        for name, size in sizes.items():
            columns[name] = columns[name] + size * rng.standard_normal(count)
        columns |= {"n": np.full(count, plant.n), "wind_speed": np.full(count, weather.wind)}
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
            hull, machinery = drawn_hull(number), machinery_of(drawn_hull(number), number)
            foreign_runs(hull, machinery, where / "first", 2 * number)
            foreign_runs(hull, machinery, where / "second", 2 * number + 1)
            (where / "start.toml").write_text(dump_ship(start_ship(hull, machinery)), encoding="utf-8")
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


def made_sisters(folder: Path, generator: str, widths: dict[str, float], seed: int) -> tuple[Path, list[Ship]]:
    """A plan of six sisters of a ``generator``, "own" or "foreign", and the true ships of the first; the first three
    have two runs each, the others five. widths: of "own"; foreign hulls differ by 2 % in beam, draught and block."""
    start, lines, truths = load_ship("esso_osaka_3m"), ["[fleet]", "diagnose = false", ""], []
    mean, hull = moved(start, np.random.default_rng([9, seed]), 0.3), drawn_hull(30 + seed)
    folder.mkdir(parents=True, exist_ok=True)
    machinery = machinery_of(hull, seed)
    began = start if generator == "own" else start_ship(hull, machinery)
    (folder / "start.toml").write_text(dump_ship(began), encoding="utf-8")
    for number in range(6):
        name, where = f"sister_{number}", folder / f"sister_{number}"
        rng = np.random.default_rng([10, seed, number])
        if generator == "own":
            truths.append(moved(start, rng, widths, mean))
            own_runs(truths[-1], where, (), 100 * seed + number)
        else:
            by = np.exp(rng.normal(0.0, 0.02, 3))
            own = replace(hull, beam=hull.beam * by[0], draught=hull.draught * by[1], block=hull.block * by[2])
            foreign_runs(own, machinery, where, 100 * seed + number)
        runs = "[0-1]" if number < 3 else "[0-3]"
        files = f'trials = ["{name}/{runs}_*.csv"]', f'held_out = ["{name}/4_*.csv"]'
        lines += [f"[ships.{name}]", 'ship = "start.toml"', *files, ""]
    lines += ["[sisters]", "class = [" + ", ".join(f'"sister_{k}"' for k in range(6)) + "]"]
    plan = folder / "plan.toml"
    plan.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return plan, truths


def shared(work: Path, keep: bool) -> None:
    """What a shared prior brings, by generator and width; keep: in RESULTS.md."""
    from mmg_ident.fleet.plan import read_plan
    from mmg_ident.fleet.run import run_fleet

    cases: tuple[tuple[str, dict[str, float], str], ...] = (
        ("own", WIDTH, "0.6 in 6 of 61"),
        ("own", {}, "0"),
        ("foreign", {}, "not known"),
    )
    rows = []
    for number, (generator, widths, words) in enumerate(cases):
        folder = work / f"sisters_{number}"
        shutil.rmtree(folder, ignore_errors=True)
        plan, truths = made_sisters(folder, generator, widths, number)
        found = run_fleet(read_plan(plan), folder / "out")
        w = found.groups[0].widths
        told = [k for k, s in enumerate(w.symbols) if s in WIDTH]
        size = np.sqrt((w.width[told] ** 2).mean()) if truths else np.nan
        rest = np.median(np.delete(w.width, told))
        alone, together = (errors(found.rows[:3], truths, key, w.unit) for key in ("alone", "value"))
        scores = [[r["scores"]["held_out"]["alone"], r["scores"]["held_out"]["window"]["after"]] for r in found.rows]
        few, many = np.mean(scores[:3], axis=0), np.mean(scores[3:], axis=0)
        rows.append([
            generator, words, f"{w.common:.2f} ({w.common_90[0]:.2f} to {w.common_90[1]:.2f})",
            f"{size:.2f}" if truths and widths else "", f"{rest:.3f}",
            f"{alone:.3f} -> {together:.3f}" if truths else "",
            f"{few[0]:.3f} -> {few[1]:.3f}", f"{many[0]:.3f} -> {many[1]:.3f}",
        ])  # fmt: skip
        print(rows[-1], flush=True)
    header = ["generator", "true width", "one width for all (90 %)", "width of those that differ, rms",
              "median of the others", "rms error of coefficients, 2 runs", "held-out error, 2 runs",
              "held-out error, 4 runs"]  # fmt: skip
    lines = [
        "Six sisters with a run held out each; three have two runs, three have four. Widths and errors of coefficients "
        "are in standard deviations of the start's prior; held-out errors are of 30 s windows. alone -> with sisters.",
        "", *table(header, rows),
    ]  # fmt: skip
    if keep:
        record("Sister ships", "python -m benchmarks.fleet sisters", lines)


def errors(rows: Sequence[Mapping[str, Any]], truths: Sequence[Ship], key: str, unit: np.ndarray) -> float:
    """Root mean square error of the coefficients of ``rows``, "alone" or "value" by ``key``, against the ``truths``, in
    units of the prior (``unit``, in the order of the coefficients)."""
    found = []
    for row, truth in zip(rows, truths, strict=False):
        symbols = [s for s, c in row["coefficients"].items() if key in c and "sister_mean" in c]
        found += [
            (row["coefficients"][s][key] - truth.coefficients[s].value) / u for s, u in zip(symbols, unit, strict=True)
        ]
    return float(np.sqrt(np.mean(np.square(found)))) if found else math.nan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("time", "sisters"))
    parser.add_argument("--ships", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "mmg_fleet")
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    if given.what == "sisters":
        shared(given.work, given.record)
    else:
        timed(given.work, given.ships, given.workers, given.record)


def timed(work: Path, ships: int, workers: int, keep: bool) -> None:
    """Make the fleet in ``work`` and measure ``mmg fleet`` on it; keep: in RESULTS.md."""
    folder, out = work / f"fleet_{ships}", work / f"out_{ships}"
    plan = folder / "plan.toml"
    if not plan.exists():
        plan = made_fleet(folder, ships)
    before = os.getloadavg()[0]
    wall, used, code = measured(plan, out, workers)
    content = json.loads((out / "fleet.json").read_text(encoding="utf-8"))
    rows = {row["name"]: row for row in content["ships"]}
    own = [f"ship_{k:02d}" for k in range((ships + 1) // 2)]
    drifted = [name for name, row in rows.items() if any(d["name"] == "fouling" for d in row["drifted"])]
    gyro = [name for name, row in rows.items() if any("gyro" in words for words in row["instruments"])]
    planted = [[f"ship_{k:02d}" for k in some if k < len(own)] for some in (FOULED, GYRO)]
    lines = [
        f"{ships} ships with 10 runs each (8 fitted, 2 held out), half of them of a foreign generator; {workers} "
        f"processes; load of the machine by other work before it began: {before:.1f}.", "",
        *table(["seconds", "processor seconds", "processor seconds / workers", "exit code", "failed"],
               [[f"{wall:.0f}", f"{used:.0f}", f"{used / workers:.0f}", str(code), str(len(content["failed"]))]]), "",
        *table(["planted", "in", "named in"], [
            ["fouling by 25 % in the second campaign", ", ".join(planted[0]), ", ".join(drifted)],
            ["gyro that shows 6 % too much in the second campaign", ", ".join(planted[1]), ", ".join(gyro)],
        ]),
    ]  # fmt: skip
    if keep:
        record("Fleets", "python -m benchmarks.fleet time", lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
