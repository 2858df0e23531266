"""The comparison: captive, calibrated, hybrid and black boxes on the same trials, over seeds and amounts of data.

Nothing is chosen by the test trials: trainings stop by held-out parts of the training trials, and their settings are
fixed beforehand.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cases.shipfiles.effects import freeing_effects
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.parallel import run_all
from fitting.prediction.predict import Forecaster, predict_all
from fitting.prediction.score import PAPER_WINDOW, Score, pooled_sigma, score, wrapped_error
from fitting.settings import Settings
from fitting.solvers.interrupts import Interrupts
from mmg.errors import UserError
from mmg.progress import LOGGER
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.blackbox.models import BOX_KIND, box_of
from residual.comparison.store import Subset, arrays_of, filled, name_of, words_of
from residual.settings import KINDS, BlackBoxSettings, TrainSettings
from residual.training.checkpoint import Store
from residual.training.hybrid import HYBRID_KIND, network_of
from residual.training.tasks import tasks_of
from residual.training.trainer import train_one

MODELS = ("captive", "calibrated", "hybrid", *KINDS)
HORIZONS = (5.0, 10.0, 20.0, 30.0, 50.0, 100.0)
"""Seconds after a start at which the growth of the error is read."""
BLOCK = 65.0
"""Length [s] of the blocks of which a share of the data is made, enough for ``residual.training.folds``."""
MINIMUM_SECONDS = 10.0
"""Seconds that have to be left of a time limit for something to be started."""


@dataclass(frozen=True)
class Study:
    """What to compare. ship: captive; seeds, seed: how many and the first; epochs: of all trainings, None for theirs;
    time_limit: of the whole [s]; step: grid of the trainings [s], None as in a calibration; instruments: effects that a
    calibration frees along, as mmg fit does.
    """

    ship: Ship
    train: tuple[Trial, ...]
    test: tuple[Trial, ...]
    models: tuple[str, ...] = MODELS
    subsets: tuple[Subset, ...] = (Subset(),)
    seeds: int = 5
    seed: int = 0
    workers: int = 1
    epochs: int | None = None
    step: float | None = None
    time_limit: float | None = None
    instruments: tuple[str, ...] = ("velocity_lag",)


@dataclass(frozen=True)
class Entry:
    """A model from one seed (None: it has none) on a subset of ``seconds`` of data, scored on the test trials.

    status: "finished", "stopped" (early, with what it had), or why there is nothing. score: both metrics; growth:
    (horizons, 2) rms of position [m] and heading [rad] errors, NaN where no window is that long. held_out: error of the
    30 s windows by which the training stopped.
    """

    model: str
    subset: Subset
    seed: int | None
    status: str
    seconds: float
    took: float = 0.0
    score: Score | None = None
    growth: np.ndarray = field(default_factory=lambda: np.full((len(HORIZONS), 2), np.nan))
    held_out: float = float("nan")


@dataclass(frozen=True)
class Comparison:
    """Entries of a study; interrupted: by Ctrl-C or its time limit."""

    study: Study
    entries: tuple[Entry, ...]
    seconds: float
    interrupted: bool

    def of(self, model: str, subset: Subset) -> list[Entry]:
        """Scored entries of a model on a subset."""
        return [e for e in self.entries if (e.model, e.subset) == (model, subset) and e.score is not None]


@dataclass(frozen=True)
class _Job:
    study: Study
    subset: Subset
    trials: tuple[Trial, ...]
    model: str
    seed: int | None
    ship: Ship
    end: float | None
    stop: Path
    store: Store | None


def compare(study: Study, store: Store | None = None) -> Comparison:
    """Calibrate and train on every subset of a ``study``, score all on its test trials; returns what was done.

    store: what it holds is not trained again, calibrations of which a hybrid may start excepted. What is done when it
    is stopped is kept.
    """
    began = time.time()
    entries: list[Entry] = []
    end = began + study.time_limit if study.time_limit else None
    chosen = {subset: subset_of(study.train, subset) for subset in study.subsets}
    if store:
        store.open()
    with tempfile.TemporaryDirectory() as scratch:
        stop = Path(scratch) / "stop"

        def job(subset: Subset, model: str, seed: int | None, ship: Ship) -> _Job:
            return _Job(study, subset, chosen[subset], model, seed, ship, end, stop, store)

        def note(entry: Entry) -> None:
            entries.append(entry)
            figure = f"30 s windows {entry.score.window:.4f}, " if entry.score else ""
            which = entry.model + ("" if entry.seed is None else f" seed {entry.seed}")
            LOGGER.info(f"{which}, {entry.subset.words} of the data: {figure}{entry.status} in {entry.took:.0f} s")

        def interrupted() -> None:
            stop.touch()
            LOGGER.info("interrupted: keeping what is done")

        with Interrupts(interrupted):
            first = [job(study.subsets[0], "captive", None, study.ship)] if "captive" in study.models else []
            if {"calibrated", "hybrid"} & set(study.models):
                first += [job(subset, "calibrated", None, study.ship) for subset in study.subsets]
            ships: dict[Subset, Ship] = {}
            unfinished: set[Subset] = set()
            for made, (entry, ship) in zip(
                first, run_all(_done, first, study.workers, lambda r: note(r[0])), strict=True
            ):
                if ship is not None and entry.model == "calibrated":
                    ships[made.subset] = ship
                    if entry.status != "finished":  # what starts from it is not that of a whole run
                        unfinished.add(made.subset)
            later = []
            for subset in study.subsets:
                for model in study.models:
                    if model in KINDS or (model == "hybrid" and subset in ships):
                        ship = ships[subset] if model == "hybrid" else study.ship
                        jobs = [job(subset, model, study.seed + i, ship) for i in range(study.seeds)]
                        loose = model == "hybrid" and subset in unfinished
                        later += [replace(one, store=None) for one in jobs] if loose else jobs
            run_all(_done, later, study.workers, lambda r: note(r[0]))
        broken = stop.exists() or (end is not None and time.time() > end)
    return Comparison(study, tuple(entries), time.time() - began, broken)


def _done(job: _Job) -> tuple[Entry, Ship | None]:
    """The entry of a job and, of a calibration, the ship."""
    began = time.time()
    amount = sum(t.duration for t in job.trials)
    blank = Entry(job.model, job.subset, job.seed, "", amount)
    left = None if job.end is None else job.end - began
    name = name_of(job.model, job.subset, job.seed)
    again = job.model == "calibrated" and "hybrid" in job.study.models
    known = job.store.load(name) if job.store and not again else None
    if known:
        return filled(blank, *known), None
    if job.stop.exists() or (left is not None and left < MINIMUM_SECONDS):
        return replace(blank, status="not begun"), None
    ship = job.ship
    model: Simulator | Forecaster
    held_out, status = float("nan"), "finished"
    try:
        if job.model == "captive":
            model = Simulator(ship)
        elif job.model == "calibrated":
            start = freeing_effects(ship, [name for name in job.study.instruments if name not in ship.effects])
            found = estimate_coefficients(start, job.trials, Settings(time_limit=left))
            ship, status = found.ship, "finished" if found.converged else "stopped"
            model = Simulator(ship)
        else:
            model, status, held_out = _trained(job, left)
    except UserError as error:
        return replace(blank, status=str(error), took=time.time() - began), None
    sigma = pooled_sigma(job.study.test)
    found_score = score(model, job.study.test, sigma, "the test trials")
    entry = replace(blank, status=status, score=found_score, growth=growth(model, job.study.test), held_out=held_out)
    entry = replace(entry, took=time.time() - began)
    if job.store and entry.status == "finished":
        job.store.save(name, words_of(entry), arrays_of(entry))
    return entry, ship


def _trained(job: _Job, left: float | None) -> tuple[Simulator | Forecaster, str, float]:
    """A hybrid or black box of one seed, how its training ended, its held-out error."""
    study, ship, hybrid = job.study, job.ship.without_network(), job.model == "hybrid"
    assert job.seed is not None
    values: dict[str, Any] = {"seeds": study.seeds, "seed": study.seed, "step": study.step}
    values |= {"epochs": study.epochs} if study.epochs else {}
    settings = TrainSettings(**values) if hybrid else BlackBoxSettings(kind=job.model, **values)
    kind = HYBRID_KIND if hybrid else BOX_KIND
    tasks = tasks_of(kind, ship, job.trials, settings, judged_apart=False)
    task = replace(tasks[job.seed - study.seed], seconds=left, stop=job.stop)
    outcome = train_one(task)
    if outcome.status == "diverged":
        raise UserError("diverged, also at lower rates")
    if not hybrid:
        return box_of(task, [outcome]), outcome.status, outcome.after[0]
    return Simulator(ship.with_network(network_of(task, [outcome]))), outcome.status, outcome.after[0]


def subset_of(trials: Sequence[Trial], subset: Subset) -> tuple[Trial, ...]:
    """The ``trials`` of a ``subset``: whole, or evenly spread blocks of about BLOCK seconds as trials of their own.

    Raises UserError where nothing is left.
    """
    kept = [t for t in trials if subset.random or not is_random(t)]
    if subset.fraction < 1:
        cut = [block for trial in kept for block in blocks_of(trial)]
        edges = np.floor(np.arange(len(cut) + 1) * subset.fraction + 0.5)
        kept = [block for block, wanted in zip(cut, np.diff(edges) > 0, strict=True) if wanted]
    if not kept:
        raise UserError(f"nothing is left of the training trials at {subset.words}; leave that share out")
    return tuple(kept)


def is_random(trial: Trial) -> bool:
    """Whether ``trial`` is a run of random manoeuvres, by its kind or its name."""
    return "random" in (trial.kind.lower() or trial.name.lower())


def blocks_of(trial: Trial) -> list[Trial]:
    """A ``trial`` cut evenly into blocks of about BLOCK seconds."""
    count = max(1, int(trial.duration / BLOCK))
    edges = np.linspace(0, len(trial), count + 1).round().astype(int)
    return [
        replace(trial, name=f"{trial.name} part {k + 1}", columns={n: c[a:b] for n, c in trial.columns.items()})
        for k, (a, b) in enumerate(pairwise(edges))
    ]


def growth(model: Simulator | Forecaster, trials: Sequence[Trial]) -> np.ndarray:
    """Rms of position [m] and heading [rad] errors (horizons, 2) of ``model`` on ``trials`` over windows in a row."""
    squares: list[list[tuple[float, float]]] = [[] for _ in HORIZONS]
    for trial, (windows, _) in zip(trials, predict_all(model, trials, PAPER_WINDOW, PAPER_WINDOW), strict=True):
        for w in windows:
            t = trial.t[w.first : w.last + 1] - trial.t[w.first]
            error = wrapped_error(w.states, trial.states[w.first : w.last + 1])
            for found, horizon in zip(squares, HORIZONS, strict=True):
                if t[-1] >= horizon - trial.dt:
                    k = int(np.abs(t - horizon).argmin())
                    found.append((error[k, 0] ** 2 + error[k, 1] ** 2, error[k, 2] ** 2))
    return np.array([np.sqrt(np.mean(found, axis=0)) if found else (np.nan, np.nan) for found in squares])
