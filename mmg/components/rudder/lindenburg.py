"""Rudder that stalls: inflow of the standard model, normal force of Lindenburg (2000).

C_N = 1.98 k_N [1/(0.56 + 0.44 |sin alpha|) - 0.41 (1 - exp(-17/Lambda))] sin alpha,  F_N = 1/2 rho A_R U_R^2 C_N,
as in one public simulator (single lineage). C_N rises up to 90 degrees of incidence (1.17), but bends early: for
Lambda = 2.2 it is 28 % below the sine law of equal slope at 20 degrees and 41 % at 35. The tangential force of that
simulator is left out. k_N (1 as published) scales the force for identification.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import table
from mmg.components.rudder import inflow as shared
from mmg.components.rudder import standard
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = standard.PARTICULARS
INPUTS = standard.INPUTS

COEFFICIENTS = table("default of the standard rudder model", *standard.INFLOW) + table(
    "Lindenburg (2000)", ("k_N", 1.0, 0.15, 0.3, 2.0, "", "factor on the normal force of Lindenburg")
)


def normal_force(sine: Any, modulus: Any, aspect_ratio: float) -> Any:
    """C_N [-] from sin(alpha) and its modulus. sine: sin(alpha); aspect_ratio: Lambda [-]."""
    return 1.98 * (1 / (0.56 + 0.44 * modulus) - 0.41 * (1 - math.exp(-17 / aspect_ratio))) * sine


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Rudder force including its effect on the hull [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    u_R, v_R = standard.inflow(flow, p, c, s)
    U_R, cross = shared.resultant(u_R, v_R, s), shared.across(u_R, v_R, flow.delta)
    modulus = s.divide(s.absolute(cross, 0.1 * s.speed), U_R, 0.0)
    # C_N is linear in the sine: U_R^2 C_N(sin alpha) = U_R C_N(U_R sin alpha), with the modulus of the sine itself
    F_N = 0.5 * p.rho * p.A_R * U_R * c.k_N * normal_force(cross, modulus, p.aspect_ratio)
    return shared.on_the_ship(F_N, s.divide(cross**2, U_R**2, 0.0), flow.delta, p, c)
