"""Ensembles of the hybrid and of the pure network on Train-TZRB: how well their spread tells the error of unseen runs.

Bands are calibrated on half of the runs of Train-TZRB+ that took no part in training, and judged on the rest, for
several random halves. TS1 and TS-infinity are compared by Eq. 31 of Wakita et al. (2025). Ends with the time of a
training step.
Run from the repository root: python -m benchmarks.ensemble
"""

from __future__ import annotations

import copy
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmarks.ensembles.casadi_to_torch import TorchPhysics
from benchmarks.ensembles.spread_calibration import Spread, calibrated, coverage
from benchmarks.ensembles.stacked import Stacked, losses, on
from benchmarks.record import record, table
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.nlp.grid import default_step
from mmg.ship import Ship
from mmg.states import STATES
from residual.blackbox.models import box_scales, build_box
from residual.ensemble import SAMPLINGS, distances, particles, train_members
from residual.physics.operator import Physics
from residual.rollout import RolloutBatch, state_loss
from residual.settings import BlackBoxSettings, TrainSettings
from residual.system import Hybrid, TrainableSystem
from residual.training.hybrid import build_hybrid, hybrid_scales
from residual.training.pieces import pieces_of
from residual.training.scales import Scales
from residual.training.windows import windows

MEMBERS, PARTICLES, WINDOW, STRIDE = 8, 40, 30.0, 15.0
COUSINS = "turn_14-Sep-2020_15_58_08"
"""Part of this run is in Train-TZRB, so it is no unseen run."""
REPEATS, COLUMNS, HALVES = 7, 64, 10


def unseen() -> list[str]:
    """Records of Train-TZRB+ that neither training, nor its part of a longer run, nor the hold-outs contain."""
    out = {*splits.TRAIN_TZRB, *splits.DEVELOPMENT_HOLDOUT, COUSINS}
    return sorted(name for name in splits.TRAIN_TZRB_PLUS if name not in out)


@dataclass(frozen=True)
class Runs:
    """Particles of an ensemble on the windows of some runs, by sampling; truth and mask (N + 1, 6, M)."""

    h: float
    paths: dict[str, np.ndarray]
    truth: np.ndarray
    mask: np.ndarray

    @classmethod
    def of(cls, members: Sequence[TrainableSystem], trial: Trial, inputs: Sequence[str], h: float) -> Runs | None:
        batch = windows(pieces_of([trial], h, inputs), h, round(WINDOW / h), round(STRIDE / h))
        if batch is None:
            return None
        paths = {s: particles(members, batch, PARTICLES, s) for s in SAMPLINGS}
        return cls(h, paths, batch.targets.numpy(), batch.mask.numpy())

    @classmethod
    def together(cls, runs: Sequence[Runs]) -> Runs:
        paths = {s: np.concatenate([r.paths[s] for r in runs], axis=-1) for s in SAMPLINGS}
        truth, mask = (np.concatenate([getattr(r, name) for r in runs], axis=-1) for name in ("truth", "mask"))
        return cls(runs[0].h, paths, truth, mask)

    def covered(self, sampling: str, spread: Spread | None) -> np.ndarray:
        """Share inside the band (6,); without a spread by the particles' own standard deviation."""
        paths = self.paths[sampling]
        std = np.sqrt(paths.var(axis=2)) if spread is None else spread.std(paths)
        return coverage(paths, self.truth, self.mask, std)


def coverage_rows(name: str, runs: Sequence[Runs]) -> list[list[str]]:
    """Coverage of unseen runs by the particles' own spread, by a factor on it, and with the common part."""
    rows = []
    for sampling in SAMPLINGS:
        for how in ("as it is", "factor", "factor and common part"):
            shares, factors = [], []
            for split in range(HALVES):
                order = np.random.default_rng([14, split]).permutation(len(runs))
                a, b = (Runs.together([runs[i] for i in half]) for half in np.array_split(order, 2))
                spread = None
                if how != "as it is":
                    spread = calibrated(a.paths[sampling], a.truth, a.mask, a.h, how != "factor")
                    factors.append(spread.factor)
                shares.append(b.covered(sampling, spread))
            mean, sd = np.mean(shares, axis=0), np.std(shares, axis=0)
            good = np.mean((np.array(shares) >= 0.85) & (np.array(shares) <= 0.95))
            said = " ".join(f"{f:.1f}" for f in np.median(factors, axis=0)) if factors else "-"
            cells = [f"{m:.3f} ({d:.3f})" for m, d in zip(mean, sd, strict=True)]
            rows.append([name, sampling, how, *cells, f"{good:.0%}", said])
    return rows


def distance_rows(name: str, runs: Runs, noise: np.ndarray) -> list[list[str]]:
    """Eq. 31 and correlations over all windows, without and with the noise of the instruments."""
    rows = []
    for sampling in SAMPLINGS:
        for added in (None, noise):
            whole = distances(runs.paths[sampling], runs.truth, runs.mask, added)
            e, m, v = whole.euclidean, whole.mahalanobis, whole.variance
            rows.append(
                [
                    name,
                    sampling,
                    "with" if added is not None else "without",
                    f"{np.sqrt(e.mean()):.4f}",
                    f"{np.sqrt(v.mean()):.4f}",
                    f"{np.sqrt(np.median(m)):.1f}",
                    f"{whole.correlation():.2f}",
                    f"{whole.spread_correlation():.2f}",
                ]
            )
    return rows


def timed(step: Callable[[], Tensor], parameters: Sequence[Tensor], device: str) -> float:
    """Median milliseconds of a gradient step with Adam."""
    optimiser, seconds = torch.optim.Adam(parameters, lr=1e-6), []
    for _ in range(REPEATS + 1):
        if device == "cuda":
            torch.cuda.synchronize()
        began = time.perf_counter()
        optimiser.zero_grad(set_to_none=True)
        step().backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        if device == "cuda":
            torch.cuda.synchronize()
        seconds.append(time.perf_counter() - began)
    return 1e3 * statistics.median(seconds[1:])


def time_rows(ship: Ship, members: Sequence[Hybrid], batch: RolloutBatch | None, sigma: np.ndarray) -> list[list[str]]:
    """One gradient step of all members on COLUMNS windows each."""
    assert batch is not None
    batch = batch.chosen(torch.arange(COLUMNS) % len(batch))
    residuals, results = [m.residual for m in members], {}

    def one_by_one() -> Tensor:
        return torch.stack([state_loss(m, batch, torch.as_tensor(sigma)) for m in members]).sum()

    each = [p for m in members for p in m.learned()]
    results["members one by one, fused kernel"] = timed(one_by_one, each, "cpu")
    kinds = [("stacked, compiled operator", Physics, "cpu"), ("stacked, torch code, eager", TorchPhysics, "cpu")]
    if torch.cuda.is_available():
        kinds.append(("stacked, torch code, eager, cuda", TorchPhysics, "cuda"))
    for name, physics, device in kinds:
        stacked = Stacked(physics(ship), copy.deepcopy(residuals)).to(device)
        many, weights = on(batch, len(members), device), torch.as_tensor(sigma).to(device)

        def all_at_once(stacked: Stacked = stacked, many: RolloutBatch = many, weights: Tensor = weights) -> Tensor:
            return losses(stacked, many, weights).sum()

        results[name] = timed(all_at_once, list(stacked.parameters()), device)
    least = results["members one by one, fused kernel"]
    return [[name, f"{ms:.0f}", f"{ms / least:.1f}"] for name, ms in results.items()]


def main() -> None:
    torch.set_num_threads(1)
    train = read_trials(splits.find(splits.TRAIN_TZRB))
    others = read_trials(splits.find(unseen()))
    ship = estimate_coefficients(freeing_effects(load_ship("esso_osaka_3m"), ["velocity_filter"]), train).ship
    h = default_step(train, ship.particulars["L"])
    pieces = pieces_of(train, h, ship.inputs)
    of_hybrid: Scales = hybrid_scales(ship, pieces, train, h)
    box = box_scales(ship, pieces, train, h)
    whole = "all runs, no early stopping"
    kinds = {
        f"hybrid, {whole}": (
            build_hybrid,
            of_hybrid,
            TrainSettings(seeds=MEMBERS, workers=2, epochs=12, step=h, penalty=0.3),
            False,
        ),
        "hybrid, bootstrap": (
            build_hybrid,
            of_hybrid,
            TrainSettings(seeds=MEMBERS, workers=2, epochs=12, step=h, penalty=0.3),
            True,
        ),
        f"FNN, {whole}": (
            build_box,
            box,
            BlackBoxSettings(seeds=MEMBERS, workers=2, epochs=20, penalty=0.0, step=h),
            False,
        ),
    }
    covered: list[list[str]] = []
    far: list[list[str]] = []
    timing: list[list[str]] = []
    for name, (build, scales, training, bootstrap) in kinds.items():
        began = time.perf_counter()
        members, outcomes = train_members(build, ship, scales, training, pieces, pieces, bootstrap)
        print(f"{name}: {len(outcomes)} members in {time.perf_counter() - began:.0f} s", flush=True)
        found = [r for trial in others if (r := Runs.of(members, trial, ship.inputs, h)) is not None]
        covered += coverage_rows(name, found)
        far += distance_rows(name, Runs.together(found), of_hybrid.noise)
        if not timing:
            hybrids = [m for m in members if isinstance(m, Hybrid)]
            timing = time_rows(ship, hybrids, windows(pieces, h, round(WINDOW / h), 1), scales.sigma)
    lines = [
        f"{MEMBERS} members on Train-TZRB, {WINDOW:g} s windows of {len(others)} unseen runs. Half of the runs "
        f"calibrates the spread, the other half judges it: mean and standard deviation over {HALVES} random halves of "
        "the share of true states inside the 90 % band, over all rows of the windows. In target: share of halves and "
        "states between 0.85 and 0.95.",
        "",
        *table(["ensemble", "sampling", "spread", *STATES, "in target", "factor on x, y, psi, u, v, r"], covered),
        "",
        "Eq. 30 and 31 on u, v, r in m/s and rad/s; correlations over windows of bias with Mahalanobis distance, and "
        "with the spread. With noise: that of the instruments is added to the covariance, as the truth is measured.",
        "",
        *table(
            ["ensemble", "sampling", "noise", "rms bias", "rms spread", "median Mahalanobis", "r(bias, Mahalanobis)",
             "r(bias, spread)"], far,
        ),
        "",
        f"Gradient step of all {MEMBERS} members, {COLUMNS} windows of {WINDOW:g} s, Runge-Kutta, one thread:",
        "",
        *table(["way", "ms", "x"], timing),
    ]  # fmt: skip
    record("Ensembles", "python -m benchmarks.ensemble", lines)


if __name__ == "__main__":
    main()
