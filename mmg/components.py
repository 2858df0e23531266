"""The force models by role and name, and what each needs: particulars, coefficients, inputs."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

from mmg.coefficients import Coefficient, names
from mmg.hull import unified
from mmg.propeller import hachii
from mmg.rigid_body import INERTIA
from mmg.rudder import single
from mmg.wind import fujiwara

ROLES = ("hull", "propeller", "rudder", "wind")
"""Roles in the order of evaluation: the rudder sees the propeller's slipstream."""

MODELS: dict[str, dict[str, ModuleType]] = {
    "hull": {"unified": unified},
    "propeller": {"hachii": hachii},
    "rudder": {"single": single},
    "wind": {"fujiwara": fujiwara},
}

BASE_PARTICULARS = ("L", "B", "d", "m", "x_G", "rho")
"""Particulars that every ship needs, whatever its force models."""


def module(role: str, name: str) -> ModuleType:
    """The force model ``name`` of a role; KeyError with the choices if there is none."""
    try:
        return MODELS[role][name]
    except KeyError:
        known = ", ".join(MODELS.get(role, {})) or "no such role; roles are " + ", ".join(ROLES)
        raise KeyError(f"{role} = {name!r} is unknown; known: {known}") from None


def required_particulars(components: Mapping[str, str]) -> tuple[str, ...]:
    """Particulars needed by a choice of force models, in order, without repetition."""
    needed = list(BASE_PARTICULARS)
    for role in ROLES:
        if role in components:
            needed += module(role, components[role]).PARTICULARS
    return tuple(dict.fromkeys(needed))


def coefficient_table(components: Mapping[str, str], particulars: Mapping[str, float]) -> dict[str, Coefficient]:
    """All coefficients of a choice of force models with their defaults, in the fixed order of the library."""
    rows = list(INERTIA)
    for role in ROLES:
        if role in components:
            model = module(role, components[role])
            rows += model.coefficients(names(dict(particulars))) if role == "wind" else model.COEFFICIENTS
    return {row.symbol: row for row in rows}
