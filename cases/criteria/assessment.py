"""A ship judged by IMO MSC.137(76): from her model, or from measured runs, to a row per figure with its verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from cases.checks.trusted import remarks
from cases.criteria.imo import ASSUMED, OPEN, SOURCE, Row, assess, worst
from cases.criteria.standard_runs import STANDARD, Run, approach_speed, measured_runs, simulated_run
from cases.criteria.trial_correction import WaterVelocity, corrected_runs
from cases.inputs import assumed
from cases.io.leave_out import CODE
from cases.maneuvers.controller import Limits
from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.stopping import CODES
from cases.shipfiles.effects import calm_and_deep
from cases.trial import Trial
from mmg.errors import Missing, NoSolution, UnknownName, UserError
from mmg.messages import Message, has_code
from mmg.notebook import html_table
from mmg.ship import CalibrationMark, Ship


@dataclass(frozen=True)
class Assessment:
    """Figures of standard manoeuvres with limits and verdicts.

    ship: its name, "" where it is not known; heading: what was judged, in a line; rows: a row per figure; runs: the
    manoeuvres; notices: what to know of them; mark: which calibration the ship is of, None: of none; basis: what the
    verdict of a ship with draws rests on, "" of any other.
    """

    ship: str
    heading: str
    rows: tuple[Row, ...]
    runs: tuple[Run, ...]
    notices: tuple[Message, ...]
    mark: CalibrationMark | None = None
    basis: str = ""

    @property
    def verdict(self) -> str:
        """ "fail" if any figure fails, "pass" if all that have a limit pass, else "not judged"."""
        return worst(self.rows)

    @property
    def conclusion(self) -> str:
        """The verdict in a line, with what it rests on."""
        return f"IMO MSC.137(76): {self.verdict}" + (f" ({self.basis})" if self.basis else "")

    def to_dict(self) -> dict[str, Any]:
        """What ``mmg imo --json`` prints: SI and rad in the figures of the runs, L and deg in the rows."""
        runs = [
            {
                "name": run.name,
                "kind": run.kind,
                "measured": run.measured,
                "order_time_s": run.order_time,
                "rudder_rad": run.rudder,
                "switch_heading_rad": run.heading,
                "speed_m_s": run.speed,
                "length_m": run.length,
                "figures": dict(run.figures),
                "notes": list(run.notes),
                "caveats": list(run.caveats),
                "title": run.title,
                "end_s": run.end,
            }
            for run in self.runs
        ]
        head = {"ship": self.ship, "heading": self.heading, "standard": "IMO MSC.137(76)", "verdict": self.verdict}
        head |= {"verdict_basis": self.basis}
        mark = asdict(self.mark) if self.mark else None
        rows = [asdict(row) | {"criterion": row.limit} for row in self.rows]
        return {**head, "calibration": mark, "rows": rows, "runs": runs, "notices": list(self.notices)}

    def to_pandas(self) -> Any:
        """A DataFrame with a row per figure: ability, run, figure, value, limit, unit, verdict, why, reference."""
        import pandas as pd

        return pd.DataFrame([asdict(row) for row in self.rows])

    def _repr_html_(self) -> str:
        rows = [(r.run, r.figure.replace("_", " "), r.value, r.limit, r.unit, r.verdict, r.why) for r in self.rows]
        header = ("run", "figure", "value", "limit", "unit", "verdict", "remark")
        return html_table(f"{self.heading}. {self.conclusion}", header, rows)


def imo_figures(
    ship: Ship,
    speed: float | None = None,
    rudder_rate: float | None = None,
    maneuvers: Sequence[str] = (),
    scale: float | None = None,
) -> Assessment:
    """The standard manoeuvres of IMO MSC.137(76), simulated in calm and deep water and judged.

    ship: effects of its surroundings and instruments are left out; speed: test speed [m/s], default as for
    ``approach_speed``; rudder_rate [rad/s], default the ship's own; maneuvers: further ones, such as "spiral:15/5";
    scale: ship length over model length, default the ship's own: a model is judged at the scale of the ship. Raises
    UserError for a text that names no manoeuvre, and when no manoeuvre reaches its event.
    """
    calm, left_out = calm_and_deep(ship)
    V, origin = approach_speed(calm, speed)
    for text in maneuvers:
        if "order_time" not in parse_maneuver(text, calm, speed=V, rudder_rate=rudder_rate).parameters:
            kinds = "turning, zigzag, spiral, pull-out, crash-stop, coasting"
            raise UnknownName(f"manoeuvre '{text}' has no order to judge; use {kinds}")
    runs, missed = [], {}
    for text in dict.fromkeys((*STANDARD, *maneuvers)):
        try:
            runs.append(simulated_run(calm, text, V, rudder_rate=rudder_rate))
        except UserError as error:
            missed[text] = str(error)
    if not runs:
        raise NoSolution(next(iter(missed.values())))
    L = calm.particulars["L"]
    heading = f"{calm.title}, simulated: L {L:g} m, V {V:.4g} m/s, L/V {L / V:.3g} s"
    if "n" in calm.actuators:
        heading += f", n {runs[0].trial['n'][0]:.4g} rps"
    degrees = math.degrees(rudder_rate if rudder_rate is not None else Limits.for_ship(calm).rudder_rate)
    finite = math.isfinite(degrees)
    helm = f"rudder rate {degrees:.3g} deg/s" if finite else "the rudder moves as the ship's actuators do"
    notices = [Message(f"test speed V: {origin}; {helm}", "test_conditions")]
    said = (m for run in runs for m in run.trial.notices if isinstance(m, Message) and m.code in CODES)
    notices += dict.fromkeys(said)
    if left_out:
        words = "left out, as the tests are in calm, deep water and free of sensor errors: "
        notices.append(Message(words + ", ".join(left_out), "effects_left_out"))
    more = [Row("", text, "no figure", None, None, "", OPEN, why) for text, why in missed.items()]
    return _assessed(calm, heading, runs, scale or calm.particulars.get("scale"), notices, more)


def imo_figures_of_trials(
    trials: Sequence[Trial],
    ship: Ship | None = None,
    length: float | None = None,
    kind: str = "",
    scale: float | None = None,
    correct: bool | WaterVelocity = False,
) -> Assessment:
    """Measured runs judged by IMO MSC.137(76).

    trials: with one manoeuvre or several each, the approach is cut off; ship: gives its name, length and scale;
    length: of the ship [m], where there is no ship; kind: "turning", "zigzag" or "crash-stop", default from the data;
    scale: ship length over model length; correct: to still water and calm air, with the current of the circles among
    the trials or a given one (cases/criteria/trial_correction.py). Of several runs, one without a manoeuvre becomes a
    notice. Raises UserError when no length is
    given, when the trials are not of the ship, and when there is no manoeuvre in any of them.
    """
    if ship is None and length is None:
        raise Missing("trials need the length of their ship; give ship or length")
    L = length if length is not None else ship.particulars["L"] if ship else 0.0
    runs, notices = [], [*remarks(trials), *(assumed(trials, ship.inputs) if ship else ())]
    if has_code(notices, CODE):
        words = (
            "what is left out of a measured manoeuvre is bridged by straight lines, where she hardly turns meanwhile"
        )
        notices.append(Message(words, "bridged"))
    for trial in trials:
        try:
            runs += measured_runs(trial, L, kind)
        except UserError as error:
            if len(trials) == 1:
                raise
            notices.append(Message(f"left out: {error}", "no_maneuver_found"))
    refused = [note for note in notices if has_code([note], "no_maneuver_found")]
    if not runs:
        raise Missing(f"no standard manoeuvre in any of {len(trials)} trials; first: {refused[0]}")
    several = len(trials) - len(refused) < len(runs)
    held = f", {len(runs)} manoeuvres" if several else ""
    title, used = ship.title if ship else "ship", len(trials) - len(refused)
    heading = f"{title}, measured: L {L:g} m, {used} of {len(trials)} runs{held}"
    size = scale or (ship.particulars.get("scale") if ship else None)
    if not correct:
        return _assessed(ship, heading, runs, size, notices, [])
    better, done = corrected_runs(runs, ship, correct if isinstance(correct, WaterVelocity) else None)
    found = _assessed(ship, f"{heading}, corrected for wind and current", better, size, [*notices, *done], [])
    before = [row.value for run in runs for row in assess(run, size, _known_as(ship))]
    return replace(
        found, rows=tuple(replace(row, measured=value) for row, value in zip(found.rows, before, strict=True))
    )


def _assessed(
    ship: Ship | None, heading: str, runs: list[Run], scale: float | None, notices: list[Message], more: list[Row]
) -> Assessment:
    rows = [*(row for run in runs for row in assess(run, scale, _known_as(ship))), *more]
    if any(row.reference is not None for row in rows):
        notices = [*notices, Message(f"reference: {SOURCE}", "reference_values")]
    name, mark = (ship.name, ship.mark) if ship else ("", None)
    return Assessment(name, heading, tuple(rows), tuple(runs), (*notices, Message(ASSUMED, "not_checked")), mark)


def _known_as(ship: Ship | None) -> str:
    """The name under which figures of the ``ship`` are published: of a calibration that of the ship it began from."""
    if ship is None:
        return ""
    return ship.mark.start if ship.mark and ship.mark.start else ship.name
