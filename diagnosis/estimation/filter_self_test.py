"""The compiled functions of the filter against those in numpy, on a small system, before they are used."""

from __future__ import annotations

from typing import Any

import numpy as np

from diagnosis.estimation import kalman
from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.kalman import LinearSystem, SystemParts
from diagnosis.estimation.transition_model import LinearModel


def agrees(code: Any) -> bool:
    """Whether compiled functions give on a small system what those in numpy do. code: has them as methods."""
    s, columns = _example()
    f, own = kalman.filtered(s), code.filtered(s)
    white, states = kalman.responses(s, f, columns.forcing, columns.dense_observed, columns.start)
    out = np.empty(white.shape)
    moved = code.whitened(s, own, columns, out, True)
    adjoints = kalman.adjoint(s, f), code.adjoint(s, own)
    last, state = white[..., 0], states[..., 0]
    pairs = [
        *((getattr(f, name), getattr(own, name)) for name in ("gain", "P", "inverse", "root", "log_det")),
        (white, out), (states, moved),
        *((getattr(adjoints[0], name), getattr(adjoints[1], name)) for name in ("by_T", "by_Z", "N", "D")),
        *zip(kalman.smoothed(s, f, last, state), code.smoothed(s, own, last, state), strict=True),
        (kalman.observations(s, f, white), code.observations(s, own, white)),
    ]  # fmt: skip
    for gusts in (None, s.T[:, :, :3, :2]):
        decay = np.linspace(0.5, 0.9, 5 if gusts is None else 7)
        model = LinearModel(*(s.T[..., :3, :3],) * 4, s.Z[..., 0], s.Z[..., :3], s.Z, np.arange(0))
        parts = SystemParts(model, decay, np.array([1, 4]), s.good, s.inside, gusts)
        pairs += zip(kalman.assembled(parts), code.assembled(parts), strict=True)
        rates = (s, adjoints[0], 3, 0.5, gusts)
        pairs.append((kalman.by_rates(*rates), code.by_rates(*rates)))
    return all(bool(np.abs(a - b).max() <= 1e-9 * (1 + np.abs(a).max())) for a, b in pairs)


def _example() -> tuple[LinearSystem, DrivenColumns]:
    """A small system with samples missing and a window that ends early, and columns of it."""
    rng, K, R, S, c = np.random.default_rng(0), 6, 2, 3, 19
    inside = np.arange(K)[:, None] < np.array([K, K - 2])
    good = rng.random((K + 1, R, 6)) > 0.3
    good[2, 0] = False
    good[:, 1] &= (np.arange(K + 1) <= K - 2)[:, None]
    T = np.zeros((K, R, S + 6, S + 6))
    T[..., :S, :] = 0.3 * rng.standard_normal((K, R, S, S + 6))
    T[..., np.arange(S + 6), np.arange(S + 6)] += 0.7
    T[~inside] = np.eye(S + 6)
    Z = np.where(good[..., None], rng.standard_normal((K + 1, R, 6, S + 6)), 0.0)
    Q, white = 0.1 + rng.random(S + 6), 0.1 + rng.random(6)
    s = LinearSystem(T, Z, Q, white, np.repeat(np.eye(S + 6)[None], R, axis=0), good, inside, S)
    observed, start = rng.standard_normal((K + 1, R, 6, 2)), rng.standard_normal((R, S + 6, c))
    return s, DrivenColumns(rng.standard_normal((K, R, S, c)), observed, np.array([1, 17]), None, start)
