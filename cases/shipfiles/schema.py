"""What a ship file may hold: the tables [ship], [model] and [coefficients.NAME] as schemas."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field, create_model

from cases.io.toml_file import Name, Section, number
from mmg.components.catalogue import ROLES, model_names
from mmg.components.coefficients import PARTICULARS
from mmg.effects import present_name
from mmg.ship import Ship


def _not_nan(value: float) -> float:
    if math.isnan(value):
        raise ValueError("must be a number or inf")
    return value


Finite = Annotated[float, Field(allow_inf_nan=False)]
Bound = Annotated[float, Field(allow_inf_nan=True), AfterValidator(_not_nan)]
Present = Annotated[str, AfterValidator(present_name)]


class CoefficientEntry(Section):
    """One coefficient: value, prior or standard error (std), bounds, unit or prime, source; more after a fit."""

    value: float = Field(description="give the value that the model uses")
    unit: str = ""
    prime: Literal["", "mmg"] = ""
    std: float | None = Field(None, ge=0)
    lower: Bound | None = None
    upper: Bound | None = None
    fixed: bool = False
    source: str = ""
    description: str = ""
    verdict: str = ""
    prior_value: float | None = None
    prior_std: float | None = Field(None, ge=0)
    monomial: str = ""


class _Words(Section):
    """it holds the particulars, such as L = 3.0"""

    name: Name = ""
    description: str = ""
    reference: str = ""


class _Effects(Section):
    """it names the force model of each role: hull, propeller, rudder, wind"""

    effects: list[Present] = Field(default_factory=list)
    registered: dict[str, str] = Field(default_factory=dict)


def _known_to(role: str) -> AfterValidator:
    """Refuses a force model that ``role`` does not have."""

    def known(name: str) -> str:
        if name not in (names := model_names(role)):
            choices = ", ".join(json.dumps(each) for each in names)
            raise ValueError(f"must be {choices} or one that @mi.force has registered")
        return name

    return AfterValidator(known)


class CalibrationSection(Section):
    """it says which calibration the ship is of: name, date, data, start"""

    name: Name = ""
    date: str = ""
    data: str = ""
    start: str = ""


if TYPE_CHECKING:
    ShipSection = _Words
    ModelSection = _Effects
else:
    _quantities = {name: (float | None, number(unit, None)) for name, (_, unit) in PARTICULARS.items()}
    ShipSection = create_model("ShipSection", __base__=_Words, __doc__=_Words.__doc__, **_quantities)
    _roles = {role: (Annotated[str, _known_to(role)] | None, None) for role in ROLES}
    ModelSection = create_model("ModelSection", __base__=_Effects, __doc__=_Effects.__doc__, **_roles)


class ShipFile(Section):
    """A whole ship file."""

    ship: ShipSection
    model: ModelSection
    coefficients: dict[Present, CoefficientEntry] = Field(default_factory=dict)
    sources: dict[Present, str] = Field(default_factory=dict)
    calibration: CalibrationSection | None = None
    campaigns: dict[Name, dict[Present, Finite]] = Field(default_factory=dict)


def model_table(ship: Ship) -> dict[str, Any]:
    """The table [model] of a ``ship``: force models by role, effects, and where those are from that are no part of the
    library."""
    more = {"effects": list(ship.effects), "registered": {model.name: model.origin for model in ship.own}}
    return {**ship.components, **{key: value for key, value in more.items() if value}}
