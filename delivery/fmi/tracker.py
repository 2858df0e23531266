"""The variables of ``mmg export --format fmu-tracker``: a filter that follows a ship, in co-simulation."""

from __future__ import annotations

import math
from dataclasses import replace

from delivery.c.tracker import TrackedShip
from delivery.fmi.ship import TIME
from delivery.fmi.variables import FmuVariable, VariableTable, coefficient_row, input_name, plain_unit
from delivery.product import QUANTITIES, unit_of
from mmg.motion.froude import time_scale
from mmg.ship import AIR
from mmg.states import STATES

HORIZON = 60.0  # Seconds ahead of a forecast of a 3 m model, unless it is set: those of ``benchmarks.tracker``
TRUST = "how far state and inputs lie outside what the trials held; 0 inside, -1 where that is not known"


def tracker_table(ship: TrackedShip) -> VariableTable:
    """The variables of a filter of ``ship``, in the order of enum FmuOutput of fmu-instance.h."""
    actuators = [name for name in ship.model.controls if name not in (*AIR, TIME)]
    rows = [FmuVariable("time", "independent", "s", "time")]
    for name in actuators:
        words, unit = QUANTITIES[name]
        rows.append(FmuVariable(input_name(name), "input", plain_unit(unit), f"{words}; held over a step", 0.0))
    for axis in ("north", "east"):
        words = f"velocity of the air over ground towards {axis}; held over a step"
        rows.append(FmuVariable(f"wind_velocity.{axis}", "input", "m/s", words, 0.0))
    for state in STATES:
        words = f"{QUANTITIES[state][0]}, as logged at the begin of a step; NaN where there is no new measurement"
        rows.append(FmuVariable(f"measured.{state}", "input", unit_of(state), words, math.nan))
    parameters = [*map(coefficient_row, ship.coefficients), *_noise(ship)]
    seconds = HORIZON * time_scale(ship.ship.particulars["L"])
    words = "how far ahead forecast.* lies; the controls are held"
    parameters.append(FmuVariable("horizon", "parameter", "s", words, seconds, "tunable", 1e-3))
    rows += parameters + _outputs(ship)
    words = "whether the filter has begun and the ship moves inside what the trials held"
    rows.append(FmuVariable("valid", "output", None, words, variability="discrete"))
    numbered = tuple(replace(row, reference=i) for i, row in enumerate(rows))
    return VariableTable(numbered, len(actuators), len(actuators) + 2, len(parameters))


def _unit(ship: TrackedShip, name: str) -> str:
    """Unit of a state or of a coefficient."""
    return unit_of(name) or plain_unit(ship.ship.coefficients[name].unit)


def _noise(ship: TrackedShip) -> list[FmuVariable]:
    """Parameters in the order of the noise of the C code."""
    random, rows = ship.random, []
    for name, size in zip(random.names, random.sizes, strict=True):
        rows.append((f"noise.{name}", _unit(ship, name), f"standard deviation of the random state {name}", size))
    for name, memory in zip(random.names, random.memories, strict=True):
        time = memory if math.isfinite(memory) else 0.0
        rows.append((f"memory.{name}", "s", f"time in which {name} fades; 0: it does not", time))
    for state, size in zip(STATES, ship.noise.sensors, strict=True):
        rows.append((f"noise.{state}", unit_of(state), f"standard deviation of the errors of logged {state}", size))
    rows.append(("noise.interval", "s", "samples nearer than this share their errors", ship.noise.interval))
    return [FmuVariable(name, "parameter", unit, words, float(x), "tunable", 0.0) for name, unit, words, x in rows]


def _outputs(ship: TrackedShip) -> list[FmuVariable]:
    names, rows = (*STATES, *ship.random.names), []
    for kind, words in (("estimate", "from all samples before"), ("std", "standard deviation of the estimate")):
        rows += [(f"{kind}.{name}", _unit(ship, name), f"{name}: {words}") for name in names]
    rows.append(("nis", "", "squared distance of the last sample from what was expected of it: chi-square"))
    rows.append(("compared", "", "numbers of the last sample that were compared: the degrees of freedom of nis"))
    for kind, words in (("forecast", "as it will be logged"), ("forecast_std", "standard deviation of the forecast")):
        rows += [(f"{kind}.{state}", unit_of(state), f"{state} after the horizon: {words}") for state in STATES]
    rows.append(("extrapolation", "", TRUST))
    return [FmuVariable(name, "output", unit, words) for name, unit, words in rows]
