"""The ship file's numbers and the true coefficients of a case."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

SHIP_FILE = Path(__file__).parents[3] / "cases" / "ships" / "esso_osaka_3m.toml"

DRAWN = (
    "X_0F", "X_0A", "X_vr", "Y_v", "Y_r", "N_v", "N_r", "C_D", "C_rY", "C_rN",
    "k_0", "t_P", "w_P0", "tau",
    "t_R", "a_H", "ell_R", "k_x", "epsilon", "gamma_P", "gamma_N",
)  # fmt: skip
"""Coefficients of hull, propeller and rudder whose truth differs from the ship file."""

SPREAD = 0.05
"""Standard deviation of the ratio of true to nominal coefficient."""


def ship_numbers() -> tuple[dict[str, float], dict[str, float]]:
    """Particulars (SI) and nominal coefficients of the ship file."""
    with SHIP_FILE.open("rb") as file:
        data = tomllib.load(file)
    particulars = {key: float(value) for key, value in data["ship"].items() if not isinstance(value, str)}
    return particulars, {name: float(entry["value"]) for name, entry in data["coefficients"].items()}


def true_coefficients(nominal: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Nominal values, those of DRAWN times N(1, SPREAD) each (cut at three standard deviations)."""
    factors = np.clip(1 + SPREAD * rng.standard_normal(len(DRAWN)), 1 - 3 * SPREAD, 1 + 3 * SPREAD)
    return {**nominal, **{name: nominal[name] * float(f) for name, f in zip(DRAWN, factors, strict=True)}}
