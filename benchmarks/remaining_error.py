"""What the error that calibration leaves in 30 s windows is made of: structure, memory, inflow, gusts, or none of them.

Run from the repository root: python -m benchmarks.remaining_error [RUN]
RUN is a folder of ``mmg fit esso_osaka_3m`` on Train-TZRB, whose ship is looked at without the refits of "Structure".
Fitted on Train-TZRB, looked at on the records of Train-TZRB+ that are neither in it nor development hold-outs.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import spearmanr

from benchmarks.record import record, table
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.prediction.predict import record_of, window_rows
from fitting.prediction.score import pooled_sigma
from fitting.prediction.stretches import FadingCurrent, Stretch, WindowBatch, rollout
from mmg.rollout import Simulator
from mmg.ship import Ship

LASTING = 1e6
"""Seconds: a current or force that does not change within a window."""
DUPLICATE = "turn_14-Sep-2020_15_58_08"
"""Its first part is in Train-TZRB under another name."""
STRUCTURE = ((), ("velocity_filter",), ("velocity_filter", "gyro"), ("velocity_filter", "antenna_offset"),
             ("velocity_filter", "hull_memory"), ("velocity_filter", "rudder_lag"),
             ("velocity_filter", "rudder_offset"), ("velocity_filter", "propeller_side_force"))  # fmt: skip


def validation_names() -> list[str]:
    """The records on which settings may be chosen."""
    used = {*splits.TRAIN_TZRB, *splits.DEVELOPMENT_HOLDOUT, DUPLICATE}
    return [name for name in splits.TRAIN_TZRB_PLUS if name not in used]


@dataclass(frozen=True)
class Look:
    """Windows of trials with the errors (N + 1, 6, M) of a ship, in units of sigma (6,), NaN beyond their end."""

    simulator: Simulator
    windows: list[Stretch]
    trial: np.ndarray
    sigma: np.ndarray
    error: np.ndarray

    @classmethod
    def at(cls, ship: Ship, trials: list[Trial], sigma: np.ndarray, stride: float) -> Look:
        simulator = Simulator(ship)
        windows, trial = [], []
        for i, t in enumerate(trials):
            r = record_of(t, ship.inputs)
            rows = [(a, b) for a, b in window_rows(t.t, 30.0, stride, False) if r.good[a : b + 1].all()]
            windows += [Stretch(r, a, b) for a, b in rows]
            trial += [i] * len(rows)
        look = cls(simulator, windows, np.array(trial), sigma, np.empty(0))
        return replace(look, error=look.errors())

    def errors(self, inputs: np.ndarray | None = None, **options: object) -> np.ndarray:
        """Errors in units of sigma; inputs (N, C, M) replace the recorded ones, options as of ``rollout``."""
        batch = WindowBatch.of(self.windows)
        if inputs is not None:
            batch = replace(batch, inputs=inputs)
        out = rollout(self.simulator, batch, **options)[0]  # type: ignore[arg-type]
        error = np.full(out.shape, np.nan)
        for i, s in enumerate(self.windows):
            error[: s.last - s.first + 1, :, i] = out[: s.last - s.first + 1, :, i] - s.logged
        error[:, 2] = np.pi - np.mod(np.pi - error[:, 2], 2 * np.pi)
        return error[1:] / self.sigma[:, None]

    def mean(self, error: np.ndarray | None = None) -> np.ndarray:
        """Mean square by state (6,)."""
        return np.nanmean((self.error if error is None else error) ** 2, axis=(0, 2))


def pushed(look: Look, kind: str, size: float) -> np.ndarray:
    """Errors (N, 6, M) under one constant disturbance of this size in every window."""
    batch, model = WindowBatch.of(look.windows), look.simulator.model
    M = len(look.windows)
    if kind.startswith("current"):
        velocity = np.zeros((2, M))
        velocity[0 if kind.endswith("north") else 1] = size
        return look.errors(water=FadingCurrent(velocity, LASTING))
    if kind.startswith("force"):
        offset = np.zeros((len(model.states) - 6, M))
        offset[model.states.index(f"disturbance.{kind[-1]}") - 6] = size
        return look.errors(offset=offset)
    inputs = batch.inputs.copy()
    column = {"wind north": "wind_north", "wind east": "wind_east", "rudder": "delta"}[kind]
    inputs[:, model.controls.index(column)] += size
    return look.errors(inputs)


KINDS = {"current": {"current north": 0.01, "current east": 0.01}, "wind bias": {"wind north": 0.1, "wind east": 0.1},
         "rudder bias": {"rudder": 0.01}, "yaw moment": {"force N": 0.3}, "sway force": {"force Y": 0.3},
         "sway force and yaw moment": {"force Y": 0.3, "force N": 0.3}}  # fmt: skip


def hindsight(look: Look, pushes: dict[str, float]) -> tuple[float, float, np.ndarray]:
    """Share of the (linearised) error that constants of each window, and that constants of all, remove; constants."""
    e0 = np.nan_to_num(look.error)
    J = np.array([np.nan_to_num((pushed(look, k, s) - look.error) / s) for k, s in pushes.items()])
    H = np.einsum("ansm,bnsm->mab", J, J) + 1e-9 * np.eye(len(J))
    g = -np.einsum("ansm,nsm->ma", J, e0)
    own = np.linalg.solve(H, g[..., None])[..., 0]
    left = e0 + np.einsum("ansm,ma->nsm", J, own)
    common = np.linalg.solve(H.sum(axis=0), g.sum(axis=0))
    all_left = e0 + np.einsum("ansm,a->nsm", J, common)
    total = (e0**2).sum()
    return 1 - (left**2).sum() / total, 1 - (all_left**2).sum() / total, own


def successive(values: np.ndarray, trial: np.ndarray, apart: int = 1) -> float:
    """Rank correlation of values (M,) of windows with those ``apart`` windows later in the same trial."""
    same = trial[apart:] == trial[:-apart]
    a, b = values[:-apart][same], values[apart:][same]
    return correlation(a, b)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Spearman's rank correlation."""
    good = np.isfinite(a) & np.isfinite(b)
    return float(spearmanr(a[good], b[good]).statistic)


def circumstances(look: Look) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Signed and unsigned circumstances of each window (M,)."""
    names = list(look.simulator.model.controls)
    signed, unsigned = [], []
    for w in look.windows:
        z, c = w.logged, w.record.controls[w.first : w.last + 1]
        n, delta, north, east = (c[:, names.index(i)] for i in ("n", "delta", "wind_north", "wind_east"))
        across = np.cos(z[:, 2]) * east - np.sin(z[:, 2]) * north
        half = len(across) // 2
        side = np.sign(delta[np.abs(delta) > 0.05])
        signed.append(
            {
                "mean turn rate": z[:, 5].mean(),
                "mean sway velocity": z[:, 4].mean(),
                "mean rudder angle": delta.mean(),
                "mean wind from port": across.mean(),
                "its change, second half less first": across[half:].mean() - across[:half].mean(),
            }
        )
        unsigned.append(
            {
                "speed": np.hypot(z[:, 3], z[:, 4]).mean(),
                "turn rate": np.abs(z[:, 5]).mean(),
                "wind speed": np.hypot(north, east).mean(),
                "variation of the wind": np.hypot(north.std(), east.std()),
                "rudder reversals": (np.diff(side) != 0).sum(),
                "share of n < 0": (n < 0).mean(),
                "share of n = 0": (n == 0).mean(),
            }
        )
    return _columns(signed), _columns(unsigned)


def _columns(rows: list[dict]) -> dict[str, np.ndarray]:
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}


def gusts(look: Look) -> list[list[str]]:
    """The metric with the recorded wind, with its mean over each window, and without wind."""
    batch, names = WindowBatch.of(look.windows), list(look.simulator.model.controls)
    at = [names.index("wind_north"), names.index("wind_east")]
    mean, none = batch.inputs.copy(), batch.inputs.copy()
    mean[:, at] = batch.inputs[:, at].mean(axis=0)
    none[:, at] = 0.0
    rows = [["as recorded", look.error]]
    rows += [["its mean over the window", look.errors(mean)], ["calm air", look.errors(none)]]
    return [[str(name), *_by_state(look.mean(np.asarray(e)))] for name, e in rows]


def _by_state(mean: np.ndarray) -> list[str]:
    return [f"{mean.sum():.4f}", *[f"{m:.4f}" for m in mean[2:]]]


def main() -> None:
    start = load_ship("esso_osaka_3m")
    train, trials = (read_trials(splits.find(n)) for n in (splits.TRAIN_TZRB, validation_names()))
    sigma = pooled_sigma(trials)
    lines = [
        f"Fitted on Train-TZRB, {len(trials)} other records of Train-TZRB+ (no development hold-out), 30 s windows.",
        "Mean square error in units of the records' sigma, sum over six states and the four that matter.",
        "",
    ]
    states = ["sum", "psi", "u", "v", "r"]
    if len(sys.argv) > 1:
        chosen = load_ship(sys.argv[1])
    else:
        chosen, words = _structure(start, train, trials, sigma)
        lines += ["**Structure**: refitted with effects freed.", "", *table(["effects", *states], words), ""]
    look = Look.at(
        chosen.with_effect("disturbance", {"X": 1.0, "Y": 1.0, "N": 1.0, "tau": LASTING}), trials, sigma, 30.0
    )
    lines += ["**Gusts**: the velocity-lag ship with the wind smoothed out.", ""]
    lines += [*table(["wind", *states], gusts(look)), ""]
    rows = []
    for name, pushes in KINDS.items():
        own, common, constants = hindsight(look, pushes)
        lasting = ", ".join(f"{successive(c, look.trial):+.2f}" for c in constants.T)
        rows.append([name, f"{100 * own:.0f} %", f"{100 * common:.1f} %", lasting])
    lines += ["**Inflow and forces**: constants of a window, with hindsight (linearised), windows every 30 s.", ""]
    header = ["constant", "removed by one per window", "by one for all", "rank correlation with the next window"]
    lines += [*table(header, rows), ""]
    lines += _correlations(look)
    record(
        "What the remaining error is made of", " ".join(["python -m benchmarks.remaining_error", *sys.argv[1:]]), lines
    )


def _structure(start: Ship, train: list[Trial], trials: list[Trial], sigma: np.ndarray) -> tuple[Ship, list[list[str]]]:
    """The ship with the velocity lag, and what refits with further effects leave."""
    rows, chosen = [], start
    for effects in STRUCTURE:
        fitted = estimate_coefficients(freeing_effects(start, list(effects)), train).ship
        chosen = fitted if effects == ("velocity_filter",) else chosen
        rows.append([" + ".join(effects) or "none", *_by_state(Look.at(fitted, trials, sigma, 15.0).mean())])
        print(rows[-1], flush=True)
    return chosen, rows


def _correlations(look: Look) -> list[str]:
    """Lines on what goes with the errors at the end of the windows, and on how long these last."""
    end = look.error[-1]
    signed, unsigned = circumstances(look)
    limit = 2 / np.sqrt(end.shape[1])
    rows = [[k, *[f"{correlation(v, end[s]):+.2f}" for s in (2, 3, 4, 5)]] for k, v in signed.items()]
    rows += [[f"size of the error, {k}", *[f"{correlation(v, np.abs(end[s])):+.2f}" for s in (2, 3, 4, 5)]]
             for k, v in unsigned.items()]  # fmt: skip
    rows += [["the error of the next window", *[f"{successive(end[s], look.trial):+.2f}" for s in (2, 3, 4, 5)]]]
    rows += [["its size", *[f"{successive(np.abs(end[s]), look.trial):+.2f}" for s in (2, 3, 4, 5)]]]
    words = f"**Circumstances**: rank correlation with the error at the end of a window (chance: below {limit:.2f})."
    return [words, "", *table(["", "psi", "u", "v", "r"], rows)]


if __name__ == "__main__":
    main()
