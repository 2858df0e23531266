"""A ship at another length: similarity, then what changes with the Reynolds number; the covariance is carried along."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from cases.maneuvers.self_propulsion import TEST_FROUDE
from cases.shipfiles.particulars import LONGEST
from delivery.full_scale.similarity import Similarity, similar_ship
from delivery.full_scale.viscous import RESISTANCE, Change, Doubt, HullInWater, doubts, ship_values
from mmg.components import friction
from mmg.components.coefficients import Coefficient
from mmg.errors import BadValue, Missing, OutOfRange
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

# Density [kg/m^3] of sea water (ITTC 7.5-02-01-03: 1026 at 15 degrees C), in which a ship of 20 m and more floats.
SALT = 1025.0
SHORTEST = 0.1  # m; no model is shorter. Set by hand: bounds what a typing error can do.
# Step of the derivatives of the scaled coefficients, by the size of each: set by hand between rounding and curvature.
STEP = 1e-4


@dataclass(frozen=True)
class Scaling:
    """What is asked for, as of ``delivery.full_scale.result.scale``.

    speed None: by U_0 of the model, else the greatest speed of its trials, else Froude number 0.142; density None: sea
    water from 20 m on.
    """

    length: float
    speed: float | None = None
    density: float | None = None
    form_factor: float | None = None
    roughness: float = friction.ROUGHNESS
    froude_only: bool = False
    name: str = ""

    def check(self) -> None:
        """Raises UserError for what is no number, or no ship has."""
        for name in ("length", "speed", "density", "form_factor", "roughness"):
            value, optional = getattr(self, name), name not in ("length", "roughness")
            if not (isinstance(value, Real) or (value is None and optional)):
                raise BadValue(f"{name} = {value!r}: is no number")
        if not SHORTEST <= self.length <= LONGEST:
            raise OutOfRange(f"--length {self.length:g}: give {SHORTEST:g} to {LONGEST:g} m")
        # wide enough for every ship, narrow enough for a wrong unit; set by hand
        limits = {"speed": (0, 50, "m/s"), "density": (500, 1500, "kg/m³"), "form_factor": (0, 1.5, "")}
        for name, (low, high, unit) in limits.items():
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and low < value <= high):
                option = name.replace("_", "-").replace("density", "rho")
                raise OutOfRange(f"--{option} {value:g}: must be above {low:g}, at most {high:g} {unit}".rstrip())
        if not 0 <= self.roughness <= 0.01:
            raise OutOfRange(f"--roughness {self.roughness:g}: must be 0 to 0.01 m; 0.00015 is a newly painted hull")


@dataclass(frozen=True)
class ScaledShip:
    """A ship at another length.

    model: the one that was scaled; ship: with standard deviations; law: of similarity; change: of the water, None where
    similarity alone was asked for; changed: symbols whose value follows from the Reynolds number; doubts: standard
    deviations that scaling adds; symbols, correlation: (P,) and (P, P) of what the standard deviations belong to.
    """

    model: Ship
    ship: Ship
    law: Similarity
    speed: float
    change: Change | None
    changed: tuple[str, ...]
    doubts: dict[str, Doubt]
    symbols: tuple[str, ...]
    correlation: np.ndarray


def scaled_ship(
    model: Ship,
    scaling: Scaling,
    symbols: Sequence[str] = (),
    correlation: np.ndarray | None = None,
    fastest: float = 0.0,
) -> ScaledShip:
    """The ``model`` at the length of ``scaling``.

    symbols, correlation: (P,) and (P, P) of its estimates, independent where they are not given; fastest: greatest
    speed of its trials [m/s], 0 where it is not known. Raises UserError for particulars that are lacking, or that no
    ship has, and for a model without a resistance and a wake to correct.
    """
    scaling.check()
    p = model.particulars
    same = math.isclose(scaling.length, p["L"], rel_tol=1e-9)
    # a model's fresh water goes with it; above 1010 kg/m^3, between fresh and sea water, the model was in salt already
    density = scaling.density or (p["rho"] if same or scaling.length < friction.MODEL or p["rho"] > 1010 else SALT)
    law = Similarity(scaling.length / p["L"], density / p["rho"])
    bare = similar_ship(model, law, scaling.name or f"{model.name}_{scaling.length:g}m")
    speed = p.get("U_0", 0.0) or fastest  # of the model [m/s], at which friction is taken
    if scaling.speed is not None:
        speed = scaling.speed / math.sqrt(law.scale)
        sources = {key: text for key, text in bare.sources.items() if key != "U_0"}  # given, not by Froude's law
        bare = replace(bare, particulars={**bare.particulars, "U_0": scaling.speed}, sources=sources)
    elif not speed > 0:
        speed = TEST_FROUDE * reference_speed(p["L"])
    change = None if scaling.froude_only else _change(model, bare, scaling, speed, law)
    values = {s: c.value for s, c in model.coefficients.items()}
    scaled = ship_values(values, change) if change else {}
    if change and not set(scaled) & {*RESISTANCE, "w_P0", "a_0"}:
        roles = ", ".join(f"{role} {name}" for role, name in model.components.items())
        raise Missing(f"{model.name} ({roles}) has no coefficient of resistance or wake that friction would change; "
                        "scale it with --froude-only")  # fmt: skip
    added = doubts(model, values, scaled, change) if change else {}
    added = {s: doubt for s, doubt in added.items() if not model.coefficients[s].fixed and doubt.std > 0}
    fitted, covariance = _covariance(bare, symbols, correlation, added)
    # first order: what the estimates leave open goes through the laws, what scaling leaves open is added, independent
    J = _jacobian(model, fitted, change)
    covariance = J @ covariance @ J.T + np.diag([added[s].std ** 2 if s in added else 0.0 for s in fitted])
    std = np.sqrt(np.diag(covariance))
    safe = np.where(std > 0, std, 1.0)  # what is certain correlates with nothing
    matrix = covariance / np.outer(safe, safe)
    np.fill_diagonal(matrix, 1.0)  # where the quotient is 1 but for rounding, or 0
    rows = {
        s: _row(bare, s, scaled, dict(zip(fitted, std, strict=True)), added)
        for s in {**dict.fromkeys(fitted), **scaled}
    }
    ship = bare.with_coefficients(rows)
    return ScaledShip(model, ship, law, speed, change, tuple(scaled), added, fitted, matrix)


def _change(model: Ship, ship: Ship, scaling: Scaling, speed: float, law: Similarity) -> Change:
    """The waters of both. Raises UserError for particulars that are lacking."""
    p = model.particulars
    lacking = [name for name in ("B", "d") if name not in p]
    if "C_b" not in p and ("m" not in p or lacking):
        lacking.append("C_b")
    if lacking:
        raise Missing(
            f"{model.name} lacks {', '.join(lacking)} for its wetted surface and form factor; add it under [ship], or "
            "scale by Froude's law alone with --froude-only"
        )
    block = p.get("C_b") or p["m"] / (p["rho"] * p["L"] * p["B"] * p["d"])  # one form, hence one for both
    model_hull = HullInWater(p["L"], p["B"], p["d"], block, speed, p["rho"], scaling.roughness)
    q = ship.particulars
    other = HullInWater(q["L"], q["B"], q["d"], block, speed * math.sqrt(law.scale), q["rho"], scaling.roughness)
    return Change(model_hull, other, scaling.form_factor)


def _covariance(
    ship: Ship, symbols: Sequence[str], correlation: np.ndarray | None, added: Mapping[str, Doubt]
) -> tuple[tuple[str, ...], np.ndarray]:
    """Symbols (P,) that have, or get, a standard deviation, and their covariance (P, P) before scaling [unit of the
    ship]."""
    free = [s for s in ship.free if (0 < ship.coefficients[s].std < math.inf) or s in added]
    fitted = [s for s in symbols if s in free]
    order = (*fitted, *(s for s in free if s not in fitted))  # those without a correlation behind
    matrix = np.eye(len(order))
    if correlation is not None and fitted:
        at = [list(symbols).index(s) for s in fitted]
        matrix[: len(fitted), : len(fitted)] = np.nan_to_num(np.asarray(correlation, dtype=float)[np.ix_(at, at)])
        np.fill_diagonal(matrix, 1.0)
    std = np.array([ship.coefficients[s].std for s in order])
    std = np.where(np.isfinite(std), std, 0.0)  # infinite: never estimated; its error is what scaling adds alone
    return order, matrix * np.outer(std, std)


def _jacobian(model: Ship, symbols: Sequence[str], change: Change | None) -> np.ndarray:
    """Derivatives (P, P) of the scaled coefficients by those of the model, as mean slopes over a standard deviation on
    both sides: the laws have kinks."""
    J = np.eye(len(symbols))
    if change is None:
        return J
    values = {s: c.value for s, c in model.coefficients.items()}
    place = {s: i for i, s in enumerate(symbols)}
    # the others scale by themselves: t_P stays, and acts on the wakes
    for s in (s for s in place if s in ship_values(values, change) or s == "t_P"):
        std = model.coefficients[s].std
        h = max(STEP * max(abs(values[s]), 1e-3), std if math.isfinite(std) else 0.0)
        up, down = (ship_values({**values, s: values[s] + sign * h}, change) for sign in (1, -1))
        for target in up.keys() & place.keys():
            J[place[target], place[s]] = (up[target] - down[target]) / (2 * h)
    return J


def _row(
    ship: Ship, symbol: str, scaled: Mapping[str, float], std: Mapping[str, float], added: Mapping[str, Doubt]
) -> Coefficient:
    """The coefficient ``symbol`` of the scaled ship."""
    c = ship.coefficients[symbol]
    value, spread = scaled.get(symbol, c.value), std.get(symbol, c.std)
    if value == c.value and symbol not in added:
        return c.with_(std=spread)
    # bounds hold the new value and three standard deviations, and no sign that the model's bounds exclude
    lower, upper = min(c.lower, value - 3 * spread), max(c.upper, value + 3 * spread)
    lower = max(lower, 0.0) if c.lower >= 0 else lower
    upper = min(upper, 0.0) if c.upper <= 0 else upper
    how = "scaled by ITTC-78" if symbol in scaled else "that of the model, wider"
    return c.with_(value=value, std=spread, lower=lower, upper=upper, source=f"{how}; {c.source}" if c.source else how)
