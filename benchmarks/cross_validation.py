"""Errors on runs that a calibration has not seen: all records left out in five folds, or the five hold-outs.

All 35 records of Train-TZRB+ in folds that spread each day and kind; records that share rows stay together. Each fold
is what ``mmg fit`` does by default, or with the options of a variant, on the other records; its ship predicts the
records left out, 30 s windows and 100 s restarts, in units of the sigma of all records, without and with 30 s of past.
Means of files with their jackknife errors; variants are compared with the first one, file by file.
--hold-outs: five records by the captive ship and by ships fitted on Train-TZRB and on the rest of Train-TZRB+, in units
of their own sigma. Nothing is chosen by them. Broken stretches are left out, as by ``mmg fit`` and ``mmg score``.

Run from the repository root: python -m benchmarks.cross_validation [VARIANT ...] [--hold-outs] [--record], VARIANT
being "default" or settings and options as "loss=student,window=50,estimator=windows,instruments=velocity_filter+gyro".
Finished folds are kept in the file --rows and not made again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record import Figure, keep, table
from cases import published_splits as splits
from cases.checks.duplicates import duplicates
from cases.checks.trusted import without_broken
from cases.io.groups import group_trials
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibrate import FitOptions
from fitting.prediction.score import Score, pooled_sigma
from fitting.result import FitResult
from fitting.settings import Settings
from mmg_ident.api import calibrate, score

SHIP = "esso_osaka_3m"
FOLDS = 5
PAST = 30.0
"""s before a window that a prediction may use."""
METRICS = {"30": "30 s windows", "100": "100 s restarts"}
ROWS = Path(tempfile.gettempdir()) / "mmg_cross_validation.jsonl"
Files = dict[str, tuple[float, float]]
"""Record -> errors of its 30 s windows and of its 100 s restarts, NaN without a whole window."""


def trials_of(names: Sequence[str]) -> list[Trial]:
    """Records by their ``names`` without their broken stretches, as the commands take them."""
    return without_broken(read_trials(splits.find(names)))


def fitted(variant: str, train: Sequence[Trial]) -> FitResult:
    """What ``mmg fit`` makes of the trials ``train`` with the options of a ``variant``. Raises SystemExit for one that
    is not known."""
    settings: dict[str, Any] = {}
    options: dict[str, Any] = {"next_trial": False}
    for word in [] if variant == "default" else variant.split(","):
        key, _, value = word.partition("=")
        if key in {f.name for f in fields(Settings)}:
            settings[key] = value if value.isalpha() else int(value) if value.isdigit() else float(value)
        elif key in {f.name for f in fields(FitOptions)}:
            options[key] = value if key == "estimator" else tuple(v for v in value.split("+") if v != "none")
        else:
            raise SystemExit(f"{variant}: {key!r} is no field of Settings or FitOptions")
    return calibrate(load_ship(SHIP), list(train), (), Settings(**settings), FitOptions(**options))


def by_file(found: Score) -> Files:
    """Errors of the records of a score."""
    return {r.name: (r.window, r.paper) if r.windows else (np.nan, np.nan) for r in found.trials}


def folds_of(trials: Sequence[Trial]) -> list[list[int]]:
    """Numbers of ``trials`` in folds that spread each day and kind; those that share rows stay together."""
    days, groups = group_trials(trials, "day"), list(range(len(trials)))
    position = {t.name: i for i, t in enumerate(trials)}
    for i, (copies, _) in enumerate(duplicates(trials)):
        for copy in copies:
            pair = (groups[i], groups[position[copy["other"]]])
            groups = [min(pair) if g in pair else g for g in groups]
    labels = [f"{days.names[k]} {t.kind}" for t, k in zip(trials, days.number, strict=True)]
    heads = sorted(set(groups), key=lambda i: (labels[i], i))
    fold = {group: k % FOLDS for k, group in enumerate(heads)}
    return [[i for i, g in enumerate(groups) if fold[g] == k] for k in range(FOLDS)]


def fold_errors(
    variant: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray, path: Path
) -> tuple[Files, Files]:
    """Errors of the trials ``out`` by a ship fitted on ``train`` with the options of a ``variant``, without and with a
    past; sigma (6,); path: of the file of finished folds."""
    content = json.dumps([variant, [t.sha256 for t in train], [t.sha256 for t in out]])
    mark = hashlib.sha256(content.encode()).hexdigest()[:16]
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    row = next((r for r in map(json.loads, lines) if r["key"] == mark), None)
    if row is None:
        found = fitted(variant, train)
        files = [by_file(score(found, list(out), sigma, adapt)) for adapt in (None, PAST)]
        row = {"key": mark, "variant": variant, "converged": found.converged, "files": files}
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{variant}: {len(out)} of {len(out) + len(train)} files, converged {found.converged}", flush=True)
    return row["files"][0], row["files"][1]


def cross_validated(variant: str, path: Path) -> tuple[Files, Files]:
    """Errors of all records by ships that did not see them, without and with a past; path: of finished folds."""
    trials, bare, past = trials_of(splits.TRAIN_TZRB_PLUS), {}, {}
    sigma = pooled_sigma(trials)
    for out in folds_of(trials):
        rest = [t for i, t in enumerate(trials) if i not in out]
        files = fold_errors(variant, rest, [trials[i] for i in out], sigma, path)
        bare |= files[0]
        past |= files[1]
    return bare, past


def jackknifed(values: np.ndarray) -> tuple[float, float]:
    """Mean of ``values`` (R,) over files, those that are NaN left out, and its jackknife error."""
    good = values[~np.isnan(values)]
    return float(good.mean()), float(good.std(ddof=1) / np.sqrt(len(good)))


def change(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """mean(after) / mean(before) - 1 over the files (R,) that both have, and its jackknife error over files."""
    good = ~(np.isnan(before) | np.isnan(after))
    a, b, n = before[good], after[good], int(good.sum())
    without = (b.sum() - b) / (a.sum() - a)
    return float(b.mean() / a.mean() - 1), float(np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum()))


def lines_of(errors: Mapping[str, Files]) -> list[str]:
    """Tables of both metrics by kind and variant, with the change against the first variant."""
    first, lines = next(iter(errors.values())), []
    kinds = {name: name.split("_")[0] for name in first}
    for metric, words in enumerate(METRICS.values()):
        rows = []
        for kind in [*dict.fromkeys(kinds.values()), "all"]:
            names = [name for name in first if kind in ("all", kinds[name])]
            values = {v: np.array([files[name][metric] for name in names]) for v, files in errors.items()}
            cells = ["{:.4f} ± {:.4f}".format(*jackknifed(column)) for column in values.values()]
            before = next(iter(values.values()))
            for k, column in enumerate(list(values.values())[1:], 1):
                cells[k] += " ({:+.1f} ± {:.1f} %)".format(*(100 * x for x in change(before, column)))
            rows.append([f"{kind} ({len(names)})", *cells])
        lines += [f"{words}:", "", *table(["kind (files)", *errors], rows), ""]
    return lines


def hold_outs(variant: str) -> tuple[list[str], dict[str, Figure]]:
    """Lines and figures of the five hold-outs, the ships being fitted with the options of a ``variant``."""
    held = trials_of(splits.DEVELOPMENT_HOLDOUT)
    sigma, rest = pooled_sigma(held), [n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT]
    scores = {"captive": ("captive model tests", score(SHIP, held, sigma))}
    for name, words, names in (("tzrb", "Train-TZRB", splits.TRAIN_TZRB), ("plus", "Train-TZRB+ without them", rest)):
        found = fitted(variant, trials_of(names))
        scores[name] = words, score(found, held, sigma)
        scores[f"{name}_past"] = f"{words}, {PAST:g} s of past", score(found, held, sigma, adapt=PAST)
    figures: dict[str, Figure] = {}
    for name, (words, found) in scores.items():
        for metric, value in zip(METRICS, (found.window, found.paper), strict=True):
            figures[f"holdout_{name}_{metric}"] = Figure(f"hold-outs, {METRICS[metric]}, pooled: {words}", value)
    files = [by_file(found) for _, found in scores.values()]
    body = [[name, *("{:.4f} / {:.4f}".format(*each[name]) for each in files)] for name in files[0]]
    body.append(["pooled", *(f"{s.window:.4f} / {s.paper:.4f}" for _, s in scores.values())])
    return table([" / ".join(METRICS.values()), *(words for words, _ in scores.values())], body), figures


def main() -> None:
    """Measures, prints, and records the figures of the first variant."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cross_validation", description=__doc__)
    parser.add_argument("variants", nargs="*", default=["default"])
    parser.add_argument("--hold-outs", action="store_true", help="score the five hold-outs instead")
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of finished folds")
    parser.add_argument("--record", action="store_true", help="keep the figures in record.json")
    given = parser.parse_args()
    if given.hold_outs:
        lines, figures = hold_outs(given.variants[0])
    else:
        pairs = {variant: cross_validated(variant, given.rows) for variant in given.variants}
        lines, figures = [], {}
        for k, (ending, words) in enumerate((("", "without a past"), ("past_", f"{PAST:g} s of past"))):
            lines += [f"{words}:", "", *lines_of({variant: pair[k] for variant, pair in pairs.items()})]
            values = np.array(list(pairs[given.variants[0]][k].values()))
            for column, (metric, name) in zip(values.T, METRICS.items(), strict=True):
                what = f"cross-validation over 35 records, {name}, mean of files: {words}"
                figures[f"cv_{ending}{metric}"] = Figure(what, *_value_error(column))
    print("\n".join(lines))
    if given.record:
        keep(figures, "python -m benchmarks.cross_validation" + " --hold-outs" * given.hold_outs)


def _value_error(column: np.ndarray) -> tuple[float, str, float]:
    value, error = jackknifed(column)
    return value, "", error


if __name__ == "__main__":
    main()
