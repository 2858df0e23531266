"""Do 90 % prediction bands hold nine tenths of the rows of runs that had no part in the calibration?

Run from the repository root: python -m benchmarks.bands records: all 35 records of Train-TZRB+ in five folds by day and
kind, refitted in full, without and with the past of a window; or python -m benchmarks.bands manoeuvres: turnings
predicted from zigzags and random runs (records), circles from zigzags alone (two generators: the KVLCC2 model of 7 m
pushed by random forces, and ``benchmarks/file_faults/plant.py``, whose equations are not the package's).
Each calibration is what ``mmg fit`` does by default; the bands are those of its result.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.disturbed_trials import Disturbed, disturbed_trials, drawn_ship
from benchmarks.file_faults.plant import Hull, Plant, Weather, circle, run, zigzag
from benchmarks.record import record, table
from benchmarks.sound_records import trials_of
from cases import published_splits as splits
from cases.checks.duplicates import duplicates
from cases.io.groups import group_trials
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.pipeline import FitOptions
from fitting.prediction.adaptation import Adaptation
from fitting.prediction.band_calibration import NORMAL
from fitting.prediction.bands import bands_of
from fitting.prediction.predict import predict_all
from fitting.prediction.worth_of_past import default_past
from fitting.result import FitResult
from fitting.selection.left_out_runs import folds_by
from mmg.ship import Ship
from mmg.states import STATES
from mmg_ident.api import calibrate

FOLDS = 5
KINDS = ((30.0, 15.0), (100.0, 100.0))
"""Length of windows and seconds between their starts."""
SEEDS = (41, 42, 43)
"""Of the synthetic ships."""
DEG = math.pi / 180
Counted = dict[tuple[float, bool, str], np.ndarray]
"""Rows inside by state, then rows, (7,), by length, whether with a past, and group of trials."""


def fitted(ship: Ship, trials: Sequence[Trial]) -> FitResult:
    """What ``mmg fit`` does by default."""
    return calibrate(ship, trials, (), None, FitOptions(next_trial=False))


def count_inside(
    found: FitResult, trials: Sequence[Trial], groups: Sequence[str], into: Counted, pasts: Sequence[bool]
) -> None:
    """Adds the rows of ``trials``, each of one of ``groups``, that the bands of ``found`` hold; the first row of a
    window does not count."""
    assert found.objects is not None
    bands, simulator = bands_of(found.to_dict(), found.ship), found.objects.after
    assert bands is not None
    for length, stride in KINDS:
        for past in pasts:
            adaptation = Adaptation.of(found.ship, default_past(found.ship)) if past else None
            made = predict_all(simulator, trials, length, stride, length > 50, adaptation=adaptation, bands=bands)
            for trial, group, (windows, _) in zip(trials, groups, made, strict=True):
                rows = into.setdefault((length, past, group), np.zeros(7))
                for w in windows:
                    assert w.std is not None
                    error = w.error(trial.states)[1:]
                    known = np.isfinite(error).all(axis=1)
                    rows[:6] += (np.abs(error[known]) < NORMAL * w.std[1:][known]).sum(axis=0)
                    rows[6] += known.sum()


def rows_of(counted: Counted) -> list[list[str]]:
    """Rows of a table: coverage by state, and in the mean over states."""
    rows = []
    for (length, past, group), n in counted.items():
        share = n[:6] / n[6]
        name = f"{group}, {length:g} s{', with a past' if past else ''}"
        rows.append([name, *(f"{v:.3f}" for v in share), f"{share.mean():.3f}"])
    return rows


HEADER = ["windows", *STATES, "mean"]


def records() -> None:
    """All records, each predicted by a calibration on the other folds."""
    trials = trials_of(splits.TRAIN_TZRB_PLUS)
    days = group_trials(trials, "day")
    labels = [f"{days.names[k]} {t.kind}" for t, k in zip(trials, days.number, strict=True)]
    groups = list(range(len(trials)))
    for i, (copies, _) in enumerate(duplicates(trials)):  # records that share rows stay together
        for copy in copies:
            j = next(k for k, t in enumerate(trials) if t.name == copy["other"])
            groups = [min(groups[i], groups[j]) if g in (groups[i], groups[j]) else g for g in groups]
    counted: Counted = {}
    for out in folds_by(labels, groups, FOLDS):
        found = fitted(load_ship("esso_osaka_3m"), [t for i, t in enumerate(trials) if i not in out])
        held = [trials[i] for i in out]
        count_inside(found, held, ["all records"] * len(held), counted, (False, True))
        print(len(held), "records,", "growth", (found.bands or {}).get("held", {}).get("growth"), flush=True)
    lines = [
        f"{len(trials)} records in {FOLDS} folds by day and kind, each predicted by a calibration on the others, "
        "refitted in full. Share of rows inside the 90 % band, by state.",
        "",
        *table(HEADER, rows_of(counted)),
    ]
    record("Prediction bands on records left out", "python -m benchmarks.bands records", lines)


def kvlcc2(seed: int) -> tuple[Ship, list[Trial], list[Trial]]:
    """A start ship, zigzags and circles of a ship drawn from its prior, pushed by random forces."""
    base, k = load_ship("kvlcc2_l7"), (7.0 / 3.0) ** 0.5
    size = (7.0 / 3.0) ** 3
    how = replace(Disturbed(defects=()), X=0.3 * size, Y=0.4 * size, N=0.3 * size * 7 / 3, tau=8 * k)
    zigzags = [(f"zigzag:{a}/{a}", 150.0) for a in (10, 20, 10, 20, 15)]
    true = drawn_ship(base, seed)
    return (
        base,
        disturbed_trials(true, zigzags, seed, how, dt=0.2),
        disturbed_trials(true, [("turning:35", 200.0), ("turning:-35", 200.0)], seed + 500, how, dt=0.2),
    )


def plant(seed: int) -> tuple[Ship, list[Trial], list[Trial]]:
    """The same of a plant that is not the package's."""
    rng = np.random.default_rng(seed)
    hull = Hull(7.0, 1.27, 0.46, 0.81, 1.2, 10.0, 0.2)
    particulars = {"L": 7.0, "B": 1.27, "d": 0.46, "C_b": 0.81, "U_0": 1.2}
    sets: list[list[Trial]] = []
    for orders in ([(zigzag, a) for a in (10, -10, 20, -20, 15)], [(circle, 35), (circle, -35)]):
        made = []
        for number, (order, angle) in enumerate(orders):
            heading = float(rng.uniform(-math.pi, math.pi))
            weather = Weather(1.0, float(rng.uniform(-math.pi, math.pi)), 0.3)
            true = run(Plant(hull, weather, rng), order(angle, heading, 15.0), 180.0, 0.2, heading)
            noise = {"x": 0.02, "y": 0.02, "psi": 0.1 * DEG, "u": 0.005, "v": 0.005, "r": 0.05 * DEG}
            true |= {name: true[name] + sd * rng.standard_normal(len(true["t"])) for name, sd in noise.items()}
            true["n"] = np.full(len(true["t"]), hull.revolutions)
            made.append(Trial(f"{order.__name__}_{number}", true, kind="zigzag" if order is zigzag else "turning"))
        sets.append(made)
    return new_ship("plant", particulars), sets[0], sets[1]


def manoeuvres() -> None:
    """Manoeuvres of a kind that the calibration did not have."""
    counted: Counted = {}
    known = [n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT]
    trials = trials_of(known)
    found = fitted(load_ship("esso_osaka_3m"), [t for t in trials if t.kind in ("zigzag", "random")])
    turnings = [t for t in trials if t.kind == "turning"]
    count_inside(found, turnings, ["records: turnings from zigzags and random runs"] * len(turnings), counted, (False,))
    remarks = []
    for name, world in (("KVLCC2", kvlcc2), ("plant", plant)):
        for seed in SEEDS:
            ship, zigzags, circles = world(seed)
            found = fitted(ship, zigzags)
            count_inside(found, circles, [f"{name}: circles from zigzags alone"] * len(circles), counted, (False,))
            remarks.append(f"{name} {seed} {'converged' if found.converged else 'NOT converged'}")
            print(remarks[-1], flush=True)
    lines = [
        f"Share of rows inside the 90 % band, by state; synthetic ships of seeds {', '.join(map(str, SEEDS))} "
        f"({'; '.join(remarks)}).",
        "",
        *table(HEADER, rows_of(counted)),
    ]
    record("Prediction bands on manoeuvres of another kind", "python -m benchmarks.bands manoeuvres", lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bands", description=__doc__)
    parser.add_argument("what", choices=("records", "manoeuvres"))
    {"records": records, "manoeuvres": manoeuvres}[parser.parse_args().what]()


if __name__ == "__main__":
    main()
