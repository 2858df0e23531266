"""Candidates for the structure of a ship's model: the ship as it is, and generated polynomials instead of it or on top.

Their names say what they are: ``mmg`` is the ship as given, ``sm2-order3`` a polynomial of third order with two
sub-models (Miyauchi et al. 2023), ``full-order4`` one of fourth order without sub-models, but with all moduli and only
such terms left out as follow from others, ``mmg+full-order2`` one on top of the ship's own forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from cases.shipfiles.generated_ship import generated_ship, structure_of
from fitting.settings import Rules
from mmg.components.expansion.actuators import variables
from mmg.components.expansion.structure import Structure
from mmg.errors import OutOfRange, UnknownName, Unsupported
from mmg.ship import Ship

GIVEN = "mmg"  # Name of the ship as it was given
HIGHEST = Rules.order  # Order of the polynomials where none is asked for. Set by hand.
FULL = "full"  # Family of polynomials without sub-models, with all moduli: one order higher than the others by default
# Most monomials of one force, before the rules, of a polynomial of that family: it bounds time and memory.
WIDEST = 2500
ON_TOP = 2  # Highest order of polynomials on top of the ship's own forces. Set by hand.


@dataclass(frozen=True)
class StructureCandidate:
    """A candidate: its name, ship to fit, what it is in words, order (0: no polynomial), sub-models ("": none)."""

    name: str
    ship: Ship
    words: str
    order: int = 0
    submodels: str = ""

    @property
    def unknowns(self) -> int:
        """Number of coefficients that a fit may change."""
        return len(self.ship.free)

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of generated terms in X, Y and N."""
        # symbols of generated terms begin with their force
        x, y, n = (sum(symbol[0] == force for symbol in self.ship.monomials) for force in "XYN")
        return x, y, n


def candidates(ship: Ship, rules: Rules | None = None) -> tuple[StructureCandidate, ...]:
    """All candidates for ``ship`` by ``rules``, the one with the fewest generated terms first.

    Raises UserError for rules that no structure can meet (``structure_of``), and for a ship that is generated already.
    """
    rules = rules or Rules()
    if "expansion" in ship.components:
        raise Unsupported(f"{ship.name} is a generated model already; give the ship that it was made from")
    if rules.order < 1:
        raise OutOfRange(f"order {rules.order}: must be at least 1")
    polynomials = []
    for name, structure in _structures(ship, rules):
        may_be_on_top = structure.submodels == "SM-1" and structure.order <= ON_TOP
        for on_top in (False, True)[: 1 + may_be_on_top]:  # of the ship's own forces, which are fixed then
            called = f"{ship.name}_{'plus_' * on_top}{name.replace('-', '_')}"
            made = generated_ship(ship, structure, called, rules.hard, offset=on_top)
            words = structure.words + ", on top of the ship's own forces" * on_top
            label = f"{GIVEN}+{name}" if on_top else name
            polynomials.append(StructureCandidate(label, made, words, structure.order, structure.submodels))
    polynomials.sort(key=lambda candidate: (sum(candidate.counts), candidate.name))
    own = ", ".join(f"{role} {model}" for role, model in ship.components.items())
    return (StructureCandidate(GIVEN, ship, f"the ship as given: {own}"), *polynomials)


def candidate(ship: Ship, name: str, rules: Rules | None = None) -> StructureCandidate:
    """The candidate ``name`` among those of ``ship`` by ``rules``. Raises UserError where there is none so named."""
    by_name = {one.name: one for one in candidates(ship, rules)}
    if name not in by_name:
        raise UnknownName(f"no candidate '{name}' for {ship.name}; known: {', '.join(by_name)}")
    return by_name[name]


def _structures(ship: Ship, rules: Rules) -> list[tuple[str, Structure]]:
    """The structures of all polynomials by their names."""
    words = (rules.actuators, not rules.asymmetric, rules.duplicates, rules.moduli)
    first = structure_of(ship, 1, "SM-1", *words)
    names = [name for device in first.devices for name in device.names]
    by_stall = ("SM-3", "SM-4") if any(name.startswith("delta") for name in names) else ()
    found = [
        (f"{submodels.lower().replace('-', '')}-order{order}", structure_of(ship, order, submodels, *words))
        for submodels in ("SM-1", "SM-2", *by_stall, *(("quadrants",) if "n" in names else ()))
        for order in range(1, rules.order + 1)
    ]
    for order in range(2, rules.order + (2 if rules.order >= HIGHEST else 1)):
        count = len(variables(first.devices))
        if math.comb(count + order, order) <= WIDEST:  # monomials of count variables up to this order
            found.append((f"{FULL}-order{order}", replace(first, order=order, duplicates="identity", moduli="full")))
    return found
