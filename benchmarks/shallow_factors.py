"""Shallow water: published factors f on coefficients, D(h) = f D(deep), beside the growth of the effect shallow_water.

Run from the repository root: python -m benchmarks.shallow_factors

h is the depth of water [m], x = d/h. UNVERIFIED as a whole: one public source each, partly from recollection, that of
Kijima & Nakiri from a code whose own text says it does not work. Compare with tests before use; ``growth`` has two
numbers to identify instead. All functions raise ValueError for a ship aground (h <= d).
"""

from __future__ import annotations

from benchmarks.literature import tanker
from mmg.effects.shallow_water import GROWTH


def _ratio(d: float, h: float) -> float:
    if not h > d:
        raise ValueError(f"depth {h:g} m must be larger than the draught {d:g} m")
    return d / h


def growth(d: float, h: float, alpha: float, power: float) -> float:
    """1 + alpha (d/(h - d))^power: for added masses and cross-flow drag, alpha and power to be identified.

    Own robust form (UNVERIFIED): 1 in deep water, rising without bound towards the ground.
    """
    _ratio(d, h)
    return float(1 + alpha * (d / (h - d)) ** power)


def kijima_nakiri_1990(L: float, B: float, d: float, C_b: float, h: float) -> dict[str, float]:
    """Factors on the hull derivatives of ``empirical.kijima_1990``; h/d >= 1.2. UNVERIFIED.

    f1 = 1/(1 - x)^n - x for Y_beta (n = 0.40 C_b B/d), N_beta (0.425 C_b B/d, from recollection), N_r (1.5 - 14.28
    d/L); f2 = 1 + a_1 x + a_2 x^2 + a_3 x^3 for the rest (Kijima & Nakiri 1990 as in a public code after Taimuri et
    al. 2020). The cubics do not tend to 1 monotonically: a factor far from 1 in deep water is the polynomial's doing.
    """
    x = _ratio(d, h)
    b, beam, fine = C_b * B / d, C_b * d / B, 1 - C_b
    t = fine * d / B

    def f1(n: float) -> float:
        return float(1 / (1 - x) ** n - x)

    def f2(a_1: float, a_2: float, a_3: float) -> float:
        return 1 + a_1 * x + a_2 * x**2 + a_3 * x**3

    return {
        "Y_beta": f1(0.40 * b),
        "N_beta": f1(0.425 * b),
        "N_r": f1(1.5 - 14.28 * d / L),
        "Y_r": f2(-5.5 * b**2 + 26 * b - 31.5, 37 * b**2 - 185 * b + 230, -38 * b**2 + 197 * b - 250),
        "Y_rr": f2(-15600 * fine**5, 116000 * fine**5, -128000 * fine**5),
        "Y_brr": f2(21500 * t**2 - 4800 * t + 220, -40800 * t**2 + 7500 * t - 274, -90800 * t**2 + 25500 * t - 1400),
        "N_bb": f2(-240 * fine + 57, 1770 * fine - 413, -1980 * fine + 467),
        "N_rr": f2(-1960 * t**2 + 448 * t - 25, 12220 * t**2 - 2720 * t + 146, -12160 * t**2 + 2650 * t - 137),
        "N_bbr": f2(91 * beam - 25, -515 * beam + 144, 508 * beam - 143),
        "N_brr": f2(40 * b - 88, -295 * b + 645, 312 * b - 678),
    }


def ankudinov(L: float, B: float, d: float, C_b: float, h: float) -> dict[str, float]:
    """Factors of the type of Ankudinov (1990): f_nr, f_yr, f_nv, f_yv, g_nr, g_v. UNVERIFIED, single source.

    H = h/d - 1, K_0 = 1 + 0.0775/H^2 - 0.011/H^3 + 0.000068/H^5, K_1 = -0.0643/H + 0.0724/H^2 - 0.0113/H^3 +
    0.0000767/H^5, K_2 = 0.0342/H (B/d <= 4) or 0.137 B/(H d), the latter doubtful. f: linear derivatives of sway (v)
    and yaw (r) in force (y) and moment (n); g: added masses.

    f_yv = 1.5 f - 0.5 is remembered with f_nv; the only public code has f_nr. The primary (Ankudinov, Miller, Jakobsen
    & Daggett 1990, MARSIM & ICSM) could not be read, so two others decide: Y_v of the Esso tanker grows 1.14, 1.85 and
    3.96 fold at h/d = 2, 1.5, 1.2 (van Berlekom & Goddard 1972), Kijima & Nakiri have 1.30, 1.87, 3.74. By f_nr it is
    1.23, 1.76, 3.52, by f_nv 1.50, 2.47, 5.55. It is f_nr here.
    """
    _ratio(d, h)
    H, b = h / d - 1, C_b * B / d * (1 + B / L) ** 2
    K_0 = 1 + 0.0775 / H**2 - 0.011 / H**3 + 0.000068 / H**5
    K_1 = -0.0643 / H + 0.0724 / H**2 - 0.0113 / H**3 + 0.0000767 / H**5
    K_2 = 0.0342 / H if B / d <= 4 else 0.137 * B / (H * d)

    def combined(one: float, two: float) -> float:
        return K_0 + one * K_1 * b + two * K_2 * b**2

    f_nr = combined(1 / 2, 1 / 3)
    return {
        "f_nr": f_nr,
        "f_yr": combined(2 / 5, 24 / 105),
        "f_nv": combined(1, 1),
        "f_yv": 1.5 * f_nr - 0.5,
        "g_nr": combined(8 / 15, 40 / 105),
        "g_v": combined(2 / 3, 8 / 15),
    }


def taimuri_interaction(L: float, B: float, d: float, C_b: float, h: float) -> dict[str, float]:
    """Factors on w_P0, 1 - t_P and gamma_R after Taimuri et al. (2020), Ocean Eng (108103). UNVERIFIED.

    Single source. gamma_R has two forms; the second holds for x <= 0.581 - 0.332 d/B. The factor of 1 - t_P does not
    tend to 1 in deep water.
    """
    x, c, s = _ratio(d, h), C_b * B / L, C_b * L / B
    if x <= -0.332 * d / B + 0.581:
        gamma_R = 1 + (-135.25 + 2432.95 * c - 10137.7 * c**2) * x**4.81
    else:
        gamma_R = 1 + (-10.258 + 178.207 * c - 686.25 * c**2) * (-3.854 + 13.665 * x - 10.468 * x**2)
    long = C_b * L / d
    return {
        "w_P0": 1 + (-4.932 + 0.6425 * long - 0.0165 * long**2) * x**1.655,
        "one_minus_t_P": 1 + (29.495 - 14.089 * s + 1.6486 * s**2) * (1 / 250 - 7 * x / 200 - 13 * x**2 / 125),
        "gamma_R": gamma_R,
    }


def main() -> None:
    """Prints the factors for the KVLCC2 at depths of 3, 2 and 1.3 draughts, and those of the effect."""
    kvlcc2 = {"L": 320.0, "B": 58.0, "d": 20.8, "C_b": 0.81}
    for ratio in (3.0, 2.0, 1.3):
        h = ratio * kvlcc2["d"]
        print(f"h/d = {ratio:g}")
        for name, found in (
            ("Kijima & Nakiri 1990", kijima_nakiri_1990(**kvlcc2, h=h)),
            ("Ankudinov 1990", ankudinov(**kvlcc2, h=h)),
            ("Taimuri et al. 2020", taimuri_interaction(**kvlcc2, h=h)),
            ("effect shallow_water", {key: 1 + a / (ratio - 1) for key, a in GROWTH.items()}),
        ):
            print(f"  {name}: " + ", ".join(f"{key} {value:.3f}" for key, value in found.items()))
    esso = {"L": tanker.LENGTH, "B": 47.17, "d": tanker.DRAUGHT, "C_b": 0.83}
    for ratio in (3.0, 2.0, 1.5, 1.3, 1.2):
        h, known = ratio * tanker.DRAUGHT, tanker.growth(ratio)
        one, other = ankudinov(**esso, h=h), kijima_nakiri_1990(**esso, h=h)
        by_moment = 1.5 * one["f_nv"] - 0.5
        print(
            f"Esso tanker, h/d = {ratio:g}: Y_v {known['Y_uv']:.2f} (van Berlekom & Goddard 1972), "
            f"{other['Y_beta']:.2f} (Kijima & Nakiri), {one['f_yv']:.2f} (f_yv by f_nr), {by_moment:.2f} (by f_nv); "
            f"N_v {known['N_uv']:.2f}, {other['N_beta']:.2f}, {one['f_nv']:.2f}; "
            f"m_y {known['Y_vdot']:.2f} and g_v {one['g_v']:.2f}"
        )


if __name__ == "__main__":
    main()
