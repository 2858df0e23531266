"""Coefficients: what a ship file says about each of them, and the tables that the force models bring; particulars that
these use, in words and with their units."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from mmg.errors import refusing


@refusing
@dataclass(frozen=True)
class Coefficient:
    """One coefficient of a force model, with its prior before and its estimate after a calibration.

    symbol: MMG symbol in plain letters, such as ``Y_v``, ``w_P0``, ``ell_R``.
    value: the value the model uses.
    std: standard deviation: of the prior in a starting ship, of the estimate in a calibrated one.
    lower, upper: bounds that a fit respects.
    unit: SI unit, "" for a dimensionless number.
    prime: "mmg" when made dimensionless with 1/2 rho L d U^2 and so on, else "".
    fixed: a fit leaves it alone.
    source: where the value comes from.
    description: what it is, in words.
    verdict: a sentence on how well the data determine it, after a fit.
    prior_value, prior_std: the prior a calibrated value started from; None before a fit.
    monomial: of a term of a generated polynomial, what it multiplies (mmg/components/expansion/words.py).
    """

    symbol: str
    value: float
    std: float
    lower: float = -math.inf
    upper: float = math.inf
    unit: str = ""
    prime: str = ""
    fixed: bool = False
    source: str = ""
    description: str = ""
    verdict: str = ""
    prior_value: float | None = None
    prior_std: float | None = None
    monomial: str = ""

    def with_(self, **changes: Any) -> Coefficient:
        """A copy with some attributes changed."""
        return replace(self, **changes)


def names(mapping: dict[str, Any]) -> SimpleNamespace:
    """Attribute access to a mapping, so that a force reads ``c.Y_v`` and ``p.L``."""
    return SimpleNamespace(**mapping)


def table(source: str, *rows: tuple, fixed: bool = False) -> tuple[Coefficient, ...]:
    """Coefficient table of a force model.

    Each row is (symbol, default value, prior std, lower, upper, prime or unit, description). ``prime`` is
    "mmg" for a coefficient in the MMG system of Yasukawa & Yoshimura (2015), "" for another pure number.
    source: where the values come from; rows: as above; fixed: left alone by a fit.
    """

    def row(symbol: str, value: float, std: float, lower: float, upper: float, kind: str, words: str) -> Coefficient:
        unit, prime = ("", "mmg") if kind == "mmg" else (kind, "")
        return Coefficient(symbol, value, std, lower, upper, unit, prime, fixed, source, words)

    return tuple(row(*values) for values in rows)


# Particulars of a main engine.
ENGINE = (
    "n_MCR", "engine_delay", "restart", "astern_revolutions", "astern_torque", "engine_rise", "engine_inertia",
)  # fmt: skip

# Particulars of a ship file: words and unit.
PARTICULARS = {
    "L": ("length between perpendiculars", "m"),
    "B": ("breadth", "m"),
    "d": ("draught", "m"),
    "m": ("mass", "kg"),
    "x_G": ("centre of gravity, forward of midship", "m"),
    "C_b": ("block coefficient", "-"),
    "GM": ("metacentric height", "m"),
    "rho": ("water density", "kg/m³"),
    "U_0": ("service or test speed; an Abkowitz polynomial is expanded about it", "m/s"),
    "scale": ("length of the ship that a model stands for, by that of the model", "-"),
    "rudder_rate": ("greatest rate of the steering gear", "rad/s"),
    "rudder_delay": ("from an order of the helm until the rudder moves", "s"),
    "propeller_rate": ("greatest rate of the revolutions", "1/s^2"),
    "approach_speed": ("with which the manoeuvres of the trials begin", "m/s"),
    "neutral_rudder": ("rudder angle of a straight course in the trials", "rad"),
    "n_MCR": ("revolutions of the engine at maximum continuous rating", "1/s"),
    "engine_delay": ("from an order astern until the fuel is cut", "s"),
    "restart": ("revolutions at which the engine can be reversed, by n_MCR", "-"),
    "astern_revolutions": ("most revolutions astern, by n_MCR", "-"),
    "astern_torque": ("most torque of the engine astern, by that at maximum continuous rating", "-"),
    "engine_rise": ("time in which the revolutions rise by n_MCR", "s"),
    "engine_inertia": ("2 pi I n_MCR / Q_MCR of shaft line and propeller", "s"),
    "stopping_resistance": (
        "resistance in a stopping test by that of the coefficients, where these are a model's",
        "-",
    ),
    "y_P": ("propellers of a twin-screw ship, from the centre plane", "m"),
    "pitch": ("blade angle ahead of a controllable-pitch propeller", "rad"),
    "D_P": ("propeller diameter", "m"),
    "pitch_ratio": ("propeller pitch / diameter", "-"),
    "A_R": ("rudder area", "m²"),
    "aspect_ratio": ("rudder aspect ratio", "-"),
    "x_R": ("rudder, forward of midship", "m"),
    "D_BT": ("bow thruster diameter", "m"),
    "x_BT": ("bow thruster, forward of midship", "m"),
    "D_ST": ("stern thruster diameter", "m"),
    "x_ST": ("stern thruster, forward of midship", "m"),
    "D_az": ("azimuth thruster diameter", "m"),
    "x_az": ("azimuth thruster, forward of midship", "m"),
    "y_az": ("azimuth thruster, to starboard of the centre plane", "m"),
    **{
        f"{axis}_az_{i}": (f"azimuth thruster {i}, {side}", "m")
        for i in range(2, 5)
        for axis, side in (("x", "forward of midship"), ("y", "to starboard of the centre plane"))
    },
    "delta_stall": ("nominal stall angle of the rudders, where sub-models of a generated polynomial change", "rad"),
    "u_ahead": ("greatest speed ahead of the trials behind a generated polynomial", "m/s"),
    "u_astern": ("greatest speed astern of the trials behind a generated polynomial", "m/s"),
    "v_most": ("greatest lateral speed of the trials behind a generated polynomial", "m/s"),
    "r_most": ("greatest yaw rate of the trials behind a generated polynomial", "rad/s"),
    "A_T": ("frontal projected area above water", "m²"),
    "A_L": ("lateral projected area above water", "m²"),
    "A_OD": ("lateral area of superstructures on deck", "m²"),
    "C": ("centre of A_L, forward of midship", "m"),
    "C_BR": ("centre of superstructure, forward of midship", "m"),
    "H_BR": ("height of superstructure top above water", "m"),
    "H_C": ("height of the centre of A_L above water", "m"),
    "L_OA": ("length over all", "m"),
    "A_SS": ("lateral area of the superstructure", "m²"),
    "S_A": ("perimeter of the lateral projection above water, without waterline, masts and ventilators", "m"),
    "rho_a": ("air density", "kg/m³"),
}
