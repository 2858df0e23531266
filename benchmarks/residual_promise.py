"""What a residual promises, and what runs that nobody saw obtain.

Nine zigzags of a 7 m ship are calibrated on and a residual is trained on them, as ``mmg fit`` and ``mmg train`` do by
default. The promise is the gain that the decision found, with its 90 % interval; what is obtained is the gain of the
hybrid ship on eight fresh zigzags, of the same angles and of others, and on four turnings. Worlds: "foreign": the plant
of ``benchmarks.foreign_figures``, whose equations are not the package's; "own": the library's KVLCC2 with coefficients
drawn from its prior, pushed by random forces, with an effect that the calibrated ship lacks in every second seed;
"cross": her trials, calibrated from a ship made of particulars, whose hull is of another structure. "records":
Train-TZRB; obtained on the other records of Train-TZRB+ but the five hold-outs, and at last on these.

Run from the repository root: python -m benchmarks.residual_promise [WORLD:SEED ...] [--rows FILE] [--record]. Finished
cases are kept in the file and not made again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.disturbed_trials import Disturbed, disturbed_trials, drawn_ship
from benchmarks.foreign_figures import drawn_hull, foreign_trials, machinery_of, start_ship
from benchmarks.record import record, table
from benchmarks.remaining_error import validation_names
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.effects import with_effects
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.pipeline import FitOptions, calibrate
from fitting.prediction.score import pooled_sigma, score
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.pipeline import train

ROWS = Path(tempfile.gettempdir()) / "mmg_residual_promise.jsonl"
NINE = ((5, 5), (10, 10), (15, 15), (20, 20), (20, 10), (-5, 5), (-10, 10), (-15, 15), (-20, 20))
FRESH = ((10, 10), (-10, 10), (20, 20), (-20, 20), (7, 7), (-25, 25), (30, 15), (-12, 12))
TURNINGS = (35, -35, -20, 15)
"""Angles of rudder and heading [deg]."""
LACKED = ("hull_memory:T=3", "shallow_water:d_h=0.5", "wave_drift:x=6")
"""Effects that the calibrated ship lacks."""
CASES = ("foreign:0", "foreign:3", "foreign:6", "own:41", "own:42", "own:43", "own:44", "cross:41", "cross:42",
         "cross:43", "records:0")  # fmt: skip


class Case(NamedTuple):
    """A ship to calibrate, runs to calibrate and train on, and runs that judge, by their name."""

    ship: Ship
    runs: list[Trial]
    judges: dict[str, list[Trial]]


def foreign(seed: int) -> Case:
    """The plant that shares nothing with the package. seed: of ship, winds and noise."""
    hull = drawn_hull(seed)
    machinery = machinery_of(hull, seed)
    sets = [
        [("zigzag", float(a), float(b)) for a, b in NINE],
        [("zigzag", float(a), float(b)) for a, b in FRESH],
        [("turning", float(a), 0.0) for a in TURNINGS],
    ]
    runs, zigzags, turnings = (foreign_trials(hull, machinery, seed, s, 100 * k) for k, s in enumerate(sets))
    return Case(start_ship(hull, machinery), runs, {"zigzags": zigzags, "turnings": turnings})


def library(seed: int, cross: bool) -> Case:
    """The library's KVLCC2 of 7 m. seed: of her coefficients and of what pushes her; cross: calibrated from a ship made
    of particulars, else from herself, in every second seed without an effect that she has."""
    base, k, size = load_ship("kvlcc2_l7"), (7 / 3) ** 0.5, (7 / 3) ** 3
    how = replace(Disturbed(defects=()), X=0.3 * size, Y=0.4 * size, N=0.3 * size * 7 / 3, tau=8 * k)
    true, p = drawn_ship(base, seed), base.particulars
    if not cross and seed % 2:
        true = with_effects(true, [LACKED[seed // 2 % len(LACKED)]])
    start = new_ship("cross", {"L": 7.0, "B": p["B"], "d": p["d"], "C_b": p["C_b"], "U_0": 1.18}) if cross else base
    sets = [
        [(f"zigzag:{a}/{b}", 150.0) for a, b in NINE],
        [(f"zigzag:{a}/{b}", 150.0) for a, b in FRESH],
        [(f"turning:{a}", 150.0) for a in TURNINGS],
    ]
    runs, zigzags, turnings = (disturbed_trials(true, s, seed + 500 * i, how, dt=0.2) for i, s in enumerate(sets))
    return Case(start, runs, {"zigzags": zigzags, "turnings": turnings})


def records() -> Case:
    """The real records."""
    judges = {"other records": validation_names(), "hold-outs": splits.DEVELOPMENT_HOLDOUT}
    read = {name: read_trials(splits.find(names)) for name, names in judges.items()}
    return Case(load_ship("esso_osaka_3m"), read_trials(splits.find(splits.TRAIN_TZRB)), read)


def case_of(name: str) -> Case:
    """The case called WORLD:SEED. Raises SystemExit for another world."""
    world, _, seed = name.partition(":")
    if world == "records":
        return records()
    if world == "foreign":
        return foreign(int(seed))
    if world in ("own", "cross"):
        return library(int(seed), world == "cross")
    raise SystemExit(f"{name}: none of foreign, own, cross, records")


def row_of(name: str) -> dict[str, Any]:
    """The promise of the case ``name`` and what its judges obtain: gains of 30 s windows and of 100 s restarts."""
    began, (ship, runs, judges) = time.process_time(), case_of(name)
    found = calibrate(ship, runs, (), None, FitOptions(next_trial=False))
    trained = train(found, runs)
    assert trained.decision is not None and trained.hybrid is not None
    d, sigma = trained.decision, pooled_sigma(runs)
    obtained = {}
    for words, trials in judges.items():
        before, after = (score(Simulator(s), trials, sigma) for s in (found.ship, trained.hybrid))
        obtained[words] = [1 - after.window / before.window, 1 - after.paper / before.paper]
    promise = {n: getattr(d, n) for n in ("kept", "improvement", "lowest", "highest", "groups", "reason")}
    return {"name": name, "seconds": time.process_time() - began, "promise": promise, "obtained": obtained}


def lines_of(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The table, and how the promises did."""
    body, errors, inside = [], [], []
    for row in rows:
        p, first = row["promise"], next(iter(row["obtained"].values()))
        told = [f"{words} {v[0]:+.1%} ({v[1]:+.1%})" for words, v in row["obtained"].items()]
        ends = f"{p['lowest']:+.1%} to {p['highest']:+.1%}"
        body.append(
            [row["name"], f"{p['improvement']:+.1%}", ends, "yes" if p["kept"] else p["reason"], ", ".join(told)]
        )
        errors.append(p["improvement"] - first[0])
        inside.append(p["lowest"] <= first[0] <= p["highest"])
    e, n = np.array(errors), len(errors)
    gains = [next(iter(r["obtained"].values()))[0] for r in rows if r["promise"]["kept"]]
    head = ["case", "promised", "90 % interval", "kept", "obtained, 30 s windows (100 s restarts)"]
    summary = (
        f"Promised less obtained on fresh runs of the kinds trained on: mean {e.mean():+.1%} "
        f"± {e.std(ddof=1) / np.sqrt(n):.1%}; {sum(inside)} of {n} obtained gains inside the interval; "
        f"{sum(g > 0 for g in gains)} of {len(gains)} kept residuals gain."
    )
    return [*table(head, body), "", summary]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.residual_promise", description=__doc__)
    parser.add_argument("cases", nargs="*", default=CASES, metavar="WORLD:SEED")
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of finished cases")
    parser.add_argument("--record", action="store_true", help="keep the table in RESULTS.md")
    given = parser.parse_args()
    lines = given.rows.read_text(encoding="utf-8").splitlines() if given.rows.exists() else []
    known = {row["name"]: row for row in map(json.loads, lines)}
    for name in given.cases:
        if name not in known:
            known[name] = row_of(name)
            with given.rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps(known[name]) + "\n")
            print(json.dumps(known[name]), flush=True)
    made = lines_of([known[name] for name in given.cases])
    if given.record:
        record("What a residual promises", "python -m benchmarks.residual_promise " + " ".join(given.cases), made)
    else:
        print("\n".join(made))


if __name__ == "__main__":
    main()
