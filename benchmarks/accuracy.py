"""Captive and calibrated ESSO OSAKA on the five development hold-outs: scores, adaptation, prediction bands.

Run from the repository root: python -m benchmarks.accuracy
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.record import record, table
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.pipeline import coefficient_rows, correlation_of, prediction_bands
from fitting.prediction.adaptation import Adaptation
from fitting.prediction.band_calibration import NORMAL
from fitting.prediction.bands import bands_of
from fitting.prediction.predict import predict_all
from fitting.prediction.score import Score, pooled_sigma, score
from fitting.report.run_folder import plain
from mmg.rollout import Simulator
from mmg.states import STATES

PAST = 30.0


def inside(
    found: Calibration, train: Sequence[Trial], held_out: Sequence[Trial], length: float, stride: float, past: float
) -> list[str]:
    """Share of rows after the first inside the 90 % band, by state."""
    simulator = Simulator(found.ship)
    known = {"coefficients": coefficient_rows(found), "correlation": correlation_of(found)}
    bands = bands_of(plain(known) | {"bands": prediction_bands(found, simulator, train)}, found.ship)
    adaptation = Adaptation.of(found.ship, past) if past else None
    hit, count = np.zeros(6), 0
    made = predict_all(simulator, held_out, length, stride, length > 50, adaptation=adaptation, bands=bands)
    for trial, (windows, _) in zip(held_out, made, strict=True):
        for w in windows:
            error = w.states - trial.states[w.first : w.last + 1]
            error[:, 2] = np.pi - np.mod(np.pi - error[:, 2], 2 * np.pi)
            assert w.std is not None
            hit += (np.abs(error[1:]) < NORMAL * w.std[1:]).sum(axis=0)
            count += len(error) - 1
    return [f"{share:.3f}" for share in hit / count]


def main() -> None:
    start = load_ship("esso_osaka_3m")
    late = freeing_effects(start, ["velocity_filter"])
    held_out = read_trials(splits.find(splits.DEVELOPMENT_HOLDOUT))
    sigma = pooled_sigma(held_out)
    small = read_trials(splits.find(splits.TRAIN_TZRB))
    names = [n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT]
    large = read_trials(splits.find(names))
    plain, lag, more = (
        estimate_coefficients(start, small),
        estimate_coefficients(late, small),
        estimate_coefficients(late, large),
    )
    scores: dict[str, Score] = {"captive": score(Simulator(start), held_out, sigma)}
    for name, found in (
        ("TZRB, --measurement none", plain), ("TZRB (default: velocity lag)", lag), ("TZRB+ without them", more),
    ):  # fmt: skip
        scores[name] = score(Simulator(found.ship), held_out, sigma)
        if found is not plain:
            scores[f"{name}, --adapt {PAST:g}"] = score(Simulator(found.ship), held_out, sigma, adapt=PAST)
    rows = []
    for i, trial in enumerate(scores["captive"].trials):
        rows.append([trial.name, *[f"{s.trials[i].paper:.4f} / {s.trials[i].window:.4f}" for s in scores.values()]])
    rows.append(["pooled", *[f"{s.paper:.4f} / {s.window:.4f}" for s in scores.values()]])
    for reference in list(scores)[:2]:
        r = scores[reference]
        factors = [f"{r.paper / s.paper:.2f} / {r.window / s.window:.2f}" for s in scores.values()]
        rows.append([f"{reference} / this", *factors])
    lines = [
        "100 s restarts (Eq. 25) / 30 s windows; sigma pooled over the five files. Nothing was selected on them.",
        "",
        *table(["hold-out", *scores], rows),
        "",
        "Share of the hold-outs' rows inside the 90 % band, ship calibrated on TZRB:",
        "",
    ]
    kinds = [(30.0, 15.0, 0.0), (30.0, 15.0, PAST), (100.0, 100.0, 0.0), (100.0, 100.0, PAST)]
    rows = [
        [f"{length:g} s{f', --adapt {past:g}' if past else ''}", *inside(lag, small, held_out, length, stride, past)]
        for length, stride, past in kinds
    ]
    lines += table(["windows", *STATES], rows)
    record("Accuracy on the development hold-outs", "python -m benchmarks.accuracy", lines)


if __name__ == "__main__":
    main()
