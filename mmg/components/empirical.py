"""Coefficients from particulars: regressions of the literature, as starting values of a fit.

Each is a pure function of numbers that returns symbol -> value. k = 2 d/L, c = C_b B/L throughout. Expect 20..40 % of
error in the nonlinear terms. Primes are those of MMG (by 1/2 rho L d U^2, 1/2 rho L^2 d, ...) unless stated.
"""

from __future__ import annotations

import math


def kijima_1990(L: float, B: float, d: float, C_b: float, m_x: float = 0.0) -> dict[str, float]:
    """Linear derivatives of Kijima et al. (1990), JSNAJ 168:141, even keel, MMG primes.

    Y_r is pure: Y_r - (m' + m_x') = -1.5 c and m' = 2 c give Y_r = m_x' + 0.5 c (``m_x`` in MMG primes). Two public
    codes agree on the numbers. L, B, d [m]: length, breadth, draught; C_b: block coefficient [-].
    """
    k, c = 2 * d / L, C_b * B / L
    # printed by the drift angle beta = -v': Y_v = -Y_beta, N_v = -N_beta
    return {"Y_v": -(0.5 * math.pi * k + 1.4 * c), "Y_r": m_x + 0.5 * c, "N_v": -k, "N_r": -0.54 * k + k * k}


def inoue_1981(L: float, B: float, d: float, C_b: float) -> dict[str, float]:
    """Linear derivatives on even keel, Inoue et al. (1981), ISP 28:112: those of Kijima but for Y_r, the pure one.

    UNVERIFIED (from recollection). L, B, d [m]: length, breadth, draught; C_b: block coefficient [-].
    """
    return {**kijima_1990(L, B, d, C_b), "Y_r": 0.25 * math.pi * (2 * d / L)}


def yoshimura_masumoto_2012(
    L: float, B: float, d: float, C_b: float, m_x: float, m_y: float, x_G: float = 0.0
) -> dict[str, float]:
    """Hull polynomial and rudder interaction, Yoshimura & Masumoto (2012), MARSIM; for the polynomial hull.

    m_x, m_y in MMG primes, x_G [m]. Medium-speed merchant and fishing vessels. Hull: two public codes agree. Rudder:
    single source; a_H = 0.627 C_b - 0.153 after Quadvlieg (2013), single source.
    L, B, d [m]: length, breadth, draught; C_b: block coefficient [-].
    """
    c, slender = C_b * B / L, L / B
    return {
        **kijima_1990(L, B, d, C_b, m_x),
        "X_vv": 1.15 * c - 0.18,
        "X_vr": m_y - 1.91 * c + 0.08,
        "X_rr": -0.085 * c + 0.008 - x_G / L * m_y,
        "X_vvvv": -6.68 * c + 1.1,
        "Y_vvv": -0.185 * slender + 0.48,
        "Y_vvr": -0.75,
        "Y_vrr": -(0.26 * (1 - C_b) * slender + 0.11),
        "Y_rrr": -0.051,
        "N_vvv": -(0.66 - 0.69 * C_b),
        "N_vvr": 1.55 * c - 0.76,
        "N_vrr": -0.075 * (1 - C_b) * slender - 0.098,
        "N_rrr": 0.25 * c - 0.056,
        "t_R": 0.39,
        "ell_R": -0.9,
        "gamma_R": 2.06 * c + 0.14,
        "a_H": 0.627 * C_b - 0.153,
    }


def clarke_1983(L: float, B: float, d: float, C_b: float) -> dict[str, float]:
    """Linear derivatives of Clarke et al. (1983) in MMG primes, i.e. those of 1/2 rho L^2 U^2 times L/d.

    With S = pi (d/L)^2 the printed ones are S times the brackets. Y_vdot and N_rdot are added masses with the sign
    of a derivative: m_y = -Y_vdot, J_z = -N_rdot. Two public texts agree.
    L, B, d [m]: length, breadth, draught; C_b: block coefficient [-].
    """
    unit = math.pi * d / L  # S L/d: from the system with L in place of d to that of MMG
    wide, high = B / L, B / d
    return {
        "Y_vdot": -unit * (1 + 0.16 * C_b * high - 5.1 * wide**2),
        "N_rdot": -unit * (1 / 12 + 0.017 * C_b * high - 0.33 * wide),
        "Y_v": -unit * (1 + 0.40 * C_b * high),
        "Y_r": -unit * (-0.5 + 2.2 * wide - 0.08 * high),
        "N_v": -unit * (0.5 + 2.4 * d / L),
        "N_r": -unit * (0.25 + 0.039 * high - 0.56 * wide),
    }


def norrbin_1971(L: float, B: float, d: float, C_b: float) -> dict[str, float]:
    """Linear derivatives of Norrbin (1971) in MMG primes, from pi (d/L)^2 times brackets as Clarke's.

    UNVERIFIED: as compared with others by Clarke et al. (1983), from recollection. Y_r is the pure one.
    L, B, d [m]: length, breadth, draught; C_b: block coefficient [-].
    """
    unit, full = math.pi * d / L, C_b * B / (math.pi * d)
    return {
        "Y_v": -unit * (1.69 + 0.08 * full),
        "Y_r": -unit * (-0.645 + 0.38 * full),
        "N_v": -unit * (0.64 - 0.04 * full),
        "N_r": -unit * (0.47 - 0.18 * full),
    }


def wagner_smitt_1971(L: float, d: float) -> dict[str, float]:
    """Linear derivatives of Wagner Smitt (1971) in MMG primes, from pi (d/L)^2 times numbers.

    UNVERIFIED: as compared with others by Clarke et al. (1983), from recollection. Y_r is the pure one. L, d [m]:
    length, draught.
    """
    unit = math.pi * d / L
    return {"Y_v": -1.59 * unit, "Y_r": 0.32 * unit, "N_v": -0.62 * unit, "N_r": -0.21 * unit}


def lee_1998(L: float, B: float, d: float, C_b: float, m_x: float = 0.0) -> dict[str, float]:
    """Linear derivatives of Lee, Shin et al. (1998), "ship's manoeuvring performance in the initial design stage".

    In MMG primes, as quoted in the review of MANSIM (Sukas et al. 2019, Ocean Engineering 192:106239) and coded in one
    public port: UNVERIFIED. The Y_r of the print is Y_r - (m' + m_x'), with m' = 2 C_b B/L; here it is the pure one.
    L, B, d [m]: length, breadth, draught; C_b: block coefficient [-]; m_x: added mass in MMG primes.
    """
    high, long = C_b * B / d, L / d
    return {
        "Y_v": -0.4545 + 0.065 * high,
        "Y_r": -0.115 * high + 0.0024 * long + 2 * C_b * B / L + m_x,  # the last two: m' + m_x'
        "N_v": -0.23 + 0.0059 * long,
        "N_r": -0.003724 * long + 0.10446 - 1.393 / long,
    }


def linear_derivatives(L: float, B: float, d: float, C_b: float, m_x: float = 0.0) -> dict[str, dict[str, float]]:
    """Y_v, Y_r, N_v, N_r in MMG primes by the regressions of the literature, by name of the regression.

    Yoshimura & Masumoto (2012) have those of Kijima et al. (1990). m_x: added mass in MMG primes.
    L, B, d [m]: length, breadth, draught; C_b: block coefficient [-].
    """
    derivatives = {
        "Kijima (1990)": kijima_1990(L, B, d, C_b, m_x),
        "Inoue (1981)": inoue_1981(L, B, d, C_b),
        "Clarke (1983)": clarke_1983(L, B, d, C_b),
        "Norrbin (1971)": norrbin_1971(L, B, d, C_b),
        "Wagner Smitt (1971)": wagner_smitt_1971(L, d),
        "Lee (1998)": lee_1998(L, B, d, C_b, m_x),
    }
    return {name: {s: values[s] for s in ("Y_v", "Y_r", "N_v", "N_r")} for name, values in derivatives.items()}


def motora_added_mass(L: float, B: float, d: float, C_b: float) -> dict[str, float]:
    """Added masses in MMG primes: regression of Motora's charts by Zhou et al. (1983).

    m_x/m, m_y/m and k_J/L of the regression, with m' = 2 c (displacement L B d C_b); J_z = m k_J^2. m_y and J_z agree
    in two public codes; the line of m_x is UNVERIFIED but gives 0.0231 for KVLCC2 (published 0.022).
    """
    s, b, D = L / B, d / B, d * L / B**2
    m = 2 * C_b * B / L  # m' of the displacement L B d C_b, by 1/2 rho L^2 d
    surge = 0.01 * (
        0.398
        + 11.97 * C_b * (1 + 3.73 * b)
        - 2.89 * C_b * s * (1 + 1.13 * b)
        + 0.175 * C_b * s**2 * (1 + 0.541 * b)
        - 1.107 * s * b
    )
    sway = (
        0.882
        - 0.54 * C_b * (1 - 1.6 * b)
        - 0.156 * s * (1 - 0.673 * C_b)
        + 0.826 * D * (1 - 0.678 * b)
        - 0.638 * C_b * D * (1 - 0.669 * b)
    )
    arm = 0.01 * (33 - 76.85 * C_b * (1 - 0.784 * C_b) + 3.43 * s * (1 - 0.63 * C_b))
    return {"m_x": m * surge, "m_y": m * sway, "J_z": m * arm**2}


def yoshimura_2009_low_speed(L: float, B: float, d: float) -> dict[str, float]:
    """Cross-flow coefficients of the unified low-speed hull (Yoshimura, Nakao & Ishibashi 2009, MARSIM).

    C_D = 1.848 - 0.0591 L/d, C_rY = 0.52 L/B - 1.062, C_rN = 0.0742 L/d - 0.297: tanker-like ratios only (L/d = 25
    gives C_D = 0.37). They reproduce C_D, C_rN of ESSO OSAKA and C_rY, C_rN of a second ship to all digits.
    """
    return {"C_D": 1.848 - 0.0591 * L / d, "C_rY": 0.52 * L / B - 1.062, "C_rN": 0.0742 * L / d - 0.297}
