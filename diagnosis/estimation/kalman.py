"""Kalman filter and smoother of a linear model with a latent force, for R windows side by side.

The state is that of the ship, then a latent force X, Y, N (Ornstein-Uhlenbeck process), then gusts where the trials
have them. Notation of Durbin & Koopman (2012), chapter 4. The first state of a window is given so wide a covariance
that it is as good as unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from diagnosis.estimation.transition_model import LinearModel

BLOCK = 2_000_000  # Numbers in a block: 16 MB, of memory that the next block uses again. Set by hand: bounds memory.


@dataclass(frozen=True)
class DrivenColumns:
    """c columns whose responses are wanted.

    forcing: (K, R, m, c) what a column adds over a step to the first m states; observed: (K + 1, R, 6, d) what the
    columns ``observing`` (d,) add to the logged columns, the others add nothing; scale: (R, c) by which forcing and
    observed are multiplied (None: 1); start: (R, n, c) first states (None: 0).
    """

    forcing: np.ndarray
    observed: np.ndarray
    observing: np.ndarray
    scale: np.ndarray | None = None
    start: np.ndarray | None = None

    @classmethod
    def dense(cls, forcing: np.ndarray, observed: np.ndarray, start: np.ndarray | None = None) -> DrivenColumns:
        """DrivenColumns that may all act on what is logged. forcing, observed, start: as of the class, with d = c."""
        return cls(forcing, observed, np.arange(observed.shape[3]), None, start)

    @classmethod
    def pushing(cls, forcing: np.ndarray) -> DrivenColumns:
        """DrivenColumns that act on the states alone. forcing: as of the class."""
        K, R = forcing.shape[:2]
        return cls(forcing, np.zeros((K + 1, R, 6, 0)), np.zeros(0, dtype=int))

    @classmethod
    def misread(cls, observed: np.ndarray) -> DrivenColumns:
        """DrivenColumns that act on what is logged alone. observed: as of the class, with d = c."""
        K1, R, _, c = observed.shape
        return cls(np.zeros((K1 - 1, R, 0, c)), observed, np.arange(c))

    @property
    def width(self) -> int:
        """How many columns they are."""
        return self.forcing.shape[3]

    def blocks(self) -> Iterator[DrivenColumns]:
        """These columns, at once."""
        yield self

    @property
    def dense_observed(self) -> np.ndarray:
        """What every column adds to the logged columns, (K + 1, R, 6, c)."""
        out = np.zeros((*self.observed.shape[:3], self.forcing.shape[3]))
        out[..., self.observing] = self.observed
        return out


@dataclass(frozen=True)
class ProductColumns:
    """f times v columns that act on the states: pushes (K, R, m, f), what each adds over a step to the first m states,
    times each of the ``values`` (v, K, R), or (v, K, 1) of all windows. Those of one value are side by side."""

    pushes: np.ndarray
    values: np.ndarray

    @property
    def width(self) -> int:
        """How many columns they are."""
        return len(self.values) * self.pushes.shape[3]

    def blocks(self) -> Iterator[DrivenColumns]:
        """The columns in their order, some at a time."""
        K, R, m, f = self.pushes.shape
        count = max(1, BLOCK // max(K * R * m * f, 1))
        for begin in range(0, len(self.values), count):
            some = np.moveaxis(self.values[begin : begin + count], 0, -1)
            made = self.pushes[:, :, :, None] * some[:, :, None, :, None]
            yield DrivenColumns.pushing(made.reshape(K, R, m, -1))


@dataclass(frozen=True)
class NoiseModel:
    """Standard deviations of the latent force (3,) [N, N, N m], with correlation time tau [s], and of the white errors
    of the sensors (6,) [units of x, y, psi, u, v, r]; gust: (2,) of gusts along and across the wind [share of its
    speed], with correlation time gust_tau [s], which count where the trials have gusts.
    """

    force: np.ndarray
    tau: float
    white: np.ndarray
    gust: np.ndarray = field(default_factory=lambda: np.full(2, 0.05))
    gust_tau: float = 1.0

    def towards(self, other: NoiseModel, share: float) -> NoiseModel:
        """Sizes on the way to those of the ``other``: a ``share`` of the logarithm of each ratio."""

        pairs = ((getattr(self, name), getattr(other, name)) for name in ("force", "white", "gust"))
        force, white, gust = (one * (last / one) ** share for one, last in pairs)
        return replace(self, force=force, white=white, gust=gust)

    def with_(self, **changed: object) -> NoiseModel:
        """A copy with the fields ``changed``."""
        return replace(self, **changed)  # type: ignore[arg-type]


@dataclass(frozen=True)
class LinearSystem:
    """State-space model with n states, of all windows.

    T: (K, R, n, n) transition; Z: (K + 1, R, 6, n) observation, 0 where nothing is compared; Q: (n,), R: (6,) variances
    of process and observation; first: (R, n, n) initial covariance; good: (K + 1, R, 6) compared; inside: (K, R) steps
    that exist; S: states of the ship, which come first, before the latent force; those behind them follow none of them.
    """

    T: np.ndarray
    Z: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    first: np.ndarray
    good: np.ndarray
    inside: np.ndarray
    S: int

    @cached_property
    def places(self) -> tuple[np.ndarray, ...]:
        """Where numbers are not zero in any window: of T, of which the first S rows are alike, where those of each row
        begin (n + 1,) and the columns of all, and the same of Z (7,)."""
        T, Z = (self.T != 0).any(axis=(0, 1)), (self.Z != 0).any(axis=(0, 1))
        T[: self.S] = T[: self.S].any(axis=0)  # one pattern for all rows of the ship: the code loops over it
        return tuple(
            found.astype(np.int64)
            for rows in (T, Z)
            for found in (np.concatenate([[0], np.cumsum(rows.sum(axis=1))]), np.nonzero(rows)[1])
        )


def linear_system(
    linear: LinearModel,
    noise: NoiseModel,
    first: np.ndarray,
    good: np.ndarray,
    inside: np.ndarray,
    h: float,
    gusts: np.ndarray | None = None,
) -> LinearSystem:
    """State-space model of S ship states, latent force and gusts.

    linear: linearised model; noise: sizes; first: (R, S, S) initial covariance of the ship's states; good: (K + 1, R,
    6) values compared; inside: (K, R) steps that exist; h: step [s]; gusts: as of ``GriddedTrials``.
    """
    K, R, S = linear.force.shape[:3]
    gust = noise.gust[: 0 if gusts is None else 2]
    n = S + 3 + len(gust)
    decay = np.exp(-h / np.array([noise.tau] * 3 + [noise.gust_tau] * len(gust)))  # of one size, after a step
    at = np.arange(S, n)
    T = np.zeros((K, R, n, n))
    T[..., :S, :S], T[..., :S, S : S + 3] = linear.F, linear.force
    if gusts is not None:
        T[..., :S, S + 3 :] = linear.force @ gusts
    T[..., at, at] = decay
    T[~inside] = np.eye(n)  # behind its end a window stands still
    Z = np.zeros((K + 1, R, 6, n))
    Z[..., :S] = linear.H
    Z[~good] = 0.0
    own = np.concatenate([noise.force, gust]) ** 2
    Q = np.concatenate([np.zeros(S), own * (1 - decay**2)])  # so their variances stay what they are at the start
    start = np.zeros((R, n, n))
    start[:, :S, :S] = first
    start[:, at, at] = own  # they began long before the window
    return LinearSystem(T, Z, Q, noise.white**2, start, good, inside, S)


@dataclass(frozen=True)
class Filtered:
    """Result of a filter run: gain K (K, R, n, 6), predicted covariance P (K + 1, R, n, n), inverse (K + 1, R, 6, 6) of
    the innovation covariance F and its root (root v is white), log_det of F (R,)."""

    gain: np.ndarray
    P: np.ndarray
    inverse: np.ndarray
    root: np.ndarray
    log_det: np.ndarray


def filtered(s: LinearSystem) -> Filtered:
    """Covariances and gains of the system s; they do not depend on the measurements."""
    K, R, n = s.T.shape[:3]
    gain, P = np.empty((K, R, n, 6)), np.empty((K + 1, R, n, n))
    inverse, root = np.empty((K + 1, R, 6, 6)), np.empty((K + 1, R, 6, 6))
    log_det = np.zeros(R)
    now, at = s.first, np.arange(n)
    white = np.where(s.good, s.R, 1.0)  # what is not compared has unit variance and no observation: its log is 0
    q = s.inside[..., None] * s.Q
    for k in range(K + 1):
        P[k] = now
        Z = s.Z[k]
        PZ = now @ Z.swapaxes(1, 2)
        F = Z @ PZ  # F = Z P Z' + H, the recursion of section 4.3.2
        F[:, np.arange(6), np.arange(6)] += white[k]
        lower = np.linalg.cholesky(F)
        root[k] = np.linalg.inv(lower)  # root v has unit covariance, as F = lower lower'
        inverse[k] = root[k].swapaxes(1, 2) @ root[k]
        log_det += 2 * np.log(lower[:, np.arange(6), np.arange(6)]).sum(axis=1)
        if k == K:
            break
        T = s.T[k]
        gain[k] = T @ PZ @ inverse[k]  # from what is predicted to what is predicted next: T is in it
        now = (T - gain[k] @ Z) @ now @ T.swapaxes(1, 2)  # (T - K Z) P T'; Q follows below
        now = 0.5 * (now + now.swapaxes(1, 2))  # rounding would grow until no root exists
        now[:, at, at] += q[k]
    return Filtered(gain, P, inverse, root, log_det)


def whitened(
    s: LinearSystem,
    f: Filtered,
    columns: DrivenColumns,
    out: np.ndarray | None = None,
    with_states: bool = False,
    rows: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened responses (K + 1, R, 6, c) of ``columns``, written into ``out`` if given, and their predicted states
    (K + 1, R, n, c), an empty array where these are not wanted.

    s, f: system and its filter run; out: (K + 1, R, 6, c), columns of a larger array or not; with_states: whether the
    states are wanted; rows: (k,) rising grid times, the only ones of what is returned and of ``out`` (default: all).
    The residual is the column (end of a step less path, model less log).
    """
    forcing, observed, start = columns.forcing, columns.dense_observed, columns.start
    if columns.scale is not None:
        forcing, observed = forcing * columns.scale[:, None], observed * columns.scale[:, None]
    K, R, m, c = forcing.shape
    n = s.T.shape[2]
    states, white = np.zeros((K + 1, R, n, c)), np.empty((K + 1, R, 6, c))
    masked = np.where(s.good[..., None], observed, 0.0)  # rows that are not compared say nothing
    forcing = np.where(s.inside[..., None, None], forcing, 0.0)
    if start is not None:
        states[0] = start
    for k in range(K + 1):
        W = s.Z[k] @ states[k] + masked[k]  # its innovation
        white[k] = f.root[k] @ W
        if k < K:
            states[k + 1] = s.T[k] @ states[k] - f.gain[k] @ W
            states[k + 1, :, :m] += forcing[k]
    white = white if rows is None else white[rows]
    if out is not None:
        out[...] = white
    return white if out is None else out, states if with_states else np.empty(0)


def smoothed(
    s: LinearSystem, f: Filtered, white: np.ndarray, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smoothed states (K + 1, R, n), and the smoother's r (K, R, n) and u (K + 1, R, 6), from the residual's column.

    s, f: system and its filter run; white: (K + 1, R, 6), states: (K + 1, R, n) of that column by ``whitened``.
    """
    K, R, n = s.T.shape[:3]
    us = -(f.root.swapaxes(2, 3) @ white[..., None])  # F^-1 v; the minus as the column is -v
    rs, r = np.empty((K + 1, R, n, 1)), np.zeros((R, n, 1))  # rs: also with what is seen at the same time
    for k in range(K, -1, -1):
        if k < K:
            us[k] -= f.gain[k].swapaxes(1, 2) @ r  # backwards: what follows speaks of this sample
            r = s.T[k].swapaxes(1, 2) @ r
        rs[k] = r = r + s.Z[k].swapaxes(1, 2) @ us[k]  # r = Z' u + T' r (section 4.5)
    mean = states + (f.P @ rs)[..., 0]  # a + P r (section 4.4)
    return mean, rs[1:, ..., 0], us[..., 0]


@dataclass(frozen=True)
class Adjoint:
    """Derivatives of 1/2 log det F by the ship's rows of T (K, R, S, n) and by Z (K + 1, R, 6, n), and the diagonals N
    (K, R, n) and D (K + 1, R, 6), expected squares of the smoother's r and u; 0 where nothing is compared."""

    by_T: np.ndarray
    by_Z: np.ndarray
    N: np.ndarray
    D: np.ndarray


def adjoint(s: LinearSystem, f: Filtered) -> Adjoint:
    """Derivatives of the filter run f of the system s, by the recursion N_t = Z' F^-1 Z + L' N_t+1 L, in
    which L = T - K Z. Only that goes step by step; all else is done for all steps at once."""
    K, R, n = s.T.shape[:3]
    ZF = s.Z.swapaxes(2, 3) @ f.inverse
    last, L = ZF @ s.Z, s.T - f.gain @ s.Z[:-1]  # Z' F^-1 Z, and what is left of an error after a step
    back, N, NL = L.swapaxes(2, 3), np.empty((K, R, n, n)), np.empty((K, R, n, n))
    now = last[K]
    for k in range(K - 1, -1, -1):
        N[k] = now
        np.matmul(now, L[k], out=NL[k])
        now = back[k] @ NL[k]
        now += last[k]
    ahead = ZF.swapaxes(2, 3)
    ahead[:-1] -= f.gain.swapaxes(2, 3) @ NL  # through the gain to the next step; the last has none
    Ds = np.einsum("krii->kri", f.inverse).copy()
    Ds[:-1] += np.einsum("krij,krij->krj", f.gain, N @ f.gain)
    by_T, by_Z = NL[:, :, : s.S] @ f.P[:-1], np.where(s.good[..., None], ahead @ f.P, 0.0)
    return Adjoint(by_T, by_Z, np.einsum("krii->kri", N).copy(), np.where(s.good, Ds, 0.0))


def by_rates(s: LinearSystem, by_T: np.ndarray, h: float, gusts: np.ndarray | None = None) -> np.ndarray:
    """Derivative (K, R, S, S + 3) of 1/2 log det by the Jacobian of the ship's rates by states and latent force, times
    the step h [s]; 0 behind a window's end.

    s: the system; by_T: of its adjoint; gusts: as of ``GriddedTrials``, which push as the latent force does. T is the
    exponential of the generator: a change of the generator acts equally on either side of the step.
    """
    A = s.S
    weight, through = np.where(s.inside[..., None, None], by_T[..., : A + 3], 0.0), s.T[:, :, :A, : A + 3]
    if gusts is not None:  # they act by the columns of the force
        weight[..., A:] += by_T[..., A + 3 :] @ gusts.swapaxes(2, 3)
    # dT = h (dA T + T dA) / 2 for T = exp(A h)
    ahead = np.concatenate([weight @ through.swapaxes(2, 3), weight[..., A:]], axis=3)
    return np.asarray(0.5 * h * (ahead + through[..., :A].swapaxes(2, 3) @ weight))


def observations(s: LinearSystem, f: Filtered, white: np.ndarray) -> np.ndarray:
    """The deviations (K + 1, R, 6, c) of what is logged from the path without random forces whose whitened residuals
    are ``white`` (K + 1, R, 6, c). s, f: system and its filter run."""
    K, R, n = s.T.shape[:3]
    y, state = np.empty(white.shape), np.zeros((R, n, white.shape[3]))
    for k in range(K + 1):
        innovation = np.linalg.solve(f.root[k], white[k])  # whitening undone
        y[k] = s.Z[k] @ state + innovation
        if k < K:
            state = s.T[k] @ state + f.gain[k] @ innovation
    return y
