"""A ship as JSON: the tables of a ship file, with unit and words beside every number, bounds that are infinite as null.

``{"format": "mmg ship 1", "ship": {name, description, reference}, "particulars": {L: {value, unit, description}},
"model": {hull: ..., effects: [...]}, "coefficients": {Y_v: {value, unit, prime, ...}}, "inputs": [...], "network":
null or its table}``. ``inputs`` is for the reader alone. What ``prime`` stands for is said under "primes".
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isinf
from typing import Any

from cases.shipfiles.network_file import network_table
from cases.shipfiles.schema import CoefficientEntry, model_table
from mmg.components.coefficients import PARTICULARS
from mmg.motion.flow import INPUTS
from mmg.ship import Ship

FORMAT = "mmg ship 1"
PRIMES = {
    "mmg": "made dimensionless with 1/2 rho L d U^2 (forces), 1/2 rho L^2 d U^2 (moments), 1/2 rho L^2 d (masses), "
    "1/2 rho L^4 d (moments of inertia), lengths L, v' = v/U, r' = r L/U (Yasukawa & Yoshimura 2015)"
}
CONVENTIONS = (
    "SI and radians. Earth frame x north, y east, psi clockwise; origin midship; a positive rudder turns to starboard; "
    "n in 1/s, positive ahead; std is the standard error of the estimate, before a calibration that of the prior."
)
WIND = {name: f"velocity of the air over ground, to the {name[5:]}" for name in ("wind_north", "wind_east")}


def dump_ship_json(ship: Ship, more: Mapping[str, Any] | None = None) -> str:
    """The text of the JSON of ``ship``. more: further keys for the reader, plain values."""
    words = {"name": ship.name, "description": ship.description, "reference": ship.reference}
    particulars = {}
    for name, value in ship.particulars.items():
        what, unit = PARTICULARS.get(name, ("", ""))
        particulars[name] = {"value": float(value), "unit": unit, "description": what}
    coefficients = {}
    for symbol, c in ship.coefficients.items():
        coefficients[symbol] = {key: _number(getattr(c, key)) for key in CoefficientEntry.model_fields}
    network = network_table(ship.network) if ship.network is not None else None
    if network is not None:
        network |= {key: [_number(x) for x in network[key]] for key in ("lower", "upper")}
    inputs = []
    for name in ship.inputs:
        what, unit = INPUTS.get(name) or ((WIND[name], "m/s") if name in WIND else ("time", "s"))
        inputs.append({"name": name, "unit": unit, "description": what})
    content = {
        "format": FORMAT, "conventions": CONVENTIONS, "primes": PRIMES, "ship": words, "particulars": particulars,
        "model": {**model_table(ship), "effects": list(ship.effects)}, "coefficients": coefficients, "inputs": inputs,
        "calibration": dict(vars(ship.mark)) if ship.mark else None,
        "network": network, **({"campaigns": ship.campaigns} if ship.campaigns else {}),
        **({"sources": dict(ship.sources)} if ship.sources else {}), **(more or {}),
    }  # fmt: skip
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _number(value: Any) -> Any:
    """``value`` as JSON can hold it."""
    return None if isinstance(value, float) and isinf(value) else value
