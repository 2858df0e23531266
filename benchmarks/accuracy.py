"""Captive and calibrated ESSO OSAKA on the five development hold-outs.

Run from the repository root: python -m benchmarks.accuracy
"""

from __future__ import annotations

from benchmarks.record import record, table
from cases import splits
from cases.read import read_trials
from cases.ships import load_ship
from fitting.calibration import Settings, calibrate
from fitting.score import pooled_sigma, score
from mmg.rollout import Simulator


def main() -> None:
    ship = load_ship("esso_osaka_3m")
    held_out = read_trials(splits.find(splits.DEVELOPMENT_HOLDOUT))
    sigma = pooled_sigma(held_out)
    train = {
        "TZRB": splits.TRAIN_TZRB,
        "TZRB+ without them": [n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT],
    }
    scores = {"captive": score(Simulator(ship), held_out, sigma)}
    for name, names in train.items():
        fitted = calibrate(ship, read_trials(splits.find(list(names))), Settings()).ship
        scores[name] = score(Simulator(fitted), held_out, sigma)
    rows = []
    for i, trial in enumerate(scores["captive"].trials):
        rows.append([trial.name, *[f"{s.trials[i].paper:.4f} / {s.trials[i].window:.4f}" for s in scores.values()]])
    rows.append(["pooled", *[f"{s.paper:.4f} / {s.window:.4f}" for s in scores.values()]])
    captive = scores["captive"]
    rows.append(
        [
            "captive / this",
            *[f"{captive.paper / s.paper:.2f} / {captive.window / s.window:.2f}" for s in scores.values()],
        ]
    )
    lines = [
        "100 s restarts (Eq. 25) / 30 s windows; sigma pooled over the five files. Nothing was selected on them.",
        "",
    ]
    lines += table(["hold-out", *[s if s == "captive" else f"calibrated on {s}" for s in scores]], rows)
    record("Accuracy on the development hold-outs", "python -m benchmarks.accuracy", lines)


if __name__ == "__main__":
    main()
