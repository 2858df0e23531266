"""Effects that a gap between model and trial may consist of: one file each, one object each.

An effect is switched on by the synthetic generator, freed by a fit and screened by the diagnosis. EFFECTS lists them
in the order in which they enter the model; adding one is adding its file and its line here.
"""

from typing import Any

from mmg.effects.antenna_offset import AntennaOffset
from mmg.effects.bank import Bank
from mmg.effects.control_delay import ControlDelay
from mmg.effects.current import Current
from mmg.effects.draft import Draft
from mmg.effects.effect import Effect, Parameter
from mmg.effects.fouling import Fouling
from mmg.effects.gnss_delay import GnssDelay
from mmg.effects.gyro import Gyro
from mmg.effects.heading_bias import HeadingBias
from mmg.effects.hull_memory import HullMemory
from mmg.effects.log_scale import LogScale
from mmg.effects.propeller_side_force import PropellerSideForce
from mmg.effects.rudder_backlash import RudderBacklash
from mmg.effects.rudder_lag import RudderLag
from mmg.effects.rudder_offset import RudderOffset
from mmg.effects.rudder_stall import RudderStall
from mmg.effects.shallow_water import ShallowWater
from mmg.effects.tow import Tow
from mmg.effects.velocity_filter import VelocityFilter
from mmg.effects.wave_drift import WaveDrift
from mmg.effects.wind_force import WindForce
from mmg.effects.wind_sensor_bias import WindSensorBias

EFFECTS: dict[str, Effect] = {
    kind.name: kind()
    for kind in (
        Draft, Current, WindSensorBias, ControlDelay, RudderLag, RudderBacklash, RudderOffset,
        WindForce, PropellerSideForce, RudderStall, Fouling, ShallowWater, HullMemory, Bank, WaveDrift, Tow,
        AntennaOffset, GnssDelay, VelocityFilter, HeadingBias, LogScale, Gyro,
    )
}  # fmt: skip

FORMER = {"velocity_lag": "velocity_filter"}
"""Names of effects in files and options of earlier releases, and what they are called now."""
GONE = ("disturbance",)
"""Effects of earlier releases without which a ship moves as with them."""


def present_name(name: str) -> str:
    """What an effect, or its coefficient, of an earlier ``name`` is called now; every other name as it is."""
    effect_name, dot, parameter = name.partition(".")
    return FORMER.get(effect_name, effect_name) + dot + parameter


def with_present_names(content: Any) -> Any:
    """The ``content`` of a JSON file with effects and their coefficients as they are called now, in keys and texts."""
    if isinstance(content, dict):
        return {present_name(key): with_present_names(value) for key, value in content.items()}
    if isinstance(content, list):
        return [with_present_names(value) for value in content]
    return present_name(content) if isinstance(content, str) else content


def effect(name: str) -> Effect:
    """The effect of this name; KeyError with the choices if there is none."""
    if name not in EFFECTS:
        raise KeyError(f"effect {name!r} is unknown; known: {', '.join(sorted(EFFECTS))}")
    return EFFECTS[name]


__all__ = ["EFFECTS", "GONE", "Effect", "Parameter", "effect", "present_name", "with_present_names"]
