"""Many runs of one manoeuvre with an acceleration of its own in each, as gusts or what a model leaves out would give.

All runs are stepped side by side, a sample at a time. Inputs are held over each sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from cases.maneuvers.definitions import Maneuver
from cases.maneuvers.orders import Orders, StepOrders, StopOrders, Turning, Zigzag
from cases.simulation.actuator_ramps import TINY, EngineRevolutions, ZigzagRudders, ramps
from cases.simulation.simulate import integration_steps
from cases.simulation.simulate_batch import SimulatedRuns, coefficients_in, ends_of, input_array
from mmg.errors import Unsupported
from mmg.model import settled
from mmg.rollout import Simulator

HALF_TURN = math.radians(190.0)
"""Change of heading behind which no figure of a turning circle is read but its steady turn [rad]."""
READ = 4
"""Executes of the rudder of a zigzag after which its first two overshoots are over."""

Push = Callable[[int, np.ndarray], np.ndarray]
"""Accelerations (3, M) of u, v [m/s^2] and r [rad/s^2] over the sample that follows, from its number and the states (6,
M) at its begin."""


def simulate_pushed(
    simulator: Simulator,
    maneuver: Maneuver,
    coefficients: Mapping[str, np.ndarray],
    dt: float,
    push: Push,
    threads: int = 1,
) -> SimulatedRuns:
    """A manoeuvre in calm air, once for each set of ``coefficients`` (symbol -> (M,)), with accelerations ``push``.

    simulator: of the ship; maneuver: what is ordered; dt: sampling [s]; threads: over which the runs are spread. With
    accelerations of zero it is ``simulate_batch`` with held inputs, but ends when all runs have been through half a
    turn, two overshoots, or lost their headway, and each zigzag stands still once it has been read. Raises
    UserError for spiral and pull-out.
    """
    ship, orders = simulator.ship, maneuver.orders()
    if isinstance(orders, StepOrders):
        raise Unsupported(f"{maneuver.name}: its orders wait for a steady turn; simulate one ship at a time")
    theta = coefficients_in(maneuver, ship, coefficients)
    M, N = theta.shape[1], math.floor(maneuver.duration / dt + TINY)
    t, parts = np.round(dt * np.arange(N + 1), 9), integration_steps(ship, dt)
    keep = np.arange(1, parts + 1) == parts
    six = np.repeat(maneuver.start[:, None], M, axis=1)
    state = settled(simulator.model, six, input_array(ship, np.array([[maneuver.n, 0.0]]), np.zeros(1))[0], theta)
    states, inputs = np.empty((N + 1, 6, M)), np.empty((N + 1, 2, M))
    rudders = ZigzagRudders(orders, maneuver.limits.rudder_rate, M) if isinstance(orders, Zigzag) else None
    engines = EngineRevolutions(maneuver, orders, M) if isinstance(orders, StopOrders) and maneuver.engine else None
    known, done = None, np.zeros(M, dtype=bool)
    if rudders is None and engines is None:
        moves = ramps(maneuver, orders, t)
        known = np.vstack([moves.means(t), moves.at(t[-1:])])
    inputs[:, 0], last = maneuver.n, np.full(M, N)
    for k in range(N + 1):
        states[k] = state[:6]
        if rudders is not None:
            rudders.observe(float(t[k]), state)
            done = rudders.count >= READ
            last = np.where(done & (last == N), k, last)
            inputs[k, 1] = rudders.delta
        elif engines is not None:
            inputs[k] = engines.n, np.zeros(M)
        elif known is not None:
            inputs[k] = known[k][:, None]
        if k == N or _all_read(orders, float(t[k]), states[: k + 1], rudders):
            break

        def advance(
            delta: np.ndarray, which: np.ndarray, state: np.ndarray = state, k: int = k, done: np.ndarray = done
        ) -> np.ndarray:
            moving = which & ~done
            held = np.stack([inputs[k, 0], delta])[None, :, moving]
            controls = np.repeat(input_array(ship, held, t[[k]]), parts, axis=0)
            found = state[:, which]
            found[:, moving[which]] = simulator.run(
                state[:, moving], controls, dt / parts, theta[:, moving], keep=keep, threads=threads
            )[-1]
            return found

        kick = dt * push(k, state[:6])
        if rudders is not None:
            kick[:, done] = 0.0
            inputs[k, 1], state = rudders.means(float(t[k]), dt, state, advance)
        else:
            if engines is not None:
                inputs[k, 0] = engines.means(float(t[k]), dt, state)
            state = advance(inputs[k, 1], np.ones(M, dtype=bool))
        state[3:6] += kick
    t, states, inputs = t[: k + 1], states[: k + 1], inputs[: k + 1]
    return SimulatedRuns(t, states, inputs, np.minimum(last, k) if rudders is not None else ends_of(orders, t, states))


def _all_read(orders: Orders, now: float, states: np.ndarray, rudders: ZigzagRudders | None) -> bool:
    """Whether no run (N + 1, 6, M) until ``now`` has a figure to come: half a turn, two overshoots, lost headway."""
    lost = ~np.isfinite(states[-1]).all(axis=0)
    if rudders is not None:
        return bool((lost | (rudders.count >= READ)).all())
    if now <= orders.lead + TINY if isinstance(orders, (Turning, StopOrders)) else True:
        return False
    if isinstance(orders, StopOrders):
        return bool((lost | (states[-1, 3] <= orders.least * states[0, 3])).all())
    return bool((lost | (np.abs(states[-1, 2] - states[0, 2]) >= HALF_TURN)).all())
