"""Filter and smoother of a linear model with a latent force, for many windows side by side.

The state is that of the ship, then a force X, Y, N that remembers (Ornstein-Uhlenbeck), then a coloured error of each
sensor (first-order as well). Whitening by the filter is the same as by the Cholesky factor of the propagated
covariance R + J_f S_f J_f^T of a window, at a cost that grows with its length only (Kalman 1960; Durbin & Koopman
2012, chapter 4, whose notation is used). The first state of a window is as good as unknown, which projects it out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.linearised_model import LinearModel

KNOWN = 30.0
"""Samples that the usual size of what is random counts as."""


@dataclass(frozen=True)
class NoiseModel:
    """What is random: sizes of the latent force (3,) [N, N, N m] and its memory [s], white errors of the sensors (6,),
    and the size (6,) and memory [s] of their coloured errors (size 0: none).

    usual: what the same ship and instruments showed in other trials, if any; it counts as KNOWN samples of each size.
    """

    force: np.ndarray
    tau: float
    white: np.ndarray
    coloured: np.ndarray
    colour_tau: float
    usual: NoiseModel | None = None

    @property
    def unusual(self) -> float:
        """Negative log of the prior of the sizes of force and white errors (inverse gamma), 0 where they are usual."""
        if self.usual is None:
            return 0.0
        pairs = ((self.usual.force, self.force), (self.usual.white, self.white))
        ratio = np.concatenate([(known / size) ** 2 for known, size in pairs])
        return 0.5 * KNOWN * float(np.sum(ratio - 1 - np.log(ratio)))

    def with_(self, **changed: object) -> NoiseModel:
        """A copy with some fields replaced."""
        return replace(self, **changed)  # type: ignore[arg-type]


@dataclass(frozen=True)
class LinearSystem:
    """The linear model of all windows as the filter takes it; n states.

    T: (K, R, n, n); Z: (K + 1, R, 6, n), rows of what was not measured zero; Q: (n,) variances of a step's random
    change; R: (6,); first: (R, n, n) covariance of the state at the start; good: (K + 1, R, 6); inside: (K, R).
    """

    T: np.ndarray
    Z: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    first: np.ndarray
    good: np.ndarray
    inside: np.ndarray


def system(
    linear: LinearModel, noise: NoiseModel, first: np.ndarray, good: np.ndarray, inside: np.ndarray, h: float
) -> LinearSystem:
    """The filter's model from a linearisation; first: (R, S, S) covariance of the ship's state at the start."""
    K, R, S = linear.force.shape[:3]
    coloured = np.flatnonzero(noise.coloured > 0)
    n = S + 3 + len(coloured)
    left, left_b = np.exp(-h / noise.tau), np.exp(-h / noise.colour_tau)
    T = np.zeros((K, R, n, n))
    T[..., :S, :S], T[..., :S, S : S + 3] = linear.F, linear.force
    decay = np.concatenate([np.full(3, left), np.full(len(coloured), left_b)])
    at = np.arange(S, n)
    T[..., at, at] = decay
    T[~inside] = np.eye(n)
    Z = np.zeros((K + 1, R, 6, n))
    Z[..., :S] = linear.H
    Z[..., coloured, S + 3 + np.arange(len(coloured))] = 1.0
    Z[~good] = 0.0
    own = np.concatenate([noise.force, noise.coloured[coloured]]) ** 2
    Q = np.concatenate([np.zeros(S), own * (1 - decay**2)])
    start = np.zeros((R, n, n))
    start[:, :S, :S] = first
    start[:, at, at] = own
    return LinearSystem(T, Z, Q, noise.white**2, start, good, inside)


@dataclass(frozen=True)
class Filtered:
    """What a filter run leaves: gains L = T - K Z (K, R, n, n) and K (K, R, n, 6), P (K + 1, R, n, n) predicted
    covariances, inverse F (K + 1, R, 6, 6) and root (K + 1, R, 6, 6) of it (root v is white), log_det: (R,)."""

    L: np.ndarray
    gain: np.ndarray
    P: np.ndarray
    inverse: np.ndarray
    root: np.ndarray
    log_det: np.ndarray


def filtered(s: LinearSystem) -> Filtered:
    """Covariances and gains; they do not depend on what was measured."""
    K, R, n = s.T.shape[:3]
    L, gain, P = np.empty((K, R, n, n)), np.empty((K, R, n, 6)), np.empty((K + 1, R, n, n))
    inverse, root = np.empty((K + 1, R, 6, 6)), np.empty((K + 1, R, 6, 6))
    log_det = np.zeros(R)
    now, at = s.first, np.arange(n)
    white = np.where(s.good, s.R, 1.0)
    q = s.inside[..., None] * s.Q
    for k in range(K + 1):
        P[k] = now
        Z = s.Z[k]
        PZ = now @ Z.swapaxes(1, 2)
        F = Z @ PZ
        F[:, np.arange(6), np.arange(6)] += white[k]
        lower = np.linalg.cholesky(F)
        root[k] = np.linalg.inv(lower)
        inverse[k] = root[k].swapaxes(1, 2) @ root[k]
        log_det += 2 * np.log(lower[:, np.arange(6), np.arange(6)]).sum(axis=1)
        if k == K:
            break
        T = s.T[k]
        gain[k] = T @ PZ @ inverse[k]
        L[k] = T - gain[k] @ Z
        now = L[k] @ now @ T.swapaxes(1, 2)
        now = 0.5 * (now + now.swapaxes(1, 2))
        now[:, at, at] += q[k]
    return Filtered(L, gain, P, inverse, root, log_det)


def responses(
    s: LinearSystem, f: Filtered, forcing: np.ndarray, seen: np.ndarray, start: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """White responses (K + 1, R, 6, c) of columns, and their predicted states (K + 1, R, n, c).

    forcing: (K, R, m, c) what a column adds over a step to the first m states; seen: (K + 1, R, 6, c) what to the
    logged columns; start: (R, n, c) its state at the start. A residual is the column (defect, -residual).
    """
    K, R, m, c = forcing.shape
    n = s.T.shape[2]
    states, white = np.zeros((K + 1, R, n, c)), np.empty((K + 1, R, 6, c))
    masked = np.where(s.good[..., None], seen, 0.0)
    forcing = np.where(s.inside[..., None, None], forcing, 0.0)
    if start is not None:
        states[0] = start
    for k in range(K + 1):
        W = s.Z[k] @ states[k] + masked[k]
        white[k] = f.root[k] @ W
        if k < K:
            states[k + 1] = s.T[k] @ states[k] - f.gain[k] @ W
            states[k + 1, :, :m] += forcing[k]
    return white, states


def smoothed(
    s: LinearSystem, f: Filtered, white: np.ndarray, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smoothed states (K + 1, R, n) from the column (defect, -residual); adjoints r (K, R, n) and u (K + 1, R, 6).

    white: (K + 1, R, 6), states: (K + 1, R, n) as ``responses`` gives them for it.
    """
    K, R, n = s.T.shape[:3]
    v = -(f.root.swapaxes(2, 3) @ white[..., None])
    r, mean = np.zeros((R, n, 1)), np.empty((K + 1, R, n))
    rs, us = np.zeros((K, R, n)), np.empty((K + 1, R, 6))
    for k in range(K, -1, -1):
        us[k] = v[k, ..., 0]
        if k < K:
            rs[k] = r[..., 0]
            us[k] -= (f.gain[k].swapaxes(1, 2) @ r)[..., 0]
            r = f.L[k].swapaxes(1, 2) @ r
        r = r + s.Z[k].swapaxes(1, 2) @ v[k]
        mean[k] = states[k] + (f.P[k] @ r)[..., 0]
    return mean, rs, us


@dataclass(frozen=True)
class Adjoint:
    """Derivatives of 1/2 log det of the filter: by T (K, R, n, n), by Z (K + 1, R, 6, n); the diagonals N (K, R, n) and
    D (K + 1, R, 6) of Durbin & Koopman, which say how far r and u should scatter."""

    by_T: np.ndarray
    by_Z: np.ndarray
    N: np.ndarray
    D: np.ndarray


def adjoint(s: LinearSystem, f: Filtered) -> Adjoint:
    """Backward sweep of N_t = Z' F^-1 Z + L' N_t+1 L, the derivative of log det by the predicted covariance."""
    K, R, n = s.T.shape[:3]
    by_T, by_Z = np.empty((K, R, n, n)), np.empty((K + 1, R, 6, n))
    Ns, Ds = np.zeros((K, R, n)), np.empty((K + 1, R, 6))
    N = np.zeros((R, n, n))
    for k in range(K, -1, -1):
        ZF = s.Z[k].swapaxes(1, 2) @ f.inverse[k]
        by_Z[k] = ZF.swapaxes(1, 2) @ f.P[k]
        Ds[k] = np.einsum("rii->ri", f.inverse[k])
        if k < K:
            Ns[k] = np.einsum("rii->ri", N)
            NK = N @ f.gain[k]
            Ds[k] += np.einsum("rij,rij->rj", f.gain[k], NK)
            by_T[k] = N @ f.L[k] @ f.P[k]
            by_Z[k] -= f.gain[k].swapaxes(1, 2) @ by_T[k]
            N = f.L[k].swapaxes(1, 2) @ N @ f.L[k]
        N = N + ZF @ s.Z[k]
    return Adjoint(by_T, by_Z, Ns, Ds)
