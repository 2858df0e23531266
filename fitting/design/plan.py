"""A trial of one's own design: rudder and revolutions that lower the uncertainty of what is wanted most.

The trial's Fisher information, by the right-hand side, noise and windows of the calibration, is added to her present
precision; the mean log variance of what is wanted is minimised (Bayesian design, Chaloner & Verdinelli 1995). The
search goes on from the best manoeuvre of the library that fits into the area, from the best two of these one after the
other, and from a random sequence. Two standard deviations of the track, by draws of the coefficients, must stay inside
the area too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np

from cases.maneuvers.definitions import Limits
from cases.maneuvers.self_propulsion import engine_of, own_speed, revolutions_for
from cases.simulation.simulate_batch import input_array
from cases.trial import Trial
from fitting.design.next_trial import Option, library, repetitions, runs
from fitting.nlp.fisher_information import information
from fitting.nlp.prior import Prior
from fitting.nlp.problem import Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import Segments
from fitting.parallel import Shared, kept_workers, run_all, width
from fitting.settings import Wish
from mmg.errors import BadValue, NoSolution, OutOfRange
from mmg.messages import OnProgress, Progress
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship


@dataclass(frozen=True)
class TrialWorth:
    """What a simulated trial would tell, as the fit of a run takes it: the same right-hand side, noise and windows.

    simulator: of the calibrated ship; prior: of her free coefficients, in whose standard deviations all is; sigma: (6,)
    noise of the states, infinite where one is not measured; dt: step [s]; window: steps of a window; precision: (P, P)
    of the coefficients now; worth: factor on the information of a trial for residuals correlated beyond the noise
    model; wanted: (m, P) combinations of the coefficients that are to be known better; names: of these (m,).
    """

    simulator: Simulator
    prior: Prior
    sigma: np.ndarray
    dt: float
    window: int
    precision: np.ndarray
    worth: float
    wanted: np.ndarray
    names: tuple[str, ...]

    def __reduce__(self) -> tuple:  # without the kernels: in another process they are taken from the cache
        return TrialWorth, tuple(getattr(self, field.name) for field in fields(self))

    @cached_property
    def kernels(self) -> Kernels:
        """Right-hand side and Jacobian of the ship."""
        free = self.prior.positions(self.simulator.ship)
        return Kernels(self.simulator.model, free, self.simulator.compiled)

    def fisher(self, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Fisher information (K, P, P) of motions ``states`` (N + 1, S, K) under ``inputs`` (N, C, K), prior excluded.
        The state at the begin of each window, which is one shooting interval, is unknown."""
        (N, C, K), S, P = inputs.shape, states.shape[1], len(self.prior.symbols)
        windows = max(1, round(N / self.window))
        m, M = N // windows, windows * K  # steps of a window; the first windows of all trials, then the second
        first, each, measured = m * np.arange(windows), np.arange(M), np.isfinite(self.sigma).astype(float)
        controls = np.ascontiguousarray(np.concatenate([inputs[k : k + m] for k in first], axis=2))
        ends = np.stack([states[first], states[first + m]])  # (2, windows, S, K)
        segments = Segments(
            h=self.dt,
            steps=np.full(M, m),
            start=2 * each,  # nodes: begin and end of each window in turn
            end=2 * each + 1,
            controls=controls,
            targets=np.zeros((m - 1, 6, M)),  # information knows no residuals
            mask=np.tile(measured[:, None], (m - 1, 1, M)),
            nodes=(nodes := ends.transpose(1, 3, 0, 2).reshape(2 * M, S))[:, :6],
            node_mask=np.tile(measured, (2 * M, 1)),
            node_controls=controls[[0, -1]].transpose(1, 2, 0).reshape(C, 2 * M),
            window=each,
            node_window=np.repeat(each, 2),
            run=np.tile(np.arange(K), windows),
            trials=(),
            duration=N * self.dt,
        )
        sigma = np.where(measured > 0, self.sigma, 1.0)  # the mask leaves these states out
        problem = Problem(self.simulator.ship, self.prior, self.kernels, segments, sigma)
        fisher = information(problem, problem.join(nodes, np.zeros(P))).fisher
        return np.nan_to_num(fisher, posinf=0.0, neginf=0.0).reshape(windows, K, P, P).sum(axis=0)

    def variances(self, fisher: np.ndarray | None = None) -> np.ndarray:
        """Variances (..., m) of what is wanted with trials of information ``fisher`` (..., P, P); None: now."""
        A = self.precision if fisher is None else self.precision + self.worth * fisher
        return np.einsum("mp,...pq,mq->...m", self.wanted, np.linalg.inv(A), self.wanted)

    def gain(self, fisher: np.ndarray) -> np.ndarray:
        """Mean logarithm of the variances with trials of information ``fisher`` (..., P, P) less that of now, (...)."""
        return np.log(self.variances(fisher) / self.variances()).mean(axis=-1)


# Headings [rad] in which a track is tried; the opposite ones leave as much room. Set by hand.
HEADINGS = np.radians(np.arange(0, 180, 15))


@dataclass(frozen=True)
class Area:
    """A rectangle with x (north) from 0 to ``length`` and y (east) from 0 to ``width`` [m]. margin: that the hull keeps
    from its edges [m]."""

    length: float
    width: float
    margin: float

    @classmethod
    def parse(cls, text: str, ship: Ship, margin: float | None = None) -> Area:
        """The area that ``text`` such as "60x25" names; margin [m], default half the beam of ``ship``. Raises UserError
        for a text that is no area, and for an area that the ship does not fit into."""
        try:
            length, width = (float(part) for part in text.lower().split("x"))
        except ValueError:
            length = width = math.nan
        if not (0 < length < math.inf and 0 < width < math.inf):
            raise BadValue(f"--area {text}: give length x width in metres, both positive, such as 60x25")
        L, B = ship.particulars["L"], ship.particulars["B"]
        margin = B / 2 if margin is None else margin
        if not (math.isfinite(margin) and margin >= 0):
            raise OutOfRange(f"--margin {margin:g} m must not be negative")
        if max(length, width) < L + 2 * margin or min(length, width) < B + 2 * margin:
            raise OutOfRange(
                f"--area {text}: {ship.called} ({L:g} m long, {B:g} m wide) with a margin of {margin:g} m does not fit "
                "into it; give a larger area"
            )
        return cls(length, width, margin)

    def placing(self, tracks: np.ndarray, ship: Ship, turned: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """x, y [m], psi [rad] (3, K) at which K ``tracks`` (N, 3, D, K) of these begin, of D draws each, all from 0, 0,
        0; and by how much each is too large for the area [m] (K,).

        The heading with most room is taken, where it may be ``turned``, and the track is put into the middle. Of draws
        the hull of the first, the ship herself, and two standard deviations of all to each side count; draws that are
        not finite do not. ship: whose hull it is.
        """
        px, py = corners(tracks, ship)  # (4, N, D, K)
        headings = HEADINGS if turned else HEADINGS[:1]
        inner = np.array([self.length, self.width])[:, None] - 2 * self.margin
        placed = []
        for psi in headings:
            c, s = math.cos(psi), math.sin(psi)
            along = np.array([c * px - s * py, s * px + c * py])  # north, east: (2, 4, N, D, K)
            spread = 2 * np.std(along, axis=3, where=np.isfinite(along)) if along.shape[3] > 1 else 0.0
            lows = np.fmin.reduce(along[:, :, :, 0] - spread, axis=(1, 2))  # (2, K)
            highs = np.fmax.reduce(along[:, :, :, 0] + spread, axis=(1, 2))
            begin = self.margin + 0.5 * inner - 0.5 * (lows + highs)
            over = np.maximum(highs - lows - inner, 0)
            placed.append((over.sum(axis=0), np.min(inner - highs + lows, axis=0), begin))
        excess, room, begins = (np.array(part) for part in zip(*placed, strict=True))
        # least excess; of headings that fit the one with most room
        best, k = np.argmin(excess - 1e-6 * room, axis=0), np.arange(excess.shape[1])
        return np.vstack([begins[best, :, k].T, headings[best]]), np.nan_to_num(excess[best, k], nan=1e6)


def corners(tracks: np.ndarray, ship: Ship) -> tuple[np.ndarray, np.ndarray]:
    """x and y (4, N, ...) of the hull's four corners [m] along ``tracks`` (N, 3, ...); ship: whose L and B."""
    x, y, psi = tracks[:, 0], tracks[:, 1], tracks[:, 2]
    c, s = np.cos(psi), np.sin(psi)
    a, b = 0.5 * ship.particulars["L"], 0.5 * ship.particulars["B"]
    places = [(i * a, j * b) for i in (1, -1) for j in (1, -1)]
    return np.array([x + i * c - j * s for i, j in places]), np.array([y + i * s + j * c for i, j in places])


SHORTEST = 0.2  # A stretch has at least about this share of the mean length of stretches. Set by hand.


@dataclass(frozen=True)
class Sequences:
    """What orders are allowed: ``rudders`` and ``engines`` stretches of constant order over ``steps`` of ``dt`` [s].

    rudder: largest angle [rad]; n: lowest and highest revolutions [1/s]; speeds, revolutions: approach speeds [m/s] and
    the revolutions [1/s] that hold them, rising; limits: rates of the actuators.
    """

    steps: int
    dt: float
    rudders: int
    engines: int
    rudder: float
    n: tuple[float, float]
    speeds: np.ndarray
    revolutions: np.ndarray
    limits: Limits

    @property
    def size(self) -> int:
        """How many numbers between 0 and 1 name a sequence."""
        return 2 * (self.rudders + self.engines) + 1

    def orders(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Orders n [1/s] and delta [rad], (steps + 1, 2, K), approach speed [m/s] (K,) and its revolutions (K,). x: (K,
        size). Angles are whole degrees, revolutions hundredths of the highest, times whole steps."""
        x = np.clip(x, 0.0, 1.0)
        a, b = self.rudders, self.engines  # x: a angles, a lengths, b revolutions, b lengths, approach speed
        angles = np.radians(np.round(np.degrees((2 * x[:, :a] - 1) * self.rudder)))
        engine = self.n[0] + x[:, 2 * a : 2 * a + b] * (self.n[1] - self.n[0])
        engine = np.clip(np.round(engine / self.n[1], 2) * self.n[1], *self.n)
        orders = (self._over_time(engine, x[:, 2 * a + b : -1]), self._over_time(angles, x[:, a : 2 * a]))
        speed = self.speeds[0] + x[:, -1] * (self.speeds[-1] - self.speeds[0])
        return np.stack(orders, axis=1), speed, np.interp(speed, self.speeds, self.revolutions)

    def _over_time(self, levels: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """The ``levels`` (K, m) over time (steps + 1, K), each for its share of ``lengths`` (K, m)."""
        weights = SHORTEST + lengths
        ends = np.round(np.cumsum(weights, axis=1) / weights.sum(axis=1, keepdims=True) * (self.steps + 1))
        at = np.arange(self.steps + 1)[:, None, None]
        number = np.minimum((at >= ends[None]).sum(axis=2), levels.shape[1] - 1)
        return levels[np.arange(len(levels))[None, :], number]

    def positions(self, orders: np.ndarray, revolutions: np.ndarray) -> np.ndarray:
        """Positions of the actuators (steps + 1, 2, K) that follow ``orders`` at limited rates. They are means over the
        step that follows; revolutions: of the approach (K,), the rudder is midships then."""
        rates = np.array([self.limits.propeller_rate, self.limits.rudder_rate])[:, None] * self.dt
        position = np.stack([revolutions, np.zeros_like(revolutions)])
        means = np.empty_like(orders)
        for k, order in enumerate(orders):
            after = position + np.clip(order - position, -rates, rates)
            means[k] = 0.5 * (position + after)
            position = after
        return means

    def like(self, n: np.ndarray, delta: np.ndarray, speed: float) -> np.ndarray:
        """The numbers (size,) of a sequence near a run with ``n`` [1/s] and ``delta`` [rad] (N,), repeated to the end.
        speed: of its approach [m/s]."""
        at = np.arange(self.steps + 1) % max(len(n), 1)
        parts = []  # in the order that ``orders`` reads
        for values, count, low, high in (
            (delta[at], self.rudders, -self.rudder, self.rudder), (n[at], self.engines, *self.n),
        ):  # fmt: skip
            edges = np.linspace(0, len(at), count + 1).round().astype(int)
            level = np.array([np.median(values[i:j]) for i, j in pairwise(edges)])
            parts += [(level - low) / (high - low), np.full(count, 0.5)]
        span = max(self.speeds[-1] - self.speeds[0], 1e-9)
        return np.clip(np.concatenate([*parts, [(speed - self.speeds[0]) / span]]), 0.0, 1.0)


class Evolution:
    """A search without derivatives, with adapted covariance (CMA-ES; Hansen 2016, arXiv:1604.00772, appendix A).

    From ``mean`` (n,) with steps of about ``sigma`` in each number; ``best``, ``cost``: found so far.
    count: trials of a generation; rng: their source of chance.
    """

    def __init__(self, mean: np.ndarray, sigma: float, count: int, rng: np.random.Generator) -> None:
        self.mean, self.sigma, self.count, self.rng = np.array(mean, dtype=float), sigma, count, rng
        n, half = len(self.mean), count // 2
        # positive weights alone, of the better half
        weights = np.log((count + 1) / 2) - np.log(np.arange(1, half + 1))
        self.weights = weights / weights.sum()
        self.mu = mu = 1 / float((self.weights**2).sum())  # effective number of those selected
        self.c_s, self.c_c = (mu + 2) / (n + mu + 5), (4 + mu / n) / (n + 4 + 2 * mu / n)  # rates of the two paths
        self.c_1 = 2 / ((n + 1.3) ** 2 + mu)  # rates of the updates of rank 1 and mu
        self.c_mu = min(1 - self.c_1, 2 * (mu - 2 + 1 / mu) / ((n + 2) ** 2 + mu))
        self.damping = 1 + 2 * max(0.0, np.sqrt((mu - 1) / (n + 1)) - 1) + self.c_s
        self.norm = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))  # expected length of a standard normal vector
        self.C, self.path, self.path_s = np.eye(n), np.zeros(n), np.zeros(n)
        self.best, self.cost, self.generation = self.mean.copy(), np.inf, 0

    def advance(self, cost: Callable[[np.ndarray], np.ndarray]) -> None:
        """One generation; ``cost`` of points (count, n) is (count,). Points are held between 0 and 1."""
        n, mu = len(self.mean), self.mu
        values, vectors = np.linalg.eigh(self.C)
        root = np.sqrt(np.maximum(values, 1e-14))
        drawn = self.rng.standard_normal((self.count, n))
        steps = (drawn * root) @ vectors.T
        x = self.mean + self.sigma * steps
        if self.generation == 0:
            x[0], steps[0] = self.mean, 0.0  # the start itself is tried
        inside = np.clip(x, 0.0, 1.0)
        costs = cost(inside) + 0.01 * ((x - inside) ** 2).sum(axis=1)  # a small penalty draws the mean back inside
        order = np.argsort(costs, kind="stable")
        if costs[order[0]] < self.cost:
            self.best, self.cost = inside[order[0]].copy(), float(costs[order[0]])
        selected = steps[order[: len(self.weights)]]
        y = self.weights @ selected
        self.mean = self.mean + self.sigma * y
        self.generation += 1
        whitened = vectors @ ((vectors.T @ y) / root)  # C^(-1/2) y
        self.path_s = (1 - self.c_s) * self.path_s + np.sqrt(self.c_s * (2 - self.c_s) * mu) * whitened
        length = float(np.linalg.norm(self.path_s))
        fading = np.sqrt(1 - (1 - self.c_s) ** (2 * self.generation))
        on = float(length / fading < (1.4 + 2 / (n + 1)) * self.norm)  # Heaviside: a path too long stalls the other
        self.path = (1 - self.c_c) * self.path + on * np.sqrt(self.c_c * (2 - self.c_c) * mu) * y
        remainder = 1 - self.c_1 - self.c_mu + (1 - on) * self.c_1 * self.c_c * (2 - self.c_c)
        rank_mu = np.einsum("k,ki,kj->ij", self.weights, selected, selected)
        self.C = remainder * self.C + self.c_1 * np.outer(self.path, self.path) + self.c_mu * rank_mu
        self.sigma *= float(np.exp(min(1.0, self.c_s / self.damping * (length / self.norm - 1))))


# Mean length of a stretch of rudder [s of a 3 m model]; stretches of rudder for one of revolutions. Set by hand.
STRETCH, ENGINES = 12.0, 3
FEWEST, MOST = 4, 14  # Stretches of rudder in a trial. Set by hand: they bound the unknowns of the search.
ASTERN = 0.8  # Part of the highest revolutions that is ordered astern. Set by hand.
# Sequences of a generation; generations of each start; of the best one after that. Set by hand: 30 s of the processor
# for a plan of 180 s (RESULTS.md of 5f878e7).
COUNT, FIRST, THEN = 16, 30, 240
SPREAD = 0.25  # Standard deviation of the first generation, of numbers from 0 to 1. Set by hand.
STARTS = 3  # The best manoeuvre, the best pair and a random sequence: from these the search goes on. Set by hand.
RUN_UP = 2.0  # Straight way behind the start that must be inside the area too [ship lengths]. Set by hand.
TOO_FAST = 1.02  # Speed over the highest one beyond which a sequence is not allowed. Set by hand: a tolerance.
FORBIDDEN = 10.0  # Cost of a sequence that is not allowed, above that of any that is. Set by hand.


def is_reversible(ship: Ship) -> bool:
    """Whether the propeller of ``ship`` is reversed at will: not with a diesel engine, which takes its time."""
    if "n" not in ship.actuators or "pitch" in ship.actuators:
        return False
    speed = own_speed(ship)
    return engine_of(ship, speed, revolutions_for(ship, speed)) is None


@dataclass(frozen=True)
class LibraryRow:
    """A manoeuvre of the library beside the plan: mean log variance by it, whether it stays in the area, its run."""

    option: Option
    gain: float
    fits: bool
    fisher: np.ndarray
    trial: Trial


def sequences_for(ship: Ship, wish: Wish, highest: float, dt: float) -> Sequences:
    """The sequences of orders that a ``wish`` allows a ``ship`` up to the ``highest`` speed [m/s], in steps of ``dt``
    [s]."""
    rudders = int(np.clip(round(wish.seconds / (STRETCH * time_scale(ship.particulars["L"]))), FEWEST, MOST))
    speeds = highest * np.linspace(0.4, 1.0, 7)  # approaches ahead at 40 to 100 % of the highest speed. Set by hand.
    revolutions = np.array([revolutions_for(ship, u) for u in speeds])
    most = float(revolutions[-1])
    least = 0.3 * most  # of an engine that is not reversed. Set by hand.
    if is_reversible(ship):  # approaches astern too, at 50 and 25 % of that speed
        least = -ASTERN * most
        speeds = np.concatenate([highest * np.array([-0.5, -0.25]), speeds])
        revolutions = np.concatenate([[least, 0.5 * least], revolutions])
    steps, engines = int(np.floor(wish.seconds / dt + 1e-9)), max(2, rudders // ENGINES)
    limits = Limits.for_ship(ship)
    return Sequences(steps, dt, rudders, engines, wish.rudder_limit, (least, most), speeds, revolutions, limits)


class SequenceSearch:
    """Judges sequences: first whether they stay inside, then what they gain.

    trials: what a trial tells; wish: what is asked for; area: in which the trial must stay; speed: highest [m/s];
    draws: (all, D) differences of coefficients from the ship's, whose tracks must stay inside too.
    """

    def __init__(self, trials: TrialWorth, wish: Wish, area: Area, speed: float, draws: np.ndarray) -> None:
        self.trials, self.wish, self.area, self.speed, self.draws = trials, wish, area, speed, draws
        self.ship, self.dt = trials.simulator.ship, trials.dt
        self.sequences = sequences_for(self.ship, wish, speed, self.dt)
        nominal = self.ship.values[:, None]
        values = np.hstack([nominal, nominal + draws])  # the first is the ship herself
        bounds = [(c.lower, c.upper) if not c.fixed else (-np.inf, np.inf) for c in self.ship.coefficients.values()]
        low, high = np.array(bounds, dtype=float).T[..., None]
        # she may lie beyond her bounds herself
        self.theta = np.clip(values, np.minimum(low, nominal), np.maximum(high, nominal))

    def inputs(self, orders: np.ndarray, revolutions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N + 1, 2, K) and inputs of the model (N, C, K) that follow ``orders`` (N + 1, 2, K) from
        ``revolutions`` (K,)."""
        positions = self.sequences.positions(orders, revolutions)
        return positions, input_array(self.ship, positions[:-1], self.dt * np.arange(len(positions) - 1))

    @np.errstate(all="ignore")
    def motions(self, inputs: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """States (N + 1, S, D, K) of every draw under ``inputs`` (N, C, K) from approaches at ``speed`` (K,)."""
        D, K = self.theta.shape[1], len(speed)
        start = np.zeros((6, D * K))
        start[3] = np.tile(speed, D)
        theta = np.repeat(self.theta, K, axis=1)
        states = self.trials.simulator.run(start, np.tile(inputs, (1, 1, D)), self.dt, theta)
        return states.reshape(len(states), -1, D, K)

    def placing(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where motions (N + 1, S, D, K) begin, and by how much each is too large, as of ``Area.placing``."""
        before = np.zeros((1, 3, *states.shape[2:]))
        # the run-up lies behind a ship that goes ahead, before one that goes astern
        before[:, 0] = -RUN_UP * self.ship.particulars["L"] * np.where(states[0, 3] < 0, -1.0, 1.0)
        tracks = np.concatenate([before, states[::2, :3]])  # each second sample, to save time
        return self.area.placing(tracks, self.ship, "current" not in self.ship.effects)

    def cost(self, x: np.ndarray) -> np.ndarray:
        """Cost (K,) of sequences (K, size): the gain of those that stay inside and are not too fast, else above 0."""
        orders, speed, revolutions = self.sequences.orders(x)
        _, inputs = self.inputs(orders, revolutions)
        states = self.motions(inputs, speed)
        with np.errstate(all="ignore"):
            fast = np.hypot(states[:, 3, 0], states[:, 4, 0]).max(axis=0) / self.speed - TOO_FAST
        diverged = ~np.isfinite(states[:, :, 0]).all(axis=(0, 1))
        over = self.placing(states)[1] / self.ship.particulars["L"] + 10 * np.maximum(np.nan_to_num(fast), 0)
        # above all gains (below 0) by how far a sequence is from being allowed, so that the search finds its way in
        cost = np.where(diverged, 1e6, FORBIDDEN + over)
        good = np.flatnonzero((over <= 1e-9) & ~diverged)
        if len(good):
            chosen = np.ascontiguousarray(states[:, :, 0, good]), np.ascontiguousarray(inputs[..., good])
            cost[good] = self.trials.gain(self.trials.fisher(*chosen))
        return cost

    def allows(self, trial: Trial) -> bool:
        """Whether rudder angles and revolutions of a manoeuvre, ``trial``, are those that the wish allows."""
        angles = [float(np.abs(trial[name]).max()) for name in trial.columns if name.startswith("delta")]
        astern = "n" in trial and float(trial["n"].min()) < 0
        within = max(angles, default=0.0) <= self.wish.rudder_limit + 1e-6
        return within and (not astern or is_reversible(self.ship))


def _library_row(job: tuple[Shared[SequenceSearch], Option]) -> LibraryRow | None:
    """A manoeuvre of the library in calm air for a search, None where the ship cannot run it or the wish does not allow
    it. One that is over sooner than the wish is repeated, with way to gain speed again between."""
    search, option = job[0].value, job[1]
    ship, seconds = search.ship, search.wish.seconds
    chosen, trials, _ = runs(ship, [option], seconds, search.dt)
    if not chosen or not search.allows(trials[0]):
        return None
    trial = trials[0]
    inputs = input_array(ship, ordered(trial)[:-1, :, None], trial.t[:-1])
    start = trial.states[0][:, None] * np.array([0, 0, 0, 1, 1, 1])[:, None]  # from the origin, heading north
    states = search.trials.simulator.run(start, inputs, search.dt)
    fisher = search.trials.fisher(states, inputs)[0] * repetitions(trial, seconds, ship)
    _, excess = search.placing(states[:, :, None, :])
    return LibraryRow(option, float(search.trials.gain(fisher)), bool(excess[0] <= 1e-9), fisher, trial)


def ordered(trial: Trial) -> np.ndarray:
    """Revolutions and rudder (N, 2) of a ``trial``, 0 where it has none."""
    return np.stack([trial[name] if name in trial else np.zeros(len(trial)) for name in ("n", "delta")], axis=1)


def best_pairs(rows: Sequence[LibraryRow], trials: TrialWorth) -> dict[str, tuple[tuple[str, str], float]]:
    """The best two different manoeuvres of ``rows`` together, of all and of those that stay inside, and their gain.
    trials: what a trial tells."""
    best = {}
    for words, some in (("library", rows), ("inside", [row for row in rows if row.fits])):
        if pairs := list(combinations(some, 2)):
            gains = trials.gain(np.array([a.fisher + b.fisher for a, b in pairs]))
            k = int(np.argmin(gains))
            best[words] = ((pairs[k][0].option.name, pairs[k][1].option.name), float(gains[k]))
    return best


def _costs(job: tuple[Shared[SequenceSearch], np.ndarray]) -> np.ndarray:
    """Cost (K,) of some sequences (K, size) of a generation, of a search."""
    return job[0].value.cost(job[1])


def best_sequence(
    search: SequenceSearch, progress: OnProgress | None = None
) -> tuple[np.ndarray, tuple[LibraryRow, ...], int, bool]:
    """The numbers (size,) of the sequence that gains most by a ``search``, the manoeuvres of the library, how many
    sequences were tried, and whether the search went to its end.

    progress: called at each generation. Raises UserError where no sequence found stays inside the area.
    """
    wish, shared = search.wish, Shared(search)

    def cost(x: np.ndarray) -> np.ndarray:
        parts = np.array_split(x, min(width(1), len(x)))
        return np.concatenate(run_all(_costs, [(shared, part) for part in parts]))

    with kept_workers(wish.workers):
        ship, fastest = search.ship, TOO_FAST * search.speed
        options = [o for o in library(ship, wind=False) if (o.speed or own_speed(ship)) <= fastest]
        tried = run_all(_library_row, [(shared, option) for option in options], name="manoeuvres of the library")
        rows = tuple(sorted((row for row in tried if row is not None), key=lambda row: row.gain))  # the best first
        rng = np.random.default_rng(wish.seed)
        starts = [0.5 + 0.3 * rng.uniform(-1, 1, search.sequences.size) for _ in range(STARTS)]
        fitting = [row for row in rows if row.fits] or list(rows)
        if fitting:
            starts[0] = _started(search, fitting[:1])
        if len(fitting) > 1:
            names = best_pairs(fitting, search.trials)["library"][0]
            starts[1] = _started(search, [row for row in fitting if row.option.name in names])
        first, then = (max(1, round(wish.effort * count)) for count in (FIRST, THEN))
        evolutions = [Evolution(start, SPREAD, COUNT, rng) for start in starts]
        total, began, made = first * len(starts) + then, time.monotonic(), 0
        for k in range(total):
            if time.monotonic() - began > wish.time_limit:
                break
            evolution = evolutions[k // first] if k < first * len(starts) else min(evolutions, key=lambda e: e.cost)
            evolution.advance(cost)
            made += 1
            if progress:
                progress(Progress("planning", k + 1, total, {"mean log variance": min(e.cost for e in evolutions)}))
    winner = min(evolutions, key=lambda e: e.cost)
    if winner.cost >= FORBIDDEN:
        area, early = search.area, f"; the search was ended after {wish.time_limit:g} s (--time-limit)"
        raise NoSolution(
            f"no sequence of {wish.seconds:g} s was found that stays inside {area.length:g} x {area.width:g} m with a "
            f"margin of {area.margin:g} m; give a larger --area, a shorter --time or a lower "
            "--speed-limit" + ("" if made == total else early)
        )
    return winner.best, rows, made * COUNT, made == total


def _started(search: SequenceSearch, rows: Sequence[LibraryRow]) -> np.ndarray:
    """The numbers (size,) of a sequence near manoeuvres of the library, one after the other for equal times."""
    count = (search.sequences.steps + 1) // len(rows) + 1
    n, delta = np.vstack([ordered(row.trial)[np.arange(count) % len(row.trial)] for row in rows]).T
    return search.sequences.like(n, delta, float(rows[0].trial["u"][0]))
