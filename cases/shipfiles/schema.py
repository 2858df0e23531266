"""What a ship file may hold: the tables [ship], [model] and [coefficients.NAME] as schemas."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, create_model

from cases.io.toml_file import Name, Section, number
from mmg.components.catalogue import MODELS
from mmg.components.particulars import PARTICULARS
from mmg.effects import present_name


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
    _roles = {role: (Literal[tuple(models)] | None, None) for role, models in MODELS.items()}
    ModelSection = create_model("ModelSection", __base__=_Effects, __doc__=_Effects.__doc__, **_roles)


class ShipFile(Section):
    """A whole ship file."""

    ship: ShipSection
    model: ModelSection
    coefficients: dict[Present, CoefficientEntry] = Field(default_factory=dict)
    sources: dict[Present, str] = Field(default_factory=dict)
    calibration: CalibrationSection | None = None
    campaigns: dict[Name, dict[Present, Finite]] = Field(default_factory=dict)
