"""The functions of ``mmg_ident``: what each command does, for a script or a notebook.

A *model* is a ship, the name of one of the library, a ship file, a run folder, or the result of ``calibrate`` or
``train``. *Trials* are a ``TrialSet``, what ``read_trials`` returns, or paths; what is fitted and judged is ``sound``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from cases.checks.report import CheckReport
    from cases.trial import Trial
    from cases.trial_set import TrialSet
    from diagnosis.inputs import DiagnosisOptions
    from diagnosis.result import Diagnosis
    from diagnosis.validation.gap import Gap
    from fitting.calibrate import FitOptions
    from fitting.calibration import SecondEstimate
    from fitting.prediction.predict import Forecaster, Window
    from fitting.prediction.score import Score
    from fitting.result import FitResult
    from fitting.settings import Settings
    from mmg.messages import Message
    from mmg.progress import OnProgress
    from mmg.rollout import Simulator
    from mmg.ship import Ship
    from mmg_ident.model_gap import GapOptions
    from residual.result import TrainResult
    from residual.settings import TrainSettings

    Model: TypeAlias = Ship | str | Path | FitResult | TrainResult | Simulator | Forecaster
    Trials: TypeAlias = str | Path | Trial | Sequence[str | Path | Trial]


@dataclass(frozen=True)
class Prediction:
    """Open-loop windows of one trial.

    trial: that was predicted; windows: each with its rows of the trial, predicted states and, where they are known,
    standard deviations; notes: on windows that were left out; outside: share of the rows that lie outside the data the
    network of a hybrid was trained on, None without a network; past_s: seconds before each window that were used.
    """

    trial: Trial
    windows: tuple[Window, ...]
    notes: tuple[Message, ...] = ()
    outside: float | None = None
    past_s: float = 0.0

    @property
    def diverged(self) -> int:
        """Number of windows whose prediction ends in numbers that are not finite."""
        import numpy as np

        return sum(not np.isfinite(w.states[-1]).all() for w in self.windows)

    @property
    def table(self) -> np.ndarray:
        """Rows window, t, x, y, psi, u, v, r in SI units, (N, 8), or with six standard deviations, (N, 14)."""
        import numpy as np

        parts = []
        for w in self.windows:
            columns = [np.full(len(w.states), float(w.number)), self.trial.t[w.first : w.last + 1], w.states]
            parts.append(np.column_stack(columns if w.std is None else [*columns, w.std]))
        return np.vstack(parts) if parts else np.empty((0, 8))

    def __repr__(self) -> str:
        failed = f", {self.diverged} diverged" if self.diverged else ""
        return f"<Prediction of {self.trial.name}: {len(self.windows)} windows{failed}>"

    def to_pandas(self) -> pd.DataFrame:
        """``table`` as a DataFrame, with the headers of the files that ``mmg predict`` writes."""
        import pandas as pd

        from fitting.prediction.predict import HEADER, STD_HEADER

        rows = self.table
        names = (HEADER + (STD_HEADER if rows.shape[1] > 8 else "")).split(",")
        return pd.DataFrame(rows, columns=names).astype({"window": int})

    def _repr_html_(self) -> str:
        from mmg.messages import html_table

        last = [(w.number, *self.trial.t[[w.first, w.last]].tolist(), *w.states[-1].tolist()) for w in self.windows]
        header = ("window", "from [s]", "to [s]", "x [m]", "y [m]", "psi [rad]", "u [m/s]", "v [m/s]", "r [rad/s]")
        return html_table(f"{self.trial.name}: predicted states at the end of each window", header, last)


def _sound(given: Trials) -> TrialSet:
    """Trials without their broken stretches, paths read."""
    from cases.trial_set import TrialSet

    return TrialSet.of(given).sound


def _ship(model: Any) -> Ship:
    """The ship of a model."""
    from cases.shipfiles.ship_file import load_ship
    from mmg.ship import Ship

    if isinstance(model, (str, Path)):
        return load_ship(model)
    return model if isinstance(model, Ship) else model.ship


def predictor(model: Model) -> Simulator | Forecaster:
    """What predicts for ``model``: a simulator of its ship, or the black box of a training.

    Raises UserError where there is neither.
    """
    from cases.shipfiles.network_file import is_black_box
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import START
    from mmg.errors import needs_torch
    from mmg.rollout import Simulator

    if isinstance(model, (str, Path)) and is_black_box(model):
        needs_torch("a black box")
        from residual.papers.black_box import load_box

        start = Path(model) / START
        return load_box(model, load_ship(start) if start.exists() else None)
    if isinstance(model, Simulator) or hasattr(model, "forecast"):
        return model  # type: ignore[return-value]
    box = getattr(model, "black_box", None)
    return box if box is not None else Simulator(_ship(model))


def content_of(model: Model) -> dict[str, Any]:
    """What is known of ``model`` beside its ship, as in result.json; empty for a bare ship."""
    from fitting.report.run_folder import content_on

    if isinstance(model, (str, Path)):
        return content_on(Path(model))
    return model.to_dict() if hasattr(model, "to_dict") else {}


def check(trials: Trials) -> list[CheckReport]:
    """Check ``trials`` before anything is fitted to them: units, signs, frames, gaps, copies, lags, excitation.

    Returns a report per trial, with its verdict and findings. Raises UserError for a file that cannot be read.
    """
    from cases.trial_set import TrialSet

    return list(TrialSet.of(trials).reports)


def simulate(
    ship: Model,
    maneuver: str | Trial,
    wind: str | None = None,
    effects: Sequence[str] = (),
    noise: bool = False,
    duration: float | None = None,
    dt: float | None = None,
    seed: int = 0,
) -> Trial:
    """Simulate a manoeuvre of ``ship``, or let it follow the rudder, revolutions and wind of a trial.

    maneuver: as ``mmg simulate --maneuver`` takes it, such as "turning:35" or "zigzag:20/20" [deg], or a trial to
    follow; wind: "speed:direction[:gusty]" [m/s, deg it comes from], None: calm air; effects: switched on, such as
    "current:x=0.1"; noise: add sensor noise; duration: longest time [s]; dt: sampling interval [s], default 0.1; seed:
    of gusts, noise and random manoeuvres. Returns the run. Raises UserError for what cannot be simulated.
    """
    from cases.criteria.standard_runs import simulated_trial
    from cases.maneuvers.definitions import parse_maneuver
    from cases.shipfiles.effects import with_effects
    from mmg.errors import Conflict

    model = with_effects(_ship(ship), effects)
    if isinstance(maneuver, str):
        plan = parse_maneuver(maneuver, model, seed=seed, duration=duration)
        return simulated_trial(model, plan, None, wind, noise, seed, dt)
    if duration is not None or dt is not None:
        raise Conflict("duration and dt belong to a manoeuvre; a trial that is followed gives its own times")
    return simulated_trial(model, None, maneuver, wind, noise, seed)


def calibrate(
    ship: Model,
    trials: Trials,
    validate: Trials = (),
    settings: Settings | None = None,
    options: FitOptions | None = None,
    progress: OnProgress | None = None,
    **values: Any,
) -> FitResult:
    """Calibrate the free coefficients of ``ship`` on ``trials``, as ``mmg fit`` does.

    validate: held-out trials to score before and after; settings: of the solver (``fitting.settings.Settings``);
    options: uncertainty, instruments, next trial and more (``fitting.calibrate.FitOptions``); progress: called at each
    iteration; values: fields of the settings that differ from these, by name, such as ``window=20.0``. Returns the
    result, whose ``save(folder)`` writes the run folder; ``effects`` tests each effect that the ship has free, by the
    likelihood of a diagnosis, and warnings say which of the usual suspects the trials speak for, which are fitted
    along. Raises UserError for
    input from which nothing can be identified, and for values outside their limits.
    """
    from cases.shipfiles.effects import without_suspects
    from fitting import calibrate as pipeline
    from fitting.settings import Settings
    from fitting.solvers.control import unless_interrupted
    from mmg_ident.settings import check_settings, checked_settings

    settings = replace(settings or Settings(), **checked_settings(Settings, values))
    check_settings(settings)
    start = without_suspects(_ship(ship))  # of a calibration before, they are asked anew
    options = replace(options or pipeline.FitOptions(), second=_second_estimate)
    result = pipeline.calibrate(start, _sound(trials), _sound(validate), settings, options, progress)
    if start.effects:
        from diagnosis.for_calibration import with_effect_tests

        tested = unless_interrupted(lambda: with_effect_tests(result, start))
        return tested or result.without_parts("tests of effects")
    return result


def refit(fit: FitResult, hold: Mapping[str, float] | None = None, progress: OnProgress | None = None) -> FitResult:
    """The calibration ``fit`` of this session again, from where it ended, for pages on which a coefficient is moved.

    hold: values of coefficients by symbol that stay, while the others are fitted; progress: called at each iteration.
    Trials, windows and the noise that residuals are weighed by stay as they were, so that objectives can be compared;
    a second estimate keeps its distance. Returns coefficients, errors and scores alone: no bands, no next trial.
    Standard errors are those of a fit in which all coefficients move. Raises UserError for a result that was read from
    a folder, for a symbol that is not free and a value outside its bounds.
    """
    from fitting.calibrate import refit as solved_again

    return solved_again(fit, hold or {}, progress)


def _second_estimate(ship: Ship, trials: Sequence[Trial], frees: bool, surroundings: bool) -> SecondEstimate:
    """As ``second_estimate``, whose modules are read only where one is asked for."""
    from diagnosis.for_calibration import second_estimate

    return second_estimate(ship, trials, frees, surroundings)


def score(
    model: Model,
    trials: Trials,
    sigma: Sequence[float] | np.ndarray | None = None,
    adapt: float | None = None,
    baseline: Trials = (),
) -> Score:
    """Errors of ``model`` on ``trials`` in units (``units``), and the normalised metric (Wakita et al. 2022, Eq. 25).

    sigma: (6,) of x, y [m], psi [rad], u, v [m/s], r [rad/s] by which errors of the normalised metric are divided,
    default pooled over the trials; adapt: seconds before each window from which the disturbance of the run is
    estimated; baseline: trials to which a plain grey box is fitted that the model must beat, as it must beat
    velocities that are kept (``units.ratio``). Returns the scores, pooled and by trial; lower is better. Raises
    UserError for trials without positions.
    """
    import numpy as np

    from fitting.prediction.baselines import fit_grey_box
    from fitting.prediction.score import score as scored
    from fitting.prediction.unit_errors import window_for
    from mmg.rollout import Simulator

    origin = "the scored trials" if sigma is None else "the caller"
    given = None if sigma is None else np.asarray(sigma, dtype=float)
    runs, fitted, simulator = _sound(trials), _sound(baseline), predictor(model)
    particulars = simulator.ship.particulars if isinstance(simulator, Simulator) else {}
    window = window_for(runs, particulars.get("L")) if runs else 0.0
    box = fit_grey_box(fitted, simulator.inputs, particulars, window) if fitted else None
    return scored(simulator, runs, given, origin, adapt=adapt, units=window, baseline=box)


def predict(
    model: Model,
    trials: Trials,
    window: float = 30.0,
    stride: float | None = 15.0,
    adapt: float | None = None,
    progress: OnProgress | None = None,
) -> list[Prediction]:
    """Predict open-loop windows of ``trials``, each started from the measured state, as ``mmg predict`` does.

    window: length [s], 0: the whole run; stride: between starts [s], None: the window; adapt: seconds before each
    window (never the window itself) from which the disturbance of the run is estimated, 0: none, None: those that pay,
    by the result of a calibration; progress: told before each trial. Returns a prediction per trial, with standard
    deviations where ``model`` is a result that knows them.
    Raises UserError where no window can be predicted, and for a black box with ``adapt``.
    """
    from cases.inputs import assumed
    from cases.io.campaigns import campaigns_taken
    from cases.trial_set import TrialSet
    from fitting.prediction.bands import bands_of
    from fitting.prediction.predict import outside_share
    from fitting.prediction.predict import predict as windows_of
    from fitting.prediction.score import past_to_use
    from fitting.prediction.stretches import Adaptation
    from mmg.errors import OutOfRange, TooFewData, Unsupported
    from mmg.messages import Message
    from mmg.progress import Progress
    from mmg.rollout import Simulator

    if adapt is not None and not (0 <= adapt < float("inf")):
        raise OutOfRange("--adapt must be 0 or a positive number of seconds")
    if not window >= 0 or (stride is not None and not stride > 0):
        raise OutOfRange("--window must be 0 or positive and --stride positive")
    step = stride or (window if window > 0 else 1.0)
    simulator = predictor(model)
    ship = simulator.ship if isinstance(simulator, Simulator) else None
    if adapt and not ship:
        raise Unsupported(f"--adapt: {model} is a black box, whose disturbance cannot be estimated; leave it out")
    content = content_of(model) if ship else {}
    bands, seconds = bands_of(content, ship) if ship else None, past_to_use(content, adapt)[0]
    past = Adaptation.of(ship, seconds) if seconds and ship else None
    results, runs, short = [], TrialSet.of(trials), window <= 0 or step >= window
    for number, run in enumerate(runs):
        if progress:
            progress(Progress("predicting", number, len(runs)))
        found, notes = windows_of(simulator, run, window, step, short_last=short, adaptation=past, bands=bands)
        outside = outside_share(simulator, run, found) if isinstance(simulator, Simulator) else None
        made = Prediction(run, tuple(found), (), outside, seconds)
        notes = [*notes, *assumed([run], simulator.inputs), *(campaigns_taken(ship, [run]) if ship else ())]
        if not run.has_position:
            notes.append(Message(f"{run.name}: no measured position; each window starts at x = y = 0", "no_position"))
        if made.diverged:
            words = f"{run.name}: {made.diverged} of {len(found)} windows diverge; their last rows are nan"
            notes.append(Message(words, "diverged"))
        if outside:
            words = f"{run.name}: {outside:.1%} of the rows lie outside the network's training range"
            notes.append(Message(words, "outside_training"))
        results.append(replace(made, notes=tuple(notes)))
    if not any(p.windows for p in results):
        why = "; ".join(note for p in results for note in p.notes) or "the trials are shorter than --window"
        raise TooFewData(f"no window could be predicted; {why}")
    return results


def train(
    model: Model,
    trials: Trials,
    validate: Trials = (),
    settings: TrainSettings | None = None,
    keep: str = "better",
    progress: OnProgress | None = None,
) -> TrainResult:
    """Learn a residual acceleration on a calibrated ship, or a black box, as ``mmg train`` does.

    model: the calibrated ship, best as a run folder or a result of ``calibrate``; trials: to train on; validate: trials
    to judge by; settings: ``residual.settings.TrainSettings``, or ``BlackBoxSettings`` for a black box; keep: "better"
    or "always", which ship is recommended; progress: called after each epoch or seed. Returns the result with both
    ships. Raises UserError where there is too little to train on.
    """
    from mmg_ident.settings import check_settings
    from residual import pipeline

    if settings:
        check_settings(settings)
    return pipeline.train(model, _sound(trials), _sound(validate), settings, keep, progress=progress)  # type: ignore[arg-type]


def diagnose(
    model: Model,
    trials: Trials,
    test: Trials = (),
    options: DiagnosisOptions | None = None,
    progress: OnProgress | None = None,
) -> Diagnosis:
    """Say which effect ``model`` lacks, judged by ``trials``, where the gap lies and how far it shrinks.

    test: trials that take no part, to check on; options: ``diagnosis.diagnose.DiagnosisOptions``; progress: called as
    the work goes on. Where ``model`` is a run folder or a result of ``calibrate``, what it was calibrated on is taken
    into account. Returns the diagnosis. Raises UserError for input from which nothing can be concluded.
    """
    from diagnosis import diagnose as pipeline
    from mmg_ident.settings import check_settings

    if options:
        check_settings(options)
    runs = _sound(trials)
    known: Any = model if isinstance(model, (str, Path)) else getattr(model, "folder", None)
    objects = getattr(model, "objects", None)
    if known is None and objects is not None and not any(a is b for a in objects.trials for b in runs):
        known = objects.trials
    found = pipeline.diagnose(_ship(model), runs, _sound(test), None, options, known, progress)
    return found.told_by(content_of(model))


def gap(
    model: Ship | str | Path,
    trials: Trials,
    test: Trials,
    options: GapOptions | None = None,
    progress: OnProgress | None = None,
) -> Gap:
    """Compare a ship as given, refitted, with a learned residual, with named effects and with both, on test trials.

    model: a ship, its file or a run folder; trials: to calibrate, train and diagnose on; test: trials that take no
    part, to predict; options: ``mmg_ident.model_gap.GapOptions``; progress: called as the work goes on. Returns the
    comparison: lines with 90 % intervals, a sentence, and what the named effects explain of what the network learned.
    Raises UserError where there is too little to train on or to predict.
    """
    from mmg_ident.model_gap import compare_models

    return compare_models(model, _sound(trials), _sound(test), options, progress, calibrate)


def load_run(folder: str | Path) -> FitResult | TrainResult | Diagnosis:
    """The result in a run ``folder`` of ``mmg fit``, ``train`` or ``diagnose``, or of ``save`` of its result.

    Raises UserError where the folder is none of these, or was changed so that it cannot be read.
    """
    from fitting.report.run_folder import read_result
    from mmg.errors import BadValue

    kind = read_result(Path(folder))["kind"]
    if kind == "calibration":
        from fitting.result import read_fit

        return read_fit(folder)
    if kind == "training":
        from residual.result import read_training

        return read_training(folder)
    if kind == "diagnosis":
        from diagnosis.result import read_diagnosis

        return read_diagnosis(folder)
    raise BadValue(f"{folder}: result.json says kind {kind!r}; known are calibration, training and diagnosis")


def write_report(
    runs: str | Path | Sequence[str | Path], out: str | Path, pdf: str | Path | None = None,
    full_load: float | None = None, imo: bool = True,
) -> None:  # fmt: skip
    """Write one self-contained HTML page on a run folder, or on several side by side.

    runs: folders of ``mmg fit``, or of ``mmg train``; out: the file; pdf: file for the same as PDF (needs WeasyPrint);
    full_load: draught [m] of the loaded ship, to which tested figures are corrected; imo: with the form for IMO, whose
    figures are simulated. Raises UserError for a folder of another kind, an unwritable file, and a missing WeasyPrint.
    """
    from fitting.report.page import needs_weasyprint, write_pdf
    from fitting.report.run_folder import read_result

    folders = [Path(run) for run in ([runs] if isinstance(runs, (str, Path)) else runs)]
    if pdf is not None:
        needs_weasyprint()
    if read_result(folders[0])["kind"] == "training":
        from residual.result import write_report as write_trainings

        write_trainings(folders, out, full_load, imo)
    else:
        from fitting.result import write_report as write_calibrations

        write_calibrations(folders, out, full_load, imo)
    if pdf is not None:
        write_pdf(Path(out).read_text(encoding="utf-8"), Path(pdf))
