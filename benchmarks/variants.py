"""What memory, estimated initial states, jittering, slicing and the loss bring a black box on Train-TZRB.

Run from the repository root: python -m benchmarks.variants [SEEDS]. The sets of Wakita et al. (2024) are trained on
every second trial, d-ref on all of them.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from benchmarks.record import record, table
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from fitting.prediction.score import pooled_sigma, score
from residual.comparison.tables import mean_and_std
from residual.pipeline import train
from residual.settings import BlackBoxSettings
from residual.training.augmentation import SETS

BASE = BlackBoxSettings(kind="rnn-window", seeds=3, workers=2)
VARIANTS = {
    "as by default, m = 2": BASE,
    "m = 1, no memory": replace(BASE, memory=1),
    "m = 5": replace(BASE, memory=5),
    "standard, Eq. 7": replace(BASE, kind="rnn"),
    "initial state from 5 rows": replace(BASE, initial=5),
    "jittering at every step": replace(BASE, jitter=1.0),
    "acceleration loss, Eq. 16": replace(BASE, loss="acceleration"),
    "no penalty": replace(BASE, penalty=0.0),
}
STEPS = 600
"""Epochs of ref; the other sets get as many gradient steps."""


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    ship, trials = load_ship("esso_osaka_3m"), read_trials(splits.find(splits.TRAIN_TZRB))
    tests = read_trials(splits.find(splits.DEVELOPMENT_HOLDOUT))
    sigma, rows = pooled_sigma(tests), []
    cases = {name: (training, trials) for name, training in VARIANTS.items()}
    for name in SETS:
        some, times = (trials, 2) if name == "d-ref" else (trials[::2], 1)
        training = replace(BASE, augment=name, epochs=max(1, STEPS // (times * SETS[name].factor)))
        cases[f"{name}, {sum(t.duration for t in some):.0f} s"] = training, some
    for name, (training, some) in cases.items():
        trained = train(ship, some, settings=replace(training, seeds=seeds))
        box = trained.black_box
        assert box is not None
        found = [score(replace(box, systems=(system,)), tests, sigma) for system in box.systems]
        mean = score(box, tests, sigma)
        rows.append(
            [
                name,
                mean_and_std([row["judged_window"]["after"] for row in trained.per_seed]),
                mean_and_std([s.window for s in found]),
                mean_and_std([s.paper for s in found]),
                f"{mean.window:.3f}",
                f"{sum(row['seconds'] for row in trained.per_seed) / seeds:.0f}",
            ]
        )
        print(" | ".join(rows[-1]), flush=True)
    header = ["variant of rnn-window", "windows to stop by", "30 s windows", "100 s restarts", "mean of seeds", "s"]
    lines = [
        f"Train-TZRB against the five development hold-outs, {seeds} seeds, mean ± standard deviation; 30 s windows of "
        "the mean of the seeds' trajectories; seconds per training. The sets (ref ... sli10+jit10) are trained on "
        "every second trial, d-ref on all, with as many gradient steps each.",
        "",
        *table(header, rows),
    ]
    record(
        "What memory, initial states, augmentation and the loss bring a black box",
        "python -m benchmarks.variants",
        lines,
    )


if __name__ == "__main__":
    main()
