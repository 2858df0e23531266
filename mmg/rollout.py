"""Simulation of many trajectories side by side with fixed-step Runge-Kutta (or Euler) integration."""

from __future__ import annotations

import casadi as ca
import numpy as np

from mmg.batch import BatchFunction, batch_functions, padded
from mmg.model import assemble
from mmg.ship import Ship


class Simulator:
    """Integrates a ship from given initial states under given inputs.

    ``compiled=False`` runs without a C compiler. ``interpreted_because`` says why it does when it does.
    """

    def __init__(self, ship: Ship, compiled: bool = True) -> None:
        self.ship = ship
        self.model = assemble(ship)
        q, c = ca.SX.sym("q", 4), ca.SX.sym("c", 4)
        theta = ca.SX.sym("theta", len(self.model.symbols))
        rates = ca.cse(self.model.rates(ca.vertcat(0, 0, q), c, theta))
        function = ca.Function("f_rates", [q, c, theta], [rates], {"cse": True})
        batch, self.interpreted_because = batch_functions([function], compiled)
        self._rates: BatchFunction = batch[0]

    def rates(self, state: np.ndarray, controls: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """d state / dt (6, M) from states (6, M), controls (4, M), coefficients (P,) or (P, M)."""
        count = state.shape[1]
        extra = padded(count) - count
        theta = self.ship.values if theta is None else theta
        if extra:
            state, controls = (np.hstack([a, np.repeat(a[:, -1:], extra, axis=1)]) for a in (state, controls))
            if theta.ndim == 2:
                theta = np.hstack([theta, np.repeat(theta[:, -1:], extra, axis=1)])
        result = self._rates(state[2:], controls, theta)[0]
        assert result is not None
        return result[:, :count]

    def run(
        self,
        start: np.ndarray,
        controls: np.ndarray,
        dt: float | np.ndarray,
        theta: np.ndarray | None = None,
        method: str = "rk4",
    ) -> np.ndarray:
        """States (N + 1, 6, M) from start (6, M) and inputs (N, 4, M) held over each step.

        dt: one step [s], or (N,) or (N, M) steps. theta: coefficients (P,) shared or (P, M); default the ship's.
        method: "rk4" or "euler".
        """
        N, M = controls.shape[0], start.shape[1]
        steps = np.broadcast_to(np.asarray(dt, dtype=float).reshape(np.shape(dt) + (1,) * (2 - np.ndim(dt))), (N, M))
        out = np.empty((N + 1, 6, M))
        out[0] = z = np.array(start, dtype=float)
        for k in range(N):
            h, c = steps[k], controls[k]
            k1 = self.rates(z, c, theta)
            if method == "euler":
                z = z + h * k1
            else:
                k2 = self.rates(z + 0.5 * h * k1, c, theta)
                k3 = self.rates(z + 0.5 * h * k2, c, theta)
                k4 = self.rates(z + h * k3, c, theta)
                z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            out[k + 1] = z
        return out
