"""The real records with and without values by campaign: runs left out in five folds, and the five hold-outs.

Each calibration on some of the 35 records of Train-TZRB+ is made once; from it follow the ship without campaigns and,
if the choice keeps an instrument, the one with them, which predicts a record by the values of its day where it knows
that. Folds spread each day and kind, as in benchmarks/cross_validation.py. The measure trains nothing that is judged on
the five hold-outs: these are predicted by ships calibrated on Train-TZRB, and on the rest of Train-TZRB+.

Run from the repository root: python -m benchmarks.campaign_records [--parts hold-outs fast folds] [--rows FILE].
Finished calibrations are kept in the file and not made again. "fast" leaves each record out by one Newton step from a
single calibration on all 35 instead of five.
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
from cases.shipfiles.model_changes import with_instruments
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.prediction.score import pooled_sigma, score
from fitting.selection.campaigns.by_campaign import CampaignQuestion, by_campaign
from fitting.settings import Settings
from mmg.rollout import Simulator

VARIANTS = ("without campaigns", "with campaigns")
PARTS = ("hold-outs", "fast", "folds")
ROWS = Path(tempfile.gettempdir()) / "mmg_campaign_records.jsonl"


def row_of(name: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray) -> dict[str, Any]:
    """Scores of the trials ``out`` by both variants of a calibration on ``train``, without and with a past; sigma (6,)
    is their unit."""
    began = time.perf_counter()
    ship, settings = (
        with_instruments(load_ship("esso_osaka_3m"), ("velocity_filter",)),
        Settings(),
    )
    found = estimate_coefficients(ship, train, settings)
    fit = by_campaign(found, CampaignQuestion(ship, train, settings))
    files: dict[str, dict[str, list[float]]] = {}
    for words, calibration in zip(VARIANTS, (found, fit.calibration), strict=True):
        simulator = Simulator(calibration.ship)
        for past in (None, PAST):
            rows = score(simulator, out, sigma, adapt=past).trials
            files[words + (WITH_PAST if past else "")] = {r.name: [r.window, r.paper, r.windows] for r in rows}
    kept = list(fit.calibration.constants.symbols) if fit.calibration.constants else []
    return {
        "name": name,
        "kept": kept,
        "sentences": [str(message) for message in fit.messages],
        "seconds": time.perf_counter() - began,
        "files": files,
    }


def made(path: Path, name: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray) -> dict[str, Any]:
    """The row called ``name``, from the file at ``path`` or made now and added to it."""
    if known := kept_row(path, name):
        return known
    row = row_of(name, train, out, sigma)
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
    print(f"{name}: {len(train)} records, kept {row['kept']}, {row['seconds']:.0f} s", flush=True)
    return row


def fold_lines(path: Path, past: bool) -> list[str]:
    """Tables of the runs left out in five folds, by kind; past: with 30 s of past."""
    scores, rows = scores_of_folds(VARIANTS, partial(made, path), WITH_PAST if past else "")
    kept = ", ".join(" and ".join(row["kept"]) or "nothing" for row in rows)
    head = f"35 records in 5 folds{', with 30 s of past' if past else ''}; kept: {kept}."
    return [head, "", *lines_of(scores)]


def fast_lines(path: Path) -> list[str]:
    """Tables of all records left out in turn, one Newton step from a single calibration on all of them."""
    known = path.with_suffix(".fast.json")
    if not known.exists():
        trials = trials_of(splits.TRAIN_TZRB_PLUS)
        ship, settings = (
            with_instruments(load_ship("esso_osaka_3m"), ("velocity_filter",)),
            Settings(),
        )
        found = estimate_coefficients(ship, trials, settings)
        fit = by_campaign(found, CampaignQuestion(ship, trials, settings))
        if fit.left_out is None:
            return ["All 35 records: no instrument was kept."]
        scores = dict(zip(VARIANTS, fit.left_out, strict=True))
        lines = [
            "35 records left out in turn, those that share rows together, one Newton step from one calibration:",
            "",
        ]
        lines += [*lines_of(scores), *(str(message) for message in fit.messages)]
        known.write_text(json.dumps(lines), encoding="utf-8")
    return list(json.loads(known.read_text(encoding="utf-8")))


def hold_out_lines(path: Path) -> list[str]:
    """Tables of the five hold-outs."""
    held, small = trials_of(splits.DEVELOPMENT_HOLDOUT), trials_of(splits.TRAIN_TZRB)
    large = trials_of(n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT)
    columns: dict[str, dict[str, list[float]]] = {}
    told = []
    for words, train in (("Train-TZRB", small), ("Train-TZRB+ without them", large)):
        row = made(path, words, train, held, pooled_sigma(small))
        columns |= {f"{words}, {variant}": files for variant, files in row["files"].items()}
        told += [f"{words}: {sentence}" for sentence in row["sentences"]]
    body = [[t.name, *(f"{c[t.name][0]:.4f}" for c in columns.values())] for t in held]
    body.append(["mean of files", *(f"{np.mean([v[0] for v in c.values()]):.4f}" for c in columns.values())])
    return ["30 s windows, in units of the sigma of Train-TZRB:", "", *table(["hold-out", *columns], body), "", *told]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.campaign_records", description=__doc__)
    parser.add_argument("--parts", nargs="+", default=["hold-outs", "fast"], choices=PARTS)
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of finished calibrations")
    parser.add_argument("--record", action="store_true", help="keep the tables in RESULTS.md")
    given = parser.parse_args()
    lines: list[str] = []
    if "hold-outs" in given.parts:
        lines += [*hold_out_lines(given.rows), ""]
    if "fast" in given.parts:
        lines += [*fast_lines(given.rows), ""]
    if "folds" in given.parts:
        lines += [*fold_lines(given.rows, False), *fold_lines(given.rows, True)]
    command = f"python -m benchmarks.campaign_records --parts {' '.join(given.parts)}"
    if given.record:
        record("Campaigns on the real records", command, lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
