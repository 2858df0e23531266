"""Error bars of manoeuvring figures: many ships that the trials allow, each simulated through the manoeuvre.

A draw has coefficients from their joint covariance. Where the manoeuvre leaves the motion that the trials held, it also
has a lasting unexplained acceleration, whose size grows with the distance (``unexplained``): that is the ship's figure.
A single trial has besides the fluctuating accelerations that no model explained in the trials (``bands.Process``). All
draws of a manoeuvre are simulated side by side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cases.criteria.assessment import Assessment
from cases.criteria.batch_figures import figures_of_each, since_each
from cases.criteria.figures import Since
from cases.criteria.imo import NONE, OPEN, Row
from cases.criteria.scatter import draw_coefficients
from cases.criteria.standard_runs import Run
from cases.maneuvers.definitions import STOPS, Maneuver, parse_maneuver
from cases.shipfiles.effects import calm_and_deep
from cases.simulation.pushed_batch import simulate_pushed
from cases.simulation.simulate_batch import SimulatedRuns, simulate_batch
from fitting.parallel import Shared, run_all
from fitting.prediction.bands import bands_of
from fitting.prediction.envelope import DRIFT
from fitting.prediction.unexplained import accelerations, drawn_resistance
from mmg.errors import UserError
from mmg.messages import Message
from mmg.motion.froude import reference_speed, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

STEP = 0.5
"""Sampling interval [s] of a 3 m model; scales with sqrt(L)."""
DRAWS = 500
"""Ships drawn where nothing else is asked for."""
MOST = 20_000
"""Most draws of one call."""
JUDGED = ("turning", "zigzag", *STOPS)
"""Manoeuvres whose figures get an interval."""
NEAR = 0.25
"""Share of their distance from the ship at which draws of a calibrated ship are simulated."""
SHOWN = 60
"""Draws whose tracks are kept for a figure."""
BEYOND = 0.05
"""Share of the range of the trials, and of its greatest value, by which a manoeuvre may leave it."""
ANGLE = math.radians(2.0)
"""Least excess of a rudder or drift angle that is said [rad]."""
QUANTITIES = {
    "u": "surge velocity",
    "v": "sway velocity",
    "r": "yaw rate",
    DRIFT: "drift angle",
    "n": "revolutions",
    "delta": "rudder angle",
}
"""What is compared with the trials."""
SHOWN_IN = {
    "u": ("m/s", 1.0),
    "v": ("m/s", 1.0),
    "r": ("deg/s", math.degrees(1.0)),
    DRIFT: ("deg", math.degrees(1.0)),
    "n": ("1/s", 1.0),
    "delta": ("deg", math.degrees(1.0)),
}
"""Unit in which a quantity is said, and its factor from SI and rad."""
FAR = 2.0
"""Yaw rate or drift angle over the greatest of the trials on that side, beyond which no trial came near: less than a
quarter of the nonlinear forces, which go with the square or more, acted in them."""
TITLES = {"turning": "a turn so tight", "zigzag": "a zigzag so wide", "spiral": "a spiral so wide",
          "pull-out": "a turn so tight"}  # fmt: skip
"""How a manoeuvre is called that no trial came near."""


@dataclass(frozen=True)
class FigureScatter:
    """One manoeuvre over all draws.

    ship, trial: figure -> values (count,), SI and rad, NaN where it is not reached, of the ship and of a single trial;
    outside: what leaves the range of the trials, in words, None where that range is not known; lost: draws that
    diverge; shown: some of the draws of single trials from the order on; ranges: quantity of ``QUANTITIES`` -> least
    and greatest value of the ship as it is in this manoeuvre, SI and rad; widened: whether the figures' scatter grows
    where the manoeuvre leaves the trials.
    """

    ship: Mapping[str, np.ndarray]
    trial: Mapping[str, np.ndarray]
    outside: tuple[str, ...] | None
    lost: int
    shown: tuple[Since, ...]
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    widened: bool = True


@dataclass(frozen=True)
class JudgedFigures:
    """An assessment with intervals in its rows, and the scatter behind it by the name of the manoeuvre."""

    assessment: Assessment
    scatter: Mapping[str, FigureScatter]


def with_intervals(
    found: Assessment,
    ship: Ship,
    content: Mapping[str, Any],
    count: int,
    seed: int = 0,
    rudder_rate: float | None = None,
    workers: int = 1,
) -> JudgedFigures:
    """An assessment of simulated runs with median, 90 % interval and probability of meeting the criterion.

    found: of ``cases.criteria.assessment.imo_figures``, with the same rudder_rate [rad/s]; ship: as it was given there;
    content: of the result.json of a calibration, {}: the standard deviations of the ship file stand alone, and are
    independent; count, seed: of the draws; workers: processes over which the manoeuvres are spread. Raises UserError
    for a count that makes no sense, and for a ship without standard deviations.
    """
    if not 20 <= count <= MOST:
        raise UserError(f"--scatter {count}: give 20 to {MOST} draws, or 0 for none")
    calm = calm_and_deep(ship)[0]
    correlation, notices = correlation_in(content), list(found.notices)
    drawn = draw_coefficients(calm, count, seed, correlation)
    if correlation is None:
        words = "coefficients are drawn independently of each other: no correlation is known"
        notices.append(Message(words, "independent_draws"))
    shared, judged = Shared((Simulator(calm), drawn, content)), [run for run in found.runs if run.kind in JUDGED]
    plans = [parse_maneuver(run.name, calm, speed=run.speed, rudder_rate=rudder_rate) for run in judged]
    made = run_all(_drawn_plan, [(shared, plan, seed) for plan in plans], workers, name="manoeuvres")
    scatter = {run.name: one for run, one in zip(judged, made, strict=True)}
    for run, one in zip(judged, made, strict=True):
        if one.outside:
            notices.append(Message(outside_words(run.name, run.kind, one.outside, one.widened), "outside_the_trials"))
        if one.lost:
            words = f"{run.name}: {one.lost} of {count} drawn ships run away, and count as never reaching a figure"
            notices.append(Message(words, "diverging_draws"))
    runs = {run.name: run for run in found.runs}
    rows = tuple(judged_row(row, runs[row.run], scatter[row.run]) if row.run in scatter else row for row in found.rows)
    return JudgedFigures(replace(found, rows=rows, notices=tuple(notices)), scatter)


def _drawn_plan(job: tuple[Shared, Maneuver, int]) -> FigureScatter:
    """All draws of one manoeuvre, of simulator, draws and content of the result that tasks share, and a seed."""
    shared, plan, seed = job
    simulator, drawn, content = shared.value
    return drawn_figures(simulator, plan, drawn, content, seed)[0]


def correlation_in(content: Mapping[str, Any]) -> tuple[list[str], np.ndarray] | None:
    """Symbols (Q,) and correlation matrix (Q, Q) of the estimates in the ``content`` of a result.json, None where
    there is none or numbers are missing in it."""
    try:
        symbols = [str(s) for s in content["correlation"]["symbols"]]
        matrix = np.array(content["correlation"]["matrix"], dtype=float)
    except (KeyError, TypeError, ValueError):
        return None
    whole = matrix.shape == (len(symbols), len(symbols)) and np.isfinite(matrix).all()
    return (symbols, matrix) if whole else None


def drawn_figures(
    simulator: Simulator,
    plan: Maneuver,
    drawn: Mapping[str, np.ndarray],
    content: Mapping[str, Any],
    seed: int,
    dt: float | None = None,
    tracks: int = SHOWN,
) -> tuple[FigureScatter, SimulatedRuns]:
    """All draws of one manoeuvre: of the ship, and of as many single trials of the same ships.

    simulator: of the ship; plan: what is ordered; drawn: symbol -> (count,); content: of the result.json of a
    calibration, {}: no unexplained accelerations are known; seed: of the accelerations; dt: sampling interval [s],
    default 0.5 s of a 3 m model; tracks: single trials whose motions are returned, of the first draws. Figures of a
    calibrated ship are linear in the draws but in stops (``linearised``). Raises UserError for spiral and pull-out.
    """
    ship = simulator.ship
    bands, envelope = bands_of(content, ship), content.get("envelope")
    count, L = len(next(iter(drawn.values()))), ship.particulars["L"]
    dt, tracks = dt or STEP * time_scale(L), min(tracks, count)
    nominal = simulate_batch(simulator, plan, dt=dt, held=True)
    outside = outside_of(envelope, nominal) if envelope else None
    drawn = drawn_resistance(ship, plan, dict(drawn), count, seed)
    own = figures_of_each(nominal, plan)[0]
    near = NEAR if bands is not None and plan.kind not in STOPS and all(map(math.isfinite, own.values())) else 1.0

    def moved(many: int, share: float) -> SimulatedRuns:
        copies = 2 if bands is not None else 1
        push = accelerations(bands, ship, plan, nominal, many, dt, seed, share)
        values = {s: np.tile(_towards(ship.coefficients[s].value, x[:many], share), copies) for s, x in drawn.items()}
        order = plan if plan.engine is None else replace(plan, engine=plan.engine.drawn(many, seed).repeated(copies))
        runs = simulate_pushed(simulator, order, values, dt, push)
        with np.errstate(invalid="ignore", over="ignore"):
            lost = ~(np.abs(runs.states[:, 3:5]).max(axis=(0, 1)) < 3 * reference_speed(L))
        return replace(runs, states=np.where(lost, np.nan, runs.states))

    runs = moved(count, near)
    each = figures_of_each(runs, plan)
    names = list(dict.fromkeys(name for one in each for name in one))
    table = {name: np.array([one.get(name, np.nan) for one in each]) for name in names}
    ships, trials = ({name: column[part] for name, column in table.items()}
                     for part in (slice(count), slice(-count, None)))  # fmt: skip
    if near < 1:
        ships, trials = linearised(own, ships, trials, near)
    whole = runs if near == 1 else moved(tracks, 1.0)
    kept = np.arange(len(whole.last) - (count if near == 1 else tracks), len(whole.last))[:tracks]
    motions = SimulatedRuns(whole.t, whole.states[:, :, kept], whole.inputs[:, :, kept], whole.last[kept])
    few = SimulatedRuns(whole.t, *(x[..., :SHOWN] for x in (motions.states, motions.inputs, motions.last)))
    shown = tuple(s for s in since_each(few, plan.parameters["order_time"]) if s is not None)
    lost = int(np.isnan(runs.states[-1, 0, :count]).sum())
    widened = bands is not None and bands.held is not None
    return FigureScatter(ships, trials, outside, lost, shown, ranges_of(nominal), widened), motions


def _towards(value: float, drawn: np.ndarray, share: float) -> np.ndarray:
    """``drawn`` (count,) moved to a ``share`` of its distance from ``value``."""
    return drawn if share == 1 else value + share * (drawn - value)


def linearised(
    own: Mapping[str, float], ships: Mapping[str, np.ndarray], trials: Mapping[str, np.ndarray], near: float
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Figures (count,) of ``ships`` and of single ``trials`` of them, from those of draws that lie ``near`` the ship.

    A covariance belongs to the model linearised in its coefficients: in directions that the trials hardly tell, draws
    through the whole model leave what the trials allow, and figures scatter too widely (Immer, Korzepa & Bauer 2021,
    Improving predictions of Bayesian neural nets via local linearization, AISTATS, eq. 10). So the figure's change
    between the ship as she is, ``own``, and draws at a share ``near`` of their distance is carried on, in its
    logarithm where it is positive. A single trial has besides what it changes of the near ship's figure.
    """
    found: tuple[dict[str, np.ndarray], dict[str, np.ndarray]] = {}, {}
    for name, column in ships.items():
        once, at = trials[name], own.get(name, math.nan)
        positive = at > 0 and not (column <= 0).any() and not (once <= 0).any()
        with np.errstate(over="ignore"):
            if positive:
                ship = at * (column / at) ** (1 / near)
                each = ship * (once / column)
            else:
                ship = at + (column - at) / near
                each = ship + (once - column)
        found[0][name], found[1][name] = ship, each
    return found


def ranges_of(runs: SimulatedRuns) -> dict[str, tuple[float, float]]:
    """Least and greatest value of each of ``QUANTITIES`` in the first of ``runs``, SI and rad."""
    rows = slice(0, int(runs.last[0]) + 1)
    u, v, r = runs.states[rows, 3:, 0].T
    moving = np.hypot(u, v) > 0.1 * np.abs(u).max()
    n, delta = np.asarray(runs.inputs[rows, :, 0]).T
    beta = np.arctan2(-v[moving], u[moving])
    known = {"u": u, "v": v, "r": r, DRIFT: beta, "n": n, "delta": delta}
    return {name: (float(known[name].min()), float(known[name].max())) for name in QUANTITIES if len(known[name])}


def outside_of(envelope: Mapping[str, Sequence[float]], runs: SimulatedRuns) -> tuple[str, ...]:
    """Which quantities of the first of ``runs`` leave the ranges of an ``envelope``, in words with the worst value."""
    found = []
    for name, (least, most) in ranges_of(runs).items():
        if name not in envelope:
            continue
        low, high = (float(x) for x in envelope[name])
        slack = max(BEYOND * max(high - low, abs(low), abs(high)), ANGLE if name in (DRIFT, "delta") else 0.0)
        unit, factor = SHOWN_IN[name]
        for reached, limit, over in ((least, low, least < low - slack), (most, high, most > high + slack)):
            if over:
                found.append(f"{QUANTITIES[name]} {factor * reached:.3g} {unit}, in the trials {factor * limit:.3g}")
    return tuple(found)


def outside_words(name: str, kind: str, outside: Sequence[str], widened: bool = True) -> str:
    """A sentence on a manoeuvre of this ``name`` and ``kind`` that leaves what the trials held.

    outside: how; widened: whether its intervals grow by that.
    """
    turns = [_numbers_in(words) for words in outside if words.startswith(QUANTITIES["n"])]
    if kind in STOPS and any(reached < limit for reached, limit in turns):
        return f"{name}: stopping was not in the trials: these figures are the prior's ({'; '.join(outside)})"
    turning = [_numbers_in(words) for words in outside if words.startswith(tuple(QUANTITIES[q] for q in ("r", DRIFT)))]
    if kind not in STOPS and any(abs(reached) > FAR * abs(limit) for reached, limit in turning):
        title = TITLES.get(kind, "such a manoeuvre")
        return f"{name}: no trial came near {title}: these figures are the prior's ({'; '.join(outside)})"
    effect = "so its intervals are wider" if widened else "which its intervals do not cover"
    return f"{name}: outside the trials, {effect}: {'; '.join(outside)}"


def _numbers_in(words: str) -> tuple[float, float]:
    """What a manoeuvre reaches and the trials held, as ``outside_of`` words them."""
    reached, _, held = words.partition(", ")
    return float(reached.split()[-2]), float(held.split()[-1])


def judged_row(row: Row, run: Run, scatter: FigureScatter) -> Row:
    """The ``row`` of a ``run`` with what its draws, ``scatter``, say."""
    factor = {"L": 1 / run.length, "deg": 57.29577951308232}.get(row.unit)
    values, trial = scatter.ship.get(row.figure), scatter.trial.get(row.figure)
    outside = None if scatter.outside is None else bool(scatter.outside)
    if factor is None or values is None or trial is None or not np.isfinite(values).any():
        return replace(row, extrapolated=outside)
    # a draw that never comes so far lies beyond every value
    never, once = (np.where(np.isfinite(x), factor * x, np.inf) for x in (values, trial))
    low, middle, high = (float(q) for q in np.quantile(never, (0.05, 0.5, 0.95), method="inverted_cdf"))
    ends = tuple(float(q) for q in np.quantile(once, (0.05, 0.95), method="inverted_cdf"))
    chance = None
    if row.limit is not None and row.verdict not in (OPEN, NONE):
        chance = float((never <= row.limit).mean())
    return replace(
        row, median=middle, interval_90=(low, high), interval_90_trial=ends, probability=chance,
        reached=float(np.isfinite(values).mean()), extrapolated=outside,
    )  # fmt: skip
