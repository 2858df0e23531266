"""A scaled ship as a result like that of a calibration, with what was assumed on the way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.ship_file import load_ship, ship_of
from delivery.full_scale.scaled_ship import ScaledShip, Scaling, scaled_ship
from delivery.full_scale.similarity import dropped_effects, similar_adaptation, similar_bands, similar_envelope
from fitting.record import CoefficientRow, Correlation, MessageRow
from fitting.report.run_folder import content_on, of_predictions, versions
from fitting.result import FitResult, read_fit
from fitting.settings import Settings
from mmg.components.friction import ROUGHNESS
from mmg.errors import UserError, refusing
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

if TYPE_CHECKING:
    from residual.result import TrainResult

NOT_CALIBRATED = "not calibrated"  # Status of a result that holds the priors of a ship


def result_of(source: str | Path | Ship | FitResult) -> FitResult:
    """What is known of a ``source``: a result, the run folder of a calibration, a ship, or what ``load_ship`` takes.

    A ship without a calibration is known by its priors. Raises UserError for what is none of these.
    """
    if isinstance(source, FitResult):
        return source
    if isinstance(source, Ship):
        return _of_ship(source)
    folder = Path(source)
    content = content_on(folder)
    if content.get("kind") == "calibration":
        return read_fit(folder)
    content = of_predictions(content)
    return replace(_of_ship(load_ship(source)), bands=content.get("bands"), adaptation=content.get("adaptation"))


def _without_trials(ship: Ship, start: Ship) -> FitResult:
    """A result on ``ship`` that no trial belongs to, without coefficients."""
    return FitResult(
        created=datetime.now(timezone.utc).isoformat(timespec="seconds"), command="", ship_name=ship.name,
        converged=True, status=NOT_CALIBRATED, advice="", objective=None, constraint_violation=None,
        condition_number=None, iterations=0, passes=(), starts=(), settings=Settings(), versions=versions(),
        compiled=False, timings_s={}, data=(), validation_data=(), windows=0, intervals=0, seconds_used=0.0, sigma={},
        noise={}, estimates={}, fixed=tuple(s for s in ship.symbols if ship.coefficients[s].fixed),
        correlation=Correlation((), ()), scores={}, identifiability={}, messages=(), ship=ship, start=start,
    )  # fmt: skip


def _of_ship(ship: Ship) -> FitResult:
    free, rows = [s for s in ship.free if 0 < ship.coefficients[s].std < math.inf], {}
    for s in free:
        c = ship.coefficients[s]
        rows[s] = CoefficientRow(c.value, c.std, c.value, c.std, _finite(c.lower), _finite(c.upper), None, 1.0,
                                 c.verdict or "prior", c.description, c.unit, c.prime)  # fmt: skip
    # no run, no correlation: each stands for itself
    independent = Correlation(tuple(free), tuple(tuple(float(a == b) for b in free) for a in free))
    return replace(_without_trials(ship, ship), estimates=rows, correlation=independent)


def scaled_result(source: str | Path | Ship | FitResult, scaling: Scaling, command: str = "") -> FitResult:
    """The ship of ``source`` at the length of ``scaling``, with its covariance, ranges and bands.

    source: as for ``result_of``; one that was scaled before is scaled from its model again, so that two steps are one.
    command: the command line. Raises UserError as ``scaled_ship`` does.
    """
    model = result_of(source)
    model = model.model or model  # of a scaled ship the model that it was scaled from
    matrix = np.array(model.correlation.matrix, dtype=float)
    fastest = max(map(abs, (model.envelope or {}).get("u", [0.0])))  # 0: not known
    scaled = scaled_ship(model.ship, scaling, model.correlation.symbols, matrix if matrix.size else None, fastest)
    priors = scaled_ship(_prior_ship(model), scaling, fastest=fastest).ship  # by the same laws as the estimates
    estimates = _coefficient_rows(model, scaled, priors)
    named = {
        s: scaled.ship.coefficients[s].with_(verdict=row.verdict, prior_value=row.prior_value, prior_std=row.prior_std)
        for s, row in estimates.items()
    }
    symbols = tuple(s for s in scaled.symbols if s in estimates)
    at = [scaled.symbols.index(s) for s in symbols]
    matrix = scaled.correlation[np.ix_(at, at)]
    start = scaled_ship(model.start, scaling, fastest=fastest).ship
    return replace(
        _without_trials(scaled.ship.with_coefficients(named), start), command=command, model=model,
        converged=model.converged, status=model.status, advice=model.advice, settings=model.settings,
        compiled=model.compiled, fixed=model.fixed, estimates=estimates, messages=_messages(model, scaled),
        correlation=Correlation(symbols, tuple(tuple(map(float, row)) for row in matrix)),
        bands=similar_bands(model.bands, scaled.law), adaptation=similar_adaptation(model.adaptation, scaled.law),
        envelope=similar_envelope(model.envelope, scaled.law), scaling=_account(model, scaled, scaling),
    )  # fmt: skip


@refusing
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
    return scaled_result(model if isinstance(model, (str, Path, FitResult)) else ship_of(model), scaling)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _prior_ship(model: FitResult) -> Ship:
    """The model with the priors of its coefficients in place of the estimates."""
    rows = {}
    for s, row in model.estimates.items():
        if s in model.ship.coefficients and row.prior_value is not None:
            rows[s] = model.ship.coefficients[s].with_(value=row.prior_value, std=row.prior_std or 0.0)
    return model.ship.without_network().with_coefficients(rows)


def _coefficient_rows(model: FitResult, scaled: ScaledShip, priors: Ship) -> dict[str, CoefficientRow]:
    rows = {}
    for s in scaled.symbols:
        c, prior = scaled.ship.coefficients[s], priors.coefficients[s]
        old = model.estimates.get(s)
        verdict = (old.verdict if old else c.verdict) or "prior"
        if s in scaled.changed:
            verdict = f"{model.ship.coefficients[s].value:.4g} of the model, scaled by ITTC-78; there: {verdict}"
        bound = old.at_bound if old and s not in scaled.changed else None  # a changed value has left its bound
        share = (c.std / prior.std) ** 2 if prior.std > 0 else None  # of the prior's variance that is left
        rows[s] = CoefficientRow(
            c.value, c.std, prior.value, prior.std, _finite(c.lower), _finite(c.upper), bound,
            share, verdict, c.description, c.unit, c.prime,
        )  # fmt: skip
    return rows


def _messages(model: FitResult, scaled: ScaledShip) -> tuple[MessageRow, ...]:
    """What must be known of the ship: the model's state, what was left out, what was assumed."""
    rows = []
    if not model.converged:
        rows.append(("warning", "not_converged", f"the calibration of the model did not converge ({model.status})"))
    if model.status == NOT_CALIBRATED:
        words = "standard deviations are those of the ship file, taken as independent of each other: no run is known"
        rows.append(("notice", "independent_priors", words))
    if gone := dropped_effects(model.ship):
        words = "left with the model, as they belong to its place, instruments or steering gear: " + ", ".join(gone)
        rows.append(("notice", "effects_left_out", words))
    if scaled.ship.network is not None:
        words = "the learned residual is scaled by Froude's law: it was trained at the model's Reynolds number"
        rows.append(("warning", "residual_scaled", words))
    rows += [("notice", "assumed", words) for words in assumptions(scaled)]
    return tuple(MessageRow(*row) for row in rows)


def assumptions(scaled: ScaledShip) -> list[str]:
    """What was assumed on the way from model to ship, in sentences. scaled: the scaled ship."""
    same = "hull forces, added masses, thrust deduction and open-water thrust keep their dimensionless values"
    first = "equal Froude numbers: lengths by the scale, times and speeds by its square root"
    if scaled.change is None:
        return [first, f"{same}, and so do resistance and wake: Froude's law alone was asked for"]
    model, ship = scaled.change.model, scaled.change.ship
    return [
        first,
        same,
        f"friction and wake are those at {ship.speed:.4g} m/s of the ship and {model.speed:.4g} m/s of the model "
        f"(Froude number {model.froude:.3f}, Reynolds numbers {ship.reynolds:.3g} and {model.reynolds:.3g})",
        "the boundary layer of the model is turbulent from the bow",
        "the ship is loaded as the model is ballasted: same draught, trim and radius of gyration by L",
        "the rudder's flow straightening and the hull's share of its force are those of the model, with wider errors",
        "the engine holds the revolutions that are ordered; a direct-reversible diesel obeys in a crash stop",
    ]


def _account(model: FitResult, scaled: ScaledShip, scaling: Scaling) -> dict[str, Any]:
    """The section ``scaling`` of result.json."""
    old, new = model.ship, scaled.ship
    rows = []
    for s in dict.fromkeys((*scaled.changed, *scaled.doubts)):
        doubt, before, after = scaled.doubts.get(s), old.coefficients[s], new.coefficients[s]
        rows.append({
            "symbol": s, "model": before.value, "model_std": before.std, "ship": after.value, "ship_std": after.std,
            "added_std": doubt.std if doubt else 0.0, "source": doubt.source if doubt else "follows from the others",
            "changed": s in scaled.changed,
        })  # fmt: skip
    speed = scaled.speed * math.sqrt(scaled.law.scale)  # of the ship, at the Froude number of the model
    return {
        "model": {"ship": old.name, "length_m": old.particulars["L"], "status": model.status,
                  "trials": [row.name for row in model.data]},
        "length_m": new.particulars["L"],
        "scale": scaled.law.scale,
        "density_ratio": scaled.law.density,
        "froude_only": scaling.froude_only,
        "water": {"model": _water(scaled, 0), "ship": _water(scaled, 1)} if scaled.change else None,
        "coefficients": rows,
        "particulars": [{"symbol": s, "model": value, "ship": new.particulars.get(s)}
                        for s, value in old.particulars.items()],
        "self_propulsion": {"model": self_propulsion(old, scaled.speed), "ship": self_propulsion(new, speed)},
        "assumptions": assumptions(scaled),
        "left_out": list(dropped_effects(old)),
    }  # fmt: skip


def _water(scaled: ScaledShip, side: int) -> dict[str, float]:
    assert scaled.change is not None
    water = (scaled.change.model, scaled.change.ship)[side]
    k = scaled.change.form_factor
    return {
        "speed_m_s": water.speed, "froude": water.froude, "reynolds": water.reynolds, "density": water.density,
        "friction": water.C_F, "allowance": water.allowance, "form_factor": water.watanabe if k is None else k,
        "wetted_surface_m2": water.surface * water.L * water.d,
    }  # fmt: skip


def self_propulsion(ship: Ship, speed: float) -> dict[str, float | None]:
    """Where a ``ship`` holds a ``speed`` [m/s]: revolutions n [1/s], and J, K_T, loading C_Th = 8 K_T / (pi J^2) [-].

    None for what its model does not give.
    """
    point: dict[str, float | None] = {"speed_m_s": speed, "froude": speed / reference_speed(ship.particulars["L"])}
    point |= dict.fromkeys(("n", "J", "K_T", "C_Th"))
    try:
        n = point["n"] = revolutions_for(ship, speed)
    except UserError:
        return point
    c: Mapping[str, Any] = ship.coefficients
    if {"w_P0", "k_0", "k_1", "k_2"} <= c.keys() and "D_P" in ship.particulars:
        J = speed * (1 - c["w_P0"].value) / (n * ship.particulars["D_P"])
        K = c["k_0"].value + c["k_1"].value * J + c["k_2"].value * J * J
        point |= {"J": J, "K_T": K, "C_Th": 8 * K / (math.pi * J * J)}
    return point
