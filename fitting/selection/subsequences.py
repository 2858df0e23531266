"""The objective of Miyauchi et al. (2023), Eqs. 16 to 30, for many candidates at once, and its derivatives.

J = E + w_D D + w_1 sum |p_i|. E is the mean squared error of u, v and r, each by its standard deviation over the
training trials, in subsequences simulated from their measured beginning; from the step on at which a subsequence leaves
the limits each velocity counts LIMIT^2, so an earlier exit is worse. D is the mean squared excess of accelerations over
their limits, by these, at the extremes of ``extremes_of``. p are coefficients by the standard deviations of their
priors; those of generated terms are penalised. The paper's form of Eqs. 17, 22 and 26 was lost in conversion: squares
and means are UNVERIFIED, and accelerations are those at the first instant. Bounds of the ship file are the domain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cases.simulation.harbour_inputs import ranges_of
from cases.trial import Trial
from fitting.nlp.prior import Prior
from fitting.nlp.windows import default_step, pieces_of
from mmg.errors import OutOfRange, TooFewData
from mmg.model import settled
from mmg.motion.flow import INPUTS
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

LENGTH = 100.0
"""Length of a subsequence [s of a 3 m model] (Miyauchi et al. 2023)."""
LIMIT = 20.0
"""Error of a velocity, by its standard deviation, from which on a subsequence has left the limits. Set by hand."""
VELOCITIES = slice(3, 6)
"""Rows of u, v and r among x, y, psi, u, v, r: the states that the objective compares."""
MARGIN = 1.2
"""Factor on the range of the motions of the trials at the extremes. Set by hand."""
INPUTS_EACH = 50
"""Most combinations of inputs at each of the 27 motions: 1,350 = 27 x 50 (Miyauchi et al. 2023, section 3.1.2)."""
LEVELS = {"rps": 2, "rad": 5}
"""Levels of an actuator by its unit: two of the revolutions, five of each of two rudders (UNVERIFIED: lost in
conversion)."""
DIFFERENCE = 1e-8
"""Step of the coefficients, by the standard deviations of their priors, of the differences behind derivatives. The root
of the rounding of doubles."""
AT_ONCE = 4000
"""Subsequences simulated side by side for these, which bounds the memory it takes."""
PERCENTILE = 99.7
"""Of the accelerations in the trials, from which on they are limited (Miyauchi et al. 2023)."""


@dataclass(frozen=True)
class Subsequences:
    """W subsequences of up to N steps of h [s].

    start: (6, W) measured x, y, psi, u, v, r at their beginning, position 0; controls: (N, C, W) mean inputs over each
    step; measured: (N, 3, W) u, v, r at the end of each step, 0 where there is none; weight: (N, W) 1 where there is
    one, 0 after the end of a shorter subsequence.
    """

    h: float
    start: np.ndarray
    controls: np.ndarray
    measured: np.ndarray
    weight: np.ndarray

    @property
    def count(self) -> int:
        """W."""
        return self.start.shape[1]

    @property
    def samples(self) -> float:
        """Number of samples compared, each of three velocities."""
        return float(self.weight.sum())


def subsequences(trials: Sequence[Trial], h: float, length: float, inputs: Sequence[str]) -> Subsequences:
    """The subsequences of ``length`` [s] of ``trials`` on steps of h [s], for a model with these ``inputs``.

    Each piece without gaps is cut from its beginning on; what remains at its end is a shorter one. Raises UserError
    where no piece has ten steps, or one step is longer than a subsequence.
    """
    N = round(length / h)
    if N < 1:
        raise OutOfRange(f"subsequences of {length:g} s are shorter than one step of {h:g} s; use a smaller --step")
    starts, controls, measured, weights = [], [], [], []
    for piece in pieces_of(trials, h, inputs):
        for first in range(0, piece.steps if piece.steps >= min(10, N) else 0, N):
            rows = np.arange(first, first + N)
            there = rows < piece.steps
            rows = np.minimum(rows, piece.steps - 1)
            starts.append(np.concatenate([[0.0, 0.0], piece.logged[first, 2:]]))
            controls.append(piece.controls[rows])
            measured.append(np.where(there[:, None], piece.logged[rows + 1, VELOCITIES], 0.0))
            weights.append(there)
    if not starts:
        names = ", ".join(t.name for t in trials)
        raise TooFewData(f"{names}: no piece without gaps has ten steps of {h:g} s; use longer records")
    return Subsequences(
        h,
        np.transpose(starts),
        np.ascontiguousarray(np.transpose(controls, (1, 2, 0))),
        np.ascontiguousarray(np.transpose(measured, (1, 2, 0))),
        np.transpose(weights).astype(float),
    )


def spread_of(trials: Sequence[Trial]) -> np.ndarray:
    """Standard deviations (3,) of u, v [m/s] and r [rad/s] over ``trials``, by which errors are divided.

    Raises UserError for a velocity that never changes.
    """
    sigma = np.array([np.nanstd(np.concatenate([t[name] for t in trials])) for name in ("u", "v", "r")])
    still = [name for name, value in zip("uvr", sigma, strict=True) if not value > 0]
    if still:
        raise TooFewData(f"{', '.join(t.name for t in trials)}: {', '.join(still)} never changes; give others")
    return sigma


@dataclass(frozen=True)
class Extremes:
    """Motions and inputs at which a polynomial must not accelerate more than the ship was seen to.

    state: (6, m); controls: (C, m), in the order of the ship's inputs; limit: (3,) of du/dt, dv/dt [m/s^2] and dr/dt
    [rad/s^2].
    """

    state: np.ndarray
    controls: np.ndarray
    limit: np.ndarray


def extremes_of(ship: Ship, trials: Sequence[Trial], seed: int = 0) -> Extremes:
    """The extremes for ``ship`` by the range of ``trials``, in calm air: 1,350 for one propeller and two rudders.

    Where there are more than INPUTS_EACH combinations of the actuators' levels, so many of them are drawn; seed: of
    that draw.
    """
    low, high = (f(np.concatenate([t["u"] for t in trials])) for f in (np.nanmin, np.nanmax))
    motions = [np.array([MARGIN * min(low, -0.1 * high), 0.5 * (low + high), MARGIN * high])]
    for name in ("v", "r"):
        most = MARGIN * max(float(np.nanmax(np.abs(t[name]))) for t in trials)
        motions.append(np.array([-most, 0.0, most]))
    levels = []
    for name, (lowest, highest) in ranges_of(ship).items():
        given = np.concatenate([t[name] for t in trials if name in t] or [np.zeros(1)])
        edges = min(lowest, float(np.nanmin(given))), max(highest, float(np.nanmax(given)))
        levels.append(np.linspace(*edges, LEVELS.get(INPUTS[name][1], 3)))
    each = np.array(list(product(*levels)))
    if len(each) > INPUTS_EACH:
        rng = np.random.default_rng([29, seed])
        each = each[np.sort(rng.choice(len(each), INPUTS_EACH, replace=False))]
    pairs = [(m, c) for m in product(*motions) for c in each]
    state, controls = np.zeros((6, len(pairs))), np.zeros((len(ship.inputs), len(pairs)))
    state[3:] = np.transpose([m for m, _ in pairs])
    for column, name in enumerate(ranges_of(ship)):
        controls[ship.inputs.index(name)] = [c[column] for _, c in pairs]
    return Extremes(state, controls, acceleration_limits(trials, time_scale(ship.particulars["L"])))


def acceleration_limits(trials: Sequence[Trial], seconds: float) -> np.ndarray:
    """The PERCENTILE of the modulus of du/dt, dv/dt, dr/dt (3,) in ``trials``, differences averaged over ``seconds``.

    Raises ValueError where no trial has two finite neighbours.
    """
    differences: list[np.ndarray] = []
    for trial in trials:
        span = max(1, round(seconds / trial.dt))
        rows = np.column_stack([trial[name] for name in ("u", "v", "r")])
        differences.append((rows[span:] - rows[:-span]) / (trial.t[span:] - trial.t[:-span])[:, None])
    rates = np.abs(np.concatenate(differences))
    rates = rates[np.isfinite(rates).all(axis=1)]
    if not len(rates):
        raise ValueError("no accelerations in the trials")
    return np.percentile(rates, PERCENTILE, axis=0)


@dataclass(frozen=True)
class Penalties:
    """Weights of the objective: ``deviation`` w_D and ``sparsity`` w_1."""

    deviation: float = 0.01
    sparsity: float = 0.0


class SubsequenceObjective:
    """The objective for the free coefficients of ``ship`` on training trials, and its error on validation trials.

    train, validate: trials; penalties: weights; step: of simulation [s], None:
    ``default_step``; compiled: use a C compiler if there is one. Scaled coefficients p are (P,) or, for K candidates,
    (P, K); p = 0 are the values of the ship. Raises UserError for trials without motion or without a piece long enough.
    """

    def __init__(
        self,
        ship: Ship,
        train: Sequence[Trial],
        validate: Sequence[Trial],
        penalties: Penalties | None = None,
        step: float | None = None,
        compiled: bool = True,
    ) -> None:
        self.ship, self.penalties, self.prior = ship, penalties or Penalties(), Prior.of(ship)
        self.simulator = Simulator(ship, compiled)
        self.free = np.array([ship.symbols.index(s) for s in self.prior.symbols], dtype=int)
        L = ship.particulars["L"]
        self.step, self.length = step or default_step(train, L), LENGTH * time_scale(L)
        self.sigma = spread_of(train)
        self.train = subsequences(train, self.step, self.length, ship.inputs)
        self.validate = subsequences(validate, self.step, self.length, ship.inputs)
        self.extremes = extremes_of(ship, train)
        self.lower, self.upper = self.prior.scaled_bounds
        own = ship.monomials
        self.sparse = np.array([s in own for s in self.prior.symbols], dtype=float)
        self.evaluations = 0

    @property
    def P(self) -> int:
        """Number of unknowns."""
        return len(self.prior.symbols)

    def coefficients(self, p: np.ndarray) -> np.ndarray:
        """All coefficients of the ship, (all,) or (all, K), from scaled free ones ``p``."""
        shape = (-1, *(1,) * (p.ndim - 1))
        values = np.repeat(self.ship.values.reshape(shape), p.shape[1], axis=1) if p.ndim == 2 else +self.ship.values
        values[self.free] = self.prior.mean.reshape(shape) + self.prior.std.reshape(shape) * p
        return values

    def ship_at(self, p: np.ndarray) -> Ship:
        """The ship with the coefficients ``p`` (P,)."""
        return self.ship.with_values(dict(zip(self.prior.symbols, self.coefficients(p)[self.free], strict=True)))

    def values(self, p: np.ndarray) -> np.ndarray:
        """J (K,) of the candidates ``p`` (P, K)."""
        weights, total = self.penalties, self.errors(p, self.train)
        if weights.deviation:
            total = total + weights.deviation * self.deviations(p)
        return total + weights.sparsity * (self.sparse @ np.abs(p))

    @np.errstate(all="ignore")
    def errors(self, p: np.ndarray, data: Subsequences) -> np.ndarray:
        """E (K,) of the candidates ``p`` (P, K) on ``data``."""
        self.evaluations += p.shape[1]
        e, inside = self._errors(p, data)
        squares = np.where(inside, e**2, LIMIT**2)
        return (squares * data.weight[:, None, None]).sum(axis=(0, 1, 3)) / (3 * data.samples)

    @np.errstate(all="ignore")
    def deviations(self, p: np.ndarray) -> np.ndarray:
        """D (K,) of the candidates ``p`` (P, K)."""
        return np.array([(np.maximum(np.abs(one) - 1, 0) ** 2).mean() for one in self._accelerations(p)])

    @np.errstate(all="ignore")
    def _errors(self, p: np.ndarray, data: Subsequences) -> tuple[np.ndarray, np.ndarray]:
        """Standardised errors (N, 3, K, W) of the candidates ``p`` (P, K) on ``data``, and where they count: a
        subsequence (N, 1, K, W) that has not left the limits yet."""
        K, W = p.shape[1], data.count
        theta = np.repeat(self.coefficients(p), W, axis=1)
        start, controls = np.tile(data.start, K), np.tile(data.controls, (1, 1, K))
        states = self.simulator.run(start, controls, data.h, theta, threads=1)[1:, VELOCITIES]
        e = (states.reshape(len(states), 3, K, W) - data.measured[:, :, None]) / self.sigma[:, None, None]
        inside = (np.abs(e) < LIMIT).all(axis=1) | (data.weight == 0)[:, None]
        return e, np.logical_and.accumulate(inside, axis=0)[:, None]

    @np.errstate(all="ignore")
    def _accelerations(self, p: np.ndarray) -> list[np.ndarray]:
        """Accelerations (3, m) at the extremes by their limits, of each of the candidates ``p`` (P, K)."""
        far, found = self.extremes, []
        for theta in self.coefficients(p).T:
            state = settled(self.simulator.model, far.state, far.controls, theta)
            rates = self.simulator.rates(state, far.controls, np.ascontiguousarray(theta))[VELOCITIES]
            found.append(rates / far.limit[:, None])
        return found

    def quadratic(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (P,) and Gauss-Newton Hessian (P, P) of E + w_D D on the training trials at ``p`` (P,), by
        differences of what is squared; what has left the limits is constant."""
        data, P, near = self.train, self.P, p[:, None] + DIFFERENCE * np.eye(self.P)
        e, inside = (part[:, :, 0] for part in self._errors(p[:, None], data))
        counted = np.broadcast_to(inside & (data.weight > 0)[:, None], e.shape)
        J, at_once = np.zeros((int(counted.sum()), P)), max(1, AT_ONCE // data.count)
        for first in range(0, P, at_once):
            some = slice(first, first + at_once)
            moved = np.moveaxis(self._errors(near[:, some], data)[0], 2, 3)[counted]
            J[:, some] = (moved - e[counted][:, None]) / DIFFERENCE
        n = 3 * data.samples
        gradient, hessian = 2 / n * (e[counted] @ J), 2 / n * (J.T @ J)
        if self.penalties.deviation:
            now, *others = self._accelerations(np.column_stack([p, near]))
            over = np.abs(now) > 1
            A = np.transpose([(one - now)[over] / DIFFERENCE for one in others]) * np.sign(now[over])[:, None]
            share = 2 * self.penalties.deviation / now.size
            gradient, hessian = gradient + share * ((np.abs(now[over]) - 1) @ A), hessian + share * (A.T @ A)
        return gradient, hessian
