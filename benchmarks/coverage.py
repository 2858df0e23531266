"""Do the reported 95 % intervals hold the truth? Synthetic trials of a hidden ship, white noise, 20 seeds.

Run from the repository root: python -m benchmarks.coverage
"""

from __future__ import annotations

import numpy as np

from benchmarks.record import record, table
from cases.demo_trials import demo_trials, hidden_ship
from cases.ships import load_ship
from fitting.calibration import Calibration, Settings, calibrate

SEEDS = range(100, 120)


def inside(calibration: Calibration) -> dict[str, bool]:
    """Coefficient -> does its 95 % interval hold the hidden value."""
    truth = hidden_ship().coefficients
    return {
        s: bool(
            abs(calibration.ship.coefficients[s].value - truth[s].value) <= 1.96 * calibration.ship.coefficients[s].std
        )
        for s in calibration.prior.symbols
    }


def coverage(seeds: range) -> tuple[list[dict[str, bool]], list[Calibration]]:
    """One calibration per noise seed."""
    found = [calibrate(load_ship("esso_osaka_3m"), demo_trials(seed)[0], Settings()) for seed in seeds]
    return [inside(c) for c in found], found


def main() -> None:
    hits, found = coverage(SEEDS)
    shares = np.array([[h[s] for s in found[0].prior.symbols] for h in hits])
    moved = np.array(
        [
            hidden_ship().coefficients[s].value != load_ship("esso_osaka_3m").coefficients[s].value
            for s in found[0].prior.symbols
        ]
    )
    share = np.array([np.diag(c.covariance) for c in found]).mean(axis=0)
    data = share < 0.5
    rows = [
        ["all coefficients", str(shares.shape[1]), f"{shares.mean():.1%}"],
        ["moved coefficients", str(moved.sum()), f"{shares[:, moved].mean():.1%}"],
        ["data decide (prior's share below 50 %)", str(data.sum()), f"{shares[:, data].mean():.1%}"],
        ["prior decides", str((~data).sum()), f"{shares[:, ~data].mean():.1%}"],
    ]
    low = [f"{s} {v:.0%}" for s, v in zip(found[0].prior.symbols, shares.mean(axis=0), strict=True) if v < 0.8]
    lines = [
        f"{len(hits)} noise seeds ({SEEDS.start} to {SEEDS.stop - 1}), all converged: "
        f"{all(c.converged for c in found)}; by seed {', '.join(f'{v:.0%}' for v in shares.mean(axis=1))}.",
        "",
        *table(["", "number", "truth inside the 95 % interval"], rows),
        "",
        f"Below 80 %: {', '.join(low) or 'none'}.",
    ]
    record("Coverage of the intervals on synthetic truth", "python -m benchmarks.coverage", lines)


if __name__ == "__main__":
    main()
