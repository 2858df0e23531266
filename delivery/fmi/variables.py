"""The variables of an FMU, of a ship or of a filter that follows one, and their units: one table, from which both model
descriptions and the tables of the C code are written."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from delivery.c.tracker import TrackedShip
from delivery.fmi.ship import TIME, WATER, CoSimulatedShip
from delivery.product import QUANTITIES, ProductCoefficient, plain_unit, unit_of
from mmg.motion.flow import PROPELLERS, RUDDERS, STATES
from mmg.motion.froude import time_scale
from mmg.ship import AIR

# Unit -> unit for people, and its value for one of the unit.
SHOWN = {
    "rad": ("deg", 180 / math.pi),
    "rad/s": ("deg/s", 180 / math.pi),
    "m/s": ("kn", 3600 / 1852),
    "1/s": ("rpm", 60.0),
}
# Axes of the outputs, in the order of enum FmuOutput of fmu-instance.h: all six, as partners of other tools have them.
POSITION = ("north", "east", "down", "roll", "pitch", "yaw")
VELOCITY = ("surge", "sway", "heave", "roll", "pitch", "yaw")
MEDIA = {"wind": "air", "current": "water"}
HORIZON = 60.0  # Seconds ahead of a forecast of a 3 m model, unless it is set: those of ``benchmarks.tracker``
TRUST = "how far state and inputs lie outside what the trials held; 0 inside, -1 where that is not known"
FORCE = {"X": ("N", "force ahead"), "Y": ("N", "force to starboard"), "N": ("N.m", "moment about midship")}


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


def _begin(actuators: Sequence[str], media: Mapping[str, tuple[float, float]]) -> list[FmuVariable]:
    """The time, ``actuators``, and the velocities north and east of ``media``, which start at these values [m/s]."""
    rows = [FmuVariable("time", "independent", "s", "time")]
    for name in actuators:
        words, unit = QUANTITIES[name]
        rows.append(FmuVariable(input_name(name), "input", plain_unit(unit), f"{words}; held over a step", 0.0))
    for name, starts in media.items():
        for axis, start in zip(("north", "east"), starts, strict=True):
            words = f"velocity of the {MEDIA[name]} over ground towards {axis}; held over a step"
            rows.append(FmuVariable(f"{name}_velocity.{axis}", "input", "m/s", words, start))
    return rows


def _numbered(rows: Sequence[FmuVariable], actuators: int, inputs: int, parameters: int) -> VariableTable:
    """The table of ``rows``, whose value references are their places: the C code counts on it."""
    return VariableTable(tuple(replace(row, reference=i) for i, row in enumerate(rows)), actuators, inputs, parameters)


def variable_table(ship: CoSimulatedShip) -> VariableTable:
    """The variables of ``ship``, in the order of fmu-instance.h."""
    actuators = [name for name in ship.model.controls if name not in (*AIR, *WATER, TIME)]
    parameters = (*ship.coefficients, *ship.delays)
    rows = _begin(actuators, {"wind": (0.0, 0.0), "current": ship.water})
    for state in STATES:
        words = f"{QUANTITIES[state][0]}, at the start"
        rows.append(FmuVariable(f"initial.{state}", "parameter", unit_of(state), words, 0.0, "fixed"))
    rows += [coefficient_row(c) for c in parameters] + _outputs(ship)
    words = "whether the ship moves inside what the trials held, that is extrapolation = 0"
    rows.append(FmuVariable("valid", "output", None, words, variability="discrete"))
    return _numbered(rows, len(actuators), len(actuators) + 4, len(parameters))


def tracker_table(ship: TrackedShip) -> VariableTable:
    """The variables of a filter of ``ship``, in the order of fmu-instance.h."""
    actuators = [name for name in ship.model.controls if name not in (*AIR, TIME)]
    rows = _begin(actuators, {"wind": (0.0, 0.0)})
    for state in STATES:
        words = f"{QUANTITIES[state][0]}, as logged at the begin of a step; NaN where there is no new measurement"
        rows.append(FmuVariable(f"measured.{state}", "input", unit_of(state), words, math.nan))
    seconds = HORIZON * time_scale(ship.ship.particulars["L"])
    words = "how far ahead forecast.* lies; the controls are held"
    horizon = FmuVariable("horizon", "parameter", "s", words, seconds, "tunable", 1e-3)  # no forecast of no time
    parameters = [*map(coefficient_row, ship.coefficients), *_filter_noise(ship), horizon]
    rows += parameters + _filter_outputs(ship)
    words = "whether the filter has begun and the ship moves inside what the trials held"
    rows.append(FmuVariable("valid", "output", None, words, variability="discrete"))
    return _numbered(rows, len(actuators), len(actuators) + 2, len(parameters))


def coefficient_row(c: ProductCoefficient) -> FmuVariable:
    """The tunable parameter of a coefficient ``c``; its words say how well it is known."""
    words = [c.description or c.symbol]
    if not c.unit:
        words.append("dimensionless")
    words.append(f"std {c.std:.3g}" if c.std is not None else "fixed" if c.fixed else "std not known")
    words += [c.verdict] if c.verdict else ["not determined by trials"]
    lower, upper = min(c.lower, c.value), max(c.upper, c.value)  # FMI wants the start value within the bounds
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


def _unit(ship: TrackedShip, name: str) -> str:
    """Unit of a state or of a coefficient."""
    return unit_of(name) or plain_unit(ship.ship.coefficients[name].unit)


def _filter_noise(ship: TrackedShip) -> list[FmuVariable]:
    """Parameters in the order of the noise of the C code."""
    random, rows = ship.random, []
    for name, size in zip(random.names, random.sizes, strict=True):
        rows.append((f"noise.{name}", _unit(ship, name), f"standard deviation of the random state {name}", size))
    for name, memory in zip(random.names, random.memories, strict=True):
        time = memory if math.isfinite(memory) else 0.0  # infinite: a coefficient, which does not fade
        rows.append((f"memory.{name}", "s", f"time in which {name} fades; 0: it does not", time))
    for state, size in zip(STATES, ship.noise.sensors, strict=True):
        rows.append((f"noise.{state}", unit_of(state), f"standard deviation of the errors of logged {state}", size))
    rows.append(("noise.interval", "s", "samples nearer than this share their errors", ship.noise.interval))
    return [FmuVariable(name, "parameter", unit, words, float(x), "tunable", 0.0) for name, unit, words, x in rows]


def _filter_outputs(ship: TrackedShip) -> list[FmuVariable]:
    names, rows = (*STATES, *ship.random.names), []
    for kind, words in (("estimate", "from all samples before"), ("std", "standard deviation of the estimate")):
        rows += [(f"{kind}.{name}", _unit(ship, name), f"{name}: {words}") for name in names]
    rows.append(("nis", "", "squared distance of the last sample from what was expected of it: chi-square"))
    rows.append(("compared", "", "numbers of the last sample that were compared: the degrees of freedom of nis"))
    for kind, words in (("forecast", "as it will be logged"), ("forecast_std", "standard deviation of the forecast")):
        rows += [(f"{kind}.{state}", unit_of(state), f"{state} after the horizon: {words}") for state in STATES]
    rows.append(("extrapolation", "", TRUST))
    return [FmuVariable(name, "output", unit, words) for name, unit, words in rows]
