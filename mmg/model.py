"""Assembles the force models and effects of a ship into one right-hand side, as a CasADi expression."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from mmg.components.catalogue import FORCES, module, twin_screw
from mmg.components.coefficients import names
from mmg.components.rigid_body import accelerations, inertia
from mmg.effects import effect
from mmg.effects.effect import Setting
from mmg.motion.flow import STATES, Flow, Force
from mmg.motion.frames import body_to_earth, earth_to_body, relative_air
from mmg.motion.memory import Memory
from mmg.motion.smooth import Exact, Smooth, Smoothing
from mmg.ship import Ship


@dataclass(frozen=True)
class Model:
    """The right-hand side of a ship and its parts.

    A state is x, y, psi, u, v, r (velocities over ground) and whatever the ship's effects remember; S of them.

    ship: the ship it was made from.
    symbols: coefficients that are arguments, in order; all others are constants inside.
    controls: names of the inputs, ``ship.inputs``: actuators, air over ground, perhaps the time.
    states: names of the states, STATES first; sizes: typical size of those that follow, (S - 6,).
    first: the rates depend on the states from this one on (2: not on the position).
    rates: Function (state (S,), controls (C,), coefficients (P,)) -> d state / dt (S,), SI.
    forces: Function of the same arguments -> (number of roles, 3): X, Y [N], N [N m] per role of ``roles``.
    roles: parts of the force, in the order of the rows of ``forces``: roles of the ship, then effects.
    network_force: Function of the same arguments -> (1, 3): the force that stands for the accelerations of the ship's
        network, None without one.
    initial: Function (x, y, psi, u, v, r (6,), controls, coefficients) -> state (S,) whose memory is settled.
    columns: Function (state (S,), coefficients) -> the six columns as they are logged (6,); columns_by: the same of the
    coefficients ``measured_by`` (numbers of them) alone.
    features: Function (state (S,), controls (C,), coefficients (P,)) -> what a network sees, ``ship.features`` (F,).
    measured: whether the columns differ from the first six states.
    """

    ship: Ship
    symbols: tuple[str, ...]
    controls: tuple[str, ...]
    states: tuple[str, ...]
    sizes: np.ndarray
    first: int
    rates: ca.Function
    forces: ca.Function
    roles: tuple[str, ...]
    network_force: ca.Function | None
    initial: ca.Function
    columns: ca.Function
    columns_by: ca.Function
    measured_by: np.ndarray
    features: ca.Function
    measured: bool

    def forces_by_role(self, states: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> dict[str, np.ndarray]:
        """X, Y [N], N [N m], (M, 3), of each of ``roles`` and of a network, at states (S, M) under inputs (C, M).

        theta: coefficients (P,). The sum, divided by masses and added masses, moves the ship.
        """
        given = states, controls, theta
        rows = np.array(self.forces(*given)).reshape(len(self.roles), -1, 3)
        by_role = dict(zip(self.roles, rows, strict=True))
        return by_role | ({NETWORK: np.array(self.network_force(*given)).reshape(-1, 3)} if self.network_force else {})

    def at_points(self, name: str, *inputs: np.ndarray) -> np.ndarray:
        """Result (rows, M) of the function called ``name`` at M points, without a compiler.

        inputs: its arguments, (rows, M) where the points have their own, (rows,) where they share it; at least the
        first one has M.
        """
        function: ca.Function = getattr(self, name)
        return np.array(function(*[a if a.size else 0.0 for a in inputs]))


def component_forces(flow: Flow, ship: Ship, p: SimpleNamespace, c: Any, s: Smoothing) -> dict[str, Force]:
    """Force of each component by role, evaluated in the order in which they feed each other. ship: gives the models;
    flow, p, c, s: as in mmg/motion/flow.py."""
    result: dict[str, Force] = {}
    flows: tuple[Flow, ...] = (flow,)  # one for each propeller and the rudder behind it
    if twin_screw(ship.particulars):
        from mmg.components import twin  # late: few ships have two screws

        flows = twin.mirrored_flows(flow, p)
    for role in FORCES:
        if role not in ship.components:
            continue
        model = module(role, ship.components[role])
        if role in ("propeller", "rudder"):
            forces = [model.force(side, p, c, s) for side in flows]
            result[role] = twin.combined(forces[0], forces[1], p) if len(forces) == 2 else forces[0]
            if role == "propeller":
                flows = tuple(f.with_(slipstream=x.slipstream) for f, x in zip(flows, forces, strict=True))
        elif role == "expansion":
            result[role] = model.force(flow, p, c, s, ship.monomials)
        else:
            result[role] = model.force(flow, p, c, s)
    return result


def _equations(
    state: Any, controls: Mapping[str, Any], c: SimpleNamespace, ship: Ship, s: Smoothing, acted: bool = False
) -> tuple[Any, dict[str, Force], Force, Memory, list[Any], dict[str, Any]]:
    """Rates of the six states, forces by role and of the network, memory, logged columns and what a network sees.

    Expressions of the state (6,), the inputs by name and the coefficients by attribute.
    """
    effects = [(effect(name), ship.parameters_of(name, vars(c))) for name in ship.effects]
    p, memory = names(dict(ship.particulars)), Memory()
    for e, values in effects:  # first: masses and forces are those of the ship as she is
        p = e.particulars(p, values)
    x, y, psi, u, v, r = (state[i] for i in range(6))
    place = {"psi": psi, "x": x, "y": y, "time": controls.get("time", 0.0)}
    flow = Flow(u=u, v=v, r=r, **place, **{name: controls[name] for name in ship.actuators})
    north, east = controls["wind_north"], controls["wind_east"]
    for e, values in effects:
        north, east = e.air(north, east, values)
        flow = flow if acted and e.moves else e.actuators(flow, memory, values, p, s)
    if "actuators" in ship.components:  # after the effects: these make orders of what was logged
        flow = module("actuators", ship.components["actuators"]).actuators(flow, memory, p, c, s)
    a_x, a_y = relative_air(north, east, psi, u, v)  # by the velocity over ground, whatever the water does
    currents = [w for e, values in effects if (w := e.water(flow, values)) is not None]
    flow, u_c, v_c, a_cx, a_cy = _through_water(flow.with_(a_x=a_x, a_y=a_y), currents)
    parts = component_forces(flow, ship, p, c, s)
    mass = inertia(p, c)
    at = Setting(p, ship.components, c, memory, s)
    for e, values in effects:
        parts = e.forces(parts, flow, values, at)
        mass = e.inertia(mass, flow, values, p, s)
    du, dv, dr = accelerations(flow.u, flow.v, r, sum(parts.values(), Force()), mass)  # of the velocity through water
    if "roll" in ship.components:
        module("roll", ship.components["roll"]).roll(flow, parts, dv, memory, p, c)
    if currents:  # to the velocity over ground: see ``_through_water``
        du, dv = du + r * v_c + a_cx, dv - r * u_c + a_cy
    features = {name: getattr(flow, name) for name in ship.features}
    learned = Force()
    if ship.network:
        added = ship.network.accelerations(ca.vertcat(*[features[name] for name in ship.network.features]))
        du, dv, dr = du + added[0], dv + added[1], dr + added[2]
        learned = mass.force_of((added[0], added[1], added[2]))
    dx, dy = body_to_earth(u, v, psi)
    columns: list[Any] = [x, y, psi, u, v, r]
    for e, values in effects:
        columns = e.columns(columns, flow, memory, values, p)
    return ca.vertcat(dx, dy, r, du, dv, dr), parts, learned, memory, columns, features


def _through_water(flow: Flow, currents: list[tuple[Any, Any, Any, Any]]) -> tuple[Flow, Any, Any, Any, Any]:
    """The flow with velocities through the water, and the water's velocity and acceleration in body axes.

    Relative-velocity formulation (Fossen 2021): all forces, and the equations of motion, are those of (u - u_c,
    v - v_c, r). An unsteady uniform current brings no further term, as Froude-Krylov force and apparent force cancel
    for a floating body. The ground velocity changes with u_c' = r v_c + a_cx, v_c' = -r u_c + a_cy.
    """
    if not currents:
        return flow, 0.0, 0.0, 0.0, 0.0
    north, east, north_rate, east_rate = (sum(values[1:], values[0]) for values in zip(*currents, strict=True))
    u_c, v_c = earth_to_body(north, east, flow.psi)
    a_cx, a_cy = earth_to_body(north_rate, east_rate, flow.psi)
    return flow.with_(u=flow.u - u_c, v=flow.v - v_c), u_c, v_c, a_cx, a_cy


NETWORK = "network"  # Role of the force that stands for its accelerations
# What was assembled last: key, model, sizes of the memory. To make the functions takes longer than to call them.
_ASSEMBLED: deque[tuple[tuple[Any, ...], Model, ca.Function]] = deque(maxlen=16)


def assemble(ship: Ship, symbols: Sequence[str] | None = None, exact: bool = False, acted: bool = False) -> Model:
    """The model of a ship.

    ``symbols`` names the coefficients that become arguments (default: all); the others are put in as
    numbers. ``exact`` evaluates the published branches instead of their smooth blends: for checking only. ``acted``:
    what ``Effect.acted`` does was done to the inputs.
    The functions of a ship that differs from an earlier one in values of arguments alone are those of that one.
    """
    chosen = tuple(ship.symbols if symbols is None else symbols)
    if ship.network is not None:
        return _assembled(ship, chosen, exact, acted)[0]
    values = {name: c.value for name, c in ship.coefficients.items()}
    key: tuple[Any, ...] = (
        *(tuple(m.items()) for m in (ship.particulars, ship.components, ship.monomials)),
        tuple((name, None if name in chosen else value) for name, value in values.items()),
        # objects too: a name that was registered anew is another model
        (ship.effects, *map(effect, ship.effects), *ship.own, chosen, exact, acted),
    )
    entry = next((each for each in list(_ASSEMBLED) if each[0] == key), None)  # a copy: other threads may append
    if entry is None:
        entry = (key, *_assembled(ship, chosen, exact, acted))
        _ASSEMBLED.append(entry)
    _, model, sizes = entry
    return replace(model, ship=ship, sizes=_numbers(sizes, chosen, values))


def _assembled(ship: Ship, chosen: tuple[str, ...], exact: bool, acted: bool) -> tuple[Model, ca.Function]:
    """The model of a ship with the coefficients ``chosen`` as arguments, and the sizes of its memory as a function of
    them. exact, acted: as of ``assemble``."""
    six, controls = ca.SX.sym("state", 6), ca.SX.sym("controls", len(ship.inputs))
    theta = ca.SX.sym("coefficients", len(chosen))
    values_of = {name: c.value for name, c in ship.coefficients.items()}
    values: dict[str, Any] = values_of | {name: theta[i] for i, name in enumerate(chosen)}
    s: Smoothing = Exact() if exact else Smooth.for_length(ship.particulars["L"])
    by_name = {name: controls[i] for i, name in enumerate(ship.inputs)}
    rates, parts, learned, memory, logged, features = _equations(six, by_name, names(values), ship, s, acted)
    state = ca.vertcat(six, *memory.symbols)
    derivative = ca.vertcat(rates, *memory.rates)
    rows = ca.vertcat(*[ca.horzcat(part.X, part.Y, part.N) for part in parts.values()])
    placed = any(ca.which_depends(derivative, six[:2], 1, True))
    columns = ca.vertcat(*logged)
    used = np.flatnonzero(ca.which_depends(columns, theta, 1, False)).tolist()
    few = theta[used] if used else ca.SX.sym("none")  # a function needs its argument, though nothing is read from it

    def function(name: str, expression: Any) -> ca.Function:
        arguments, labels = [state, controls, theta], ["state", "controls", "coefficients"]
        return ca.Function(name, arguments, [expression], labels, [name], {"cse": True})

    sizes = ca.Function("numbers", [theta], [ca.SX(ca.vertcat(*memory.sizes))])
    model = Model(
        ship=ship,
        symbols=chosen,
        controls=ship.inputs,
        states=(*STATES, *memory.names),
        sizes=_numbers(sizes, chosen, values_of),
        first=0 if placed else 2,
        rates=function("rates", derivative),
        forces=function("forces", rows),
        roles=tuple(parts),
        network_force=function("network_force", ca.horzcat(learned.X, learned.Y, learned.N)) if ship.network else None,
        initial=ca.Function("initial", [six, controls, theta], [ca.densify(ca.vertcat(six, *_settled(memory)))]),
        columns=ca.Function("columns", [state, theta], [columns], {"cse": True}),
        columns_by=ca.Function("columns_by", [state, few], [ca.densify(columns)], {"cse": True}),
        measured_by=np.array(used, dtype=int),
        features=function("features", ca.densify(ca.vertcat(*features.values()))),
        measured=any(effect(name).measures for name in ship.effects),
    )
    return model, sizes


def _numbers(sizes: ca.Function, chosen: Sequence[str], values: Mapping[str, float]) -> np.ndarray:
    """What a function of the coefficients ``chosen`` gives for their ``values``, (n,)."""
    return np.array(sizes([values[name] for name in chosen]), dtype=float).reshape(-1)


def _settled(memory: Memory) -> list[Any]:
    """Initial values of the remembered states, each free of the others."""
    settled: list[Any] = []
    for target in memory.targets:
        start = ca.SX(target)
        if settled:  # a target may see states that were made before it, and none that come after
            start = ca.substitute([start], memory.symbols[: len(settled)], settled)[0]
        settled.append(start)
    return settled


# Points at which logged columns are asked for in one call: a call costs as much as a thousand of them.
POINTS = 50_000  # set by hand: it bounds memory, to some MB
INVERSIONS = 30  # Most fixed-point steps from logged columns to the state behind them. Set by hand.
# Error of a logged column [its unit] at which they end: rounding of positions of a kilometre.
CLOSE = 1e-12  # set by hand: 2e-16 of a kilometre is 2e-13 m


def settled(model: Model, six: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """States (S, M) from x, y, psi, u, v, r (6, M), with what is remembered settled under inputs (C, M). model: of the
    ship; six: those columns; controls (C, M); theta: coefficients (P,) or (P, M)."""
    if len(model.states) == 6:
        return np.array(six, dtype=float)
    return model.at_points("initial", six, controls, theta)


def columns(
    model: Model,
    states: np.ndarray,
    theta: np.ndarray,
    at: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """The six columns as they are logged, (..., 6, M), of states (..., S, M). model: of the ship; theta: coefficients
    (P,) or (P, M); at: the same as ``model.columns_by`` of many points, compiled (default: that)."""
    if not model.measured:
        return states[..., :6, :]
    flat = states.reshape(-1, *states.shape[-2:])
    # few coefficients: CasADi copies what it is given to every point
    coefficients = np.asarray(theta, dtype=float)[model.measured_by]
    M, logged = states.shape[-1], np.empty((len(flat), 6, states.shape[-1]))
    many = max(1, POINTS // max(M, 1))
    for first in range(0, len(flat), many):
        z = flat[first : first + many]
        each = np.tile(coefficients, (1, len(z))) if np.ndim(coefficients) == 2 else coefficients
        points = z.transpose(1, 0, 2).reshape(z.shape[1], -1)  # (S, times x M), M fastest as in ``each``
        values = at(points, each) if at else model.at_points("columns_by", points, each)
        logged[first : first + many] = values.reshape(6, len(z), M).transpose(1, 0, 2)
    return logged.reshape(*states.shape[:-2], 6, M)


AtPoints = Callable[..., np.ndarray]  # Of arguments (rows, M), the values (rows, M) at M points


def states_behind(
    model: Model,
    logged: np.ndarray,
    controls: np.ndarray,
    theta: np.ndarray,
    initial: AtPoints | None = None,
    at: AtPoints | None = None,
) -> np.ndarray:
    """States (S, M) that are logged as (6, M) under inputs (C, M), their memory settled; NaN stays NaN. model: of the
    ship; controls: those inputs; theta: coefficients (P,) or (P, M); initial, at: ``settled`` and the same as
    ``model.columns_by`` of many points, compiled (default: interpreted)."""
    initial = initial or partial(settled, model)
    six = np.array(logged, dtype=float)
    states = initial(six, controls, theta)
    if not model.measured:
        return states
    for _ in range(INVERSIONS):  # fixed point: the columns differ little from the state behind them
        error = columns(model, states, theta, at) - logged
        if not np.nanmax(np.abs(error), initial=0.0) > CLOSE:
            break
        six -= error
        states = initial(six, controls, theta)
    return states
