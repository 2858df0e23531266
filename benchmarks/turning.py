"""One turning of KVLCC2, 10,000 with scattered coefficients, and the same turning with shipmmg.

Run from the repository root: python -m benchmarks.turning
For the comparison install shipmmg, in an environment of its own: python -m venv X; X/bin/pip install shipmmg; then
SHIPMMG_PYTHON=X/bin/python python -m benchmarks.turning
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.record import record, table
from benchmarks.speed import best_of
from cases.maneuvers.definitions import Maneuver, parse_maneuver
from cases.maneuvers.orders import Turning
from cases.shipfiles.ship_file import load_ship
from cases.simulation.actuator_ramps import ramps
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import input_array, simulate_batch
from mmg.rollout import Simulator
from mmg.ship import Ship

SHIP, SPEED, RUDDER, RATE, SECONDS = "kvlcc2_l7", 1.179, 35.0, 15.82, 300.0
"""Approach speed [m/s], rudder angle [deg] and rate [deg/s] of the free-running tests of the 7 m model; duration."""

STEP, MANY, SPREAD, GOAL = 0.75, 10_000, 0.05, 1e-4


def maneuver(ship: Ship) -> Maneuver:
    """The turning: rudder ordered at t = 0."""
    plan = parse_maneuver(f"turning:{RUDDER:g}", ship, speed=SPEED, duration=SECONDS, rudder_rate=math.radians(RATE))
    return replace(plan, orders=lambda: Turning(plan.n, 0.0, math.radians(RUDDER)))


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


def off(states: np.ndarray, truth: np.ndarray, length: float) -> float:
    """Largest position error over the run and all runs, in ship lengths."""
    return float(np.hypot(states[:, 0] - truth[:, 0], states[:, 1] - truth[:, 1]).max() / length)


def shipmmg(ship: Ship, plan: Maneuver, t: np.ndarray) -> tuple[list[dict[str, float]], str]:
    """Rows of benchmarks.turning_shipmmg, or a line that says why there are none."""
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
    given = {
        "basic": basic, "maneuvering": maneuvering, "t": fine.tolist(), "n": path[:, 0].tolist(),
        "delta": path[:, 1].tolist(), "u0": plan.speed, "rho": p["rho"], "at": t.tolist(), "repeats": 7,
    }  # fmt: skip
    python = os.environ.get("SHIPMMG_PYTHON", sys.executable)
    script = str(Path(__file__).with_name("turning_shipmmg.py"))
    try:
        run = subprocess.run([python, script], input=json.dumps(given), capture_output=True, text=True)
        why = (run.stderr.strip().splitlines() or ["no message"])[-1] if run.returncode else ""
    except OSError as error:
        why = str(error)
    if why:
        return [], f"shipmmg was not measured ({why}); see the docstring of benchmarks/turning.py."
    return json.loads(run.stdout), ""


def main() -> None:
    ship = load_ship(SHIP)
    simulator, plan, L = Simulator(ship), maneuver(ship), ship.particulars["L"]
    t = STEP * np.arange(round(SECONDS / STEP) + 1)
    one = best_of(50, lambda: simulate_batch(simulator, plan, dt=STEP))
    error = off(simulate_batch(simulator, plan, dt=STEP).states[:, :, 0], reference(simulator, plan, t), L)
    rng = np.random.default_rng(0)
    theta = ship.values[:, None] * (1 + SPREAD * rng.standard_normal((len(ship.values), MANY)))
    many = {n: best_of(3, lambda n=n: simulate_batch(simulator, plan, theta, STEP, threads=n)) for n in (1, 2)}
    coarse, fine = (simulate_batch(simulator, plan, theta[:, :200], dt).states for dt in (STEP, STEP / 15))
    scattered = off(coarse, fine[::15], L)
    loop = best_of(3, lambda: simulate(ship, plan, 0.1))
    zigzag = parse_maneuver("zigzag:20/20", ship, speed=SPEED, rudder_rate=math.radians(RATE), duration=SECONDS)
    zigzags = best_of(2, lambda: simulate_batch(simulator, zigzag, theta[:, :1000], 0.5, threads=2))
    each = many[2] / MANY
    rows = [
        ["one turning (simulate_batch, warm)", f"{1e3 * one:.2f}", f"{error:.1e}", "3 ms"],
        [f"{MANY} scattered, 1 thread", f"{1e3 * many[1] / MANY:.4f} each, {many[1]:.2f} s", f"{scattered:.1e}", ""],
        [f"{MANY} scattered, 2 threads", f"{1e3 * each:.4f} each, {many[2]:.2f} s", f"{scattered:.1e}", "10 s"],
        ["1000 scattered zigzags 20/20, 0.5 s, 2 threads", f"{zigzags:.3f} each, {zigzags:.2f} s", "", ""],
        ["closed loop in Python (synthetic.simulate, 0.1 s; ends at 540 deg)", f"{1e3 * loop:.0f}", "", ""],
    ]
    lines = [
        f"{SHIP}, rudder to {RUDDER:g} deg at {RATE:g} deg/s from {SPEED:g} m/s, {SECONDS:g} s in Runge-Kutta steps of "
        f"{STEP:g} s. Best of several runs on a machine that others use. Errors: largest position error over the run, "
        f"in ship lengths (one: against DOP853 at rtol 1e-12; scattered by {SPREAD:.0%}: 200 of them against steps of "
        f"{STEP / 15:g} s).",
        "",
        *table(["this package", "ms", "error / L", "limit"], rows),
        "",
    ]
    theirs, why = shipmmg(ship, plan, t)
    if why:
        lines.append(why)
    else:
        lines += [
            "shipmmg from PyPI with the same particulars, coefficients and inputs (an independent process in the same "
            "run; errors against its own model at rtol 1e-11):",
            "",
            *table(
                ["shipmmg, solve_ivp with", "ms", "calls", "error / L", "times one of ours", "times one of our batch"],
                [
                    [str(r["words"]), f"{1e3 * r['s']:.1f}", f"{r['calls']}", f"{r['error'] / L:.1e}",
                     f"{r['s'] / one:.0f}", f"{r['s'] / each:.0f}"]
                    for r in theirs
                ],
            ),
        ]  # fmt: skip
        for goal, words in ((GOAL, f"below {GOAL:g} L"), (error, "no larger than ours")):
            good = [r for r in theirs if r["error"] / L <= goal]
            if good:
                best = min(good, key=lambda r: r["s"])
                lines += [
                    "",
                    f"At an error {words} shipmmg takes {1e3 * best['s']:.1f} ms ({best['words']}): "
                    f"{best['s'] / one:.0f} times one of ours, {best['s'] / each:.0f} times one of our batch on 2 "
                    "threads (goals: 15 and 100).",
                ]
    record("Turning of KVLCC2", "python -m benchmarks.turning", lines)


if __name__ == "__main__":
    main()
