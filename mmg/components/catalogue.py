"""The force models by role and name, and what each needs: particulars, coefficients, inputs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, MutableMapping
from importlib import import_module
from types import SimpleNamespace
from typing import Any, ClassVar

import casadi as ca

from mmg.components.coefficients import Coefficient, names
from mmg.components.own import Own, load_plug_ins
from mmg.components.rigid_body import INERTIA
from mmg.errors import BadValue, Conflict, UnknownName
from mmg.motion.flow import INPUTS, Flow, Force, pods
from mmg.motion.smooth import Smoothing

# Roles that exert forces, in the order of evaluation: the rudder sees the propeller's slipstream.
FORCES = ("hull", "propeller", "rudder", "bow_thruster", "stern_thruster", "azimuth", "expansion", "wind", "waves")

# All roles: the last two move rudder and propeller to their orders, and add a degree of freedom.
ROLES = (*FORCES, "actuators", "roll")


def _files(folder: str, *names: str) -> dict[str, Any]:
    return {name: f"{folder}.{name}" for name in names}


# Role -> name -> file in this folder, or a model of a user. Those of a ship are read when she needs them.
MODELS: dict[str, dict[str, Any]] = {
    "hull": _files("hull", "unified", "harbour", "polynomial", "abkowitz"),
    "propeller": _files(
        "propeller", "hachii", "four_quadrant", "kang", "cpp", "standard", "standard_kijima", "standard_hirano"
    ),
    "rudder": _files("rudder", "single", "vectwin", "standard", "lindenburg"),
    "bow_thruster": {"kobayashi": "thruster.bow"},
    "stern_thruster": {"kobayashi": "thruster.stern"},
    "azimuth": _files("thruster", "azimuth"),
    "expansion": _files("expansion", "smooth_submodels", "hard_submodels"),
    "wind": _files("wind", "fujiwara", "blendermann", "isherwood"),
    "waves": _files("waves", "drift"),
    "actuators": _files("actuators", "rate_limited", "lag"),
    "roll": _files("roll", "linear"),
}

BASE_PARTICULARS = ("L", "B", "d", "m", "x_G", "rho")  # Particulars that every ship needs, whatever its force models


class OwnForce(Own):
    """A force model of a user, which answers as a module of this folder does.

    role, name: by which a ship finds it; function: (flow, p, c, s) -> Force, or X, Y [N], N [N m], as
    mmg/motion/flow.py says; COEFFICIENTS, PARTICULARS, INPUTS: as of a module.
    """

    stated: ClassVar[tuple[str, ...]] = (*Own.stated, "role", "COEFFICIENTS", "PARTICULARS", "INPUTS")
    role: str
    COEFFICIENTS: tuple[Coefficient, ...]
    PARTICULARS: tuple[str, ...]
    INPUTS: tuple[str, ...]

    def __init__(self, function: Callable[..., Any], **stated: Any) -> None:
        super().__init__(function, **stated)
        self.__doc__ = function.__doc__ or f"{self.name.replace('_', ' ')}, a {self.role} model of {self.origin}"

    @property
    def names(self) -> MutableMapping[str, Any]:
        """The force models of its role."""
        return MODELS[self.role]

    def force(self, flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
        """X, Y [N], N [N m]. flow, p, c, s: as in mmg/motion/flow.py. Raises UserError for another result."""
        return as_force(self.function(flow, p, c, s), f"{self.role} model {self.name}")


def as_force(result: Any, where: str) -> Force:
    """The ``result`` of a function of a user, X, Y [N] and N [N m] or a Force. where: which function, for messages.
    Raises UserError where it is neither."""
    if isinstance(result, Force):
        as_force((result.X, result.Y, result.N), where)
        return result  # as it is: a propeller's has a slipstream, a rudder's has blades
    if isinstance(result, (ca.SX, ca.DM)):  # a vertcat or horzcat of the three
        result = ca.vertsplit(ca.vec(result))
    if not isinstance(result, (tuple, list)) or len(result) != 3:
        size = f"{len(result)} values" if isinstance(result, (tuple, list)) else f"a {type(result).__name__}"
        raise BadValue(f"{where}: returns {size}; return X, Y [N] and N [N m], or mi.Force(X, Y, N)")
    for name, part in zip("XYN", result, strict=True):
        if not (isinstance(part, (int, float)) or (isinstance(part, (ca.SX, ca.DM)) and part.numel() == 1)):
            raise BadValue(f"{where}: {name} is a {type(part).__name__}; return one CasADi expression or number each")
        if isinstance(part, float) and not math.isfinite(part):
            raise BadValue(f"{where}: {name} is {part}; use operators and functions of casadi, not of math")
    return Force(*result)


def model_names(role: str) -> list[str]:
    """The force models of ``role``, those of plug-ins too. Raises UserError for an unknown role."""
    if role not in MODELS:
        raise UnknownName(f"role = '{role}' is unknown; roles are {', '.join(ROLES)}")
    load_plug_ins()
    return list(MODELS[role])


def own_models(components: Mapping[str, str]) -> tuple[OwnForce, ...]:
    """Those of the force models ``components`` (role -> name) that a user registered."""
    models = (MODELS.get(role, {}).get(name) for role, name in components.items())
    return tuple(model for model in models if isinstance(model, OwnForce))


def module(role: str, name: str) -> Any:
    """The force model ``name`` of a role; UserError with the choices if there is none."""
    model = MODELS.get(role, {}).get(name)
    if model is None and name not in model_names(role):  # which loads the plug-ins: it may be there now
        words = f"known: {', '.join(MODELS[role])}; one of your own is registered first, by @mi.force"
        raise UnknownName(f"{role} = '{name}' is unknown; {words}")
    model = model or MODELS[role][name]
    return model if isinstance(model, OwnForce) else import_module(f"mmg.components.{model}")


def summary(role: str, name: str) -> str:
    """Docstring of the force model ``name`` of ``role``: title, equations and their source; UserError as ``module``."""
    return (module(role, name).__doc__ or "").strip().replace("``", "")


def required_particulars(components: Mapping[str, str]) -> tuple[str, ...]:
    """Particulars needed by a choice of force models, in order, without repetition. components: role -> model."""
    needed = [name for role in ROLES if role in components for name in module(role, components[role]).PARTICULARS]
    return tuple(dict.fromkeys((*BASE_PARTICULARS, *needed)))


def coefficient_table(components: Mapping[str, str], particulars: Mapping[str, float]) -> dict[str, Coefficient]:
    """All coefficients of a choice of force models with their defaults, in the fixed order of the library. components:
    role -> model; particulars: symbol -> SI value. Raises UserError where two of them share a symbol."""
    models = [module(role, components[role]) for role in ROLES if role in components]
    rows = [*INERTIA, *(row for model in models for row in _rows(model, particulars))]
    by_symbol = {row.symbol: row for row in rows}
    if len(by_symbol) < len(rows):  # of the library no two roles share a symbol
        (twice, _), *_ = Counter(row.symbol for row in rows).most_common(1)
        raise Conflict(f"coefficients: {twice} belongs to two parts of the model; rename it in your own")
    return by_symbol


def _rows(model: Any, particulars: Mapping[str, float]) -> tuple[Coefficient, ...]:
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
    if twin_screw(particulars):  # n is the starboard propeller's then
        needed |= {"n_2"} if "n" in needed else set()
        needed = (needed - {"delta"}) | {"delta_port", "delta_starboard"} if "delta" in needed else needed
    return tuple(name for name in INPUTS if name in needed)


def twin_screw(particulars: Mapping[str, float]) -> bool:
    """True for a ship with two propellers at +- y_P from the centre plane. particulars: symbol -> SI value."""
    return particulars.get("y_P", 0.0) > 0.0
