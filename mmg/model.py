"""Assembles the force models of a ship into one right-hand side, as a CasADi expression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from mmg.coefficients import names
from mmg.components import ROLES, module
from mmg.flow import Flow, Force
from mmg.frames import body_to_earth, relative_air
from mmg.rigid_body import accelerations
from mmg.ship import Ship
from mmg.smooth import Exact, Smooth, Smoothing

STATES = ("x", "y", "psi", "u", "v", "r")
CONTROLS = ("n", "delta", "wind_north", "wind_east")
"""Inputs of the right-hand side: 1/s, rad, and the velocity of the air over ground in the earth frame [m/s]."""


@dataclass(frozen=True)
class Model:
    """The right-hand side of a ship and its parts.

    Attributes
    ----------
    ship: the ship it was made from.
    symbols: coefficients that are arguments, in order; all others are constants inside.
    rates: Function (state (6,), controls (4,), coefficients (P,)) -> d state / dt (6,), SI.
    forces: Function of the same arguments -> (number of roles, 3): X, Y [N], N [N m] per role of ``roles``.
    roles: roles present in the ship, in the order of the rows of ``forces``.
    """

    ship: Ship
    symbols: tuple[str, ...]
    rates: ca.Function
    forces: ca.Function
    roles: tuple[str, ...]


def component_forces(flow: Flow, ship: Ship, c: Any, s: Smoothing) -> dict[str, Force]:
    """Force of each component by role, evaluated in the order in which they feed each other."""
    p = names(dict(ship.particulars))
    result: dict[str, Force] = {}
    for role in ROLES:
        if role not in ship.components:
            continue
        result[role] = module(role, ship.components[role]).force(flow, p, c, s)
        if role == "propeller":
            flow = Flow(**{**flow.__dict__, "slipstream": result[role].slipstream})
    return result


def rates(state: Any, controls: Any, c: Any, ship: Ship, s: Smoothing) -> tuple[Any, dict[str, Force]]:
    """d(x, y, psi, u, v, r)/dt as an expression (6,), and the force of each component.

    ``controls`` as in CONTROLS, ``c`` the coefficients by attribute.
    """
    psi, u, v, r = state[2], state[3], state[4], state[5]
    a_x, a_y = relative_air(controls[2], controls[3], psi, u, v)
    flow = Flow(u=u, v=v, r=r, n=controls[0], delta=controls[1], a_x=a_x, a_y=a_y)
    parts = component_forces(flow, ship, c, s)
    total = Force()
    for part in parts.values():
        total = total + part
    du, dv, dr = accelerations(u, v, r, total, names(dict(ship.particulars)), c)
    dx, dy = body_to_earth(u, v, psi)
    return ca.vertcat(dx, dy, r, du, dv, dr), parts


def assemble(ship: Ship, symbols: Sequence[str] | None = None, exact: bool = False) -> Model:
    """The model of a ship.

    ``symbols`` names the coefficients that become arguments (default: all); the others are put in as
    numbers. ``exact`` evaluates the published branches instead of their smooth blends: for checking only.
    """
    chosen = tuple(ship.symbols if symbols is None else symbols)
    state, controls = ca.SX.sym("state", 6), ca.SX.sym("controls", len(CONTROLS))
    theta = ca.SX.sym("coefficients", len(chosen))
    values: dict[str, Any] = {name: c.value for name, c in ship.coefficients.items()}
    values.update({name: theta[i] for i, name in enumerate(chosen)})
    s: Smoothing = Exact() if exact else Smooth.for_length(ship.particulars["L"])
    derivative, parts = rates(state, controls, names(values), ship, s)
    roles = tuple(parts)
    rows = ca.vertcat(*[ca.horzcat(parts[role].X, parts[role].Y, parts[role].N) for role in roles])
    arguments, labels = [state, controls, theta], ["state", "controls", "coefficients"]
    options = {"cse": True}
    return Model(
        ship=ship,
        symbols=chosen,
        rates=ca.Function("rates", arguments, [derivative], labels, ["rates"], options),
        forces=ca.Function("forces", arguments, [rows], labels, ["forces"], options),
        roles=roles,
    )
