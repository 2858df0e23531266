"""A turning of KVLCC2, alone and 10,000 times with scattered coefficients, and the same turning with shipmmg.

Run from the repository root: python -m benchmarks.open_comparisons.turning [--record]
For the comparison install shipmmg beside this package.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any
from unicodedata import normalize

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.record import Figure, keep, table
from cases.maneuvers.definitions import Maneuver, parse_maneuver
from cases.maneuvers.orders import Turning
from cases.shipfiles.ship_file import load_ship
from cases.simulation.actuator_ramps import ramps
from cases.simulation.simulate_batch import input_array, simulate_batch
from mmg.rollout import Simulator
from mmg.ship import Ship

SPEED, RUDDER, RATE, SECONDS = 1.179, math.radians(35.0), math.radians(15.82), 300.0
"""Approach speed [m/s], rudder angle [rad] and rate [rad/s] of the free-running tests of the 7 m model; duration."""
STEP, MANY, SPREAD, GOAL = 0.75, 10_000, 0.05, 1e-4
"""Runge-Kutta step [s]; ships side by side, and the share by which coefficients differ; error [L] to compare at."""


SETTINGS: tuple[dict[str, Any], ...] = (
    {},
    {"rtol": 1e-4},
    {"rtol": 1e-5},
    {"rtol": 1e-6},
    {"rtol": 1e-7},
    {"rtol": 1e-6, "atol": 1e-8},
    {"rtol": 1e-7, "atol": 1e-8},
    {"rtol": 1e-8, "atol": 1e-9},
    {"method": "LSODA", "rtol": 1e-6, "atol": 1e-8},
    {"method": "DOP853", "rtol": 1e-6, "atol": 1e-8},
)
"""Options of solve_ivp that shipmmg is tried with."""


def best_of(count: int, work: Callable[[], object]) -> float:
    """Shortest of ``count`` runs of some ``work`` [s]."""
    times = []
    for _ in range(count):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def maneuver(ship: Ship) -> Maneuver:
    """The turning: rudder ordered at t = 0."""
    plan = parse_maneuver("turning:35", ship, speed=SPEED, duration=SECONDS, rudder_rate=RATE)
    return replace(plan, orders=lambda: Turning(plan.n, 0.0, RUDDER))


def scattered(count: int, spread: float) -> tuple[Ship, np.ndarray]:
    """The ship, and her coefficients (P, count) each times N(1, spread)."""
    ship = load_ship("kvlcc2_l7")
    noise = np.random.default_rng(0).standard_normal((len(ship.values), count))
    return ship, ship.values[:, None] * (1 + spread * noise)


def reference(simulator: Simulator, plan: Maneuver, t: np.ndarray) -> np.ndarray:
    """x, y (N + 1, 2) at t by DOP853, rtol 1e-12, from kink to kink of the rudder's path."""
    moves, values = ramps(plan, plan.orders(), t), simulator.ship.values

    def rates(when: float, z: np.ndarray) -> np.ndarray:
        at = np.array([when])
        return np.array(simulator.model.rates(z, input_array(simulator.ship, moves.at(at), at)[0], values)).ravel()

    z, out = plan.start, [plan.start[:2]]
    for a, b in zip(moves.times[:-1], moves.times[1:], strict=True):
        wanted = t[(t > a) & (t <= b)]
        points = np.union1d(wanted, [b])
        y = solve_ivp(rates, (a, b), z, "DOP853", t_eval=points, rtol=1e-12, atol=1e-13).y
        z = y[:, -1]
        out += list(y[:2, np.isin(points, wanted)].T)
    return np.array(out)


def shipmmg(ship: Ship, plan: Maneuver, t: np.ndarray) -> list[dict[str, Any]]:
    """A row for each of SETTINGS: words, seconds with the places at ``t``, calls of the right-hand side, and largest
    error of a place [m] against shipmmg's model solved exactly. Raises ImportError where it is not to be had."""
    from shipmmg import mmg_3dof

    p, c = ship.particulars, {s: x.value for s, x in ship.coefficients.items()}
    unit = 0.5 * p["rho"] * p["L"] ** 2 * p["d"]
    basic = {
        "L_pp": p["L"], "B": p["B"], "d": p["d"], "x_G": p["x_G"], "D_p": p["D_P"], "m": p["m"], "A_R": p["A_R"],
        "I_zG": c["I_J_z"] * unit * p["L"] ** 2, "J_z": 0.0, "m_x": c["m_x"] * unit, "m_y": c["m_y"] * unit,
        "η": p["D_P"] / math.sqrt(p["aspect_ratio"] * p["A_R"]), "f_α": c["f_alpha"], "ϵ": c["epsilon"],
        "t_R": c["t_R"], "x_R": p["x_R"], "a_H": c["a_H"], "x_H": c["x_H"] * p["L"], "γ_R_minus": c["gamma_R_minus"],
        "γ_R_plus": c["gamma_R_plus"], "l_R": c["ell_R"], "κ": c["kappa"], "t_P": c["t_P"], "w_P0": c["w_P0"],
        "x_P": c["x_P"],
    }  # fmt: skip
    hull = ["R_0"] + [s for s in c if s[:2] in ("X_", "Y_", "N_")]
    maneuvering = {s: c[s] for s in ("k_0", "k_1", "k_2")} | {f"{s}_dash": c[s] for s in hull}
    fine = np.linspace(0.0, SECONDS, 3001)
    path = ramps(plan, plan.orders(), fine).at(fine)
    basic_params = mmg_3dof.Mmg3DofBasicParams(**{normalize("NFKC", k): v for k, v in basic.items()})
    maneuvering_params = mmg_3dof.Mmg3DofManeuveringParams(**maneuvering)

    def turned(**options: Any) -> tuple[np.ndarray, int]:
        solution = mmg_3dof.simulate_mmg_3dof(
            basic_params, maneuvering_params, fine, path[:, 1], path[:, 0], u0=plan.speed, ρ=p["rho"], **options
        )
        return np.array(solution.sol(t)[3:5]), solution.nfev

    exact, rows = turned(method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.1)[0], []
    for options in SETTINGS:
        seconds = best_of(7, partial(turned, **options))
        places, calls = turned(**options)
        words = ", ".join(f"{k} {v if isinstance(v, str) else f'{v:g}'}" for k, v in options.items())
        error = float(np.hypot(*(places - exact)).max())
        rows.append({"words": words or "its defaults (RK45, rtol 1e-3)", "s": seconds, "calls": calls, "error": error})
    return rows


def main() -> None:
    """Measure, print and, if asked, record."""
    ship, theta = scattered(MANY, SPREAD)
    simulator, plan, L = Simulator(ship), maneuver(ship), ship.particulars["L"]
    t = STEP * np.arange(round(SECONDS / STEP) + 1)
    one = best_of(50, lambda: simulate_batch(simulator, plan, dt=STEP))
    away = simulate_batch(simulator, plan, dt=STEP).states[:, :2, 0] - reference(simulator, plan, t)
    error = float(np.hypot(*away.T).max() / L)
    many = best_of(3, lambda: simulate_batch(simulator, plan, theta, STEP, threads=2))
    made = {"turning": Figure("a turning of KVLCC2, 300 s", 1e3 * one, "ms", note=f"off by {error:.1e} L at most"),
            "turnings": Figure(f"{MANY:,} turnings of KVLCC2, two threads", many, "s")}  # fmt: skip
    print(f"one turning {1e3 * one:.2f} ms, error {error:.1e} L; {MANY} scattered {many:.2f} s on two threads")
    try:
        rows = shipmmg(ship, plan, t)
    except ImportError as reason:
        print(f"shipmmg was not measured ({reason}); see the docstring of this module")
    else:
        body = [[r["words"], f"{1e3 * r['s']:.1f}", str(r["calls"]), f"{r['error'] / L:.1e}"] for r in rows]
        print("\n".join(table(["shipmmg, solve_ivp with", "ms", "calls", "error / L"], body)))
        for name, goal, words in (("shipmmg", GOAL, f"below {GOAL:g} L"), ("shipmmg_same", error, "as small as here")):
            best = min((r for r in rows if r["error"] / L <= goal), key=lambda r: r["s"])
            what = f"shipmmg by a turning here, its error {words}"
            made[name] = Figure(what, best["s"] / one, "times as long", note=best["words"])
    print("\n".join(f"{figure.what}: {figure.value:.3g} {figure.unit}" for figure in made.values()))
    if "--record" in sys.argv:
        keep(made, "python -m benchmarks.open_comparisons.turning")


if __name__ == "__main__":
    main()
