"""A ship judged by the standards for ship manoeuvrability, IMO MSC.137(76): from her model, or from measured runs, to a
row per figure with its limit and verdict.

The standards hold for ships of 100 m and more (and all chemical and gas carriers), in deep water and calm weather, at
full load on even keel, at a test speed V of at least 90 % of the speed at 85 % MCR. A model is judged at the length and
the L/V of the ship it stands for: L scale and (L/V) sqrt(scale).

Measured manoeuvres are corrected to still water and calm air, as MSC/Circ.1053 (2002) 3.4.2 asks where the conditions
of the criteria were not met.

Current, 3.4.2.5: in a turning circle the positions a whole turn apart, from a change of heading of 180 deg on, drift
with the water. The mean of their velocities is the current; the track less its way is that in still water. ITTC
7.5-04-02-01 (2017) asks for the circle for the same purpose. Wind: the model of the ship runs the manoeuvre in the mean
wind and in calm air, and the difference of a figure is added to the measured one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from cases.criteria.measured_maneuvers import Execute
from cases.criteria.standard_runs import (
    STANDARD,
    STEP,
    Run,
    approach_speed,
    figures_of,
    measured_figures,
    measured_runs,
    simulated_run,
)
from cases.inputs import assumed
from cases.maneuvers.definitions import STOPPING_CODES, STOPS, Limits, parse_maneuver
from cases.shipfiles.effects import calm_and_deep
from cases.shipfiles.particulars import BY_RULE
from cases.simulation.simulate import Wind, simulate
from cases.trial import LEFT_OUT, Trial
from cases.trial_set import TrialSet
from mmg.errors import Missing, NoSolution, UnknownName, UserError
from mmg.messages import Message, as_messages, has_code, html_table
from mmg.motion.froude import time_scale
from mmg.ship import CalibrationMark, Ship

# Change of heading from which positions count, and that between two of a pair [rad] (MSC/Circ.1053, 3.4.2.5).
FIRST, WHOLE = math.pi, 2 * math.pi
PAIRS_EVERY = math.radians(10.0)  # Between the pairs of positions [rad]. Set by hand: pairs overlap in any case.
# Standard deviation of the velocities of a circle's pairs, as a share of their mean, above which they are no steady
# current; one that is less than LEAST_SCATTER of the ship's speed is never too much. Set by hand.
MOST_SCATTER = 0.5
LEAST_SCATTER = 0.03  # Share of the ship's speed [-]. Set by hand.


@dataclass(frozen=True)
class WaterVelocity:
    """Velocity of the water over ground. north, east [m/s]; origin: where it is from, in words."""

    north: float
    east: float
    origin: str

    @property
    def words(self) -> str:
        """Speed and the direction that it goes to, in words."""
        speed = math.hypot(self.north, self.east)
        towards = math.degrees(math.atan2(self.east, self.north)) % 360
        return f"current {speed:.3g} m/s towards {towards:.0f} deg ({self.origin})"


def current_of(run: Run) -> WaterVelocity | None:
    """The current in which a measured turning circle drifted; None for another run, one that turns less than 540 deg,
    one without positions, and one whose pairs disagree."""
    trial = run.trial
    if run.kind != "turning" or not trial.has_position:
        return None
    t = trial.t - trial.t[0]
    psi, x, y = trial.psi_unwrapped, trial["x"], trial["y"]
    rows = np.isfinite(psi) & np.isfinite(x) & np.isfinite(y) & (t >= run.order_time) & (t <= run.end + 1e-9)
    if rows.sum() < 10:
        return None
    t, x, y = t[rows], x[rows], y[rows]
    # towards the rudder; noise of a heading must not make it fall, as times are read at angles below
    change = np.maximum.accumulate(math.copysign(1.0, run.rudder) * (psi[rows] - psi[rows][0]))
    starts = np.arange(FIRST, float(change[-1]) - WHOLE, PAIRS_EVERY)
    if len(starts) == 0:
        return None
    rising = np.concatenate([[True], np.diff(change) > 0])
    t, x, y, change = t[rising], x[rising], y[rising], change[rising]

    def at(values: np.ndarray, angles: np.ndarray) -> np.ndarray:
        return np.interp(angles, change, values)

    seconds = at(t, starts + WHOLE) - at(t, starts)
    velocity = np.array([at(p, starts + WHOLE) - at(p, starts) for p in (x, y)]) / seconds
    mean, scatter = velocity.mean(axis=1), float(np.hypot(*velocity.std(axis=1)))
    if scatter > max(MOST_SCATTER * float(np.hypot(*mean)), LEAST_SCATTER * run.speed):
        return None
    return WaterVelocity(float(mean[0]), float(mean[1]), f"{len(starts)} pairs of positions of {run.name}")


def mean_current(currents: Sequence[WaterVelocity]) -> WaterVelocity | None:
    """The mean of ``currents`` of several circles, None of none."""
    if len(currents) < 2:
        return currents[0] if currents else None
    parts = np.array([(c.north, c.east) for c in currents])
    std = float(np.hypot(*parts.std(axis=0)))
    north, east = (float(x) for x in parts.mean(axis=0))
    return WaterVelocity(north, east, f"mean of {len(currents)} circles, which differ by {std:.2g} m/s")


def in_still_water(run: Run, current: WaterVelocity) -> Run:
    """Returns ``run`` as seen from water that moves with the ``current``: track, velocities, test speed, figures."""
    trial = run.trial
    psi, t = trial.psi_unwrapped, trial.t - trial.t[0] - run.order_time
    c, s = np.cos(psi), np.sin(psi)
    through_water = trial.through_water(current.north, current.east)
    before = (t <= 1e-9) & np.isfinite(psi)
    at = np.flatnonzero(before)[-1] if before.any() else np.flatnonzero(np.isfinite(psi))[0]
    ahead = float(c[at] * current.north + s[at] * current.east)  # of the current, on the heading of the approach
    corrected = replace(run, trial=through_water, speed=run.speed - ahead)
    return replace(corrected, figures=measured_figures(through_water, corrected))


def _without_wind(run: Run, ship: Ship) -> tuple[dict[str, float], np.ndarray]:
    """By the model of a ``ship``: what her figures in calm air are more than in the wind of a measured ``run``, and how
    that wind alone moves a circle over ground, north and east [m/s]. Raises UserError where the run has no wind, or the
    model does not reach what was measured."""
    trial = run.trial
    t = trial.t - trial.t[0]
    rows = (t >= run.order_time) & (t <= run.end + 1e-9) & np.isfinite(trial.wind_vector).all(axis=1)
    if not trial.has_wind or not rows.any():
        raise Missing("no wind is recorded")
    north, east = -trial.wind_vector[rows].mean(axis=0)
    good = np.isfinite(trial["psi"])
    heading = float(np.interp(run.order_time, t[good], trial.psi_unwrapped[good]))
    wind = Wind(math.hypot(north, east), math.atan2(east, north) - heading)  # a simulated run begins on heading north
    calm, _ = calm_and_deep(ship)
    degrees = math.degrees(run.rudder)
    order = {"turning": f":{degrees:g}", "zigzag": f":{degrees:g}/{math.degrees(run.heading):g}"}
    text, dt = run.kind + order.get(run.kind, ""), STEP * time_scale(ship.particulars["L"])
    plan = parse_maneuver(text, calm, speed=run.speed)
    # a wind may slow the turn: the circle in it is given half as much time again for its pairs of positions
    longer = replace(plan, duration=1.5 * plan.duration) if run.kind == "turning" else plan
    still, windy = simulate(calm, plan, dt), simulate(calm, longer, dt, wind)
    execute = Execute(plan.kind, plan.parameters["order_time"], run.rudder, (), windy.duration, 0.0, run.speed, ())
    leeway = current_of(Run(**vars(execute), name="model", trial=windy, length=run.length, figures={}))
    # from the axes of the model's run to north and east
    drift = (complex(leeway.north, leeway.east) if leeway else 0.0) * np.exp(1j * heading)
    calm_air, in_wind = figures_of(still, plan), figures_of(windy, plan)
    shift = {name: value - in_wind[name] for name, value in calm_air.items() if name in in_wind}
    return shift, np.array([drift.real, drift.imag])


def corrected_runs(
    runs: Sequence[Run], ship: Ship | None, current: WaterVelocity | None = None
) -> tuple[list[Run], list[Message]]:
    """Measured ``runs`` in still water and calm air, and what was done, as messages.

    current: as known; None takes for a circle its own, less what the model drifts in the wind alone, for the others the
    mean of all circles among the runs. ship: whose wind model corrects for the wind of the runs; None or without one:
    none is corrected for.
    """
    notices, winds = [], {}
    if ship is not None and ship.feels_wind:
        for run in runs:
            try:
                winds[run.name] = _without_wind(run, ship)
            except UserError as error:
                notices.append(Message(f"{run.name}: not corrected for wind: {error}", "not_corrected"))
    else:
        words = "wind is not corrected for: there is no ship with a wind model"
        notices.append(Message(words, "no_wind_model"))
    currents = {}
    for run in runs:
        found = None if current else current_of(run)
        if found is not None:  # what the wind alone makes of the circle's drift is no current
            north, east = winds[run.name][1] if run.name in winds else (0.0, 0.0)
            currents[run.name] = replace(found, north=found.north - north, east=found.east - east)
    shared, result = current or mean_current(list(currents.values())), []
    for run in runs:  # current first: the figures in still water are those to which the wind's part is added
        water = currents.get(run.name, shared)
        if water is not None:
            run = in_still_water(run, water)
            notices.append(Message(f"{run.name}: corrected for {water.words}", "current_corrected"))
        if run.name in winds:
            shift, _ = winds[run.name]
            run = replace(run, figures={k: v + shift.get(k, 0.0) for k, v in run.figures.items()})
            words = f"{run.name}: corrected for wind by what it changes of the figures of {ship.name if ship else ''}"
            notices.append(Message(words, "wind_corrected"))
        result.append(run)
    if shared is None:
        words = "no current is known: give one, or a turning circle of 540 deg and more among the trials"
        notices.append(Message(words, "no_current"))
    return result, notices


SMALLEST = 100.0  # Length from which the standard applies [m]. (IMO MSC.137(76), 2.2.)
ASSUMED = "not checked: deep water, calm weather, full load on even keel, V at least 90 % of the speed at 85 % MCR"
PASS, FAIL, OPEN, NONE = "pass", "fail", "not judged", "-"
SOURCE = (
    "MARIN free-running tests of KVLCC2 (SIMMAN 2008), re-reduced from the records in "
    "martinlarsalbert/System-identification-of-Vessel-Manoeuvring-Models, origin at the first rudder motion"
)
# (Manoeuvre, figure) -> value of SOURCE: lengths in L, angles in deg, positive rudder to starboard.
_KVLCC2 = {
    ("turning:35", "advance"): 3.09, ("turning:35", "transfer"): 1.35, ("turning:35", "tactical_diameter"): 3.33,
    ("turning:-35", "advance"): 3.02, ("turning:-35", "transfer"): 1.20, ("turning:-35", "tactical_diameter"): 3.07,
    ("zigzag:10/10", "overshoot_1"): 8.2, ("zigzag:10/10", "overshoot_2"): 21.9,
    ("zigzag:-10/10", "overshoot_1"): 9.5, ("zigzag:-10/10", "overshoot_2"): 15.0,
    ("zigzag:20/20", "overshoot_1"): 13.7, ("zigzag:20/20", "overshoot_2"): 14.9,
    ("zigzag:-20/20", "overshoot_1"): 15.1, ("zigzag:-20/20", "overshoot_2"): 13.3,
}  # fmt: skip
# Ship name -> its reference values.
REFERENCES: dict[str, dict[tuple[str, str], float]] = {"kvlcc2_l7": _KVLCC2, "kvlcc2_full": _KVLCC2}


@dataclass(frozen=True)
class Row:
    """One line of the table: a figure, its limit and the verdict.

    ability: of the standard, in words; run: the manoeuvre; figure: name of cases/criteria/figures.py; value, limit: in
    ``unit`` ("L" or "deg"), None where there is none; verdict: "pass", "fail", "not judged", or "-" where the standard
    sets no limit; why: reason or remark; reference: published value for this ship, None where there is none; measured:
    value before it was corrected for wind and current, None where nothing was. Of many ships that the trials allow
    (fitting/prediction/figure_intervals.py), None where none were drawn: median, which is the value
    then, and interval_90 (5 and 95 % quantiles) of the ship's figure, infinite where more draws than that never reach
    it; interval_90_trial: of a single trial of hers; probability of meeting the limit; reached: share of the draws that
    reach the figure; extrapolated: whether the manoeuvre leaves what the trials held.
    """

    ability: str
    run: str
    figure: str
    value: float | None
    limit: float | None
    unit: str
    verdict: str
    why: str = ""
    reference: float | None = None
    measured: float | None = None
    median: float | None = None
    interval_90: tuple[float, float] | None = None
    interval_90_trial: tuple[float, ...] | None = None
    probability: float | None = None
    reached: float | None = None
    extrapolated: bool | None = None


def first_overshoot_limit(ratio: float) -> float:
    """Limit of the first overshoot of the 10/10 zigzag [deg] for L/V = ``ratio`` [s] of the ship."""
    # IMO MSC.137(76), 5.3.3: 10 deg below 10 s, 20 deg from 30 s on, 5 + L/(2V) between
    return min(max(5.0 + 0.5 * ratio, 10.0), 20.0)


def second_overshoot_limit(ratio: float) -> float:
    """Limit of the second overshoot of the 10/10 zigzag [deg] for L/V = ``ratio`` [s] of the ship."""
    # IMO MSC.137(76), 5.3.3: 25 deg below 10 s, 40 deg from 30 s on, 17.5 + 0.75 L/V between
    return min(max(17.5 + 0.75 * ratio, 25.0), 40.0)


# Limits in L; the last is what an Administration may allow for ships of large displacement. (IMO MSC.137(76), 5.3.1,
# 5.3.2 and 5.3.4.)
ADVANCE, TACTICAL_DIAMETER, INITIAL_TURNING, TRACK_REACH, LONGEST_TRACK_REACH = 4.5, 5.0, 2.5, 15.0, 20.0
MAY_BE_LONG = f"an Administration may allow {LONGEST_TRACK_REACH:g} L for a ship of large displacement"
STOPPING = "stopping"
OVERSHOOT_20 = 25.0  # Limit of the first overshoot of the 20/20 zigzag [deg]. (IMO MSC.137(76), 5.3.3.)
# A turning test with less rudder is not judged, as the standard asks for 35 deg; zigzags are recognised within 2 deg
# [rad]. Both leave what a helm and its log are off by. Set by hand.
LEAST_TURNING_RUDDER, SLACK = math.radians(33.0), math.radians(2.0)


def assess(run: Run, scale: float | None = None, ship: str = "") -> list[Row]:
    """Rows of one run. scale: of a model, ship length over model length; ship: name for the reference values."""
    rows = _zigzag(run, scale) if run.kind == "zigzag" else _turning(run) if run.kind == "turning" else _others(run)
    why, caveats = _not_applicable(run, scale), "; ".join(run.caveats)
    judged = [replace(row, verdict=OPEN, why=why) if why and row.verdict in (PASS, FAIL) else row for row in rows]
    judged = [replace(row, why="; ".join(filter(None, (row.why, caveats)))) if caveats else row for row in judged]
    return [replace(row, reference=REFERENCES.get(ship, {}).get((run.name, row.figure))) for row in judged]


def worst(rows: Iterable[Row]) -> str:
    """ "fail" if any of ``rows`` fails, "pass" if all that have a limit pass, else "not judged"."""
    verdicts = [row.verdict for row in rows if row.verdict != NONE]
    if FAIL in verdicts:
        return FAIL
    return PASS if verdicts and all(v == PASS for v in verdicts) else OPEN


def _not_applicable(run: Run, scale: float | None) -> str:
    """Why nothing of a run can be judged, "" if it can."""
    length = run.length * (scale or 1.0)
    if length < SMALLEST:
        words = f"L = {length:g} m: the standard is for ships of {SMALLEST:g} m and more"
        return words if scale else f"{words}; for a model give its scale"
    return "; ".join(run.notes)


def _row(run: Run, ability: str, figure: str, unit: str, limit: float | None, why: str = "", open_: str = "") -> Row:
    """A row with its verdict; ``open_`` says why it is not judged although there is a value and a limit."""
    value = run.figures.get(figure)
    if value is not None and unit == "deg":
        value = math.degrees(value)
    elif value is not None:
        value = value / run.length if unit == "L" else value * run.length / run.speed  # r' = r L/V
    row = Row(ability, run.name, figure, value, limit, unit, NONE if limit is None else PASS, why)
    return replace(row, verdict=OPEN, why=open_) if open_ and value is not None else with_value(row, value)


def with_value(row: Row, value: float | None) -> Row:
    """The ``row`` with another ``value`` of its figure [``row.unit``], None where it is not reached, and the verdict
    that follows where there is one."""
    if row.limit is None or row.verdict not in (PASS, FAIL):
        return replace(row, value=value)
    if value is None:
        return replace(row, value=None, verdict=OPEN, why="the run does not reach it")
    # the remark on long ships is put anew: an other value may be on the other side of the limit
    why, is_long = row.why.removeprefix(MAY_BE_LONG).removeprefix("; "), row.limit < value <= LONGEST_TRACK_REACH
    why = "; ".join(filter(None, (MAY_BE_LONG, why))) if row.ability == STOPPING and is_long else why
    return replace(row, value=value, verdict=PASS if value <= row.limit else FAIL, why=why)


def _turning(run: Run) -> list[Row]:
    degrees = abs(math.degrees(run.rudder))
    requirement = f"rudder {degrees:.0f} deg; the standard asks for 35 deg of rudder or the largest"
    open_ = "" if abs(run.rudder) >= LEAST_TURNING_RUDDER else requirement
    return [
        _row(run, "turning", "advance", "L", ADVANCE, open_=open_),
        _row(run, "turning", "transfer", "L", None),
        _row(run, "turning", "tactical_diameter", "L", TACTICAL_DIAMETER, open_=open_),
    ]


def _is_zigzag(run: Run, degrees: float) -> bool:
    angle = math.radians(degrees)
    near = abs(abs(run.rudder) - angle) <= SLACK and abs(run.heading - angle) <= SLACK
    return near and (not run.measured or run.steps == (degrees, degrees))


def _zigzag(run: Run, scale: float | None) -> list[Row]:
    if _is_zigzag(run, 10.0):
        ratio = run.length / run.speed * math.sqrt(scale or 1.0)  # of the ship, by Froude's law
        words = f"L/V = {ratio:.3g} s"
        if scale:
            words += f" ({run.length / run.speed:.3g} s at scale {scale:g})"
        return [
            _row(run, "initial turning", "initial_turning_track", "L", INITIAL_TURNING),
            _row(run, "yaw checking", "overshoot_1", "deg", first_overshoot_limit(ratio), words),
            _row(run, "yaw checking", "overshoot_2", "deg", second_overshoot_limit(ratio), words),
        ]
    if _is_zigzag(run, 20.0):
        return [
            _row(run, "yaw checking", "overshoot_1", "deg", OVERSHOOT_20),
            _row(run, "yaw checking", "overshoot_2", "deg", None),
        ]
    rudder, heading = run.steps
    words = f"{rudder:g}/{heading:g} is no zigzag of the standard"
    if run.steps in ((10.0, 10.0), (20.0, 20.0)):
        words = f"the rudder was reversed at {math.degrees(run.heading):.1f} deg, more than 2 deg off the order"
    return [_row(run, "yaw checking", f"overshoot_{k}", "deg", None, words) for k in (1, 2)]


def _others(run: Run) -> list[Row]:
    """A stop; one by the engine alone has no limit, nor have spiral and pull-out: rates times L / V, dimensionless."""
    if run.kind in ("crash-stop", "coasting"):
        ability, limit = (STOPPING, TRACK_REACH) if run.kind == "crash-stop" else (run.kind, None)
        return [_row(run, ability, "track_reach", "L", limit), _row(run, ability, "head_reach", "L", None)]
    units = {name: "V/L" for name in run.figures if "rate" in name or name == "loop_height"}
    units |= {"loop_width": "deg"} if "loop_width" in run.figures else {}
    return [_row(run, "course stability", name, unit, None) for name, unit in units.items()]


# Key of a run in JSON -> attribute of a Run, beside its figures, notes and caveats.
RUN_KEYS = {
    "name": "name", "kind": "kind", "title": "title", "measured": "measured", "order_time_s": "order_time",
    "end_s": "end", "rudder_rad": "rudder", "switch_heading_rad": "heading", "speed_m_s": "speed", "length_m": "length",
}  # fmt: skip


@dataclass(frozen=True, repr=False)
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
            {key: getattr(run, name) for key, name in RUN_KEYS.items()}
            | {"figures": dict(run.figures), "notes": list(run.notes), "caveats": list(run.caveats)}
            for run in self.runs
        ]
        head = {"ship": self.ship, "heading": self.heading, "standard": "IMO MSC.137(76)", "verdict": self.verdict}
        head |= {"verdict_basis": self.basis}
        mark = asdict(self.mark) if self.mark else None
        rows = [asdict(row) | {"criterion": row.limit} for row in self.rows]
        return {**head, "calibration": mark, "rows": rows, "runs": runs, "notices": list(self.notices)}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.heading}; {len(self.rows)} figures, {self.conclusion}>"

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
        plan = parse_maneuver(text, calm, speed=V, rudder_rate=rudder_rate)
        if "order_time" not in plan.parameters or plan.kind == "heading":
            kinds = "turning, zigzag, spiral, pull-out, crash-stop, coasting"
            raise UnknownName(f"manoeuvre '{text}' has no order to judge; use {kinds}")
    runs, missed = [], {}
    for text in dict.fromkeys((*STANDARD, *maneuvers)):
        try:
            run = simulated_run(calm, text, V, rudder_rate=rudder_rate)
            runs.append(replace(run, caveats=(*run.caveats, *by_rule(calm, run, origin, rudder_rate))))
        except UserError as error:
            missed[text] = str(error)
    if not runs:
        raise NoSolution(next(iter(missed.values())))
    L = calm.particulars["L"]
    heading = f"{calm.title}, simulated: L {L:g} m, V {V:.4g} m/s, L/V {L / V:.3g} s"
    if "n" in calm.actuators:
        heading += f", n {runs[0].trial['n'][0]:.4g} rps"
    notices = [Message(f"test speed V: {origin}; {helm_words(calm, rudder_rate)}", "test_conditions")]
    said = (m for run in runs for m in run.trial.notices if isinstance(m, Message) and m.code in STOPPING_CODES)
    notices += dict.fromkeys((*said, *as_messages(ship.notices, "ship")))
    if left_out:
        words = "left out, as the tests are in calm, deep water and free of sensor errors: "
        notices.append(Message(words + ", ".join(left_out), "effects_left_out"))
    more = [Row("", text, "no figure", None, None, "", OPEN, why) for text, why in missed.items()]
    return _assessed(calm, heading, runs, scale or calm.particulars.get("scale"), notices, more)


def helm_words(ship: Ship, rudder_rate: float | None = None) -> str:
    """The rate at which the rudder of ``ship`` moves in a simulated manoeuvre, and its delay, and where they are from;
    rudder_rate: [rad/s] where it was given."""
    degrees = math.degrees(rudder_rate if rudder_rate is not None else Limits.for_ship(ship).rudder_rate)
    if not math.isfinite(degrees):
        return "the rudder moves as the ship's actuators do"
    given = "as given" if rudder_rate is not None else ship.sources.get("rudder_rate", "")
    rule = rudder_rate is None and "rudder_rate" not in ship.particulars
    origin = "by rule, 20 deg/s of a 3 m model by Froude's law" if rule else given or "of the ship file"
    delay = ship.particulars.get("rudder_delay", 0.0)
    late = f"; it waits {delay:.3g} s, {ship.sources.get('rudder_delay', 'of the ship file')}" if delay else ""
    return f"rudder rate {degrees:.3g} deg/s, {origin}{late}"


def follows_rule(words: str) -> bool:
    """Whether ``words`` on where a value is from say that a rule of thumb gave it; they may name trials."""
    return BY_RULE in words or " by rule" in words


def by_rule(ship: Ship, run: Run, origin: str, rudder_rate: float | None) -> list[str]:
    """What of a simulated ``run`` of ``ship`` hangs on rules of thumb: words. origin: of the test speed; rudder_rate:
    [rad/s] where it was given."""
    words = [f"test speed: {origin}"] if follows_rule(origin) else []
    helm = helm_words(ship, rudder_rate)
    if run.kind not in STOPS and follows_rule(helm):
        words.append(helm)
    if has_code(run.trial.notices, STOPPING_CODES[0]):
        words.append("engine by rule: its particulars are not in the ship file")
    return words


def of_midship(ship: Ship | None, trial: Trial) -> Trial:
    """The ``trial`` with positions and velocities of midship, by the antenna of the ``ship``; as it is where she has
    none."""
    if ship is None or "antenna_offset" not in ship.effects:
        return trial
    x, y, alone_x, alone_y = (
        c.value if (c := ship.coefficients.get(f"antenna_offset.{name}")) else 0.0
        for name in ("x", "y", "alone_x", "alone_y")
    )
    # x0 + i y0 and u + i v: positions lie off by the lever arm turned with psi, velocities by r times it
    speed = trial["u"] + 1j * trial["v"] - 1j * trial["r"] * complex(x, y)
    moved = {"u": speed.real, "v": speed.imag}
    if trial.has_position:
        place = trial["x"] + 1j * trial["y"] - complex(x + alone_x, y + alone_y) * np.exp(1j * trial["psi"])
        moved |= {"x": place.real, "y": place.imag}
    return trial.with_columns(**moved)


def imo_figures_of_trials(
    trials: Sequence[Trial],
    ship: Ship | None = None,
    length: float | None = None,
    scale: float | None = None,
    correct: bool | WaterVelocity = False,
) -> Assessment:
    """Measured runs judged by IMO MSC.137(76).

    trials: with one manoeuvre or several each, the approach is cut off; ship: gives its name, length and scale, and
    the lever arm of an antenna that was fitted, which is taken off; length: of the ship [m], where there is no ship;
    scale: ship length over model length; correct: to still water and calm air, with the current of the circles among
    the trials or a given one (``corrected_runs``). Of several runs, one without a manoeuvre becomes a notice. Raises
    UserError when no length is given, when the trials are not of the ship, and when there is no manoeuvre in any of
    them.
    """
    if ship is None and length is None:
        raise Missing("trials need the length of their ship; give ship or length")
    L = length if length is not None else ship.particulars["L"] if ship else 0.0
    runs, notices = [], [*TrialSet.of(trials).remarks, *(assumed(trials, ship.inputs) if ship else ())]
    if has_code(notices, LEFT_OUT):
        words = (
            "what is left out of a measured manoeuvre is bridged by straight lines, where she hardly turns meanwhile"
        )
        notices.append(Message(words, "bridged"))
    if ship is not None and "antenna_offset" in ship.effects:
        notices.append(Message("of midship: without the lever arm of the antenna of the ship file", "of_midship"))
    for trial in trials:
        try:
            runs += measured_runs(of_midship(ship, trial), L)
        except UserError as error:
            if len(trials) == 1:
                raise
            notices.append(Message(f"left out: {error}", "no_maneuver_found"))
    refused = [note for note in notices if has_code([note], "no_maneuver_found")]
    if not runs:
        raise Missing(f"no standard manoeuvre in any of {len(trials)} trials; first: {refused[0]}")
    several = len(trials) - len(refused) < len(runs)
    counted = f", {len(runs)} manoeuvres" if several else ""
    title, used = ship.title if ship else "ship", len(trials) - len(refused)
    heading = f"{title}, measured: L {L:g} m, {used} of {len(trials)} runs{counted}"
    size = scale or (ship.particulars.get("scale") if ship else None)
    if not correct:
        return _assessed(ship, heading, runs, size, notices, [])
    better, done = corrected_runs(runs, ship, correct if isinstance(correct, WaterVelocity) else None)
    corrected = _assessed(ship, f"{heading}, corrected for wind and current", better, size, [*notices, *done], [])
    before = [row.value for run in runs for row in assess(run, size, _known_as(ship))]
    return replace(
        corrected, rows=tuple(replace(row, measured=value) for row, value in zip(corrected.rows, before, strict=True))
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
