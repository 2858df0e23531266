"""The folder of the C product: header, source, an example that prints a turning circle, and how to compile it."""

from __future__ import annotations

from pathlib import Path

from cases.maneuvers import self_propulsion
from delivery.c.header import TEMPLATES, comment, filled
from delivery.c.source import c_files
from delivery.product import Product
from mmg.errors import UserError

RUDDER = 0.3
"""Rudder angle [rad] of the turn in an example."""


def write_c(product: Product, target: Path) -> None:
    """Write the C product of ``product`` into the folder ``target``. Raises UserError where C cannot hold it."""
    files = c_files(product) | {
        "example.c": example_c(product),
        "README.md": filled(TEMPLATES / "README.md", product),
    }
    for name, text in files.items():
        (target / name).write_text(text, encoding="utf-8", newline="\n")


def example_c(product: Product) -> str:
    """A program that steers ``product`` through 600 s with the rudder held, and prints its motion as CSV."""
    p, (speed, inputs) = product.identifier, approach(product)
    build = f"Compile: cc -std=c99 -O2 {p}.c example.c -lm -o example"
    timed = "time" in product.model.controls
    return filled(
        TEMPLATES / "example.c", product, SPEED=speed,
        ABOUT=comment(["How to use the ship: a turn of 600 s in steps of 0.1 s.", build]),
        SETTINGS="".join(f"  inputs[{p}_input_{name}] = ({p}_real){value!r};\n" for name, value in inputs.items()),
        CLOCK=f"    inputs[{p}_input_time] = ({p}_real)(0.1 * k);\n" if timed else "",
    )  # fmt: skip


def approach(product: Product) -> tuple[float, dict[str, float]]:
    """Speed [m/s] and inputs by name of the turn in an example of ``product``.

    It begins at the highest revolutions that the trials held and the speed that they give, else as ``mmg simulate``
    begins: at the ship's own speed.
    """
    ship, highest = product.ship, product.held.get("n", (0.0, 0.0))[1]
    try:
        speed, n = self_propulsion.approach(ship, highest if highest > 0 else None, None)
    except UserError:  # a ship before its calibration may hold no speed
        speed = self_propulsion.own_speed(ship)
        n = speed / (0.6 * ship.particulars.get("D_P", 0.03 * ship.particulars["L"]))
    inputs = self_propulsion.actuator_positions(ship, n, RUDDER)
    named = {name: round(float(value), 3) for name, value in inputs.items() if name in product.model.controls}
    return round(speed, 3), {name: value for name, value in named.items() if value}
