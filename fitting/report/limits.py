"""The range of motion and inputs that trials held: outside of it a calibrated ship extrapolates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fitting.prediction.envelope import DRIFT
from mmg.effects import effect
from mmg.motion.flow import INPUTS, RUDDERS
from mmg.ship import Ship

MODEL = 20.0
"""Length [m] below which a ship is a model."""
DEGREES = 180.0 / np.pi
WORDS = {
    "u": ("surge velocity", "m/s", 1.0),
    "v": ("sway velocity at midship", "m/s", 1.0),
    "r": ("yaw rate", "deg/s", DEGREES),
    DRIFT: ("drift angle, positive where the water comes from starboard", "deg", DEGREES),
    "a_x": ("air relative to the hull, ahead", "m/s", 1.0),
    "a_y": ("air relative to the hull, to starboard", "m/s", 1.0),
}
"""Quantity -> words, unit in which it is shown, factor from SI."""


def limit_rows(envelope: Mapping[str, Sequence[float]], length: float) -> list[dict[str, Any]]:
    """Rows for the table of an ``envelope``: name, words, unit, low, high, and what is dimensionless of it.

    length: of the ship [m].
    """
    rows = []
    speed = max(map(abs, envelope.get("u", [0.0])))
    for name in sorted(envelope, key=lambda name: list(WORDS).index(name) if name in WORDS else 2.5):
        words, unit, factor = WORDS.get(name) or _input(name)
        low, high = (factor * value for value in envelope[name])
        more = ""
        if name == "r" and speed > 0:
            slow, fast = (value * length / speed for value in envelope[name])
            more = f"r L / U at the highest speed {slow:.2g} to {fast:.2g}"
        elif name == "u":
            more = f"Froude number up to {speed / np.sqrt(9.80665 * length):.2g}"
        row = {"name": name, "words": words, "unit": unit, "low": low, "high": high}
        rows.append(row | {"more": more.replace("-", "−")})
    return rows


def _input(name: str) -> tuple[str, str, float]:
    """Words, unit and factor of an actuator."""
    words, unit = INPUTS[name]
    return words, {"rad": "deg", "rps": "1/s"}.get(unit, unit), DEGREES if unit == "rad" else 1.0


def use_rows(envelope: Mapping[str, Sequence[float]], ship: Ship, windy: bool = True) -> tuple[list[str], list[str]]:
    """What a model calibrated on trials of this ``envelope`` is good for, and what not, in sentences.

    ship: the calibrated one; windy: whether any of the trials logs wind. Both follow from the ranges,
    the force models and the effects alone.
    """
    good = ["manoeuvres within the limits of use above, in deep and open water"]
    if "u" in envelope:
        low, high = envelope["u"]
        words = f"manoeuvres at u from {low:.3g} to {high:.3g} m/s within the limits of use above"
        good = [f"{words}, in deep, open water"]
    if ship.particulars["L"] < MODEL:
        words = "the model itself; the full-scale ship only after mmg scale: Froude's law, and other friction and wake"
        good.append(words)
    bad = [*_unseen(envelope), *_not_modelled(ship, windy)]
    bad.append(
        "reading a single coefficient as physics where the calibration's report says shared, prior or not excited: "
        "only the whole is calibrated"
    )
    return good, bad


def _unseen(envelope: Mapping[str, Sequence[float]]) -> list[str]:
    """Uses that the ranges of the trials rule out."""
    bad, largest = [], {name: max(map(abs, pair)) for name, pair in envelope.items()}
    if "u" in envelope and envelope["u"][0] > 0.05 * envelope["u"][1]:
        bad.append("stopping, going astern and manoeuvring near rest: the ship never did it in the trials")
    if "n" in envelope and envelope["n"][0] >= 0:
        bad.append("reversed propeller: n was never below 0, so crash stops rest on the prior alone")
    if "n" in envelope and envelope["n"][1] - envelope["n"][0] < 0.05 * largest["n"]:
        bad.append("other revolutions: n hardly changed, so thrust and resistance are not told apart")
    if DRIFT in envelope and largest[DRIFT] < np.radians(30):
        bad.append(f"berthing and cross flow: drift angles beyond {DEGREES * largest[DRIFT]:.0f} deg were not seen")
    for name in RUDDERS:
        if name in envelope and largest[name] < np.radians(34):
            bad.append(f"hard-over rudder: {name} stayed within {DEGREES * largest[name]:.0f} deg, without stall")
    return bad


def _not_modelled(ship: Ship, windy: bool) -> list[str]:
    """Uses that the force models and effects of the ``ship`` rule out."""
    bad = []
    if not ship.feels_wind:
        bad.append("wind: the model has no wind forces")
    elif not windy:
        bad.append("wind: the trials log none, so its forces are those of the model's regression")
    if not {"shallow_water", "bank"} & set(ship.effects):
        bad.append("shallow water, banks, locks and passing ships: the model knows none of them")
    if "waves" not in ship.components:
        bad.append("waves: the model has no wave forces")
    place = [name for name in ship.effects if effect(name).surroundings]
    if place:
        words = f"other places and days with the effects as fitted ({', '.join(place)})"
        bad.append(f"{words}: they belong to the trials, set them to 0")
    if ship.network is not None:
        bad.append("states outside the network's training range: the residual is bounded there, not supported")
    return bad
