"""Effects that a gap between model and trial may consist of: one file each, one object each.

An effect is switched on by the synthetic generator, freed by a fit and screened by the diagnosis. EFFECTS lists them
in the order in which they enter the model; adding one is adding its file and its line here. Those that a user
registers follow them.
"""

from collections import UserDict
from collections.abc import Iterator, MutableMapping
from importlib import import_module
from typing import Any

from mmg.components.own import load_plug_ins
from mmg.effects.effect import Effect, Parameter


class _EffectsByName(UserDict[str, Any]):
    """Effects by name; the file of one is read when it is first looked up, as a model has few of them."""

    def __getitem__(self, name: str) -> Effect:
        if self.data[name] is None:
            kind = name.title().replace("_", "")  # gnss_delay: the class GnssDelay of gnss_delay.py
            self.data[name] = getattr(import_module(f"mmg.effects.{name}"), kind)()
        return self.data[name]  # type: ignore[no-any-return]

    def __contains__(self, name: object) -> bool:
        if name not in self.data:  # plug-ins are imported for an unknown name alone
            load_plug_ins()
        return name in self.data

    def __iter__(self) -> Iterator[str]:
        load_plug_ins()
        return iter(self.data)


EFFECTS: MutableMapping[str, Effect] = _EffectsByName(
    dict.fromkeys(
        (
            "draft", "current", "wind_sensor_bias", "control_delay", "rudder_lag", "rudder_backlash", "rudder_offset",
            "wind_force", "propeller_side_force", "rudder_stall", "fouling", "shallow_water", "hull_memory", "bank",
            "wave_drift", "tow", "antenna_offset", "gnss_delay", "velocity_filter", "heading_bias", "log_scale", "gyro",
        )
    )
)  # fmt: skip

# Names of effects in files and options of earlier releases, and what they are called now.
FORMER = {"velocity_lag": "velocity_filter"}
GONE = ("disturbance",)  # Effects of earlier releases without which a ship moves as with them


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
