"""Manoeuvring data of a ship in the form that IMO asks for (MSC/Circ.1053, appendix 6), with 90 % intervals.

Tested: the standard manoeuvres among the trials. Model: the calibrated ship in calm air and deep water. Corrected to
full load: R = T F / B (3.4.1, option 1), with T tested, and F and B the model at full load and as tested. The intervals
are those of ``fitting.prediction.figure_intervals``, as ``mmg imo`` gives them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cases.criteria.imo import FAIL, OPEN, PASS, Assessment, Row, imo_figures, imo_figures_of_trials
from cases.trial import Trial
from fitting.prediction.figure_intervals import DRAWS, FigureScatter, JudgedFigures, with_intervals
from mmg.errors import Conflict, OutOfRange, UserError
from mmg.messages import has_code
from mmg.ship import Ship

LOW, HIGH = 0.05, 0.95
FORM = (
    ("Turning circle, 35° rudder", "turning:35", (("advance", "Advance"), ("tactical_diameter", "Tactical diameter"))),
    ("Zig-zag 10°/10°", "zigzag:10/10",
     (("overshoot_1", "1st overshoot angle"), ("overshoot_2", "2nd overshoot angle"))),
    ("Zig-zag 20°/20°", "zigzag:20/20", (("overshoot_1", "1st overshoot angle"),)),
    ("Initial turning", "zigzag:10/10", (("initial_turning_track", "Distance to turn 10° with 10° rudder"),)),
    ("Stopping", "crash-stop", (("track_reach", "Track reach"),)),
)  # fmt: skip
"""Groups of the form: title, manoeuvre to starboard, figures with their words."""
ELSEWHERE = ("not_checked", "outside_the_trials")
"""Codes of notices on the model's runs that other parts of a page say."""
UNITS = {"L": "L", "deg": "deg"}
"""Units of the form; L: ship lengths."""


@dataclass(frozen=True)
class FormValue:
    """A figure in the unit of the form, the median of its draws where there are any. interval: 90 %, its upper end
    infinite where more than 5 % of the draws never reach the figure, None where no covariance is known; count: of runs
    behind it."""

    value: float
    interval: tuple[float, float] | None = None
    count: int = 1


@dataclass(frozen=True)
class FormSide:
    """A figure on one side: tested, of the model, corrected to full load; each None where it is not known. verdict: of
    the corrected value, else the tested, else the model's; why: what stands behind it."""

    tested: FormValue | None
    model: FormValue | None
    corrected: FormValue | None
    verdict: str
    why: str = ""


@dataclass(frozen=True)
class FormRow:
    """One line of the form; sides: port and starboard, or one for a stop."""

    group: str
    name: str
    unit: str
    limit: float | None
    sides: tuple[FormSide, ...]


@dataclass(frozen=True)
class ImoForm:
    """The form. heading: of the model's runs; rows; remarks: what is to be known of it; full_load: draught [m];
    intervals: whether the model's figures have any; widened: whether they grow where a manoeuvre leaves the trials."""

    heading: str
    rows: tuple[FormRow, ...]
    remarks: tuple[str, ...]
    full_load: float | None = None
    intervals: bool = False
    widened: bool = False

    @property
    def tested(self) -> bool:
        """Whether any figure was tested."""
        return any(side.tested for row in self.rows for side in row.sides)

    @property
    def corrected(self) -> bool:
        """Whether any figure was corrected to full load."""
        return any(side.corrected for row in self.rows for side in row.sides)


def imo_form(
    ship: Ship,
    trials: Sequence[Trial],
    model: JudgedFigures,
    result: Mapping[str, Any] | None = None,
    full_load: float | None = None,
) -> ImoForm:
    """The form of a calibrated ``ship``.

    trials: measured, of which the standard manoeuvres are the tested figures; model: her standard manoeuvres with the
    draws behind their intervals, none where no covariance is known; result: content of her result.json, of which the
    loaded ship is drawn too; full_load: draught of the fully loaded ship [m]. Raises UserError for a draught that the
    model cannot be carried to, and when no manoeuvre of the model reaches its event.
    """
    remarks: list[str] = []
    found = model.assessment
    loaded = _loaded(ship, full_load) if full_load is not None else None
    tested = _tested(ship, trials, remarks)
    factors = _factors(loaded, model, result or {}, remarks) if loaded is not None and tested else {}
    remarks += _of_intervals(model) + _of_correction(full_load, bool(tested))
    by_name = {(row.run, row.figure): row for row in found.rows}
    rows = []
    for group, text, figures in FORM:
        sides = (text,) if text == "crash-stop" else (text.replace(":", ":-"), text)
        for figure, words in figures:
            known = [by_name.get((side, figure)) for side in sides]
            first = next((row for row in known if row is not None), None)
            cells = tuple(
                _side(row, tested.get((side, figure)), factors.get((side, figure)))
                for side, row in zip(sides, known, strict=True)
            )
            unit = first.unit if first else "L"
            rows.append(FormRow(group, words, UNITS.get(unit, unit), first.limit if first else None, cells))
    remarks += [f"the model's figures alone: {found.verdict} ({found.basis})"] if found.basis else []
    remarks += [str(note) for note in found.notices if not any(has_code([note], code) for code in ELSEWHERE)]
    drawn = model.scatter.values()
    widened = bool(drawn) and all(one.widened for one in drawn)
    return ImoForm(found.heading, tuple(rows), tuple(dict.fromkeys(remarks)), full_load, bool(drawn), widened)


def _of_intervals(model: JudgedFigures) -> list[str]:
    if not model.scatter:
        return []
    outside = ", ".join(name for name, one in model.scatter.items() if one.outside)
    return [
        f"intervals: 90 % of {DRAWS} ships that the trials allow, the same draws as in the table of figures below; a "
        "test's own scatter comes on top"
    ] + ([f"the manoeuvre leaves what the trials held, so its figures are extrapolated: {outside}"] if outside else [])


def _of_correction(full_load: float | None, tested: bool) -> list[str]:
    if full_load is None:
        return ["no correction to full load: that draught is not known; give it with --full-load-draught"]
    if not tested:
        return ["no correction to full load: R = T F / B needs tested figures T, and no trial is a standard test"]
    return [
        "corrected: R = T F / B (MSC/Circ.1053, 3.4.1), F and B by the model at full load and as tested; draught and "
        "mass grow, the primed coefficients stay: how they change with draught is not known and not in the interval"
    ]


def _side(row: Row | None, tested: FormValue | None, factor: np.ndarray | None) -> FormSide:
    """One side from the model's ``row``, the tested value, and F / B of the ship and of the draws."""
    model = corrected = None
    if row is not None and row.value is not None:
        model = FormValue(row.value, row.interval_90)
    if tested is not None and factor is not None:
        draws = _quantiles(tested.value * factor[1:])
        low, middle, high = draws or (math.nan, tested.value * float(factor[0]), math.nan)
        corrected = FormValue(middle, (low, high) if draws else None, tested.count)
    limit, why = (row.limit, row.why) if row is not None else (None, "")
    judged = corrected or tested or model
    verdict = row.verdict if row is not None else OPEN
    # a figure of the model that no trial supports is not judged, but a tested one is
    applies = row is not None and (verdict in (PASS, FAIL) or row.probability is not None)
    if applies and judged is not None and judged is not model and limit is not None:
        verdict = PASS if judged.value <= limit else FAIL
    if verdict in (PASS, FAIL) and judged is not None and judged.interval and limit is not None:
        low, high = judged.interval
        verdict += ", within the interval" if low <= limit < high else ""
    return FormSide(tested, model, corrected, verdict, why)


def _quantiles(values: np.ndarray) -> tuple[float, float, float] | None:
    """Quantiles at LOW, 0.5 and HIGH of the finite ``values`` (M,), None for fewer than half of them."""
    good = values[np.isfinite(values)]
    if len(good) < max(20, len(values) // 2):
        return None
    low, middle, high = (float(q) for q in np.quantile(good, (LOW, 0.5, HIGH)))
    return low, middle, high


def _tested(ship: Ship, trials: Sequence[Trial], remarks: list[str]) -> dict[tuple[str, str], FormValue]:
    """Mean of each tested figure over the runs, by manoeuvre and figure."""
    try:
        found = imo_figures_of_trials(trials, ship) if trials else None
    except UserError:
        found = None
    if found is None:
        remarks.append("tested: none of the trials at hand is a standard manoeuvre")
        return {}
    values: dict[tuple[str, str], list[float]] = {}
    for (name, figure), value in _measured(found).items():
        values.setdefault((name.partition("|")[0], figure), []).append(value)
    if not values:
        remarks.append("tested: no trial is a standard manoeuvre (35° turn, 10/10 or 20/20 zig-zag, crash stop)")
    else:
        remarks.append("tested: means over the trials, in the air and water of the trials; no uncertainty is known")
    return {key: FormValue(float(np.mean(some)), None, len(some)) for key, some in values.items()}


def _measured(found: Assessment) -> dict[tuple[str, str], float]:
    """Value of each figure of measured runs, by "manoeuvre|run" and figure."""
    kinds = {}
    for run in found.runs:
        rudder, heading = math.degrees(run.rudder), math.degrees(run.heading)
        side = "-" if rudder < 0 else ""
        if run.kind == "turning" and abs(rudder) >= 33:
            kinds[run.name] = f"turning:{side}35"
        for angle in (10, 20):
            if run.kind == "zigzag" and abs(abs(rudder) - angle) <= 2 and abs(heading - angle) <= 2:
                kinds[run.name] = f"zigzag:{side}{angle}/{angle}"
        if run.kind == "crash-stop":
            kinds[run.name] = "crash-stop"
    return {
        (f"{kinds[row.run]}|{row.run}", row.figure): row.value
        for row in found.rows
        if row.run in kinds and row.value is not None
    }


def _loaded(ship: Ship, full_load: float) -> Ship:
    """The ``ship`` at another draught [m]: draught and mass by their ratio, primed coefficients as they are."""
    own = ship.particulars["d"]
    share = full_load / own - 1
    if not (math.isfinite(share) and -0.6 <= share <= 1.5):
        raise OutOfRange(f"--full-load-draught {full_load:g}: must be 0.4 to 2.5 times the draught of {own:g} m")
    if "draft" in ship.effects:
        raise Conflict("--full-load-draught: the ship has the effect draft already; leave it out of the ship first")
    return ship.with_effect("draft", {"share": share}).fixing(["draft.share"])


def _factors(
    loaded: Ship, model: JudgedFigures, result: Mapping[str, Any], remarks: list[str]
) -> dict[tuple[str, str], np.ndarray]:
    """F / B of each figure of the ships as they are, then over the draws, the same ones for both.

    loaded: at full load; model: figures B of the ship as tested; result: content of result.json; remarks: to add to.
    """
    full = JudgedFigures(imo_figures(loaded), {})
    if model.scatter:
        try:
            full = with_intervals(full.assessment, loaded, result, DRAWS)
        except UserError as error:
            remarks.append(f"no intervals of what is corrected to full load: {error}")
    own = {(row.run, row.figure): row.value for row in model.assessment.rows}
    found: dict[tuple[str, str], np.ndarray] = {}
    for row in full.assessment.rows:
        B = own.get((row.run, row.figure))
        if B and row.value is not None:
            before, after = (_drawn(some.scatter.get(row.run), row.figure) for some in (model, full))
            draws = after / before if before is not None and after is not None else np.empty(0)
            found[row.run, row.figure] = np.concatenate([[row.value / B], draws])
    return found


def _drawn(scatter: FigureScatter | None, figure: str) -> np.ndarray | None:
    """A figure over the draws (count,), None where there are none."""
    return scatter.ship.get(figure) if scatter is not None else None
