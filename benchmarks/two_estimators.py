"""Coefficients by multiple shooting, by the Kalman filter of the diagnosis, and their mean, on records left out.

Multiple shooting predicts windows open loop; the filter predicts the next sample from the past, with random forces and
gusts between. Both see other errors of the same model, so that their mean may be better than each. All 35 records of
Train-TZRB+ in five folds that spread each day and kind, as in benchmarks/cross_validation.py, and the five hold-outs,
which nothing is chosen by. The mean has the instruments and values by campaign of the first.

Run from the repository root: python -m benchmarks.two_estimators [--rows FILE] [--record]. Finished calibrations are
kept in the file.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cross_validation import PAST, WITH_PAST, lines_of, scores_of_folds
from benchmarks.record import kept_row, record, table
from benchmarks.sound_records import trials_of
from cases import published_splits as splits
from cases.evidence.kinematics import consistency
from cases.shipfiles.model_changes import with_instruments
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from diagnosis import summary
from diagnosis.inputs import diagnosable
from diagnosis.prepare import prepare, with_sensor_faults
from fitting.calibration import estimate_coefficients
from fitting.prediction.score import pooled_sigma, score
from fitting.selection.campaigns.by_campaign import CampaignQuestion, by_campaign
from fitting.settings import Settings
from mmg.rollout import Simulator
from mmg.ship import Ship

NAMES = ("multiple shooting", "filter", "mean of both")
ROWS = Path(tempfile.gettempdir()) / "mmg_two_estimators.jsonl"


def by_shooting(train: Sequence[Trial]) -> Ship:
    """What ``mmg fit`` does by default."""
    ship, settings = (
        with_instruments(load_ship("esso_osaka_3m"), ("velocity_filter",)),
        Settings(),
    )
    found = estimate_coefficients(ship, train, settings)
    return by_campaign(found, CampaignQuestion(ship, train, settings)).calibration.ship


def by_filter(train: Sequence[Trial]) -> Ship:
    """The fit without effects with which a diagnosis begins."""
    given, _ = diagnosable(load_ship("esso_osaka_3m"))
    ship, _ = with_sensor_faults(given, consistency(train, given))
    ready = prepare(ship, train)
    return summary.fitted_ship(ship, ready.full, ready.null, ())


def mean_of(first: Ship, second: Ship) -> Ship:
    """The first with the mean of the free coefficients of both; what only it has stays."""
    both = [s for s in first.free if s in second.coefficients and "." not in s]
    return first.with_values({s: 0.5 * (first.coefficients[s].value + second.coefficients[s].value) for s in both})


def made(path: Path, name: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray) -> dict[str, Any]:
    """Scores of the trials ``out`` by each of NAMES, from the file at ``path`` or made now and added to it."""
    if known := kept_row(path, name):
        return known
    began = time.perf_counter()
    shooting = by_shooting(train)
    middle = time.perf_counter()
    filtered = by_filter(train)
    seconds = [middle - began, time.perf_counter() - middle]
    files: dict[str, dict[str, list[float]]] = {}
    for words, ship in zip(NAMES, (shooting, filtered, mean_of(shooting, filtered)), strict=True):
        for past in (None, PAST):
            rows = score(Simulator(ship), out, sigma, adapt=past).trials
            files[words + (WITH_PAST if past else "")] = {r.name: [r.window, r.paper, r.windows] for r in rows}
    row = {"name": name, "seconds": seconds, "files": files}
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
    print(f"{name}: {len(train)} records, {seconds[0]:.0f} and {seconds[1]:.0f} s", flush=True)
    return row


def fold_lines(path: Path, past: bool) -> list[str]:
    """Tables of the runs left out in five folds, by kind; past: with 30 s of past."""
    scores, _ = scores_of_folds(NAMES, partial(made, path), WITH_PAST if past else "")
    return [f"35 records in 5 folds{', with 30 s of past' if past else ''}.", "", *lines_of(scores)]


def hold_out_lines(path: Path) -> list[str]:
    """A table of the five hold-outs."""
    held, small = trials_of(splits.DEVELOPMENT_HOLDOUT), trials_of(splits.TRAIN_TZRB)
    large = trials_of(n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT)
    rows = []
    for words, train in (("Train-TZRB", small), ("Train-TZRB+ without them", large)):
        found = made(path, words, train, held, pooled_sigma(small))["files"]
        for name, files in found.items():
            window = [files[t.name][0] for t in held]
            rows.append([words, name, *(f"{v:.4f}" for v in window), f"{np.mean(window):.4f}"])
    heads = ["trained on", "coefficients", *(t.name for t in held), "mean of files"]
    return ["Hold-outs, 30 s windows, in units of the sigma of Train-TZRB:", "", *table(heads, rows), ""]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.two_estimators", description=__doc__)
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of finished calibrations")
    parser.add_argument("--record", action="store_true", help="keep the tables in RESULTS.md")
    given = parser.parse_args()
    lines = [*fold_lines(given.rows, False), *fold_lines(given.rows, True), *hold_out_lines(given.rows)]
    if given.record:
        record("Two estimators and their mean", "python -m benchmarks.two_estimators", lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
