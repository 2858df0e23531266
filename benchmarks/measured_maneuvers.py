"""What is found in records whose orders are known: zigzags of nine steps and turning circles of eight foreign ships and
of three of the library, at 1 to 10 Hz, with noise, slow rudders, rudder zeros that are off and headings that wrap.

Run from the repository root: python -m benchmarks.measured_maneuvers [SEED]
The foreign ships are another model with another integrator (benchmarks/file_faults/plant.py). With the FRT-DS-ESSO
records (MMG_DATA) also what is found in these, read without the kind that their names tell.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.file_faults.fleet import SETS
from benchmarks.file_faults.plant import Plant, Weather, circle, program, run, zigzag
from benchmarks.record import record, table
from cases.criteria.measured_maneuvers import find_maneuvers
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.errors import UserError
from mmg.motion.froude import time_scale

SEED = 4100
"""Of the printed figures; the limits were set on seeds from 4000 to 4009."""

ZIGZAGS = ((5, 1), (5, 5), (10, 5), (10, 10), (15, 15), (20, 10), (20, 20), (35, 35))
OTHER = ((12, 8), (7, 3), (25, 15))
"""Steps that nobody orders as a rule: whole degrees are read."""

TURNS = (20, 35)
OWN = ("esso_osaka_3m", "kvlcc2_l7", "kvlcc2_full")


@dataclass(frozen=True)
class Case:
    """A record of a ship of ``length`` [m], and what was ordered in it, as ``Execute.title`` says it."""

    ship: str
    trial: Trial
    length: float
    ordered: str


def title(kind: str, side: int, steps: tuple[int, int]) -> str:
    """What was ordered, as it is called."""
    sign = "-" if side < 0 else ""
    return f"zigzag {sign}{steps[0]}/{steps[1]}" if kind == "zigzag" else f"turning {sign}{steps[0]}"


def orders() -> list[tuple[str, int, tuple[int, int]]]:
    """(kind, side, steps) of all records of a ship."""
    zigzags = [("zigzag", side, steps) for steps, side in product((*ZIGZAGS, *OTHER), (1, -1))]
    return [*zigzags, *(("turning", side, (angle, 0)) for angle, side in product(TURNS, (1, -1)))]


def foreign(name: str, kind: str, side: int, steps: tuple[int, int], rng: np.random.Generator) -> Case:
    """A record of the foreign ship ``name``."""
    some = SETS[name]
    hull, unit = some.hull, some.hull.length / some.hull.speed
    heading, towards = rng.uniform(-math.pi, math.pi, 2)
    drift = some.current * float(rng.uniform(0, 1))
    weather = Weather(0.3 * some.wind, float(rng.uniform(-math.pi, math.pi)), 0.2,
                      (drift * math.cos(towards), drift * math.sin(towards)))  # fmt: skip
    plant, begin = Plant(hull, weather, rng), float(rng.uniform(0.5, 5.0)) * unit
    rudder = side * steps[0]
    order = zigzag(rudder, heading, begin, steps[1]) if kind == "zigzag" else circle(rudder, heading, begin)
    dt = float(rng.choice([0.1, 0.2, 0.5, 1.0])) if hull.length > 20 else float(rng.choice([0.1, 0.2, 0.5]))
    out = run(plant, order, begin + 30 * unit, dt, heading)
    return Case(name, logged(out | {"n": np.full(len(out["t"]), hull.revolutions)}, hull.length, rng), hull.length,
                title(kind, side, steps))  # fmt: skip


def own(name: str, kind: str, side: int, steps: tuple[int, int], rng: np.random.Generator) -> Case:
    """A record of the ship ``name`` of the library."""
    ship = load_ship(name)
    L = ship.particulars["L"]
    text = f"zigzag:{side * steps[0]}/{steps[1]}" if kind == "zigzag" else f"turning:{side * steps[0]}"
    rate = math.radians(float(rng.uniform(8.0, 20.0))) / time_scale(L)
    plan = parse_maneuver(text, ship, rudder_rate=rate)
    trial = simulate(ship, plan, float(rng.choice([0.1, 0.2, 0.5])) * (2.0 if L > 100 else 1.0))
    return Case(name, logged(dict(trial.columns), L, rng), L, title(kind, side, steps))


def logged(columns: dict[str, np.ndarray], length: float, rng: np.random.Generator) -> Trial:
    """What instruments log of the true ``columns``: noise, a rudder zero that is off, steps of 0.1 deg, headings in
    (-180, 180]."""
    count, unit = len(columns["t"]), math.sqrt(length / 3.0)
    out = dict(columns)
    sizes = dict.fromkeys("xy", 0.01 * length / 3) | dict.fromkeys("uv", 0.004 * unit)
    sizes |= {"r": 0.0006 / unit, "psi": 0.0015, "delta": math.radians(rng.choice([0.0, 0.1, 0.3]))}
    for name, size in sizes.items():
        out[name] = out[name] + size * rng.standard_normal(count)
    out["delta"] = np.radians(np.round(np.degrees(out["delta"] + math.radians(rng.uniform(-1.5, 1.5))), 1))
    out["psi"] = np.mod(out["psi"] + math.pi, 2 * math.pi) - math.pi
    return Trial("run", out)


def found_in(case: Case) -> str:
    """Titles of what is found in the record of a ``case``, "nothing" where nothing is."""
    try:
        return ", ".join(e.title for e in find_maneuvers(case.trial, case.length))
    except UserError:
        return "nothing"


def cases(seed: int) -> list[Case]:
    """All records with the draws of ``seed``."""
    made = [(foreign, name) for name in SETS] + [(own, name) for name in OWN]
    found = []
    for k, (make, name) in enumerate(made):
        for j, order in enumerate(orders()):
            try:
                found.append(make(name, *order, np.random.default_rng([seed, k, j])))
            except UserError:
                continue  # a ship that does not reach the heading has no such manoeuvre
    return found


def confusion(some: list[Case]) -> tuple[list[list[str]], list[str]]:
    """A row per order: records, how many are read as ordered, what else; and the misread ones with their ships."""
    read = [(case, found_in(case)) for case in some]
    rows, wrong = [], []
    for ordered in dict.fromkeys(case.ordered for case in some):
        mine = [(case, words) for case, words in read if case.ordered == ordered]
        right = [words for case, words in mine if same(words, ordered)]
        others = Counter(words for case, words in mine if not same(words, ordered))
        wrong += [f"{case.ship}, {ordered}: {words}" for case, words in mine if not same(words, ordered)]
        rows.append([ordered, str(len(mine)), str(len(right)), "; ".join(f"{w} ({n})" for w, n in others.items())])
    return rows, wrong


PLAN = (("zigzag", 10.0, 10.0), ("turning", 35.0, 560.0), ("zigzag", -20.0, 20.0), ("turning", -35.0, 400.0),
        ("zigzag", -5.0, 1.0), ("zigzag", 20.0, 10.0))  # fmt: skip
"""Of the long records: six manoeuvres, between which the course is kept."""


def long_record(name: str, seed: int) -> Case:
    """One record of the foreign ship ``name`` with the manoeuvres of PLAN."""
    hull, rng = SETS[name].hull, np.random.default_rng([seed, 1])
    unit, heading = hull.length / hull.speed, float(rng.uniform(-math.pi, math.pi))
    dt = 1.0 if hull.length > 20 else 0.2
    order = program(PLAN, heading, 15 * unit)
    out = run(Plant(hull, Weather(), rng), order, 300 * unit, dt, heading)
    trial = logged(out | {"n": np.full(len(out["t"]), hull.revolutions)}, hull.length, rng)
    ordered = [title(kind, int(math.copysign(1, a)), (int(abs(a)), int(b))) for kind, a, b in PLAN]
    return Case(name, trial, hull.length, ", ".join(ordered))


def listed(case: Case) -> list[tuple[str, str]]:
    """(found, ordered) of each manoeuvre of a long record in turn; "nothing" for those that are missing."""
    asked, got = case.ordered.split(", "), found_in(case).split(", ")
    return list(zip([*got, *["nothing"] * (len(asked) - len(got))], asked, strict=False))


def same(found: str, ordered: str) -> bool:
    """Whether one manoeuvre was ``found``, and as ``ordered``; the rudder of a turn as it is logged, within 2 deg."""
    if ordered.startswith("turning") and found.startswith("turning") and "," not in found:
        return abs(float(found.split()[1]) - float(ordered.split()[1])) <= 2.0
    return found == ordered


def real() -> list[list[str]]:
    """A row per kind of the FRT-DS-ESSO records: how many, and what is found; empty without the data."""
    from cases.io.read import read_trials
    from cases.published_splits import data_folder

    try:
        trials = read_trials([data_folder()])
    except UserError:
        return []
    rows = []
    for kind in dict.fromkeys(trial.kind for trial in trials):
        mine = [found_in(Case("", replace(trial, kind=""), 3.0, kind)) for trial in trials if trial.kind == kind]
        words = Counter(mine)
        rows.append([kind, str(len(mine)), "; ".join(f"{w} ({n})" for w, n in sorted(words.items()))])
    return rows


def main() -> None:
    """Print and record the tables."""
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else SEED
    some = cases(seed)
    rows, wrong = confusion(some)
    right = sum(int(row[2]) for row in rows)
    lines = [f"Seed {seed}: {right} of {len(some)} records are read as they were ordered.", ""]
    lines += table(["ordered", "records", "read so", "read as something else"], rows)
    lines += ["", f"Misread: {'; '.join(wrong)}."] if wrong else []
    records = [long_record(name, seed) for name in SETS]
    pairs = [(got, asked) for case in records for got, asked in listed(case)]
    cut = sum(same(got, asked) for got, asked in pairs)
    lines += [
        "",
        f"{len(records)} records of {len(PLAN)} manoeuvres each: {cut} of {len(pairs)} are found and read so.",
    ]
    found = real()
    if found:
        lines += ["", "The FRT-DS-ESSO records, read without the kind that their names tell:", ""]
        lines += table(["kind", "records", "found"], found)
    if seed == SEED:
        record("Measured manoeuvres", "python -m benchmarks.measured_maneuvers", lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
