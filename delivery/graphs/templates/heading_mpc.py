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
        self.n, self.dt = n, dt
        self.interval = self._interval(ca.Function.load(str(folder / "step.casadi")))
        t = tuning or Tuning()
        S, K = len(self.about["states"]), t.intervals
        self.plan = np.zeros(K)
        problem = self.problem = ca.Opti()
        self.deltas, self.states = problem.variable(K), problem.variable(S, K)
        self.start, self.before = problem.parameter(S), problem.parameter()
        self.heading, self.wind = problem.parameter(), problem.parameter(2)
        reached = self.interval.map(K)(
            ca.horzcat(self.start, self.states[:, :-1]), self.deltas.T, ca.repmat(self.wind, 1, K)
        )
        changes = self.deltas - ca.vertcat(self.before, self.deltas[:-1])
        problem.subject_to(self.states == reached)
        problem.subject_to(problem.bounded(-t.rudder_rate * dt, changes, t.rudder_rate * dt))
        problem.subject_to(problem.bounded(-t.largest_rudder, self.deltas, t.largest_rudder))
        cost = ca.sumsqr(self.states[2, :] - self.heading) + t.rudder_weight * ca.sumsqr(self.deltas)
        problem.minimize(cost + t.change_weight * ca.sumsqr(changes))
        problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "max_iter": 200})

    def _interval(self, step: ca.Function) -> ca.Function:
        """Function (state (S,), rudder angle, wind (2,)) -> state one interval later."""
        state, delta, wind = (ca.SX.sym(n, k) for n, k in (("z", len(self.about["states"])), ("d", 1), ("wind", 2)))
        given: dict[str, Any] = {"n": self.n, "delta": delta, "wind_north": wind[0], "wind_east": wind[1]}
        controls, after = ca.vertcat(*[given.get(row["name"], 0.0) for row in self.about["controls"]]), state
        parts = max(1, math.ceil(self.dt / self.about["longest_step_s"] - 1e-9))
        for _ in range(parts):
            after = step(after, controls, self.dt / parts)
        return ca.Function("interval", [state, delta, wind], [after])

    def rudder(self, state: np.ndarray, delta: float, heading: float, wind: tuple[float, float] = (0, 0)) -> float:
        """The rudder angle [rad] to hold over the next interval.

        state (S,); delta: rudder angle so far [rad]; heading: wanted [rad]; wind: velocity of the air to north and east
        as the controller knows it [m/s]. Raises RuntimeError where no plan is found.
        """
        known: list[tuple[Any, Any]] = [(self.start, state), (self.before, delta), (self.heading, heading)]
        for parameter, value in (*known, (self.wind, wind)):
            self.problem.set_value(parameter, value)
        if not self.plan.any():
            self.problem.set_initial(self.states, np.tile(state[:, None], len(self.plan)))
        solution = self.problem.solve()
        self.plan, states = np.array(solution.value(self.deltas)), np.array(solution.value(self.states))
        self.problem.set_initial(self.deltas, np.append(self.plan[1:], self.plan[-1]))
        self.problem.set_initial(self.states, np.hstack([states[:, 1:], states[:, -1:]]))
        return float(self.plan[0])


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
    tuning = Tuning(rudder_rate=about["rudder_rate_rad_s"] or math.radians(5.0) / scale)
    controller = HeadingController(folder, steady_revolutions(folder, speed), scale, tuning)
    for t, psi, delta, u, _, _ in sail(controller, math.radians(wanted), 60.0 * scale, speed)[::5]:
        angles = f"heading {math.degrees(psi):7.2f} deg  rudder {math.degrees(delta):7.2f} deg"
        print(f"t {t:6.1f} s  {angles}  u {u:.3f} m/s")


if __name__ == "__main__":
    main()
