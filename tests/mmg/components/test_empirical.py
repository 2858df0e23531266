"""Regressions for coefficients against the printed check values of KVLCC2 and ESSO OSAKA."""

from __future__ import annotations

import math

import pytest

from mmg.components import empirical

KVLCC2 = {"L": 320.0, "B": 58.0, "d": 20.8, "C_b": 0.810}


@pytest.mark.parametrize(
    ("symbol", "value", "digits"),
    [
        ("X_vv", -0.0112, 4), ("X_vr", 0.0226, 4), ("X_vvvv", 0.119, 3), ("Y_v", -0.4097, 4), ("Y_r", 0.0954, 4),
        ("Y_vvv", -0.541, 3), ("Y_vvr", -0.75, 2), ("Y_vrr", -0.383, 3), ("Y_rrr", -0.051, 3), ("N_v", -0.130, 3),
        ("N_r", -0.0533, 4), ("N_vvv", -0.101, 3), ("N_vvr", -0.532, 3), ("N_vrr", -0.177, 3), ("N_rrr", -0.0193, 4),
        ("a_H", 0.355, 3), ("gamma_R", 0.442, 3),
    ],
)  # fmt: skip
def test_yoshimura_masumoto_for_kvlcc2(symbol: str, value: float, digits: int) -> None:
    got = empirical.yoshimura_masumoto_2012(**KVLCC2, m_x=0.022, m_y=0.223, x_G=11.2)
    assert got[symbol] == pytest.approx(value, abs=0.51 * 10**-digits)


def test_x_G_enters_X_rr_alone() -> None:
    """X_rr = -0.085 c + 0.008 - x_G' m_y'."""
    one, other = (empirical.yoshimura_masumoto_2012(**KVLCC2, m_x=0.022, m_y=0.223, x_G=x) for x in (0.0, 11.2))
    assert other["X_rr"] - one["X_rr"] == pytest.approx(-11.2 / 320 * 0.223)
    assert one["X_rr"] == pytest.approx(-0.085 * 0.1468125 + 0.008)
    assert {s for s in one if one[s] != other[s]} == {"X_rr"}


def test_motoras_charts_for_kvlcc2() -> None:
    """Regression 0.0231, 0.2243, 0.0112; published 0.022, 0.223, 0.011."""
    got = empirical.motora_added_mass(**KVLCC2)
    assert got == pytest.approx({"m_x": 0.0231, "m_y": 0.2243, "J_z": 0.0112}, abs=0.51e-4)


def test_clarke_for_kvlcc2() -> None:
    """Printed by 1/2 rho L^2 U^2 (times d/L here); m_y' 0.2438 and Y_v -0.3887 in the MMG system. The rest by hand:
    pi d/L = 0.204204, B/L = 0.18125, B/d = 2.788462, C_b B/d = 2.258654."""
    got = empirical.clarke_1983(**KVLCC2)
    assert got["Y_v"] == pytest.approx(-0.3887, abs=0.51e-4)
    assert got["Y_vdot"] == pytest.approx(-0.2438, abs=0.51e-4)
    printed = {"Y_v": -0.025265, "Y_vdot": -0.015846, "N_v": -0.008707, "N_r": -0.0034145}
    for symbol, value in printed.items():
        assert got[symbol] * 20.8 / 320 == pytest.approx(value, rel=6e-5)
    brackets = {"N_rdot": -0.0619179, "Y_r": 0.3243269}
    for symbol, bracket in brackets.items():
        assert got[symbol] == pytest.approx(0.2042035 * bracket, rel=2e-6), symbol


def test_kijima_inoue_and_yoshimura_masumoto_share_three_derivatives() -> None:
    kijima, inoue = empirical.kijima_1990(**KVLCC2, m_x=0.022), empirical.inoue_1981(**KVLCC2)
    yoshimura = empirical.yoshimura_masumoto_2012(**KVLCC2, m_x=0.022, m_y=0.223)
    for symbol in ("Y_v", "N_v", "N_r"):
        assert kijima[symbol] == inoue[symbol] == yoshimura[symbol]
    assert kijima["Y_r"] == yoshimura["Y_r"] == pytest.approx(0.022 + 0.5 * 0.1468125)
    assert inoue["Y_r"] == pytest.approx(math.pi / 4 * 0.13)


def test_low_speed_regressions_of_esso_osaka_and_takaoki() -> None:
    esso = empirical.yoshimura_2009_low_speed(3.0, 0.48925, 0.20114)
    assert esso["C_D"] == pytest.approx(0.96652, abs=1e-5) and esso["C_rN"] == pytest.approx(0.80969, abs=1e-5)
    assert esso["C_rY"] == pytest.approx(2.127, abs=0.8e-3)
    takaoki = empirical.yoshimura_2009_low_speed(3.0, 0.4843, 0.1721)
    assert takaoki["C_rY"] == pytest.approx(2.15914, abs=1e-5)
    assert takaoki["C_rN"] == pytest.approx(0.99643, abs=1e-5)
