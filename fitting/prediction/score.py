"""The two metrics: Wakita et al. (2022) Eq. 25 with restarts every 100 s, and 30 s windows every 15 s.

Both divide errors by the sigma of the states, that of a heading as stored. Beside them stand errors in units
(``unit_errors``), by which models are judged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

import numpy as np
from pydantic import GetPydanticSchema
from pydantic_core.core_schema import no_info_plain_validator_function

from cases.inputs import assumed
from cases.trial import Trial, inside, spans_left_out
from fitting.prediction.predict import Forecaster, ShipsByTrial, Window, change_over, planned_windows, predict_all
from fitting.prediction.stretches import default_past, record_of
from fitting.prediction.unit_errors import REFERENCES, STATE_ERRORS, RunErrors, UnitErrors, errors_in_units, is_worse
from fitting.report.run_folder import Real
from mmg.errors import Missing, TooFewData, UserError
from mmg.messages import Message, html_table, listed
from mmg.motion.flow import INPUTS, STATES
from mmg.rollout import Simulator

MOST_NAMED = 5  # Of trials in one message. Set by hand: display.
PAPER_WINDOW = 100.0  # Length of the restarts [s] of Wakita et al. (2022), Eq. 25.
# Length of the shorter windows [s] and the time between their starts: less of a run is one drift. Set by hand.
WINDOW, STRIDE = 30.0, 15.0
# A mean squared error of 30 s windows, summed over six states in units of their variance, above which a calibrated ship
# does not follow the trials; real ships of good trials have 0.1. Set by hand above them.
UNDESCRIBED = 0.5
# Most of the error of 30 s windows, and of 100 s restarts, that may remain for the past to be used. Set by hand.
GAIN, HARM = 0.99, 1.01
HYBRID = "hybrid"  # What a training that is no black box calls its model
SETS = {"validation": "validation trials", "left out": "trials left out of the calibration in turn"}


def _by_state(row: Mapping[str, float | None] | np.ndarray) -> np.ndarray:
    """Numbers of the six states (6,), null in a file for NaN."""
    return row if isinstance(row, np.ndarray) else np.array([row[state] for state in STATES], dtype=float)


def _stored(value: float, count: int) -> float:
    """A number of ``count`` windows as it was before it was stored: a file holds null for NaN, and for inf where there
    was something to score."""
    return math.inf if count and math.isnan(value) else value


@dataclass(frozen=True)
class TrialScore:
    """Both metrics of one trial (dimensionless), each also by state: NaN where there is nothing to score,
    inf where a prediction diverges. windows, restarts: how many were predicted, of 30 s and of 100 s."""

    name: str
    paper: Real
    paper_by_state: dict[str, Real]
    window: Real
    window_by_state: dict[str, Real]
    windows: int
    restarts: int = 0

    def __post_init__(self) -> None:
        for kind, count in (("paper", self.restarts), ("window", self.windows)):
            by_state = getattr(self, f"{kind}_by_state")
            object.__setattr__(self, kind, _stored(getattr(self, kind), count))  # frozen: not by assignment
            object.__setattr__(self, f"{kind}_by_state", {s: _stored(value, count) for s, value in by_state.items()})


@dataclass(frozen=True)
class Score:
    """Scores of a set of trials with the sigma they were divided by.

    paper, window: pooled over all rows of all trials, NaN and inf as of a trial; sigma: (6,) with ``sigma_from`` saying
    where it is from; units: errors in units, None where they were not asked for; past_s: seconds before each window
    that the predictions used.
    """

    trials: tuple[TrialScore, ...]
    paper: Real
    window: Real
    sigma: Annotated[np.ndarray, GetPydanticSchema(lambda *_: no_info_plain_validator_function(_by_state))]
    sigma_from: str
    notes: tuple[str, ...] = field(default=())
    units: UnitErrors | None = None
    past_s: float = 0.0

    @property
    def diverged(self) -> tuple[str, ...]:
        """Names of the trials of which windows were predicted without a finite error."""
        return tuple(t.name for t in self.trials if np.isinf([t.paper, t.window]).any())

    def __post_init__(self) -> None:
        object.__setattr__(self, "paper", _stored(self.paper, sum(t.restarts for t in self.trials)))
        object.__setattr__(self, "window", _stored(self.window, sum(t.windows for t in self.trials)))

    def to_dict(self) -> dict[str, Any]:
        """Both metrics as plain values, per trial and pooled, with their sigma."""
        return asdict(self) | {"sigma": dict(zip(STATES, self.sigma.tolist(), strict=True)), "notes": list(self.notes)}

    def __repr__(self) -> str:
        pooled = self.units.pooled if self.units else None
        size = f"position {pooled.position_m:.3g} m, heading {pooled.heading_deg:.3g} deg; " if pooled else ""
        normalised = f"normalised: 30 s {self.window:.4g}, 100 s {self.paper:.4g}"
        return f"<Score of {len(self.trials)} trials: {size}{normalised}>"

    def to_pandas(self) -> Any:
        """A DataFrame with a row per trial: errors in units where they are known, both metrics, the number of windows,
        the 30 s metric by state."""
        import pandas as pd

        units = [_units_of(run) for run in self.units.runs] if self.units else [{} for _ in self.trials]
        rows = [
            {**errors, "paper": t.paper, "window": t.window, "windows": t.windows}
            | {f"window_{s}": value for s, value in t.window_by_state.items()}
            for t, errors in zip(self.trials, units, strict=True)
        ]
        return pd.DataFrame(rows, index=pd.Index([t.name for t in self.trials], name="trial"))

    def _repr_html_(self) -> str:
        rows = [(t.name, t.window, t.paper, t.windows) for t in self.trials]
        header = ("trial", "30 s windows", "100 s restarts", "windows")
        every = [*rows, ("all rows", self.window, self.paper, None)]
        normalised = html_table("Mean squared normalised error (Eq. 25)", header, every)
        if self.units is None:
            return normalised
        by_run = [(run.name, *_units_of(run).values()) for run in (*self.units.runs, self.units.pooled)]
        for name, errors in self.units.references.items():
            by_run.append((REFERENCES[name], *_units_of(errors.pooled).values()))
        title = f"rms errors over {self.units.window_s:g} s windows"
        return html_table(title, ("trial", *STATE_ERRORS), by_run) + normalised


def _units_of(run: RunErrors) -> dict[str, float]:
    """Errors of a ``run`` by key of STATE_ERRORS."""
    return {key: getattr(run, key) for key in STATE_ERRORS}


NOTHING = "nothing to score"  # Of a run without a window, in words
# Codes of the messages on a score that is no number as the prediction diverges, and on trials without a window.
NO_SCORE, NOTHING_SCORED = "no_score", "nothing_scored"


def scores_by_set(model: Simulator | Forecaster, sets: Mapping[str, Sequence[Trial]]) -> dict[str, Score]:
    """Scores of ``model`` on each of ``sets`` (name -> trials) that has trials with positions.

    Trials without positions are left out, and so is a set in which one state never changes, as it gives no sigma, and
    one in which no whole window of 30 s is measured.
    """
    scores = {}
    for name, trials in sets.items():
        located = [t for t in trials if t.has_position]
        try:
            sigma = pooled_sigma(located)
        except UserError:  # of this alone: what a score finds missing in trials is the user's to know
            continue
        scored = score(model, located, sigma, f"the {name} trials", units=0.0)
        if any(t.windows for t in scored.trials):
            scores[name] = scored
    return scores


def _mean(total: np.ndarray, rows: float) -> np.ndarray:
    """Mean of squares (...) whose ``total`` is of so many ``rows``: NaN of none, inf of predictions that diverge."""
    return np.where(np.isfinite(total), total, np.inf) / rows if rows else np.full(np.shape(total), np.nan)


def pooled_sigma(trials: Sequence[Trial]) -> np.ndarray:
    """Standard deviation of each state over all rows of all ``trials``, heading as stored, shape (6,). Raises UserError
    for trials without positions, and where a state never changes."""
    located = [t for t in trials if t.has_position]
    rows = [np.column_stack([t[c] for c in STATES])[record_of(t, [n for n in INPUTS if n in t]).good] for t in located]
    if not rows:
        raise Missing("sigma cannot be taken from trials without positions x and y; give it with --sigma")
    if not any(map(len, rows)):
        names = ", ".join(t.name for t in located[:MOST_NAMED])
        raise TooFewData(f"{names}: no row has all six states and the inputs, nothing to score; see mmg check")
    sigma = np.vstack(rows).std(axis=0)
    if not (sigma > 0).all():
        flat = ", ".join(s for s, value in zip(STATES, sigma, strict=True) if not value > 0)
        raise TooFewData(f"sigma of {flat} is zero in these trials; give sigma with --sigma or --sigma-from")
    return sigma


def check_scorable(trials: Sequence[Trial], purpose: str, inputs: Sequence[str]) -> None:
    """Raises UserError unless a whole 30 s window of one of ``trials`` can be scored. purpose: what they are for, in
    words; inputs: of the models, as of ``Ship.inputs``."""
    if not any(planned_windows(trial, inputs, WINDOW, STRIDE, False)[0] for trial in trials):
        names = ", ".join(trial.name for trial in trials[:MOST_NAMED])
        raise TooFewData(f"{names}: no whole window of {WINDOW:g} s without missing samples in the trials {purpose}")


def _squares(trial: Trial, windows: Sequence[Window], whole: bool) -> tuple[np.ndarray, int]:
    """Sum of squared errors by state (6,) and number of rows counted.

    ``whole`` (restarts): a window's first row counts with error 0; the row shared with the next window counts there.
    Otherwise the first row of each window is left out.
    """
    measured, total, rows = trial.states, np.zeros(6), 0
    for w in windows:
        error, finite = w.error(measured), np.isfinite(measured[w.first : w.last + 1]).all(axis=1)
        counted = slice(1, None) if not whole else slice(None, -1 if w.last < len(trial) - 1 else None)
        error = error[counted][finite[counted]]  # rows of a broken stretch do not count; a prediction that is NaN does
        total += (error**2).sum(axis=0)
        rows += len(error)
    return total, rows


@np.errstate(all="ignore")
def score(
    simulator: Simulator | Forecaster,
    trials: Sequence[Trial],
    sigma: np.ndarray | None = None,
    sigma_from: str = "the scored trials",
    method: str = "rk4",
    adapt: float | None = None,
    units: float | None = None,
    baseline: Forecaster | None = None,
) -> Score:
    """Both metrics of a ship or a black box, ``simulator``, on ``trials``.

    sigma: (6,) by which errors are divided, by default the pooled one of these trials; sigma_from: what is said of its
    source; method: "rk4" or "euler"; adapt: seconds before each window from which the run's disturbance is estimated,
    of a ship only; units: add errors in units over windows of so many seconds, 0: as long as suits the ship; baseline:
    what the model must beat there. Raises UserError when a trial has no positions, or sigma cannot be pooled.
    """
    for trial in trials:
        if not trial.has_position:
            raise Missing(f"{trial.name}: no position columns x [m], y [m]; both metrics need all six states")
    sigma = pooled_sigma(trials) if sigma is None else np.asarray(sigma, dtype=float)
    past = (adapt or 0.0) if isinstance(simulator, Simulator) else 0.0
    paper = predict_all(simulator, trials, PAPER_WINDOW, PAPER_WINDOW, True, method, past=past)
    short = predict_all(simulator, trials, WINDOW, STRIDE, False, method, past=past)
    rows, notes = [], assumed(trials, simulator.inputs)
    pooled = np.zeros((2, 2))  # restarts and windows: sum of squares, number of rows
    for trial, (restarts, remarks), (windows, more) in zip(trials, paper, short, strict=True):
        notes += remarks + more
        means = []
        for j, predicted in enumerate((restarts, windows)):
            squares, count = _squares(trial, predicted, whole=predicted is restarts)
            squares = squares / sigma**2  # Wakita et al. (2022), Eq. 25: a sum over the states, a mean over the rows
            pooled[j] += squares.sum(), count
            means.append(_mean(squares, count))
        totals = [float(mean.sum()) for mean in means]
        by_state = [dict(zip(STATES, mean.tolist(), strict=True)) for mean in means]
        rows.append(TrialScore(trial.name, totals[0], by_state[0], totals[1], by_state[1], len(windows), len(restarts)))
    paper_all, window_all = (float(_mean(total, count)) for total, count in pooled)
    for size, each in ((PAPER_WINDOW, [r.restarts for r in rows]), (WINDOW, [r.windows for r in rows])):
        if names := ", ".join(row.name for row, count in zip(rows, each, strict=True) if not count):
            notes.append(Message(f"{names}: nothing to score over {size:g} s", NOTHING_SCORED))
    errors = None if units is None else errors_in_units(simulator, trials, units or None, method, past, baseline)
    return Score(tuple(rows), paper_all, window_all, sigma, sigma_from, tuple(dict.fromkeys(notes)), errors, past)


def in_words(error: float | None) -> str:
    """An ``error`` with four digits behind the point, NOTHING of NaN, "diverges" where the prediction gave none."""
    if error is None or np.isinf(error):
        return "diverges"
    return NOTHING if np.isnan(error) else f"{error:.4f}"


@dataclass(frozen=True)
class ScorePair:
    """Scores of the same trials, predicted by a model before and after it was changed."""

    before: Score
    after: Score

    @property
    def worse_runs(self) -> tuple[str, ...]:
        """Runs that became worse as a share of what the states change by, with their errors in units, in words."""
        if not (self.before.units and self.after.units):
            return ()
        pairs = zip(self.before.units.runs, self.after.units.runs, strict=True)
        return tuple(
            f"{after.name} (position {before.position_m:.3g} -> {after.position_m:.3g} m, "
            f"heading {before.heading_deg:.3g} -> {after.heading_deg:.3g} deg)"
            for before, after in pairs
            if is_worse(before.share_of_change, after.share_of_change)
        )

    def messages(self, name: str) -> list[Message]:
        """What speaks against the model after the change, with one of the codes of GRAVEST.

        name: of the set of trials, such as "validation".
        """
        found, old, new = list[Message](), self.before.units, self.after.units
        if lost := self.after.diverged:
            words = f"no score of the {name} trials: the prediction diverges on {listed(lost, MOST_NAMED)}"
            found.append(Message(words, NO_SCORE))
        elif old and new:
            worse = []
            for key, (state, unit) in STATE_ERRORS.items():
                before, after = getattr(old.pooled, key), getattr(new.pooled, key)
                worse += [f"{state} {before:.3g} -> {after:.3g} {unit}"] if is_worse(before, after) else []
            words = f"rms errors of the {name} trials over {new.window_s:g} s windows became worse: {', '.join(worse)}"
            found += [Message(words, "worse_after")] if worse else []
        if runs := self.worse_runs:
            words = f"worse than before on {len(runs)} of {len(self.after.trials)} {name} runs: {'; '.join(runs)}"
            found.append(Message(words, "worse_runs"))
        defeats = new.defeats(by_run=False) if new else []
        found += [Message(f"the {name} trials: {words}", "worse_than_persistence") for words in defeats]
        # of the trials that she was calibrated on; that the prediction diverges is said
        if name == "training" and UNDESCRIBED < self.after.window < math.inf:
            share = (self.after.window / len(STATES)) ** 0.5  # the metric sums six squares: rms over states and rows
            words = (
                f"30 s predictions of the trials err by {share:.0%} of what the states vary by (rms): this ship does "
                "not follow them; see that they are hers and in her size, and what mmg check says of them"
            )
            found.append(Message(words, "not_described"))
        return found


# Codes of ``ScorePair.messages``, in the order in which they are said.
GRAVEST = (NO_SCORE, "worse_after", "worse_runs", "worse_than_persistence", "not_described")


def score_messages(pairs: Mapping[str, ScorePair]) -> list[Message]:
    """The messages of all ``pairs``, by set of trials, the gravest first."""
    found = [message for name, pair in pairs.items() for message in pair.messages(name)]
    return sorted(found, key=lambda message: GRAVEST.index(message.code))


NO_SCORES: Mapping[str, ScorePair] = {}  # Scores of no set of trials


def score_pairs(before: Mapping[str, Score], after: Mapping[str, Score]) -> dict[str, ScorePair]:
    """Scores ``before`` and ``after`` a change of the model, as of ``scores_by_set``, by set of trials."""
    return {name: ScorePair(before[name], found) for name, found in after.items() if name in before}


def adaptation_worth(
    simulator: Simulator, held_out: Sequence[Trial], without: np.ndarray | None = None
) -> dict[str, Any] | None:
    """Both metrics on ``held_out`` trials without and with the past of each window, as plain values: errors divided by
    what the states change by over 30 s.

    simulator: of the calibrated ship; without: (R, P) coefficients by which each trial is predicted where they are
    those of the calibration, each without its trial. Adapting is worthwhile when 30 s windows become better and 100 s
    restarts no worse. None where none of the trials can be scored.
    """
    kept = [i for i, t in enumerate(held_out) if t.has_position]
    located = [held_out[i] for i in kept]
    if without is not None:  # NaN: the fit without that trial was not made
        values = np.where(np.isfinite(without).all(axis=1)[:, None], without, simulator.ship.values)
        simulator = ShipsByTrial(simulator.ship, values[kept], simulator.compiled)
    # sigma of a heading that goes round grows with every turn, the change over a window does not
    past, unit = default_past(simulator.ship), change_over(located, WINDOW, STRIDE)
    bare, adapted = (score(simulator, located, unit, adapt=seconds) for seconds in (None, past))
    if math.isnan(bare.window):
        return None
    good = adapted.window < GAIN * bare.window and not adapted.paper > HARM * bare.paper
    return {
        "past_s": past,
        "trials": "validation" if without is None else "left out",
        "files": len(located),
        "without": {"window": bare.window, "paper": bare.paper},
        "with": {"window": adapted.window, "paper": adapted.paper},
        "worthwhile": bool(good),
    }


def past_to_use(result: Mapping[str, Any], wanted: float | None) -> tuple[float, list[Message]]:
    """Seconds of past that a prediction uses, 0: none, and what is said of it.

    result: content of the run's result.json, empty for a bare ship, or of a black box, which knows no past; wanted:
    seconds that the caller names, None: what the result says pays.
    """
    worth: Any = result.get("adaptation")
    if wanted == 0 or (wanted is None and (not result or result.get("model", HYBRID) != HYBRID)):
        return 0.0, []
    try:
        pays, default = bool(worth["worthwhile"]), float(worth["past_s"])
        changes = [worth["with"][metric] / worth["without"][metric] - 1 for metric in ("window", "paper")]
        evidence = (
            f"on the {SETS.get(worth['trials'], worth['trials'])} mean squared errors of 30 s windows "
            f"change by {changes[0]:+.0%}, of 100 s restarts by {changes[1]:+.0%}"
        )
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        words = "whether the past of a window pays with this model is not known: calibrate it with mmg fit to find out"
        words += "" if wanted else "; it is not used, --adapt 30 uses it"
        return wanted or 0.0, [Message(words, "adaptation_untested")]
    if wanted is not None:
        words = f"adapting did not pay: {evidence}; better leave it off"
        return wanted, [] if pays else [Message(words, "adaptation_does_not_pay")]
    if not pays:
        return 0.0, [Message(f"the past of a window is not used: {evidence}", "adaptation_off")]
    words = f"up to {default:g} s before each window are used, as that pays: {evidence}; --adapt 0 does not"
    return default, [Message(words, "adaptation_on")]


JUDGED = {"validation": "held-out trials", "training": "training trials"}


def worth_of_left_out(
    after: Simulator, sets: Mapping[str, Sequence[Trial]], scores: Mapping[str, ScorePair]
) -> dict[str, Any] | None:
    """Content of "left_out" in result.json; None where nothing was left out.

    after: the calibrated ship; sets: trials by name, "training" and "validation"; scores: of them, without what was
    left out. Returns seconds and trials that are concerned, and both metrics with and without.
    """
    concerned = {}
    for trial in (t for some in sets.values() for t in some if t.whole is not None):
        spans = spans_left_out(trial)
        why = "; ".join(str(note) for note in trial.notices if getattr(note, "code", "") == "left_out")
        seconds = float(inside(trial, spans).sum()) * trial.dt
        concerned[trial.name] = {"seconds": seconds, "spans": [list(span) for span in spans], "why": why}
    if not concerned:
        return None
    errors = {}
    for name, pair in scores.items():
        if any(t.whole is not None for t in sets[name]):  # scored again as they came, by the same sigma
            kept = score(after, [t.whole or t for t in sets[name] if t.has_position], pair.after.sigma)
            errors[name] = {
                metric: {"without": getattr(pair.after, metric), "with": getattr(kept, metric)}
                for metric in ("window", "paper")
            }
    return {"seconds": sum(row["seconds"] for row in concerned.values()), "trials": concerned, "scores": errors}


def worth_message(worth: Mapping[str, Any] | None) -> list[Message]:
    """A message on ``worth``, what ``worth_of_left_out`` gave."""
    if not worth:
        return []
    count = len(worth["trials"])
    parts = [f"{worth['seconds']:.1f} s of {count} trial{'s' * (count > 1)} were left out"]
    for name, row in worth["scores"].items():
        words = [
            f"{label} {in_words(row[key]['with'])} instead of {in_words(row[key]['without'])}"
            for key, label in (("window", "30 s windows"), ("paper", "100 s restarts"))
        ]
        parts.append(f"with them the {JUDGED.get(name, name)} have {', '.join(words)}")
    return [Message("; ".join(parts), "left_out_worth")]
