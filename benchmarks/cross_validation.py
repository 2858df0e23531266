"""Runs left out of a calibration, refitted in full: mean of files by kind of manoeuvre, with jackknife errors.

All 35 records of Train-TZRB+ in folds that spread each day and kind (``--folds 5``), or whole days and kinds left out
(``--folds day-kind``); records that share rows stay together. Each fold is what ``mmg fit`` does by default, or with
the options named, on the other records; its ship predicts the records left out, 30 s windows and 100 s restarts, in
units of the sigma of all records. Variants are compared with the first one, file by file.
This is a measure and trains nothing that is judged on the five hold-outs; ``--without-hold-outs`` leaves them out
altogether, which choices of method must do; ``--hold-outs`` scores them once by ships fitted on Train-TZRB and on the
rest of Train-TZRB+, with the sigma of Train-TZRB.

Run from the repository root: python -m benchmarks.cross_validation [VARIANT ...], VARIANT being "default" or options as
"loss=student,window=50,adapt=30,measurement=velocity_lag+gyro,campaigns=none". Finished folds are kept in --rows and
not made again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record import record, table
from cases import published_splits as splits
from cases.io.groups import group_trials
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.pipeline import FitOptions
from fitting.prediction.score import pooled_sigma, score
from fitting.selection.left_out_runs import METRICS, Jackknifed, RunScores, folds_by, sharing_rows
from fitting.settings import Settings
from mmg_ident.api import calibrate

ROWS = Path(tempfile.gettempdir()) / "mmg_cross_validation.jsonl"
LABELS = {"window": "30 s windows", "paper": "100 s restarts"}
SETTINGS = {"loss": str, "weight": float, "window": float, "step": float, "horizon": float, "passes": int}
"""Options of a variant that are settings of the calibration; "adapt", "measurement" and "campaigns" are the others."""


def options_of(variant: str) -> dict[str, Any]:
    """Options named by a ``variant``. Raises SystemExit for one that is not known."""
    found: dict[str, Any] = {}
    for word in [] if variant == "default" else variant.split(","):
        key, _, value = word.partition("=")
        if key == "adapt":
            found[key] = float(value)
        elif key == "measurement":
            found[key] = tuple(v for v in value.split("+") if v != "none")
        elif key == "campaigns":
            found[key] = tuple(value.split("+"))
        elif key in SETTINGS and hasattr(Settings(), key):
            found[key] = SETTINGS[key](value)
        else:
            raise SystemExit(
                f"{variant}: {key!r} is none of {', '.join([*SETTINGS, 'adapt', 'measurement', 'campaigns'])}"
            )
    return found


def grouped(trials: Sequence[Trial]) -> tuple[list[str], list[int]]:
    """Day and kind of each of ``trials``, and a number that those share which hold the same rows."""
    days = group_trials(trials, "day")
    labels = [f"{days.names[k]} {t.kind}" for t, k in zip(trials, days.number, strict=True)]
    return labels, sharing_rows(trials)


def fold_score(variant: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray) -> dict[str, Any]:
    """Scores of the trials ``out`` by a ship fitted on ``train`` with the options of a ``variant``; sigma (6,)."""
    began, chosen = time.perf_counter(), options_of(variant)
    adapt = chosen.pop("adapt", None)
    options = FitOptions(next_trial=False)
    if "measurement" in chosen:
        options = replace(options, instruments=chosen.pop("measurement"))
    if "campaigns" in chosen:
        options = replace(options, per_campaign=chosen.pop("campaigns"))
    found = calibrate(
        load_ship("esso_osaka_3m"), train, (), Settings(**{"loss": None, "weight": None} | chosen), options
    )
    assert found.objects is not None
    seconds = time.perf_counter() - began
    rows = score(found.objects.after, out, sigma, adapt=adapt).trials
    return {
        "converged": found.converged,
        "seconds": seconds,
        "files": {row.name: [row.window, row.paper, row.windows] for row in rows},
    }


class Rows:
    """Results kept in a file of lines, by a key of what made them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.known = {row["key"]: row for row in map(json.loads, lines)}

    def made(self, key: str, variant: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray) -> dict:
        """The row of ``fold_score``, made now unless it is known."""
        names = json.dumps([key, variant, [t.sha256 for t in train], [t.sha256 for t in out]])
        mark = hashlib.sha256(names.encode()).hexdigest()[:16]
        if mark not in self.known:
            row = {"key": mark, "variant": variant, **fold_score(variant, train, out, sigma)}
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            self.known[mark] = row
            mean = np.nanmean([w for w, _, n in row["files"].values() if n])
            print(
                f"{variant}: {len(out)} of {len(out) + len(train)} files, {mean:.4f}, {row['seconds']:.0f} s",
                flush=True,
            )
        return self.known[mark]


def cross_validated(
    rows: Rows, mark: str, variant: str, trials: Sequence[Trial], folds: Sequence[Sequence[int]]
) -> tuple[RunScores, float, bool]:
    """Scores of all ``trials`` by ships that did not see them, mean seconds of a fit, whether all fits converged."""
    sigma, found, seconds, converged = pooled_sigma(trials), {}, [], True
    for out in folds:
        rest = [t for i, t in enumerate(trials) if i not in out]
        row = rows.made(mark, variant, rest, [trials[i] for i in out], sigma)
        found |= row["files"]
        seconds.append(row["seconds"])
        converged &= row["converged"]
    window, paper, count = np.array([found[t.name] for t in trials]).T
    bare = [np.where(count > 0, v, np.nan) for v in (window, paper)]
    scores = RunScores(tuple(t.name for t in trials), tuple(t.kind for t in trials), *bare, count, sigma)
    return scores, float(np.mean(seconds)), converged


def lines_of(scores: dict[str, RunScores]) -> list[str]:
    """Tables of both metrics by kind and variant, changes against the first variant."""
    first, lines = next(iter(scores.values())), []
    kinds = list(dict.fromkeys(first.kinds))
    for metric in METRICS:
        body = []
        for kind in (*kinds, None):
            count = int(np.isfinite(first.of(metric, kind)).sum())
            cells = [_cell(s.mean(metric, kind), first.change(s, metric, kind), s is first) for s in scores.values()]
            body.append([f"{kind or 'all'} ({count})", *cells])
        lines += [f"{LABELS[metric]}:", "", *table(["kind (files)", *scores], body), ""]
    return lines


def _cell(mean: Jackknifed, change: Jackknifed, first: bool) -> str:
    words = f"{mean.value:.4f} ± {mean.error:.4f}"
    return words if first else f"{words} ({100 * change.value:+.1f} ± {100 * change.error:.1f} %)"


def scores_of_folds(
    variants: Sequence[str], made: Callable[[str, Sequence[Trial], Sequence[Trial], np.ndarray], dict], ending: str
) -> tuple[dict[str, RunScores], list[dict]]:
    """Scores by variant of all records of Train-TZRB+, left out in five folds, and the rows that hold them.

    made: from the name of a fold, trials to fit, trials left out and sigma (6,) a row whose "files" has the scores of
    each of the ``variants`` with an ``ending`` to its name.
    """
    trials = read_trials(splits.find(splits.TRAIN_TZRB_PLUS))
    labels, groups = grouped(trials)
    sigma, rows = pooled_sigma(trials), []
    for k, out in enumerate(folds_by(labels, groups, 5)):
        rest = [t for i, t in enumerate(trials) if i not in out]
        rows.append(made(f"fold {k}", rest, [trials[i] for i in out], sigma))
    names, kinds = tuple(t.name for t in trials), tuple(t.kind for t in trials)
    scores = {}
    for variant in variants:
        files = {name: found for row in rows for name, found in row["files"][variant + ending].items()}
        window, paper, count = np.array([files[name] for name in names]).T
        window, paper = (np.where(count > 0, v, np.nan) for v in (window, paper))
        scores[variant] = RunScores(names, kinds, window, paper, count, sigma)
    return scores, rows


def hold_out_lines(rows: Rows, mark: str, variants: Sequence[str]) -> list[str]:
    """Tables of the five hold-outs by ships fitted on Train-TZRB and on the rest of Train-TZRB+."""
    held, small = read_trials(splits.find(splits.DEVELOPMENT_HOLDOUT)), read_trials(splits.find(splits.TRAIN_TZRB))
    large = read_trials(splits.find(n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT))
    columns: dict[str, dict] = {}
    for variant in variants:
        for words, train in (("Train-TZRB", small), ("Train-TZRB+ without them", large)):
            columns[f"{words}, {variant}"] = rows.made(mark, variant, train, held, pooled_sigma(small))["files"]
    body = [[t.name, *(f"{c[t.name][0]:.4f} / {c[t.name][1]:.4f}" for c in columns.values())] for t in held]
    means = [np.mean([v[:2] for v in c.values()], axis=0) for c in columns.values()]
    body.append(["mean of files", *(f"{a:.4f} / {b:.4f}" for a, b in means)])
    return [
        "30 s windows / 100 s restarts, in units of the sigma of Train-TZRB:",
        "",
        *table(["hold-out", *columns], body),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cross_validation", description=__doc__)
    parser.add_argument("variants", nargs="*", default=["default"])
    parser.add_argument("--folds", default="5", help="number of folds, or day-kind: each of them left out as a whole")
    parser.add_argument("--without-hold-outs", action="store_true")
    parser.add_argument("--hold-outs", action="store_true", help="score the five hold-outs instead")
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of finished folds")
    parser.add_argument("--mark", default="", help="word kept with the rows: others are made for another one")
    parser.add_argument("--title", help="record the tables in RESULTS.md under this title")
    given = parser.parse_args()
    for variant in given.variants:
        options_of(variant)
    rows = Rows(given.rows)
    options = [f"--folds {given.folds}", *(["--without-hold-outs"] if given.without_hold_outs else [])]
    if given.hold_outs:
        options, lines = ["--hold-outs"], hold_out_lines(rows, given.mark, given.variants)
    else:
        names = [n for n in splits.TRAIN_TZRB_PLUS if not (given.without_hold_outs and n in splits.DEVELOPMENT_HOLDOUT)]
        trials = read_trials(splits.find(names))
        labels, groups = grouped(trials)
        if given.folds == "day-kind":
            folds = [tuple(i for i, k in enumerate(labels) if k == label) for label in dict.fromkeys(labels)]
        else:
            folds = folds_by(labels, groups, int(given.folds))
        found, remarks = {}, []
        for variant in given.variants:
            found[variant], seconds, converged = cross_validated(rows, given.mark, variant, trials, folds)
            remarks.append(f"{variant}: {seconds:.0f} s a fit, {'all' if converged else 'NOT all'} converged")
        lines = [
            f"{len(trials)} records in {len(folds)} folds, refitted in full; mean of files ± jackknife error over "
            "files; in brackets the change against the first variant and its error. " + "; ".join(remarks) + ".",
            "",
            *lines_of(found),
        ]
    command = " ".join(["python -m benchmarks.cross_validation", *given.variants, *options])
    if given.title:
        record(given.title, command, lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
