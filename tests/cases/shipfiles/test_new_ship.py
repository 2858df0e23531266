"""A starting ship from main particulars: figures, priors, bad input, and the newcomer's three commands."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.literature import SHIPS
from cases.criteria.standard_runs import figures_of
from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.self_propulsion import actuator_positions
from cases.shipfiles import new_ship as starting
from cases.shipfiles.new_ship import new_ship, parse_particulars
from cases.shipfiles.particulars import unusual
from cases.shipfiles.ship_file import LIBRARY, dump_ship, load_ship, parse_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import simulate_batch
from mmg.components import empirical
from mmg.components.propeller.b_series import TERMS, thrust_coefficient, thrust_parabola
from mmg.errors import BadValue, UserError
from mmg.messages import has_code
from mmg.model import assemble
from mmg.ship import Ship
from mmg_ident.commands.main import main

KVLCC2 = dict(zip(starting.ORDER, (7.0, 1.27, 0.455, 0.81, 0.216, 0.721, 0.0539, 1.179), strict=True))


def test_b_series_check_values() -> None:
    """Z = 4, A_E/A_O = 0.70: K_T at P/D 0.7151 (Oosterveld & van Oossanen 1975) and 1.0."""
    assert TERMS.shape == (39, 5)
    J = np.array([0.0, 0.4, 0.8])
    np.testing.assert_allclose(thrust_coefficient(J, 0.7151, 0.70, 4), (0.3100, 0.1688, -0.0149), atol=5e-5)
    J = np.array([0.2, 0.4, 0.6, 0.8])
    np.testing.assert_allclose(thrust_coefficient(J, 1.0, 0.70, 4), (0.392, 0.314, 0.226, 0.130), atol=6e-4)


def test_the_parabola_follows_the_series() -> None:
    J = np.linspace(0, 0.7, 8)
    k = thrust_parabola(0.72)
    np.testing.assert_allclose(k[0] + k[1] * J + k[2] * J**2, thrust_coefficient(J, 0.72, 0.6, 4), atol=0.004)


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
    pairs = [(published.coefficients[s].value, estimate.coefficients[s]) for s in shared]
    assert len(shared) > 25 and all(c.std > 0 for _, c in pairs)
    assert np.mean([abs(value - c.value) < 2 * c.std for value, c in pairs]) >= 0.8


def test_a_starting_ship_may_turn_differently_to_port_and_to_starboard() -> None:
    """By the asymmetry of her wake alone, and as her mirror image by that of the other sign."""
    ship = new_ship("mine", KVLCC2)
    assert "tau_a" in ship.free and ship.coefficients["tau_a"].value == 0.0

    def diameters(tau_a: float) -> tuple[float, ...]:
        drawn = ship.with_values({"tau_a": tau_a})
        plans = [parse_maneuver(f"turning:{angle}", drawn) for angle in (35, -35)]
        return tuple(figures_of(simulate(drawn, plan), plan)["tactical_diameter"] for plan in plans)

    starboard, port = diameters(0.3)
    assert abs(port / starboard - 1) > 0.02
    assert diameters(-0.3) == pytest.approx((port, starboard), rel=1e-6)
    assert np.ptp(diameters(0.0)) == pytest.approx(0.0, abs=1e-6)


def test_what_is_not_given_is_said_and_the_resistance_is_that_of_the_kvlcc2_model() -> None:
    assert starting.resistance(starting.complete(KVLCC2)[0]) == pytest.approx(0.022, rel=0.30)
    p, notices = starting.complete({"L": 180.0, "B": 30.0, "d": 10.0, "C_b": 0.75})
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
        ({"D_az": 3.0, "x_az": -80.0, "y_az": 5.0, "x_az_2": -80.0, "y_az_2": -5.0}, {"hull", "azimuth", "wind"}),
    ],
)
def test_a_new_ship_is_a_ship_file(extra: dict, roles: set) -> None:
    ship = new_ship("mine", {"L": 180.0, "B": 30.0, "d": 10.0, "C_b": 0.7, **extra})
    assert set(ship.components) == roles
    back = parse_ship(dump_ship(ship))
    assert dict(back.coefficients) == dict(ship.coefficients) and not back.notices
    assert ("n_2" in assemble(ship).controls) == ("y_P" in extra)
    podded = "k_T_az_2" in ship.free, "D_v" in ship.free, "azimuth_2" in assemble(ship).controls
    assert podded == ("D_az" in extra,) * 3
    assert any(c.startswith("delta") for c in assemble(ship).controls) == ("rudder" in roles)
    for c in ship.coefficients.values():
        assert math.isfinite(c.value) and c.std >= 0 and c.lower <= c.value <= c.upper


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["320", "580", "20.8", "0.81"], "L / B"),
        (["320", "58", "20.8"], "C_b missing"),
        (["320", "58", "20.8", "0.81", "speed=3"], "'speed'"),
        (["320", "58", "20.8", "fast"], "'fast'"),
        (["320", "58", "20.8", "0.81", "U_0=80"], "Froude number"),
        (["320", "58", "20.8", "0.81", "U_0=0.1"], "U_0 = 0.1 m/s"),
        (["320", "58", "20.8", "0.81", "D_P=0.00986"], "D_P = 0.00986"),
        (["320", "58", "20.8", "0.81", "A_R=1e-4"], "A_R = 0.0001"),
        (["L=320", "L=300", "58", "20.8", "0.81"], "given twice"),
        (["320", "58", "20.8", "0.81", "9.86", "0.72", "112.5", "15.5"], "U_0=7.97"),
        (["180", "32", "11", "0.8", "U_0=14.5"], "C_b = 0.8"),
        (["320", "58", "20.8", "0.81", "m=200e6"], "m / .rho L B d C_b."),
        (["34", "9.6", "2.7", "0.6", "D_az=1.9"], "x_az, y_az missing"),
        (["34", "9.6", "2.7", "0.6", "D_az=1.9", "x_az=-16", "y_az=2", "y_P=2"], "y_P"),
    ],
)
def test_unphysical_particulars_are_refused_with_their_value(words: list[str], message: str) -> None:
    with pytest.raises(UserError, match=message):
        new_ship("mine", parse_particulars(words))


KVLCC2_HULL = {"L": 7.0, "B": 1.27, "d": 0.455, "C_b": 0.81}


def test_the_mean_of_the_regressions_is_near_the_captive_tests_of_the_kvlcc2() -> None:
    """Published: Y_v -0.315, Y_r 0.083, N_v -0.137, N_r -0.049; single regressions are up to 42 % off."""
    found = empirical.linear_derivatives(**KVLCC2_HULL, m_x=0.022)
    assert len(found) == 6
    published = {s: load_ship("kvlcc2_l7").coefficients[s].value for s in starting.LINEAR}
    for symbol, value in published.items():
        values = [each[symbol] for each in found.values()]
        assert np.mean(values) == pytest.approx(value, rel=0.17)
        assert min(values) <= value <= max(values) or symbol == "N_v"


def test_regressions_by_hand() -> None:
    """Norrbin: pi d/L (1.69 + 0.08 C_b B/(pi d)); Wagner Smitt: 1.59 pi d/L; Lee: -0.4545 + 0.065 C_b B/d."""
    found = empirical.linear_derivatives(**KVLCC2_HULL, m_x=0.022)
    unit, full = np.pi * 0.065, 0.81 * 1.27 / (np.pi * 0.455)
    assert found["Norrbin (1971)"]["Y_v"] == pytest.approx(-unit * (1.69 + 0.08 * full))
    assert found["Wagner Smitt (1971)"]["N_r"] == pytest.approx(-0.21 * unit)
    assert found["Lee (1998)"]["Y_v"] == pytest.approx(-0.4545 + 0.065 * 0.81 * 1.27 / 0.455)


@pytest.mark.parametrize("hull", starting.HULLS)
def test_priors_are_no_narrower_than_the_regressions_scatter_and_factors_are_said(hull: str) -> None:
    p = starting.complete(KVLCC2_HULL)[0]
    rows, scatter = starting.estimates(p, hull), starting.spread(p, 0.022)
    neutral = empirical.linear_derivatives(**KVLCC2_HULL, m_x=empirical.motora_added_mass(**KVLCC2_HULL)["m_x"])
    for symbol in starting.LINEAR:
        value, share, source = rows[symbol]
        factor = starting.CORRECTIONS[hull].get(symbol, 1.0)
        assert value == pytest.approx(factor * np.mean([each[symbol] for each in neutral.values()]))
        assert share >= 0.99 * scatter[symbol] and ("times" in source) == (factor != 1.0)


@pytest.mark.slow
def test_imo_gives_a_starting_ship_intervals_and_a_ship_of_the_library_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fitting.prediction.figure_intervals.DRAWS", 20)
    ship = new_ship("mine", KVLCC2_HULL)
    assert ship.description == starting.STARTING and starting.is_starting_ship(ship)
    assert not starting.is_starting_ship(load_ship("kvlcc2_l7"))
    symbol = ship.symbols[0]
    calibrated = ship.coefficients[symbol].with_(prior_value=1.0, prior_std=1.0)
    assert not starting.is_starting_ship(ship.with_coefficients({symbol: calibrated}))
    (tmp_path / "mine.toml").write_text(dump_ship(ship), encoding="utf-8")
    command = ["imo", str(tmp_path / "mine.toml"), "--json"]
    assert main(command) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    row = next(r for r in rows if r["figure"] == "tactical_diameter")
    low, high = row["interval_90"]
    assert low < 3.33 < high and low < row["value"] < high
    assert main([*command, "--scatter", "0"]) == 0
    assert all(r["interval_90"] is None for r in json.loads(capsys.readouterr().out)["rows"])


TEXT = (LIBRARY / "esso_osaka_3m.toml").read_text(encoding="utf-8")


def changed(key: str, value: float) -> str:
    """The ESSO OSAKA's ship file with one particular replaced or added."""
    text, count = re.subn(rf"(?m)^{key} = [^#\n]*", f"{key} = {value} ", TEXT, count=1)
    return text if count else TEXT.replace("[ship]\n", f"[ship]\n{key} = {value}\n", 1)


WRONG = {
    "negative draught": ("d", -0.2, "d = -0.2 m (draught)"),
    "block coefficient above 1": ("C_b", 1.2, "C_b = 1.2"),
    "negative block coefficient, though no model needs it": ("C_b", -0.8, "C_b = -0.8 (block"),
    "propeller larger than the draught": ("D_P", 0.5, "D_P = 0.5 m: the propeller is larger than the draught"),
    "breadth above length": ("B", 4.0, "B"),
    "length in millimetres": ("L", 3000.0, "L = 3000 m"),
    "mass in tonnes": ("m", 0.2446, "m = 0.2446 kg"),
    "mass in grams": ("m", 244600.0, "m = 244600 kg"),
    "density in t/m3": ("rho", 0.998, "rho = 0.998"),
    "density of air in g/m3": ("rho_a", 1225.0, "rho_a = 1225"),
    "rudder area in cm2": ("A_R", 106.3, "A_R = 106.3"),
    "rudder higher than the draught": ("aspect_ratio", 15.0, "aspect_ratio = 15"),
    "rudder off the ship": ("x_R", -20.0, "x_R = -20 m"),
    "centre of gravity off the ship": ("x_G", 5.0, "x_G = 5 m"),
    "screws off the ship": ("y_P", 0.4, "y_P = 0.4 m"),
    "screws at a negative distance": ("y_P", -0.1, "y_P = -0.1 m"),
    "lateral area in cm2": ("A_L", 5203.8, "A_L = 5203.8"),
    "rudder rate in deg/s": ("rudder_rate", 20.0, "rudder_rate = 20 rad/s"),
    "rudder that cannot move": ("rudder_rate", 0.0, "rudder_rate = 0 rad/s"),
    "a breadth whose square is no number": ("B", 1e300, "B = 1e+300 m is out of all proportion"),
    "a mass of next to nothing": ("m", 1e-300, "m = 1e-300 kg is out of all proportion"),
    "negative speed": ("U_0", -2.0, "U_0 = -2 m/s"),
}
"""What is wrong -> key, value, what the line must say."""


@pytest.mark.parametrize("case", WRONG)
def test_a_ship_file_with_particulars_of_no_ship_is_refused(case: str) -> None:
    key, value, words = WRONG[case]
    with pytest.raises(BadValue) as raised:
        parse_ship(changed(key, value), "mine.toml")
    line = str(raised.value)
    assert line.startswith("mine.toml: [ship]") and words in line and "\n" not in line


@pytest.mark.parametrize(("key", "value"), [("C_b", 1.0), ("x_G", -0.1), ("y_P", 0.1), ("D_P", 0.2), ("x_R", -1.7)])
def test_unusual_particulars_of_a_possible_ship_are_taken(key: str, value: float) -> None:
    assert parse_ship(changed(key, value)).particulars[key] == value


def test_particulars_may_be_named_and_numbered_as_a_notebook_has_them() -> None:
    given = pd.Series({"Lpp": 30, "B": np.float32(5.5), "T": np.int64(2), "Cb": 0.8}, dtype=object)
    ship = new_ship("x", given)
    assert {key: ship.particulars[key] for key in ("L", "B", "d", "C_b")} == {"L": 30, "B": 5.5, "d": 2, "C_b": 0.8}
    assert all(type(value) is float for value in ship.particulars.values())


def podded(x_az: float = -1.4) -> Ship:
    """A ship with an azimuth thruster alone, ``x_az`` [m] ahead of midship."""
    sizes = {"L": 3.0, "B": 0.49, "d": 0.2, "C_b": 0.83, "x_G": 0.09, "D_az": 0.08, "x_az": x_az, "y_az": 0.0}
    return new_ship("podded", sizes, "unified")


@pytest.mark.parametrize(("side", "x_az"), [(1, -1.4), (-1, -1.4), (1, 1.2)])
def test_a_ship_with_an_azimuth_thruster_alone_is_driven_and_steered_by_it(side: int, x_az: float) -> None:
    """A positive rudder order turns to starboard, wherever the thruster is; the approach is steady."""
    ship = podded(x_az)
    trial = simulate(ship, parse_maneuver(f"turning:{side * 20}", ship, duration=40), 0.1)
    lead = trial.t < 4.9
    assert trial["n_azimuth"][0] > 1 and abs(trial["u"][lead] - trial["u"][0]).max() < 1e-6
    assert side * trial["r"][-1] > 0.01 and side * x_az * trial["azimuth"][-1] > 0


def test_a_batch_drives_an_azimuth_thruster_as_a_single_run_does() -> None:
    ship = podded()
    plan = parse_maneuver("turning:20", ship, duration=40)
    alone, batch = simulate(ship, plan, 0.5), simulate_batch(ship, plan, dt=0.5)
    assert abs(alone.states - batch.states[:, :, 0]).max() < 1e-9


def test_a_ship_with_propeller_and_azimuth_thruster_leaves_that_at_rest() -> None:
    ship = replace(podded(), components={**podded().components, "propeller": "hachii"})
    moved = actuator_positions(ship, 10.0, 0.3)
    assert (moved["n"], moved["n_azimuth"], moved["azimuth"]) == (10.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("161 23.2 7.5 0.6 U_0=15", "U_0=7.72"),
        ("325 53 21.7 0.83 U_0=1.5", "Froude number 0.027"),
        ("180 30 10 0.7 A_R=6", "A_R / .L d. = 0.00333"),
        ("180 30 10 0.7 D_P=9.7", "D_P / d = 0.97"),
        ("180 60 10 0.7", "L / B = 3"),
        ("180 30 20 0.7", "B / d = 1.5"),
        ("180 30 10 0.7 m=42e6", "1.08"),
        ("180 30 10 0.95", "C_b = 0.95"),
    ],
)
def test_what_few_ships_have_is_one_warning(words: str, said: str) -> None:
    ship = new_ship("mine", parse_particulars(words.split()))
    (found,) = (notice for notice in ship.notices if has_code([notice], "unusual_particular"))
    assert re.search(said, found)


@pytest.mark.parametrize("real", SHIPS, ids=lambda real: real.name)
def test_ships_of_the_literature_are_not_unusual(real) -> None:
    assert list(unusual({**real.particulars, "U_0": real.speed})) == []


def test_the_command_warns_and_says_how_far_the_ship_can_be_trusted(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ships", "--new", "161", "23.2", "7.5", "0.6", "U_0=15"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert sum(line.startswith("warning: U_0 = 15 m/s") for line in lines) == 1
