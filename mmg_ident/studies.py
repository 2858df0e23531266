"""Functions of ``mmg_ident`` that begin before a calibration or go on from one: import, figures, plans, structures,
months, fleets, pages. Models and trials are those of ``mmg_ident.api``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cases.io.read import read_trials
from cases.io.toml_file import validated
from cases.shipfiles.effects import with_instruments
from cases.shipfiles.new_ship import is_starting_ship
from cases.shipfiles.ship_file import ship_of
from cases.trial import Trial
from cases.trial_set import TrialSet, ready
from fitting.settings import Rules, Settings, Wish
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, TooFewData, UnknownName, needs_torch, together
from mmg.messages import Message, OnProgress
from mmg_ident.api import content_of, load_run
from mmg_ident.settings import checked_settings, keywords, listed, names_of, settings_of, taken
from residual.settings import TrainSettings

if TYPE_CHECKING:
    from cases.importing.import_logs import Imported
    from cases.importing.import_map import ImportMap
    from diagnosis.groups.months import MonthStudy
    from fitting.design.planned_trial import PlannedTrial
    from fitting.prediction.figure_intervals import JudgedFigures
    from fitting.report.ship_card import ShipCard
    from fitting.result import FitResult
    from fitting.selection.structure_choice import StructureChoice
    from mmg_ident.api import Model, Trials
    from mmg_ident.fleets.rows import Fleet
    from residual.papers.comparison import Comparison, Study


def import_map(file: str | Path | None = None, **changes: Any) -> ImportMap:
    """The map in a ``file`` (None: none) with ``changes`` of its keys, None: as there. Raises UserError for what is
    none."""
    from cases.importing.import_map import ImportMap, read_map

    chosen = read_map(Path(file)) if file else ImportMap()
    return changed_map(chosen, {key: value for key, value in changes.items() if value is not None})


def changed_map(chosen: ImportMap, changes: dict[str, Any]) -> ImportMap:
    """The map ``chosen`` with ``changes``, other values of some keys. Raises UserError for a value that is none."""
    from cases.importing.import_map import ImportMap

    if not changes:
        return chosen
    content = chosen.model_dump(exclude_unset=True, by_alias=True)  # as its file: what was not said stays open
    return validated(ImportMap, {**content, **changes}, "options")


def complete(imported: Imported) -> Imported:
    """The runs that were ``imported``, where nothing is open. Raises UserError with all that is."""
    if faults := [BadValue(text) for text in imported.problems]:
        raise together(faults, f"{len(faults)} problems; nothing is written")
    return imported


@keywords(also="rudder_positive wind_direction velocity_frame zone_hours", others=True)
def import_logs(
    logs: str | Path | Sequence[str | Path],
    out: str | Path,
    map: str | Path | None = None,
    separate: bool | None = None,
    force: bool = False,
    **conventions: Any,
) -> TrialSet:
    """Turn raw ``logs``, files or folders of them, into trial files, as ``mmg import`` does without a terminal.

    out: folder to write; map: file that says what the headers leave unsaid; separate: every file is a run; force: write
    into a folder that holds files; conventions: rudder_positive ("starboard" or "port"), wind_direction ("from" or
    "to"), velocity_frame ("body" or "earth"), zone_hours, and other keys of the map. Returns the trials. Raises
    UserError with all that is open or wrong; nothing is written then.
    """
    from cases.importing.import_logs import import_logs as read_logs
    from cases.importing.import_logs import write_import

    chosen = import_map(map, separate=separate, **conventions)
    paths = [Path(log) for log in ([logs] if isinstance(logs, (str, Path)) else logs)]
    files = write_import(complete(read_logs(paths, chosen)), chosen, Path(out), force)
    return TrialSet(tuple(read_trials(files)))


# Keywords of ``imo`` for measured trials, and for a ship that is simulated
MEASURED, SIMULATED = "length correct current", "speed rudder_rate maneuver scatter seed workers"


@keywords(also="length# correct? current speed# rudder_rate# maneuver scatter# seed# workers#")
def imo(
    model: Model | None, trials: Trials = (), scale: float | None = None, unchecked: bool = False, **values: Any
) -> JudgedFigures:
    """Judge a ship by IMO MSC.137(76), as ``mmg imo`` does: simulated, or by measured ``trials`` of her.

    model: the ship; None: not known, of trials with a length; trials: measured, of which then the figures are; scale:
    ship length over model length; unchecked: judge contradictory trials too; values, of trials: length: L of their ship
    [m], default that of the model; correct: to still water and calm air; current: speed [m/s] and direction it goes to
    [deg], default from their circles; of a ship that is simulated: speed: of the test [m/s]; rudder_rate [deg/s];
    maneuver: further ones, such as "spiral:15/5"; scatter: draws for intervals, 0: none, default 500 where a covariance
    is known; seed, workers: of the draws. Returns figures, limits and verdicts. Raises UserError for what does not
    belong together, and when no manoeuvre reaches its event.
    """
    from cases.criteria.imo import WaterVelocity, imo_figures, imo_figures_of_trials
    from fitting.prediction.bands import correlation_in
    from fitting.prediction.figure_intervals import DRAWS, JudgedFigures, with_intervals

    for name, value in (("scale", scale), ("length", values.get("length"))):
        if value is not None and not 0 < value < math.inf:
            raise OutOfRange(f"{name} = {value:g}: must be positive")
    measured, simulated = taken(values, MEASURED), taken(values, SIMULATED)
    if isinstance(trials, (str, Path)) or len(trials if hasattr(trials, "__len__") else TrialSet.of(trials)):
        if simulated:
            raise Conflict(f"--{next(iter(simulated)).replace('_', '-')}: belongs to a simulated ship, not to trials")
        water: bool | WaterVelocity = measured.get("correct", False)
        if "current" in measured:
            try:
                speed, towards = (float(x) for x in measured["current"])
            except (TypeError, ValueError):
                raise BadValue("current: give its speed [m/s] and the direction it goes to [deg]") from None
            towards = math.radians(towards)
            # north and east [m/s]: a current is named by where it goes to, a wind by where it comes from
            water = WaterVelocity(speed * math.cos(towards), speed * math.sin(towards), "as given")
        length = measured.get("length")
        if model is None and length is None:
            raise Missing("trials need the length of their ship: --ship SHIP or --length METRES")
        (runs,) = ready(TrialSet.of(trials), unchecked=unchecked)
        ship = None if model is None else ship_of(model)
        return JudgedFigures.of(imo_figures_of_trials(runs, ship, length, scale, water))
    if measured:
        raise Conflict(f"--{next(iter(measured)).replace('_', '-')}: belongs to measured trials; give trials")
    ship, content = ship_of(model), {} if model is None else content_of(model)
    rate, speed = simulated.pop("rudder_rate", None), simulated.pop("speed", None)
    rate = None if rate is None else math.radians(rate)
    figures = imo_figures(ship, speed, rate, listed(simulated.pop("maneuver", ())), scale)
    has_covariance = correlation_in(content) is not None or (not content and is_starting_ship(ship))
    # a library ship has no intervals unless draws are asked for: her priors are those of a regression
    scatter = simulated.get("scatter")
    count = scatter if scatter is not None else DRAWS * has_covariance
    if count:
        return with_intervals(
            figures, ship, content, count, simulated.get("seed", 0), rate, simulated.get("workers", 1)
        )
    if content and scatter is None:
        words = f"no 90 % intervals: the run of {ship.name} holds no covariance; fit again, or give --scatter for its "
        figures = replace(figures, notices=(*figures.notices, Message(words + "priors", "no_covariance")))
    return JudgedFigures.of(figures)


@keywords()
def card(
    model: Model,
    speed: float | None = None,
    rudder_rate: float | None = None,
    scatter: int | None = None,
    seed: int = 0,
) -> ShipCard:
    """Pilot card, wheelhouse poster and manoeuvring booklet of a ship (IMO A.601(15)), as ``mmg card`` writes them.

    model: the ship; speed: of the test [m/s] and rudder_rate [deg/s], default those of ``imo``; scatter: draws for 90 %
    intervals, 0: none, default 500 where a covariance is known; seed: of the draws. Returns the card: ``to_dict()`` has
    its figures, ``page()`` the HTML page. Raises UserError when no manoeuvre reaches its event.
    """
    from fitting.report.ship_card import ship_card

    ship = ship_of(model)
    more = ("coasting",) if {"n", "n_azimuth"} & set(ship.actuators) else ()  # what has no propeller cannot stop it
    judged = imo(model, speed=speed, rudder_rate=rudder_rate, maneuver=more, scatter=scatter, seed=seed)
    rate = None if rudder_rate is None else math.radians(rudder_rate)
    return ship_card(judged, ship, content_of(model), rate, seed)


@keywords(Wish)
def plan(
    run: str | Path | FitResult | Any,
    area: str,
    time: float,
    rudder_limit: float = 35.0,
    progress: OnProgress | None = None,
    **values: Any,
) -> PlannedTrial:
    """Design the trial that would tell most beside those that a ship was calibrated on, as ``mmg plan`` does.

    run: a run folder of mmg fit or mmg train, or its result; area: length x width [m], such as "60x25"; time: length of
    the trial [s]; rudder_limit [deg]; progress: called as the search goes on; values: coefficients, figures,
    speed_limit and other fields of ``Wish``. Returns the plan, whose ``write`` makes the file for an autopilot. Raises
    UserError for an area that the ship does not fit into.
    """
    from fitting.design.planned_trial import plan_trial

    values = checked_settings(
        Wish, {n: listed(v) if n in ("coefficients", "figures") else v for n, v in values.items()}
    )
    wish = Wish(area=area, seconds=time, rudder_limit=math.radians(rudder_limit), **values)
    result: Any = load_run(run) if isinstance(run, (str, Path)) else run
    content = content_of(result)
    if content.get("kind") not in ("calibration", "training"):
        kind = content.get("kind", "a bare ship")
        raise BadValue(f"{run}: kind {kind!r} cannot be planned from; give a run folder of mmg fit or mmg train")
    return plan_trial(ship_of(result), content, wish, progress)


def parted_trials(trials: Trials, validate: Trials = (), test: Trials = ()) -> tuple[TrialSet, TrialSet, TrialSet, str]:
    """``trials`` to fit on, to choose by (``validate``) and to ``test`` on: as given, else by their role, else the last
    quarter chooses; and a sentence on what chooses, "" where it was given. Raises UserError where nothing is left."""
    all_trials = TrialSet.of(trials)
    # what is named goes before roles of a sidecar, and these before the rule of the last quarter
    judges = list(TrialSet.of(validate)) or [t for t in all_trials if t.role == "validate"]
    tests = list(TrialSet.of(test)) or [t for t in all_trials if t.role == "test"]
    train, words = [t for t in all_trials if t.role not in ("validate", "test")], ""
    if not judges:
        count = max(1, len(train) // 4)
        if len(train) < 2:
            raise TooFewData(f"{len(train)} trial to fit on and none to choose by: give more, or some with --validate")
        train, judges = train[:-count], train[-count:]
        words = f"no --validate: the choice is by {', '.join(t.name for t in judges)}, which no fit sees"
    return TrialSet(tuple(train)), TrialSet(tuple(judges)), TrialSet(tuple(tests)), words


# Settings of each fit of ``select`` unless others are given: limit [s] and solves. Set by hand: many models are fitted.
SELECTION: dict[str, Any] = {"time_limit": 300.0, "passes": 2}


@keywords(Settings, Rules, also="objective seeds#")
def select(
    ship: Model,
    trials: Trials,
    validate: Trials = (),
    test: Trials = (),
    only: str | Sequence[str] = (),
    unchecked: bool = False,
    progress: OnProgress | None = None,
    **values: Any,
) -> StructureChoice:
    """Generate Abkowitz-MMG hybrid models for a ``ship``, fit them to ``trials`` and choose the best, as ``mmg
    select``.

    validate: to choose by, default those of that role, else the last quarter; test: on which the choice is tested once;
    only: names of candidates, such as "sm2-order2"; unchecked: take contradictory trials and broken stretches too;
    progress: called before each fit; values: fields of ``Settings`` and of the rules by which candidates are made, such
    as order=2, objective: "regression", or "paper" (Miyauchi et al. 2023) with seeds: its runs. Returns the choice.
    Raises UserError where no candidate can be fitted.
    """
    from fitting.selection.structure_choice import choose_structure

    study, _ = selection_study(ship, trials, validate, test, only, unchecked, **values)
    return choose_structure(**study, progress=progress)


def selection_study(
    ship: Model, trials: Trials, validate: Trials = (), test: Trials = (), only: str | Sequence[str] = (),
    unchecked: bool = False, **values: Any,
) -> tuple[dict[str, Any], str]:  # fmt: skip
    """Arguments by name of ``choose_structure``, and a sentence on what chooses, "" where that was given. ship, trials,
    validate, test, only, unchecked, values: as of ``select``. Raises UserError as that does."""
    from fitting.selection.candidates import candidate, candidates

    objective, seeds = values.pop("objective", "regression"), values.pop("seeds", None)
    if objective not in ("regression", "paper"):
        raise UnknownName(f"--objective {objective}: must be regression or paper")
    rules = Rules(**checked_settings(Rules, {name: values.pop(name) for name in settings_of(Rules) if name in values}))
    settings = Settings(**(SELECTION | checked_settings(Settings, values)))
    *parts, words = parted_trials(trials, validate, test)
    sets, model, names = ready(*parts, unchecked=unchecked), ship_of(ship), names_of(only)
    tried = [candidate(model, name, rules) for name in names] if names else list(candidates(model, rules))
    study = {"ship": model, "given": tried, "trials": sets, "settings": settings, "named": bool(names)}
    # runs of the paper's objective, 0: by regression
    return study | {"seeds": (seeds or 1) if objective == "paper" else 0}, words


def comparison_study(
    train: Trials = (), test: Trials = (), ship: Model = "esso_osaka_3m", models: str | Sequence[str] | None = None,
    fractions: str | Sequence[float] = "1", unchecked: bool = False, paper: str | None = None, **values: Any,
) -> Study:  # fmt: skip
    """What ``compare`` is asked for: ``train``, ``test``, ``ship``, ``models``, ``fractions``, ``unchecked`` and
    ``values`` are its own, and ``paper`` one of these. Raises UserError for what is unknown, and where nothing is left
    to train on."""
    from residual.papers.comparison import MODELS, PAPERS, TYPES, Study, Subset, paper_models

    if paper and paper not in PAPERS:
        raise UnknownName(f"--paper {paper}: unknown; choose one of {', '.join(PAPERS)}")
    choices = ("captive", *TYPES) if paper else MODELS
    names = choices if models is None else tuple(dict.fromkeys(names_of(models)))
    strange = [name for name in names if name not in choices]
    if strange or not names:
        raise UnknownName(f"--models {models}: unknown {', '.join(strange)}; choose from {', '.join(choices)}")
    try:
        given = fractions.split(",") if isinstance(fractions, str) else fractions
        shares = sorted({float(part) for part in given}, reverse=True)
    except (TypeError, ValueError):
        shares = []  # refused below, as shares outside (0, 1] are
    if not shares or not all(0 < share <= 1 for share in shares):
        raise OutOfRange(f"--fractions {fractions}: give shares above 0 and up to 1, separated by commas")
    values = {name: value for name, value in values.items() if value is not None}
    settings = {name: value for name, value in values.items() if name in settings_of(TrainSettings)}
    checked_settings(TrainSettings, settings, "settings of the trainings")
    kinds = (True, False)[: 1 + bool(values.pop("no_random", False))]  # with runs of random manoeuvres, and without
    tests = _positioned(test, "--test", ["development-holdout"])
    # by name and by content: splits of the same records share names, copies share bytes
    tested = {t.name for t in tests} | {t.sha256 for t in tests if t.sha256}
    usual = ["train-tzrb+" if paper else "train-tzrb"]
    trained_on = [t for t in _positioned(train, "--train", usual) if not {t.name, t.sha256} & tested]
    if not trained_on:
        raise Missing("--train: nothing is left to train on besides the test trials")
    train_set, test_set = ready(trained_on, tests, unchecked=unchecked)
    captive, instruments = ship_of(ship).without_network(), tuple(names_of(values.pop("measurement", "shown")))
    with_instruments(captive, instruments)  # freed later; what is wrong with them is said now
    subsets = tuple(Subset(share, random) for random in kinds for share in shares)
    study = Study(captive, train_set.trials, test_set.trials, names, subsets, instruments=instruments, **values)
    if not paper:
        return study
    types = [name for name in names if name in TYPES]
    return replace(study, paper=paper_models(study.train, types, study.epochs, seeds=study.seeds, seed=study.seed))


def _positioned(given: Trials, option: str, usual: Sequence[str]) -> list[Trial]:
    """Trials, files, folders and names of splits, the ``usual`` ones where none is given, as trials with positions."""
    from cases.io.published_splits import SPLITS, find

    # one trial or path is not looped over: a text is a sequence too
    several = [given] if isinstance(given, (str, Path)) or not isinstance(given, Sequence) else list(given)
    trials: list[Trial] = []
    for one in several or usual:
        split = SPLITS.get(one.lower()) if isinstance(one, str) else None
        trials += TrialSet.of(find(split) if split else one)
    without = [t.name for t in trials if not t.has_position]
    if without:
        raise Missing(f"{option}: {', '.join(without)}: no position columns x [m], y [m], which the metrics need")
    return trials


@keywords(also="measurement no_random? paper seeds# seed# epochs# step# workers# time_limit#")
def compare(
    train: Trials = (),
    test: Trials = (),
    ship: Model = "esso_osaka_3m",
    models: str | Sequence[str] | None = None,
    fractions: str | Sequence[float] = "1",
    unchecked: bool = False,
    progress: OnProgress | None = None,
    **values: Any,
) -> Comparison:
    """Calibrate and train every model on the same trials and score all of them on others, as ``mmg compare`` does.

    train, test: trials, or names of splits, default "train-tzrb" and "development-holdout"; ship: the captive one;
    models: which, by commas or several, default all; fractions: shares of the training data; unchecked: take
    contradictory trials and broken stretches too; progress: told of each model; values: measurement, no_random,
    paper="wakita2022", seeds, seed, epochs, step [s], workers, time_limit [s]. Returns the entries, scored. Raises
    UserError for what is unknown, and without torch.
    """
    needs_torch("mi.compare")  # before the import below, whose error would name no remedy
    from residual.papers.comparison import compare as compared

    return compared(comparison_study(train, test, ship, models, fractions, unchecked, **values), None, progress)


@keywords(Settings)
def months(
    folder: str | Path,
    ship: Model,
    fit: bool = True,
    windows: int = 24,
    progress: OnProgress | None = None,
    **values: Any,
) -> tuple[MonthStudy, FitResult | None]:
    """Study months of operational data in partitioned Parquet, as ``mmg months`` does: cut, fit, date what changed.

    folder: of the log; ship: that made it; fit: calibrate her on the windows that tell most, at most ``windows`` of
    them; progress: of the calibration; values: fields of ``Settings``. Returns what the log says, and the calibration.
    Raises UserError for a folder without a readable part.
    """
    from diagnosis.groups.months import study_months

    # huber unless another loss is given: nobody has looked through months of a log as through trials
    settings = Settings(**{"loss": "huber", **checked_settings(Settings, values)})
    return study_months(folder, ship_of(ship), settings, None, windows if fit else 0, progress)


@keywords()
def fleet(
    plan: str | Path, out: str | Path | None = None, workers: int = 1, progress: OnProgress | None = None
) -> Fleet:
    """Fit, judge, diagnose and compare the ships of a ``plan`` (TOML), as ``mmg fleet`` does.

    out: folder of their runs, default beside the plan: what lies there of the same ships and files is not done again;
    workers: processes; progress: told of each ship. Returns the rows of all. Raises UserError for a plan with a fault.
    """
    from mmg_ident.fleets.plan import read_plan
    from mmg_ident.fleets.run import run_fleet

    return run_fleet(read_plan(plan), Path(plan).with_suffix("") if out is None else Path(out), workers, "", progress)


@keywords()
def view(
    runs: str | Path | Sequence[str | Path],
    out: str | Path,
    trials: Sequence[str | Path] = (),
    window: Sequence[float] = (),
) -> Path:
    """Write one interactive page on ``runs``, run folders, as ``mmg view`` does; returns the file ``out``.

    trials: to show, default those of the runs; window: seconds between restarts of the predictions, 0: none. Raises
    UserError where no trial is left to show.
    """
    from delivery.view.page import LENGTHS, gather, write_view

    folders = [Path(run) for run in ([runs] if isinstance(runs, (str, Path)) else runs)]
    write_view(gather(folders, trials), Path(out), window or LENGTHS)
    return Path(out)
