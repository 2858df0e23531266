"""The manoeuvring data of a calibrated ship in the form that IMO asks for.

The form is that of MSC/Circ.1053, appendix 6, with 90 % intervals. Tested: the standard manoeuvres among the trials.
Model: the calibrated ship in calm air and deep water. Corrected to full load: R = T F / B (3.4.1, option 1), with T
tested, and F and B the model at full load and as tested. The intervals are those of
``fitting.prediction.figure_intervals``, as ``mmg imo`` gives them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import bdtrc

from cases.criteria import imo
from cases.criteria.own_rates import LOWER_BOUND
from cases.criteria.standard_runs import Run
from cases.inputs import is_sampled
from cases.maneuvers.definitions import Limits
from cases.trial import Trial
from cases.trial_set import in_own_water
from fitting.prediction.bands import correlation_in
from fitting.prediction.figure_intervals import DRAWS, JudgedFigures, with_intervals
from fitting.report.plot_maneuvers import maneuver_figure
from fitting.report.plot_style import figure_entry, png_of
from mmg.errors import Conflict, OutOfRange, UserError
from mmg.messages import Message, has_code
from mmg.ship import Ship


def standard_figures(result: Mapping[str, Any], ship: Ship) -> JudgedFigures:
    """The standard manoeuvres of a ship with the draws of which a page shows intervals, the same as ``mmg imo``.

    result: content of result.json; ship: the calibrated or hybrid ship of which it speaks. Where no covariance is known
    or none can be drawn there are no draws, and a notice says why. Raises UserError when no manoeuvre reaches its
    event.
    """
    assessment = imo.imo_figures(ship)
    why = "no covariance of the coefficients is known"
    if correlation_in(result) is not None:
        try:
            return with_intervals(assessment, ship, result, DRAWS)
        except UserError as error:
            why = str(error)
    notices = (*assessment.notices, Message(f"no intervals: {why}", "no_covariance"))
    return JudgedFigures.of(replace(assessment, notices=notices))


def drawn_maneuvers(judged: JudgedFigures) -> dict[str, Any] | None:
    """The figure of the standard manoeuvres with single trials drawn behind them, as the macro ``figure`` takes it;
    None where ``judged``, as of ``standard_figures``, has no draws."""
    if not judged.scatter:
        return None
    return figure_entry(
        png_of(partial(maneuver_figure, judged.runs, judged.heading, judged.clouds)), "maneuvers",
        "Standard manoeuvres with drawn trials",
        "Lines: the ship as calibrated. Thin and grey: single trials of ships that the trials allow.",
    )  # fmt: skip


# Probability by chance up to which figures outside of their intervals contradict the model. Set by hand.
CHANCE = 0.05
# Groups of the form: title, manoeuvre to starboard, figures with their words.
FORM = (
    ("Turning circle, 35° rudder", "turning:35", (("advance", "Advance"), ("tactical_diameter", "Tactical diameter"))),
    ("Zig-zag 10°/10°", "zigzag:10/10",
     (("overshoot_1", "1st overshoot angle"), ("overshoot_2", "2nd overshoot angle"))),
    ("Zig-zag 20°/20°", "zigzag:20/20", (("overshoot_1", "1st overshoot angle"),)),
    ("Initial turning, 10° rudder", "zigzag:10/10", (("initial_turning_track", "Track to turn 10°"),)),
    ("Stopping", "crash-stop", (("track_reach", "Track reach"),)),
)  # fmt: skip


# Share by which speeds, or revolutions astern, of trials and model differ, and movement of the rudder between two
# samples [rad], that may make their figures differ. Set by hand.
OTHER_SPEED, COARSE = 0.1, math.radians(1.0)


@dataclass(frozen=True)
class FormValue:
    """A figure in the unit of the form, the median of its draws where there are any. interval: 90 %, its upper end
    infinite where more than 5 % of the draws never reach the figure, None where no covariance is known; count: of runs
    behind it; of_trial: 90 % interval of a single trial, as interval; reading: by what the figure of a test changes
    within a sampling interval, in which its rudder may have begun to move at any time."""

    value: float
    interval: tuple[float, float] | None = None
    count: int = 1
    of_trial: tuple[float, ...] | None = None
    reading: float = 0.0

    def words(self, unit: str, of_trial: bool = False) -> str:
        """The value in ``unit`` with its interval, that of a single trial where wanted and known, to the figures that
        the form asks for."""
        digits = 1 if unit == "deg" else 2  # ship lengths
        words, ends = f"{self.value:.{digits}f}", (of_trial and self.of_trial) or self.interval
        if round(self.reading, digits):
            words += f" ±{self.reading:.{digits}f}"
        if ends:
            high = f"{ends[1]:.{digits}f}" if math.isfinite(ends[1]) else "never"
            words += f" [{ends[0]:.{digits}f}, {high}]"
        return words + (f" ({self.count} runs)" if self.count > 1 else "")


@dataclass(frozen=True)
class FormSide:
    """A figure on one side: tested, of the model, corrected to full load; each None where it is not known. verdict: of
    the corrected value, else the tested, else the model's; is_other: the model stops by other revolutions astern than
    the trials hold, so that test and model are two manoeuvres."""

    tested: FormValue | None
    model: FormValue | None
    corrected: FormValue | None
    verdict: str
    is_other: bool = False

    @property
    def _ends(self) -> tuple[float, ...] | None:
        """The interval of a single trial of the model, else of the ship."""
        return (self.model.of_trial or self.model.interval) if self.model else None

    @property
    def is_vague(self) -> bool:
        """Whether that interval is wider than the tested figure is large, so that it tells nothing of it."""
        ends = self._ends
        return bool(self.tested and ends and ends[1] - ends[0] > abs(self.tested.value))

    @property
    def contradicts(self) -> bool | None:
        """Whether the interval of a single trial excludes the tested figure by more than it can be read to; None where
        either is not known, or they are two manoeuvres."""
        ends = self._ends
        if not self.tested or not ends or self.is_other:
            return None
        return not ends[0] - self.tested.reading <= self.tested.value <= ends[1] + self.tested.reading


@dataclass(frozen=True)
class FormRow:
    """One line of the form, in ship lengths ("L") or "deg"; sides: port and starboard, or one for a stop."""

    group: str
    name: str
    unit: str
    limit: float | None
    sides: tuple[FormSide, ...]


@dataclass(frozen=True)
class ImoForm:
    """The form. heading: of the model's runs; rows; remarks: what is to be known of it; intervals: whether the model's
    figures have any; causes: likely ones of tested figures that the model's intervals exclude; rules: rules of thumb,
    and the figures of the model that hang on each."""

    heading: str
    rows: tuple[FormRow, ...]
    remarks: tuple[str, ...]
    intervals: bool = False
    causes: tuple[str, ...] = ()
    rules: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def contradiction(self) -> str:
        """Sentence on tested figures outside of the model's intervals; "" where none is."""
        judged = [(row, side.contradicts) for row in self.rows for side in row.sides if side.contradicts is not None]
        outside = [row.name for row, excluded in judged if excluded]
        if not outside:
            return ""
        by_chance = bdtrc(len(outside) - 1, len(judged), 0.1) > CHANCE
        words = "No more than chance against the model" if by_chance else "The model contradicts its trials"
        words += (
            f": {len(outside)} of {len(judged)} tested figures lie outside of the 90 % intervals of a single trial, "
        )
        words += f"where {0.1 * len(judged):.1f} are expected by chance "
        return words + f"({', '.join(dict.fromkeys(outside))})."

    @property
    def tested(self) -> int:
        """How many figures were tested."""
        return sum(side.tested is not None for row in self.rows for side in row.sides)

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
    loaded = None
    if full_load is not None:  # draught and mass by the ratio of the draughts, primed coefficients as they are
        share = full_load / ship.particulars["d"] - 1
        if not (math.isfinite(share) and -0.6 <= share <= 1.5):  # set by hand, far beyond ballast and full load
            words = f"must be 0.4 to 2.5 times the draught of {ship.particulars['d']:g} m"
            raise OutOfRange(f"--full-load-draught {full_load:g}: {words}")
        if "draft" in ship.effects:
            raise Conflict("--full-load-draught: the ship has the effect draft already; leave it out of the ship first")
        loaded = ship.with_effect("draft", {"share": share}).fixing(["draft.share"])
    trials = in_own_water(trials, (result or {}).get("per_run"))
    tested = tested_figures(ship, trials, remarks)
    factors = _factors(loaded, model, result or {}, remarks) if loaded is not None and tested else {}
    if model.scatter:
        words = f"intervals: 90 % of {DRAWS} ships that the trials allow"
        remarks.append(f"{words}, as mmg imo draws them; a test's own scatter comes on top")
    if full_load is None:
        remarks.append("no correction to full load: that draught is not known; give it with --full-load-draught")
    elif not tested:
        remarks.append(
            "no correction to full load: R = T F / B needs tested figures T, and no trial is a standard test"
        )
    else:
        remarks.append(
            "corrected: R = T F / B (MSC/Circ.1053, 3.4.1), F and B by the model at full load and as tested; draught "
            "and mass grow, the primed coefficients stay: how they change with draught is not known and not in the "
            "interval"
        )
    by_name = {(row.run, row.figure): row for row in model.rows}
    # most revolutions astern of the model's stop, and of the trials: by others they are two manoeuvres
    ours, theirs = (
        min((float(np.nanmin(t[name])) for t in some for name in ("n", "n_azimuth") if name in t), default=math.nan)
        for some in ([run.trial for run in model.runs if run.kind == "crash-stop"], trials)
    )
    is_other_stop = theirs < 0 and abs(ours / theirs - 1) > OTHER_SPEED  # nan: one of them is not there
    rows = []
    for group, text, figures in FORM:
        sides = (text,) if text == "crash-stop" else (text.replace(":", ":-"), text)
        for figure, words in figures:
            judged = [by_name.get((side, figure)) for side in sides]
            first = next((row for row in judged if row is not None), None)
            cells = tuple(
                _side(row, tested.get((side, figure)), factors.get((side, figure)))
                for side, row in zip(sides, judged, strict=True)
            )
            if text == "crash-stop" and is_other_stop:
                cells = tuple(replace(cell, is_other=True) for cell in cells)
            unit, limit = (first.unit, first.limit) if first else ("deg" if "overshoot" in figure else "L", None)
            rows.append(FormRow(group, words, unit, limit, cells))
    remarks += [f"the model's figures alone: {model.verdict} ({model.basis})"] if model.basis else []
    remarks += [str(note) for note in model.notices if not has_code([note], "not_checked")]
    causes = likely_causes(ship, trials, model, result or {}) if tested else ()
    caveats = {run.name: [words for words in run.caveats if imo.follows_rule(words)] for run in model.runs}
    rules: dict[str, tuple[str, ...]] = {}
    for group, text, _ in FORM:
        for rule in caveats.get(text, ()):
            rules[rule] = (*rules.get(rule, ()), group)
    return ImoForm(model.heading, tuple(rows), tuple(dict.fromkeys(remarks)), bool(model.scatter), causes, rules)


def likely_causes(
    ship: Ship, trials: Sequence[Trial], model: JudgedFigures, result: Mapping[str, Any]
) -> tuple[str, ...]:
    """What may make figures of a calibrated ``ship`` differ from those of her ``trials``, of what nobody stated. model,
    result: as of ``imo_form``."""
    causes, rate = [], Limits.for_ship(ship).rudder_rate
    known = "rudder_rate" in ship.particulars and not ship.sources.get("rudder_rate", "").endswith(LOWER_BOUND)
    if math.isfinite(rate) and not known:
        causes.append(
            f"the {imo.helm_words(ship)}: overshoots and advance grow as it falls (rudder_rate in the ship file)"
        )
    speeds = {run.speed for run in model.runs}
    tested = ship.particulars.get("approach_speed")  # that of the trials [m/s]
    if tested and any(abs(speed / tested - 1) > OTHER_SPEED for speed in speeds):
        causes.append(f"the speed: the trials approach at {tested:.3g} m/s, the model at {max(speeds):.3g} m/s")
    if "antenna_offset" not in ship.effects and any(
        t.has_position and not has_code(t.notices, "reference_point") for t in trials
    ):
        causes.append("the antenna: positions are taken as midship's (reference_point in trials.toml)")
    freed = {symbol.partition(".")[0] for rows in (result.get("per_run") or {}).values() for symbol in rows}
    if "current" not in {*ship.effects, *freed}:
        causes.append("a current, which is not freed (--with current, --per-run current)")
    # 90 deg/s: of a ship without a limit of her rudder's rate
    if any(is_sampled(t) is None and t.dt * min(rate, math.radians(90.0)) > COARSE for t in trials):
        causes.append('inputs that are read as held from sample to sample (inputs = "sampled" in trials.toml)')
    return tuple(causes)


def _side(row: imo.Row | None, tested: FormValue | None, factor: np.ndarray | None) -> FormSide:
    """One side from the model's ``row``, the tested value, and F / B of the ship and of the draws."""
    model = corrected = None
    if row is not None and row.value is not None:
        model = FormValue(row.value, row.interval_90, of_trial=row.interval_90_trial)
    if tested is not None and factor is not None:
        draws = tested.value * factor[1:][np.isfinite(factor[1:])]
        corrected = FormValue(tested.value * float(factor[0]), None, tested.count)
        if len(draws) >= max(20, (len(factor) - 1) // 2):  # an interval needs half of the draws. Set by hand.
            low, middle, high = map(float, np.quantile(draws, (0.05, 0.5, 0.95)))
            corrected = FormValue(middle, (low, high), tested.count)
    if row is None:
        return FormSide(tested, model, corrected, imo.OPEN)
    judged, verdict, limit = corrected or tested or model, row.verdict, row.limit
    # a figure of the model that no trial supports is not judged, but a tested one is
    if judged is not None and limit is not None and (verdict in (imo.PASS, imo.FAIL) or row.probability is not None):
        if judged is not model:
            verdict = imo.PASS if judged.value <= limit else imo.FAIL
        if verdict in (imo.PASS, imo.FAIL) and judged.interval and judged.interval[0] <= limit < judged.interval[1]:
            verdict += ", within the interval"
    return FormSide(tested, model, corrected, verdict)


def tested_figures(ship: Ship, trials: Sequence[Trial], remarks: list[str]) -> dict[tuple[str, str], FormValue]:
    """Mean of each tested figure over the runs among ``trials``, by manoeuvre and figure, of midship and through the
    water where the ``ship`` has an antenna or a current of her own. remarks: to add to."""
    try:
        measured = imo.imo_figures_of_trials(trials, ship) if trials else None
    except UserError:
        measured = None
    if measured is None:
        remarks.append("tested: none of the trials at hand is a standard manoeuvre")
        return {}
    east, north = (ship.coefficients.get(f"current.{axis}") for axis in ("y", "x"))
    values: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for run in measured.runs:
        if (kind := _standard_run(run)) is None:
            continue
        if east and north:
            run = imo.in_still_water(run, imo.WaterVelocity(north.value, east.value, "of the ship"))
        # by what a figure changes within a sampling interval of the run, in degrees or ship lengths
        turned = run.trial.dt * math.degrees(float(np.nanmax(np.abs(run.trial["r"]))))
        gone = run.trial.dt * run.speed / run.length if math.isfinite(run.speed) else 0.0
        for row in imo.assess(run):
            if row.value is not None:
                read = row.value, turned if row.unit == "deg" else gone
                values.setdefault((kind, row.figure), []).append(read)
    if not values:
        remarks.append("tested: no trial is a standard manoeuvre (35° turn, 10/10 or 20/20 zig-zag, crash stop)")
    else:
        taken = [words for name, words in TAKEN_OFF.items() if name in ship.effects]
        of = f"without the {' and the '.join(taken)} that were fitted" if taken else "in the water of the trials"
        remarks.append(
            f"tested: means over the trials, {of} and in their air; ±: what a figure changes by between two samples"
        )
    means = {key: (*np.mean(some, axis=0).tolist(), len(some)) for key, some in values.items()}
    return {key: FormValue(value, None, count, reading=reading) for key, (value, reading, count) in means.items()}


# Effects that a tested figure has and one in still water of midship has not.
TAKEN_OFF = {"current": "current", "antenna_offset": "lever arm of the antenna"}


def _standard_run(run: Run) -> str | None:
    """The manoeuvre of the form that a measured ``run`` is, None for none."""
    rudder, heading, side = math.degrees(run.rudder), math.degrees(run.heading), "-" if run.rudder < 0 else ""
    if run.kind == "turning" and abs(rudder) >= 33:  # 35 deg or hard over, to 2 deg as below. Set by hand.
        return f"turning:{side}35"
    for angle in (10, 20):
        if run.kind == "zigzag" and abs(abs(rudder) - angle) <= 2 and abs(heading - angle) <= 2:
            return f"zigzag:{side}{angle}/{angle}"
    return "crash-stop" if run.kind == "crash-stop" else None


def _factors(
    loaded: Ship, model: JudgedFigures, result: Mapping[str, Any], remarks: list[str]
) -> dict[tuple[str, str], np.ndarray]:
    """F / B of each figure of the ships as they are, then over the draws, the same ones for both. loaded: at full load;
    model: figures B of the ship as tested; result: content of result.json; remarks: to add to."""
    # the same draws for both ships: what is uncertain of both cancels in the ratio
    full = JudgedFigures.of(imo.imo_figures(loaded))
    if model.scatter:
        try:
            full = with_intervals(full, loaded, result, DRAWS)
        except UserError as error:
            remarks.append(f"no intervals of what is corrected to full load: {error}")
    as_tested = {(row.run, row.figure): row.value for row in model.rows}
    factors: dict[tuple[str, str], np.ndarray] = {}
    for row in full.rows:
        B, draws = as_tested.get((row.run, row.figure)), np.empty(0)
        if not B or row.value is None:
            continue
        if row.run in full.scatter and row.run in model.scatter:
            ships = [some.scatter[row.run].ship for some in (full, model)]
            if all(row.figure in ship for ship in ships):
                draws = ships[0][row.figure] / ships[1][row.figure]
        factors[row.run, row.figure] = np.concatenate([[row.value / B], draws])
    return factors
