"""White, learned and named models side by side on trials that took no part: what ``mmg gap`` does.

What is missing is made, what is there is taken: a calibration of the same trials, a hybrid of them, and the parts that
an earlier call left in its folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.io.campaigns import ship_in
from cases.shipfiles.effects import without_suspects
from cases.shipfiles.ship_file import ship_of
from cases.trial import Trial
from cases.trial_set import TrialSet, ready
from diagnosis.findings import TESTS, Budget
from diagnosis.inputs import DiagnosisOptions, independent_tests
from diagnosis.result import Diagnosis, read_diagnosis
from diagnosis.validation.gap import (
    BOTH,
    GIVEN,
    LEARNED,
    NAMED,
    REFITTED,
    Gap,
    GapRow,
    compared,
    sentence_of,
    witnessed,
)
from diagnosis.validation.held_out import window_length
from fitting.report.run_folder import RESULT, hash_of_ship, hashes_of_trials, trial_rows
from fitting.solvers.control import check_time
from mmg.errors import Conflict, Missing, TooFewData, needs_torch, refusing
from mmg.messages import LOGGER, Message, OnProgress
from mmg.ship import Ship
from mmg_ident.api import calibrate
from mmg_ident.settings import check_settings, keywords

if TYPE_CHECKING:
    from mmg_ident.api import Model, Trials
    from residual.result import TrainResult
    from residual.settings import TrainSettings

FOLDERS = {REFITTED: "refitted", LEARNED: "hybrid", NAMED: "diagnosis", BOTH: "both"}  # Line -> folder of its part


@refusing
@dataclass(frozen=True)
class GapOptions:
    """How a comparison is made. settings: of both trainings, None: the usual ones; seed: of the diagnosis and all
    draws; folder: where the parts are kept and found, None: nowhere; report: with figures and pages; command: to be
    noted."""

    settings: TrainSettings | None = None
    seed: int = 0
    workers: int = 1
    folder: Path | None = None
    report: bool = True
    command: str = ""


def about(ship: Ship, trials: Sequence[Trial], tests: Sequence[Trial], options: GapOptions) -> dict[str, Any]:
    """What tells a comparison of a ``ship`` on ``trials`` and ``tests`` with ``options`` from others, as plain
    values."""
    settings = options.settings
    return {
        "ship": hash_of_ship(ship),
        "trial files": hashes_of_trials(trials),
        "--test": hashes_of_trials(tests),
        "settings": {"seed": options.seed, "seeds": settings.seeds if settings else None},
    }


@keywords(also="seeds# seed# workers#")
def gap(
    model: Model,
    trials: Trials,
    test: Trials,
    options: GapOptions | None = None,
    progress: OnProgress | None = None,
    unchecked: bool = False,
    **values: Any,
) -> Gap:
    """Compare a ship as given, refitted, with a learned residual, with named effects and with both, on test trials.

    model: a ship, its file, a run folder or a result; trials: to calibrate, train and diagnose on; test: trials that
    take no part, to predict, of which those that share rows with the rest are left out; options: ``GapOptions``;
    progress: called as the work goes on; unchecked: take contradictory trials and broken stretches too; values: instead
    of options: seeds (trainings of each residual), seed (the first, and of all draws), workers. Returns the comparison:
    lines with 90 % intervals, a sentence, and what the named effects explain of what the network learned; the parts lie
    in the folder of the options. Raises UserError where there is too little to train on or to predict, and without
    torch.
    """
    values = {name: value for name, value in values.items() if value is not None}
    if values and options is not None:
        raise Conflict(f"{next(iter(values))}: is a field of options; give it there alone")
    if values:
        from residual.settings import TrainSettings

        check_settings(TrainSettings(**values))
        settings = TrainSettings(**{name: values[name] for name in ("seeds", "seed") if name in values})
        options = GapOptions(settings, values.get("seed", 0), values.get("workers", 1))
    runs, tests = ready(trials, test, unchecked=unchecked)
    return _compared(model, runs, tests, options or GapOptions(), progress)


def _compared(model: Any, trials: TrialSet, tests: TrialSet, o: GapOptions, progress: OnProgress | None) -> Gap:
    """The comparison of a ``model`` on ``tests``."""
    given = ship_of(model)
    needs_torch("mmg gap")
    chosen, by_role = TrialSet.of(trials).training(tests)
    tested, shared = independent_tests(chosen, tests)
    if not tested:
        why = "".join(f"{words}; " for words in shared if words.code == "shared_rows")
        raise Missing(f"no test trials: {why}name at least one that takes no part (--test)")
    ships: dict[str, Ship] = {}
    fitted = [trial.name for trial in tested if _key(trial) in _calibrated_on(model)]
    remarks = [*by_role, *shared]
    if fitted:
        words = (
            f"{', '.join(fitted)}: the ship was calibrated on it, so its errors are not of a trial that took no part"
        )
        remarks.append(Message(words, "calibrated_on"))
    refitted, source = _refitted(model, given.without_network(), chosen, o, progress)
    if source is None:
        remarks.append(Message("the ship was calibrated on these trials: she is not refitted", "not_refitted"))
    else:
        ships[GIVEN] = given.without_network()
    ships[REFITTED] = refitted
    base = source if source is not None else model  # what training and diagnosis know the calibration by
    check_time()  # between the parts: each that is finished is kept, so that --resume loses none
    trainings: dict[str, TrainResult] = {}

    def learn(name: str, on: Any) -> None:
        try:
            trainings[name] = _trained(on, chosen, o, name, progress)
        except TooFewData as reason:  # the named effects are compared all the same
            remarks.append(Message(f"no line {name}: {reason}", "not_learned"))

    learn(LEARNED, base)
    check_time()
    diagnosis = _diagnosed(base, refitted, chosen, tested, o, progress)
    effects = tuple(e.name for e in diagnosis.effects)
    if effects:
        check_time()
        learn(BOTH, diagnosis.ship)
    # the floor is that of the test trials; one of left-out runs would be of other errors
    budget = diagnosis.budget if diagnosis.budget is not None and diagnosis.budget.by == TESTS else None
    rows, run = _lines(ships, trainings, (diagnosis, budget), [*chosen, *tested], tested, o)
    if source is None:  # no folder of ours holds the refitted ship: she was given
        rows = [replace(r, ship="") if r.name == REFITTED else r for r in rows]
    seconds = window_length(refitted)
    hybrid = trainings[LEARNED].hybrid if LEARNED in trainings else None
    witness, channels = witnessed(hybrid, diagnosis.ship, effects, chosen) if hybrid is not None else ((), {})
    floor = [] if budget is not None else [Message("no floor: the diagnosis has none of these trials", "no_floor")]
    gap = Gap(
        sentence=sentence_of(rows, effects, diagnosis.verdict, seconds),
        rows=tuple(rows),
        seconds=seconds,
        windows=len(run),
        runs=len(set(run.tolist())),
        verdict=diagnosis.verdict,
        effects=effects,
        witness=witness,
        learned=channels,
        warnings=(*remarks, *floor),
        about={**about(given, chosen, tested, o), "command": o.command},
    )
    if o.folder is not None and o.report and diagnosis.data is not None:  # none of one that was read from its folder
        diagnosis.save(o.folder / FOLDERS[NAMED], replace=True, gap=gap)
    return gap


def _lines(
    ships: dict[str, Ship],
    trainings: dict[str, TrainResult],
    diagnosed: tuple[Diagnosis, Budget | None],
    trials: Sequence[Trial],
    held: Sequence[Trial],
    o: GapOptions,
) -> tuple[list[GapRow], np.ndarray]:
    """The lines of the ``ships``, and of those that the ``trainings`` and the diagnosis make, on the ``held`` of all
    ``trials``, with the floor of its budget; and the number of the trial of each window (W,)."""
    diagnosis, budget = diagnosed
    hybrids = {name: result.hybrid for name, result in trainings.items()}
    named = diagnosis.ship if diagnosis.effects else None
    for name, ship in ((LEARNED, hybrids.get(LEARNED)), (NAMED, named), (BOTH, hybrids.get(BOTH))):
        if ship is not None:
            ships[name] = ship
    seconds = window_length(ships[REFITTED])
    # the ship of the diagnosis is of the campaigns of the trials: all ships are looked at alike
    ships = {name: ship_in(ship, trials)[0] for name, ship in ships.items()}
    rows, run = compared(ships, held, seconds, budget, o.seed)
    recommended = {name: result.decision.kept for name, result in trainings.items() if result.decision is not None}
    places = FOLDERS if o.folder else {}
    return [replace(r, kept=recommended.get(r.name), ship=places.get(r.name, "")) for r in rows], run


def _refitted(model: Any, ship: Ship, trials: TrialSet, o: GapOptions, progress: OnProgress | None) -> tuple[Ship, Any]:
    """The ``ship`` calibrated on the ``trials``, and the calibration; None where she was already. Surroundings are left
    to the diagnosis: what the trials speak for is its answer, not a part of the ship that is asked about."""
    bare = without_suspects(ship, surroundings_only=True)
    if bare.effects == ship.effects and _calibrated_on(model) == set(map(_key, trials)):
        return ship, None
    from fitting.calibrate import FitOptions
    from fitting.result import read_fit

    place = o.folder and o.folder / FOLDERS[REFITTED]
    if place is not None and (place / RESULT).exists():
        return read_fit(place).ship, place
    LOGGER.info("calibrating the ship")
    options = FitOptions(surroundings=False, next_trial=False, command=o.command)
    fit = calibrate(bare, trials, options=options, progress=progress)
    check_time()  # here and below: what the limit cut short is not kept
    if place is None:
        return fit.ship, fit
    fit.save(place, report=o.report)
    return fit.ship, place


def _key(trial: Trial) -> Any:
    """What tells a ``trial`` from others: its bytes, or of one that was made in memory the object."""
    return trial.sha256 or id(trial)


def _calibrated_on(model: Any) -> set[Any]:
    """The ``_key`` of each trial that a ``model`` was calibrated on, none of a ship."""
    if (objects := getattr(model, "objects", None)) is not None:
        return set(map(_key, objects.calibration.trials))
    if isinstance(model, (str, Path)):
        rows = trial_rows(Path(model)) if (Path(model) / RESULT).exists() else []
    else:
        rows = model.to_dict()["data"] if hasattr(model, "to_dict") else []
    return {row["sha256"] for row in rows if row.get("sha256")}


def _trained(base: Any, trials: TrialSet, o: GapOptions, name: str, progress: OnProgress | None) -> TrainResult:
    """A residual learned on the ship of ``base``; that of ``base`` itself, where it is such a training or its run."""
    from fitting.report.run_folder import read_result
    from residual.pipeline import train
    from residual.result import TrainResult, read_training
    from residual.settings import TrainSettings
    from residual.train import training_store

    if isinstance(base, TrainResult):
        return base
    is_run = isinstance(base, (str, Path)) and (Path(base) / RESULT).exists()
    if is_run and read_result(Path(base))["kind"] == "training":
        return read_training(base)
    place = o.folder and o.folder / FOLDERS[name]
    if place is not None and (place / RESULT).exists() and (earlier := read_training(place)).complete:
        return earlier
    LOGGER.info("training a residual on the ship %s", "with the named effects" if name == BOTH else "as calibrated")
    settings = replace(o.settings or TrainSettings(), workers=o.workers)
    # a residual is learned on the ship without the one that she may have
    store = (
        training_store(place, ship_of(base).without_network(), trials, (), settings, place.exists()) if place else None
    )
    result = replace(train(base, trials, (), settings, progress=progress, store=store), command=o.command)
    if result.interrupted:  # Ctrl-C ends a training with the best weights so far, but no comparison is made of these
        raise KeyboardInterrupt
    if place is not None:
        result.save(place, replace=True, report=False)
    return result


def _diagnosed(
    base: Any, ship: Ship, trials: TrialSet, tests: Sequence[Trial], o: GapOptions, progress: OnProgress | None
) -> Diagnosis:
    """The diagnosis of the refitted ``ship`` of the run ``base``."""
    from diagnosis.diagnose import diagnose

    place = o.folder and o.folder / FOLDERS[NAMED]
    if place is not None and (place / RESULT).exists():
        return read_diagnosis(place)
    LOGGER.info("diagnosing the ship")
    calibrated_on = base if isinstance(base, (str, Path)) else getattr(base, "folder", None)
    options = DiagnosisOptions(seed=o.seed, workers=o.workers, command=o.command)
    diagnosis = diagnose(ship, trials, tests, None, options, calibrated_on, progress)
    check_time()
    if place is not None:
        diagnosis.save(place, report=False)  # the page comes with the comparison, which it shows
    return diagnosis
