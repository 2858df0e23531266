"""Froude's law on everything that has a unit: particulars, coefficients, ranges, a learned residual, prediction bands.

At equal Froude number lengths grow with the scale lambda, times and speeds with sqrt(lambda), masses and forces with
lambda^3 and the density of the water. Coefficients without a unit stay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cases.shipfiles.particulars import BY_RULE
from delivery.product import exponents, plain_unit, unit_of
from fitting.prediction.bands import SIZES
from mmg.components.coefficients import PARTICULARS
from mmg.effects import effect
from mmg.errors import UnknownName
from mmg.motion.flow import INPUTS
from mmg.network import Network
from mmg.ship import Ship

# Unit -> power of the scale.
POWERS = {"m": 1.0, "s": 0.5, "kg": 3.0, "rad": 0.0}
KEPT = ("rho_a",)  # Particulars with a unit that do not scale: the air is the same


@dataclass(frozen=True)
class Similarity:
    """Two ships of one form. scale: length of the second by that of the first; density: of their waters alike [-]."""

    scale: float
    density: float = 1.0

    def factor(self, unit: str, name: str = "") -> float:
        """By what a quantity of this ``unit``, such as "m/s^2", grows. Raises UserError for an unknown unit, with the
        ``name`` of the quantity."""
        powers = exponents(plain_unit(unit))
        if powers is None:
            raise UnknownName(f"{name or 'a quantity'} has the unit '{unit}', which mmg scale does not know")
        length = sum(POWERS[base] * power for base, power in powers.items())
        return float(self.scale**length * self.density ** powers.get("kg", 0))

    def feature(self, name: str) -> float:
        """By what a quantity of an envelope or an input of a network grows, by its ``name``."""
        return self.factor(unit_of(name), name)


def similar_particulars(given: Mapping[str, float], law: Similarity) -> dict[str, float]:
    """Particulars at the other length. given: symbol -> value [SI]; law: of similarity. The particular ``scale``
    becomes what is left of it and is gone at 1. Raises UserError for a unit that is not known."""
    scaled = {}
    for name, value in given.items():
        unit = PARTICULARS[name][1] if name in PARTICULARS else ""
        scaled[name] = value if name in KEPT else value * law.factor(unit, name)
    ratio = scaled.pop("scale", 1.0) / law.scale
    # within half a per cent of 1 nothing is left of it; set by hand
    return scaled | ({"scale": ratio} if ratio > 1.005 else {})


def dropped_effects(ship: Ship) -> tuple[str, ...]:
    """Effects of a ``ship`` that stay with the model: of its place and day, its instruments and its steering gear."""

    return tuple(
        name for name in ship.effects if (e := effect(name)).surroundings or e.measures or e.enters == "actuator path"
    )


def similar_ship(ship: Ship, law: Similarity, name: str) -> Ship:
    """The ``ship`` at the other length by Froude's law alone, with the new ``name``.

    Effects of place, instruments and steering gear are left out; a learned residual is scaled with the rest. law: of
    similarity. Raises UserError for a unit that is not known.
    """
    for gone in dropped_effects(ship):
        ship = ship.without_effect(gone)
    rows = {}
    for symbol, c in ship.coefficients.items():
        factor = law.factor(c.unit, symbol)
        numbers = {key: getattr(c, key) for key in ("value", "std", "lower", "upper", "prior_value", "prior_std")}
        rows[symbol] = c.with_(**{key: None if v is None else v * factor for key, v in numbers.items()})
    network = ship.network and similar_network(ship.network, law)
    particulars = similar_particulars(ship.particulars, law)
    words = f"scaled by {law.scale:.6g} from {ship.name}"
    words = f"{words}: {ship.description}" if ship.description else words
    # a gear or a speed that was measured on the model is the ship's by no more than the law
    sources = {key: BY_RULE + f"Froude's law, {text.removeprefix(BY_RULE)}" for key, text in ship.sources.items()}
    mark = ship.mark and replace(ship.mark, name=f"{ship.called} scaled to {particulars['L']:.4g} m")
    # values by campaign are those of the model's instruments, which the ship has not
    bare = replace(ship, network=None, name=name, particulars=particulars, coefficients=rows, description=words,
                   mark=mark, sources=sources, campaigns={})  # fmt: skip
    return bare.with_network(network)


def similar_network(network: Network, law: Similarity) -> Network:
    """A learned residual of accelerations at the other length: the same ``network`` of the same Froude numbers. law:
    of similarity."""
    factors = np.array([law.feature(name) for name in network.features])
    outputs = np.array([law.factor(unit) for unit in ("m/s^2", "m/s^2", "rad/s^2")])
    return replace(
        network, feature_scales=network.feature_scales * factors, output_scales=network.output_scales * outputs,
        lower=network.lower * factors, upper=network.upper * factors,
    )  # fmt: skip


def similar_envelope(envelope: Mapping[str, Sequence[float]] | None, law: Similarity) -> dict[str, list[float]] | None:
    """The ranges that the trials held at the other length; None stays None. envelope: quantity -> (lowest, highest),
    SI; law: of similarity."""
    if envelope is None:
        return None
    return {name: [law.feature(name) * value for value in pair] for name, pair in envelope.items()}


def similar_adaptation(adaptation: Mapping[str, Any] | None, law: Similarity) -> dict[str, Any] | None:
    """What the past of a window is worth, found on trials of the model, with seconds of the other length.

    adaptation: as ``fitting.prediction.score.adaptation_worth`` gives it, None stays None; law: of similarity.
    """
    if not adaptation:
        return None
    seconds = float(max(1.0, round(adaptation["past_s"] * math.sqrt(law.scale))))  # whole seconds, one at the least
    return {**adaptation, "past_s": seconds, "trials": "trials of the model"}


def similar_bands(bands: Mapping[str, Any] | None, law: Similarity) -> dict[str, Any] | None:
    """The process of unexplained accelerations in result.json at the other length, without noise of instruments.

    bands: as ``fitting.prediction.bands.process_dict`` gives it, None stays None; law: of similarity.
    """
    if not bands:
        return None
    time = math.sqrt(law.scale)
    # copies of what is changed below: the bands of the model stay as they are
    scaled: dict[str, Any] = {key: dict(value) if key != "horizons_s" else value for key, value in bands.items()}
    if "held" in scaled:  # its points are divided by the scales of u, v, r L, actuators, air
        actuators = [name for name in scaled["held"]["inputs"] if name in INPUTS]
        units = ["m/s"] * 3 + [INPUTS[name][1] for name in actuators] + ["m/s"] * 2
        scales = zip(scaled["held"]["scale"], units, strict=True)
        scaled["held"]["scale"] = [value * law.factor(unit) for value, unit in scales]
    if "horizons_s" in scaled:
        scaled["horizons_s"] = [value * time for value in scaled["horizons_s"]]
    for key in ("acceleration_memory_s", "error_decay_s"):
        scaled[key] = {name: value * time for name, value in scaled[key].items()}
    turning = scaled["acceleration_std"]["r"]  # [rad/s^2], by 1 / scale; those of u and v [m/s^2] stay
    scaled["acceleration_std"]["r"] = {name: turning[name] / law.scale for name in SIZES}
    scaled["noise"] = dict.fromkeys(scaled["noise"], 0.0)  # of the model's instruments, which the ship has not
    return scaled
