"""``mmg_ident.scale``: a model carried to another length, in one call."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from delivery.full_scale.result import scaled_result
from delivery.full_scale.scaled_ship import Scaling
from fitting.result import FitResult
from mmg.components.friction import ROUGHNESS
from mmg.ship import Ship

if TYPE_CHECKING:
    from residual.result import TrainResult


def scale(
    model: Ship | str | Path | FitResult | TrainResult,
    length: float,
    speed: float | None = None,
    density: float | None = None,
    form_factor: float | None = None,
    roughness: float = ROUGHNESS,
    froude_only: bool = False,
    name: str = "",
) -> FitResult:
    """Carry ``model`` to another length, as ``mmg scale`` does: similarity, and friction, wake, rudder inflow by ITTC.

    length: of the ship [m]; speed: of the ship [m/s] at which friction and wake are taken, default that of the model by
    Froude's law; density: of the ship's water [kg/m^3], default sea water; form_factor: k [-] where it was measured;
    roughness: of the hull [m]; froude_only: similarity alone; name: of the ship. Returns a result with the ship's
    coefficients, covariance, ranges and bands, whose ``scaling`` holds what was assumed. Raises UserError for
    particulars that are lacking.
    """
    scaling = Scaling(length, speed, density, form_factor, roughness, froude_only, name)
    return scaled_result(model if isinstance(model, (str, Path, Ship, FitResult)) else model.ship, scaling)
