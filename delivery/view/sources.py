"""What a page shows: the models of run folders, the trials behind them, and what a diagnosis found missing.

Trials are those that the result.json of a run names, where their file is still there with the same hash.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.inputs import assumed
from cases.io.read import read_trials
from cases.trial import Trial
from diagnosis.report.missing_force import MissingForce, read_missing_force
from diagnosis.result import CONTENT, read_diagnosis
from fitting.prediction.bands import Bands, bands_of
from fitting.prediction.predict import Forecaster
from fitting.report.page import label_of
from fitting.report.run_folder import RESULT, read_result, rows_by_role, trials_again, unique_rows
from fitting.result import read_fit
from mmg.errors import BadValue, Conflict, Missing
from mmg.rollout import Simulator
from mmg.ship import Ship


@dataclass(frozen=True)
class ViewModel:
    """A model that predicts on the page.

    kind: "start", "calibrated", "hybrid", "black box" or "named" (with the effects of a diagnosis); label: in words;
    run: name of its folder; predictor; bands: standard deviations of its predictions, None where they are not known.
    """

    kind: str
    label: str
    run: str
    predictor: Simulator | Forecaster
    bands: Bands | None = None

    @property
    def ship(self) -> Ship | None:
        """Its ship, None of a black box."""
        return self.predictor.ship if isinstance(self.predictor, Simulator) else None


@dataclass(frozen=True)
class ViewTrial:
    """A trial and what it was used for: "calibration", "held out", "test", or "other" where no run names it."""

    trial: Trial
    role: str


@dataclass(frozen=True)
class MarkedDiagnosis:
    """A diagnosis: name of its folder, verdict, the sentence, and the missing force by trial name."""

    folder: str
    verdict: str
    sentence: str
    missing: Mapping[str, MissingForce]


@dataclass(frozen=True)
class Campaign:
    """All that a page shows. notes: sentences on what could not be shown."""

    ship: Ship
    models: tuple[ViewModel, ...]
    trials: tuple[ViewTrial, ...]
    diagnosis: MarkedDiagnosis | None
    notes: tuple[str, ...]


def gather(folders: Sequence[Path], trials: Sequence[str | Path] = (), diagnosis: Path | None = None) -> Campaign:
    """The models and trials of run ``folders`` of fit, train and diagnose.

    trials: files or folders to show instead of those that the runs name; diagnosis: folder of a diagnosis whose missing
    force is marked, None: one beside the runs that used the same trials. Raises UserError for folders of other kinds,
    and where no trial is left to show.
    """
    kinds = {folder: read_result(folder)["kind"] for folder in folders}
    diagnoses = [folder for folder, kind in kinds.items() if kind == "diagnosis"]
    if diagnosis is not None:
        diagnoses = [*diagnoses, diagnosis]
    if len(dict.fromkeys(diagnoses)) > 1:
        raise Conflict(f"{diagnoses[1]}: a page marks one diagnosis, and {diagnoses[0]} is another; give one of them")
    models: list[ViewModel] = []
    rows: list[tuple[str, Mapping[str, Any]]] = []
    for folder in [folder for folder, kind in kinds.items() if kind != "diagnosis"]:
        models += _models(folder, kinds[folder])
        rows += rows_by_role(read_result(folder))
    diagnosis_folder = diagnoses[0] if diagnoses else None
    if diagnosis_folder is not None:
        rows += rows_by_role(read_result(diagnosis_folder))
        models += _named(diagnosis_folder)
    shown, notes = _trials(rows, trials)
    if diagnosis_folder is None:
        diagnosis_folder, more = _used_with(folders, shown)
        notes += more
    distinct, measured = _distinct(models), [one.trial for one in shown]
    notes += dict.fromkeys(str(note) for model in distinct for note in assumed(measured, model.predictor.inputs))
    ships = [model.ship for model in distinct if model.ship is not None] or [_start_of(folders)]
    ship = next((one for one in ships if one.mark), ships[0])  # a calibration before the ship that it began from
    marked = None
    if diagnosis_folder is not None:
        d, missing = read_diagnosis(diagnosis_folder), read_missing_force(diagnosis_folder)
        marked = MarkedDiagnosis(label_of(diagnosis_folder), d.verdict, d.sentence, missing)
    return Campaign(ship, distinct, tuple(shown), marked, tuple(notes))


def _models(folder: Path, kind: str) -> list[ViewModel]:
    """Both ships of a calibration; both ships, or the black box, of a training."""
    run = label_of(folder)
    if kind == "calibration":
        fit = read_fit(folder)
        words = "calibrated" if fit.converged else "calibrated (NOT converged)"
        bands = bands_of(fit.to_dict(), fit.ship)
        return [
            ViewModel("start", "start ship", run, Simulator(fit.start)),
            ViewModel("calibrated", words, run, Simulator(fit.ship), bands),
        ]
    if kind != "training":
        raise BadValue(f"{folder}: kind {kind!r} cannot be shown; give run folders of mmg fit, train or diagnose")
    from residual.result import read_training

    training = read_training(folder)
    if training.black_box is not None:
        return [ViewModel("black box", "black box", run, training.black_box)]
    bands = bands_of(training.to_dict(), training.ship)
    kept = training.recommended == "hybrid"
    models = [ViewModel("calibrated", "calibrated", run, Simulator(training.start), None if kept else bands)]
    if training.hybrid is not None:
        words = "hybrid" if kept else "hybrid (not recommended)"
        models.append(ViewModel("hybrid", words, run, Simulator(training.hybrid), bands if kept else None))
    return models


def _named(folder: Path) -> list[ViewModel]:
    """The ship of a diagnosis that named effects."""
    d = read_diagnosis(folder)
    if not d.effects:
        return []
    words, bands = f"with {', '.join(e.name for e in d.effects)}", bands_of(d.inputs.of_predictions, d.ship)
    return [ViewModel("named", words, label_of(folder), Simulator(d.ship), bands)]


def _trials(
    rows: Iterable[tuple[str, Mapping[str, Any]]], given: Sequence[str | Path]
) -> tuple[list[ViewTrial], list[str]]:
    """The trials to show, each file once, and what is missing of them."""
    if given:
        rows_by_hash = unique_rows(rows)
        return [ViewTrial(t, rows_by_hash.get(str(t.sha256), ("other", {}))[0]) for t in read_trials(given)], []
    pairs, absent = trials_again(rows)
    if not pairs:
        what = f"none of the {len(absent)} trials of the run is there as it was: {absent[0]}" if absent else "no trial"
        raise Missing(f"{what}; give the files with --trials")
    notes = [f"{len(absent)} trial(s) of the run are not shown: {'; '.join(absent)}; give them with --trials"]
    return [ViewTrial(trial, role) for role, trial in pairs], notes if absent else []


def _used_with(folders: Sequence[Path], shown: Sequence[ViewTrial]) -> tuple[Path | None, list[str]]:
    """The diagnosis folder beside the runs that used any of the trials ``shown``; where there are several, none."""
    hashes = {view.trial.sha256 for view in shown}
    around = dict.fromkeys(p.parent for folder in folders for p in folder.absolute().parent.glob(f"*/{CONTENT}"))
    good = [
        p
        for p in around
        if (p / RESULT).is_file() and hashes & {row.get("sha256") for _, row in rows_by_role(read_result(p))}
    ]
    if len(good) > 1:
        names = ", ".join(sorted(p.name for p in good))
        return None, [f"several diagnoses lie beside the run ({names}); choose one with --diagnosis"]
    return (good[0] if good else None), []


def _distinct(models: Sequence[ViewModel]) -> tuple[ViewModel, ...]:
    """Each model once; where two of a kind differ, the label has the name of the run."""
    kept: list[ViewModel] = []
    for model in models:
        twin = next((i for i, k in enumerate(kept) if k.ship and model.ship and same_ship(k.ship, model.ship)), None)
        if twin is None:
            kept.append(model)
        elif kept[twin].bands is None and model.bands is not None:
            kept[twin] = replace(kept[twin], bands=model.bands)
    labels = [model.label for model in kept]
    return tuple(replace(m, label=f"{m.label}, {m.run}") if labels.count(m.label) > 1 else m for m in kept)


def same_ship(a: Ship, b: Ship) -> bool:
    """Whether the ships ``a`` and ``b`` move alike: equal particulars, force models, effects, values and networks."""
    first, second = ((s.particulars, s.components, s.effects, s.symbols, s.values.tolist()) for s in (a, b))
    if first != second or (a.network and a.network.features) != (b.network and b.network.features):
        return False
    states = np.linspace(-1.0, 1.0, 5 * len(a.features)).reshape(-1, 5)
    nets = [s.network for s in (a, b) if s.network is not None]
    accelerations = [np.array(net.accelerations(states[: len(net.features)])).tolist() for net in nets]
    return accelerations[:1] == accelerations[1:]


def _start_of(folders: Sequence[Path]) -> Ship:
    """The ship for which the black box in ``folders`` was trained."""
    from residual.result import read_training

    return read_training(folders[0]).start
