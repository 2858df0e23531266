"""The measurement model of a calibration: logged columns of many states, with first and second derivatives.

y = h(z, theta): the identity for most ships; lags, lever arms, gains and biases of the effects that enter there.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from mmg.compile.batch import batch_functions
from mmg.model import Model


class Measurement:
    """h of a model, for the free coefficients at positions ``free`` among all of them.

    identity: h copies the first six states; the other methods need not be called then. own: positions, among the free
    coefficients, of those that h depends on (O of them). States are (S, m), columns (6, m), coefficients (all,).
    """

    def __init__(self, model: Model, free: np.ndarray, compiled: bool = True) -> None:
        self.S, self.identity, self.own = len(model.states), not model.measured, np.zeros(0, dtype=int)
        if self.identity:
            return
        z, theta = ca.SX.sym("z", self.S), ca.SX.sym("theta", len(model.symbols))
        mu, y = ca.SX.sym("mu", 6), model.columns(z, theta)
        touched = ca.which_depends(y, ca.vertcat(*[theta[int(i)] for i in free]), 1) if len(free) else []
        self.own = np.flatnonzero(touched)
        x = ca.vertcat(z, *[theta[int(free[i])] for i in self.own])
        J, H = ca.densify(ca.jacobian(y, x)), ca.densify(ca.hessian(ca.dot(mu, y), x)[0])
        functions = [
            ca.Function("h_values", [z, theta], [y], {"cse": True}),
            ca.Function("h_jacobian", [z, theta], [J], {"cse": True}),
            ca.Function("h_hessian", [z, theta, mu], [H], {"cse": True}),
        ]
        self._batch = batch_functions(functions, compiled)[0]

    def values(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Logged columns (6, m)."""
        return z[:6] if self.identity else self._batch[0].at(z, theta)[0]

    def jacobian(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """d y / d (z, own coefficients), (m, 6, S + O)."""
        flat = self._batch[1].at(z, theta)[0]
        return np.ascontiguousarray(flat.T.reshape(-1, self.S + len(self.own), 6).swapaxes(1, 2))

    def hessian(self, z: np.ndarray, theta: np.ndarray, mu: np.ndarray) -> np.ndarray:
        """Second derivative of mu . y with respect to (z, own coefficients), mu (6, m): (m, S + O, S + O)."""
        size = self.S + len(self.own)
        return np.ascontiguousarray(self._batch[2].at(z, theta, mu)[0].T.reshape(-1, size, size))

    def slope(self, z: np.ndarray, we: np.ndarray, theta: np.ndarray, free: int) -> tuple[np.ndarray, np.ndarray]:
        """Gradient of 1/2 sum w e^2 with respect to states z (m, S) and, directly, the ``free`` coefficients (m, free).

        we: (m, 6) weighted residuals. The latter has one row of zeros if the measurement model depends on none.
        """
        if self.identity:
            return np.hstack([we, np.zeros((len(we), self.S - 6))]), np.zeros((1, free))
        direct = np.zeros((len(we), free))
        pull = (we[:, None, :] @ self.jacobian(z.T, theta))[:, 0]
        direct[:, self.own] = pull[:, self.S :]
        return pull[:, : self.S], direct

    def curvature(self, z: np.ndarray, w: np.ndarray, we: np.ndarray | None, theta: np.ndarray) -> np.ndarray:
        """Hessian of 1/2 sum w e^2 with respect to states z (m, S) and own coefficients, (m, S + O, S + O).

        w, we: (m, 6) weights and weighted residuals; None: to first order in the columns.
        """
        J = self.jacobian(z.T, theta)
        first = np.swapaxes(J, 1, 2) @ (w[:, :, None] * J)
        return first if we is None else first + self.hessian(z.T, theta, we.T)
