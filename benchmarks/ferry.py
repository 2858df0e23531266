"""A ferry of 5 m with four pods in harbour manoeuvres at 0 to 0.7 m/s, by equations that the product does not have.

Her linear and quadratic damping, Coriolis forces, a current, a steady wind on her side, pods of unequal thrust that
wash each other, gusts and noise of the sensors are drawn by seed. A ship file as of ``mmg ships --new`` is calibrated
on six runs; three others are predicted over 30 s windows, beside kept velocities and the grey box of ``mmg score
--baseline``. The ratios of the rms errors are to be .85 or less.

Run from the repository root: python -m benchmarks.ferry [--seeds 1 2 3]
"""

from __future__ import annotations

import argparse

import numpy as np

from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.new_ship import new_ship
from cases.trial import Trial
from fitting.calibrate import FitOptions
from fitting.prediction.baselines import fit_grey_box
from fitting.prediction.unit_errors import errors_in_units
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.api import calibrate

STEP, LOGGED, LENGTH = 0.05, 10, 300.0
"""Step of the simulation [s], steps from sample to sample, length of a run [s]."""
TRAINING, HELD_OUT = 6, 3
WINDOW = 30.0
"""s; of a prediction."""
MASS = np.array([1900.0, 2700.0, 4300.0])
"""With added mass, in surge and sway [kg] and yaw [kg m^2]."""
LINEAR, QUADRATIC = np.array([65.0, 110.0, 160.0]), np.array([90.0, 520.0, 900.0])
"""Mean linear damping [kg/s, kg/s, kg m^2/s] and quadratic damping [kg/m, kg/m, kg m^2]."""
PODS = np.array([[1.8, 0.8], [1.8, -0.8], [-1.8, 0.8], [-1.8, -0.8]])
"""Places of the pods, forward and to starboard of midship [m]."""
DIAMETER, BOLLARD = 0.3, 3.2
"""Of a pod [m], and its thrust at rest by n^2 [N s^2]: K_T = 0.4, which ends at an advance ratio of 0.9 to 1.3."""
PARTICULARS = {"L": 5.0, "B": 2.2, "d": 0.3, "C_b": 0.55, "m": 1800.0, "rho": 1000.0, "U_0": 1.0, "x_G": 0.0}
NOISE = np.array([0.02, 0.02, 0.004, 0.01, 0.01, 0.002])
"""Standard deviations of the noise of x, y [m], psi [rad], u, v [m/s], r [rad/s]."""


class Ferry:
    """The true ferry of one ``seed``, and her runs."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.linear = LINEAR * rng.lognormal(0.0, 0.3, 3)
        self.quadratic = QUADRATIC * rng.lognormal(0.0, 0.3, 3)
        self.efficiency = rng.uniform(0.7, 1.1, 4)
        self.no_thrust = rng.uniform(0.9, 1.3)
        course, wind = rng.uniform(-np.pi, np.pi, 2)
        self.current = rng.uniform(0.04, 0.12) * np.array([np.cos(course), np.sin(course)])
        self.wind, self.wind_force = wind, rng.uniform(8.0, 20.0)

    def acceleration(self, state: np.ndarray, n: np.ndarray, azimuth: np.ndarray, gust: np.ndarray) -> np.ndarray:
        """Rates (6,) of x, y, psi, u, v, r. state: these; n (4,) [1/s]; azimuth (4,) [rad]; gust (3,) [N, N, N m]."""
        _, _, psi, u, v, r = state
        c, s = np.cos(psi), np.sin(psi)
        u_c, v_c = np.array([[c, s], [-s, c]]) @ self.current
        motion = np.array([u - u_c, v - v_c, r])
        force = -self.linear * motion - self.quadratic * motion * np.abs(motion) + gust
        angle = self.wind - psi
        force += self.wind_force * np.array([0.5 * np.cos(angle), np.sin(angle), 0.3 * np.sin(2 * angle)])
        flow = np.array([motion[0] - PODS[:, 1] * r, motion[1] + PODS[:, 0] * r])
        along = flow[0] * np.cos(azimuth) + flow[1] * np.sin(azimuth)
        thrust = self.efficiency * BOLLARD * np.abs(n) * (n - along / (self.no_thrust * DIAMETER))
        X, Y = thrust * np.cos(azimuth), thrust * np.sin(azimuth)
        force += np.array([X.sum(), Y.sum(), (PODS[:, 0] * Y - PODS[:, 1] * X).sum()])
        coriolis = np.array([MASS[1] * motion[1] * r, -MASS[0] * motion[0] * r, 0.0])
        coriolis[2] = (MASS[0] - MASS[1]) * 0.5 * motion[0] * motion[1]
        du, dv, dr = (force + coriolis) / MASS
        return np.array([u * c - v * s, u * s + v * c, r, du + r * v_c, dv - r * u_c, dr])

    def run(self, name: str) -> Trial:
        """A run of orders that change every 12 to 25 s: ahead, aside, astern, turning, drifting, and mixed."""
        rng = self.rng
        state, gust = np.zeros(6), np.zeros(3)
        state[2] = rng.uniform(-np.pi, np.pi)
        n, azimuth = np.zeros(4), np.zeros(4)
        until, n_order, direction = 0.0, n, azimuth
        rows = []
        for k in range(int(LENGTH / STEP)):
            if k * STEP >= until:
                until = k * STEP + rng.uniform(12.0, 25.0)
                n_order, direction = self._orders()
            n = n + STEP / 1.0 * (n_order - n)
            azimuth = azimuth + np.clip(direction - azimuth, -0.6 * STEP, 0.6 * STEP)
            gust = gust + STEP * -gust / 8.0 + np.sqrt(STEP) * rng.normal(size=3) * (1.5, 1.5, 1.5)
            if k % LOGGED == 0:
                rows.append([k * STEP, *(state + NOISE * rng.normal(size=6)), *n, *azimuth])
            middle = state + 0.5 * STEP * self.acceleration(state, n, azimuth, gust)
            state = state + STEP * self.acceleration(middle, n, azimuth, gust)
        names = ["t", "x", "y", "psi", "u", "v", "r", *(f"n_azimuth{i}" for i in ("", "_2", "_3", "_4"))]
        names += [f"azimuth{i}" for i in ("", "_2", "_3", "_4")]
        columns = dict(zip(names, np.array(rows).T, strict=True))
        return Trial(name, columns, meta={"inputs": "sampled"})

    def _orders(self) -> tuple[np.ndarray, np.ndarray]:
        """Revolutions [1/s] and directions [rad] of the four pods."""
        rng, n = self.rng, self.rng.uniform(0.5, 4.0)
        kind = rng.choice(["ahead", "aside", "turn", "mixed", "drift"])
        if kind == "drift":
            return np.zeros(4), rng.uniform(-np.pi, np.pi, 4)
        if kind == "turn":
            side = rng.choice([-1.0, 1.0])
            return np.full(4, 0.6 * n), side * np.array([0.5, 0.5, -0.5, -0.5]) * np.pi
        if kind == "mixed":
            return rng.uniform(0.5, 3.5, 4), rng.uniform(-np.pi, np.pi, 4)
        course = rng.uniform(-0.4, 0.4) + (rng.choice([0.0, np.pi]) if kind == "ahead" else rng.choice([-1, 1]) * 1.57)
        return n * rng.uniform(0.8, 1.2, 4), course + rng.normal(size=4) * 0.15


def start() -> Ship:
    """The ship that a person writes who knows the particulars, with a current and a steady wind to be found."""
    places = {f"{axis}_az{i}": float(place[k]) for i, place in zip(("", "_2", "_3", "_4"), PODS, strict=True)
              for k, axis in enumerate("xy")}  # fmt: skip
    return new_ship("ferry", {**PARTICULARS, "D_az": DIAMETER, **places})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--with", dest="effects", nargs="*", default=["current", "tow", "wave_drift"])
    given = parser.parse_args()
    for seed in given.seeds:
        ferry = Ferry(seed)
        train = [ferry.run(f"train {k}") for k in range(TRAINING)]
        held_out = [ferry.run(f"test {k}") for k in range(HELD_OUT)]
        fit = calibrate(freeing_effects(start(), given.effects), train, options=FitOptions(next_trial=False))
        simulator = Simulator(fit.ship)
        box = fit_grey_box(train, simulator.ship.inputs, fit.ship.particulars, WINDOW)
        errors = errors_in_units(simulator, held_out, WINDOW, baseline=box)
        print(f"seed {seed}: {fit.status}, {fit.timings_s['wall']:.0f} s")
        for name, rows in (("model", errors.pooled), *((n, e.pooled) for n, e in errors.references.items())):
            print(f"  {name:12} position {rows.position_m:.3f} m, heading {rows.heading_deg:.2f} deg, "
                  f"u {rows.u_m_s:.4f}, v {rows.v_m_s:.4f} m/s, r {rows.r_deg_s:.3f} deg/s")  # fmt: skip
        for name, ratios in errors.ratio.items():
            print(f"  by {name}: " + ", ".join(f"{state} {ratio:.2f}" for state, ratio in ratios.items()))


if __name__ == "__main__":
    main()
