"""The equations of a ship as one staged program: rates, forces, columns, memory, features, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from mmg.compile.stages import Program
from mmg.model import Model

COEFFICIENTS, INPUTS, STATE = 1, 2, 3
"""Stages: what depends on the coefficients alone, on these and the inputs, and on the state."""
ARGUMENTS = (STATE, INPUTS, COEFFICIENTS)
"""Stages of the arguments of the program: state (S,), inputs (C,), coefficients (P,)."""
RATES, FORCES, COLUMNS, SETTLED, FEATURES, RATES_Z, RATES_C, FEATURES_Z, FEATURES_C = range(9)
"""Outputs: rates without network (S,), forces (R, 3), logged columns (6,), state with settled memory (S,) from the
first six, features (F,); derivatives of rates and features by state (S) and inputs (C)."""


@dataclass(frozen=True)
class Equations:
    """The program of a ship without its network, whose accelerations are added by other code.

    model: the ship without network; program: staged by ARGUMENTS, its outputs numbered as above.
    """

    model: Model
    program: Program

    @classmethod
    def of(cls, model: Model) -> Equations:
        """The equations of a ``model`` without network."""
        z, c = ca.SX.sym("state", len(model.states)), ca.SX.sym("inputs", len(model.controls))
        theta = ca.SX.sym("coefficients", len(model.symbols))
        rates, features = model.rates(z, c, theta), model.features(z, c, theta)
        outputs = [rates, model.forces(z, c, theta), model.columns(z, theta), model.initial(z[:6], c, theta), features]
        outputs += [ca.jacobian(of, by) for of in (rates, features) for by in (z, c)]
        function = ca.Function("ship", [z, c, theta], outputs, {"cse": True})
        return cls(model, Program.of(function, ARGUMENTS))
