"""Adaptation of a forecast to the past of its run: a slowly varying current, and the memory of the ship.

The seconds before a window are cut into short restarts from the measured state. Their errors, younger ones counting
more, are explained by a current with a Gaussian prior: one Gauss-Newton step, all windows and both directions in one
batch. In the forecast the current decays. (A Kalman filter with latent accelerations of two memories and a current,
its sizes chosen on the same records, was no better.) States of
lags and filters start at their values at the end of the last restart, relative to settled. Rows from a window's start
on are never read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.nlp.windows import Record, Stretch
from fitting.prediction.stretches import FadingCurrent, WindowBatch, rollout, wrapped_error
from mmg.model import settled
from mmg.motion.froude import state_scale, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

RESTART, FORGET, DECAY = 8.0, 15.0, 120.0
"""Seconds: length of a restart, time in which an error's weight falls to 1/e^2, decay time of the current. From half to
twice of each nothing is better by more than its error (22 records; benchmarks/RESULTS.md of 5f878e7)."""
SIZE = 0.02
"""Prior standard deviation of the current [m/s]; .01 and .03 are 1 to 2 % worse (as above)."""
ERRORS = (0.06, 0.04, 0.017, 0.011, 0.0066, 0.003)
"""Typical error of x, y [m], psi [rad], u, v [m/s], r [rad/s] over a restart: what of it a current explains counts
against these. Set by hand with SIZE, which they act through."""
AT_ONCE = 256
"""Windows adapted in one batch, which bounds the memory it takes."""
ROBUST = 3.0
"""Errors count less beyond so many of these (Huber). Set by hand."""
PAST = 30.0
"""Seconds of past of a 3 m model that are used by default; 60 s are no better (as above)."""


@dataclass(frozen=True)
class Adaptation:
    """How the past is used: ``seconds`` of it; the other fields as the constants above, errors (6,)."""

    seconds: float
    restart: float
    forget: float
    decay: float
    size: float
    errors: np.ndarray

    @classmethod
    def of(cls, ship: Ship, seconds: float) -> Adaptation:
        """Settings for a ship, chosen on runs of a 3 m model and scaled by Froude's law."""
        k, errors = time_scale(ship.particulars["L"]), np.array(ERRORS) * state_scale(ship.particulars["L"])
        return cls(seconds, RESTART * k, FORGET * k, DECAY * k, SIZE * k, errors)


def past_begin(record: Record, row: int, seconds: float) -> int:
    """First row of the unbroken, measured stretch of at most ``seconds`` before ``row`` of a ``record``.

    ``row`` itself if there is none.
    """
    t = record.t
    gap = 2.5 * float(np.median(np.diff(t)))
    first = int(np.searchsorted(t, t[row] - seconds - 0.2 * gap))
    broken = ~record.good[first : row + 1]
    broken[:-1] |= np.diff(t[first : row + 1]) > gap
    at = np.flatnonzero(broken)
    return row if len(at) and at[-1] == row - first else first + (int(at[-1]) + 1 if len(at) else 0)


def restarts(record: Record, row: int, a: Adaptation) -> list[Stretch]:
    """The past of a window that starts at ``row`` of a ``record``, as restarts by ``a``, youngest first, none under
    half length.
    """
    begin, sample = past_begin(record, row, a.seconds), float(np.median(np.diff(record.t)))
    result: list[Stretch] = []
    last = row
    while last > begin:
        first = max(begin, int(np.searchsorted(record.t, record.t[last] - a.restart - 0.5 * sample)))
        if first == last or (result and record.t[last] - record.t[first] < 0.5 * a.restart):
            break
        result.append(Stretch(record, first, last))
        last = first
    return result


def adapt(simulator: Simulator, windows: Sequence[Stretch], a: Adaptation) -> tuple[FadingCurrent, np.ndarray]:
    """Current at the start of each of ``windows`` (M of them), fading, and offsets (S - 6, M) from the settled memory.

    simulator: of the ship; a: how the past is used. Both are zero for a window without a past.
    """
    parts = [_adapt(simulator, windows[i : i + AT_ONCE], a) for i in range(0, len(windows), AT_ONCE)]
    return FadingCurrent(np.hstack([w for w, _ in parts]), a.decay), np.hstack([o for _, o in parts])


def _adapt(simulator: Simulator, windows: Sequence[Stretch], a: Adaptation) -> tuple[np.ndarray, np.ndarray]:
    """Currents (2, M) and offsets (S - 6, M) of some windows."""
    M = len(windows)
    offset = np.zeros((len(simulator.model.states) - 6, M))
    pasts = [restarts(w.record, w.first, a) for w in windows]
    pieces = [piece for past in pasts for piece in past]
    owner = [(i, j == 0) for i, past in enumerate(pasts) for j in range(len(past))]
    if not pieces:
        return np.zeros((2, M)), offset
    batch, K = WindowBatch.of(pieces), len(pieces)
    probed = batch.times_over(3)
    probe = np.zeros((2, 3, K))
    probe[0, 1] = probe[1, 2] = 0.5 * a.size
    # within a restart the current hardly decays: its age is counted in the weights
    out, states = rollout(simulator, probed, FadingCurrent(probe.reshape(2, -1), 1e3 * a.decay))
    information, gradient = np.zeros((M, 2, 2)), np.zeros((M, 2))
    for k, (piece, (i, youngest)) in enumerate(zip(pieces, owner, strict=True)):
        now = float(piece.record.t[windows[i].first])
        J, error, weight = _equations(out[:, :, [k, K + k, 2 * K + k]], piece, now, a)
        information[i] += np.einsum("ans,ns,bns->ab", J, weight, J)
        gradient[i] -= np.einsum("ans,ns,ns->a", J, weight, error)
        if youngest and len(offset):
            rows = piece.last - piece.first
            end = states[rows, :, k : k + 1]
            here = piece.record.controls[piece.last][:, None]
            values = simulator.ship.values if piece.record.values is None else piece.record.values
            beyond = (end - settled(simulator.model, end[:6], here, values))[6:, 0]
            offset[:, i] = beyond if np.isfinite(beyond).all() else 0.0
    return np.linalg.solve(information + np.eye(2) / a.size**2, gradient[..., None])[..., 0].T, offset


def _equations(out: np.ndarray, piece: Stretch, now: float, a: Adaptation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sensitivities (2, n, 6), errors (n, 6) and weights (n, 6) of one restart at about ten of its rows.

    out: (rows, 6, 3) without and with a probing current in either direction. The rows of a restart of full length
    together count as one observation of each state.
    """
    rows = piece.last - piece.first
    t = piece.record.t[piece.first : piece.last + 1]
    every = max(1, round(0.1 * a.restart * rows / max(float(t[-1] - t[0]), 1e-9)))
    at = np.arange(rows, 0, -every)[::-1]
    error = wrapped_error(out[at, :, 0], piece.logged[at])
    J = np.moveaxis(out[at, :, 1:] - out[at, :, :1], 2, 0) / (0.5 * a.size)
    age = now - t[at]
    share = every * (t[-1] - t[0]) / rows / a.restart
    relative = np.abs(error) / a.errors
    weight = share * np.exp(-2 * age / a.forget)[:, None] * ROBUST / np.maximum(relative, ROBUST)
    weight = weight / a.errors**2
    usable = np.isfinite(error) & np.isfinite(J).all(axis=0)
    usable[:, :2] &= piece.record.has_position
    return np.where(usable, J, 0.0), np.where(usable, error, 0.0), np.where(usable, weight, 0.0)


def default_past(ship: Ship) -> float:
    """Seconds of past that are used by default for a ``ship``, by Froude's law, whole ones."""
    return float(max(1.0, round(PAST * time_scale(ship.particulars["L"]))))
