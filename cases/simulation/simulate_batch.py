"""Many manoeuvres at once: one ship with scattered coefficients, integrated in compiled code.

Where the orders do not depend on the motion (turning, crash stop, random, berthing, straight), the rudder and the
revolutions are ramps known in advance: steps are cut at their kinks, so that few Runge-Kutta steps are accurate. In a
zigzag each ship reverses her rudder at her own time; all of them are stepped side by side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cases.maneuvers.definitions import FULL_TURN, TINY, Maneuver, Orders, StepOrders, StopOrders, Turning, Zigzag
from cases.maneuvers.self_propulsion import actuator_positions
from cases.simulation.actuator_ramps import EngineRevolutions, ZigzagRudders, ramps
from cases.simulation.simulate import integration_steps, longest_step
from cases.trial import Trial
from mmg.errors import OutOfRange, Unsupported
from mmg.model import settled
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg.states import STATES

HALF_TURN = math.radians(190.0)
"""Change of heading behind which no figure of a turning circle is read but its steady turn [rad]."""
READ = 4
"""Executes of the rudder of a zigzag after which its first two overshoots are over: the second one begins at the third
(IMO MSC.137(76))."""

Push = Callable[[int, np.ndarray], np.ndarray]
"""Accelerations (3, M) of u, v [m/s^2] and r [rad/s^2] over the sample that follows, from its number and the states (6,
M) at its begin."""


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
    held: bool = False,
) -> SimulatedRuns:
    """A manoeuvre in calm air from its own start, once for each set of coefficients.

    ship: give a Simulator to run again without assembling the ship again. coefficients: (P,) or (P, M) in the order of
    ``ship.symbols``, or symbol -> number or (M,) for those that differ from the ship's; default the ship's, M = 1. dt:
    sampling [s], divided into steps of at most 0.5 s of a 3 m model. held: inputs are held at their means over each
    sample, as a logged trial has them, and ``cases.simulation.simulate.simulate`` gives the same motion; else they move
    within the sample (a zigzag is always held). A control delay acts as in the model, by its approximation. A run that
    diverges is not noticed here: look at its states. Raises UserError for a step that makes no sense and for spiral and
    pull-out, whose orders wait for a steady turn. maneuver: what is ordered.
    """
    simulator = ship if isinstance(ship, Simulator) else Simulator(ship)
    ship, batch = simulator.ship, _Batch.of(simulator, maneuver, coefficients, dt)
    orders, t = batch.orders, batch.t
    if isinstance(orders, Zigzag) or (isinstance(orders, StopOrders) and maneuver.engine is not None):
        return _side_by_side(batch)
    moves = ramps(maneuver, orders, t)
    means = np.vstack([moves.means(t), moves.at(t[-1:])])
    if held or "pitch" in ship.actuators:
        parts = integration_steps(ship, dt)
        controls = np.repeat(input_array(ship, means[:-1], t[:-1]), parts, axis=0)
        steps: float | np.ndarray = dt / parts
        keep = np.arange(1, (len(t) - 1) * parts + 1) % parts == 0
    else:
        fine, keep = moves.grid(t, longest_step(ship))
        controls, steps = input_array(ship, moves.at(fine), fine), np.diff(fine)
    linear = len(controls) > len(keep)
    out = simulator.run(batch.start, controls, steps, batch.theta, linear=linear, keep=keep)
    states = out if out.shape[1] == 6 else np.ascontiguousarray(out[:, :6])
    inputs = np.broadcast_to(means[:, :, None], (*means.shape, states.shape[2]))
    return SimulatedRuns(t, states, inputs, ends_of(orders, t, states))


def simulate_pushed(
    simulator: Simulator,
    maneuver: Maneuver,
    coefficients: Mapping[str, np.ndarray],
    dt: float,
    push: Push,
) -> SimulatedRuns:
    """A manoeuvre in calm air, once for each set of ``coefficients`` (symbol -> (M,)), with accelerations ``push`` of
    its own in each run, as gusts or what a model leaves out would give.

    simulator: of the ship; maneuver, dt: as for ``simulate_batch``. With accelerations of zero it is that with
    held inputs, but ends when all runs have been through half a turn, two overshoots, or lost their headway, and each
    zigzag stands still once it has been read. Raises UserError for spiral and pull-out.
    """
    return _side_by_side(_Batch.of(simulator, maneuver, coefficients, dt), push)


@dataclass(frozen=True)
class _Batch:
    """M runs that are to be made: orders of one of them, theta (P,) or (P, M), start (S, M), t (N + 1,) [s]."""

    simulator: Simulator
    maneuver: Maneuver
    orders: Orders
    theta: np.ndarray
    start: np.ndarray
    dt: float
    t: np.ndarray

    @classmethod
    def of(
        cls,
        simulator: Simulator,
        maneuver: Maneuver,
        coefficients: np.ndarray | Mapping[str, float | np.ndarray] | None,
        dt: float,
    ) -> _Batch:
        """Of a ``maneuver`` with ``coefficients`` as for ``simulate_batch``; raises what that says."""
        ship, orders = simulator.ship, maneuver.orders()
        if not (math.isfinite(dt) and 0 < dt <= maneuver.duration):
            longest = f"no longer than the manoeuvre ({maneuver.duration:g} s)"
            raise OutOfRange(f"dt = {dt:g} s must be positive and {longest}")
        if isinstance(orders, StepOrders):
            raise Unsupported(f"{maneuver.name}: its orders wait for a steady turn; simulate one ship at a time")
        theta = coefficients_in(maneuver, ship, coefficients)
        six = np.repeat(maneuver.start[:, None], theta.shape[1] if theta.ndim == 2 else 1, axis=1)
        start = settled(simulator.model, six, input_array(ship, np.array([[maneuver.n, 0.0]]), np.zeros(1))[0], theta)
        t = np.round(dt * np.arange(math.floor(maneuver.duration / dt + TINY) + 1), 9)
        return cls(simulator, maneuver, orders, theta, start, dt, t)


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


def coefficients_in(
    maneuver: Maneuver, ship: Ship, given: np.ndarray | Mapping[str, float | np.ndarray] | None
) -> np.ndarray:
    """Coefficients (P,) or (P, M) that a ``ship`` has in a ``maneuver``. given: as for ``coefficient_array``."""
    theta = coefficient_array(ship, given)
    factors = np.array([maneuver.factors.get(symbol, 1.0) for symbol in ship.symbols])
    return (theta.T * factors).T if maneuver.factors else theta


def input_array(ship: Ship, positions: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Inputs (N, C) or (N, C, M) from n and delta (N, 2) or (N, 2, M) in calm air.

    ``actuator_positions`` says what moves. ship: gives the inputs; positions: those; t (N,) [s].
    """
    values = actuator_positions(ship, positions[:, 0], positions[:, 1])
    values["time"] = t.reshape(-1, *(1,) * (positions.ndim - 2))
    out = np.zeros((len(positions), len(ship.inputs), *positions.shape[2:]))
    for i, name in enumerate(ship.inputs):
        out[:, i] = values.get(name, 0.0)
    return out


def ends_of(orders: Orders, t: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Row (M,) of the end of each run: heading changed by 540 degrees, headway lost, or the last one.

    orders: of the manoeuvre; t: (N + 1,) times [s]; states: (N + 1, 6, M).
    """
    N = len(states) - 1
    if isinstance(orders, Turning):
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


def _side_by_side(batch: _Batch, push: Push | None = None) -> SimulatedRuns:
    """All ships of a ``batch`` a sample at a time, with their rudders or engines, inputs held over each sample.

    push: accelerations; with them the runs end once they have been read.
    """
    ship, orders, theta, t, dt = batch.simulator.ship, batch.orders, batch.theta, batch.t, batch.dt
    state, M, N = batch.start, batch.start.shape[1], len(t) - 1
    parts = integration_steps(ship, dt)
    keep = np.arange(1, parts + 1) == parts
    states, inputs = np.empty((N + 1, 6, M)), np.zeros((N + 1, 2, M))
    rudders = ZigzagRudders(orders, batch.maneuver.limits.rudder_rate, M) if isinstance(orders, Zigzag) else None
    engines = (
        EngineRevolutions(batch.maneuver, orders, M)
        if isinstance(orders, StopOrders) and batch.maneuver.engine
        else None
    )
    if rudders is None and engines is None:
        moves = ramps(batch.maneuver, orders, t)
        inputs[:] = np.vstack([moves.means(t), moves.at(t[-1:])])[:, :, None]
    elif rudders is not None:
        inputs[:, 0] = batch.maneuver.n
    everyone, done, last = np.ones(M, dtype=bool), np.zeros(M, dtype=bool), np.full(M, N)
    for k in range(N + 1):

        def advance(
            delta: np.ndarray, which: np.ndarray, state: np.ndarray = state, k: int = k, done: np.ndarray = done
        ) -> np.ndarray:
            moving = which & ~done
            held = input_array(ship, np.stack([inputs[k, 0], delta])[None, :, moving], t[[k]])
            own = theta if theta.ndim == 1 else theta[:, moving]
            found = state[:, which]
            found[:, moving[which]] = batch.simulator.run(
                state[:, moving], np.repeat(held, parts, axis=0), dt / parts, own, keep=keep
            )[-1]
            return found

        states[k] = state[:6]
        if rudders is not None:
            rudders.observe(float(t[k]), state)
            over = rudders.over if push is None else rudders.count >= READ
            last = np.where(over & (last == N), k, last)
            inputs[k, 1] = rudders.delta
        elif engines is not None:
            inputs[k, 0] = engines.n
        if k == N or ((push or engines) and _all_read(orders, t[: k + 1], states[: k + 1], rudders)):
            break
        kick = 0.0 if push is None else dt * push(k, state[:6])
        if rudders is not None:
            done = over if push else done
            inputs[k, 1], state = rudders.means(float(t[k]), dt, state, advance)
            state[3:6] += np.where(done, 0.0, kick)
        else:
            if engines is not None:
                inputs[k, 0] = engines.means(float(t[k]), dt, state)
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
