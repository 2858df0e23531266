"""The terms of a generated polynomial in a ship file: coefficients that state a monomial."""

from __future__ import annotations

from collections.abc import Mapping

from cases.io.toml_file import header
from cases.shipfiles.schema import CoefficientEntry
from mmg.components.coefficients import Coefficient
from mmg.components.expansion.series import RANGE
from mmg.components.expansion.words import parse_monomial
from mmg.motion.flow import PODS

PODS_OF = tuple(f"{axis}_az{ending}" for ending in ("", *(f"_{i}" for i in range(2, PODS + 1))) for axis in "xy")
"""Places of the pods, which a generated polynomial keeps for the sense in which they steer."""

RANGES = tuple(dict.fromkeys(name for pair in RANGE.values() for name in pair))
"""Particulars that give the range of the motions behind a polynomial."""


def optional_particulars(components: Mapping[str, str]) -> tuple[str, ...]:
    """Particulars that the force models may use beside those that they need. components: role -> model."""
    more = ("delta_stall", *RANGES, *PODS_OF) if "expansion" in components else ()
    return (*more, *PODS_OF[2:]) if "azimuth" in components else more


def generated_terms(
    entries: Mapping[str, CoefficientEntry], components: Mapping[str, str], table: Mapping[str, Coefficient]
) -> tuple[dict[str, Coefficient], list[str]]:
    """Rows for the coefficients among ``entries`` that state a monomial, and sentences on what is wrong with them.

    components: role -> model; table: coefficients of the ship's other models, whose symbols are taken.
    """
    rows, wrong = {}, []
    for symbol, entry in entries.items():
        if not entry.monomial:
            continue
        where = header("coefficients", symbol)
        try:
            parse_monomial(entry.monomial)
        except ValueError as error:
            wrong.append(f"{where} monomial = '{entry.monomial}': {error}")
            continue
        if "expansion" not in components:
            wrong.append(f'{where} states a monomial, but [model] has no expansion; add expansion = "smooth_submodels"')
        elif symbol in table:
            wrong.append(f"{where} states a monomial, but {symbol} is a coefficient of another model; rename it")
        elif not (symbol[:1] in "XYN" and symbol[1:2] == "_" and symbol.isidentifier()):
            wrong.append(f"{where} states a monomial; its symbol must begin with X_, Y_ or N_, the force it adds to")
        elif entry.std is None:
            wrong.append(f"{where} states a monomial, so give its std as well: there is no default")
        else:
            rows[symbol] = Coefficient(symbol, entry.value, entry.std, monomial=entry.monomial)
    if "expansion" in components and not rows and not wrong:
        wrong.append(
            "[model] expansion: no coefficient states a monomial, so there is no term; generate them (mmg select)"
        )
    return rows, wrong
