"""Do the reported 95 % intervals hold the truth? Synthetic trials of ships drawn from the prior, 20 seeds.

Run from the repository root: python -m benchmarks.coverage, or with the argument ``clean`` for white noise only.

The trials are as bad as the real ones (benchmarks/disturbed_trials.py): forces that remember, late velocities, a gyro
that reads
too little, an antenna off midship, coloured noise. Three intervals of the same fit of coefficients and measurement
effects: of white noise (sigma = rms, information + prior, refitted with those weights), of the effective noise that
the fit weighs by, and the cluster-robust ones that ``mmg fit`` reports.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.disturbed_trials import DEFECTS, Disturbed, disturbed_trials, drawn_ship
from benchmarks.record import record, table
from cases.shipfiles.effects import freeing_effects, with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import TRAIN, demo_trials, hidden_ship
from fitting.calibration import Calibration, Settings, estimate_coefficients
from fitting.nlp.fisher_information import information
from fitting.parallel import run_all
from fitting.solvers.ipopt import solve
from mmg.errors import UserError

SEEDS = range(100, 120)
EFFECTS = ("velocity_filter", "gyro", "antenna_offset")
SETTINGS = Settings(step=1.0, window=50.0)
KINDS = ("white noise", "effective noise", "cluster-robust (reported)")


@dataclass(frozen=True)
class Trialled:
    """Errors of one seed over standard errors by kind, (kinds, P), prior's share of the model-based variance (P,)."""

    seed: int
    symbols: tuple[str, ...]
    errors: np.ndarray
    share: np.ndarray
    ratio: np.ndarray
    converged: tuple[bool, bool]


def one(seed: int) -> Trialled:
    """Draw a ship and its disturbed trials (again if the ship cannot hold its course), fit, compare with the truth."""
    base = load_ship("esso_osaka_3m")
    for attempt in range(10):
        try:
            true = drawn_ship(base, seed + 1000 * attempt)
            trials = disturbed_trials(true, TRAIN, seed, Disturbed())
            break
        except UserError:
            continue
    start = freeing_effects(base, EFFECTS)
    found = estimate_coefficients(start, trials, SETTINGS)
    truth, prior = with_effects(true, DEFECTS).coefficients, found.prior
    at = np.array([truth[s].value if s in truth else start.coefficients[s].value for s in prior.symbols])
    p = (at - prior.mean) / prior.std
    white = found.problem.with_sigma(found.noise.rms)
    refit = solve(white, found.solution.x, max_iterations=60)
    narrow = np.linalg.inv(information(white, refit.x).hessian)
    errors = [
        (white.split(refit.x)[1] - p) / np.sqrt(np.diag(narrow)),
        (found.p - p) / np.sqrt(np.diag(found.covariance_model)),
        (found.p - p) / np.sqrt(np.diag(found.covariance)),
    ]
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(narrow))
    both = (found.converged, refit.converged)
    return Trialled(seed, prior.symbols, np.array(errors), np.diag(found.covariance_model).copy(), ratio, both)


def disturbed(seeds: range, workers: int = 2) -> list[Trialled]:
    """One calibration of disturbed trials per seed."""
    return run_all(one, list(seeds), workers)


def main() -> None:
    began = time.perf_counter()
    found = disturbed(SEEDS)
    inside = np.array([np.abs(f.errors) < 1.96 for f in found])
    share = np.array([f.share for f in found])
    groups = {
        "all coefficients": np.ones(share.shape, dtype=bool),
        "of the ship": np.broadcast_to([s.split(".")[0] not in EFFECTS for s in found[0].symbols], share.shape),
        "of the measurement": np.broadcast_to([s.split(".")[0] in EFFECTS for s in found[0].symbols], share.shape),
        "data decide (prior's share below 50 %)": share < 0.5,
        "prior decides": share >= 0.5,
    }
    rows = [
        [name, f"{mask.sum() / len(found):.0f}", *(f"{inside[:, k][mask].mean():.1%}" for k in range(len(KINDS)))]
        for name, mask in groups.items()
    ]
    how = Disturbed()
    low = inside[:, 2].mean(axis=0)
    worst = [f"{found[0].symbols[i]} {low[i]:.0%}" for i in np.argsort(low) if low[i] < 0.8]
    lines = [
        f"{len(found)} seeds ({SEEDS.start} to {SEEDS.stop - 1}), coefficients from the prior; {len(TRAIN)} runs, "
        f"Ornstein-Uhlenbeck forces {how.X:g} N, {how.Y:g} N, {how.N:g} N m of {how.tau:g} s; defects "
        f"{', '.join(how.defects)}; noise white and of {how.noise_tau:g} s. {sum(f.converged[0] for f in found)} fits "
        f"converged ({sum(f.converged[1] for f in found)} with white noise); {time.perf_counter() - began:.0f} s.",
        "",
        *table(["truth inside the 95 % interval", "number", *KINDS], rows),
        "",
        "By seed, reported: " + ", ".join(f"{v:.0%}" for v in inside[:, 2].mean(axis=1)) + ".",
        f"Reported over white-noise standard error, median: {np.median([f.ratio for f in found]):.1f}.",
        f"Below 80 %: {', '.join(worst) or 'none'}.",
    ]
    record("Coverage under autocorrelated forces and bad sensors", "python -m benchmarks.coverage", lines)


def held(calibration: Calibration) -> dict[str, bool]:
    """Coefficient -> does its 95 % interval hold the hidden value of the demo's ship."""
    truth = hidden_ship().coefficients
    return {
        s: bool(
            abs(calibration.ship.coefficients[s].value - truth[s].value) <= 1.96 * calibration.ship.coefficients[s].std
        )
        for s in calibration.prior.symbols
    }


def clean_one(seed: int) -> tuple[dict[str, bool], np.ndarray, bool]:
    found = estimate_coefficients(load_ship("esso_osaka_3m"), demo_trials(seed)[0], Settings())
    return held(found), np.diag(found.covariance_model).copy(), found.converged


def clean() -> None:
    """The demo's hidden ship, white noise only."""
    found = run_all(clean_one, list(SEEDS), 2)
    symbols = list(found[0][0])
    shares = np.array([[hit[s] for s in symbols] for hit, _, _ in found])
    base, truth = load_ship("esso_osaka_3m").coefficients, hidden_ship().coefficients
    moved = np.array([truth[s].value != base[s].value for s in symbols])
    data = np.mean([share for _, share, _ in found], axis=0) < 0.5
    rows = [
        ["all coefficients", str(shares.shape[1]), f"{shares.mean():.1%}"],
        ["moved coefficients", str(moved.sum()), f"{shares[:, moved].mean():.1%}"],
        ["data decide (prior's share below 50 %)", str(data.sum()), f"{shares[:, data].mean():.1%}"],
        ["prior decides", str((~data).sum()), f"{shares[:, ~data].mean():.1%}"],
    ]
    low = [f"{s} {v:.0%}" for s, v in zip(symbols, shares.mean(axis=0), strict=True) if v < 0.8]
    lines = [
        f"{len(found)} noise seeds ({SEEDS.start} to {SEEDS.stop - 1}), all converged: {all(f[2] for f in found)}; "
        f"by seed {', '.join(f'{v:.0%}' for v in shares.mean(axis=1))}.",
        "",
        *table(["", "number", "truth inside the 95 % interval"], rows),
        "",
        f"Below 80 %: {', '.join(low) or 'none'}.",
    ]
    record("Coverage of the intervals on synthetic truth", "python -m benchmarks.coverage clean", lines)


if __name__ == "__main__":
    clean() if "clean" in sys.argv[1:] else main()
