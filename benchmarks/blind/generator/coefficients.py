"""The ship file's numbers and the true coefficients of a case."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.blind.generator.world import ESSO, MODEL, World
from benchmarks.toml import tables

SHIPS = Path(__file__).parents[3] / "cases" / "ships"
DRAWN = ESSO
SPREAD = 0.05
LENGTHS = {"L": 1, "B": 1, "d": 1, "x_G": 1, "D_P": 1, "x_R": 1, "A_R": 2, "m": 3}
"""Particulars that the plant uses, and the power of the scale that each goes with."""


def scaled_ship(world: World) -> tuple[dict[str, float], dict[str, float]]:
    """Particulars of the ``world``'s ship at the length that is integrated (SI), and its nominal coefficients."""
    particulars, coefficients = ship_numbers(world.ship)
    ratio = MODEL / particulars["L"]
    if ratio != 1:
        particulars = {k: v * ratio ** LENGTHS.get(k, 0) for k, v in particulars.items()}
    return particulars, coefficients


def ship_numbers(name: str = "esso_osaka_3m") -> tuple[dict[str, float], dict[str, float]]:
    """Particulars (SI) and nominal coefficients of a ship file."""
    data = tables(SHIPS / f"{name}.toml")
    particulars = {key: float(value) for key, value in data["ship"].items() if not isinstance(value, str)}
    return particulars, {name: float(entry["value"]) for name, entry in data["coefficients"].items()}


def true_coefficients(
    nominal: dict[str, float], rng: np.random.Generator, drawn: Sequence[str] = DRAWN, spread: float = SPREAD
) -> dict[str, float]:
    """Nominal values, those ``drawn`` times N(1, spread) each (cut at three standard deviations)."""
    factors = np.clip(1 + spread * rng.standard_normal(len(drawn)), 1 - 3 * spread, 1 + 3 * spread)
    return {**nominal, **{name: nominal[name] * float(f) for name, f in zip(drawn, factors, strict=True)}}
