"""Coefficients of a starting ship: several regressions mixed, corrected and widened by ships of the literature.

The linear derivatives are means of six regressions. Common factors (CORRECTIONS) bring turning circles and zigzags of
the ships in benchmarks/literature to the published ones as far as one set for all ships can; they are determined by
``benchmarks.own_ships`` of 5f878e7, which also leaves out each ship in turn. The standard deviations are as wide as the
errors of the ships left out demand.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mmg.components import empirical, friction
from mmg.components.propeller.b_series import thrust_parabola
from mmg.ship import Ship

STARTING = "starting ship from main particulars"
"""Description of a starting ship."""

Estimate = tuple[float, float, str]
"""Value, standard deviation as a share of it, source."""

LINEAR = ("Y_v", "Y_r", "N_v", "N_r")

CORRECTIONS = {
    "unified": {"N_v": 1.6, "C_rN": 1.55, "gamma_R": 0.9, "epsilon": 0.93, "kappa": 0.93},
    "polynomial": {"N_v": 1.4, "N_r": 1.5, "Y_vrr": 2.1, "gamma_R": 1.05, "epsilon": 0.83},
}
"""Hull -> factor on a coefficient, the same for all ships, from ships of the literature."""

WIDENING = {"unified": 0.65, "polynomial": 1.0}
"""Hull -> factor on the standard deviations of the literature and of experience. With those of the unified hull, 90 %
intervals hold nine in ten figures of ships left out; the polynomial's are wider, so that captive tests lie within."""

FULL = 0.7
"""Block coefficient from which a ship counts as full."""
ERRORS = {
    ("unified", True): (26, 39, 4),
    ("unified", False): (25, 39, 2),
    ("polynomial", True): (25, 42, 4),
    ("polynomial", False): (33, 42, 2),
}
"""Hull, full or fine -> root mean square errors of lengths and of overshoots [%] of ships left out, how many ships."""


def resistance(p: Mapping[str, float]) -> float:
    """R_0' [-] for particulars ``p`` [SI]: viscous resistance at the service speed by 1/2 rho L d U^2.

    ITTC-57 friction on the wetted surface of Mumford, S = 1.7 L d + vol/d, with Watanabe's form factor
    k = -0.095 + 25.6 C_b / ((L/B)^2 sqrt(B/d)) and 0.0004 for roughness and waves; 24 % low for the KVLCC2 model.
    """
    L, B, d, C_b = (p[name] for name in ("L", "B", "d", "C_b"))
    C_F = friction.friction_line(p["U_0"] * L / friction.viscosity(p["rho"]))
    surface = friction.wetted_surface(L, B, d, C_b) / (L * d)
    return surface * (C_F * (1 + friction.form_factor(L, B, d, C_b)) + 4e-4)


def is_starting_ship(ship: Ship) -> bool:
    """Whether ``ship`` is as ``mmg ships --new`` made it: its standard deviations are priors."""
    return ship.description == STARTING and all(c.prior_value is None for c in ship.coefficients.values())


def trust(p: Mapping[str, float], hull: str) -> str:
    """How far a starting ship can be trusted, in a sentence. p: particulars [SI]; hull: of HULLS."""
    full = p["C_b"] >= FULL
    lengths, angles, count = ERRORS[hull, full]
    kind = f"full ships (C_b of {FULL:g} and more)" if full else f"fine ships (C_b below {FULL:g})"
    words = (
        f"a starting ship: of {count} {kind} of the literature, each left out in turn, advance and tactical diameter "
        f"were missed by {lengths} %, overshoots by {angles} % (root mean square). Its standard deviations are as "
        "wide: mmg imo shows the intervals"
    )
    if "y_P" in p or p.get("A_R") == 0.0:
        words += "; none of them had two screws or no rudder"
    return words


def spread(p: Mapping[str, float], m_x: float) -> dict[str, float]:
    """Standard deviation of the regressions of the literature about their mean, as a share of it, by symbol.

    Linear derivatives of the six regressions; added masses: deviation of Clarke's from Motora's charts. p: particulars
    [SI]; m_x: added mass in MMG primes.
    """
    L, B, d, C_b = (p[name] for name in ("L", "B", "d", "C_b"))
    found = empirical.linear_derivatives(L, B, d, C_b, m_x).values()
    rows = {s: np.array([each[s] for each in found]) for s in LINEAR}
    shares = {s: float(values.std() / abs(values.mean())) for s, values in rows.items()}
    mass, clarke = empirical.motora_added_mass(L, B, d, C_b), empirical.clarke_1983(L, B, d, C_b)
    shares["m_y"] = abs(-clarke["Y_vdot"] / mass["m_y"] - 1)
    return shares | {"J_z": abs(-clarke["N_rdot"] / mass["J_z"] - 1)}


def estimates(p: Mapping[str, float], hull: str) -> dict[str, Estimate]:
    """Symbol -> value, standard deviation as a share of it, source. p: all particulars [SI]; hull: of HULLS."""
    L, B, d, C_b = (p[name] for name in ("L", "B", "d", "C_b"))
    mass = empirical.motora_added_mass(L, B, d, C_b)
    regression = empirical.yoshimura_masumoto_2012(L, B, d, C_b, mass["m_x"], mass["m_y"], p["x_G"])
    scatter = spread(p, mass["m_x"])
    mixed = empirical.linear_derivatives(L, B, d, C_b, mass["m_x"])
    radius = 0.25**2 * p["m"] / (0.5 * p["rho"] * L**2 * d)
    R_0 = resistance(p)
    k_0, k_1, k_2 = thrust_parabola(p["pitch_ratio"])
    wake = 0.5 * C_b - 0.05 if "y_P" not in p else max(0.55 * C_b - 0.20, 0.05)
    gyration = "radius of gyration 0.25 L, J_z from Motora's charts"
    motora = "Motora's charts, regression of Zhou et al. (1983)"
    b_series = "Wageningen B-series (4 blades, area ratio 0.6)"
    source, friction = "Yoshimura & Masumoto (2012) on L, B, d, C_b", "ITTC-57 friction with a form factor"
    mean = {s: float(np.mean([each[s] for each in mixed.values()])) for s in LINEAR}
    six = f"mean of {len(mixed)} regressions: {', '.join(mixed)}"
    linear = {s: (mean[s], max(0.25, scatter[s]), six) for s in LINEAR}
    found: dict[str, Estimate] = {
        "m_x": (mass["m_x"], 0.3, motora),
        "m_y": (mass["m_y"], max(0.15, scatter["m_y"]), motora),
        "I_J_z": (radius + mass["J_z"], max(0.15, 0.3 * scatter["J_z"]), gyration),
        "k_0": (k_0, 0.1, b_series),
        "k_1": (k_1, 0.15, b_series),
        "k_2": (k_2, 0.3, b_series),
        "w_P0": (wake, 0.25, "0.5 C_b - 0.05, twin screw 0.55 C_b - 0.20"),
        "t_R": (regression["t_R"], 0.3, source),
        "ell_R": (regression["ell_R"], 0.2, source),
        "gamma_R_plus": (regression["gamma_R"], 0.3, source),
        "gamma_R_minus": (regression["gamma_R"], 0.3, source),
        "epsilon": (1.09, 0.23, "default of the standard rudder model"),
        "kappa": (0.50, 0.24, "default of the standard rudder model"),
        "a_H": (max(regression["a_H"], 0.05), 0.4, "Quadvlieg (2013): 0.627 C_b - 0.153"),
    }
    if hull == "polynomial":
        derivatives = {s: (value, 0.5, source) for s, value in regression.items() if s[0] in "XYN" and "_" in s}
        return _corrected(found | {"R_0": (R_0, 0.3, friction)} | derivatives | linear, hull, scatter)
    low = empirical.yoshimura_2009_low_speed(L, B, d)
    whole = found | {
        "X_0F": (-R_0, 0.3, friction),
        "X_0A": (-1.3 * R_0, 0.4, "1.3 times the resistance ahead"),
        **linear,
        "C_D": (min(max(low["C_D"], 0.4), 1.2), 0.3, "Yoshimura et al. (2009) on L/d, within 0.4 to 1.2"),
        "C_rY": (min(max(low["C_rY"], 0.8), 2.4), 0.3, "Yoshimura et al. (2009) on L/B, within 0.8 to 2.4"),
        "C_rN": (min(max(low["C_rN"], 0.4), 1.5), 0.3, "Yoshimura et al. (2009) on L/d, within 0.4 to 1.5"),
    }
    return _corrected(whole, hull, scatter)


def _corrected(rows: Mapping[str, Estimate], hull: str, scatter: Mapping[str, float]) -> dict[str, Estimate]:
    """``rows`` with the factors of CORRECTIONS and shares times WIDENING, linear ones no less than their scatter."""
    found = {}
    for symbol, (value, share, source) in rows.items():
        factor = CORRECTIONS[hull].get(symbol.removesuffix("_plus").removesuffix("_minus"), 1.0)
        words = f"{source}; times {factor:g} by ships of the literature (benchmarks/own_ships.py of 5f878e7)"
        least = scatter[symbol] if symbol in LINEAR else 0.0
        found[symbol] = (factor * value, max(WIDENING[hull] * share, least), source if factor == 1.0 else words)
    return found
