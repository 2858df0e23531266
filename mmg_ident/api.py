"""The functions of ``mmg_ident``: what each command does, for a script or a notebook.

A *model* is a ship, the name of one of the library, a ship file, a run folder, or the result of ``calibrate`` or
``train``. *Trials* are a ``TrialSet``, what ``read_trials`` returns, or paths. What is fitted and judged has no broken
stretches, and is refused where its data refute what it says (``check``); unchecked=True takes it as it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cases.inputs import assumed
from cases.io.campaigns import campaigns_taken, ship_of_campaign
from cases.shipfiles.effects import reduced_ship, with_effects, without_suspects
from cases.shipfiles.network_file import is_black_box
from cases.shipfiles.ship_file import load_ship, ship_of
from cases.trial import Trial
from cases.trial_set import TrialSet, ready
from diagnosis.inputs import DiagnosisOptions
from fitting.report.run_folder import START, content_on, read_result
from fitting.settings import Settings
from mmg.errors import (
    BadValue,
    Conflict,
    Missing,
    OutOfRange,
    TooFewData,
    UnknownName,
    Unsupported,
    as_array,
    by_name,
    finite,
    needs_torch,
)
from mmg.messages import Message, OnProgress, Progress, html_table
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.settings import check_settings, checked_settings, effects_of, keywords, names_of, taken
from residual.settings import BlackBoxSettings, TrainSettings, defaults_of

# What a single verb needs is imported in its function: solvers, figures and torch take a second or more to load.
if TYPE_CHECKING:
    import pandas as pd

    from cases.checks.report import CheckReport
    from cases.simulation.simulate import Wind
    from diagnosis.result import Diagnosis
    from fitting.calibrate import FitOptions
    from fitting.calibration import SecondEstimate
    from fitting.prediction.predict import Forecaster, Window
    from fitting.prediction.score import Score
    from fitting.result import FitResult
    from residual.result import TrainResult

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
        # states of a prediction that diverges stay nan from there on, so that the last row tells
        return sum(not np.isfinite(w.states[-1]).all() for w in self.windows)

    @property
    def table(self) -> np.ndarray:
        """Rows window, t, x, y, psi, u, v, r in SI units, (N, 8), or with six standard deviations, (N, 14)."""
        parts = []
        for w in self.windows:  # w.first and w.last are rows of the trial, both within the window
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
        names = (HEADER + (STD_HEADER if rows.shape[1] > 8 else "")).split(",")  # more than window, t and six states
        return pd.DataFrame(rows, columns=names).astype({"window": int})

    def _repr_html_(self) -> str:
        last = [(w.number, *self.trial.t[[w.first, w.last]].tolist(), *w.states[-1].tolist()) for w in self.windows]
        header = ("window", "from [s]", "to [s]", "x [m]", "y [m]", "psi [rad]", "u [m/s]", "v [m/s]", "r [rad/s]")
        return html_table(f"{self.trial.name}: predicted states at the end of each window", header, last)


def predictor(model: Model) -> Simulator | Forecaster:
    """What predicts for ``model``: a simulator of its ship, or the black box of a training.

    Raises UserError where there is neither.
    """
    if isinstance(model, (str, Path)) and is_black_box(model):
        needs_torch("a black box")
        from residual.papers.black_box import load_box

        start = Path(model) / START  # of the ship it stands for it takes inputs and length
        return load_box(model, load_ship(start) if start.exists() else None)
    if isinstance(model, Simulator) or hasattr(model, "forecast"):  # all that the protocol Forecaster asks for
        return model  # type: ignore[return-value]
    box = getattr(model, "black_box", None)
    return box if box is not None else Simulator(ship_of(model))


def content_of(model: Model) -> dict[str, Any]:
    """What is known of ``model`` beside its ship, as in result.json; empty for a bare ship."""
    if isinstance(model, (str, Path)):
        return content_on(Path(model))
    return model.to_dict() if hasattr(model, "to_dict") else {}


@keywords()
def check(trials: Trials) -> list[CheckReport]:
    """Check ``trials`` before anything is fitted to them: units, signs, frames, gaps, copies, lags, excitation.

    Returns a report per trial, with its verdict and findings. Raises UserError for a file that cannot be read.
    """
    return list(TrialSet.of(trials).reports)


@keywords(also="duration# dt# n speed# rudder_rate# sampled_helm? campaign x0 delta", others=True)
def simulate(
    ship: Model,
    maneuver: str | Trial | Sequence[float] | np.ndarray,
    wind: str | Wind | None = None,
    effects: str | Sequence[str] | Mapping[str, Mapping[str, float]] = (),
    noise: bool = False,
    seed: int = 0,
    **values: Any,
) -> Trial:
    """Simulate a manoeuvre of ``ship``, or let it follow inputs: those of a trial, or given over time.

    maneuver: as ``mmg simulate --maneuver`` takes it, such as "turning:35" or "zigzag:20/20" [deg], a trial to follow,
    or times (N,) [s] at which ``values`` gives the inputs: numbers, arrays (N,) or functions of the time, by name of
    the ship's actuators, n [1/s], delta [rad], ..., with wind_speed [m/s] and wind_direction [rad] that it comes from,
    and x0 (6,), the first state x, y [m], psi [rad], u, v [m/s], r [rad/s], default at rest. wind:
    "speed:direction[:gusty]" [m/s, deg it comes from], None: calm air; effects: switched on, such as "current:x=0.1" or
    {"current": {"x": 0.1}}; noise: add sensor noise; seed: of gusts, noise and random manoeuvres; values, of a
    manoeuvre: duration: longest time [s]; dt: sampling interval [s], default 0.1; n: of the approach [1/s]; speed
    [m/s]; rudder_rate [deg/s]; sampled_helm: orders are given at samples only; of all: campaign: whose instruments log
    the run. Returns the run. Raises UserError for what cannot be simulated.
    """
    from cases.criteria.standard_runs import planned, simulated_trial
    from cases.inputs import given_inputs

    model = with_effects(ship_of_campaign(ship_of(ship), values.pop("campaign", None)), effects_of(effects))
    if isinstance(maneuver, str):
        orders = taken(values, "n speed rudder_rate duration dt")
        orders = {name: finite(name, order) for name, order in orders.items()}
        dt, sampled = orders.pop("dt", None), values.pop("sampled_helm", False)
        _refuse(values, f"{maneuver} takes duration, dt, n, speed, rudder_rate and sampled_helm")
        if "rudder_rate" in orders:
            orders["rudder_rate"] = math.radians(orders["rudder_rate"])  # a person gives deg/s
        followed = planned(model, maneuver, seed, dt, sampled=sampled, **orders)
        return simulated_trial(model, *followed, wind, noise, seed, dt)
    if {"duration", "dt"} & set(values):
        raise Conflict("duration and dt belong to a manoeuvre; what is followed gives its own times")
    if isinstance(maneuver, Trial):
        _refuse(values, f"the inputs are those of {maneuver.name}")
    else:
        start = values.pop("x0", None)
        maneuver = given_inputs(model, maneuver, values, start)  # refuses what is left in values and is no input
    return simulated_trial(model, None, maneuver, wind, noise, seed)


def simulate_many(
    ships: Sequence[Model] | pd.DataFrame, maneuver: Any, ship: Model | None = None, **values: Any
) -> list[Trial]:
    """``simulate`` with each of several ships, or with draws of the coefficients of one, in the order given.

    ships: models, or a frame with a row per draw and a column per coefficient (``FitResult.sample``) of the ``ship``;
    maneuver, values: as for ``simulate``. Returns the runs. Raises UserError as that does.
    """
    if isinstance(ships, Sequence):
        return [simulate(each, maneuver, **values) for each in ships]
    if not hasattr(ships, "columns"):
        raise BadValue(f"ships: {type(ships).__name__} is none; give a list of models, or a DataFrame of draws")
    if ship is None:
        raise Missing("ship: missing; draws of coefficients need the ship whose they are")
    start, rows = ship_of(ship), zip(*(ships[symbol] for symbol in ships.columns), strict=True)
    drawn = (start.with_values(dict(zip(ships.columns, row, strict=True))) for row in rows)
    return [simulate(each, maneuver, **values) for each in drawn]


def _refuse(values: Mapping[str, Any], why: str) -> None:
    """Raises UserError for the first of the keyword arguments that nothing takes."""
    for name in values:
        raise UnknownName(f"{name}: is no keyword here; {why}")


CHANGES = "with_ without fix only"  # Keywords of ``calibrate`` that change the ship
# Keywords of ``calibrate`` that are fields of its options.
OPTIONS = "measurement per_run per_campaign profile bootstrap posterior next_trial estimator name"


@keywords(Settings, also=f"{CHANGES} {OPTIONS} captive/ captive_sigma".replace("bootstrap", "bootstrap#"))
def calibrate(
    ship: Model,
    trials: Trials,
    validate: Trials = (),
    settings: Settings | None = None,
    options: FitOptions | None = None,
    progress: OnProgress | None = None,
    unchecked: bool = False,
    **values: Any,
) -> FitResult:
    """Calibrate the free coefficients of ``ship`` on ``trials``, as ``mmg fit`` does.

    validate: held-out trials to score before and after; settings: of the solver (``fitting.settings.Settings``);
    options: uncertainty, instruments, next trial and more (``FitOptions``); progress: called at each iteration;
    unchecked: take contradictory trials and broken stretches too; values: what differs from both by name, as the
    options of the command: window=20.0, with_="current", without="wind", fix=["N_v"], only=[...], measurement="none",
    captive="pmm.csv". Returns the result, whose ``save(folder)`` writes the run folder; ``effects`` tests each effect
    that the ship has free, by the likelihood of a diagnosis, and warnings say which of the usual suspects the trials
    speak for, which are fitted along. Raises UserError for input from which nothing can be identified, and for values
    outside their limits.
    """
    from fitting import calibrate as pipeline
    from fitting.solvers.control import unless_interrupted

    changes, chosen = taken(values, CHANGES), taken(values, OPTIONS)
    captive, captive_sigma = values.pop("captive", None), values.pop("captive_sigma", None)
    if captive_sigma is not None:
        captive_sigma = tuple(np.atleast_1d(as_array("captive_sigma", captive_sigma)).tolist())
        if len(captive_sigma) != 3 or not min(captive_sigma) > 0:
            raise BadValue("captive_sigma: needs three positive numbers, of X, Y [N] and N [N m]")
    if captive is not None:
        from fitting.nlp.captive import read_captive

        chosen["captive"] = read_captive(Path(captive), captive_sigma)
    for name in {"measurement", "per_campaign", "profile"} & set(chosen):
        chosen["instruments" if name == "measurement" else name] = tuple(names_of(chosen.pop(name)))
    if "per_run" in chosen:
        chosen["per_run"] = effects_of(chosen["per_run"])
    settings = replace(settings or Settings(), **checked_settings(Settings, values))
    check_settings(settings)  # once more: a Settings made by hand was not checked when it was made
    without, fix, only = (names_of(changes.get(name)) for name in ("without", "fix", "only"))
    effects = effects_of(changes.get("with_", ()))  # commas are of the parameters of an effect
    # suspects of a calibration before are asked anew
    start = reduced_ship(without_suspects(ship_of(ship)), without, effects, fix, only)
    options = replace(options or pipeline.FitOptions(), second=_second_estimate, **chosen)
    runs, held_out = ready(trials, validate, unchecked=unchecked)
    result = pipeline.calibrate(start, runs, held_out, settings, options, progress)
    if start.effects:  # by the likelihood of a diagnosis, which lies above the floor of the calibration
        from diagnosis.for_calibration import with_effect_tests

        tested = unless_interrupted(lambda: with_effect_tests(result, start))
        return tested or result.without_parts("tests of effects")
    return result


@keywords()
def refit(fit: FitResult, hold: Mapping[str, float] | None = None, progress: OnProgress | None = None) -> FitResult:
    """The calibration ``fit`` of this session again, from where it ended, for pages on which a coefficient is moved.

    hold: values of coefficients by symbol that stay, while the others are fitted; progress: called at each iteration.
    Trials, windows and the noise that residuals are weighed by stay as they were, so that objectives can be compared;
    a second estimate keeps its distance. Returns coefficients, errors and scores alone: no bands, no next trial.
    Standard errors are those of a fit in which all coefficients move. Raises UserError for a result that was read from
    a folder, for a symbol that is not free and a value outside its bounds.
    """
    from fitting.calibrate import refit as solved_again

    held = {} if hold is None else by_name(hold)
    return solved_again(fit, {symbol: finite(symbol, value) for symbol, value in held.items()}, progress)


def _second_estimate(ship: Ship, trials: Sequence[Trial], frees: bool, surroundings: bool) -> SecondEstimate:
    """As ``second_estimate``, whose modules are read only where one is asked for."""
    from diagnosis.for_calibration import second_estimate

    return second_estimate(ship, trials, frees, surroundings)


@keywords()
def score(
    model: Model,
    trials: Trials,
    sigma: Sequence[float] | np.ndarray | None = None,
    adapt: float | None = None,
    baseline: Trials = (),
    window: float | None = None,
    method: str = "rk4",
    unchecked: bool = False,
) -> Score:
    """Errors of ``model`` on ``trials`` in units (``units``), and the normalised metric (Wakita et al. 2022, Eq. 25).

    sigma: (6,) of x, y [m], psi [rad], u, v [m/s], r [rad/s] by which errors of the normalised metric are divided,
    default pooled over the trials; adapt: seconds before each window from which the disturbance of the run is
    estimated; baseline: trials to which a plain grey box is fitted that the model must beat, as it must beat velocities
    that are kept (``units.ratio``); window: of the errors in units [s], default one ship length; method: of
    integration, "rk4" or "euler"; unchecked: score contradictory trials and broken stretches too. Returns the scores,
    pooled and by trial; lower is better. Raises UserError for trials without positions.
    """
    from fitting.prediction.baselines import fit_grey_box
    from fitting.prediction.score import score as scored
    from fitting.prediction.unit_errors import window_for

    if method not in ("rk4", "euler"):
        raise UnknownName(f"method {method!r}: unknown; use rk4 or euler")
    if window is not None and not 0 <= window < math.inf:
        raise OutOfRange(f"window = {window:g}: must be 0 or a positive number of seconds")
    origin = "the scored trials" if sigma is None else "the caller"
    sigmas: np.ndarray | None = None if sigma is None else as_array("sigma", sigma)
    if sigmas is not None and not (sigmas.shape == (6,) and (sigmas > 0).all()):
        raise OutOfRange("sigma: give six positive numbers, of x, y [m], psi [rad], u, v [m/s], r [rad/s]")
    if adapt is not None and not 0 <= adapt < math.inf:
        raise OutOfRange(f"adapt = {adapt:g}: must be 0 or a positive number of seconds")
    (runs, fitted), simulator = ready(trials, baseline, unchecked=unchecked), predictor(model)
    particulars = simulator.ship.particulars if isinstance(simulator, Simulator) else {}
    if window is None:
        window = window_for(runs, particulars.get("L")) if runs else 0.0
    box = fit_grey_box(fitted, simulator.inputs, particulars, window) if fitted else None
    return scored(simulator, runs, sigmas, origin, method, adapt=adapt, units=window, baseline=box)


@keywords()
def predict(
    model: Model,
    trials: Trials,
    window: float = 30.0,
    stride: float | None = 15.0,
    adapt: float | None = None,
    progress: OnProgress | None = None,
    unchecked: bool = False,
    members: str = "",
) -> list[Prediction]:
    """Predict open-loop windows of ``trials``, each started from the measured state, as ``mmg predict`` does with its
    own default window, of 100 s.

    window: length [s], 0: the whole run; stride: between starts [s], None: the window; adapt: seconds before each
    window (never the window itself) from which the disturbance of the run is estimated, 0: none, None: those that pay,
    by the result of a calibration; progress: told before each trial; unchecked: predict contradictory trials too; rows
    of broken stretches are predicted always; members: predict by particles that follow the members of a hybrid or black
    box instead, without a past: "ts-infinity": each keeps its member, "ts1": each draws one at every step
    (Wakita et al. 2025, section 4). Returns a prediction per trial, with standard deviations where ``model`` is a
    result that knows them, or those of the particles. Raises UserError where no window can be predicted, and for a
    black box or ``members`` with ``adapt``.
    """
    from fitting.prediction.bands import bands_of
    from fitting.prediction.predict import outside_share
    from fitting.prediction.predict import predict as windows_of
    from fitting.prediction.score import past_to_use

    if adapt is not None and not (0 <= adapt < math.inf):
        raise OutOfRange("--adapt must be 0 or a positive number of seconds")
    if not window >= 0 or (stride is not None and not stride > 0):  # so written that nan is refused too
        raise OutOfRange("--window must be 0 or positive and --stride positive")
    step = stride or (window if window > 0 else 1.0)  # a whole run is one window, whatever the stride
    simulator = predictor(model)
    ship = simulator.ship if isinstance(simulator, Simulator) else None
    if adapt and not ship:
        raise Unsupported(f"--adapt: {model} is a black box, whose disturbance cannot be estimated; leave it out")
    if members:
        needs_torch("predicting by members")
        if adapt:
            raise Conflict("--adapt: the members of an ensemble are predicted without a past; leave it out")
        adapt = 0.0
    content = content_of(model) if ship else {}
    bands, seconds = bands_of(content, ship) if ship else None, past_to_use(content, adapt)[0]
    # a shorter window at the end is kept only where windows do not overlap: else its rows are predicted twice
    results, runs, short = [], TrialSet.of(trials), window <= 0 or step >= window
    ready(runs, unchecked=unchecked)  # to refuse contradictory ones alone: rows of broken stretches are predicted too
    for number, run in enumerate(runs):
        if progress:
            progress(Progress("predicting", number, len(runs)))
        if members:
            from residual.papers.ensemble import predict_members

            hybrid: Any = ship or simulator  # a black box is its own ensemble
            windows, notes = predict_members(hybrid, run, window, step, short, members)
        else:
            windows, notes = windows_of(simulator, run, window, step, short_last=short, past=seconds, bands=bands)
        outside = outside_share(simulator, run, windows) if isinstance(simulator, Simulator) else None
        prediction = Prediction(run, tuple(windows), (), outside, seconds)
        notes = [*notes, *assumed([run], simulator.inputs), *(campaigns_taken(ship, [run]) if ship else ())]
        if not run.has_position:
            notes.append(Message(f"{run.name}: no measured position; each window starts at x = y = 0", "no_position"))
        if prediction.diverged:
            words = f"{run.name}: {prediction.diverged} of {len(windows)} windows diverge; their last rows are nan"
            notes.append(Message(words, "diverged"))
        if outside:
            words = f"{run.name}: {outside:.1%} of the rows lie outside the network's training range"
            notes.append(Message(words, "outside_training"))
        results.append(replace(prediction, notes=tuple(notes)))
    if not any(p.windows for p in results):
        why = "; ".join(note for p in results for note in p.notes) or "the trials are shorter than --window"
        raise TooFewData(f"no window could be predicted; {why}")
    return results


@keywords(TrainSettings, BlackBoxSettings, also="model network")
def train(
    run: Model,
    trials: Trials,
    validate: Trials = (),
    settings: TrainSettings | None = None,
    keep: str = "better",
    progress: OnProgress | None = None,
    unchecked: bool = False,
    **values: Any,
) -> TrainResult:
    """Learn a residual acceleration on a calibrated ship, or a black box, as ``mmg train`` does.

    run: the calibrated ship, best as a run folder or a result of ``calibrate``; trials: to train on; validate: trials
    to judge by; settings: ``TrainSettings``, or ``BlackBoxSettings`` for a black box; keep: "better" or "always", which
    ship is recommended; progress: called after each epoch or seed; unchecked: take contradictory trials and broken
    stretches too; values: settings that differ, by name, such as seeds=3, and model="fnn", "rnn" or "rnn-window" for a
    black box. network=module: a residual of your custom, a torch.nn.Sequential of Linear layers with Tanh between them
    from ``ship.features`` (M, F), over their scales, to scaled accelerations (M, 3); it starts with its weights, but
    for the last layer, at zero. loss may be a function of the errors (N, 6, M) of x, y, psi, u, v, r over their noise,
    of N rows in M windows, 0 where not measured, to a tensor of one number. Returns the result with both ships. Raises
    UserError where there is too little to train on, and for a network or loss that cannot be.
    """
    kind, network = values.pop("model", None), values.pop("network", None)
    loss = values.pop("loss") if callable(values.get("loss")) else None
    if settings is not None and kind is not None:
        raise Conflict("model: is that of the settings; give one of them")
    settings = settings or defaults_of(kind or "hybrid")
    settings = replace(settings, **checked_settings(type(settings), values))
    check_settings(settings)
    custom = network is not None or loss is not None
    if custom and (isinstance(settings, BlackBoxSettings) or (loss is not None and settings.loss != "state")):
        raise Conflict("network, loss: belong to a residual on a ship; leave out the black box and settings.loss")
    needs_torch("mi.train")
    from residual import pipeline
    from residual.hybrid import own_kind

    what = own_kind(ship_of(run), network, loss, settings.seed) if custom else None
    runs, held_out = ready(trials, validate, unchecked=unchecked)
    return pipeline.train(run, runs, held_out, settings, keep, progress, kind=what)  # type: ignore[arg-type]


@keywords(DiagnosisOptions, also="without")
def diagnose(
    model: Model,
    trials: Trials,
    test: Trials = (),
    options: DiagnosisOptions | None = None,
    progress: OnProgress | None = None,
    site: str | Path | None = None,
    unchecked: bool = False,
    **values: Any,
) -> Diagnosis:
    """Say which effect ``model`` lacks, judged by ``trials``, where the gap lies and how far it shrinks.

    test: trials that take no part, to check on; options: ``DiagnosisOptions``; progress: called as the work goes on;
    site: file of the place, default site.toml beside the trials; unchecked: take contradictory trials and broken
    stretches too; values: options that differ, by name, such as between="month", and without="wind". Where ``model`` is
    a run folder or a result of ``calibrate``, what it was calibrated on is taken into account. Returns the diagnosis.
    Raises UserError for input from which nothing can be concluded.
    """
    from diagnosis import diagnose as pipeline

    without = names_of(values.pop("without", ()))
    options = replace(options or DiagnosisOptions(), **checked_settings(DiagnosisOptions, values))
    check_settings(options)
    runs, tests = ready(trials, test, unchecked=unchecked)
    calibrated_on: Any = model if isinstance(model, (str, Path)) else getattr(model, "folder", None)
    objects = getattr(model, "objects", None)
    # a result that was not saved has no folder: its trials say what is no news, unless they are those to be diagnosed
    if (
        calibrated_on is None
        and objects is not None
        and not any(a is b for a in objects.calibration.trials for b in runs)
    ):
        calibrated_on = objects.calibration.trials
    place, calibrated = Path(site) if isinstance(site, str) else site, ship_of(model)
    ship = reduced_ship(calibrated, without)
    result = pipeline.diagnose(ship, runs, tests, place, options, calibrated_on, progress)
    # a calibration tells nothing of predictions by a model of other components
    return result.told_by(content_of(model)) if ship.components == calibrated.components else result


@keywords()
def load_run(folder: str | Path) -> FitResult | TrainResult | Diagnosis:
    """The result in a run ``folder`` of ``mmg fit``, ``train`` or ``diagnose``, or of ``save`` of its result.

    Raises UserError where the folder is none of these, or was changed so that it cannot be read.
    """
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


@keywords()
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

    folders = [Path(run) for run in ([runs] if isinstance(runs, (str, Path)) else runs)]
    if not folders:
        raise Missing("runs: none is given; a page shows at least one run folder")
    if pdf is not None:
        needs_weasyprint()  # before the page is made, which takes longer
    kinds = {folder: read_result(folder)["kind"] for folder in folders}
    if len(set(kinds.values())) > 1:
        words = ", ".join(f"{folder} of {kind}" for folder, kind in kinds.items())
        raise Conflict(f"{words}: a page shows runs of mmg fit or of mmg train, not of both; make one of each")
    if kinds[folders[0]] == "training":
        from residual.result import write_report as write_trainings

        write_trainings(folders, out, full_load, imo)
    else:
        from fitting.result import write_report as write_calibrations

        write_calibrations(folders, out, full_load, imo)
    if pdf is not None:
        write_pdf(Path(out).read_text(encoding="utf-8"), Path(pdf))
