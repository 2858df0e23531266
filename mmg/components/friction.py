"""Friction of a hull at the Reynolds number of its size: the line of ITTC 1957, form, wetted surface, allowances.

Coefficients are made dimensionless with 1/2 rho S U^2. Sources: ITTC Recommended Procedure 7.5-02-03-01.4 (1978 ITTC
performance prediction method: friction line, roughness, correlation), 7.5-02-01-03 (viscosity at 15 degrees C); form
factor of Watanabe and wetted surface of Mumford as quoted in textbooks. The allowances are written from memory of the
procedure, whose text was not at hand: UNVERIFIED; together they come to 0.0002 to 0.0003 for a tanker, as is usual.
"""

from __future__ import annotations

import math

# Kinematic viscosity [m^2/s] of fresh and of sea water at 15 degrees C (ITTC 7.5-02-01-03: 1.139e-6, 1.188e-6).
FRESH, SALT = 1.14e-6, 1.19e-6
ROUGHNESS = 150e-6  # Roughness [m] of a newly painted hull (ITTC 7.5-02-03-01.4)
MODEL = 20.0  # Length [m] below which a ship is a model: smooth, and without allowances. Set by hand.


def viscosity(density: float) -> float:
    """Kinematic viscosity [m^2/s] at 15 degrees C of water of this ``density`` [kg/m^3]: fresh below 1010."""
    return FRESH if density < 1010 else SALT  # between fresh water of 999 kg/m^3 and sea water of 1026


def friction_line(reynolds: float) -> float:
    """C_F [-] = 0.075 / (log10 Re - 2)^2 (ITTC 1957). reynolds: U L / nu [-], above 1000."""
    return 0.075 / (math.log10(max(reynolds, 1e3)) - 2) ** 2  # the line has a pole at Re = 100


def form_factor(L: float, B: float, d: float, C_b: float) -> float:
    """k [-] = -0.095 + 25.6 C_b / ((L/B)^2 sqrt(B/d)) (Watanabe), at least 0.05. L, B, d: length, breadth, draught
    [m]; C_b: block coefficient [-]."""
    return max(-0.095 + 25.6 * C_b / ((L / B) ** 2 * math.sqrt(B / d)), 0.05)


def wetted_surface(L: float, B: float, d: float, C_b: float) -> float:
    """S [m^2] = 1.7 L d + L B C_b (Mumford). L, B, d: length, breadth, draught [m]; C_b: block coefficient [-]."""
    return 1.7 * L * d + L * B * C_b


def allowance(length: float, reynolds: float, roughness: float = ROUGHNESS) -> float:
    """Roughness and correlation allowances together [-], 0 for a model (``length`` below 20 m).

    dC_F = 0.044 [(k_s / L)^(1/3) - 10 Re^(-1/3)] + 0.000125 and C_A = (5.68 - 0.6 log10 Re) 10^-3, neither below 0
    (ITTC 7.5-02-03-01.4). reynolds: U L / nu [-]; roughness: k_s [m].
    """
    if length < MODEL:
        return 0.0
    rough = 0.044 * ((roughness / length) ** (1 / 3) - 10 * reynolds ** (-1 / 3)) + 0.000125
    return max(rough, 0.0) + max((5.68 - 0.6 * math.log10(reynolds)) * 1e-3, 0.0)
