"""How well ``mmg_ident.Tracker`` forecasts the next minute of the five hold-outs, and how long a sample takes it.

The ship is fitted on Train-TZRB. Windows of 60 s every 15 s are predicted open loop from the measured state, with 30 s
of past as ``mmg predict --adapt 30`` does, and by a tracker that has been fed all samples until their start. Errors are
those of ``mmg score``: squares in units of the sigma of the states, summed over these.

Run from the repository root: python -m benchmarks.tracker [--record]
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from benchmarks.accuracy import NORMAL, PAST, SHIP, trials_of
from benchmarks.record import Figure, parser_of, report
from cases.io import published_splits as splits
from cases.io.campaigns import campaign_among
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibrate import FitOptions
from fitting.prediction.bands import bands_of
from fitting.prediction.predict import Window, predict
from fitting.prediction.score import pooled_sigma
from fitting.result import FitResult
from mmg.rollout import Simulator
from mmg_ident.api import calibrate
from mmg_ident.tracker import Tracker

WINDOW, STRIDE = 60.0, 15.0
SAMPLES, REPEATS = 1000, 5
"""Of the timing, of which the fastest repetition counts."""


def tracked(fit: FitResult, trial: Trial, windows: Sequence[Window]) -> list[Window]:
    """The ``windows`` of a ``trial``, forecast by a tracker that has seen all samples until their start."""
    tracker = Tracker(fit, campaign=campaign_among(trial, fit.ship.campaigns))
    states, controls = trial.states, np.column_stack([trial[name] for name in tracker.inputs])
    begins, found = {w.first: w for w in windows}, []
    for k in np.flatnonzero(np.isfinite(controls).all(axis=1)).tolist():
        tracker.update(trial.t[k], states[k], controls[k])
        if (w := begins.get(k)) is not None:
            made = tracker.forecast(trial.t[w.last] - trial.t[k], controls[k : w.last])
            found.append(Window(w.number, w.first, w.last, made.states, made.std))
    return found


def forecasts() -> dict[str, Figure]:
    """Errors and coverage on the hold-outs."""
    fit = calibrate(SHIP, trials_of(splits.TRAIN_TZRB), (), None, FitOptions(next_trial=False))
    held, simulator, bands = (
        trials_of(splits.DEVELOPMENT_HOLDOUT),
        Simulator(fit.ship),
        bands_of(fit.to_dict(), fit.ship),
    )
    sigma = pooled_sigma(held)
    words = {"open": "from the measured state", "past": f"with {PAST:g} s of past", "tracker": "Tracker"}
    errors: dict[str, list[np.ndarray]] = {name: [] for name in words}
    inside: dict[str, list[np.ndarray]] = {name: [] for name in words}
    for trial in held:
        made = {"open": predict(simulator, trial, WINDOW, STRIDE, False, bands=bands)[0]}
        made["past"] = predict(simulator, trial, WINDOW, STRIDE, False, past=PAST, bands=bands)[0]
        made["tracker"] = tracked(fit, trial, made["open"])
        for name, windows in made.items():
            error = np.concatenate([w.error(trial.states)[1:] for w in windows])
            std = np.concatenate([np.zeros((0, 6)) if w.std is None else w.std[1:] for w in windows])
            known = np.isfinite(error).all(axis=1)
            errors[name].append(((error / sigma) ** 2)[known].sum(axis=1))
            inside[name].append((np.abs(error) < NORMAL * std)[known])
        shown = (" / ".join(f"{rows[-1].mean():.4f}" for rows in kind.values()) for kind in (errors, inside))
        print(f"{trial.name}: {'; inside '.join(shown)}", flush=True)
    what, cover, figures = "hold-outs, 60 s windows", "rows inside the 90 % band, hold-outs, 60 s", {}
    for name, by in words.items():
        mean = float(np.mean([rows.mean() for rows in errors[name]]))
        share = float(np.concatenate(inside[name]).mean())
        figures[f"minute_{name}"] = Figure(f"{what}, pooled: {by}", float(np.concatenate(errors[name]).mean()))
        figures[f"minute_files_{name}"] = Figure(f"{what}, mean of files: {by}", mean)
        figures[f"minute_bands_{name}"] = Figure(f"{cover}, pooled: {by}", share, "%")
    return figures


def update_time() -> dict[str, Figure]:
    """Processor time of a sample of a ship of three degrees of freedom."""
    tracker, times = Tracker(load_ship(SHIP), {"X_0F": 0.003}), []
    for repeat in range(REPEATS):
        began = time.process_time()
        for k in range(SAMPLES):
            t = 0.1 * (repeat * SAMPLES + k)
            tracker.update(t, np.array([0.4 * t, 0, 0, 0.4, 0, 0]), np.array([10.0, 0.0, 2.0, 1.0]))
        times.append((time.process_time() - began) / SAMPLES)
    what = "`Tracker.update`, six states and six random ones, processor"
    return {"tracker_update": Figure(what, 1e3 * min(times), "ms")}


def main() -> None:
    """Measure, print and, if asked, record."""
    given = parser_of("tracker", __doc__).parse_args()
    report(update_time() | forecasts(), "tracker", given.record)


if __name__ == "__main__":
    main()
