"""The force models by role and name, and what each needs: particulars, coefficients, inputs."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import ModuleType

from mmg.components.coefficients import Coefficient, names
from mmg.components.rigid_body import INERTIA
from mmg.motion.flow import INPUTS, pods

FORCES = ("hull", "propeller", "rudder", "bow_thruster", "stern_thruster", "azimuth", "expansion", "wind", "waves")
"""Roles that exert forces, in the order of evaluation: the rudder sees the propeller's slipstream."""

ROLES = (*FORCES, "actuators", "roll")
"""All roles: the last two move rudder and propeller to their orders, and add a degree of freedom."""

MODELS = {
    "hull": {
        "unified": "hull.unified",
        "harbour": "hull.harbour",
        "polynomial": "hull.polynomial",
        "abkowitz": "hull.abkowitz",
    },
    "propeller": {
        "hachii": "propeller.hachii",
        "four_quadrant": "propeller.four_quadrant",
        "kang": "propeller.kang",
        "cpp": "propeller.cpp",
        "standard": "propeller.standard",
        "standard_kijima": "propeller.standard_kijima",
        "standard_hirano": "propeller.standard_hirano",
    },
    "rudder": {
        "single": "rudder.single",
        "vectwin": "rudder.vectwin",
        "standard": "rudder.standard",
        "lindenburg": "rudder.lindenburg",
    },
    "bow_thruster": {"kobayashi": "thruster.bow"},
    "stern_thruster": {"kobayashi": "thruster.stern"},
    "azimuth": {"azimuth": "thruster.azimuth"},
    "expansion": {
        "smooth_submodels": "expansion.smooth_submodels",
        "hard_submodels": "expansion.hard_submodels",
    },
    "wind": {"fujiwara": "wind.fujiwara", "blendermann": "wind.blendermann", "isherwood": "wind.isherwood"},
    "waves": {"drift": "waves.drift"},
    "actuators": {"rate_limited": "actuators.rate_limited", "lag": "actuators.lag"},
    "roll": {"linear": "roll.linear"},
}
"""Role -> name -> file in this folder. Those of a ship are read when she needs them."""

BASE_PARTICULARS = ("L", "B", "d", "m", "x_G", "rho")
"""Particulars that every ship needs, whatever its force models."""


def module(role: str, name: str) -> ModuleType:
    """The force model ``name`` of a role; KeyError with the choices if there is none."""
    if name not in MODELS.get(role, {}):
        choices = ", ".join(MODELS.get(role, {})) or "no such role; roles are " + ", ".join(ROLES)
        raise KeyError(f"{role} = {name!r} is unknown; known: {choices}")
    return import_module(f"mmg.components.{MODELS[role][name]}")


def summary(role: str, name: str) -> str:
    """Docstring of the force model ``name`` of ``role``: title, equations and their source; KeyError as ``module``."""
    return (module(role, name).__doc__ or "").strip().replace("``", "")


def required_particulars(components: Mapping[str, str]) -> tuple[str, ...]:
    """Particulars needed by a choice of force models, in order, without repetition. components: role -> model."""
    needed = [name for role in ROLES if role in components for name in module(role, components[role]).PARTICULARS]
    return tuple(dict.fromkeys((*BASE_PARTICULARS, *needed)))


def coefficient_table(components: Mapping[str, str], particulars: Mapping[str, float]) -> dict[str, Coefficient]:
    """All coefficients of a choice of force models with their defaults, in the fixed order of the library. components:
    role -> model; particulars: symbol -> SI value."""
    models = [module(role, components[role]) for role in ROLES if role in components]
    return {row.symbol: row for row in (*INERTIA, *(row for model in models for row in _rows(model, particulars)))}


def _rows(model: ModuleType, particulars: Mapping[str, float]) -> tuple[Coefficient, ...]:
    """Coefficient table of a force model: a constant, or made from the particulars."""
    if hasattr(model, "coefficients"):
        return model.coefficients(names(dict(particulars)))
    return model.COEFFICIENTS


def derived(components: Mapping[str, str], particulars: Mapping[str, float]) -> set[str]:
    """Coefficients whose defaults follow from the particulars, so that a ship file may leave them out. components: role
    -> model."""
    models = [module(role, name) for role, name in components.items()]
    return {row.symbol for model in models if not hasattr(model, "COEFFICIENTS") for row in _rows(model, particulars)}


def actuators(components: Mapping[str, str], particulars: Mapping[str, float]) -> tuple[str, ...]:
    """Actuators (names of mmg.motion.flow.INPUTS) that a choice of force models listens to, in the order of INPUTS.

    A ship with two screws (particular y_P, their distance from the centre plane) has n, n_2 and a rudder each.
    components: role -> model; particulars: symbol -> SI value.
    """
    needed = {name for item in components.items() for name in getattr(module(*item), "INPUTS", ())}
    needed |= {name for i in pods(particulars) for name in (f"n_azimuth{i}", f"azimuth{i}") if "azimuth" in components}
    if twin_screw(particulars):
        needed |= {"n_2"} if "n" in needed else set()
        needed = (needed - {"delta"}) | {"delta_port", "delta_starboard"} if "delta" in needed else needed
    return tuple(name for name in INPUTS if name in needed)


def twin_screw(particulars: Mapping[str, float]) -> bool:
    """True for a ship with two propellers at +- y_P from the centre plane. particulars: symbol -> SI value."""
    return particulars.get("y_P", 0.0) > 0.0
