"""The variables of an FMU and their units: one table, from which both model descriptions and the tables of the C code
are written."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from delivery.fmi.ship import TIME, WATER, CoSimulatedShip
from delivery.product import QUANTITIES, ProductCoefficient, unit_of
from mmg.motion.flow import PROPELLERS, RUDDERS
from mmg.ship import AIR
from mmg.states import STATES

# Exponents of the units that a ship file may name, alone or as products.
BASES = {"kg": {"kg": 1}, "m": {"m": 1}, "s": {"s": 1}, "rad": {"rad": 1}, "N": {"kg": 1, "m": 1, "s": -2}}
# Unit -> unit for people, and its value for one of the unit.
SHOWN = {
    "rad": ("deg", 180 / math.pi),
    "rad/s": ("deg/s", 180 / math.pi),
    "m/s": ("kn", 3600 / 1852),
    "1/s": ("rpm", 60.0),
}
_PLAIN = str.maketrans({"²": "2", "³": "3", "^": "", "·": "."})
POSITION = ("north", "east", "down", "roll", "pitch", "yaw")
VELOCITY = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FORCE = {"X": ("N", "force ahead"), "Y": ("N", "force to starboard"), "N": ("N.m", "moment about midship")}


def plain_unit(unit: str) -> str:
    """Name of the ``unit`` of a ship file in FMI: "rps" becomes "1/s", "m²" "m2"; "" stays."""
    return "1/s" if unit == "rps" else unit.translate(_PLAIN)


def exponents(unit: str) -> dict[str, int] | None:
    """Exponents of a plain ``unit`` in kg, m, s and rad, zeros left out; None for one that is not made of BASES."""
    powers: dict[str, int] = {}
    for place, part in enumerate(unit.split("/")):
        for word in re.split(r"[. ]+", part):
            match = re.fullmatch(r"([A-Za-z]+)(-?\d*)", word)
            if word == "1":
                continue
            if match is None or match[1] not in BASES:
                return None
            power = int(match[2] or 1) * (1 if place == 0 else -1)
            for base, n in BASES[match[1]].items():
                powers[base] = powers.get(base, 0) + n * power
    return {base: n for base, n in powers.items() if n}


@dataclass(frozen=True)
class FmuVariable:
    """A variable: real, or Boolean where ``unit`` is None.

    reference: value reference, the place in the table. causality: "independent", "input", "parameter", "output" or
    "local". variability: as FMI names it. start: where it begins, None where it is calculated. lower, upper: bounds
    that are stated, infinite for none.
    """

    name: str
    causality: str
    unit: str | None
    words: str
    start: float | None = None
    variability: str = "continuous"
    lower: float = -math.inf
    upper: float = math.inf
    reference: int = 0


@dataclass(frozen=True)
class VariableTable:
    """All variables in the order of their references, and the number of each kind that can be set: between the
    ``inputs``, of which the ``actuators`` come first, and the ``parameters`` are six more."""

    rows: tuple[FmuVariable, ...]
    actuators: int
    inputs: int
    parameters: int

    def of(self, causality: str) -> tuple[FmuVariable, ...]:
        """Those of one ``causality``."""
        return tuple(row for row in self.rows if row.causality == causality)


def input_name(actuator: str) -> str:
    """Name of the input of an ``actuator``: its role and its symbol, such as propeller.n or rudder.delta."""
    if actuator in RUDDERS:
        return f"rudder.{actuator}"
    return f"propeller.{actuator}" if actuator in (*PROPELLERS, "pitch") else f"thruster.{actuator}"


def variable_table(ship: CoSimulatedShip) -> VariableTable:
    """The variables of ``ship``."""
    actuators = [name for name in ship.model.controls if name not in (*AIR, *WATER, TIME)]
    parameters = (*ship.coefficients, *ship.delays)
    rows = [FmuVariable("time", "independent", "s", "time")]
    for name in actuators:
        words, unit = QUANTITIES[name]
        rows.append(FmuVariable(input_name(name), "input", plain_unit(unit), f"{words}; held over a step", 0.0))
    for what, of, starts in (("wind", "air", (0.0, 0.0)), ("current", "water", ship.water)):
        for axis, start in zip(("north", "east"), starts, strict=True):
            words = f"velocity of the {of} over ground towards {axis}; held over a step"
            rows.append(FmuVariable(f"{what}_velocity.{axis}", "input", "m/s", words, start))
    for state in STATES:
        words = f"{QUANTITIES[state][0]}, at the start"
        rows.append(FmuVariable(f"initial.{state}", "parameter", unit_of(state), words, 0.0, "fixed"))
    rows += [coefficient_row(c) for c in parameters] + _outputs(ship)
    words = "whether the ship moves inside what the trials held, that is extrapolation = 0"
    rows.append(FmuVariable("valid", "output", None, words, variability="discrete"))
    numbered = tuple(replace(row, reference=i) for i, row in enumerate(rows))
    return VariableTable(numbered, len(actuators), len(actuators) + 4, len(parameters))


def coefficient_row(c: ProductCoefficient) -> FmuVariable:
    """The tunable parameter of a coefficient ``c``; its words say how well it is known."""
    words = [c.description or c.symbol]
    if not c.unit:
        words.append("dimensionless")
    words.append(f"std {c.std:.3g}" if c.std is not None else "fixed" if c.fixed else "std not known")
    words += [c.verdict] if c.verdict else ["not determined by trials"]
    lower, upper = min(c.lower, c.value), max(c.upper, c.value)
    name, unit = f"coefficients.{c.symbol}", plain_unit(c.unit)
    return FmuVariable(name, "parameter", unit, "; ".join(words), c.value, "tunable", lower, upper)


def _outputs(ship: CoSimulatedShip) -> list[FmuVariable]:
    """What is calculated, in the order of enum FmuOutput of fmu-instance.h."""
    rows = []
    for axis, unit in zip(POSITION, ("m",) * 3 + ("rad",) * 3, strict=True):
        turned = {"yaw": "heading, clockwise from north, not wrapped", "roll": "roll angle, positive to starboard"}
        text = turned.get(axis, f"position of midship, {axis}" if unit == "m" else f"{axis} angle")
        rows.append(FmuVariable(f"ned_position.{axis}", "output", unit, text + _absent(axis, ship)))
    for axis, unit in zip(VELOCITY, ("m/s",) * 3 + ("rad/s",) * 3, strict=True):
        text = f"{axis} velocity of midship over ground" if unit == "m/s" else f"{axis} rate"
        rows.append(FmuVariable(f"body_velocity.{axis}", "output", unit, text + _absent(axis, ship)))
    near = "; its lateness is approximated" if ship.late_columns else ""
    for state in STATES:
        words = f"{QUANTITIES[state][0]}, as the ship's instruments log it{near}"
        rows.append(FmuVariable(f"logged.{state}", "output", unit_of(state), words))
    for role in ship.model.roles:
        for axis, (unit, words) in FORCE.items():
            rows.append(FmuVariable(f"force.{role}.{axis}", "output", unit, f"{words} of the part {role}, body axes"))
    for state in ship.model.states[6:]:
        rows.append(FmuVariable(f"memory.{state}", "local", unit_of(state), f"what the ship remembers: {state}"))
    words = "how far state and inputs lie outside what the trials held, over the width of that range; 0 inside"
    ranges = ", ".join(f"{name} {low:.4g} .. {high:.4g}" for name, (low, high) in ship.ranges.items())
    words += f" ({ranges})" if ranges else "; -1 as no record of the trials' range is known"
    rows.append(FmuVariable("extrapolation", "output", "", words))
    return rows


def _absent(axis: str, ship: CoSimulatedShip) -> str:
    """What is added to the words on an axis in which the ship does not move."""
    moving = axis not in ("down", "heave", "pitch") and not (axis == "roll" and "phi" not in ship.model.states)
    return "" if moving else "; always 0, the model has no such motion"
