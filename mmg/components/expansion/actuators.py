"""Lists of actuators and the variables of an expansion that follow from them.

A list is written as ``n, delta_port, delta_starboard``: each word is an actuator of a trial file. ``a+b`` are two that
mirror each other in the centre plane, whose variables become mean and half difference. A pod is named by its angle
(``azimuth_2``) and brings its revolutions along. Under the reflection of the ship in its centre plane a variable is
even (stays) or odd (changes its sign): u, revolutions, cosines are even, v, r, sines and tunnel thrusters are odd.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mmg.components.expansion.words import Word
from mmg.errors import BadValue, Conflict, Missing, UnknownName
from mmg.motion.flow import INPUTS

TUNNELS = ("n_bow", "n_stern")  # Revolutions that push sideways
# Actuators off the centre plane -> their partner on the other side.
MIRRORED = {"delta_starboard": "delta_port", "n": "n_2"}


@dataclass(frozen=True)
class Device:
    """One actuator of a list, or two that mirror each other: names of INPUTS (a pod by its angle)."""

    names: tuple[str, ...]

    def __str__(self) -> str:
        return "+".join(self.names)


@dataclass(frozen=True)
class ExpansionVariable:
    """One variable of an expansion: how it is written, whether it is odd, and which part of an angle it is.

    angle: name of the angle or pair, "" for none; part: "cos", "sin", of pairs also "half cos", "half sin".
    """

    word: Word
    odd: bool
    angle: str = ""
    part: str = ""


def parse_devices(text: str) -> tuple[Device, ...]:
    """The list of actuators in ``text``, such as "n, delta_starboard+delta_port".

    Raises UserError for a name that is no actuator, one that is given twice, and partners of different kinds.
    """
    devices = [Device(tuple(name.strip() for name in item.split("+"))) for item in text.split(",") if item.strip()]
    text, given = _shown(text), Counter(name for device in devices for name in device.names)
    for name in given:
        if name not in INPUTS or name == "pitch":
            raise UnknownName(
                f"actuators '{text}': '{_shown(name)}' is none; known: {', '.join(n for n in INPUTS if n != 'pitch')}"
            )
        if name.startswith("n_azimuth"):
            raise BadValue(f"actuators '{text}': name a pod by its angle, {name.removeprefix('n_')}")
        if given[name] > 1:
            raise Conflict(f"actuators '{text}': {name} is given {given[name]} times")
    for device in devices:
        kinds = {(INPUTS[name][1], name in TUNNELS, _is_pod(name)) for name in device.names}
        if len(device.names) > 2 or len(kinds) > 1:
            raise Conflict(f"actuators '{text}': {device} are no two of a kind that can mirror each other")
    if not devices:
        raise Missing("actuators: the list is empty; name at least one, such as n")
    return tuple(devices)


def _shown(text: str) -> str:
    """The ``text``, of a longer one its beginning."""
    return text if len(text) <= 100 else f"{text[:90]} ..."


def devices_of(inputs: Sequence[str], particulars: Mapping[str, float]) -> tuple[Device, ...]:
    """The list of a ship's actuators: propellers and pods that mirror each other in pairs, rudders one by one.

    inputs: names of its actuators; particulars: SI, where the pods are. As Miyauchi et al. (2023) do, two rudders
    behind one propeller are two devices. Blade angles are left out.
    """
    remaining = [name for name in inputs if not name.startswith("n_azimuth") and name != "pitch"]
    devices: list[Device] = []
    while remaining:
        name = remaining.pop(0)
        # of MIRRORED the propellers alone: rudders stay single
        partner = MIRRORED.get(name) if name == "n" else _mirrored_pod(name, remaining, particulars)
        if partner in remaining:
            remaining.remove(str(partner))
            devices.append(Device((name, str(partner))))
        else:
            devices.append(Device((name,)))
    return tuple(devices)


def without_partner(devices: Sequence[Device], particulars: Mapping[str, float]) -> list[str]:
    """Actuators of a list of ``devices`` that lie off the centre plane and whose partner on the other side is missing.

    particulars: SI, where the pods of the ship are (y_az, ...); a second or later pod of which that is not known counts
    as off the plane.
    """
    single = [device.names[0] for device in devices if len(device.names) == 1]
    both = MIRRORED | {other: name for name, other in MIRRORED.items()}
    lonely = [name for name in single if name in ("delta_port", "delta_starboard", "n_2") and both[name] not in single]
    lonely += [name for name in single if name == "n_2" and "n" in single]  # two propellers must stand as a pair
    return lonely + [name for name in single if _is_pod(name) and _pod_place(name, particulars)[1] != 0.0]


def variables(devices: Sequence[Device]) -> tuple[ExpansionVariable, ...]:
    """The variables of an expansion: motion, then those of each of the ``devices``; even before odd ones."""
    expansion_variables = [ExpansionVariable(Word(name), name != "u") for name in ("u", "v", "r")]
    for device in devices:
        several = [_single(name) for name in device.names]
        if len(several) == 1:
            expansion_variables += several[0]
            continue
        for one, other in zip(*several, strict=True):
            words = (one.word, other.word)
            expansion_variables.append(ExpansionVariable(Word("mean", words), one.odd, one.angle, one.part))
            half = f"half {one.part}" if one.part else ""
            # reflection exchanges the two sides: the mean keeps the parity of one, the half difference changes it
            expansion_variables.append(ExpansionVariable(Word("half", words), not one.odd, one.angle, half))
    return tuple(sorted(expansion_variables, key=lambda variable: variable.odd))


def _single(name: str) -> list[ExpansionVariable]:
    word = Word(name)
    if _is_pod(name):
        words = (Word(f"n_{name}"), word)
        return [ExpansionVariable(Word("push", words), False), ExpansionVariable(Word("side", words), True)]
    if INPUTS[name][1] == "rps":
        return [ExpansionVariable(word, name in TUNNELS)]
    return [
        ExpansionVariable(Word("cos", (word,)), False, name, "cos"),
        ExpansionVariable(Word("sin", (word,)), True, name, "sin"),
    ]


def _is_pod(name: str) -> bool:
    return name.startswith("azimuth")


def _pod_place(name: str, particulars: Mapping[str, float]) -> tuple[float, float]:
    """(x, y) [m] of a pod; y is 0 for the first and 1 for a later one where it is not known."""
    suffix = name.removeprefix("azimuth")
    return particulars.get(f"x_az{suffix}", 0.0), particulars.get(f"y_az{suffix}", 1.0 if suffix else 0.0)


def _mirrored_pod(name: str, others: Sequence[str], particulars: Mapping[str, float]) -> str | None:
    """The pod among ``others`` that is the mirror image of the pod ``name``."""
    if not _is_pod(name):
        return None
    x, y = _pod_place(name, particulars)
    images = [other for other in others if _is_pod(other) and _pod_place(other, particulars) == (x, -y)]
    return images[0] if images and y != 0 else None
