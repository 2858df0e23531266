"""Manoeuvring data of a ship in the form that IMO asks for (MSC/Circ.1053, appendix 6), with 95 % intervals.

Tested: the standard manoeuvres among the trials. Model: the calibrated ship in calm air and deep water. Corrected to
full load: R = T F / B (3.4.1, option 1), with T tested, and F and B the model at full load and as tested.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cases.criteria.assessment import Assessment, imo_figures, imo_figures_of_trials
from cases.criteria.scatter import scatter
from cases.criteria.standard_runs import STANDARD, approach_speed
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import calm_and_deep
from cases.trial import Trial
from mmg.errors import UserError
from mmg.ship import Ship

DRAWS, SEED = 200, 0
LOW, HIGH = 0.025, 0.975
FORM = (
    ("Turning circle, 35° rudder", "turning:35", (("advance", "Advance"), ("tactical_diameter", "Tactical diameter"))),
    ("Zig-zag 10°/10°", "zigzag:10/10",
     (("overshoot_1", "1st overshoot angle"), ("overshoot_2", "2nd overshoot angle"))),
    ("Zig-zag 20°/20°", "zigzag:20/20", (("overshoot_1", "1st overshoot angle"),)),
    ("Initial turning", "zigzag:10/10", (("initial_turning_track", "Distance to turn 10° with 10° rudder"),)),
    ("Stopping", "crash-stop", (("track_reach", "Track reach"),)),
)  # fmt: skip
"""Groups of the form: title, manoeuvre to starboard, figures with their words."""
UNITS = {"L": "L", "deg": "deg"}
"""Units of the form; L: ship lengths."""


@dataclass(frozen=True)
class FormValue:
    """A figure in the unit of the form. interval: 95 %, None where no covariance is known; count: of runs behind it."""

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
    """The form. heading: of the model's runs; rows; remarks: what is to be known of it."""

    heading: str
    rows: tuple[FormRow, ...]
    remarks: tuple[str, ...]
    full_load: float | None = None
    intervals: bool = field(default=False)

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
    correlation: tuple[Sequence[str], np.ndarray] | None = None,
    full_load: float | None = None,
) -> ImoForm:
    """The form of a calibrated ``ship``.

    trials: measured, of which the standard manoeuvres are the tested figures; correlation: symbols (Q,) and matrix
    (Q, Q) of the estimates, None: no intervals; full_load: draught of the fully loaded ship [m]. Raises UserError for a
    draught that the model cannot be carried to, and when no manoeuvre of the model reaches its event.
    """
    remarks: list[str] = []
    model = imo_figures(ship)
    loaded = _loaded(ship, full_load) if full_load is not None else None
    tested = _tested(ship, trials, remarks)
    draws = _draws(ship, correlation, remarks) if correlation is not None else {}
    factors: dict[tuple[str, str], np.ndarray] = {}
    if loaded is not None and tested:
        later = _draws(loaded, correlation, remarks) if correlation is not None and draws else {}
        factors = _factors(loaded, model, draws, later)
    remarks += _of_intervals(bool(draws), correlation is not None) + _of_correction(full_load, bool(tested))
    by_name = {(row.run, row.figure): row for row in model.rows}
    rows = []
    for group, text, figures in FORM:
        sides = (text,) if text == "crash-stop" else (text.replace(":", ":-"), text)
        for figure, words in figures:
            known = [by_name.get((side, figure)) for side in sides]
            first = next((row for row in known if row is not None), None)
            cells = tuple(
                _side(row, tested.get((side, figure)), draws.get((side, figure)), factors.get((side, figure)))
                for side, row in zip(sides, known, strict=True)
            )
            unit = first.unit if first else "L"
            rows.append(FormRow(group, words, UNITS.get(unit, unit), first.limit if first else None, cells))
    remarks += [str(notice) for notice in model.notices if getattr(notice, "code", "") != "not_checked"]
    return ImoForm(model.heading, tuple(rows), tuple(dict.fromkeys(remarks)), full_load, bool(draws))


def _of_intervals(known: bool, covariance: bool) -> list[str]:
    if not known:
        return [] if covariance else ["no intervals: no covariance of the coefficients is known"]
    return [
        f"intervals: 95 % of {DRAWS} draws from the covariance of the coefficients; what the model lacks, and a test's "
        "own scatter, come on top"
    ]


def _of_correction(full_load: float | None, tested: bool) -> list[str]:
    if full_load is None:
        return ["no correction to full load: that draught is not known; give it with --full-load-draught"]
    if not tested:
        return ["no correction to full load: R = T F / B needs tested figures T, and no trial is a standard test"]
    return [
        "corrected: R = T F / B (MSC/Circ.1053, 3.4.1), F and B by the model at full load and as tested; draught and "
        "mass grow, the primed coefficients stay: how they change with draught is not known and not in the interval"
    ]


def _side(row: Any, tested: FormValue | None, ratios: np.ndarray | None, factor: np.ndarray | None) -> FormSide:
    """One side from the model's ``row``, the tested value, draws over the model's value, and F / B over the draws."""
    model = corrected = None
    if row is not None and row.value is not None:
        model = FormValue(row.value, _interval(row.value * ratios) if ratios is not None else None)
    if tested is not None and factor is not None:
        interval = _interval(tested.value * factor[1:]) if len(factor) > 1 else None
        corrected = FormValue(tested.value * float(factor[0]), interval, tested.count)
    limit, why = (row.limit, row.why) if row is not None else (None, "")
    judged = corrected or tested or model
    verdict = row.verdict if row is not None else "not judged"
    if verdict in ("pass", "fail") and judged is not None and limit is not None:
        verdict = "pass" if judged.value <= limit else "fail"
    if verdict in ("pass", "fail") and judged is not None and judged.interval and limit is not None:
        low, high = judged.interval
        verdict += ", within the interval" if low <= limit < high else ""
    return FormSide(tested, model, corrected, verdict, why)


def _interval(values: np.ndarray) -> tuple[float, float] | None:
    """The 95 % interval of the finite ``values`` (M,), None for fewer than half of them."""
    good = values[np.isfinite(values)]
    if len(good) < max(20, len(values) // 2):
        return None
    low, high = np.quantile(good, (LOW, HIGH))
    return float(low), float(high)


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


Draws = Mapping[tuple[str, str], np.ndarray]
"""Figures over draws of the coefficients, by manoeuvre and name, each by that of the ship as it is, (DRAWS,)."""


def _draws(ship: Ship, correlation: tuple[Sequence[str], np.ndarray], remarks: list[str]) -> Draws:
    """The figures of the model over draws."""
    calm, _ = calm_and_deep(ship)
    speed, _ = approach_speed(calm)
    found: dict[tuple[str, str], np.ndarray] = {}
    try:
        for text in STANDARD:
            many = scatter(calm, parse_maneuver(text, calm, speed=speed), DRAWS, SEED, correlation)
            own = {row.figure: row.value for row in many.rows}
            found |= {(text, name): values / own[name] for name, values in many.values.items() if own.get(name)}
    except UserError as error:
        remarks.append(f"no intervals: {error}")
        return {}
    return found


def _loaded(ship: Ship, full_load: float) -> Ship:
    """The ``ship`` at another draught [m]: draught and mass by their ratio, primed coefficients as they are."""
    own = ship.particulars["d"]
    share = full_load / own - 1
    if not (math.isfinite(share) and -0.6 <= share <= 1.5):
        raise UserError(f"--full-load-draught {full_load:g}: must be 0.4 to 2.5 times the draught of {own:g} m")
    if "draft" in ship.effects:
        raise UserError("--full-load-draught: the ship has the effect draft already; leave it out of the ship first")
    return ship.with_effect("draft", {"share": share}).fixing(["draft.share"])


def _factors(loaded: Ship, model: Assessment, before: Draws, after: Draws) -> dict[tuple[str, str], np.ndarray]:
    """F / B of each figure of the ships as they are, then over the draws, the same ones for both.

    loaded: at full load; model: figures B of the ship as tested; before, after: draws of B and of F, or none.
    """
    own = {(row.run, row.figure): row.value for row in model.rows}
    found: dict[tuple[str, str], np.ndarray] = {}
    for row in imo_figures(loaded).rows:
        key, B = (row.run, row.figure), own.get((row.run, row.figure))
        if B and row.value is not None:
            ratio = row.value / B
            draws = ratio * after[key] / before[key] if key in before and key in after else np.empty(0)
            found[key] = np.concatenate([[ratio], draws])
    return found
