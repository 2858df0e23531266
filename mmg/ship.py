"""A ship is data: particulars, the names of its force models, and their coefficients."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mmg.coefficients import Coefficient


@dataclass(frozen=True)
class Ship:
    """A ship, before or after calibration.

    Attributes
    ----------
    name: short name, as in ``mmg ships``.
    particulars: symbol -> value in SI (L, B, d, m, x_G, rho, D_P, A_R, ...); see the force models.
    components: role ("hull", "propeller", "rudder", "wind") -> name of the force model.
    coefficients: symbol -> Coefficient, in the order of the models' tables.
    description, reference: words and citations that travel with the ship file.
    """

    name: str
    particulars: Mapping[str, float]
    components: Mapping[str, str]
    coefficients: Mapping[str, Coefficient]
    description: str = ""
    reference: str = ""
    notices: tuple[str, ...] = field(default=())

    @property
    def symbols(self) -> tuple[str, ...]:
        """All coefficient symbols in their fixed order."""
        return tuple(self.coefficients)

    @property
    def free(self) -> tuple[str, ...]:
        """Symbols that a fit may change."""
        return tuple(name for name, c in self.coefficients.items() if not c.fixed)

    @property
    def values(self) -> np.ndarray:
        """Values of all coefficients, shape (P,), in the order of ``symbols``."""
        return np.array([c.value for c in self.coefficients.values()], dtype=float)

    def with_values(self, values: Mapping[str, float]) -> Ship:
        """A copy with some coefficient values replaced."""
        return self.with_coefficients(
            {name: self.coefficients[name].with_(value=float(value)) for name, value in values.items()}
        )

    def with_coefficients(self, changed: Mapping[str, Coefficient]) -> Ship:
        """A copy with some coefficients replaced (their order is kept)."""
        return replace(self, coefficients={**self.coefficients, **changed})

    def fixing(self, symbols: Iterable[str], fixed: bool = True) -> Ship:
        """A copy in which these coefficients are fixed (or freed)."""
        return self.with_coefficients({s: self.coefficients[s].with_(fixed=fixed) for s in symbols})
