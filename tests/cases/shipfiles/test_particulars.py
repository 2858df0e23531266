"""Particulars that no ship has are refused in ship files, in one line with file, key and value."""

from __future__ import annotations

import re

import pytest

from cases.maneuvers.self_propulsion import actuator_positions
from cases.shipfiles.ship_file import LIBRARY, library, load_ship, parse_ship
from mmg.errors import BadValue

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


def test_every_ship_of_the_library_loads() -> None:
    assert all(load_ship(name) for name in library())


AZIMUTH = """[ship]
L = 3.0
B = 0.49
d = 0.2
m = 244.6
x_G = 0.09
rho = 998.0
D_az = 0.08
x_az = -1.4
y_az = 0.0
[model]
hull = "unified"
azimuth = "azimuth"
"""


@pytest.mark.parametrize(("side", "x_az"), [(1, -1.4), (-1, -1.4), (1, 1.2)])
def test_a_ship_with_an_azimuth_thruster_alone_is_driven_and_steered_by_it(side: int, x_az: float) -> None:
    """A positive rudder order turns to starboard, wherever the thruster is; the approach is steady."""
    from cases.maneuvers.definitions import parse_maneuver
    from cases.simulation.simulate import simulate

    ship = parse_ship(AZIMUTH.replace("-1.4", str(x_az)))
    trial = simulate(ship, parse_maneuver(f"turning:{side * 20}", ship, duration=40), 0.1)
    lead = trial.t < 4.9
    assert trial["n_azimuth"][0] > 1
    assert abs(trial["u"][lead] - trial["u"][0]).max() < 1e-6
    assert side * trial["r"][-1] > 0.01
    assert side * x_az * trial["azimuth"][-1] > 0


def test_a_batch_drives_an_azimuth_thruster_as_a_single_run_does() -> None:
    from cases.maneuvers.definitions import parse_maneuver
    from cases.simulation.simulate import simulate
    from cases.simulation.simulate_batch import simulate_batch

    ship = parse_ship(AZIMUTH)
    plan = parse_maneuver("turning:20", ship, duration=40)
    alone, batch = simulate(ship, plan, 0.5), simulate_batch(ship, plan, dt=0.5, held=True)
    assert abs(alone.states - batch.states[:, :, 0]).max() < 1e-9


def test_a_ship_with_propeller_and_azimuth_thruster_leaves_that_at_rest() -> None:
    ship = parse_ship(AZIMUTH.replace("[model]\n", 'D_P = 0.084\npitch_ratio = 0.7\n[model]\npropeller = "hachii"\n'))
    moved = actuator_positions(ship, 10.0, 0.3)
    assert (moved["n"], moved["n_azimuth"], moved["azimuth"]) == (10.0, 0.0, 0.0)
