"""Other ways to use the past of a window: forces, an offset of the wind, a corrected start, other constants.

``python -m benchmarks.past_variants RUN``: RUN is a calibration on Train-TZRB; judged on the other records of
Train-TZRB+ but the five development hold-outs, which no variant sees. Windows of 30 s every 15 s, restarts every 100 s,
30 s of past, mean of files; in brackets the change against the default, the fitted current, its jackknife error over
files. "forces" and "wind" are estimated along with the current, by the same equations, and decay in the forecast: body
forces X, Y, N as of the ``disturbance`` effect, velocities of the air in the earth frame. "start" moves the measured
velocities of the start towards what restarts 1, 2 and 3 s before predict for it, as a filter would.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.record import record, table
from benchmarks.remaining_error import validation_names
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.prediction.adaptation import ROBUST, Adaptation, adapt, past_begin, restarts
from fitting.prediction.predict import record_of, values_of, window_rows
from fitting.prediction.score import pooled_sigma
from fitting.prediction.stretches import FadingCurrent, Stretch, WindowBatch, rollout, wrapped_error
from fitting.selection.left_out_runs import relative_change
from mmg.rollout import Simulator
from mmg.ship import Ship

PAST = 30.0
UNITS = {"X": 0.15, "Y": 0.15, "N": 0.1125}
"""Typical sizes of the forces [N, N m] of the 3 m model; estimates count in these."""
LENGTHS = ((30.0, 15.0), (100.0, 100.0))


@dataclass(frozen=True)
class Variant:
    """Prior sizes of the forces [typical ones] and of the wind's offset [m/s], and the time in which they decay [s];
    start: share by which the start is moved; change: of the constants of ``Adaptation``."""

    forces: float = 0.0
    wind: float = 0.0
    decay: float = 20.0
    start: float = 0.0
    change: tuple[tuple[str, float], ...] = ()

    def words(self) -> str:
        """What it is."""
        parts = [f"forces {self.forces:g}, decay {self.decay:g} s"] if self.forces else []
        parts += [f"wind {self.wind:g} m/s, decay {self.decay:g} s"] if self.wind else []
        parts += [f"start {self.start:g}"] if self.start else []
        return ", ".join([*parts, *(f"{name} {value:g}" for name, value in self.change)]) or "current (default)"


VARIANTS = (
    Variant(), Variant(forces=0.3), Variant(forces=0.8), Variant(forces=0.3, decay=60), Variant(forces=0.8, decay=60),
    Variant(wind=0.2), Variant(wind=0.5), Variant(wind=0.2, decay=60), Variant(wind=0.5, decay=60),
    Variant(start=0.25), Variant(start=0.5),
    *(Variant(change=(c,)) for c in (("size", 0.01), ("size", 0.03), ("decay", 60.0), ("decay", 300.0),
      ("forget", 8.0), ("forget", 30.0), ("restart", 5.0), ("restart", 12.0), ("restart", 15.0))),
    Variant(change=(("seconds", 60.0), ("forget", 30.0))), Variant(forces=0.8, change=(("size", 1e-6),)),
)  # fmt: skip


def windows_of(ship: Ship, trials: Sequence[Trial], length: float, stride: float) -> tuple[list[Stretch], np.ndarray]:
    """Whole windows of the trials and the number of the trial of each."""
    found, number = [], []
    for i, trial in enumerate(trials):
        r = record_of(trial, ship.inputs, values_of(ship, trial))
        rows = [(a, b) for a, b in window_rows(trial.t, length, stride, length > 50) if r.good[a : b + 1].all()]
        found += [Stretch(r, a, b) for a, b in rows]
        number += [i] * len(rows)
    return found, np.array(number)


class Pushed:
    """Stretches under a current, forces and an offset of the wind."""

    def __init__(self, simulator: Simulator, variant: Variant) -> None:
        self.simulator, self.variant, states = simulator, variant, simulator.model.states
        self.force = [states.index(f"disturbance.{axis}") - 6 for axis in UNITS]
        self.air = simulator.model.controls.index("wind_north")

    def out(
        self, batch: WindowBatch, current: np.ndarray, fade: float, more: np.ndarray, offset: np.ndarray, decay: float
    ) -> np.ndarray:
        """Logged columns (N + 1, 6, M) under a current (2, M) that fades in ``fade`` [s], and ``more`` (5, M): forces,
        wind, which decays in ``decay`` [s]; offset (S - 6, M) of the memory."""
        inputs, beyond = batch.inputs.copy(), offset.copy()
        inputs[:, self.air : self.air + 2] += more[3:] * np.exp(-batch.times[:-1] / decay)[:, None]
        beyond[self.force] = more[:3]
        return rollout(self.simulator, replace(batch, inputs=inputs), FadingCurrent(current, fade), beyond)[0]

    def estimated(self, windows: Sequence[Stretch], a: Adaptation) -> np.ndarray:
        """Current, forces and wind (7, M) at the start of the windows."""
        pasts = [(i, p) for i, w in enumerate(windows) for p in restarts(w.record, w.first, a)]
        prior = np.array([a.size] * 2 + [self.variant.forces] * 3 + [self.variant.wind] * 2)
        unit = np.array([0.5 * a.size] * 2 + [1.0] * 3 + [0.2] * 2)
        H, g = np.zeros((len(windows), 7, 7)), np.zeros((len(windows), 7))
        for begin in range(0, len(pasts), 400):
            part = pasts[begin : begin + 400]
            K, batch = len(part), WindowBatch.of([p for _, p in part])
            probe = np.repeat(np.hstack([np.zeros((7, 1)), np.diag(unit)]), K, axis=1)
            still = np.zeros((len(self.simulator.model.states) - 6, 8 * K))
            out = self.out(batch.times_over(8), probe[:2], 1e3 * a.decay, probe[2:], still, 1e3 * a.decay)
            for k, (i, piece) in enumerate(part):
                J, e, w = equations(out[:, :, k::K], piece, windows[i], a, unit)
                H[i] += np.einsum("ans,ns,bns->ab", J, w, J)
                g[i] -= np.einsum("ans,ns,ns->a", J, w, e)
        D = np.diag(prior**2)
        return (D @ np.linalg.solve(np.eye(7) + H @ D, g[..., None]))[..., 0].T


def equations(
    out: np.ndarray, piece: Stretch, window: Stretch, a: Adaptation, unit: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sensitivities (7, n, 6), errors (n, 6) and weights (n, 6) of a restart, as ``fitting.prediction.adaptation``."""
    t, rows = piece.record.t[piece.first : piece.last + 1], piece.last - piece.first
    every = max(1, round(0.1 * a.restart * rows / float(t[-1] - t[0])))
    at = np.arange(rows, 0, -every)[::-1]
    error = wrapped_error(out[at, :, 0], piece.logged[at])
    J = np.moveaxis(out[at, :, 1:] - out[at, :, :1], 2, 0) / unit[:, None, None]
    age = window.record.t[window.first] - t[at]
    share = every * (t[-1] - t[0]) / rows / a.restart
    weight = share * np.exp(-2 * age / a.forget)[:, None] * ROBUST / np.maximum(np.abs(error) / a.errors, ROBUST)
    return J, error, weight / a.errors**2


def start_errors(simulator: Simulator, windows: Sequence[Stretch], water: FadingCurrent) -> np.ndarray:
    """Predicted less measured u, v, r at the starts (6, M), mean of restarts 1, 2 and 3 s before."""
    total, count = np.zeros((6, len(windows))), np.zeros(len(windows))
    for seconds in (1.0, 2.0, 3.0):
        begun = [(i, past_begin(w.record, w.first, seconds)) for i, w in enumerate(windows)]
        kept = [(i, Stretch(windows[i].record, b, windows[i].first)) for i, b in begun if b < windows[i].first]
        at = [i for i, _ in kept]
        out = rollout(simulator, WindowBatch.of([s for _, s in kept]), FadingCurrent(water.velocity[:, at], 1e4))[0]
        for k, (i, s) in enumerate(kept):
            total[3:, i] += out[s.last - s.first, 3:, k] - s.logged[-1, 3:]
            count[i] += 1
    return total / np.maximum(count, 1)


def scores(ship: Ship, trials: Sequence[Trial], sigma: np.ndarray, variant: Variant) -> list[np.ndarray]:
    """Mean error of the 30 s windows, and of the 100 s restarts, of each trial (R,)."""
    sizes = {**UNITS, "tau": variant.decay}
    simulator, found = Simulator(ship.with_effect("disturbance", sizes)), []
    pushed, a = Pushed(simulator, variant), replace(Adaptation.of(ship, PAST), **dict(variant.change))
    for length, stride in LENGTHS:
        windows, number = windows_of(simulator.ship, trials, length, stride)
        water, offset = adapt(simulator, windows, a)
        batch, more = WindowBatch.of(windows), np.zeros((5, len(windows)))
        if variant.forces or variant.wind:
            both = pushed.estimated(windows, a)
            water, more = replace(water, velocity=both[:2]), both[2:]
        if variant.start:
            moved = variant.start * start_errors(simulator, windows, water)
            batch = replace(batch, logged=batch.logged + moved)
        out = pushed.out(batch, water.velocity, water.decay, more, offset, variant.decay)
        own = [np.mean((wrapped_error(out[1 : w.last - w.first + 1, :, k], w.logged[1:]) / sigma) ** 2, axis=0).sum()
               for k, w in enumerate(windows)]  # fmt: skip
        found.append(np.array([np.mean(np.array(own)[number == i]) if (number == i).any() else np.nan
                               for i in range(len(trials))]))  # fmt: skip
    return found


def main() -> None:
    trials = read_trials(splits.find(validation_names()))
    ship, sigma = load_ship(sys.argv[1]), pooled_sigma(trials)
    of = partial(scores, ship, trials, sigma)
    first, body = of(Variant()), []
    for variant in VARIANTS:
        cells = []
        for before, after in zip(first, of(variant), strict=True):
            c = relative_change(before, after)
            cells.append(f"{np.nanmean(after):.4f} ({c.value:+.1%} ± {c.error:.1%})")
        body.append([variant.words(), *cells])
        print(body[-1], flush=True)
    lines = [f"{len(trials)} records.", "", *table(["variant", "30 s windows", "100 s restarts"], body)]
    record("Other ways to use the past of a window", "python -m benchmarks.past_variants RUN", lines)


if __name__ == "__main__":
    main()
