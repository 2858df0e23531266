"""What a report on a training needs beside its outcomes: judged runs, size of the residual, rows outside its data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cases.trial import Trial
from mmg.network import Network
from mmg.ship import Ship
from residual.blackbox.models import inputs_of
from residual.networks.features import features as box_features
from residual.physics.operator import Physics
from residual.training.hybrid import OUTPUT, TrainedResidual, physics_features
from residual.training.scales import LEAST_SCALE
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


def residual_size(trained: TrainedResidual) -> dict[str, dict]:
    """Per channel the residual of ``trained`` over the training rows [m/s2, rad/s2]: rms, 95 %, largest, its bound.

    Its row "ship_rms" is the rms of the accelerations of the ship without it; {} where every training diverged.
    """
    if trained.network is None:
        return {}
    return size_of(trained.network, trained.scales.features, (trained.scales.output - LEAST_SCALE) / OUTPUT)


def size_of(network: Network, features: np.ndarray, own: np.ndarray) -> dict[str, dict]:
    """The same of a ``network`` at ``features`` (F, R); own: rms accelerations of the ship (3,)."""
    sizes = np.abs(network.accelerations(features))
    shares = np.linspace(0, 1, 101)
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


def outside_hybrid(ship: Ship, trials: Sequence[Trial], h: float, known: np.ndarray) -> dict:
    """Shares of rows of ``trials`` outside the range of the training rows, as a hybrid on ``ship`` sees them.

    h: step of the grid [s]; known: features (F, R) of the training rows.
    """
    physics = Physics(ship.without_network())
    rows = {t.name: pieces_of([t], h, ship.inputs) for t in trials}
    return _outside(ship.features, {name: physics_features(physics, p) for name, p in rows.items() if p}, known)


def outside_box(
    names: Sequence[str], actuators: Sequence[str], trials: Sequence[Trial], h: float, known: np.ndarray
) -> dict:
    """The same of ``trials`` as a black box with these ``names`` of features and ``actuators`` sees them.

    h: step of the grid [s]; known: features (F, R) of the training rows.
    """
    rows = {t.name: windows(pieces_of([t], h, inputs_of(actuators)), h, 1, 1) for t in trials}
    return _outside(names, {n: box_features(b.targets[0], b.controls[0]).numpy() for n, b in rows.items() if b}, known)


def _outside(names: Sequence[str], rows: Mapping[str, np.ndarray], known: np.ndarray) -> dict:
    """trials: name -> share of its rows with any feature outside; features: name -> share, lowest and highest value."""
    lower, upper = known.min(axis=1)[:, None], known.max(axis=1)[:, None]
    if not rows:
        return {}
    every = np.hstack(list(rows.values()))
    beyond = (every < lower) | (every > upper)
    return {
        "trials": {n: float(((a < lower) | (a > upper)).any(axis=0).mean()) for n, a in rows.items()},
        "features": {
            n: {"share": float(b.mean()), "lowest": float(a.min()), "highest": float(a.max())}
            for n, a, b in zip(names, every, beyond, strict=True)
        },
    }
