"""Published shallow-water factors (UNVERIFIED sets): what is tested is the arithmetic and the limits."""

from __future__ import annotations

import pytest

from benchmarks import shallow_factors as shallow

KVLCC2 = {"L": 320.0, "B": 58.0, "d": 20.8, "C_b": 0.810}


def test_kijima_nakiri_by_hand_at_twice_the_draught() -> None:
    """x = 0.5, C_b B/d = 2.258654: f1 = 2^0.903462 - 0.5, N_r: 2^(1.5 - 0.9282) - 0.5; cubics summed by hand."""
    got = shallow.kijima_nakiri_1990(**KVLCC2, h=41.6)
    assert got["Y_beta"] == pytest.approx(2**0.9034615 - 0.5, rel=1e-6)
    assert got["N_r"] == pytest.approx(2 ** (1.5 - 14.28 * 20.8 / 320) - 0.5, rel=1e-9)
    by_hand = {
        "Y_r": 0.9473, "Y_rr": 2.2875, "Y_brr": -1.2252, "N_bb": -1.1250, "N_rr": 1.9520, "N_bbr": 0.8878,
        "N_brr": 0.1849,
    }  # fmt: skip
    for symbol, value in by_hand.items():
        assert got[symbol] == pytest.approx(value, abs=1e-3), symbol


SETS = (shallow.kijima_nakiri_1990, shallow.ankudinov, shallow.taimuri_interaction)


@pytest.mark.parametrize("factors", SETS)
def test_deep_water_leaves_the_coefficients_alone(factors) -> None:
    """1 - t_P tends to 0.998 in print, not to 1."""
    for symbol, value in factors(**KVLCC2, h=2e6).items():
        assert value == pytest.approx(1.0, abs=0.0025 if symbol == "one_minus_t_P" else 1e-3), symbol


@pytest.mark.parametrize("symbol", ["f_nr", "f_yr", "f_nv", "f_yv", "g_nr", "g_v"])
def test_ankudinovs_factors_grow_as_the_water_gets_shallow(symbol: str) -> None:
    deep, middle, low = (shallow.ankudinov(**KVLCC2, h=x * 20.8)[symbol] for x in (3.0, 2.0, 1.3))
    assert 1 < deep < middle < low


def test_ankudinov_by_hand_at_twice_the_draught() -> None:
    """H = 1: K_0 = 1.066568, K_1 = -0.0031233, K_2 = 0.0342; b = 3.15179 (C_b B/d (1 + B/L)^2)."""
    got = shallow.ankudinov(**KVLCC2, h=41.6)
    b = 0.81 * 58 / 20.8 * (1 + 58 / 320) ** 2
    f_nv = 1.066568 - 0.0031233 * b + 0.0342 * b * b
    assert got["f_nv"] == pytest.approx(f_nv, rel=1e-6)
    f_nr = 1.066568 - 0.0031233 * b / 2 + 0.0342 * b * b / 3
    assert got["f_yv"] == pytest.approx(1.5 * f_nr - 0.5, rel=1e-6)
    assert got["g_v"] == pytest.approx(1.066568 - 0.0031233 * b * 2 / 3 + 0.0342 * b * b * 8 / 15, rel=1e-6)


def test_taimuris_two_forms_of_gamma_R() -> None:
    """x = 0.4 lies below 0.581 - 0.332 d/B = 0.4619, x = 0.5 above."""
    c = 0.81 * 58 / 320
    below, above = (shallow.taimuri_interaction(**KVLCC2, h=20.8 / x)["gamma_R"] for x in (0.4, 0.5))
    assert below == pytest.approx(1 + (-135.25 + 2432.95 * c - 10137.7 * c * c) * 0.4**4.81)
    hump = -3.854 + 13.665 * 0.5 - 10.468 * 0.25
    assert above == pytest.approx(1 + (-10.258 + 178.207 * c - 686.25 * c * c) * hump)


def test_simple_growth_has_its_two_limits() -> None:
    assert shallow.growth(1.0, 1e9, 0.5, 1.5) == pytest.approx(1.0)
    assert shallow.growth(1.0, 2.0, 0.5, 1.5) == pytest.approx(1.5)
    assert shallow.growth(1.0, 1.25, 0.5, 1.5) == pytest.approx(1 + 0.5 * 8)


@pytest.mark.parametrize("h", [20.8, 10.0, -1.0])
@pytest.mark.parametrize("factors", SETS)
def test_a_ship_aground_is_refused(factors, h: float) -> None:
    with pytest.raises(ValueError, match="larger than the draught"):
        factors(**KVLCC2, h=h)
