"""Structures of generated polynomials: which monomials of which order in which sub-models, made by rules.

Monomials of all variables up to an order (Taylor's series about rest, without its constant), then
 A  symmetry: X keeps those of even degree in the odd variables, Y and N those of odd degree
 B  duplicates: what sin^2 + cos^2 = 1 makes of others is left out (DUPLICATES)
 C  modulus: squares become moduli (MODULI)
and the whole set once for each sub-model (SUBMODELS). Miyauchi et al. (2023), section 2.2. The lists of the paper are
not known term by term; the rule "paper" is one that gives its counts, 60 at second and 200 at third order of each
sub-model of a ship with one propeller and two rudders.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from mmg.components.coefficients import Coefficient
from mmg.components.expansion.actuators import Device, ExpansionVariable, variables
from mmg.components.expansion.words import Monomial, Word
from mmg.errors import OutOfRange, UnknownName, Unsupported

# paper: no squared cosine or sine, but in Y and N products of sines alone; identity: only what the identity of sine and
# cosine makes of others; none: all stay, and the coefficients are not determined.
DUPLICATES = ("paper", "identity", "none")
# paper: in a square or a product, x^2 of an even variable becomes x |x| and of an odd one |x| (pure squares of odd
# variables stay), x^3 alone stays; full: x^3 alone becomes x |x| too, and Y and N have v |v|, |v| r, v |r|, r |r|, the
# forms of cross-flow drag, from second order on; none: plain powers.
MODULI = ("paper", "full", "none")
# SM-1: one for all; SM-2: by the sign of u; SM-3: and ahead by the stall angle of the rudders; SM-4: by it astern too;
# quadrants: by the signs of u and of the revolutions.
SUBMODELS = ("SM-1", "SM-2", "SM-3", "SM-4", "quadrants")
MOST = 20000  # Most monomials of one force before the rules: a structure of more is refused. It bounds time and memory.

# Standard deviation of the prior of a coefficient by force: of terms that hold v or r, and of all others. The usual
# size of derivatives of the hull (MMG primes 0.02 to 1), and of rudder and propeller forces at harbour speed.
SIZES = {"X": (0.1, 0.03), "Y": (0.3, 0.05), "N": (0.1, 0.03)}
SOURCE = "generated term, prior about 0 by the usual size of such forces"
_WORDS = {"X": "surge force", "Y": "sway force", "N": "yaw moment"}

_STEADYING = (("X", "u"), ("Y", "v"), ("N", "r"))  # Force and motion of the terms that are a resistance

Powers = tuple[tuple[ExpansionVariable, int], ...]  # A monomial as variables with their powers


@dataclass(frozen=True)
class Structure:
    """What a generated polynomial consists of.

    devices: its actuators; order: highest degree; submodels: of SUBMODELS; symmetric: rule A; duplicates: of
    DUPLICATES; moduli: of MODULI. Raises UserError for a word that is none of these, an order below 1 and a sub-model
    whose actuator the list lacks.
    """

    devices: tuple[Device, ...]
    order: int = 2
    submodels: str = "SM-2"
    symmetric: bool = True
    duplicates: str = "paper"
    moduli: str = "paper"

    def __post_init__(self) -> None:
        for word, choices in ((self.submodels, SUBMODELS), (self.duplicates, DUPLICATES), (self.moduli, MODULI)):
            if word not in choices:
                raise UnknownName(f"'{word}': known are {', '.join(choices)}")
        if self.order < 1:
            raise OutOfRange(f"order {self.order}: must be at least 1")
        regimes(self)  # for its errors
        count = len(variables(self.devices))
        terms = math.comb(count + self.order, self.order) - 1  # monomials up to that degree but for the constant
        if terms > MOST:
            many = str(terms) if terms < 1e9 else f"{terms:.1e}"
            raise OutOfRange(
                f"order {self.order} of {count} variables has {many} monomials for each force, more than {MOST}; lower "
                "the order or shorten the list of actuators"
            )

    @property
    def words(self) -> str:
        """The structure in words: ``order 2, SM-2, actuators n, delta``."""
        unusual = [] if self.symmetric else ["asymmetric"]
        unusual += [f"duplicates {self.duplicates}"] if self.duplicates != "paper" else []
        unusual += [f"moduli {self.moduli}"] if self.moduli != "paper" else []
        return ", ".join(
            [f"order {self.order}", self.submodels, *unusual, f"actuators {' '.join(map(str, self.devices))}"]
        )


def regimes(structure: Structure) -> tuple[tuple[Word, ...], ...]:
    """Conditions of each sub-model of a ``structure``. Raises UserError where it lacks the actuator to switch by."""
    names = [name for device in structure.devices for name in device.names]
    rudders = tuple(Word(name) for name in names if name.startswith("delta"))
    screws = tuple(Word(name) for name in names if name in ("n", "n_2"))
    ahead, astern = Word("ahead"), Word("astern")
    if structure.submodels in ("SM-3", "SM-4"):
        if not rudders:
            raise Unsupported(
                f"{structure.submodels} switches at the stall angle of a rudder, and none of the {len(names)} "
                f"actuators is one ({', '.join(names)}); take SM-1 or SM-2"
            )
        attached, stalled = Word("attached", rudders), Word("stalled", rudders)
        aft = ((astern, attached), (astern, stalled)) if structure.submodels == "SM-4" else ((astern,),)
        return ((ahead, attached), (ahead, stalled), *aft)
    if structure.submodels == "quadrants":
        if not screws:
            raise Unsupported(
                f"quadrants switch by the revolutions of a propeller, and none of the {len(names)} actuators is one "
                f"({', '.join(names)}); take SM-1 or SM-2"
            )
        driving, reversing = Word("driving", screws), Word("reversing", screws)
        return ((ahead, driving), (ahead, reversing), (astern, driving), (astern, reversing))
    return ((),) if structure.submodels == "SM-1" else ((ahead,), (astern,))


def monomials(structure: Structure, force: str) -> tuple[Powers, ...]:
    """The monomials of ``force`` ("X", "Y" or "N") in one sub-model of a ``structure``, by order."""
    several = variables(structure.devices)
    products = []
    for degree in range(1, structure.order + 1):
        for product in itertools.combinations_with_replacement(several, degree):
            powers = tuple(Counter(product).items())
            if structure.symmetric and sum(k for x, k in powers if x.odd) % 2 != (force != "X"):
                continue
            if not _duplicate(powers, force, structure.duplicates):
                products.append(powers)
    if structure.moduli == "full" and structure.order == 2 and force != "X":
        # of third degree: ``_factors`` makes the moduli of cross-flow drag of them, as at higher orders
        drifting = [x for x in several if x.word.name in ("v", "r")]
        products += [tuple(Counter(cubic).items()) for cubic in itertools.combinations_with_replacement(drifting, 3)]
    return tuple(products)


def terms(structure: Structure) -> tuple[Coefficient, ...]:
    """The coefficients of a ``structure``, with monomial, prior and bounds: X, Y, N of each sub-model in turn.

    The resistance terms u of X, v of Y and r of N are bound to be no thrust, the thrust of revolutions no resistance
    (section 3.2 of the paper).
    """
    rows = []
    for number, conditions in enumerate(regimes(structure), start=1):
        for force in "XYN":
            for powers in monomials(structure, force):
                text = Monomial(conditions, _factors(powers, structure.moduli))
                std = SIZES[force][not any(x.word.name in ("v", "r") for x, _ in powers)]
                symbol, words = f"{force}_{text.short}_{number}", f"{_WORDS[force]}, generated term"
                bounds, about = _bounds(force, powers, 10 * std), {"source": SOURCE, "description": words}
                rows.append(Coefficient(symbol, 0.0, std, *bounds, **about, monomial=str(text)))  # type: ignore[arg-type]
    return tuple(rows)


def term_list(rows: Sequence[Coefficient]) -> str:
    """The generated terms among ``rows`` as lines: for each force its symbols and monomials, with the counts."""
    lines = []
    for force in "XYN":
        summed = [c for c in rows if c.monomial and c.symbol[0] == force]
        width = max((len(c.symbol) for c in summed), default=0)
        lines += [f"{force}: {len(summed)} terms", *(f"  {c.symbol:<{width}}  {c.monomial}" for c in summed)]
    return "\n".join(lines)


def _duplicate(powers: Powers, force: str, rule: str) -> bool:
    """Whether a monomial is left out by rule B."""
    if rule == "none":
        return False
    paired = any(x.part.startswith("half") for x, _ in powers) or any(x.word.name == "mean" for x, _ in powers)
    if rule == "identity" or paired:
        return _follows_from_identity(powers)
    if any(x.part == "cos" and k >= 2 for x, k in powers):
        return True
    # products of sines alone stay in Y and N: with them the counts are those of the paper at third order too
    sines_alone = force != "X" and all(x.part == "sin" for x, _ in powers)
    return not sines_alone and any(x.part == "sin" and k >= 2 for x, k in powers)


def _follows_from_identity(powers: Powers) -> bool:
    """Whether a monomial is divisible by the leading one of an identity of sine and cosine.

    Of one angle: c^2 = 1 - s^2. Of two that mirror each other, with means C, S and half differences c, s:
    C^2 + c^2 + S^2 + s^2 = 1 and C c + S s = 0, and then c^3 + c S^2 + c s^2 - c - C S s = 0 (a Groebner basis).
    """
    by_angle: dict[str, dict[str, int]] = {}
    for x, k in powers:
        if x.angle:
            by_angle.setdefault(x.angle, {})[x.part] = k
    for parts in by_angle.values():
        mean, half = parts.get("cos", 0), parts.get("half cos", 0)
        if mean >= 2 or (mean and half) or half >= 3:  # leading terms C^2 (c^2 of one angle), C c, c^3
            return True
    return False


def _factors(powers: Powers, rule: str) -> tuple[tuple[Word, bool], ...]:
    """The factors of a monomial after rule C."""
    factors: list[tuple[Word, bool]] = []  # each word, and whether it stands between bars
    alone = len(powers) == 1
    for x, k in powers:
        if rule == "full" and alone and k == 3:
            factors += [(x.word, False), (x.word, True)]
        elif rule == "none" or k != 2 or (alone and x.odd):
            factors += [(x.word, False)] * k
        else:
            factors += [(x.word, True)] if x.odd else [(x.word, False), (x.word, True)]
    return tuple(factors)


def _bounds(force: str, powers: Powers, reach: float) -> tuple[float, float]:
    """Bounds of a coefficient, one side of which is 0 for the terms whose sign is plain."""
    if len(powers) == 1 and powers[0][1] == 1:
        word = powers[0][0].word
        if (force, word.name) in _STEADYING:
            return -reach, 0.0
        screws = {"n", "n_2", "push"}
        if force == "X" and (word.name in screws or (word.name == "mean" and word.parts[0].name in screws)):
            return 0.0, reach
    return -reach, reach
