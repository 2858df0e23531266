"""Candidates learned by the objective of Miyauchi et al. (2023), each by several seeds: the best on validation.

A polynomial with wrong coefficients diverges within a subsequence of 100 s, where its error has no useful slope. So the
start is that of a regression on the velocities (``polynomial_regression``). Proximal Gauss-Newton steps follow, along
weights of the sparsity from strong to weak: each minimises the model with the moduli and the bounds, for several
dampings at once, of which simulation of all takes the best. (CMA-ES, as in the paper, reached J = .354 for .353 with 22
unknowns and .257 for .200 with 50, in 20 times as many simulations.)

J = E + w_D D + w_1 sum |p_i|. E is the mean squared error of u, v and r, each by its standard deviation over the
training trials, in subsequences simulated from their measured beginning; from the step on at which a subsequence leaves
the limits each velocity counts LIMIT^2, so an earlier exit is worse. D is the mean squared excess of accelerations over
their limits, by these, at the extremes of ``extremes_of``. p are coefficients by the standard deviations of their
priors; those of generated terms are penalised. The paper's form of Eqs. 17, 22 and 26 was lost in conversion: squares
and means are UNVERIFIED, and accelerations are those at the first instant. Bounds of the ship file are the domain.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from cases.io.files import replace_text
from cases.simulation.harbour_inputs import ranges_of
from cases.trial import Trial
from fitting.nlp.prior import Prior
from fitting.nlp.windows import default_step, pieces_of
from fitting.parallel import run_all
from fitting.report.run_folder import Real, Store, adapter, plain
from fitting.selection.candidates import StructureCandidate
from fitting.selection.polynomial_regression import increments, regress
from fitting.settings import Settings
from mmg.errors import OutOfRange, TooFewData
from mmg.messages import LOGGER
from mmg.model import settled
from mmg.motion.flow import INPUTS
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

LENGTH = 100.0  # Length of a subsequence [s of a 3 m model] (Miyauchi et al. 2023).
# Error of a velocity, by its standard deviation, from which on a subsequence has left the limits. Set by hand.
LIMIT = 20.0
VELOCITIES = slice(3, 6)  # Rows of u, v and r among x, y, psi, u, v, r: the states that the objective compares
MARGIN = 1.2  # Factor on the range of the motions of the trials at the extremes. Set by hand.
# Most combinations of inputs at each of the 27 motions: 1,350 = 27 x 50 (Miyauchi et al. 2023, section 3.1.2).
INPUTS_EACH = 50
# Levels of an actuator by its unit: two of the revolutions, five of each of two rudders (UNVERIFIED).
LEVELS = {"rps": 2, "rad": 5}
# Step of the coefficients, by the standard deviations of their priors, of the differences behind derivatives. The root
# of the rounding of doubles. Set by hand near it.
DIFFERENCE = 1e-8
AT_ONCE = 4000  # Subsequences simulated side by side for these. Set by hand: it bounds memory.
PERCENTILE = 99.7  # Of the accelerations in the trials, from which on they are limited (Miyauchi et al. 2023).


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
            rows = np.minimum(rows, piece.steps - 1)  # the last inputs are held: arrays are of one length

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

    state: (6, m); controls: (C, m), as the ship's inputs; limit: (3,) of du/dt, dv/dt [m/s^2] and dr/dt [rad/s^2].
    """

    state: np.ndarray
    controls: np.ndarray
    limit: np.ndarray


def extremes_of(ship: Ship, trials: Sequence[Trial]) -> Extremes:
    """The extremes for ``ship`` by the range of ``trials``, in calm air: 1,350 for one propeller and two rudders.

    Where there are more than INPUTS_EACH combinations of the actuators' levels, so many of them are drawn.
    """
    low, high = (f(np.concatenate([t["u"] for t in trials])) for f in (np.nanmin, np.nanmax))
    # astern at least at a tenth of the speed
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
        rng = np.random.default_rng([29, 0])  # the same ones for every ship and run
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


class SubsequenceObjective:
    """The objective for the free coefficients of ``ship`` on training trials, and its error on validation trials.

    train, validate: trials; compiled: use a C compiler if there is one. deviation, sparsity: its weights w_D and w_1.
    Scaled coefficients p are (P,) or, for K candidates, (P, K); p = 0 are the values of the ship. Raises UserError for
    trials without motion or without a piece long enough.
    """

    def __init__(self, ship: Ship, train: Sequence[Trial], validate: Sequence[Trial], compiled: bool = True) -> None:
        self.ship, self.prior, self.P = ship, Prior.of(ship), len(ship.free)
        self.deviation, self.sparsity = 0.01, 0.0  # the former set by hand
        self.simulator = Simulator(ship, compiled)
        self.free = np.array([ship.symbols.index(s) for s in self.prior.symbols], dtype=int)
        L = ship.particulars["L"]
        step, length, self.sigma = default_step(train, L), LENGTH * time_scale(L), spread_of(train)
        self.train, self.validate = (subsequences(some, step, length, ship.inputs) for some in (train, validate))
        self.extremes = extremes_of(ship, train)
        self.lower, self.upper = self.prior.scaled_bounds
        self.sparse = np.array([s in ship.monomials for s in self.prior.symbols], dtype=float)  # (P,), 1: penalised
        self.evaluations = 0

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
        total = self.errors(p, self.train)
        if self.deviation:
            total = total + self.deviation * self.deviations(p)
        return total + self.sparsity * (self.sparse @ np.abs(p))

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
        states = self.simulator.run(start, controls, data.h, theta)[1:, VELOCITIES]
        e = (states.reshape(len(states), 3, K, W) - data.measured[:, :, None]) / self.sigma[:, None, None]
        inside = (np.abs(e) < LIMIT).all(axis=1) | (data.weight == 0)[:, None]  # nothing leaves after its end
        return e, np.logical_and.accumulate(inside, axis=0)[:, None]  # once out, out for good

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
            J[:, some] = (moved - e[counted][:, None]) / DIFFERENCE  # (errors that count, unknowns)
        n = 3 * data.samples
        gradient, hessian = 2 / n * (e[counted] @ J), 2 / n * (J.T @ J)
        if self.deviation:
            now, *others = self._accelerations(np.column_stack([p, near]))
            over = np.abs(now) > 1  # elsewhere D is flat
            A = np.transpose([(one - now)[over] / DIFFERENCE for one in others]) * np.sign(now[over])[:, None]
            share = 2 * self.deviation / now.size
            gradient, hessian = gradient + share * ((np.abs(now[over]) - 1) @ A), hessian + share * (A.T @ A)
        return gradient, hessian


# Weights of the sparsity, from strong to weak: half decades from .1 to 1e-5. A grid set by hand.
SPARSITIES = tuple(float(w) for w in 10.0 ** np.arange(-1.0, -5.1, -0.5))
# The path ends where the validation error is WORSE times its least at PATIENCE weights in a row.
WORSE = 1.5  # set by hand: it bounds the time
PATIENCE = 3  # set by hand, with it
SPREAD = 0.3  # Standard deviation of starts of further seeds about the regression, by those of the priors. Set by hand.
ON_PATH = 10  # Most steps at each weight of the path. Set by hand: it bounds the time.
LAST = 20  # Most steps without any weight. Set by hand: it bounds the time.
# Dampings tried at once, by the last that was best. A grid set by hand.
FACTORS = np.array([1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3])


@dataclass(frozen=True)
class Lesson:
    """One point of a learning curve.

    evaluations: simulations of all training subsequences so far; seconds: of the run so far; objective: J of its
    current point; training, validation: E of it.
    """

    evaluations: int
    seconds: float
    objective: Real
    training: Real
    validation: Real


class Learning:
    """The learning curve of one run on ``objective``, which began at ``began`` by the clock of ``time.perf_counter``.

    lessons: the curve; chosen, p: the lesson of least validation error and where.
    """

    def __init__(self, objective: SubsequenceObjective, began: float | None = None) -> None:
        self.objective, self.began = objective, time.perf_counter() if began is None else began
        self.lessons: list[Lesson] = []
        self.chosen: Lesson

    @property
    def seconds(self) -> float:
        """Of the run so far."""
        return time.perf_counter() - self.began

    def note(self, p: np.ndarray) -> Lesson:
        """Adds the point ``p`` (P,) to the curve; its evaluation does not count."""
        problem = self.objective
        evaluations = problem.evaluations
        value = float(problem.values(p[:, None])[0])
        training, validation = (float(problem.errors(p[:, None], d)[0]) for d in (problem.train, problem.validate))
        problem.evaluations = evaluations
        lesson = Lesson(evaluations, self.seconds, value, training, validation)
        if not self.lessons or validation < self.chosen.validation:
            self.chosen, self.p = lesson, p.copy()
        self.lessons.append(lesson)
        return lesson


def write_learning(runs: Sequence[Learned], path: Path) -> None:
    """Writes the learning curves of ``runs`` as CSV to ``path``."""
    import pandas as pd

    rows = [{"candidate": run.name, "seed": run.seed} | vars(lesson) for run in runs for lesson in run.lessons]
    replace_text(path, pd.DataFrame(rows).to_csv(index=False, float_format="%.9g"))


@dataclass(frozen=True)
class Learned:
    """The best point of one run of a candidate.

    values: of its free coefficients, by symbol; vanished: generated terms that are zero; training, validation: E of the
    objective; objective: least J; seconds, evaluations: of the run; seed; lessons: learning curve.
    """

    name: str
    seed: int
    values: dict[str, float]
    vanished: tuple[str, ...]
    training: Real
    validation: Real
    objective: Real
    seconds: float
    evaluations: int
    lessons: tuple[Lesson, ...]


def kept_run(store: Store, name: str) -> Learned | None:
    """The finished run ``name`` of a ``store``, None where there is none or it cannot be read: it is made again."""
    with suppress(ValidationError):
        return adapter(Learned).validate_python(part[0]) if (part := store.load(name)) else None
    return None


def learn_all(
    given: Sequence[StructureCandidate],
    trials: tuple[Sequence[Trial], Sequence[Trial]],
    settings: Settings,
    seeds: int = 1,
    store: Store | None = None,
) -> dict[str, list[Learned]]:
    """Runs of each of the candidates ``given`` by name, the one with the least validation error first.

    trials: to train on and to validate; settings: seed of the first run, workers over which runs are spread, time limit
    of each [s]; seeds: runs of each candidate; store: finished runs, which are taken from there, and to which others
    are added as they come. Raises UserError for trials from which nothing can be learned.
    """
    numbers = range(settings.seed, settings.seed + seeds)
    runs = {f"{one.name}_seed{seed}": (one, seed) for one in given for seed in numbers}
    if store:
        store.open()
    learned = {name: run for name in runs if store and (run := kept_run(store, name))}
    missing = [name for name in runs if name not in learned]

    def keep(run: Learned) -> None:
        if store:
            store.save(f"{run.name}_seed{run.seed}", plain(run))
        LOGGER.info(f"{run.name}, seed {run.seed}: J {run.objective:.4g}, validation {run.validation:.4g} after "
                    f"{run.seconds:.0f} s")  # fmt: skip

    task = partial(learn_one, trials=trials, settings=settings)
    done = run_all(task, [runs[name] for name in missing], settings.workers, keep, "models")
    learned |= zip(missing, done, strict=True)
    best = sorted(learned.values(), key=lambda run: run.validation if run.validation >= 0 else float("inf"))
    return {one.name: [run for run in best if run.name == one.name] for one in given}


def learn_one(
    run: tuple[StructureCandidate, int], trials: tuple[Sequence[Trial], Sequence[Trial]], settings: Settings
) -> Learned:
    """One ``run``, a candidate and a seed, on ``trials`` to train on and to validate; the first begins at the
    regression. settings: seed, time limit.

    The time limit counts from here, compiling and preparing belong to it; a first point is evaluated in any case.
    """
    began, (one, seed) = time.perf_counter(), run
    problem = SubsequenceObjective(one.ship, *trials, compiled=settings.compiled)
    learning, start = Learning(problem, began), regression(problem, trials[0])
    if seed != settings.seed:
        start += SPREAD * np.random.default_rng([37, seed]).standard_normal(problem.P)
    follow(learning, np.clip(start, problem.lower, problem.upper), settings.time_limit or float("inf"))
    p, symbols = learning.p, problem.prior.symbols
    ship = problem.ship_at(p)
    return Learned(
        name=one.name,
        seed=seed,
        values={s: ship.coefficients[s].value for s in symbols},
        vanished=tuple(s for s, x, sparse in zip(symbols, p, problem.sparse, strict=True) if sparse and x == 0),
        training=learning.chosen.training,
        validation=learning.chosen.validation,
        objective=min(lesson.objective for lesson in learning.lessons),
        seconds=learning.seconds,
        evaluations=learning.lessons[-1].evaluations,
        lessons=tuple(learning.lessons),
    )


def follow(learning: Learning, p: np.ndarray, limit: float = float("inf")) -> None:
    """The path of the sparsity from strong to weak from ``p`` (P,) on, then the descent without any.

    Notes in ``learning`` the end of each weight, and each step of the descent; ends where validation grows worse, or at
    the ``limit`` [s].
    """
    problem, worse = learning.objective, 0
    for weight in (*SPARSITIES, 0.0):
        problem.sparsity = weight
        if learning.seconds <= limit:
            for step in descent(problem, p, ON_PATH if weight else LAST):
                p = step
                if not weight:
                    learning.note(p)
                if learning.seconds > limit:
                    break
        lesson = learning.note(p)
        worse = worse + 1 if lesson.validation > WORSE * learning.chosen.validation else 0
        if worse >= PATIENCE or learning.seconds > limit:
            break


def regression(problem: SubsequenceObjective, trials: Sequence[Trial]) -> np.ndarray:
    """Scaled coefficients p (P,) of ``problem`` by regression on the velocities of its training ``trials``."""
    found = regress(problem.ship, increments(problem.ship, trials)).values
    return (np.array([found[s] for s in problem.prior.symbols]) - problem.prior.mean) / problem.prior.std


def descent(problem: SubsequenceObjective, p: np.ndarray, most: int) -> Iterator[np.ndarray]:
    """Points (P,) of at most ``most`` steps that lower the objective of ``problem`` from ``p`` on."""
    value, damping, past = float(problem.values(p[:, None])[0]), 1.0, []
    weight, box = problem.sparsity * problem.sparse, (problem.lower, problem.upper)
    for _ in range(most):
        gradient, hessian = problem.quadratic(p)
        diagonal = np.diag(hessian)
        size = np.maximum(diagonal, 1e-6 * diagonal.max() + 1e-300)  # what hardly acts is damped too
        tried = []
        for mu in damping * FACTORS:
            H = hessian + np.diag(1e-3 * mu * size + 1e-9 * diagonal.max())  # by the diagonal (Marquardt 1963)
            tried.append(minimise_quadratic(H, gradient, p, box, weight))
        values = problem.values(np.transpose(tried))
        best = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
        if not values[best] < value:
            if damping > 1e8:  # the step is rounding
                return
            damping *= 1e4  # beyond all of FACTORS, whose largest is 1e3
            continue
        p, value, damping = tried[best], float(values[best]), max(damping * FACTORS[best], 1e-10)
        yield p
        past.append(value)
        if len(past) > 3 and past[-4] - past[-1] < 1e-4 * past[-1]:  # three steps gain next to nothing; set by hand
            return


def minimise_quadratic(
    H: np.ndarray, g: np.ndarray, p: np.ndarray, box: tuple[np.ndarray, np.ndarray], weight: np.ndarray
) -> np.ndarray:
    """The point x (P,) that makes g (x - p) + 1/2 (x - p) H (x - p) + sum weight |x| least within ``box``.

    H: (P, P), positive definite; g, p, weight: (P,); p within the box. The value is never above that of p. Accelerated
    proximal gradients with restarts (Beck & Teboulle 2009; O'Donoghue & Candes 2015) scaled by the diagonal.
    """
    scale = 1 / np.sqrt(np.diag(H))
    A, b = H * np.outer(scale, scale), scale * g
    low, high, lam, origin = box[0] / scale, box[1] / scale, weight * scale, p / scale
    largest = float(np.linalg.eigvalsh(A)[-1])

    def value(x: np.ndarray) -> float:
        d = x - origin
        return float(b @ d + 0.5 * d @ (A @ d) + lam @ np.abs(x))

    x, y, t = origin, origin, 1.0
    for _ in range(200):
        free = y - (b + A @ (y - origin)) / largest
        # soft threshold, then the box
        new = np.clip(np.sign(free) * np.maximum(np.abs(free) - lam / largest, 0), low, high)
        if np.abs(new - x).max() < 1e-5 * np.abs(new).max():  # five digits: steps follow; set by hand
            break
        t = 1.0 if (y - new) @ (new - x) > 0 else t  # restart where the momentum points uphill
        later = 0.5 * (1 + np.sqrt(1 + 4 * t * t))
        y, x, t = new + (t - 1) / later * (new - x), new, later
    return min((x, origin), key=value) * scale  # it may have ended early
