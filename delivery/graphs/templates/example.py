"""Simulates the exported ship, rudder to 20 deg starboard after ten of 120 steps: python example.py

Needs casadi and numpy, nothing else. Units are SI and radians; model.json names every row.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import casadi as ca
import numpy as np

FOLDER = Path(__file__).parent


def main() -> None:
    about = json.loads((FOLDER / "model.json").read_text(encoding="utf-8"))
    functions = {name: ca.Function.load(str(FOLDER / f"{name}.casadi")) for name in about["functions"]}
    names = [row["name"] for row in about["controls"]]
    speed = about["service_speed_m_s"] or 0.07 * math.sqrt(9.81 * about["length_m"])
    controls = positions(about, steady_revolutions(FOLDER, speed))
    state = functions["initial"]([0, 0, 0, speed, 0, 0], controls)
    h = about["longest_step_s"]
    for k in range(121):
        for name in about["rudders"]:
            controls[names.index(name)] = math.radians(20.0) if k >= 10 else 0.0
        if k % 10 == 0:
            x, y, psi, u = np.array(functions["columns"](state)).ravel()[:4]
            place = f"t {k * h:6.1f} s  x {x:8.2f} m  y {y:8.2f} m"
            print(f"{place}  heading {math.degrees(psi):7.2f} deg  u {u:6.3f} m/s")
        state = functions["step"](state, controls, h)


def positions(about: dict, n: float) -> np.ndarray:
    """The controls (C,) with all propellers at ``n`` [1/s], rudders midships. about: content of model.json."""
    controls = np.array(about["straight_ahead"], dtype=float)
    controls[[row["name"] in about["propellers"] for row in about["controls"]]] = n
    return controls


def steady_revolutions(folder: Path, speed: float) -> float:
    """Revolutions [1/s] that hold ``speed`` [m/s] straight ahead in calm air. folder: with the functions."""
    about = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    rates = ca.Function.load(str(folder / "rates.casadi"))
    low, high = 0.0, 1000.0
    state = np.zeros(len(about["states"]))
    state[3] = speed
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(rates(state, positions(about, middle))[3]) < 0 else (low, middle)
    return high


if __name__ == "__main__":
    main()
