"""Ships with four kinds of actuators, for tests of generated models."""

from __future__ import annotations

from dataclasses import replace

from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship, parse_ship
from mmg.ship import Ship

FERRY = """
[ship]
name = "ferry"
L = 3.0
B = 0.7
d = 0.15
m = 150.0
x_G = 0.0
rho = 998.0
D_az = 0.06
x_az = -1.2
y_az = 0.2
x_az_2 = -1.2
y_az_2 = -0.2
x_az_3 = 1.2
y_az_3 = 0.2
x_az_4 = 1.2
y_az_4 = -0.2

[model]
hull = "harbour"
azimuth = "azimuth"
"""
MAIN = {"L": 3.0, "B": 0.5, "d": 0.17, "C_b": 0.6, "D_P": 0.07, "U_0": 0.8}


def true_ship(kind: str) -> Ship:
    """A ship with the actuators that ``kind`` names: vectwin, pods, twin (screws and rudders) or thrusters."""
    if kind == "vectwin":
        return load_ship("vectwin_3m")
    if kind == "pods":
        return parse_ship(FERRY)
    ship = new_ship(kind, MAIN | {"y_P": 0.12})
    if kind == "twin":
        return ship
    components = {role: model for role, model in ship.components.items() if role != "rudder"}
    from mmg.components.catalogue import coefficient_table

    rows = coefficient_table(components, ship.particulars)
    return replace(ship, components=components, coefficients={s: ship.coefficients.get(s, c) for s, c in rows.items()})
