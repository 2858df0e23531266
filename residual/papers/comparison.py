"""The comparison: captive, calibrated, hybrid and black boxes on the same trials, over seeds and amounts of data.

Nothing is chosen by the test trials: trainings stop by held-out parts of the training trials, and their settings are
fixed beforehand. The networks of Wakita et al. (2022) are compared as published, by the protocol of their Table 9.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cases.inputs import assumed
from cases.io.published_splits import SPLITS
from cases.shipfiles.effects import with_instruments
from cases.trial import Trial
from cases.trial_set import TrialSet
from fitting.calibration import estimate_coefficients
from fitting.parallel import run_all
from fitting.prediction.predict import Forecaster, predict, predict_all
from fitting.prediction.score import PAPER_WINDOW, Score, pooled_sigma, score
from fitting.report.run_folder import SCHEMA_VERSION, Real, Store, adapter, data_rows, plain
from fitting.settings import Settings
from fitting.solvers.control import interrupts_noted
from mmg.errors import Missing, NoSolution, TooFewData, UserError
from mmg.messages import LOGGER, Message, OnProgress, Progress, message_rows
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.hybrid import HYBRID_KIND, network_of
from residual.papers.black_box import BOX_KIND, box_of
from residual.settings import KINDS, BlackBoxSettings, TrainSettings
from residual.train import tasks_of, train_one

MODELS = ("captive", "calibrated", "hybrid", *KINDS)
# Seconds after a start at which the growth of the error is read: up to the restarts of Wakita et al. (2022).
HORIZONS = (5.0, 10.0, 20.0, 30.0, 50.0, 100.0)
# Length [s] of the blocks of which a share of the data is made, enough for ``residual.splits``. Set by hand.
BLOCK = 65.0

NOT_BEGUN = "not begun"  # Status of what Ctrl-C or the time limit left out


@dataclass(frozen=True)
class Subset:
    """Part of the training data: a share of its blocks, with or without runs of random manoeuvres."""

    fraction: float = 1.0
    random: bool = True

    @property
    def words(self) -> str:
        return f"{self.fraction:.0%}" + ("" if self.random else " without random")


PaperModels = dict[str, tuple[BlackBoxSettings, tuple[Trial, ...]]]  # Network -> settings and trials to train on
PAPERS = ("wakita2022",)
# Type of network -> kind, loss and split of the records (Table 7).
TYPES = {
    "type1": ("rnn-window", "state", "train-tzrb+"),
    "type2": ("rnn", "state", "train-tzrb+"),
    "type3": ("rnn-window", "acceleration", "train-tzrb+"),
    "type4": ("rnn-window", "state", "train-tzb"),
    "type5": ("rnn-window", "state", "train-tzrb"),
}
# Eq. 7 and Table 8: 200 neurons, m = 10 rows, N_T = 60 rows of 0.1 s; without penalty of weights.
NETWORK: dict[str, Any] = {
    "width": 200, "memory": 10, "step": 0.1, "curriculum": ((6.0, 1.0),), "method": "euler", "penalty": 0.0,
}  # fmt: skip
# Of the shorter schedule: gradient steps, seconds between windows, windows a step, and first rate. Set by hand: some
# ten minutes a network on one core.
STEPS, EVERY, BATCH, RATE = 200, 3.0, 128, 1e-3
SHORTER = (
    f"A schedule shorter than the published one: {STEPS} gradient steps of {BATCH} windows, one every {EVERY:g} s, at "
    f"rates of {RATE:g} to 2e-05; --epochs N as published: windows at every row, 512 a step, at 2e-05 (or 1e-4)"
)


def paper_models(trials: Sequence[Trial], names: Sequence[str], epochs: int | None, **values: Any) -> PaperModels:
    """Settings and training trials of the types ``names`` of TYPES, each on those of ``trials`` that are its own.

    epochs: by the published schedule, None: by the SHORTER one; values: further settings. Raises UserError where a type
    has no trial.
    """
    result = {}
    for name in names:
        kind, loss, split = TYPES[name]
        records = tuple(t for t in trials if t.name in SPLITS[split])
        if not records:
            raise Missing(f"--models {name}: none of its training records is here, or all of them are test trials")
        rate = 2e-5 if loss == "state" else 1e-4  # as published, constant over the training
        plan: dict[str, Any] = {"batch": 512, "stride": 0.1, "rate": rate, "last_rate": rate, "epochs": epochs}
        if epochs is None:
            passes = STEPS * BATCH * EVERY / sum(t.duration for t in records)  # about duration / EVERY windows an epoch
            plan = {"batch": BATCH, "stride": EVERY, "rate": RATE, "last_rate": 2e-5, "epochs": max(1, round(passes))}
        sigma = tuple(pooled_sigma(records).tolist())
        result[name] = BlackBoxSettings(kind=kind, loss=loss, sigma=sigma, **NETWORK, **plan, **values), records
    return result


@dataclass(frozen=True)
class Study:
    """What to compare. ship: captive; seeds, seed: how many and the first; epochs: of all trainings, None for theirs;
    time_limit: of the whole [s]; step: grid of the trainings [s], None as in a calibration; instruments: effects that a
    calibration frees along, as mmg fit does; paper: models of a paper by name, with trials and settings of their own.
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
    instruments: tuple[str, ...] = ("shown",)
    paper: PaperModels = field(default_factory=dict)


# Errors whose growth is read, by their names in result.json: words, factor and digits with which they are shown.
GROWTH = {
    "position_m": ("position error, rms [m]", 1.0, 2),
    "heading_rad": ("heading error, rms [deg]", math.degrees(1.0), 1),
}


@dataclass(frozen=True)
class Entry:
    """A model from one seed (None: it has none) on a ``Subset`` of training_s seconds of data, scored on the test
    trials: its row in result.json.

    status: "finished", "stopped" (early, with what it had), or why there is nothing; score: both metrics; growth: rms
    errors of GROWTH at the HORIZONS, NaN where no window is that long; table_9: errors of the test trials by that
    protocol, of a study with models of a paper.
    """

    model: str
    fraction: float
    random: bool
    seed: int | None
    status: str
    training_s: float
    score: Score | None = None
    growth: dict[str, tuple[Real, ...]] = field(default_factory=lambda: dict.fromkeys(GROWTH, (math.nan,) * 6))
    table_9: tuple[Real, ...] = ()

    @property
    def subset(self) -> Subset:
        """The part of the data that it was trained on."""
        return Subset(self.fraction, self.random)

    @property
    def name(self) -> str:
        """Its model and seed."""
        return self.model if self.seed is None else f"{self.model} seed {self.seed}"

    @property
    def file(self) -> str:
        """Name of the file by which ``mmg compare --resume`` knows it."""
        data = f"{self.fraction:g}" + ("" if self.random else "_no_random")
        return f"{self.model}_{data}" + ("" if self.seed is None else f"_seed_{self.seed}")


@dataclass(frozen=True)
class Comparison:
    """Entries of a study; interrupted: by Ctrl-C or its time limit."""

    study: Study
    entries: tuple[Entry, ...]
    interrupted: bool

    def __repr__(self) -> str:
        scored = sum(entry.score is not None for entry in self.entries)
        state = ", interrupted" if self.interrupted else ""
        return f"<Comparison of {', '.join(self.study.models)}: {scored} of {len(self.entries)} scored{state}>"

    def of(self, model: str, subset: Subset | None = None) -> list[Entry]:
        """Scored entries of a model on a subset, by default the first one of the study."""
        wanted = model, subset or self.study.subsets[0]
        return [e for e in self.entries if (e.model, e.subset) == wanted and e.score is not None]


# A study, an entry to fill, its trials and its ship; when all ends, a file that ends it, and where it is kept.
_Job = tuple[Study, Entry, tuple[Trial, ...], Ship, float | None, Path, Store | None]


def compare(study: Study, store: Store | None = None, progress: OnProgress | None = None) -> Comparison:
    """Calibrate and train on every subset of a ``study``, score all on its test trials; returns what was done.

    store: what it holds is not trained again, calibrations of which a hybrid may start excepted. What is done when it
    is stopped is kept. progress: told how many calibrations and trainings have ended.
    """
    entries: list[Entry] = []
    end = time.time() + study.time_limit if study.time_limit else None
    chosen = {subset: subset_of(study.train, subset) for subset in study.subsets}
    if store:
        store.open()
    with tempfile.TemporaryDirectory() as scratch:
        stop = Path(scratch) / "stop"  # a file, which processes of a pool can look for: not all of them get the signal

        def job(subset: Subset, model: str, ship: Ship, seed: int | None = None, keep: Store | None = store) -> _Job:
            trials = study.paper[model][1] if model in study.paper else chosen[subset]
            entry = Entry(model, subset.fraction, subset.random, seed, "", sum(t.duration for t in trials))
            return study, entry, trials, ship, end, stop, keep

        def note(made: tuple[Entry, Ship | None]) -> None:
            entry, _ = made
            entries.append(entry)
            if progress:
                progress(Progress("comparing", len(entries)))
            figure = f"30 s windows {entry.score.window:.4f}, " if entry.score else ""
            LOGGER.info(f"{entry.name}, {entry.subset.words} of data: {figure}{entry.status}")

        def interrupted() -> None:
            stop.touch()
            LOGGER.info("interrupted: keeping what is done")

        with interrupts_noted(interrupted):
            first = [job(study.subsets[0], "captive", study.ship)] if "captive" in study.models else []
            if {"calibrated", "hybrid"} & set(study.models):
                first += [job(subset, "calibrated", study.ship) for subset in study.subsets]
            calibrations = run_all(_done, first, study.workers, note)  # before the networks: a hybrid needs one
            calibrated = {e.subset: (ship, e.status) for e, ship in calibrations if e.model == "calibrated" and ship}
            later = []
            for subset in study.subsets:
                trained = {*KINDS, *study.paper, *(["hybrid"] if subset in calibrated else [])}
                for model in (m for m in study.models if m in trained):
                    ship, status = calibrated[subset] if model == "hybrid" else (study.ship, "finished")
                    keep = store if status == "finished" else None  # what starts from a part is not that of a whole run
                    later += [job(subset, model, ship, study.seed + i, keep) for i in range(study.seeds)]
            run_all(_done, later, study.workers, note)
        broken = stop.exists() or (end is not None and time.time() > end)
    return Comparison(study, tuple(entries), broken)


def _done(job: _Job) -> tuple[Entry, Ship | None]:
    """The entry of a job and, of a calibration, the ship."""
    study, entry, trials, ship, end, stop, store = job
    remaining = None if end is None else end - time.time()  # of all machines alike
    again = entry.model == "calibrated" and "hybrid" in study.models  # the store has the row alone, not the ship
    stored = store.load(entry.file) if store and not again else None
    if stored:
        return adapter(Entry).validate_python(stored[0]), None
    if stop.exists() or (remaining is not None and remaining <= 0):
        return replace(entry, status=NOT_BEGUN), None
    model: Simulator | Forecaster | None = None
    try:
        if entry.model == "captive":
            entry = replace(entry, status="finished")
        elif entry.model == "calibrated":
            start = with_instruments(ship, study.instruments, trials)
            calibration = estimate_coefficients(start, trials, Settings(time_limit=remaining))
            ship, entry = calibration.ship, replace(entry, status="finished" if calibration.converged else "stopped")
        else:
            model, entry = _trained(job, remaining)
    except UserError as error:
        return replace(entry, status=str(error)), None
    model, tests = model or Simulator(ship), study.test
    scored = score(model, tests, pooled_sigma(tests), "the test trials")
    if scored.diverged:
        return replace(entry, status=f"no score: the prediction diverges on {', '.join(scored.diverged)}"), ship
    table_9 = table_9_errors(model, tests) if study.paper else ()
    entry = replace(entry, score=scored, growth=growth(model, tests), table_9=table_9)
    if store and entry.status == "finished":
        store.save(entry.file, plain(entry))
    return entry, ship


def _trained(job: _Job, remaining: float | None) -> tuple[Simulator | Forecaster, Entry]:
    """A hybrid or black box of one seed, and its entry before it is scored."""
    study, entry, trials, ship, _, stop, _ = job
    ship, hybrid = ship.without_network(), entry.model == "hybrid"
    assert entry.seed is not None
    values: dict[str, Any] = {"seeds": study.seeds, "seed": study.seed, "step": study.step}
    values |= {"epochs": study.epochs} if study.epochs else {}
    general = TrainSettings(**values) if hybrid else BlackBoxSettings(kind=entry.model, **values)
    settings = study.paper[entry.model][0] if entry.model in study.paper else general
    # judged apart by the test trials: nothing of the training data is spent on judging
    tasks = tasks_of(HYBRID_KIND if hybrid else BOX_KIND, ship, trials, settings, judged_apart=False)
    task = tasks[entry.seed - study.seed]
    task = replace(task, seconds=remaining, stop=stop, split=task.split._replace(judge=[]))  # the test trials judge
    outcome = train_one(task)
    if outcome.status == "diverged":
        raise NoSolution("diverged, also at lower rates")
    if outcome.status == "stopped" and len(outcome.history) == 1:  # row 0: untrained
        raise NoSolution(NOT_BEGUN)
    entry = replace(entry, status=outcome.status)
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
        edges = np.floor(np.arange(len(cut) + 1) * subset.fraction + 0.5)  # a block counts where this goes up by one
        kept = [block for block, wanted in zip(cut, np.diff(edges) > 0, strict=True) if wanted]
    if not kept:
        raise TooFewData(f"nothing is left of the training trials at {subset.words}; leave that share out")
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


def growth(model: Simulator | Forecaster, trials: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    """Rms errors of GROWTH at the HORIZONS, of ``model`` on ``trials`` over windows in a row."""
    squares: list[list[tuple[float, float]]] = [[] for _ in HORIZONS]
    for trial, (windows, _) in zip(trials, predict_all(model, trials, PAPER_WINDOW, PAPER_WINDOW), strict=True):
        for w in windows:
            t = trial.t[w.first : w.last + 1] - trial.t[w.first]
            error = w.error(trial.states)
            for errors, horizon in zip(squares, HORIZONS, strict=True):
                if t[-1] >= horizon - trial.dt:  # the last sample may lie just before
                    k = int(np.abs(t - horizon).argmin())
                    errors.append((error[k, 0] ** 2 + error[k, 1] ** 2, error[k, 2] ** 2))
    rms = [np.sqrt(np.mean(errors, axis=0)).tolist() if errors else (math.nan, math.nan) for errors in squares]
    return dict(zip(GROWTH, zip(*rms, strict=True), strict=True))


# Parts of the names of runs that are restarted every 100 s (section 4), as runs with gaps are here.
RESTARTED = ("random", "turn")


def table_9_errors(model: Simulator | Forecaster, trials: Sequence[Trial]) -> tuple[float, ...]:
    """Eq. 25 of ``model`` on each of ``trials`` by the protocol of Table 9, with sigma of all; NaN of no whole run."""
    sigma, result = pooled_sigma(trials), []
    for trial in trials:
        again = any(word in f"{trial.kind} {trial.name}".lower() for word in RESTARTED)
        windows = [] if again else predict(model, trial, 0.0, PAPER_WINDOW)[0]
        windows = windows or predict(model, trial, PAPER_WINDOW, PAPER_WINDOW)[0]
        errors = [((w.error(trial.states) / sigma) ** 2).sum(axis=1) for w in windows]  # (N + 1,) each
        result.append(float(np.concatenate(errors).mean()) if errors else math.nan)
    return tuple(result)


# Wakita et al. (2022), Table 9: mean and standard deviation over five seeds of Eq. 25, per record of TABLE_9_TEST.
TABLE_9 = {
    "captive": ((0.272,), (0.858,), (1.015,), (0.036,), (0.189,), (0.100,)),
    "type1": ((0.236, 0.003), (0.713, 0.011), (0.086, 0.063), (0.052, 0.024), (0.069, 0.014), (0.138, 0.023)),
    "type2": ((0.241, 0.005), (0.728, 0.017), (0.124, 0.141), (0.058, 0.031), (0.140, 0.101), (0.167, 0.053)),
    "type3": ((4834, 4041), (0.864, 0.100), (761.1, 1519), (634.8, 1264), (91.76, 124.6), (1.163, 0.617)),
    "type4": ((0.488, 0.022), (0.701, 0.019), (0.122, 0.054), (0.144, 0.053), (0.246, 0.107), (0.302, 0.062)),
    "type5": ((0.262, 0.007), (0.785, 0.024), (0.856, 0.288), (0.055, 0.030), (0.182, 0.047), (0.294, 0.043)),
}
TABLE_9_TEST = ("Random", "Turning", "Zigzag", "Berthing1", "Berthing2", "Berthing3")
TABLE_9_NOTE = (
    "As published by Wakita et al. (2022, Table 9), not like for like: its six test records are not those tested here "
    "unless --test test names them; sigma is pooled over its own test set; only the random and the turning record are "
    "restarted every 100 s, the others run in one piece; a windowed network is given the first second as measured, "
    "here the one before it; weights were chosen by the loss on other data, here by 30 s windows of left-out runs."
)
METRICS = {"window": "30 s windows every 15 s", "paper": "100 s restarts, Wakita et al. (2022) Eq. 25"}


def mean_and_std(values: Sequence[float], digits: int = 3) -> str:
    """Mean and standard deviation of ``values`` with so many ``digits``, "-" without any or where one is no number."""
    if not len(values) or not np.isfinite(values).all():
        return "-"
    mean = float(np.mean(values))
    # of a sample of seeds, hence ddof=1
    return f"{mean:.{digits}f}" + (f" ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else "")


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table of ``rows`` below a ``header``, its columns aligned."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
    lines = [" | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in (header, *rows)]
    return [f"| {lines[0]} |", "|" + "|".join("-" * (w + 2) for w in widths) + "|", *[f"| {x} |" for x in lines[1:]]]


def accuracy(comparison: Comparison, metric: str) -> list[str]:
    """One ``metric`` of the ``comparison`` per test trial and pooled, over the models, on all data."""
    models = comparison.study.models
    rows = []
    for i, name in enumerate([*(t.name for t in comparison.study.test), "all rows pooled"]):
        scores = [[(*e.score.trials, e.score)[i] for e in comparison.of(m) if e.score] for m in models]
        rows.append([name, *[mean_and_std([getattr(s, metric) for s in some]) for some in scores]])
    return markdown(["test trial", *models], rows)


def efficiency(comparison: Comparison) -> list[str]:
    """Pooled 30 s windows of ``comparison`` over the amount of training data."""
    models, rows = [m for m in comparison.study.models if m != "captive"], []
    for subset in comparison.study.subsets:
        took = (e.training_s for e in comparison.entries if e.subset == subset and e.model != "captive")
        seconds = next(took, math.nan)
        values = [mean_and_std([e.score.window for e in comparison.of(m, subset) if e.score]) for m in models]
        rows.append([subset.words, f"{seconds:.0f}", *values])
    return markdown(["training data", "seconds", *models], rows)


def horizon(comparison: Comparison, error: str) -> list[str]:
    """Growth of an ``error`` of GROWTH of ``comparison``."""
    models, (_, factor, digits) = comparison.study.models, GROWTH[error]
    rows = [
        [f"{s:g}", *[mean_and_std([factor * e.growth[error][k] for e in comparison.of(m)], digits) for m in models]]
        for k, s in enumerate(HORIZONS)
    ]
    return markdown(["after [s]", *models], rows)


def table_9(comparison: Comparison) -> list[str]:
    """The test trials of ``comparison`` by the protocol of Table 9 of Wakita et al. (2022)."""
    rows = [
        [model, *[mean_and_std(errors) for errors in zip(*(e.table_9 for e in found), strict=True)]]
        for model in comparison.study.models
        if (found := comparison.of(model))
    ]
    return markdown(["Table 9, here", *(t.name for t in comparison.study.test)], rows)


def published() -> list[str]:
    """Table 9 of Wakita et al. (2022)."""
    rows = [
        [", ".join((name, *TYPES.get(name, ()))), *[" ± ".join(f"{value:g}" for value in cell) for cell in cells]]
        for name, cells in TABLE_9.items()
    ]
    return markdown(["published", *TABLE_9_TEST], rows)


def tables_text(comparison: Comparison) -> str:
    """All tables of the ``comparison`` with what has to be known to read them."""
    study = comparison.study
    placed = [e for e in comparison.entries if e.score]
    sigma = "" if not placed else ", ".join(f"{v:.4g}" for v in placed[0].score.sigma)  # type: ignore[union-attr]
    lines = [
        f"Trained on {len(study.train)} trials ({sum(t.duration for t in study.train):.0f} s), tested on "
        f"{len(study.test)}; {study.seeds} seed(s), mean ± standard deviation over them. Mean squared error summed "
        f"over x, y, psi, u, v, r over sigma = ({sigma}), pooled over the test trials. "
        "Nothing was chosen by the test trials; each seed stops by another part of the training trials. No model uses "
        "the past of a window."
    ]
    for metric, words in METRICS.items():
        lines += ["", f"### {words}", "", *accuracy(comparison, metric)]
    for error, (words, *_) in GROWTH.items():
        lines += ["", f"### Growth of the {words}", "", *horizon(comparison, error)]
    if len(study.subsets) > 1:
        lines += ["", "### Data efficiency: 30 s windows, all rows pooled", "", *efficiency(comparison)]
    if study.paper:
        lines += ["", "### Protocol of Table 9", "", *table_9(comparison), ""]
        lines += [SHORTER] * (study.epochs is None)
    lines += ["", "### Published", "", *published(), "", TABLE_9_NOTE]
    if notes := _noted(comparison):
        lines += ["", "### What mmg check says of the trials", "", *[f"* {note}" for note in notes]]
    troubles: dict[tuple[str, str], list[str]] = {}
    for e in comparison.entries:
        if e.status != "finished":
            troubles.setdefault((e.subset.words, e.status), []).append(e.name)
    lines += [""] * bool(troubles)
    lines += [f"* {', '.join(who)} on {words}: {status}" for (words, status), who in troubles.items()]
    return "\n".join(lines) + "\n"


def _noted(comparison: Comparison) -> list[Message]:
    """What mmg check says of the trials of the ``comparison``, and what its ship assumes of them."""
    trials = [*comparison.study.train, *comparison.study.test]
    return [*TrialSet.of(trials).remarks, *assumed(trials, comparison.study.ship.inputs)]


def comparison_dict(comparison: Comparison, command: str) -> dict:
    """The ``comparison`` as plain values, the content of its result.json; command: that made it."""
    return {
        "kind": "comparison",
        "schema_version": SCHEMA_VERSION,
        "command": command,
        "models": list(comparison.study.models),
        "seeds": [comparison.study.seed + i for i in range(comparison.study.seeds)],
        "epochs": comparison.study.epochs,
        "train": data_rows(comparison.study.train),
        "test": data_rows(comparison.study.test),
        "messages": [{"level": "warning", **row} for row in message_rows(_noted(comparison))],
        "interrupted": comparison.interrupted,
        "horizons_s": list(HORIZONS),
        "past_s": 0.0,
        "entries": plain(comparison.entries),
        "paper": {
            name: {"settings": asdict(settings), "trials": [t.name for t in trials]}
            for name, (settings, trials) in comparison.study.paper.items()
        },
        "schedule": SHORTER if comparison.study.paper and comparison.study.epochs is None else None,
        "published_table_9": {"test": TABLE_9_TEST, "values": TABLE_9, "note": TABLE_9_NOTE},
    }
