"""Terms of a ship whose propellers and rudders act as units, each of which adds a force of its own.

A unit is a propeller with the rudder in its race. No term multiplies actuators of two units: forces of units add up,
as in the MMG model. A term is a product of motions by one of the actions of a unit; of two units that mirror each other
the mean or the half difference of the action, so that both share a coefficient. Beside them stand the terms of the hull
alone. The actions are those of thrust and of a rudder in a race: n, n |n| by 1, cos, sin, sin cos, sin^2 of the angle.
"""

from __future__ import annotations

from collections.abc import Sequence

from mmg.components.expansion.actuators import Device
from mmg.components.expansion.words import Monomial, Word, parse_monomial

Unit = tuple[str, str]
"""Revolutions and angle of a propeller and its rudder, "" for none."""

# Products of motions up to third degree, cross-flow drag among them.
HULL = (
    "u", "v", "r", "u |u|", "u u", "u v", "u r", "|u| v", "|u| r", "v |v|", "v |r|", "r |v|", "r |r|", "v v", "v r",
    "r r", "u v v", "u v r", "u r r", "u u u", "v v v", "v v r", "v r r", "r r r", "u v |v|", "u v |r|",
)  # fmt: skip
_SCREWS = (("", 0), ("n", 1), ("thrust", 2))
_ANGLES = ((), ("cos",), ("sin",), ("sin", "cos"), ("sin", "sin"))


def units_of(devices: Sequence[Device]) -> tuple[Unit, ...]:
    """The one unit on the centre plane or the two that mirror each other, starboard first, of a list of ``devices``.

    Empty where the list has other actuators than one or two propellers and one or two rudders, or no propeller.
    """
    names = {name for device in devices for name in device.names}
    rudders = {"delta", "delta_starboard", "delta_port"} & names
    if "n" not in names or names - rudders - {"n", "n_2"}:
        return ()
    if "delta" in rudders:
        return () if len(rudders) > 1 or "n_2" in names else (("n", "delta"),)
    if len(rudders) == 1:
        return ()
    starboard, port = ("delta_starboard", "delta_port") if rudders else ("", "")
    other = "n_2" if "n_2" in names else "n"
    return (("n", starboard),) if (other, port) == ("n", starboard) else (("n", starboard), (other, port))


def unit_monomials(units: Sequence[Unit], order: int, force: str) -> tuple[Monomial, ...]:
    """The terms of ``force`` ("X", "Y" or "N") of a hull with ``units``, motions and actions to ``order`` together."""
    sideways = force != "X"
    names = [motion for motion in HULL if _degree(motion) <= order and _turns(motion) == sideways]
    motions = ("", *(motion for motion in HULL if _degree(motion) <= 2))  # an action by cubes of motions tells no more
    for screw, degree in _SCREWS:
        for angle in _ANGLES if units[0][1] else _ANGLES[:1]:
            action_odd = angle.count("sin") % 2 == 1
            for motion in motions if screw or angle else ():
                if _degree(motion) + degree + len(angle) > order:
                    continue
                for word, word_odd in _both([_action(unit, screw, angle) for unit in units], action_odd):
                    if (_turns(motion) != word_odd) == sideways:
                        names.append(f"{motion} {word}".strip())
    return tuple(map(parse_monomial, names))


def _action(unit: Unit, screw: str, angle: Sequence[str]) -> Word:
    revolutions, rudder = Word(unit[0]), Word(unit[1])
    parts = [] if not screw else [revolutions if screw == "n" else Word("thrust", (revolutions,))]
    parts += [Word(name, (rudder,)) for name in angle]
    return Word("times", tuple(parts)) if len(parts) > 1 else parts[0]


def _both(actions: Sequence[Word], mirrored: bool) -> list[tuple[Word, bool]]:
    """Words for the actions of all units, and whether they change their sign under reflection."""
    if len(set(actions)) == 1:
        return [(actions[0], mirrored)]
    return [(Word("mean", tuple(actions)), mirrored), (Word("half", tuple(actions)), not mirrored)]


def _degree(motion: str) -> int:
    return len(motion.split())


def _turns(motion: str) -> bool:
    return sum(factor in ("v", "r") for factor in motion.split()) % 2 == 1
