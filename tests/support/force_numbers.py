"""Numbers out of force models, for the tests of single models: exact or smooth."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from cases.shipfiles.ship_file import load_ship
from mmg.components.catalogue import module
from mmg.components.coefficients import names
from mmg.motion.flow import Force
from mmg.motion.smooth import Smooth, Smoothing


def particulars_and_coefficients(name: str, **changes: float) -> tuple[SimpleNamespace, SimpleNamespace]:
    """p and c of a library ship, some values replaced."""
    ship = load_ship(name)
    values = {symbol: c.value for symbol, c in ship.coefficients.items()}
    return names(dict(ship.particulars)), names({**values, **changes})


def defaults(role: str, name: str, p: SimpleNamespace) -> dict[str, float]:
    """Default coefficients of a force model."""
    model = module(role, name)
    rows = model.coefficients(p) if hasattr(model, "coefficients") else model.COEFFICIENTS
    return {row.symbol: row.value for row in rows}


def xyn(force: Force) -> np.ndarray:
    """X, Y, N as numbers (3,)."""
    return np.array([float(ca.DM(part)) for part in (force.X, force.Y, force.N)])


def number(value: object) -> float:
    return float(ca.DM(value))


def table_values(*tables: tuple) -> SimpleNamespace:
    """Coefficients of these tables by attribute, all at their default."""
    rows = [row for table in tables for row in table]
    assert len({row.symbol for row in rows}) == len(rows)
    return names({row.symbol: row.value for row in rows})


def smooth(p: SimpleNamespace) -> Smoothing:
    """The smoothing that users run for a ship of this length."""
    return Smooth.for_length(p.L)
