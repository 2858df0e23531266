"""Many manoeuvres at once: one ship with scattered coefficients, integrated in compiled code.

Where the orders do not depend on the motion (turning, crash stop, random, berthing, straight), rudder and revolutions
are the same in all runs and known in advance. In a zigzag each ship reverses her rudder at her own time, and an engine
that is stopped turns on with her own speed: all of them are stepped side by side. Coefficients are scattered by their
standard errors, within their bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cases.maneuvers.definitions import (
    FULL_TURN,
    TINY,
    HeadingControl,
    Limits,
    Maneuver,
    Orders,
    StepOrders,
    StopOrders,
    Turning,
    Zigzag,
)
from cases.maneuvers.self_propulsion import Shaft, actuator_positions
from cases.simulation.simulate import integration_steps
from cases.trial import Trial
from mmg.errors import Missing, OutOfRange, Unsupported
from mmg.model import settled
from mmg.motion.flow import STATES
from mmg.rollout import Simulator
from mmg.ship import Ship

# Change of heading behind which no figure of a turning circle is read but its steady turn [rad]: the 180 deg of the
# tactical diameter (IMO MSC.137(76)) with a margin. Set by hand.
HALF_TURN = math.radians(190.0)
# Executes of the rudder of a zigzag after which its first two overshoots are over: the second one begins at the third
# (IMO MSC.137(76)).
READ = 4


def means(maneuver: Maneuver, t: np.ndarray) -> np.ndarray:
    """Revolutions [1/s] and rudder angle [rad] (N + 1, 2), means over the steps between the even times t (N + 1,) [s]
    and what is reached at the last, of a ``maneuver`` whose orders depend on the time alone."""
    controller, state, dt = maneuver.controller(), maneuver.start, float(t[1] - t[0])
    held = [controller.held(float(when), dt, state, lambda _: state) for when in t[:-1]]
    return np.array([*held, (controller.n, controller.delta)])


def _revolved(orders: StopOrders, shaft: Shaft, t: float, dt: float, u: np.ndarray) -> tuple[Shaft, np.ndarray]:
    """The ``shaft`` lines of M ships after the step from t to t + dt at speeds u (M,), and their mean revolutions (M,),
    as ``Controller`` of cases.maneuvers makes them for one: the order acts from its own moment."""
    before = min(max(orders.lead - t, 0.0), dt)
    if before <= TINY:
        return shaft.moved(orders.after, u, dt)
    shaft, first = shaft.moved(orders.n, u, before)
    if dt - before <= TINY:
        return shaft, first
    shaft, second = shaft.moved(orders.after, u, dt - before)
    return shaft, (before * first + (dt - before) * second) / dt


class ZigzagRudders:
    """Rudders of M ships that do what ``Zigzag`` and ``Controller`` of cases.maneuvers do for one.

    delta: angles reached [rad]; side: to which they are ordered; count: rudder executes so far; origin: headings at the
    first one [rad], None before; over: whose last execute has come; their orders stand from then on; helm: the orders
    that act, the last ones [rad], and when these begin to act [s], infinite where they do: (3, M).
    """

    def __init__(self, orders: Zigzag, limits: Limits, ships: int) -> None:
        self.orders, self.rate, self.delay = orders, limits.rudder_rate, limits.rudder_delay
        self.delta, self.side = np.zeros(ships), np.full(ships, orders.side)
        self.helm = np.array([[0.0], [0.0], [math.inf]]).repeat(ships, axis=1)
        self.count, self.over = np.ones(ships, dtype=int), np.zeros(ships, dtype=bool)
        self.origin: np.ndarray | None = None

    def observe(self, t: float, state: np.ndarray) -> None:
        """Orders at a sample with states (S, M): who is beyond the switch heading reverses."""
        if t >= self.orders.lead - TINY:
            if self.origin is None:
                self.origin = state[2].copy()
            self._reverse(self._beyond(state) >= -TINY)

    def means(
        self, t: float, dt: float, state: np.ndarray, advance: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean angles (M,) over the step from t to t + dt, and the states (S, M) that follow.

        advance: states (S, K) at the end of the step of the K ships that a mask (M,) names, from angles (M,). The first
        execute and reversals within the step act from their own moment, located by interpolation.
        """
        lead, before = self.orders.lead, (self.delta, self.helm)
        waiting = t < lead - TINY
        order = np.zeros_like(self.delta) if waiting else self.side * self.orders.rudder
        mean = self._travel(order, t, dt)
        everyone = np.ones(len(mean), dtype=bool)
        after = advance(mean, everyone)
        if waiting and lead >= t + dt - TINY:
            return mean, after
        if waiting:
            crosses, fraction = everyone, np.full_like(mean, (lead - t) / dt)
            self.origin = state[2] + fraction * (after[2] - state[2])
        else:
            a, b = self._beyond(state), self._beyond(after)
            crosses = (a < 0) & (b >= 0) & ~self.over
            if not crosses.any():
                return mean, after
            fraction = np.where(crosses, -a / np.where(crosses, b - a, 1.0), 1.0)
            self._reverse(crosses)
        # the step once more: the old order up to the event, then the new one (fraction 1 where there is no event)
        self.delta, self.helm = before
        first = self._travel(order, t, fraction * dt)
        second = self._travel(self.side * self.orders.rudder, t + fraction * dt, (1 - fraction) * dt)
        mean, after = fraction * first + (1 - fraction) * second, after.copy()
        after[:, crosses] = advance(mean, crosses)
        return mean, after

    def _beyond(self, state: np.ndarray) -> np.ndarray:
        """Heading past the switch heading, to the side of the rudder [rad]."""
        assert self.origin is not None
        return self.side * (state[2] - self.origin) - self.orders.heading

    def _reverse(self, which: np.ndarray) -> None:
        """Counts an execute of some ships (M,) and reverses their rudders, unless it was the last."""
        which = which & ~self.over
        self.count = self.count + which
        if self.orders.last_execute is not None:
            self.over = self.over | (self.count >= self.orders.last_execute)
        self.side = np.where(which & ~self.over, -self.side, self.side)

    def _travel(self, order: np.ndarray, t: np.ndarray | float, dt: np.ndarray | float) -> np.ndarray:
        """Moves under the orders (M,) from t [s] on for dt [s], one or (M,) each; the mean angles on the way."""
        acts, last, due = self.helm
        # an order waits for the delay; one that acts has nothing due
        due = np.where(order != last, t + self.delay, due)
        acts, due = np.where(due <= t + TINY, order, acts), np.where(due <= t + TINY, math.inf, due)
        self.helm = np.stack([acts, order, due])
        before = np.clip(due - t, 0.0, dt)
        first, second = self._ramp(acts, before), self._ramp(order, dt - before)
        share = np.divide(before, dt, out=np.ones_like(first), where=np.asarray(dt) > 0)
        return np.asarray(share * first + (1 - share) * second)

    def _ramp(self, order: np.ndarray, dt: np.ndarray) -> np.ndarray:
        """Moves towards the orders (M,) for dt (M,) [s]; the mean angles on the way."""
        way, longest = order - self.delta, self.rate * dt
        arrives = np.abs(way) <= longest
        share = np.divide(np.abs(way), longest, out=np.zeros_like(way), where=longest > 0)
        end = np.where(arrives, order, self.delta + np.copysign(longest, way))
        mean = np.where(arrives, order - 0.5 * way * share, 0.5 * (self.delta + end))
        self.delta = end
        return mean


# Accelerations (3, M) of u, v [m/s^2] and r [rad/s^2] over the sample that follows, from its number and the states (6,
# M) at its begin.
Push = Callable[[int, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class SimulatedRuns:
    """M runs of one manoeuvre.

    Attributes
    ----------
    t: (N + 1,) [s].
    states: (N + 1, 6, M): x, y, psi (continuous), u, v, r of the true motion.
    inputs: (N + 1, 2, M): means of revolutions [1/s] and rudder angle [rad] over the step that follows; read-only.
    last: (M,) row in which each run ends; the rows after it are what follows if its orders stand.
    """

    t: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    last: np.ndarray

    def trial(self, m: int) -> Trial:
        """Run ``m`` as a trial up to its end: t, the six states, n and delta, without sensors and wind."""
        rows = slice(0, int(self.last[m]) + 1)
        columns = {"t": self.t[rows], **dict(zip(STATES, self.states[rows, :, m].T, strict=True))}
        return Trial(f"run_{m}", columns | {"n": self.inputs[rows, 0, m], "delta": self.inputs[rows, 1, m]})


def simulate_batch(
    ship: Ship | Simulator,
    maneuver: Maneuver,
    coefficients: np.ndarray | Mapping[str, float | np.ndarray] | None = None,
    dt: float = 0.5,
    push: Push | None = None,
) -> SimulatedRuns:
    """A manoeuvre in calm air from its own start, once for each set of coefficients: the motion that
    ``cases.simulation.simulate.simulate`` gives each of them.

    ship: give a Simulator to run again without assembling the ship again. coefficients: (P,) or (P, M) in the order of
    ``ship.symbols``, or symbol -> number or (M,) for those that differ from the ship's; default the ship's, M = 1. dt:
    sampling [s], divided into steps of at most 0.5 s of a 3 m model; inputs are held at their means over each sample,
    as a logged trial has them. push: accelerations of its own in each run, as gusts or what a model leaves out would
    give; then the runs end when all have been through half a turn, two overshoots, or lost their headway, and each
    zigzag stands still once it has been read. A control delay acts as in the model, by its approximation. A run that
    diverges is not noticed here: look at its states. Raises UserError for a step that makes no sense and for spiral,
    pull-out and heading, whose orders follow from the motion. maneuver: what is ordered.
    """
    simulator = ship if isinstance(ship, Simulator) else Simulator(ship)
    ship, orders = simulator.ship, maneuver.orders()
    if not (math.isfinite(dt) and 0 < dt <= maneuver.duration):
        raise OutOfRange(f"dt = {dt:g} s must be positive and no longer than the manoeuvre ({maneuver.duration:g} s)")
    if isinstance(orders, StepOrders | HeadingControl):
        raise Unsupported(f"{maneuver.name}: its orders follow from the motion; simulate one ship at a time")
    theta = coefficient_array(ship, coefficients)
    if maneuver.factors:  # of the resistance, where she is stopped
        theta = (theta.T * [maneuver.factors.get(symbol, 1.0) for symbol in ship.symbols]).T
    six = np.repeat(maneuver.start[:, None], theta.shape[1] if theta.ndim == 2 else 1, axis=1)
    start = settled(simulator.model, six, input_array(ship, np.array([[maneuver.n, 0.0]]), np.zeros(1))[0], theta)
    t = np.round(dt * np.arange(math.floor(maneuver.duration / dt + TINY) + 1), 9)
    if push or isinstance(orders, Zigzag) or (isinstance(orders, StopOrders) and maneuver.engine is not None):
        return _side_by_side(simulator, maneuver, theta, start, t, dt, push)
    moves, parts = means(maneuver, t), integration_steps(ship, dt)
    keep = np.arange(1, (len(t) - 1) * parts + 1) % parts == 0
    controls = np.repeat(input_array(ship, moves[:-1], t[:-1]), parts, axis=0)
    states = simulator.run(start, controls, dt / parts, theta, keep=keep)[:, :6]
    inputs = np.broadcast_to(moves[:, :, None], (*moves.shape, states.shape[2]))
    return SimulatedRuns(t, np.ascontiguousarray(states), inputs, ends_of(orders, t, states))


def coefficient_array(ship: Ship, given: np.ndarray | Mapping[str, float | np.ndarray] | None) -> np.ndarray:
    """Coefficients (P,) or (P, M) in the ship's order; those not ``given`` are the ship's own. KeyError if unknown."""
    if given is None:
        return ship.values
    if not isinstance(given, Mapping):
        return np.asarray(given, dtype=float)
    shape = np.broadcast_shapes(*(np.shape(values) for values in given.values()))
    theta = np.repeat(ship.values[:, None], shape[0], axis=1) if shape else ship.values
    for symbol, values in given.items():
        if symbol not in ship.coefficients:
            raise KeyError(f"{ship.name} has no coefficient {symbol!r}")
        theta[ship.symbols.index(symbol)] = values
    return theta


def input_array(ship: Ship, positions: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Inputs (N, C) or (N, C, M) from n and delta (N, 2) or (N, 2, M) in calm air. ``actuator_positions`` says what
    moves. ship: gives the inputs; positions: those; t (N,) [s]."""
    values = actuator_positions(ship, positions[:, 0], positions[:, 1])
    values["time"] = t.reshape(-1, *(1,) * (positions.ndim - 2))
    out = np.zeros((len(positions), len(ship.inputs), *positions.shape[2:]))
    for i, name in enumerate(ship.inputs):
        out[:, i] = values.get(name, 0.0)
    return out


def ends_of(orders: Orders, t: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Row (M,) of the end of each run: heading changed by 540 degrees, headway lost, or the last one. orders: of the
    manoeuvre; t: (N + 1,) times [s]; states: (N + 1, 6, M)."""
    N = len(states) - 1
    if isinstance(orders, Turning):  # the heading at the order, between two samples, as ``FromLead`` has it
        k = min(int(np.searchsorted(t, orders.lead)), N)
        share = (orders.lead - t[k - 1]) / (t[k] - t[k - 1])
        origin = states[k - 1, 2] + share * (states[k, 2] - states[k - 1, 2])
        over = np.abs(states[:, 2] - origin) >= FULL_TURN
    elif isinstance(orders, StopOrders):
        first = states[_ordered(orders, t), 3]
        over = (states[:, 3] <= orders.least * first) & (t >= orders.lead - TINY)[:, None]
    else:
        return np.full(states.shape[2], N)
    return np.where(over.any(axis=0), np.argmax(over, axis=0), N)


def _side_by_side(
    simulator: Simulator,
    maneuver: Maneuver,
    theta: np.ndarray,
    state: np.ndarray,
    t: np.ndarray,
    dt: float,
    push: Push | None,
) -> SimulatedRuns:
    """All ships a sample at a time, with their rudders or engines, inputs held over each sample: from ``state`` (S, M)
    with coefficients theta (P,) or (P, M), at times t (N + 1,) [s]; the others as of ``simulate_batch``."""
    ship, orders, engine, M, N = simulator.ship, maneuver.orders(), maneuver.engine, state.shape[1], len(t) - 1
    parts = integration_steps(ship, dt)
    keep = np.arange(1, parts + 1) == parts
    states, inputs = np.empty((N + 1, 6, M)), np.zeros((N + 1, 2, M))
    rudders = ZigzagRudders(orders, maneuver.limits, M) if isinstance(orders, Zigzag) else None
    shaft = engine.shaft(M) if isinstance(orders, StopOrders) and engine else None
    if shaft is None:
        inputs[:] = means(maneuver, t)[:, :, None] if rudders is None else [[maneuver.n], [0.0]]
    everyone, done, last = np.ones(M, dtype=bool), np.zeros(M, dtype=bool), np.full(M, N)  # done: read, stands still
    for k in range(N + 1):

        def advance(
            delta: np.ndarray, which: np.ndarray, state: np.ndarray = state, k: int = k, done: np.ndarray = done
        ) -> np.ndarray:
            moving = which & ~done
            controls = input_array(ship, np.stack([inputs[k, 0], delta])[None, :, moving], t[[k]])
            coefficients = theta if theta.ndim == 1 else theta[:, moving]
            after = state[:, which]
            after[:, moving[which]] = simulator.run(
                state[:, moving], np.repeat(controls, parts, axis=0), dt / parts, coefficients, keep=keep
            )[-1]
            return after

        states[k] = state[:6]
        if rudders is not None:
            rudders.observe(float(t[k]), state)
            over = rudders.over if push is None else rudders.count >= READ
            last = np.where(over & (last == N), k, last)
            inputs[k, 1] = rudders.delta
        elif shaft is not None:
            inputs[k, 0] = shaft.n
        if k == N or ((push or shaft) and _all_read(orders, t[: k + 1], states[: k + 1], rudders)):
            break
        kick = 0.0 if push is None else dt * push(k, state[:6])  # change of u, v, r over the sample, at its end
        if rudders is not None:
            done = over if push else done
            inputs[k, 1], state = rudders.means(float(t[k]), dt, state, advance)
            state[3:6] += np.where(done, 0.0, kick)
        else:
            if isinstance(orders, StopOrders) and shaft is not None:
                shaft, inputs[k, 0] = _revolved(orders, shaft, float(t[k]), dt, state[3])
            state = advance(inputs[k, 1], everyone)
            state[3:6] += kick
    t, states, inputs = t[: k + 1], states[: k + 1], inputs[: k + 1]
    return SimulatedRuns(t, states, inputs, np.minimum(last, k) if rudders is not None else ends_of(orders, t, states))


def _all_read(orders: Orders, t: np.ndarray, states: np.ndarray, rudders: ZigzagRudders | None) -> bool:
    """Whether no run (N + 1, 6, M) until now has a figure to come: half a turn, two overshoots, lost headway."""
    lost = ~np.isfinite(states[-1]).all(axis=0)
    if rudders is not None:
        return bool((lost | (rudders.count >= READ)).all())
    if not isinstance(orders, (Turning, StopOrders)) or t[-1] <= orders.lead + TINY:
        return False
    if isinstance(orders, StopOrders):
        return bool((lost | (states[-1, 3] <= orders.least * states[_ordered(orders, t), 3])).all())
    return bool((lost | (np.abs(states[-1, 2] - states[0, 2]) >= HALF_TURN)).all())


def _ordered(orders: StopOrders, t: np.ndarray) -> int:
    """First row of the times t (N + 1,) at which a stop is ordered."""
    return min(int(np.searchsorted(t, orders.lead - TINY)), len(t) - 1)


ROUNDS = 5  # In which draws beyond bounds are put on them; what is beyond then is clipped alone. Set by hand.


def draw_coefficients(
    ship: Ship, count: int, seed: int = 0, correlation: tuple[Sequence[str], np.ndarray] | None = None
) -> dict[str, np.ndarray]:
    """Coefficients drawn from normal distributions about the ``ship``'s values, symbol -> (count,).

    Their standard deviations are those of the ship (fixed ones stay). count: draws; seed: of the draws; correlation:
    symbols (Q,) and matrix (Q, Q) of the estimates, None for independent ones. Draws beyond a bound are put on it, and
    those correlated with them follow by their regression on them.
    Raises UserError when no coefficient of the ship has a standard deviation.
    """
    free = [s for s in ship.free if 0 < ship.coefficients[s].std < math.inf]
    if not free:
        raise Missing(f"{ship.name}: no coefficient has a standard deviation; give std in the ship file, or a fit")
    matrix = np.eye(len(free))
    if correlation is not None:
        index = {symbol: i for i, symbol in enumerate(correlation[0])}
        rows = [(i, index[s]) for i, s in enumerate(free) if s in index]
        here, there = (list(part) for part in zip(*rows, strict=True)) if rows else ([], [])
        matrix[np.ix_(here, here)] = np.nan_to_num(np.asarray(correlation[1], dtype=float)[np.ix_(there, there)])
        np.fill_diagonal(matrix, 1.0)
    # a root by eigenvalues: with correlations that are not known set to zero the matrix may have negative ones
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = root @ np.random.default_rng([21, seed]).standard_normal((len(free), count))
    drawn = [ship.coefficients[s] for s in free]
    value, std = (np.array([getattr(c, name) for c in drawn], dtype=float)[:, None] for name in ("value", "std"))
    lower, upper = (np.array([getattr(c, name) for c in drawn], dtype=float)[:, None] for name in ("lower", "upper"))
    inside = _within(draws, (lower - value) / std, (upper - value) / std, root @ root.T)
    return dict(zip(free, np.clip(value + std * inside, lower, upper), strict=True))


def _within(draws: np.ndarray, lower: np.ndarray, upper: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Draws (Q, count) of unit variance and correlation ``matrix`` with those beyond bounds (Q, 1) put on them. The
    others move to their expectation given that: by the regression on those that are held."""
    bounded = np.zeros(draws.shape, dtype=bool)
    target = draws
    for _ in range(ROUNDS):
        beyond = (target < lower - 1e-9) | (target > upper + 1e-9)
        if not beyond.any():
            break
        bounded |= beyond
        target = target.copy()
        for m in np.flatnonzero(beyond.any(axis=0)):
            k = np.flatnonzero(bounded[:, m])
            ends = np.clip(draws[k, m], lower[k, 0], upper[k, 0])
            # conditional mean of a normal law, given those on their bounds
            gain = np.linalg.solve(matrix[np.ix_(k, k)] + 1e-9 * np.eye(len(k)), ends - draws[k, m])
            target[:, m] = draws[:, m] + matrix[:, k] @ gain
            target[k, m] = ends
    return np.clip(target, lower, upper)
