"""A starting ship from main particulars: figures, priors, bad input, and the newcomer's three commands."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from cases.criteria.standard_runs import figures_of
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.estimates import resistance
from cases.shipfiles.new_ship import ORDER, complete, new_ship, parse_particulars
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.simulation.simulate import simulate
from mmg.components.propeller.b_series import K_Q_TERMS, K_T_TERMS, open_water, thrust_parabola
from mmg.errors import UserError
from mmg.model import assemble
from mmg_ident.commands.main import main

KVLCC2 = dict(zip(ORDER, (7.0, 1.27, 0.455, 0.81, 0.216, 0.721, 0.0539, 1.179), strict=True))


def test_b_series_check_values() -> None:
    """Z = 4, A_E/A_O = 0.70: K_T at P/D 0.7151 (Oosterveld & van Oossanen 1975) and 1.0; efficiency of a propeller."""
    assert K_T_TERMS.shape == (39, 5) and K_Q_TERMS.shape == (47, 5)
    J = np.array([0.0, 0.4, 0.8])
    np.testing.assert_allclose(open_water(K_T_TERMS, J, 0.7151, 0.70, 4), (0.3100, 0.1688, -0.0149), atol=5e-5)
    J = np.array([0.2, 0.4, 0.6, 0.8])
    np.testing.assert_allclose(open_water(K_T_TERMS, J, 1.0, 0.70, 4), (0.392, 0.314, 0.226, 0.130), atol=6e-4)
    assert open_water(K_Q_TERMS, np.array([0.0]), 1.0, 0.70, 4)[0] == pytest.approx(0.0666, rel=0.02)
    efficiency = J * open_water(K_T_TERMS, J, 1.0, 0.7, 4) / (2 * np.pi * open_water(K_Q_TERMS, J, 1.0, 0.7, 4))
    assert 0.6 < efficiency.max() < 0.75


def test_the_parabola_follows_the_series() -> None:
    J = np.linspace(0, 0.7, 8)
    k = thrust_parabola(0.72)
    np.testing.assert_allclose(k[0] + k[1] * J + k[2] * J**2, open_water(K_T_TERMS, J, 0.72, 0.6, 4), atol=0.004)


@pytest.mark.parametrize("hull", ["unified", "polynomial"])
def test_kvlcc2_from_eight_particulars_turns_like_kvlcc2(hull: str) -> None:
    """Tactical diameter and advance of MARIN's model (3.33, 3.09 L) within 30 %: a starting point, no more."""
    ship = new_ship("mine", KVLCC2, hull)
    plan = parse_maneuver("turning:35", ship)
    assert plan.speed == 1.179
    found = figures_of(simulate(ship, plan), plan)
    assert found["tactical_diameter"] / 7.0 == pytest.approx(3.33, rel=0.30)
    assert found["advance"] / 7.0 == pytest.approx(3.09, rel=0.15)


def test_the_published_coefficients_lie_within_the_wide_priors() -> None:
    """Of the KVLCC2 captive tests, at least four in five within two standard deviations of the estimate."""
    estimate, published = new_ship("mine", KVLCC2, "polynomial"), load_ship("kvlcc2_l7")
    shared = [s for s in estimate.symbols if s in published.coefficients and s not in ("C_PR", "k_xR")]
    z = [
        (published.coefficients[s].value - estimate.coefficients[s].value) / estimate.coefficients[s].std
        for s in shared
    ]
    assert len(shared) > 25
    assert np.mean(np.abs(z) < 2) >= 0.8
    assert all(estimate.coefficients[s].std > 0 for s in shared)


def test_resistance_of_the_kvlcc2_model() -> None:
    p, _ = complete(KVLCC2)
    assert resistance(p) == pytest.approx(0.022, rel=0.30)


def test_what_is_not_given_is_said() -> None:
    p, notices = complete({"L": 180.0, "B": 30.0, "d": 10.0, "C_b": 0.75})
    for name in ("rho", "U_0", "x_G", "D_P", "A_R", "aspect_ratio"):
        assert any(line.startswith(f"{name} =") for line in notices), name
    assert 10 < p["U_0"] / 0.5144 < 22 and 0.012 < p["A_R"] / (180 * 10) < 0.03


@pytest.mark.parametrize(
    ("extra", "roles"),
    [
        ({}, {"hull", "propeller", "rudder", "wind"}),
        ({"D_BT": 2.0}, {"hull", "propeller", "rudder", "wind", "bow_thruster"}),
        ({"y_P": 6.0}, {"hull", "propeller", "rudder", "wind"}),
        ({"y_P": 6.0, "A_R": 0.0}, {"hull", "propeller", "wind"}),
    ],
)
def test_a_new_ship_is_a_ship_file(extra: dict, roles: set) -> None:
    ship = new_ship("mine", {"L": 180.0, "B": 30.0, "d": 10.0, "C_b": 0.7, **extra})
    assert set(ship.components) == roles
    back = parse_ship(dump_ship(ship))
    assert dict(back.coefficients) == dict(ship.coefficients) and not back.notices
    assert ("n_2" in assemble(ship).controls) == ("y_P" in extra)
    assert any(c.startswith("delta") for c in assemble(ship).controls) == ("rudder" in roles)
    assert all(
        math.isfinite(c.value) and c.std >= 0 and c.lower <= c.value <= c.upper for c in ship.coefficients.values()
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["320", "58", "-20.8", "0.81"], "= -20.8"),
        (["320", "58", "20.8", "1.2"], "C_b = 1.2"),
        (["320", "58", "20.8", "0.81", "25"], "propeller is larger than the draught"),
        (["320", "580", "20.8", "0.81"], "L / B"),
        (["320", "58", "20.8"], "C_b missing"),
        (["320", "58", "20.8", "0.81", "speed=3"], "'speed'"),
        (["320", "58", "20.8", "fast"], "'fast'"),
        (["320", "58", "20.8", "0.81", "U_0=80"], "Froude number"),
        (["320", "58", "20.8", "0.81", "U_0=0.1"], "U_0 = 0.1 m/s"),
        (["320", "58", "20.8", "0.81", "D_P=0.00986"], "D_P = 0.00986"),
        (["320", "58", "20.8", "0.81", "A_R=1e-4"], "A_R = 0.0001"),
        (["320", "58", "20.8", "0.81", "A_R=-1"], "A_R = -1"),
        (["320000", "58000", "20800", "0.81"], "L = 320000 m"),
        (["320", "58", "20.8", "0.81", "rho=1.025"], "rho = 1.025"),
        (["320", "58", "20.8", "0.81", "m=312600"], "m = 312600 kg"),
        (["L=320", "L=300", "58", "20.8", "0.81"], "given twice"),
    ],
)
def test_unphysical_particulars_are_refused_with_their_value(words: list[str], message: str) -> None:
    with pytest.raises(UserError, match=message):
        new_ship("mine", parse_particulars(words))


def test_the_newcomers_three_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Eight particulars to a ship file, a turning circle, an IMO table."""
    file = tmp_path / "mine.toml"
    assert (
        main(["ships", "--new", "320", "58", "20.8", "0.81", "9.86", "0.72", "112.5", "7.97", "--out", str(file)]) == 0
    )
    assert main(["simulate", str(file), "--maneuver", "turning:35", "--json"]) == 0
    captured = capsys.readouterr().out
    figures = json.loads(captured)["figures"]
    assert 2.0 < figures["tactical_diameter_L"] < 5.5
    assert main(["imo", str(file), "--scatter", "0", "--json"]) == 0
    assert "tactical" in capsys.readouterr().out
    assert main(["ships", "--new", "320", "58", "-20.8", "0.81"]) == 2
    line = capsys.readouterr().err.strip()
    assert "-20.8" in line and "\n" not in line
