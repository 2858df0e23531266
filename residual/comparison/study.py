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

from cases.shipfiles.model_changes import with_instruments
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.parallel import run_all
from fitting.prediction.predict import Forecaster, predict_all
from fitting.prediction.score import PAPER_WINDOW, Score, pooled_sigma, score
from fitting.report.parts import Store
from fitting.settings import Settings
from fitting.solvers.interrupts import interrupts_noted
from mmg.errors import UserError
from mmg.progress import LOGGER, OnProgress, Progress
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.blackbox.models import BOX_KIND, box_of
from residual.settings import KINDS, BlackBoxSettings, TrainSettings
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
class Subset:
    """Part of the training data: a share of its blocks, with or without runs of random manoeuvres."""

    fraction: float = 1.0
    random: bool = True

    @property
    def words(self) -> str:
        return f"{self.fraction:.0%}" + ("" if self.random else " without random")


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
    instruments: tuple[str, ...] = ("velocity_filter",)


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

    @property
    def name(self) -> str:
        """Its model and seed."""
        return self.model if self.seed is None else f"{self.model} seed {self.seed}"

    @property
    def file(self) -> str:
        """Name of the file by which ``mmg compare --resume`` knows it."""
        data = f"{self.subset.fraction:g}" + ("" if self.subset.random else "_no_random")
        return f"{self.model}_{data}" + ("" if self.seed is None else f"_seed_{self.seed}")

    def to_dict(self) -> dict[str, Any]:
        """Its row in result.json, and the content of its file."""
        return {
            "model": self.model,
            "fraction": self.subset.fraction,
            "random": self.subset.random,
            "seed": self.seed,
            "status": self.status,
            "training_s": self.seconds,
            "took_s": self.took,
            "held_out_window": self.held_out,
            "score": self.score.to_dict() if self.score else None,
            "growth": {"position_m": self.growth[:, 0], "heading_rad": self.growth[:, 1]},
        }

    def filled(self, row: dict[str, Any]) -> Entry:
        """This entry with what ``to_dict`` wrote to its file."""
        held_out, growth = row["held_out_window"], row["growth"]
        return replace(
            self,
            status=row["status"],
            took=row["took_s"],
            score=Score.from_dict(row["score"]) if row["score"] else None,
            growth=np.array([growth["position_m"], growth["heading_rad"]], dtype=float).T,
            held_out=float("nan") if held_out is None else held_out,
        )


@dataclass(frozen=True)
class Comparison:
    """Entries of a study; interrupted: by Ctrl-C or its time limit."""

    study: Study
    entries: tuple[Entry, ...]
    seconds: float
    interrupted: bool

    def of(self, model: str, subset: Subset | None = None) -> list[Entry]:
        """Scored entries of a model on a subset, by default the first one of the study."""
        wanted = model, subset or self.study.subsets[0]
        return [e for e in self.entries if (e.model, e.subset) == wanted and e.score is not None]


@dataclass(frozen=True)
class _Job:
    study: Study
    entry: Entry
    trials: tuple[Trial, ...]
    ship: Ship
    end: float | None
    stop: Path
    store: Store | None


def compare(study: Study, store: Store | None = None, progress: OnProgress | None = None) -> Comparison:
    """Calibrate and train on every subset of a ``study``, score all on its test trials; returns what was done.

    store: what it holds is not trained again, calibrations of which a hybrid may start excepted. What is done when it
    is stopped is kept. progress: told how many calibrations and trainings have ended.
    """
    began = time.monotonic()
    entries: list[Entry] = []
    end = time.time() + study.time_limit if study.time_limit else None
    chosen = {subset: subset_of(study.train, subset) for subset in study.subsets}
    if store:
        store.open()
    with tempfile.TemporaryDirectory() as scratch:
        stop = Path(scratch) / "stop"

        def job(subset: Subset, model: str, ship: Ship, seed: int | None = None, keep: Store | None = store) -> _Job:
            entry = Entry(model, subset, seed, "", sum(t.duration for t in chosen[subset]))
            return _Job(study, entry, chosen[subset], ship, end, stop, keep)

        def note(made: tuple[Entry, Ship | None]) -> None:
            entry, _ = made
            entries.append(entry)
            if progress:
                progress(Progress("comparing", len(entries)))
            figure = f"30 s windows {entry.score.window:.4f}, " if entry.score else ""
            LOGGER.info(f"{entry.name}, {entry.subset.words} of the data: {figure}{entry.status} in {entry.took:.0f} s")

        def interrupted() -> None:
            stop.touch()
            LOGGER.info("interrupted: keeping what is done")

        with interrupts_noted(interrupted):
            first = [job(study.subsets[0], "captive", study.ship)] if "captive" in study.models else []
            if {"calibrated", "hybrid"} & set(study.models):
                first += [job(subset, "calibrated", study.ship) for subset in study.subsets]
            made = run_all(_done, first, study.workers, note)
            calibrated = {e.subset: (ship, e.status) for e, ship in made if e.model == "calibrated" and ship}
            later = []
            for subset in study.subsets:
                for model in (m for m in study.models if m in KINDS or (m == "hybrid" and subset in calibrated)):
                    ship, status = calibrated[subset] if model == "hybrid" else (study.ship, "finished")
                    keep = store if status == "finished" else None  # what starts from a part is not that of a whole run
                    later += [job(subset, model, ship, study.seed + i, keep) for i in range(study.seeds)]
            run_all(_done, later, study.workers, note)
        broken = stop.exists() or (end is not None and time.time() > end)
    return Comparison(study, tuple(entries), time.monotonic() - began, broken)


def _done(job: _Job) -> tuple[Entry, Ship | None]:
    """The entry of a job and, of a calibration, the ship."""
    began, entry, ship, study = time.monotonic(), job.entry, job.ship, job.study
    left = None if job.end is None else job.end - time.time()  # of all machines alike
    again = entry.model == "calibrated" and "hybrid" in study.models
    known = job.store.load(entry.file) if job.store and not again else None
    if known:
        return entry.filled(known[0]), None
    if job.stop.exists() or (left is not None and left < MINIMUM_SECONDS):
        return replace(entry, status="not begun"), None
    model: Simulator | Forecaster | None = None
    try:
        if entry.model == "captive":
            entry = replace(entry, status="finished")
        elif entry.model == "calibrated":
            start = with_instruments(ship, study.instruments, job.trials)
            found = estimate_coefficients(start, job.trials, Settings(time_limit=left))
            ship, entry = found.ship, replace(entry, status="finished" if found.converged else "stopped")
        else:
            model, entry = _trained(job, left)
    except UserError as error:
        return replace(entry, status=str(error), took=time.monotonic() - began), None
    model, tests = model or Simulator(ship), study.test
    scored = score(model, tests, pooled_sigma(tests), "the test trials")
    if scored.diverged:
        status = f"no score: the prediction diverges on {', '.join(scored.diverged)}"
        return replace(entry, status=status, took=time.monotonic() - began), ship
    entry = replace(entry, score=scored, growth=growth(model, tests))
    entry = replace(entry, took=time.monotonic() - began)
    if job.store and entry.status == "finished":
        job.store.save(entry.file, entry.to_dict())
    return entry, ship


def _trained(job: _Job, left: float | None) -> tuple[Simulator | Forecaster, Entry]:
    """A hybrid or black box of one seed, and its entry before it is scored."""
    study, ship, entry, hybrid = job.study, job.ship.without_network(), job.entry, job.entry.model == "hybrid"
    assert entry.seed is not None
    values: dict[str, Any] = {"seeds": study.seeds, "seed": study.seed, "step": study.step}
    values |= {"epochs": study.epochs} if study.epochs else {}
    settings = TrainSettings(**values) if hybrid else BlackBoxSettings(kind=entry.model, **values)
    tasks = tasks_of(HYBRID_KIND if hybrid else BOX_KIND, ship, job.trials, settings, judged_apart=False)
    task = replace(tasks[entry.seed - study.seed], seconds=left, stop=job.stop)
    outcome = train_one(task)
    if outcome.status == "diverged":
        raise UserError("diverged, also at lower rates")
    entry = replace(entry, status=outcome.status, held_out=outcome.after[0])
    if hybrid:
        return Simulator(ship.with_network(network_of(task, [outcome]))), entry
    return box_of(task, [outcome]), entry


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
            error = w.error(trial.states)
            for found, horizon in zip(squares, HORIZONS, strict=True):
                if t[-1] >= horizon - trial.dt:
                    k = int(np.abs(t - horizon).argmin())
                    found.append((error[k, 0] ** 2 + error[k, 1] ** 2, error[k, 2] ** 2))
    return np.array([np.sqrt(np.mean(found, axis=0)) if found else (np.nan, np.nan) for found in squares])
