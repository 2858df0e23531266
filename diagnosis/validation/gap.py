"""The gap between a ship's model and trials, by all that may close it: white, learned and named, on the same trials.

Each model predicts windows of trials that took no part, from their measured first rows. Its error is the mean of
squared errors of the six states, each divided by what that state changes by over a window (as the share of change of
``mmg score``). Of the calibrated model's error a part cannot be avoided, the floor of a diagnosis' budget; what lies
above it a model closes to some share. Intervals come from drawing the runs again (block bootstrap).

What a network has learned is itself a witness: where a named effect is what was missing, the accelerations that the
network adds are those of the effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cases.trial import Trial
from diagnosis.findings import Budget
from diagnosis.validation.held_out import DRAWS, MOST, WindowErrors, redrawn_means
from fitting.nlp.windows import default_step, pieces_of
from fitting.prediction.bands import NORMAL
from fitting.prediction.predict import change_over, predict_all
from fitting.report.run_folder import SCHEMA_VERSION, Real, plain
from mmg.errors import TooFewData
from mmg.messages import Message, html_table, message_rows
from mmg.rollout import Simulator
from mmg.ship import Ship

# Lines of the comparison.
GIVEN = "as given"  # The ship as she came
REFITTED = "refitted"  # Calibrated on the training trials
LEARNED = "hybrid"  # With a learned residual
NAMED = "named effects"  # With the effects that a diagnosis names
BOTH = "named + hybrid"  # With a residual learned beside these
FLOOR = "floor"  # What a complete model would leave
CHANNELS = {"surge": "m/s²", "sway": "m/s²", "yaw": "rad/s²"}  # Accelerations that a network adds, and their units
BINS = 12  # Of a feature, over which accelerations are averaged. Set by hand: display.
FEWEST = 20  # Rows of a bin that is shown. Set by hand: display.


@dataclass(frozen=True)
class GapRow:
    """A model on the test trials.

    name: one of the lines above; error: mean squared error by what the states change by; position_m, heading_deg: root
    mean square errors at the ends of windows, None of a floor that is not known; each with its 90 % interval; closes:
    share of the avoidable error of the refitted ship, with its interval, None where none is; ship: folder of the ship,
    "" without one; kept: whether a learned residual was kept by its own runs, None of other lines.
    """

    name: str
    error: Real
    error_90: tuple[Real, Real]
    position_m: Real
    position_90: tuple[Real, Real]
    heading_deg: Real
    heading_90: tuple[Real, Real]
    closes: Real | None = None
    closes_90: tuple[Real, Real] | None = None
    ship: str = ""
    kept: bool | None = None


@dataclass(frozen=True)
class Witness:
    """What a named effect explains of the accelerations that a network has learned, over the training rows.

    share: squared correlation of both by channel; slope: of the learned on the effect's accelerations.
    """

    effect: str
    share: Mapping[str, Real]
    slope: Mapping[str, Real]


@dataclass(frozen=True)
class LearnedChannel:
    """Learned accelerations of a channel over the feature that they follow most: means of bins of it, with those of the
    named effects together. rms: over all rows; unit: of all; explained: share of the variance that the bins explain."""

    feature: str
    rms: Real
    unit: str
    explained: Real
    at: tuple[Real, ...]
    learned: tuple[Real, ...]
    named: tuple[Real, ...]


@dataclass(frozen=True)
class Gap:
    """The comparison. seconds: length of the windows; windows, runs: how many were predicted; effects: named ones, with
    the verdict; witness: by effect; learned: by channel; about: what it was made from, as plain values."""

    sentence: str
    rows: tuple[GapRow, ...]
    seconds: Real
    windows: int
    runs: int
    verdict: str
    effects: tuple[str, ...] = ()
    witness: tuple[Witness, ...] = ()
    learned: Mapping[str, LearnedChannel] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Header and lines in words; "|n" after a title: of numbers."""
        after = f"after {self.seconds:.3g} s"
        header = ("model", f"position {after} [m]|n", "heading [deg]|n", "error|n", "closes|n")
        return header, [_words(row) for row in self.rows]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``gap.json``."""
        content = {name: value for name, value in vars(self).items() if name != "warnings"}
        words = {"warnings": [str(m) for m in self.warnings], "messages": message_rows(self.warnings)}
        return plain({"schema_version": SCHEMA_VERSION, "kind": "gap", **content, **words})

    def to_pandas(self) -> Any:
        """A DataFrame with a line per model."""
        import pandas as pd

        return pd.DataFrame([vars(row) for row in self.rows]).set_index("name")

    def __repr__(self) -> str:
        return f"<Gap: {', '.join(row.name for row in self.rows)}; {self.sentence}>"

    def _repr_html_(self) -> str:
        header, lines = self.table
        return html_table(self.sentence, [title.removesuffix("|n") for title in header], lines)


def _words(row: GapRow) -> tuple[str, ...]:
    def interval(value: float, ends: tuple[float, float]) -> str:
        return f"{value:.3g} [{ends[0]:.3g}, {ends[1]:.3g}]"

    closes = "" if row.closes is None else _percent(row.closes, row.closes_90)
    name = row.name + (" (declined)" if row.kept is False else "")
    position = interval(row.position_m, row.position_90) if row.position_90[1] > 0 else "–"  # not measured
    return name, position, interval(row.heading_deg, row.heading_90), interval(row.error, row.error_90), closes


def _percent(share: float, ends: tuple[float, float] | None) -> str:
    return f"{100 * share:.0f} %" + (f" [{100 * ends[0]:.0f}, {100 * ends[1]:.0f}]" if ends else "")


def held_out_errors(ship: Ship, trials: Sequence[Trial], seconds: float, change: np.ndarray) -> WindowErrors:
    """Errors of a ``ship`` on windows of ``seconds``, each half over the one before, of ``trials``; states that a trial
    never measures do not count.

    change: (6,) by which errors of the states are divided (``change_over``). Raises UserError where no window fits.
    """
    mean, end, run = [], [], []
    predictions = predict_all(Simulator(ship), trials, seconds, 0.5 * seconds, False)
    for number, (trial, (windows, _)) in enumerate(zip(trials, predictions, strict=True)):
        measured = np.isfinite(trial.states).any(axis=0)  # (6,): positions may not be logged at all
        for w in windows:
            known = np.isfinite(trial.states[w.first + 1 : w.last + 1, measured]).all(axis=1)
            if not known.any():
                continue
            square = (w.error(trial.states)[1:][known] / change) ** 2
            square = np.where(measured, np.nan_to_num(square, nan=MOST, posinf=MOST).clip(max=MOST), 0.0)
            last = square[-1, :3] * np.where(np.isfinite(change[:3]), change[:3], 0.0) ** 2
            mean.append(square.sum() / (len(square) * measured.sum()))
            end.append((last[0] + last[1], last[2]))
            run.append(number)
    if not mean:
        raise TooFewData(f"no test trial holds {seconds:.0f} s without a gap, so that nothing can be predicted")
    return WindowErrors(np.array(mean), np.array(end), np.array(run))


def compared(
    ships: Mapping[str, Ship], trials: Sequence[Trial], seconds: float, budget: Budget | None, seed: int = 0
) -> tuple[list[GapRow], np.ndarray]:
    """A line for each of the ``ships``, by its name, and the floor where it is known.

    trials: that took no part; seconds: of their windows; budget: of the diagnosis of the same trials, whose floor is
    taken as a share of the error of the ship with the named effects, the refitted one without any; seed: of the draws.
    Returns the lines and the number of the trial of each window (W,). Raises UserError where no window fits.
    """
    change = change_over(trials, seconds, 0.5 * seconds)
    errors = {name: held_out_errors(ship, trials, seconds, change) for name, ship in ships.items()}
    run = next(iter(errors.values())).run
    columns = [column for e in errors.values() for column in (e.mean, *e.end.T)]
    rng = np.random.default_rng(seed)
    every = np.split(redrawn_means(columns, run, rng), len(errors), axis=1)  # of each (DRAWS, 3)
    means = {name: np.array([e.mean.mean(), *e.end.mean(axis=0)]) for name, e in errors.items()}
    draws, is_avoidable = dict(zip(errors, every, strict=True)), False
    if budget is not None:
        base = NAMED if NAMED in ships else REFITTED
        left = budget.floor / budget.after if budget.after > 0 else 1.0
        share = np.array([left, *((u[2] / u[1]) ** 2 if u[1] > 0 else 1.0 for u in budget.units.values())])
        std = (budget.floor_by_after[1] - budget.floor_by_after[0]) / (2 * NORMAL)
        # how well the floor is known: its share of the error, drawn normally, moves all three alike
        moved = np.clip(left + std * rng.standard_normal(DRAWS), 0.0, 1.0) / max(left, 1e-300)
        floor = share * moved[:, None] * draws[base]
        # by the floor itself: a model that happened to lie below it shows nothing that could be avoided
        is_avoidable = bool((draws[REFITTED][:, 0] > floor[:, 0]).mean() >= 0.95)
        # no model that was measured can lie below what no model can reach
        means[FLOOR] = np.min([share * means[base], *means.values()], axis=0)
        draws[FLOOR] = np.min([floor, *draws.values()], axis=0)
    return [_row(name, means, draws, is_avoidable) for name in means], run


def _row(name: str, means: Mapping[str, np.ndarray], draws: Mapping[str, np.ndarray], is_avoidable: bool) -> GapRow:
    """The line of a model. means, draws: error, squared position and heading, (3,) and (DRAWS, 3), by name;
    is_avoidable: whether surely some of the refitted ship's error could be avoided."""
    low, high = np.quantile(draws[name], [0.05, 0.95], axis=0)
    turn = math.degrees(1.0)
    row = GapRow(
        name,
        float(means[name][0]), (float(low[0]), float(high[0])),
        math.sqrt(means[name][1]), (math.sqrt(low[1]), math.sqrt(high[1])),
        turn * math.sqrt(means[name][2]), (turn * math.sqrt(low[2]), turn * math.sqrt(high[2])),
    )  # fmt: skip
    if name in (GIVEN, REFITTED, FLOOR) or not is_avoidable:
        return row
    gap, gaps = means[REFITTED][0] - means[FLOOR][0], draws[REFITTED][:, 0] - draws[FLOOR][:, 0]
    if not gap > 0:  # nan too
        return row
    closed = (draws[REFITTED][:, 0] - draws[name][:, 0])[gaps > 0] / gaps[gaps > 0]
    least, most = np.quantile(closed, [0.05, 0.95]).tolist()
    return replace(row, closes=float((means[REFITTED][0] - means[name][0]) / gap), closes_90=(least, most))


def sentence_of(rows: Sequence[GapRow], effects: Sequence[str], verdict: str, seconds: float) -> str:
    """The models in ``rows`` over windows of ``seconds`` compared in words; effects, verdict: of the diagnosis."""
    by_name = {row.name: row for row in rows}
    refitted, floor = by_name[REFITTED], by_name.get(FLOOR)
    errors = [
        (f"{row.position_m:.3g} m and " if refitted.position_m > 0 else "") + f"{row.heading_deg:.3g}°"
        for row in (refitted, floor)
        if row is not None
    ]
    size = f"The calibrated model errs by {errors[0]} after {seconds:.3g} s"
    if floor is not None:
        size += f", of which {errors[1]} cannot be avoided"
    unnamed = {"none": "No effect is named.", "unknown": "The cause has no name in the library."}.get(verdict, "")
    names = {LEARNED: "the network", NAMED: f"naming {' and '.join(effects)}", BOTH: "both"}
    closing = []
    for name, words in names.items():
        row = by_name.get(name)
        if row is not None and row.closes is not None:
            declined = " (declined by its own runs)" if row.kept is False else ""
            closing.append((f"{words}{declined}", _percent(row.closes, row.closes_90)))
    if not closing:
        why = "the floor is not known" if floor is None else "the error lies no more above the floor than by chance"
        return " ".join(filter(None, (f"{size}.", f"Nothing can be shared out: {why}.", unnamed)))
    (first, share), *others = closing
    told = ", ".join([f"{first} closes {share} of the avoidable error", *(" ".join(pair) for pair in others)])
    return " ".join(filter(None, (f"{told[0].upper()}{told[1:]}.", unnamed, f"{size}.")))


def witnessed(
    hybrid: Ship, named: Ship, effects: Sequence[str], trials: Sequence[Trial]
) -> tuple[tuple[Witness, ...], dict[str, LearnedChannel]]:
    """What the ``effects`` of the ``named`` ship explain of the accelerations that the network of the ``hybrid`` adds,
    at the measured rows of ``trials``: by effect, and by channel over the feature that these follow most."""
    step = default_step(trials, hybrid.particulars["L"])
    every = tuple(dict.fromkeys((*hybrid.inputs, *named.inputs)))
    rows = [(p.logged[:-1], p.controls) for p in pieces_of(trials, step, every)]
    logged, controls = (np.vstack(parts) for parts in zip(*rows, strict=True))
    good = np.isfinite(logged[:, 2:]).all(axis=1) & np.isfinite(controls).all(axis=1)
    logged, controls = np.nan_to_num(logged[good]), controls[good]

    def accelerations(ship: Ship) -> np.ndarray:
        inputs = [every.index(name) for name in ship.inputs]
        simulator = Simulator(ship)
        z = simulator.start(logged.T, controls[:, inputs].T)
        return np.asarray(simulator.rates(z, controls[:, inputs].T)[3:6])

    learned = accelerations(hybrid) - accelerations(hybrid.without_network())
    whole, bare = accelerations(named), named
    witnesses = []
    for effect in effects:
        own = whole - accelerations(named.without_effect(effect))
        bare = bare.without_effect(effect)
        pairs = {name: _related(own[k], learned[k]) for k, name in enumerate(CHANNELS)}
        witnesses.append(
            Witness(effect, {n: pair[0] for n, pair in pairs.items()}, {n: pair[1] for n, pair in pairs.items()})
        )
    together = whole - accelerations(bare) if effects else np.zeros_like(learned)
    features = _features(hybrid, logged, controls[:, [every.index(name) for name in hybrid.inputs]])
    channels = {name: _over(features, learned[k], together[k], unit) for k, (name, unit) in enumerate(CHANNELS.items())}
    return tuple(witnesses), channels


def _related(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Squared correlation of y with x, and the slope; 0 where x does not change."""
    x, y = x - x.mean(), y - y.mean()
    if not (x @ x > 0 and y @ y > 0):
        return 0.0, 0.0
    return float((x @ y) ** 2 / (x @ x) / (y @ y)), float(x @ y / (x @ x))


def _features(ship: Ship, logged: np.ndarray, controls: np.ndarray) -> dict[str, np.ndarray]:
    """What the network of a ``ship`` sees at logged rows (N, 6) under inputs (N, C), by name."""
    simulator = Simulator(ship)
    seen = simulator.model.features(simulator.start(logged.T, controls.T), controls.T, ship.values)
    return dict(zip(ship.features, np.asarray(seen), strict=True))


def _over(features: Mapping[str, np.ndarray], learned: np.ndarray, named: np.ndarray, unit: str) -> LearnedChannel:
    """The ``learned`` accelerations (N,) of a channel over the feature of which bins explain most, beside those of the
    ``named`` effects (N,)."""
    best: tuple[float, str, np.ndarray] = (-1.0, "", np.zeros(0, dtype=int))
    variance = max(float(learned.var()), 1e-300)
    for name, values in features.items():
        edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
        if len(edges) < 3:
            continue
        bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        means = np.array([learned[bins == b].mean() if (bins == b).any() else 0.0 for b in range(len(edges) - 1)])
        explained = 1 - float(((learned - means[bins]) ** 2).mean()) / variance
        if explained > best[0]:
            best = explained, name, bins
    explained, name, bins = best
    shown = [b for b in np.unique(bins) if (bins == b).sum() >= FEWEST]
    columns = (features[name], learned, named) if name else (learned[:0],) * 3
    at, mine, theirs = (tuple(float(c[bins == b].mean()) for b in shown) for c in columns)
    return LearnedChannel(name, float(np.sqrt((learned**2).mean())), unit, max(explained, 0.0), at, mine, theirs)
