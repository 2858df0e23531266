"""Checks that several force models share: derivatives of a force in motion and actuators are finite and right."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import casadi as ca
import numpy as np

from mmg.components.coefficients import names
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

FORCE = Callable[[Flow, SimpleNamespace, SimpleNamespace, Smoothing], Force]
STEP = 1e-6


def defaults(*tables: tuple) -> SimpleNamespace:
    """Coefficients of these tables by attribute, all at their default."""
    rows = [row for table in tables for row in table]
    symbols = [row.symbol for row in rows]
    assert len(set(symbols)) == len(symbols)
    return names({row.symbol: row.value for row in rows})


def values(force: Force) -> np.ndarray:
    """X, Y, N of a force in numbers."""
    return np.array([float(ca.DM(part)) for part in (force.X, force.Y, force.N)])


def behind(propeller: FORCE, rudder: FORCE) -> FORCE:
    """The force of a propeller and of the rudder in its slipstream."""

    def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
        push = propeller(flow, p, c, s)
        return push + rudder(flow.with_(slipstream=push.slipstream), p, c, s)

    return force


class Derivatives:
    """Force (3,) of the vector (u, v, r, inputs), its Jacobian (3, A) and second derivatives (3, A, A)."""

    def __init__(self, force: FORCE, inputs: tuple[str, ...], p: SimpleNamespace, c: SimpleNamespace, s: Smoothing):
        fields = ("u", "v", "r", *inputs)
        x = ca.SX.sym("x", len(fields))
        result = force(Flow(**{name: x[i] for i, name in enumerate(fields)}), p, c, s)
        f = ca.vertcat(result.X, result.Y, result.N)
        J = ca.densify(ca.jacobian(f, x))
        H = ca.densify(ca.jacobian(ca.vec(J), x))
        self.count = len(fields)
        self._function = ca.Function("f", [x], [f, J, H], {"cse": True})

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        f, J, H = (np.array(part) for part in self._function(x))
        return f.ravel(), J, H.reshape((3, self.count, self.count), order="F")

    def assert_finite(self, x: np.ndarray) -> None:
        for part in self(x):
            assert np.isfinite(part).all()

    def assert_agree_with_differences(self, x: np.ndarray, scale: np.ndarray, tolerance: float) -> None:
        """Fourth-order central differences of force and Jacobian, by the largest derivative (units of ``scale``)."""
        _, J, H = self(x)
        for k, part in ((0, J), (1, H)):
            columns = []
            for shift in np.diag(STEP * scale):
                first = self(x + shift)[k] - self(x - shift)[k]
                second = self(x + 2 * shift)[k] - self(x - 2 * shift)[k]
                columns.append((8 * first - second) / (12 * shift.sum()))
            units = scale if k == 0 else scale[:, None] * scale
            exact, difference = part * units, np.stack(columns, axis=-1) * units
            largest = np.abs(exact).max()
            assert largest > 0
            np.testing.assert_allclose(difference, exact, rtol=0, atol=tolerance * largest)
