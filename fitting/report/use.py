"""What a report says of the use of a calibrated ship: the trials and the form for IMO that are at hand, conditions of
trials beside those that IMO asks for (MSC/Circ.1053, 2.2.1.2), limits, what she is good for, and all of it on the first
screen. Outside of the range of motion and inputs that the trials held the model extrapolates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.io.site import NAME, read_site
from cases.shipfiles.particulars import BY_RULE
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
    draught, scale = ship.particulars["d"], ship.particulars.get("scale", 1.0)
    depth, depth_verdict = f"not stated: no [water] depth in {NAME} beside the trials", UNKNOWN
    try:
        site = read_site([trial.path for trial in trials if trial.path], ship)
        share = site.start.get("shallow_water", {}).get("d_h")
        if share is not None:  # d_h is draught over depth
            depth = f"{draught / share:.3g} m, {1 / share:.2g} draughts"
            depth_verdict = FULFILLED if 1 / share > DEEP else FAILED
    except UserError as error:
        depth = f"{NAME} cannot be used: {error}"
    wind, wind_verdict = "not logged" if trials else "the trial files are not there as they were", UNKNOWN
    means = {t.name: float(np.nanmean(t["wind_speed"])) for t in trials if t.has_wind}
    if means:
        strongest, missing = max(means, key=lambda name: means[name]), len(trials) - len(means)
        number = beaufort(means[strongest] * math.sqrt(scale))  # Froude's law
        wind = f"strongest mean {means[strongest]:.3g} m/s ({strongest}): Beaufort {number}"
        wind += f" at the scale of the ship (1:{scale:g})" if scale != 1.0 else ""
        wind += f"; {missing} of {len(trials)} trials log no wind" if missing else ""
        wind_verdict = FAILED if number > STRONGEST_WIND else UNKNOWN if missing else FULFILLED
    load, load_verdict = "; the full-load draught is not stated (--full-load-draught)", UNKNOWN
    if full_load is not None:
        load = f", {draught / full_load:.0%} of {full_load:g} m"
        load_verdict = FULFILLED if abs(draught / full_load - 1) <= DRAUGHT else FAILED
    return [
        Condition("water depth", depth, f"more than {DEEP:g} draughts", depth_verdict),
        Condition("wind", wind, f"not above Beaufort {STRONGEST_WIND}", wind_verdict),
        Condition("loading", f"draught {draught:g} m{load}", f"full-load draught within {DRAUGHT:.0%}", load_verdict),
    ]


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


# The first screen, for a master or a yard: is the ship right, for what, and how sure. It compares the figures of the
# standard manoeuvres that the trials hold with those of the model. Scores and coefficients come behind it.
OUTSIDE = " (!)"  # Mark of a tested figure that the model contradicts
OTHER = " (*)"  # Mark of a tested stop that is another manoeuvre than the model's
SIDES = ("port", "starboard")
MOST_MEASURED = 10  # Rows of figures of measured runs on the first screen. Set by hand: with more the track leaves it.


@dataclass(frozen=True)
class FirstScreen:
    """What a report says first.

    verdict: whether she is right; doubtful: whether that is a contradiction; causes: likely ones of it; errors: of
    predictions, in units, "" where none were scored; columns, groups, rows: table of tested and model's figures, as the
    macro ``table`` takes it; note: on the table; good, bad: uses in a few words each; rules: rules of thumb, and what
    hangs on them.
    """

    verdict: str
    doubtful: bool
    causes: tuple[str, ...]
    errors: str
    columns: tuple[str, ...]
    groups: tuple[tuple[str, tuple[str, ...]], ...]
    rows: tuple[tuple[str, ...], ...]
    note: str
    good: tuple[str, ...]
    bad: tuple[str, ...]
    rules: tuple[str, ...]

    @property
    def by_side(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Columns and rows of the table with a row for each side, as narrow as a terminal."""
        if not self.groups:
            return self.columns, list(self.rows)
        rows = []
        for name, *cells in self.rows:
            for number, side in enumerate(SIDES):  # cells: port and starboard in turn; a stop fills the first alone
                if any(cells[number::2]):
                    rows.append((name, side if any(cells[1::2]) else "", *cells[number::2]))
        return (*self.columns, "side", *(f"{title}|n" for title, _ in self.groups)), rows


def first_screen(
    result: Mapping[str, Any], ship: Ship, known: Delivered, good: Sequence[str], bad: Sequence[str]
) -> FirstScreen:
    """The first screen on a ``result``, content of result.json, and its ``ship``. known: trials and form at hand; good,
    bad: as of ``use_rows``."""
    form = known.form
    doubtful = bool(form and form.contradiction) or bool(doubts(result)) or not result["converged"]
    rules, every = list[str](), {row.group for row in form.rows} if form else set()
    for rule, names in form.rules.items() if form else ():  # what hangs on a rule of thumb
        some = ", ".join(name.split(",")[0].lower() for name in names)
        rules.append(f"{rule} ({some if every - set(names) else 'all figures'})")
    particulars = [name for name, source in ship.sources.items() if source.startswith(BY_RULE)]
    rules += [f"particulars {', '.join(particulars)}"] if particulars else []
    columns: tuple[str, ...] = ("figure",)
    if form:
        groups, rows, note = _form_table(form)
    else:
        columns, groups = ("run", "figure", "measured|n", "predicted|n"), ()
        pair = result["scores"].get("validation") or result["scores"].get("training")
        units = (pair and pair["after"].get("units")) or {"runs": []}
        rows = [
            (run["name"], f"{maneuver['title']}: {f['figure'].replace('_', ' ')} [{f['unit']}]",
             *("" if f[key] is None else f"{f[key]:.3g}" for key in ("measured", "predicted")))
            for run in units["runs"]
            for maneuver in run["maneuvers"]
            for f in maneuver["figures"]
        ][:MOST_MEASURED]  # fmt: skip
        note = "Predicted from the order on, with the measured rudder and revolutions. " * bool(rows)
        note += f"Standard manoeuvres of the model: {known.no_form}"
    return FirstScreen(
        verdict=_verdict(result, form),
        doubtful=doubtful,
        causes=form.causes if form and form.contradiction else (),
        errors=_errors(result, ship.particulars["L"]),
        columns=columns,
        groups=groups,
        rows=tuple(rows),
        note=note,
        good=tuple(dict.fromkeys(use.partition(":")[0] for use in good)),
        bad=tuple(dict.fromkeys(use.partition(":")[0] for use in bad)),
        rules=tuple(rules),
    )


# Codes of messages on a calibration by which no ship is right, whatever her figures are.
DOUBTS = ("not_converged", "worse_than_persistence")


def doubts(result: Mapping[str, Any]) -> list[str]:
    """What of a ``result`` speaks against its ship by itself: sentences of its messages with one of DOUBTS."""
    said = {m["code"]: m["text"] for m in reversed(result.get("messages", []))}
    return [said[code] for code in DOUBTS if code in said]


def _verdict(result: Mapping[str, Any], form: ImoForm | None) -> str:
    """Whether the ship is right, by the strongest evidence there is."""
    against = doubts(result)
    if not result["converged"]:
        return "Not usable: the calibration did not converge."
    if form and form.contradiction:
        return form.contradiction
    judged = [side for row in form.rows for side in row.sides if side.contradicts is False] if form else []
    if judged:
        which = f"all {len(judged)} compared figures lie" if len(judged) > 1 else "the one compared figure lies"
        words = f"{which} inside of the model's 90 % intervals of a single trial"
        vague = sum(side.is_vague for side in judged)
        if against:
            return f"Doubtful: {words}, but {against[0]}."
        if 2 * vague > len(judged):
            return f"Undecided: {words}, but {vague} of these are wider than the figure itself."
        return f"Right so far: {words}."
    if against:
        return f"Doubtful: {against[0]}."
    if result.get("scaling"):
        return "Not tested: she is scaled from a model, and no trial of the ship herself took part."
    if "validation" in result["scores"]:
        return "No figure of a standard manoeuvre is compared here: she is judged by predictions of held-out trials."
    return "Not judged: no trial was held out, and no figure of a standard manoeuvre is compared here."


def _errors(result: Mapping[str, Any], length: float) -> str:
    """How far predictions end from the measured runs; "" where none were scored in units. length: of the ship [m]."""
    held_out = "validation" in result["scores"]
    pair = result["scores"].get("validation" if held_out else "training")
    units = pair and pair["after"].get("units")
    if not units or units["pooled"]["position_end_m"] is None:
        return ""
    pooled, count = units["pooled"], sum(run["windows"] > 0 for run in units["runs"])
    which = f"{count} {'held-out' if held_out else 'training'} trial{'s' * (count != 1)}"
    position, heading = pooled["position_end_m"], pooled["heading_end_deg"]
    words = f"On {which} predictions of {units['window_s']:g} s end {position:.2g} m ({position / length:.2g} L) "
    words += f"and {heading:.2g} deg off (rms)"
    return words + (", on the trials that she was fitted to." if not held_out else ".")


def _form_table(form: ImoForm) -> tuple[tuple[tuple[str, tuple[str, ...]], ...], list[tuple[str, ...]], str]:
    """Groups of columns, rows and note of the table of tested and model's figures."""
    model = ("model [90 %]" if form.intervals else "model", SIDES)
    rows = []
    for row in form.rows:
        sides = [*row.sides, None][:2]  # a stop has one
        tested = [
            side.tested.words(row.unit) + OUTSIDE * bool(side.contradicts) + OTHER * side.is_other
            if side and side.tested
            else ""
            for side in sides * bool(form.tested)
        ]
        modelled = [side.model.words(row.unit, of_trial=True) if side and side.model else "" for side in sides]
        name = f"{row.group.split(',')[0]}: {row.name.lower().removesuffix(' angle')} [{row.unit}]"
        rows.append((name, *tested, *modelled))
    note = f"{OUTSIDE.strip()} lies outside of the interval. " * bool(form.contradiction)
    others = any(side.is_other and side.tested for row in form.rows for side in row.sides)
    note += f"{OTHER.strip()} stopped by other revolutions than the model's stop, not compared. " * others
    note += "90 % of single trials of ships that the trials allow. " * form.intervals
    read = any("±" in cell for row in rows for cell in row)
    note += "±: what a tested figure changes by between two samples. " * read
    return (("tested", SIDES), model) if form.tested else (model,), rows, note + "L: ship lengths."
