"""Simulation of many trajectories side by side with fixed-step Runge-Kutta (or Euler) integration."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from mmg.compile.batch import BatchFunction, Rollout, batch_functions, compile_rollout, filled
from mmg.compile.codegen import LANES
from mmg.model import assemble, columns, settled, states_behind
from mmg.runge_kutta import rk4_step
from mmg.ship import Ship


class Simulator:
    """Integrates a ship from given initial states under given inputs.

    States have S rows: x, y, psi, u, v, r and what the ship's effects remember (``model.states``).
    ``compiled=False`` runs without a C compiler. Code is compiled (or taken from the cache) when it is first used.
    """

    def __init__(self, ship: Ship, compiled: bool = True) -> None:
        self.ship, self.compiled = ship, compiled
        self.model = assemble(ship)
        first = self.model.first
        # without the position, where nothing depends on it: fewer arguments to load for every point and stage
        q, c = ca.SX.sym("q", len(self.model.states) - first), ca.SX.sym("c", len(self.model.controls))
        theta = ca.SX.sym("theta", len(self.model.symbols))
        rates = ca.cse(self.model.rates(ca.vertcat(ca.SX.zeros(first), q), c, theta))
        self._function = ca.Function("f_rates", [q, c, theta], [ca.densify(rates)], {"cse": True})

    def __reduce__(self) -> tuple[type[Simulator], tuple[Ship, bool]]:
        """In another process it is made anew, its code taken from the cache."""
        return Simulator, (self.ship, self.compiled)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of its inputs, as of ``Ship.inputs``."""
        return self.ship.inputs

    @property
    def _named(self) -> str:
        return f"the equations of {self.ship.name}"

    @cached_property
    def _batch(self) -> tuple[BatchFunction, str]:
        (batch,), reason = batch_functions([self._function], self.compiled, self._named)
        return batch, reason

    @cached_property
    def _logged(self) -> BatchFunction | None:
        (batch,), _ = batch_functions([self.model.columns_by], self.compiled, self._named)
        return batch if batch.library else None

    @cached_property
    def _rollout(self) -> Rollout | None:
        return compile_rollout(self._function, self.model.first, self._named) if self.compiled else None

    @property
    def is_stepwise(self) -> bool:
        """Whether it goes step by step in Python, for want of compiled code: fast with many points side by side."""
        return self._rollout is None

    @property
    def interpreted_because(self) -> str:
        """Why it runs without compiled code, when it does; else empty."""
        return self._batch[1]

    def rates(self, state: np.ndarray, controls: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """d state / dt (S, M) from states (S, M), controls (C, M), coefficients (P,) or (P, M)."""
        theta = self.ship.values if theta is None else theta
        return self._batch[0].at(state[self.model.first :], controls, theta)[0]

    def columns(self, states: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """The six columns as they are logged, (..., 6, M), of states (..., S, M)."""
        theta = self.ship.values if theta is None else theta
        compiled = self._logged if self.model.measured else None
        if compiled is None:
            return columns(self.model, states, theta)
        return columns(self.model, states, theta, lambda z, own: compiled.at(z, own)[0])

    def start(self, logged: np.ndarray, controls: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """States (S, M) that are logged as (6, M) under inputs (C, M), their memory settled."""
        return states_behind(self.model, logged, controls, self.ship.values if theta is None else theta)

    def run(
        self,
        start: np.ndarray,
        controls: np.ndarray,
        dt: float | np.ndarray,
        theta: np.ndarray | None = None,
        method: str = "rk4",
        *,
        keep: np.ndarray | None = None,
    ) -> np.ndarray:
        """States (N + 1, S, M) from start (S, M) and inputs (N, C, M), or (N, C) for all points, held over each step.

        A start of six rows is settled. dt: one step [s], or (N,) or (N, M) steps. theta: coefficients (P,) shared
        or (P, M); default the ship's. method: "rk4" or "euler". keep: (N,) bool, the steps whose end is wanted:
        states (1 + kept, S, M). Raises ValueError for shapes that do not fit and for an unknown method.
        """
        theta = self.ship.values if theta is None else theta
        N, M = len(controls), start.shape[1]
        keep = np.ones(N, dtype=bool) if keep is None else np.asarray(keep, dtype=bool)
        steps = np.asarray(dt, dtype=float)
        if steps.ndim == 2 and steps.shape[1] == 1:  # a column of steps is one for all points
            steps = steps[:, 0]
        C, P = len(self.model.controls), len(self.model.symbols)
        allowed: dict[str, tuple[tuple[int, ...], set[tuple[int, ...]]]] = {
            "start": (start.shape, {(len(self.model.states), M), (6, M)}),
            "controls": (controls.shape[1:], {(C,), (C, M)}),
            "dt": (steps.shape, {(), (N,), (N, M)}),
            "theta": (theta.shape, {(P,), (P, M)}),
            "keep": (keep.shape, {(N,)}),
        }
        for name, (shape, possible) in allowed.items():
            if N and shape not in possible:
                raise ValueError(f"{name} of shape {shape}; possible: {sorted(possible, key=len)}")
        if method not in ("rk4", "euler"):
            raise ValueError(f"method {method!r} is neither 'rk4' nor 'euler'")
        if len(start) == 6 and len(controls):
            start = settled(self.model, start, controls[0], theta)
        if M * N == 0:  # nothing to integrate
            return np.repeat(start[None], 1 + int(keep.sum()), axis=0)
        if self._rollout is None:
            return self._stepwise(start, controls, steps, theta, keep, method)
        # kernels take at least a vector of points: the last one is repeated where an array has them
        by_point = ((start, True), (controls, controls.ndim == 3), (steps, steps.ndim == 2), (theta, theta.ndim == 2))
        start, controls, steps, theta = (filled(a, LANES) if has_points else a for a, has_points in by_point)
        return self._rollout(start, controls, steps, theta, keep, method == "euler")[..., :M]

    def _stepwise(
        self,
        start: np.ndarray,
        controls: np.ndarray,
        steps: np.ndarray,
        theta: np.ndarray,
        keep: np.ndarray,
        method: str,
    ) -> np.ndarray:
        """``run`` in Python, one call of the rates per stage: what the compiled rollout does."""
        (S, M), N = start.shape, len(keep)
        if controls.ndim == 2:
            controls = np.repeat(controls[:, :, None], M, axis=2)
        steps = np.broadcast_to(steps[:, None] if steps.ndim == 1 else steps, (N, M))
        out = np.empty((1 + int(keep.sum()), S, M))
        out[0] = z = np.array(start, dtype=float)
        row = 1
        for k in range(N):
            h, held = steps[k], controls[k]
            if method == "euler":
                z = z + h * self.rates(z, held, theta)
            else:
                z = rk4_step(lambda state, _, c=held: self.rates(state, c, theta), z, h)  # type: ignore[misc]
            if keep[k]:
                out[row] = z
                row += 1
        return out
