"""What a report on a training needs beside its outcomes: judged runs, size of the residual, rows outside its data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.trial import Trial
from mmg.network import Network
from mmg.ship import Ship
from residual.training.hybrid import OUTPUT
from residual.training.scales import LEAST_SCALE, Scales
from residual.training.tasks import ModelKind
from residual.training.trainer import Outcome
from residual.training.windows import pieces_of, windows

RATES = {"du": "m/s²", "dv": "m/s²", "dr": "rad/s²"}
"""Channels of the residual and their units."""


def judged_runs(outcome: Outcome, trials: Sequence[Trial]) -> list[dict]:
    """Per run that judged the training of ``outcome``: name, number of its 30 s windows, errors before and after.

    trials: those that judged, in the order in which their runs are numbered.
    """
    rows = []
    for run in np.unique(outcome.judged[:, 0]).astype(int):
        own = outcome.judged[outcome.judged[:, 0] == run]
        before, after = own[:, 2:].mean(axis=0).tolist()
        rows.append({"run": trials[run].name, "windows": len(own), "before": before, "after": after})
    return rows


def residual_size(network: Network, scales: Scales) -> dict[str, dict]:
    """Per channel the residual ``network`` over the training rows [m/s2, rad/s2]: rms, 95 %, largest, its bound.

    scales: of its training. "ship_rms" is the rms of the accelerations of the ship without it.
    """
    sizes = np.abs(network.accelerations(scales.features))
    shares = np.linspace(0, 1, 101)
    own = (scales.output - LEAST_SCALE) / OUTPUT
    return {
        name: {
            "rms": float(np.sqrt((size**2).mean())),
            "p95": float(np.quantile(size, 0.95)),
            "largest": float(size.max()),
            "bound": float(bound),
            "ship_rms": float(rms),
            "unit": RATES[name],
            "quantiles": np.quantile(size, shares).tolist(),
        }
        for name, size, bound, rms in zip(RATES, sizes, network.bound, own, strict=True)
    }


def outside(kind: ModelKind, ship: Ship, trials: Sequence[Trial], h: float, known: np.ndarray) -> dict:
    """Shares of rows of ``trials`` outside the range of the training rows, as a ``kind`` of model of ``ship`` sees it.

    h: step of the grid [s]; known: features (F, R) of the training rows. Returns trials: name -> share of its rows with
    any feature outside; features: name -> share, lowest and highest value; {} where there are no rows.
    """
    features_at = kind.features(ship)
    rows = {t.name: windows(pieces_of([t], h, kind.inputs(ship)), h, 1, 1) for t in trials}
    seen = {name: features_at(b.targets[0], b.controls[0]).numpy() for name, b in rows.items() if b}
    if not seen:
        return {}
    lower, upper = known.min(axis=1)[:, None], known.max(axis=1)[:, None]
    every = np.hstack(list(seen.values()))
    beyond = (every < lower) | (every > upper)
    return {
        "trials": {n: float(((a < lower) | (a > upper)).any(axis=0).mean()) for n, a in seen.items()},
        "features": {
            n: {"share": float(b.mean()), "lowest": float(a.min()), "highest": float(a.max())}
            for n, a, b in zip(ship.features, every, beyond, strict=True)
        },
    }
