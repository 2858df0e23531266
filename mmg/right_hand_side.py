"""The equations of motion of a ship as a function, for controllers, observers and own studies."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from mmg.errors import BadValue, as_array, in_order, refusing
from mmg.model import settled
from mmg.motion.flow import INPUTS, STATES
from mmg.rollout import Simulator
from mmg.ship import AIR, Ship

if TYPE_CHECKING:
    import pandas as pd

# Of the states; what effects remember is without one here.
UNITS = {"x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s"}


@refusing
class RightHandSide:
    """d state / dt = f(state, controls) of a ship with her present coefficients, SI: ``ship.rhs(state, controls)``.

    states: names, x, y [m], psi [rad], u, v [m/s], r [rad/s] (north, east, clockwise; velocities over ground, body
    axes at midship), then what her effects remember; controls: names, her actuators (n [1/s], delta [rad] to starboard,
    ...), then wind_north and wind_east, the velocity of the air over ground [m/s]. A state is (S,), or (S, M) for M
    points at once; of six numbers what is remembered is settled. Controls are (C,), (C, M), or by name, a mapping or
    a Series of pandas, in which calm air may be left out; so may a state be by name.
    """

    def __init__(self, ship: Ship) -> None:
        self.ship, self.own, self._simulator = ship, ship.own, Simulator(ship)
        self.states, self.controls = self._simulator.model.states, self._simulator.model.controls
        units = {
            **UNITS,
            "time": "s",
            **{name: unit for name, (_, unit) in INPUTS.items()},
            **dict.fromkeys(AIR, "m/s"),
        }
        self.units = {name: units.get(name, "") for name in (*self.states, *self.controls)}

    def __repr__(self) -> str:
        return f"<right-hand side of {self.ship.name}: states {', '.join(self.states)}; controls {self._names}>"

    @property
    def _names(self) -> str:
        return ", ".join(self.controls)

    @cached_property
    def function(self) -> ca.Function:
        """The same as a CasADi Function: (state (S,), controls (C,)) -> rates (S,)."""
        z, c = ca.SX.sym("state", len(self.states)), ca.SX.sym("controls", len(self.controls))
        # the coefficients as numbers: what depends on them alone is folded
        rates = ca.cse(ca.densify(self._simulator.model.rates(z, c, self.ship.values)))
        return ca.Function("rhs", [z, c], [rates], ["state", "controls"], ["rates"])

    @cached_property
    def _jacobian(self) -> ca.Function:
        z, c = ca.SX.sym("state", len(self.states)), ca.SX.sym("controls", len(self.controls))
        rates = self.function(z, c)
        return ca.Function("jacobian", [z, c], [ca.densify(ca.jacobian(rates, x)) for x in (z, c)])

    def __call__(self, state: np.ndarray | Sequence[float], controls: Any) -> np.ndarray:
        """Rates (S,) or (S, M). Raises UserError for another shape, an unknown name and a missing actuator."""
        z, c, single = self._points(state, controls)
        rates = self._simulator.rates(z, c)
        return rates[:, 0] if single else rates

    def jacobian(self, state: np.ndarray | Sequence[float], controls: Any) -> tuple[np.ndarray, np.ndarray]:
        """A = d rates / d state (S, S) and B = d rates / d controls (S, C) at one point. Raises UserError as a call
        does."""
        z, c, single = self._points(state, controls)
        if not single:
            raise BadValue("jacobian: takes one state (S,), not several")
        A, B = self._jacobian(z[:, 0], c[:, 0])
        return np.array(A), np.array(B)

    def forces(self, state: np.ndarray | Sequence[float], controls: Any) -> pd.DataFrame:
        """X, Y [N] and N [N m] about midship, body axes, by component: a row for each, and for the network of a
        hybrid ("network"). Raises UserError as a call does."""
        import pandas as pd

        z, c, single = self._points(state, controls)
        if not single:
            raise BadValue("forces: takes one state (S,), not several")
        by_role = self._simulator.model.forces_by_role(z, c, self.ship.values)
        components = pd.Index(by_role, name="component")
        return pd.DataFrame(np.vstack(list(by_role.values())), components, columns=["X [N]", "Y [N]", "N [N m]"])

    def _points(self, state: Any, controls: Any) -> tuple[np.ndarray, np.ndarray, bool]:
        """States (S, M), controls (C, M), and whether one point was given."""
        try:
            names = self.states if len(state) > len(STATES) else STATES
            z = as_array("state", in_order("state", state, names))
            rows = [as_array("controls", row) for row in in_order("controls", controls, self.controls, AIR)]
            c = np.stack(np.broadcast_arrays(*rows))
        except (TypeError, ValueError):
            raise BadValue("state or controls: hold what is no number") from None
        S, C = len(self.states), len(self.controls)
        if z.ndim not in (1, 2) or len(z) not in (6, S):
            raise BadValue(f"state of shape {z.shape}; needed: ({S},) or ({S}, M), of {', '.join(self.states)}")
        if c.ndim not in (1, 2) or len(c) != C:
            raise BadValue(f"controls of shape {c.shape}; needed: ({C},) or ({C}, M), of {self._names}")
        single = z.ndim == c.ndim == 1
        z, c = (a[:, None] if a.ndim == 1 else a for a in (z, c))
        M = max(z.shape[1], c.shape[1])
        if {z.shape[1], c.shape[1]} - {1, M}:
            raise BadValue(f"{z.shape[1]} states and {c.shape[1]} controls; give as many of both, or one of either")
        z, c = (np.ascontiguousarray(np.broadcast_to(a, (len(a), M))) for a in (z, c))
        if len(z) < S:  # six numbers of a ship whose effects remember more
            z = settled(self._simulator.model, z, c, self.ship.values)
        return z, c, single
