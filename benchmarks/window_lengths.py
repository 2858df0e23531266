"""Do runs left out tell which windows are best? Half and twice the usual windows, on ships of three generators.

Each case of ``benchmarks.residual_promise`` (nine zigzags of a 7 m ship; Train-TZRB) is calibrated with the usual
windows and with others; runs left out of both compare them (30 s windows and 100 s restarts, mean over runs of the
logarithm of the change), and fresh runs say what is obtained.

Run from the repository root: python -m benchmarks.window_lengths [WORLD:SEED ...] [--record].
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from benchmarks.record import record, table
from benchmarks.residual_promise import case_of
from cases.shipfiles.model_changes import with_instruments
from fitting.calibration import estimate_coefficients
from fitting.prediction.score import pooled_sigma, score
from fitting.selection.left_out_runs import apart, leave_out
from fitting.selection.robust_choice import log_change
from fitting.settings import Settings
from mmg.rollout import Simulator

CASES = ("cross:42", "foreign:0", "cross:41", "own:42", "foreign:3", "records:0")
FACTORS = (0.5, 2.0)


def rows_of(name: str) -> list[list[str]]:
    """A row for each other length of windows of the case ``name``."""
    ship, runs, judges = case_of(name)
    judges.pop("hold-outs", None)  # nothing is chosen by them
    ship, sigma, folds = with_instruments(ship, ("velocity_filter",)), pooled_sigma(runs), apart(runs)
    usual = estimate_coefficients(ship, runs, Settings(loss=None, weight=None))
    before, rows = leave_out(usual, runs, folds, sigma), []
    for factor in FACTORS:
        assert usual.settings.window is not None
        settings = replace(usual.settings, window=factor * usual.settings.window, passes=2)
        other = estimate_coefficients(ship, runs, settings, warm={"p": usual.p})
        change, told = log_change(before, leave_out(other, runs, folds, sigma)), []
        for words, trials in judges.items():
            a, b = (score(Simulator(found.ship), trials, sigma) for found in (usual, other))
            told.append(f"{words} {b.window / a.window - 1:+.0%} ({b.paper / a.paper - 1:+.0%})")
        lengths = f"{usual.settings.window:g} -> {settings.window:g} s"
        rows.append([name, lengths, f"{change.value:+.3f} ± {change.error:.3f}", ", ".join(told)])
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.window_lengths", description=__doc__)
    parser.add_argument("cases", nargs="*", default=CASES, metavar="WORLD:SEED")
    parser.add_argument("--record", action="store_true", help="keep the table in RESULTS.md")
    given = parser.parse_args()
    head = ["case", "windows", "runs left out, log of the change", "fresh runs, 30 s windows (100 s restarts)"]
    lines = table(head, [row for name in given.cases for row in rows_of(name)])
    if given.record:
        record("Windows by runs left out", "python -m benchmarks.window_lengths " + " ".join(given.cases), lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
