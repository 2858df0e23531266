"""What a report says of the use of a calibrated ship: the trials and the form for IMO that are at hand, conditions of
trials beside those that IMO asks for (MSC/Circ.1053, 2.2.1.2), limits, and what she is good for. Outside of the range
of motion and inputs that the trials held the model extrapolates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.io.site import NAME, read_site
from cases.trial import Trial
from fitting.prediction.envelope import DEGREES, DRIFT, trial_envelope
from fitting.report.run_folder import rows_by_role, trials_again
from mmg.components.friction import MODEL
from mmg.effects import effect
from mmg.errors import UserError
from mmg.motion.flow import INPUTS, RUDDERS
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.report.imo_form import ImoForm

LATER = "mmg report RUN adds it (without --no-imo): its figures are simulated with draws of the coefficients."


@dataclass(frozen=True)
class Delivered:
    """What a page needs beside the record of a run.

    trials: those at hand; absent: sentences on the others; form: None where it was not asked for or cannot be made,
    with the reason in ``no_form``; full_load: draught [m] of the fully loaded ship, None where it is not known;
    figure: of ``imo_form.drawn_maneuvers``.
    """

    trials: tuple[Trial, ...] = ()
    absent: tuple[str, ...] = ()
    form: ImoForm | None = None
    no_form: str = LATER
    full_load: float | None = None
    figure: dict[str, Any] | None = None


def delivered(result: Mapping[str, Any], ship: Ship, full_load: float | None = None, imo: bool = True) -> Delivered:
    """Trials read again and the form for IMO of a run, of whose calibrated or hybrid ``ship`` the ``result`` speaks.

    result: content of result.json; full_load: draught [m] of the fully loaded ship; imo: with the form. Raises
    UserError for a draught that the model cannot be carried to.
    """
    trials, absent = trials_again(rows_by_role(result))
    known = Delivered(tuple(trial for _, trial in trials), tuple(absent), full_load=full_load)
    if not imo:
        return known
    from fitting.report.imo_form import drawn_maneuvers, imo_form, standard_figures  # late: a fit leaves the form out

    try:
        model = standard_figures(result, ship)
        form = imo_form(ship, known.trials, model, result, full_load)
        return replace(known, form=form, figure=drawn_maneuvers(model))
    except UserError as error:
        if full_load is not None and "--full-load-draught" in str(error):
            raise  # what the user gave is refused; a form that cannot be made is said on the page
        return replace(known, no_form=f"It cannot be made: {error}.")


def delivery_sections(result: Mapping[str, Any], ship: Ship, known: Delivered) -> dict[str, Any]:
    """What the template shows of a ``result`` and its ``ship`` in the sections on use. result: content of result.json;
    known: beside it."""
    envelope: Mapping[str, Sequence[float]] = result.get("envelope") or trial_envelope(ship, known.trials)
    good, bad = use_rows(envelope, ship, any(row.get("has_wind") for row in result["data"]))
    return {
        "known": known,
        "conditions": condition_rows(ship, known.trials, known.full_load) if known.trials else [],
        "limits": limit_rows(envelope, ship.particulars["L"]),
        "hybrid_form": ship.network is not None,
        "good": good,
        "bad": bad,
    }


FULFILLED, FAILED, UNKNOWN = "fulfilled", "not fulfilled", "unknown"
# Depth over draught, Beaufort number and deviation from the full-load draught by IMO MSC/Circ.1053 (2002), 2.2.1.2.
DEEP, STRONGEST_WIND, DRAUGHT = 4.0, 5, 0.05


@dataclass(frozen=True)
class Condition:
    """One condition: what it is, what was found, what IMO asks for, and "fulfilled", "not fulfilled" or "unknown"."""

    name: str
    found: str
    asked: str
    verdict: str


def beaufort(speed: float) -> int:
    """Beaufort number of a wind ``speed`` [m/s] at 10 m height: v = 0.836 B^1.5 (World Meteorological Organization)."""
    return min(12, round((max(speed, 0.0) / 0.836) ** (2 / 3)))


def condition_rows(ship: Ship, trials: Sequence[Trial], full_load: float | None = None) -> list[Condition]:
    """The conditions of ``trials`` of a ``ship`` beside those that the circular asks for.

    trials: those whose files are there, for wind, speed and the site file beside them; full_load: draught of the fully
    loaded ship [m], at the length of the ship file, None where it is not known.
    """
    return [_depth(ship, trials), _wind(ship, trials), _loading(ship, full_load)]


def _depth(ship: Ship, trials: Sequence[Trial]) -> Condition:
    required, draught = f"more than {DEEP:g} draughts", ship.particulars["d"]
    paths = [trial.path for trial in trials if trial.path]
    try:
        share = read_site(paths, ship).start.get("shallow_water", {}).get("d_h")
    except UserError as error:
        return Condition("water depth", f"{NAME} cannot be used: {error}", required, UNKNOWN)
    if share is None:  # d_h is draught over depth
        return Condition("water depth", f"not stated: no [water] depth in {NAME} beside the trials", required, UNKNOWN)
    verdict = FULFILLED if 1 / share > DEEP else FAILED
    return Condition("water depth", f"{draught / share:.3g} m, {1 / share:.2g} draughts", required, verdict)


def _wind(ship: Ship, trials: Sequence[Trial]) -> Condition:
    required, scale = f"not above Beaufort {STRONGEST_WIND}", ship.particulars.get("scale", 1.0)
    means = {t.name: float(np.nanmean(t["wind_speed"])) for t in trials if t.has_wind}
    if not means:
        why = "not logged" if trials else "the trial files are not there as they were"
        return Condition("wind", why, required, UNKNOWN)
    strongest = max(means, key=lambda name: means[name])
    number = beaufort(means[strongest] * math.sqrt(scale))  # Froude's law
    words = f"strongest mean {means[strongest]:.3g} m/s ({strongest}): Beaufort {number}"
    words += f" at the scale of the ship (1:{scale:g})" if scale != 1.0 else ""
    missing = len(trials) - len(means)
    words += f"; {missing} of {len(trials)} trials log no wind" if missing else ""
    verdict = FAILED if number > STRONGEST_WIND else UNKNOWN if missing else FULFILLED
    return Condition("wind", words, required, verdict)


def _loading(ship: Ship, full_load: float | None) -> Condition:
    draught, required = ship.particulars["d"], f"full-load draught within {DRAUGHT:.0%}"
    if full_load is None:
        words = f"draught {draught:g} m; the full-load draught is not stated (--full-load-draught)"
        return Condition("loading", words, required, UNKNOWN)
    verdict = FULFILLED if abs(draught / full_load - 1) <= DRAUGHT else FAILED
    return Condition(
        "loading", f"draught {draught:g} m, {draught / full_load:.0%} of {full_load:g} m", required, verdict
    )


# Quantity -> words, unit in which it is shown, factor from SI.
WORDS = {
    "u": ("surge velocity", "m/s", 1.0),
    "v": ("sway velocity at midship", "m/s", 1.0),
    "r": ("yaw rate", "deg/s", DEGREES),
    DRIFT: ("drift angle, positive where the water comes from port", "deg", DEGREES),  # MMG: beta = atan2(-v, u)
    "a_x": ("air relative to the hull, ahead", "m/s", 1.0),
    "a_y": ("air relative to the hull, to starboard", "m/s", 1.0),
}


def limit_rows(envelope: Mapping[str, Sequence[float]], length: float) -> list[dict[str, Any]]:
    """Rows for the table of an ``envelope``: name, words, unit, low, high, and what is dimensionless of it. length: of
    the ship [m]."""
    rows, speed = [], max(map(abs, envelope.get("u", [0.0])))
    more = {"u": f"Froude number up to {speed / reference_speed(length):.2g}"}
    if speed > 0 and "r" in envelope:
        slow, fast = (value * length / speed for value in envelope["r"])
        more["r"] = f"r L / U at the highest speed {slow:.2g} to {fast:.2g}".replace("-", "−")
    # motion, actuators (2.5: behind r), drift angle and air
    for name in sorted(envelope, key=lambda name: list(WORDS).index(name) if name in WORDS else 2.5):
        words, unit, factor = shown_quantity(name)
        low, high = (factor * value for value in envelope[name])
        row = {"name": name, "words": words, "unit": unit, "low": low, "high": high, "more": more.get(name, "")}
        rows.append(row)
    return rows


def shown_quantity(name: str) -> tuple[str, str, float]:
    """Words, unit and its factor from SI of a quantity ``name`` of an envelope: a motion, air or an actuator."""
    if name in WORDS:
        return WORDS[name]
    words, unit = INPUTS[name]
    return words, {"rad": "deg", "rps": "1/s"}.get(unit, unit), DEGREES if unit == "rad" else 1.0


def use_rows(envelope: Mapping[str, Sequence[float]], ship: Ship, windy: bool = True) -> tuple[list[str], list[str]]:
    """What a model calibrated on trials of this ``envelope`` is good for, and what not, in sentences.

    ship: the calibrated one; windy: whether any of the trials logs wind. Both follow from the ranges,
    the force models and the effects alone.
    """
    speeds = "at u from {:.3g} to {:.3g} m/s ".format(*envelope["u"]) if "u" in envelope else ""
    excited, unseen = _excited(envelope)
    good = [f"manoeuvres {speeds}in deep, open water: within the limits of use above", *excited]
    single = "reading a single coefficient as physics: only the whole is calibrated"
    bad = [*unseen, *_not_modelled(ship, windy), f"{single}, where section 3 says shared, prior or not excited"]
    if ship.particulars["L"] < MODEL:
        bad.append("the full-scale ship: only after mmg scale, Froude's law with other friction and wake")
    return good, bad


def _excited(envelope: Mapping[str, Sequence[float]]) -> tuple[list[str], list[str]]:
    """Uses that the ranges of the trials support, and those that they rule out."""
    largest = {name: max(map(abs, pair)) for name, pair in envelope.items()}
    judged: list[tuple[bool, str, str]] = []  # whether it was in the trials, the use if so, the use if not
    # the shares and angles below are set by hand
    if "u" in envelope:
        unseen = "stopping, going astern and manoeuvring near rest: the ship never did it in the trials"
        judged.append((envelope["u"][0] <= 0.05 * envelope["u"][1], "manoeuvring near rest", unseen))
    if "n" in envelope:
        low, high = envelope["n"]
        unseen = "reversed propeller: n was never below 0, so crash stops rest on the prior alone"
        judged.append((low < 0, f"reversed propeller: n down to {low:.2g} 1/s", unseen))
        unseen = "other revolutions: n hardly changed, so thrust and resistance are not told apart"
        judged.append(
            (high - low >= 0.05 * largest["n"], f"changes of revolutions: n from {low:.2g} to {high:.2g} 1/s", unseen)
        )
    if DRIFT in envelope:
        angle = f"{DEGREES * largest[DRIFT]:.0f} deg"
        unseen = f"berthing and cross flow: drift angles beyond {angle} were not seen"
        judged.append((largest[DRIFT] >= np.radians(30), f"berthing and cross flow: drift angles to {angle}", unseen))
    for name in (name for name in RUDDERS if name in envelope):
        angle = f"{DEGREES * largest[name]:.0f} deg"
        unseen = f"hard-over rudder: {name} stayed within {angle}, without stall"
        judged.append((largest[name] >= np.radians(34), f"hard-over rudder: {name} to {angle}", unseen))
    return [yes for seen, yes, _ in judged if seen], [no for seen, _, no in judged if not seen]


def _not_modelled(ship: Ship, windy: bool) -> list[str]:
    """Uses that the force models and effects of the ``ship`` rule out."""
    bad = []
    if not ship.feels_wind:
        bad.append("wind: the model has no wind forces")
    elif not windy:
        bad.append("wind: the trials log none, so its forces are those of the model's regression")
    if not {"shallow_water", "bank"} & set(ship.effects):
        bad.append("shallow water, banks, locks and passing ships: the model knows none of them")
    if "waves" not in ship.components:
        bad.append("waves: the model has no wave forces")
    place = [name for name in ship.effects if effect(name).surroundings]
    if place:
        words = f"other places and days with the effects as fitted ({', '.join(place)})"
        bad.append(f"{words}: they belong to the trials, set them to 0")
    if ship.network is not None:
        bad.append("states outside the network's training range: the residual is bounded there, not supported")
    bad.append("heel, trim and squat: three degrees of freedom (surge, sway, yaw)")
    if "actuators" not in ship.components:
        bad.append("lags of rudder and propeller: they act as logged")
    return bad
