"""Coefficients: what a ship file says about each of them, and the tables that the force models bring."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from mmg.errors import refusing


@refusing
@dataclass(frozen=True)
class Coefficient:
    """One coefficient of a force model, with its prior before and its estimate after a calibration.

    symbol: MMG symbol in plain letters, such as ``Y_v``, ``w_P0``, ``ell_R``.
    value: the value the model uses.
    std: standard deviation: of the prior in a starting ship, of the estimate in a calibrated one.
    lower, upper: bounds that a fit respects.
    unit: SI unit, "" for a dimensionless number.
    prime: "mmg" when made dimensionless with 1/2 rho L d U^2 and so on, else "".
    fixed: a fit leaves it alone.
    source: where the value comes from.
    description: what it is, in words.
    verdict: a sentence on how well the data determine it, after a fit.
    prior_value, prior_std: the prior a calibrated value started from; None before a fit.
    monomial: of a term of a generated polynomial, what it multiplies (mmg/components/expansion/words.py).
    """

    symbol: str
    value: float
    std: float
    lower: float = -math.inf
    upper: float = math.inf
    unit: str = ""
    prime: str = ""
    fixed: bool = False
    source: str = ""
    description: str = ""
    verdict: str = ""
    prior_value: float | None = None
    prior_std: float | None = None
    monomial: str = ""

    def with_(self, **changes: Any) -> Coefficient:
        """A copy with some attributes changed."""
        return replace(self, **changes)


def names(mapping: dict[str, Any]) -> SimpleNamespace:
    """Attribute access to a mapping, so that a force reads ``c.Y_v`` and ``p.L``."""
    return SimpleNamespace(**mapping)


def table(source: str, *rows: tuple, fixed: bool = False) -> tuple[Coefficient, ...]:
    """Coefficient table of a force model.

    Each row is (symbol, default value, prior std, lower, upper, prime or unit, description). ``prime`` is
    "mmg" for a coefficient in the MMG system of Yasukawa & Yoshimura (2015), "" for another pure number.
    source: where the values come from; rows: as above; fixed: left alone by a fit.
    """

    def row(symbol: str, value: float, std: float, lower: float, upper: float, kind: str, words: str) -> Coefficient:
        unit, prime = ("", "mmg") if kind == "mmg" else (kind, "")
        return Coefficient(symbol, value, std, lower, upper, unit, prime, fixed, source, words)

    return tuple(row(*values) for values in rows)
