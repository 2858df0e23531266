"""Error bars of manoeuvring figures: many ships that the trials allow, each simulated through the manoeuvre.

A draw has coefficients from their joint covariance. Where the manoeuvre leaves the motion that the trials held, it also
has a lasting unexplained acceleration, whose size grows with the distance (``envelope``), as her forces differ from the
model's there: that is the ship's figure. A single trial has besides the fluctuating accelerations that no model
explained in the trials (``bands.Process``): gusts, waves, and all else that changes while it runs. All draws of a
manoeuvre are simulated side by side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.criteria.figures import Since, figure_unit
from cases.criteria.imo import FAIL, NONE, OPEN, PASS, Assessment, Row, assess, with_value
from cases.criteria.standard_runs import Run, figures_of_each, planned_run, since_each
from cases.maneuvers.definitions import STOPS, Maneuver, parse_maneuver
from cases.shipfiles.effects import calm_and_deep
from cases.simulation.simulate_batch import Push, SimulatedRuns, draw_coefficients, input_array, simulate_batch
from cases.trial import Trial
from fitting.parallel import Shared, run_all
from fitting.prediction.bands import Bands, acceleration_sizes, bands_of, correlation_in, student_factor
from fitting.prediction.envelope import Excess, outside_of, outside_words, untried
from mmg.effects import EFFECTS
from mmg.errors import OutOfRange, Unsupported, refusing
from mmg.messages import Message
from mmg.motion.froude import reference_speed, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEP = 0.5  # Sampling interval [s] of a 3 m model; scales with sqrt(L). Set by hand.
# Ships drawn where nothing else is requested. The end of a 90 % interval is known to 0.09 standard deviations.
DRAWS = 500  # set by hand
MOST = 20_000  # Most draws of one call. Set by hand: bounds memory and time.
JUDGED = ("turning", "zigzag", *STOPS)  # Manoeuvres whose figures get an interval
NEAR = 0.25  # Share of their distance from the ship at which draws of a calibrated ship are simulated. Set by hand.
SHOWN = 60  # Draws whose tracks are kept for a figure. Set by hand: display.
# Share of the trials' points that are slower than the speed below which a lasting acceleration falls with U^2.
SLOW = 0.1  # set by hand
# Standard deviation of the deceleration in a stop that no trial held, by that deceleration: an estimate of this library
# for reversed propellers, of which trials ahead say nothing. Sway and yaw have no more than such a force. Nor have
# other manoeuvres a larger share of what accelerates the ship in them, however far from the trials they lie: ships that
# no trial told anything of turn within about that share (``benchmarks.literature``).
UNTRIED = 1 / 3
# Greatest error of a deceleration, by it, set below 1: water and a reversed propeller do not drive a ship on.
MOST_SHARE = 0.9  # set by hand
# Yaw acceleration by that force over mass and length, at a quarter of the length: so is the radius of gyration. Set by
# hand at that.
LEVER = 4.0
# Standard deviation of ``stopping_resistance`` by its value: form factor and allowance of ITTC 7.5-02-03-01.4 (2017)
# are each known to some 5 to 10 % of the total.
RESISTANCE = 0.1
NOWHERE = np.array([math.nan])  # A figure that no draw reaches


@dataclass(frozen=True)
class FigureScatter:
    """One manoeuvre over all draws.

    ship, trial: figure -> values (count,), SI and rad, NaN where it is not reached, of the ship and of a single trial;
    outside: what leaves the range of the trials, None where that range is not known; lost: draws that diverge; shown:
    some of the draws of single trials from the order on; widened: whether the figures' scatter grows where the
    manoeuvre leaves the trials.
    """

    ship: Mapping[str, np.ndarray]
    trial: Mapping[str, np.ndarray]
    outside: tuple[Excess, ...] | None
    lost: int
    shown: tuple[Since, ...]
    widened: bool = True

    def of(self, figure: str, factor: float = 1.0, limit: float | None = None) -> dict[str, Any]:
        """Median, 90 % intervals of the ship and of a single trial, and probability of staying within ``limit`` (None:
        no limit) of a ``figure`` by its draws, each times ``factor``: fields of a row. A draw that never comes so far
        lies beyond every value."""
        values, trial = (column.get(figure, NOWHERE) for column in (self.ship, self.trial))
        ships, trials = (np.where(np.isfinite(x), factor * x, np.inf) for x in (values, trial))
        # quantiles that are draws themselves: between a number and inf there is no mean
        low, middle, high = (float(q) for q in np.quantile(ships, (0.05, 0.5, 0.95), method="inverted_cdf"))
        ends = tuple(float(q) for q in np.quantile(trials, (0.05, 0.95), method="inverted_cdf"))
        chance = None if limit is None else float((ships <= limit).mean())
        return {"median": middle, "interval_90": (low, high), "interval_90_trial": ends, "probability": chance}

    def share(self, figure: str) -> float:
        """Share of the draws that reach a ``figure``."""
        return float(np.isfinite(self.ship.get(figure, NOWHERE)).mean())

    def notices(self, name: str, kind: str, count: int) -> list[Message]:
        """What to know of a manoeuvre of this ``name`` and ``kind``: that it leaves the trials, and that some of its
        ``count`` draws diverge."""
        found = []
        if self.outside:
            found.append(Message(outside_words(name, kind, self.outside, self.widened), "outside_the_trials"))
        if self.lost:
            words = f"{name}: {self.lost} of {count} drawn ships run away, and count as never reaching a figure"
            found.append(Message(words, "diverging_draws"))
        return found


# Said of draws where no correlation of the coefficients is known.
INDEPENDENT = Message(
    "coefficients are drawn independently of each other: no correlation is known", "independent_draws"
)


@refusing
@dataclass(frozen=True, repr=False)
class JudgedFigures(Assessment):
    """An assessment with intervals in its rows, and the scatter behind them by the name of the manoeuvre, empty where
    there are no draws."""

    scatter: Mapping[str, FigureScatter] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, assessment: Assessment) -> JudgedFigures:
        """An ``assessment`` without draws."""
        return cls(**vars(assessment))

    def plot(self, *given: Axes | str, ax: Axes | None = None, kind: str = "turning") -> Axes:
        """Draw the manoeuvres of a ``kind`` ("turning", "crash-stop", "zigzag:10/10", ...) on ``ax``, None: new axes;
        returns them. given: either or both without their names. Raises UserError where none was made."""
        from fitting.report.plot_maneuvers import draw_maneuvers  # late: matplotlib is slow to import

        for one in given:
            ax, kind = (ax, one) if isinstance(one, str) else (one, kind)
        return draw_maneuvers(self.runs, kind, self.clouds, ax)

    @property
    def clouds(self) -> dict[str, Sequence[Since]]:
        """Some of the draws of each manoeuvre, by its name, to be drawn."""
        return {name: one.shown for name, one in self.scatter.items()}


def with_intervals(
    assessment: Assessment,
    ship: Ship,
    content: Mapping[str, Any],
    count: int,
    seed: int = 0,
    rudder_rate: float | None = None,
    workers: int = 1,
) -> JudgedFigures:
    """An assessment of simulated runs with median, 90 % interval and probability of meeting the criterion.

    assessment: of ``cases.criteria.imo.imo_figures``, with the same rudder_rate [rad/s]; ship: as it was given there;
    content: of the result.json of a calibration, {}: the standard deviations of the ship file stand alone, and are
    independent; count, seed: of the draws; workers: processes over which the manoeuvres are spread. Raises UserError
    for a count that makes no sense, and for a ship without standard deviations.
    """
    if not 20 <= count <= MOST:
        raise OutOfRange(f"--scatter {count}: give 20 to {MOST} draws, or 0 for none")
    calm = calm_and_deep(ship)[0]
    correlation = correlation_in(content)
    drawn, notices = draw_coefficients(calm, count, seed, correlation), list(assessment.notices)
    notices += [INDEPENDENT] if correlation is None else []
    shared, judged = Shared((Simulator(calm), drawn, content)), [run for run in assessment.runs if run.kind in JUDGED]
    plans = [parse_maneuver(run.name, calm, speed=run.speed, rudder_rate=rudder_rate) for run in judged]
    jobs = [(shared, plan, seed, dict(run.figures)) for run, plan in zip(judged, plans, strict=True)]
    results = run_all(_drawn_plan, jobs, workers, name="manoeuvres")
    runs = {run.name: run for run in judged}
    scatter = {run.name: one for run, one in zip(judged, results, strict=True)}
    for run, one in zip(judged, results, strict=True):
        notices += one.notices(run.name, run.kind, count)
    rows = tuple(
        judged_row(row, runs[row.run], scatter[row.run]) if row.run in scatter else row for row in assessment.rows
    )
    priors = [run.name for run in judged if untried(run.kind, scatter[run.name].outside or ())]
    basis = _basis(rows, scatter, priors, bool(content))
    changed: dict[str, Any] = {"rows": rows, "notices": tuple(notices), "basis": basis, "scatter": scatter}
    return JudgedFigures(**{**vars(assessment), **changed})


def _basis(
    rows: Sequence[Row], scatter: Mapping[str, FigureScatter], priors: Sequence[str], is_calibrated: bool
) -> str:
    """What the verdict of all ``rows`` rests on, "" where nothing was judged; priors: names of manoeuvres that no trial
    supports."""
    judged = [row for row in rows if row.probability is not None]
    if not judged:
        return ""
    if any(one.outside is None for one in scatter.values()):
        return "no record says what the trials held" if is_calibrated else "by the ship file alone, not by trials"
    supported = [row for row in judged if row.run not in priors]
    passed, beyond = sum(row.verdict == PASS for row in supported), sum(bool(row.extrapolated) for row in supported)
    words = f"{passed} of {len(supported)} figures pass" + (f", {beyond} of them extrapolated" if beyond else "")
    return f"{words}; the prior's, so without a say: {', '.join(priors)}" if priors else words


def _drawn_plan(job: tuple[Shared, Maneuver, int, dict[str, float]]) -> FigureScatter:
    """All draws of one manoeuvre, of simulator, draws and content of the result that tasks share, a seed, and the
    figures of the ship as she is."""
    shared, plan, seed, exact = job
    simulator, drawn, content = shared.value
    return drawn_figures(simulator, plan, drawn, content, seed, exact=exact)[0]


def drawn_figures(
    simulator: Simulator,
    plan: Maneuver,
    drawn: Mapping[str, np.ndarray],
    content: Mapping[str, Any],
    seed: int,
    dt: float | None = None,
    tracks: int = SHOWN,
    exact: Mapping[str, float] | None = None,
) -> tuple[FigureScatter, SimulatedRuns]:
    """All draws of one manoeuvre: of the ship, and of as many single trials of the same ships.

    simulator: of the ship; plan: what is ordered; drawn: symbol -> (count,); content: of the result.json of a
    calibration, {}: no unexplained accelerations are known; seed: of the accelerations; dt: sampling interval [s],
    default 0.5 s of a 3 m model; tracks: single trials whose motions are returned, of the first draws; exact: figures
    of the ship as it is, simulated finely, about which the draws are put. Figures of a calibrated ship are linear in
    the draws but in stops (``carried_on``). Raises UserError for spiral and pull-out.
    """
    ship = simulator.ship
    bands, envelope = bands_of(content, ship), content.get("envelope")
    count, L = len(next(iter(drawn.values()))), ship.particulars["L"]
    dt, tracks = dt or STEP * time_scale(L), min(tracks, count)
    nominal = simulate_batch(simulator, plan, dt=dt)
    outside = outside_of(envelope, nominal) if envelope else None
    drawn = drawn_resistance(ship, plan, dict(drawn), count, seed)
    nominal_figures = figures_of_each(nominal, plan)[0]
    # a figure that the ship herself does not reach has no change that could be carried on
    near = (
        NEAR
        if bands is not None and plan.kind not in STOPS and all(map(math.isfinite, nominal_figures.values()))
        else 1.0
    )
    clusters = content.get("uncertainty", {}).get("runs")
    farther = student_factor(clusters) if clusters and near < 1 else 1.0  # of accelerations the bands have it already

    def simulated(many: int, share: float) -> SimulatedRuns:
        """``many`` ships at a ``share`` of the draws' distance from her, then, with bands, a single trial of each."""
        copies = 2 if bands is not None else 1
        push = accelerations(bands, ship, plan, nominal, many, dt, seed, share)
        values = {}
        for symbol, x in drawn.items():
            at = ship.coefficients[symbol].value
            values[symbol] = np.tile(x[:many] if share == 1 else at + share * farther * (x[:many] - at), copies)
        order = plan if plan.engine is None else replace(plan, engine=plan.engine.drawn(many, seed).repeated(copies))
        runs = simulate_batch(simulator, order, values, dt, push)
        with np.errstate(invalid="ignore", over="ignore"):  # Froude number 3: she runs away
            lost = ~(np.abs(runs.states[:, 3:5]).max(axis=(0, 1)) < 3 * reference_speed(L))
        return replace(runs, states=np.where(lost, np.nan, runs.states))

    runs = simulated(count, near)
    each = figures_of_each(runs, plan)
    names = list(dict.fromkeys(name for one in each for name in one))
    table = {name: np.array([one.get(name, np.nan) for one in each]) for name in names}
    ships, trials = ({name: column[part] for name, column in table.items()}
                     for part in (slice(count), slice(-count, None)))  # fmt: skip
    ships, trials = carried_on(nominal_figures, {**nominal_figures, **(exact or {})}, ships, trials, near)
    # tracks are those of whole draws: a motion, unlike a figure, is not carried on in a straight line
    full_draws = runs if near == 1 else simulated(tracks, 1.0)
    first = len(full_draws.last) - (count if near == 1 else tracks)  # single trials stand behind the ships
    kept = np.arange(first, len(full_draws.last))[:tracks]
    motions = SimulatedRuns(
        full_draws.t, full_draws.states[:, :, kept], full_draws.inputs[:, :, kept], full_draws.last[kept]
    )
    few = SimulatedRuns(full_draws.t, *(x[..., :SHOWN] for x in (motions.states, motions.inputs, motions.last)))
    shown = tuple(s for s in since_each(few, plan.parameters["order_time"]) if s is not None)
    lost = int(np.isnan(runs.states[-1, 0, :count]).sum())
    widened = bands is not None and bands.held is not None
    return FigureScatter(ships, trials, outside, lost, shown, widened), motions


def carried_on(
    coarse: Mapping[str, float],
    exact: Mapping[str, float],
    ships: Mapping[str, np.ndarray],
    trials: Mapping[str, np.ndarray],
    near: float = 1.0,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Figures (count,) of ``ships`` and of single ``trials`` of them, from those of draws that lie at a share ``near``
    of their distance from the ship; where she herself does not reach a figure, as they are.

    A covariance belongs to the model linearised in its coefficients: in directions that the trials hardly tell, draws
    through the whole model leave what the trials allow, and figures scatter too widely (Immer, Korzepa & Bauer 2021,
    Improving predictions of Bayesian neural nets via local linearization, AISTATS, eq. 10). So the change of a figure
    from that of the ship as she is, ``coarse``, is carried on, in its logarithm where it is positive, and added to her
    ``exact`` one, simulated in fine steps: a fast rudder is over within a step of the draws, and overshoots come out a
    fifth too small. A single trial has besides what it changes of the near ship's figure.
    """
    whole: tuple[dict[str, np.ndarray], dict[str, np.ndarray]] = {}, {}
    for name, column in ships.items():
        once, at, there = trials[name], coarse.get(name, math.nan), exact.get(name, math.nan)
        if not (math.isfinite(at) and math.isfinite(there)):
            whole[0][name], whole[1][name] = column, once
            continue
        with np.errstate(over="ignore"):
            if at > 0 and there > 0 and not (column <= 0).any() and not (once <= 0).any():
                ship = there * (column / at) ** (1 / near)
                each = ship * (once / column)
            else:
                ship = there + (column - at) / near
                each = ship + (once - column)
        whole[0][name], whole[1][name] = ship, each
    return whole


def judged_row(row: Row, run: Run, scatter: FigureScatter) -> Row:
    """The ``row`` of a ``run`` by its draws, ``scatter``: their median is its value, by which it is judged where trials
    support the manoeuvre."""
    factor, outside = {"L": 1 / run.length, "deg": math.degrees(1.0)}.get(row.unit), scatter.outside
    extrapolated = None if outside is None else bool(outside)
    if factor is None:
        return replace(row, extrapolated=extrapolated)
    fields = scatter.of(row.figure, factor, row.limit if row.verdict in (PASS, FAIL) else None)
    if row.value is not None:
        row = with_value(row, fields["median"] if math.isfinite(fields["median"]) else None)
    if row.verdict in (PASS, FAIL) and (why := untried(run.kind, outside or ())):
        row = replace(row, verdict=OPEN, why=why)
    return replace(row, **fields, reached=scatter.share(row.figure), extrapolated=extrapolated)


@dataclass(frozen=True)
class ManeuverScatter:
    """A manoeuvre of many ships drawn about one.

    run: of the ship as it is; drawn: the draws of its figures, ``count`` with this ``seed``; coefficients: symbols that
    were drawn; rows: a row per figure, SI and rad: what ``FigureScatter.of`` gives, with name, unit, value of the ship
    as it is, limit of the criterion, None where there is none, and share of the draws that reach it; without a
    calibration nothing is known of a single trial; motions: of the ship as it is, then of each draw; notices: what to
    know of them.
    """

    run: Run
    drawn: FigureScatter
    count: int
    seed: int
    coefficients: tuple[str, ...]
    rows: tuple[dict[str, Any], ...]
    motions: tuple[Trial, ...]
    notices: tuple[Message, ...]

    def to_dict(self) -> dict[str, Any]:
        """What ``mmg simulate --scatter --json`` prints beside the ship."""
        counts = {"run": self.run.name, "scatter": self.count, "seed": self.seed}
        return {**counts, "coefficients": self.coefficients, "figures": self.rows, "notices": list(self.notices)}

    def tracks(self) -> Any:
        """A DataFrame of all motions: run (0: the ship as it is), t [s], x, y [m], psi [rad], u, v, r, n, delta."""
        import pandas as pd

        parts = {m: trial.to_pandas() for m, trial in enumerate(self.motions)}
        return pd.concat(parts, names=["run"]).reset_index("run").reset_index(drop=True)


def maneuver_scatter(
    ship: Ship, plan: Maneuver, content: Mapping[str, Any], count: int, seed: int = 0, dt: float | None = None
) -> ManeuverScatter:
    """A manoeuvre ``plan`` of ``count`` ships drawn about one, with medians, intervals and criteria of its figures.

    ship: without her instruments, whatever they show; content: of the result.json of her calibration, {} where she has
    none: her coefficients alone are drawn then, but in a stop also its deceleration; seed: of the draws; dt: sampling
    interval [s]. Raises UserError for a count that makes no sense, a manoeuvre that is none of ``JUDGED``, and a ship
    without standard deviations.
    """
    if not 2 <= count <= MOST:
        raise OutOfRange(f"--scatter {count}: give 2 to {MOST} draws")
    if plan.kind not in JUDGED:
        raise Unsupported(f"{plan.name}: --scatter is of {', '.join(JUDGED)}; simulate one ship at a time")
    for name in ship.effects:
        ship = ship.without_effect(name) if EFFECTS[name].measures else ship
    correlation, run = correlation_in(content), planned_run(ship, plan)
    coefficients = draw_coefficients(ship, count, seed, correlation)
    simulator, dt = Simulator(ship), dt or STEP * time_scale(ship.particulars["L"])
    drawn, trials = drawn_figures(simulator, plan, coefficients, content, seed, dt, count, run.figures)
    limits = {  # SI and rad, as the draws
        row.figure: row.limit * (run.length if row.unit == "L" else math.radians(1.0))
        for row in assess(run, ship.particulars.get("scale"))
        if row.limit is not None and row.verdict not in (OPEN, NONE)
    }
    none_known = {} if content else {"interval_90_trial": None}
    rows = tuple(
        {"figure": name, "unit": figure_unit(name), "value": run.figures.get(name), "share": drawn.share(name),
         **drawn.of(name, limit=limits.get(name)), "limit": limits.get(name), **none_known}
        for name in drawn.ship
    )  # fmt: skip
    notices = [INDEPENDENT] * (correlation is None) + drawn.notices(plan.name, plan.kind, count)
    finite = [trials.trial(int(m)) for m in np.flatnonzero(np.isfinite(trials.states).all(axis=(0, 1)))]
    motions = (simulate_batch(simulator, plan, dt=dt).trial(0), *finite)
    return ManeuverScatter(run, drawn, count, seed, tuple(coefficients), rows, motions, tuple(notices))


def accelerations(
    bands: Bands | None,
    ship: Ship,
    plan: Maneuver,
    nominal: SimulatedRuns,
    count: int,
    dt: float,
    seed: int,
    near: float = 1.0,
) -> Push:
    """Accelerations of ``count`` ships, then of as many single trials of them, in the manoeuvre ``plan``.

    bands: of the calibration of the ``ship``; None: no trial is known, so there are no single trials, and a stop alone
    has a lasting part; nominal: the manoeuvre of the ship as she is; dt: sampling interval [s]; seed: of the draws;
    near: share of the lasting part, that of a single trial is whole.
    """
    rng, copies = np.random.default_rng([22, seed]), 1 if bands is None else 2  # 22: a stream of its own
    L, times = ship.particulars["L"], np.maximum(nominal.t, dt)[:, None]
    size, memory = np.zeros((len(nominal.t), 3)), np.ones(3)  # by time; SI
    if bands is not None:
        # along the ship's own track: where a draw's own motion gave the size, what pushes it would feed on itself
        size = np.sqrt(np.einsum("ck,kt->tc", bands.process.size**2, acceleration_sizes(nominal.states, L)[:, :, 0]))
        size *= bands.process.factor_at(times)[:, 3:, 0]
        memory = bands.process.memory
    # speed from which on the trials say the size of a lasting part themselves: few of their points lie below it
    lasting_size, slow = np.zeros_like(size), 0.5 * float(np.abs(nominal.states[0, 3, 0]))
    is_stop = plan.kind in STOPS
    novelty = np.full((len(size), 1), float(is_stop))  # no record of the trials: a stop is taken as new
    if bands is not None and bands.held is not None:
        novelty = bands.held.novelty(nominal.states, input_array(ship, nominal.inputs, nominal.t), L)
        lasting_size = size * novelty
        slow = float(np.quantile(np.hypot(*(bands.held.points * bands.held.scale)[:, :2].T), SLOW))
    share = np.zeros(len(size))  # of the ship's own deceleration, by time
    if is_stop:
        order = plan.parameters["order_time"]
        force = UNTRIED * mean_deceleration(nominal, order)
        lasting_size = np.minimum(lasting_size, [0.0, force, force * LEVER / L])  # ahead the share stands for it
        share = UNTRIED * np.minimum(novelty[:, 0], 1.0) * (nominal.t > order)
    else:
        lasting_size = np.minimum(lasting_size, UNTRIED * greatest_accelerations(nominal))
    before: list[np.ndarray] = []
    lasting = near * np.tile(rng.standard_normal((3, count)), copies)  # the same in both copies: a trial is of a ship
    fade = np.exp(-dt / memory)[:, None]
    passing = np.zeros((3, copies * count))  # 0 for the ships, unit variance for the trials of them
    if copies == 2:
        passing[:, count:] = rng.standard_normal((3, count))

    def push(k: int, states: np.ndarray) -> np.ndarray:
        i = min(k, len(size) - 1)  # some draws take longer to stop than the ship as it is
        # forces of water on a ship vanish with U^2
        fading = np.minimum((states[3] ** 2 + states[4] ** 2) / slow**2, 1.0) if slow > 0 else 1.0
        value = lasting_size[i][:, None] * fading * lasting + size[i][:, None] * passing
        if before:  # what the ship herself lost in the last step
            slowing = np.maximum(before[0] - states[3], 0.0) / dt
            value[0] += np.clip(share[i] * lasting[0], -MOST_SHARE, MOST_SHARE) * slowing
        before[:] = [states[3] + dt * value[0]]  # u of the next step if she lost nothing by herself
        if copies == 2:  # Ornstein-Uhlenbeck, exactly over a step
            fresh = rng.standard_normal((3, count)) * np.sqrt(1 - fade**2)
            passing[:, count:] = fade * passing[:, count:] + fresh
        return np.nan_to_num(value)

    return push


def greatest_accelerations(nominal: SimulatedRuns) -> np.ndarray:
    """Greatest accelerations (3,) by forces ahead or abeam [m/s^2], alike, and in yaw [rad/s^2], in the first of
    ``nominal``."""
    rows = slice(0, max(int(nominal.last[0]) + 1, 2))
    t, (u, v, r) = nominal.t[rows], nominal.states[rows, 3:, 0].T
    du, dv, dr = (np.gradient(x, t) for x in (u, v, r))
    force = float(np.hypot(du - v * r, dv + u * r).max())  # acceleration of midship in body axes
    return np.array([force, force, float(np.abs(dr).max())])


def mean_deceleration(nominal: SimulatedRuns, begin: float) -> float:
    """Mean deceleration [m/s^2] of a stop ordered at ``begin`` [s], to the end of the first of ``nominal`` or rest."""
    u = nominal.states[:, 3, 0]
    first = int(np.searchsorted(nominal.t, begin))
    rest = np.flatnonzero(u <= 0)
    last = min(max(int(rest[0]) if len(rest) else int(nominal.last[0]), first + 1), len(u) - 1)
    return float((u[min(first, last)] - max(u[last], 0.0)) / max(nominal.t[last] - nominal.t[first], 1e-9))


def drawn_resistance(
    ship: Ship, plan: Maneuver, drawn: dict[str, np.ndarray], count: int, seed: int
) -> dict[str, np.ndarray]:
    """Coefficients ``drawn``, symbol -> (count,), with the doubt about a ship's resistance in a stop, ``plan``.

    The factors of the plan (``stopping_resistance`` of the ``ship``) are estimates: each draw has its own. seed: of
    them.
    """
    if not plan.factors:
        return drawn
    draw = np.exp(RESISTANCE * np.random.default_rng([32, seed]).standard_normal(count))  # 32: a stream of its own
    values = ship.coefficients
    return drawn | {symbol: drawn.get(symbol, np.full(count, values[symbol].value)) * draw for symbol in plan.factors}
