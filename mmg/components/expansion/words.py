"""The words of a monomial, such as ``ahead u |v| sin(delta_port)``: how they are written, read and checked.

A factor is a variable, or a variable between bars for its modulus:
 u, v, r               velocity through the water, by V, V and V/L
 n, n_2, n_bow, ...    revolutions, by 50 V/L
 delta, azimuth, ...   an angle [rad]; sin(delta), cos(delta)
 push(n, a), side(n, a)   n |n| cos a, n |n| sin a: the thrust of a pod ahead and to starboard
 mean(x, y), half(x, y)   (x + y)/2 and (x - y)/2 of two variables of actuators that mirror each other
with V = 0.1 sqrt(g L). A condition multiplies the term by 1 where it holds and by 0 elsewhere:
 ahead, astern                       u >= 0, u < 0
 driving(n), reversing(n)            n >= 0, n < 0 (of several: their mean)
 attached(delta), stalled(delta)     no angle beyond delta_stall in magnitude, one or more beyond it
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from mmg.motion.flow import INPUTS

MOTION = ("u", "v", "r")
# Words that are no factors but say where a term acts.
CONDITIONS = ("ahead", "astern", "driving", "reversing", "attached", "stalled")

# Function -> kinds of its arguments: revolutions, an angle, or any variable of actuators; of conditions the one kind.
_ARGUMENTS = {
    "sin": ("rad",), "cos": ("rad",), "push": ("rps", "rad"), "side": ("rps", "rad"),
    "mean": ("any", "any"), "half": ("any", "any"),
}  # fmt: skip
_OF = {"driving": "rps", "reversing": "rps", "attached": "rad", "stalled": "rad"}
# Words as parts of the symbol of a coefficient, which every file of a generated ship holds.
_SHORT = {"delta_starboard": "ds", "delta_port": "dp", "delta": "d", "azimuth": "a", "mean": "m", "half": "h",
          "sin": "s", "cos": "c", "push": "px", "side": "py", "n_azimuth": "na", "n_bow": "nb",
          "n_stern": "ns"}  # fmt: skip


@dataclass(frozen=True)
class Word:
    """A variable or a condition: its name and, of a function, the words between the brackets."""

    name: str
    parts: tuple[Word, ...] = ()

    def __str__(self) -> str:
        return f"{self.name}({','.join(map(str, self.parts))})" if self.parts else self.name

    @property
    def inputs(self) -> frozenset[str]:
        """Actuators that it depends on."""
        input_names = {self.name} if self.name in INPUTS and not self.parts else set[str]()
        return frozenset(input_names).union(*(part.inputs for part in self.parts))

    @property
    def short(self) -> str:
        """The word as a part of the symbol of a coefficient: letters and digits."""
        stem, _, number = self.name.rpartition("_")
        name = _SHORT.get(self.name) or (_SHORT.get(stem, stem) + number if number.isdigit() else self.name)
        return name.replace("_", "") + "".join(part.short for part in self.parts)


@dataclass(frozen=True)
class Monomial:
    """A product: conditions, and factors with whether the modulus is taken."""

    conditions: tuple[Word, ...]
    factors: tuple[tuple[Word, bool], ...]

    def __str__(self) -> str:
        return " ".join([*map(str, self.conditions), *(f"|{w}|" if bars else str(w) for w, bars in self.factors)])

    @property
    def inputs(self) -> frozenset[str]:
        """Actuators that it depends on."""
        return frozenset[str]().union(*(w.inputs for w in (*self.conditions, *(word for word, _ in self.factors))))

    @property
    def short(self) -> str:
        """The factors as a part of a symbol: ``u_absv_sdp`` of "u |v| sin(delta_port)"."""
        return "_".join(f"abs{w.short}" if bars else w.short for w, bars in self.factors)


@lru_cache(maxsize=8192)
def parse_monomial(text: str) -> Monomial:
    """The monomial that ``text`` says. Raises ValueError, whose text says what is wrong with it."""
    words = re.sub(r"\s*([(,])\s*|\s+(\))", r"\1\2", text.strip()).split()  # no blanks inside of brackets
    if not words:
        raise ValueError("is empty; write factors such as u |v| sin(delta)")
    conditions: list[Word] = []
    factors: list[tuple[Word, bool]] = []
    for token in words:
        bars = len(token) > 2 and token[0] == token[-1] == "|"
        word = parse_word(token[1:-1] if bars else token)
        if word.name in CONDITIONS:
            _check_condition(word, bars)
            conditions.append(word)
        else:
            _check_variable(word)
            factors.append((word, bars))
    if not factors:
        raise ValueError("has conditions but no factor; write factors such as u |v| sin(delta)")
    return Monomial(tuple(conditions), tuple(factors))


def parse_word(text: str) -> Word:
    """The word that ``text`` spells, such as "cos(delta)". Raises ValueError for anything else."""
    match = re.fullmatch(r"([A-Za-z]\w*)(?:\((.*)\))?", text)
    if match is None:
        raise ValueError(f"'{text}' is no variable; known are {_choices()}")
    inside = match[2]
    if inside is None:
        return Word(match[1])
    parts, depth, start = [], 0, 0
    for i, character in enumerate(inside + ","):  # a comma outside of inner brackets ends an argument
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append(parse_word(inside[start:i]))
            start = i + 1
    if depth != 0 or start != len(inside) + 1:
        raise ValueError(f"'{text}' is no variable: its brackets do not match")
    return Word(match[1], tuple(parts))


def _choices() -> str:
    return f"{', '.join((*MOTION, *INPUTS))} and {', '.join(_ARGUMENTS)} of these"


def _check_condition(word: Word, bars: bool) -> None:
    unit = _OF.get(word.name)
    right = bool(word.parts) == (unit is not None)
    if bars or not right or any(INPUTS.get(part.name, ("", ""))[1] != unit or part.parts for part in word.parts):
        of = {"rps": "(n)", "rad": "(delta)"}.get(unit or "", "")
        raise ValueError(f"'{word}' is no condition; write {word.name}{of}")


def _check_variable(word: Word) -> None:
    if not word.parts:
        if word.name not in (*MOTION, *INPUTS):
            raise ValueError(f"'{word}' is no variable; known are {_choices()}")
        return
    wanted = _ARGUMENTS.get(word.name)
    if wanted is None or len(wanted) != len(word.parts):
        raise ValueError(f"'{word}' is no variable; known are {_choices()}")
    for unit, part in zip(wanted, word.parts, strict=True):
        if unit == "any":
            _check_variable(part)
            if part.name in ("mean", "half", *MOTION):
                raise ValueError(f"'{word}': {word.name} is of two variables of actuators")
        elif part.parts or INPUTS.get(part.name, ("", ""))[1] != unit:
            kind = "revolutions" if unit == "rps" else "an angle"
            raise ValueError(f"'{word}': {part} is not {kind} of an actuator")
