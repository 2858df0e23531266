"""Model predictive control of the heading with the exported ship: python heading_mpc.py [DEGREES]

The controller plans the rudder over a horizon by multiple shooting, solved by IPOPT, which comes with CasADi; it moves
the ship's own step function. Needs casadi and numpy, nothing else. Units are SI and radians.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from example import steady_revolutions


@dataclass(frozen=True)
class Tuning:
    """What the controller wants and may do.

    intervals: of the horizon; largest_rudder [rad], rudder_rate [rad/s]; rudder_weight, change_weight: price of a
    rudder angle and of its change, by that of the same heading error.
    """

    intervals: int = 25
    largest_rudder: float = math.radians(35.0)
    rudder_rate: float = math.radians(5.0)
    rudder_weight: float = 0.02
    change_weight: float = 0.5


class HeadingController:
    """Plans rudder angles that bring the ship to a heading.

    folder: with the exported functions; n: revolutions [1/s], held; dt: interval of control [s]. ``plan`` holds what
    was found last.
    """

    def __init__(self, folder: Path, n: float, dt: float, tuning: Tuning | None = None) -> None:
        self.about = json.loads((folder / "model.json").read_text(encoding="utf-8"))
        self.step = ca.Function.load(str(folder / "step.casadi"))
        self.names = [row["name"] for row in self.about["controls"]]
        self.n, self.dt, self.tuning = n, dt, tuning or Tuning()
        self.parts = max(1, math.ceil(dt / self.about["longest_step_s"] - 1e-9))
        self.interval = self._interval()
        self.solver, self.bounds = self._solver()
        self.guess: np.ndarray | None = None
        self.plan = np.zeros(self.tuning.intervals)

    def _interval(self) -> ca.Function:
        """Function (state (S,), rudder angle, wind (2,)) -> state one interval later."""
        state, delta, wind = (ca.SX.sym(n, k) for n, k in (("z", len(self.about["states"])), ("d", 1), ("wind", 2)))
        given: dict[str, Any] = {"n": self.n, "delta": delta, "wind_north": wind[0], "wind_east": wind[1]}
        controls, after = ca.vertcat(*[given.get(name, 0.0) for name in self.names]), state
        for _ in range(self.parts):
            after = self.step(after, controls, self.dt / self.parts)
        return ca.Function("interval", [state, delta, wind], [after])

    def _solver(self) -> tuple[ca.Function, dict[str, np.ndarray]]:
        """The nonlinear program: rudder angles (K,) and states (S, K) that follow from them."""
        t, S = self.tuning, len(self.about["states"])
        K = t.intervals
        deltas, states = ca.MX.sym("deltas", K), ca.MX.sym("states", S, K)
        start, before, heading, wind = (ca.MX.sym(n, k) for n, k in (("z", S), ("d", 1), ("psi", 1), ("wind", 2)))
        reached = self.interval.map(K)(ca.horzcat(start, states[:, : K - 1]), deltas.T, ca.repmat(wind, 1, K))
        changes = deltas - ca.vertcat(before, deltas[: K - 1])
        cost = ca.sumsqr(states[2, :] - heading) + t.rudder_weight * ca.sumsqr(deltas)
        program: dict[str, Any] = {
            "x": ca.vertcat(deltas, ca.vec(states)),
            "p": ca.vertcat(start, before, heading, wind),
        }
        program |= {
            "f": cost + t.change_weight * ca.sumsqr(changes),
            "g": ca.vertcat(ca.vec(states - reached), changes),
        }
        quiet: dict[str, Any] = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.max_iter": 200}
        widest, change = np.full(K, t.largest_rudder), np.full(K, t.rudder_rate * self.dt)
        bounds = {"ubx": np.concatenate([widest, np.full(S * K, np.inf)])}
        bounds |= {"ubg": np.concatenate([np.zeros(S * K), change])}
        return ca.nlpsol("plan", "ipopt", program, quiet), bounds

    def rudder(self, state: np.ndarray, delta: float, heading: float, wind: tuple[float, float] = (0, 0)) -> float:
        """The rudder angle [rad] to hold over the next interval.

        state (S,); delta: rudder angle so far [rad]; heading: wanted [rad]; wind: velocity of the air to north and east
        as the controller knows it [m/s]. Raises RuntimeError where no plan is found.
        """
        K, S = self.tuning.intervals, len(state)
        if self.guess is None:
            self.guess = np.concatenate([np.full(K, delta), np.tile(state, K)])
        u, g = self.bounds["ubx"], self.bounds["ubg"]
        p = np.concatenate([state, [delta, heading], wind])
        solution = self.solver(x0=self.guess, p=p, lbx=-u, ubx=u, lbg=-g, ubg=g)
        if not self.solver.stats()["success"]:
            raise RuntimeError(f"no plan: {self.solver.stats()['return_status']}")
        x = np.array(solution["x"]).ravel()
        self.plan = x[:K]
        moved = x[K:].reshape(K, S)
        self.guess = np.concatenate([x[1:K], x[K - 1 : K], moved[1:].ravel(), moved[-1]])
        return float(x[0])


def sail(
    controller: HeadingController,
    heading: float,
    duration: float,
    speed: float,
    wind: tuple[float, float] = (0.0, 0.0),
    wind_known: bool = True,
) -> np.ndarray:
    """The ship under the controller, rows t, heading, rudder, u, v, r (N, 6) in SI, from heading north.

    heading: wanted [rad] from the first moment; duration [s]; speed: at the start [m/s]; wind: velocity of the air to
    north and east [m/s]; wind_known: whether the controller knows the wind.
    """
    state, delta, rows = np.zeros(len(controller.about["states"])), 0.0, []
    state[3] = speed
    for k in range(round(duration / controller.dt) + 1):
        delta = controller.rudder(state, delta, heading, wind if wind_known else (0.0, 0.0))
        rows.append([k * controller.dt, state[2], delta, *state[3:6]])
        state = np.array(controller.interval(ca.DM(state), delta, ca.DM(wind))).ravel()
    return np.array(rows)


def main() -> None:
    folder, wanted = Path(__file__).parent, float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    about = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    scale = math.sqrt(about["length_m"] / 3.0)
    speed = about["service_speed_m_s"] or 0.07 * math.sqrt(9.81 * about["length_m"])
    tuning = Tuning(rudder_rate=math.radians(5.0) / scale)
    controller = HeadingController(folder, steady_revolutions(folder, speed), scale, tuning)
    for t, psi, delta, u, _, _ in sail(controller, math.radians(wanted), 60.0 * scale, speed)[::5]:
        print(
            f"t {t:6.1f} s  heading {math.degrees(psi):7.2f} deg  rudder {math.degrees(delta):7.2f} deg  u {u:.3f} m/s"
        )


if __name__ == "__main__":
    main()
