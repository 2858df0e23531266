"""The page: one HTML file that holds its data, its style and its script, and may load and send nothing.

Of a trial it holds the measured columns, predictions of each model over windows, and forces along the motion. Columns
of numbers become short texts, 16 bits a value, exact enough for a screen.

Trials are those that the result.json of a run names, where their file is still there with the same hash.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from cases.inputs import assumed, model_inputs
from cases.io.read import read_trials
from cases.trial import Trial
from diagnosis.result import MissingForce, read_diagnosis, read_missing_force
from fitting.prediction.bands import Bands, bands_of
from fitting.prediction.predict import Forces, Window, forces_along, predict_all
from fitting.report.page import label_of, rendered, write_page
from fitting.report.run_folder import plain, read_result, rows_by_role, trials_again, unique_rows
from fitting.result import read_fit
from mmg.errors import BadValue, Conflict, Missing
from mmg.motion.flow import INPUTS
from mmg.rollout import Simulator
from mmg.ship import Ship


@dataclass(frozen=True)
class ViewModel:
    """A model that predicts on the page.

    kind: "start", "calibrated", "hybrid" or "named" (with the effects of a diagnosis); label: in words; run: name of
    its folder; simulator; bands: standard deviations of its predictions, None where they are not known.
    """

    kind: str
    label: str
    run: str
    simulator: Simulator
    bands: Bands | None = None

    @property
    def ship(self) -> Ship:
        """Its ship."""
        return self.simulator.ship


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


def gather(folders: Sequence[Path], trials: Sequence[str | Path] = ()) -> Campaign:
    """The models and trials of run ``folders`` of fit, train and diagnose; the missing force of a diagnosis is marked.

    trials: files or folders to show instead of those that the runs name. Raises UserError for folders of other kinds,
    for two diagnoses, and where no trial is left to show.
    """
    kinds = {folder: read_result(folder)["kind"] for folder in folders}
    diagnoses = [folder for folder, kind in kinds.items() if kind == "diagnosis"]
    if len(diagnoses) > 1:
        raise Conflict(f"{diagnoses[1]}: a page marks one diagnosis, and {diagnoses[0]} is another; give one of them")
    models: list[ViewModel] = []
    rows: list[tuple[str, Mapping[str, Any]]] = []
    for folder, kind in kinds.items():
        models += _named(folder) if kind == "diagnosis" else _models(folder, kind)
        rows += rows_by_role(read_result(folder))
    shown, notes = _trials(rows, trials)
    distinct, measured = _distinct(models), [one.trial for one in shown]
    notes += dict.fromkeys(str(note) for model in distinct for note in assumed(measured, model.ship.inputs))
    if not distinct:
        raise Missing(f"{folders[0]}: has no model to show; give a run folder of mmg fit or train beside it")
    ships = [model.ship for model in distinct]
    ship = next((one for one in ships if one.mark), ships[0])  # a calibration before the ship that it began from
    marked = None
    for folder in diagnoses:
        d = read_diagnosis(folder)
        marked = MarkedDiagnosis(label_of(folder), d.verdict, d.sentence, read_missing_force(folder))
    return Campaign(ship, distinct, tuple(shown), marked, tuple(notes))


def _models(folder: Path, kind: str) -> list[ViewModel]:
    """Both ships of a calibration or of a training."""
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
    from residual.result import read_training  # late: a page on calibrations needs nothing of trainings

    training = read_training(folder)
    if training.black_box is not None:
        raise BadValue(f"{folder}: is a black box, which has no forces to show; mmg predict and mmg score take it")
    bands = bands_of(training.to_dict(), training.ship)
    kept = training.recommended == "hybrid"  # the bands are those of the recommended ship alone
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
        rows_by_hash = unique_rows(rows)  # the role of a file is found by its content
        return [ViewTrial(t, rows_by_hash.get(str(t.sha256), ("other", {}))[0]) for t in read_trials(given)], []
    pairs, absent = trials_again(rows)
    if not pairs:
        what = f"none of the {len(absent)} trials of the run is there as it was: {absent[0]}" if absent else "no trial"
        raise Missing(f"{what}; give the files with --trials")
    notes = [f"{len(absent)} trial(s) of the run are not shown: {'; '.join(absent)}; give them with --trials"]
    return [ViewTrial(trial, role) for role, trial in pairs], notes if absent else []


def _distinct(models: Sequence[ViewModel]) -> tuple[ViewModel, ...]:
    """Each model once; where two of a kind differ, the label has the name of the run."""
    kept: list[ViewModel] = []
    for model in models:
        twin = next((i for i, k in enumerate(kept) if same_ship(k.ship, model.ship)), None)
        if twin is None:
            kept.append(model)
        elif kept[twin].bands is None and model.bands is not None:  # the start of a training is a calibrated ship
            kept[twin] = replace(kept[twin], bands=model.bands)
    labels = [model.label for model in kept]
    return tuple(replace(m, label=f"{m.label}, {m.run}") if labels.count(m.label) > 1 else m for m in kept)


def same_ship(a: Ship, b: Ship) -> bool:
    """Whether the ships ``a`` and ``b`` move and log alike: equal particulars, force models, effects, values (also by
    campaign) and networks."""
    first, second = (
        (s.particulars, s.components, s.effects, s.symbols, s.values.tolist(), s.campaigns) for s in (a, b)
    )
    if first != second or (a.network and a.network.features) != (b.network and b.network.features):
        return False
    states = np.linspace(-1.0, 1.0, 5 * len(a.features)).reshape(-1, 5)  # networks by what they give at five points
    nets = [s.network for s in (a, b) if s.network is not None]
    accelerations = [np.array(net.accelerations(states[: len(net.features)])).tolist() for net in nets]
    return accelerations[:1] == accelerations[1:]  # none of both, or two that are equal


LENGTHS = (30.0, 100.0, 0.0)  # Windows of a page [s]: those of both metrics of ``mmg score``, and 0, the whole run
SCRIPTS = ("uplot/uPlot.iife.min.js", "data.js", "charts.js", "track.js", "forces.js", "main.js")
STYLES = ("uplot/uPlot.min.css", "view.css")
WIND = {"wind_north": ("velocity of the air towards north", "m/s"), "wind_east": ("and towards east", "m/s")}
MISSING = -32768  # The 16-bit number that stands for a value that is not finite
LARGEST = 32767  # The largest 16-bit number: as far below zero as above, so that the steps are even
BUDGET = 10e6  # Bytes of all runs of a page together, about. Set by hand: what a browser opens at once.
FEWEST, MOST = 120, 1000  # Rows of a run: no fewer, and no more than a screen resolves. Set by hand.


def view_page(campaign: Campaign, lengths: Sequence[float] = LENGTHS) -> str:
    """The page on a ``campaign``; lengths: of the windows that it offers [s], 0 for the whole run.

    Raises UserError where a trial lacks an input of a model, and for lengths that make no sense.
    """
    if not lengths or any(not 0 <= length < float("inf") for length in lengths):
        raise BadValue("--window: give lengths in seconds, 0 for the whole run")
    trials = [view.trial for view in campaign.trials]
    predicted = [predictions(model, trials, lengths) for model in campaign.models]
    roles = [list(next((forces for _, forces in of_model if forces), {})) for of_model in predicted]
    most = rows_per_run(campaign, lengths, roles)
    inputs = campaign.ship.inputs
    missing = campaign.diagnosis.missing if campaign.diagnosis else {}
    runs = [
        run_content(trial, inputs, of_trial, most, missing.get(trial.name))
        for trial, of_trial in zip(trials, zip(*predicted, strict=True), strict=True)
    ]
    return _rendered(campaign, safe_json(_header(campaign, lengths, roles)), [safe_json(run) for run in runs])


def _header(campaign: Campaign, lengths: Sequence[float], roles: Sequence[Sequence[str]]) -> dict[str, Any]:
    """What the script reads before any run: names, lengths, models, inputs, the diagnosis."""
    ship, marked = campaign.ship, campaign.diagnosis
    p = ship.particulars
    L = p["L"]
    # where forces are drawn, by L ahead of midship; usual places where the ship file has none
    places = {"propeller": -0.5, "rudder": p.get("x_R", -0.5 * L) / L}
    places |= {"bow_thruster": p.get("x_BT", 0.4 * L) / L, "stern_thruster": p.get("x_ST", -0.4 * L) / L}
    return {
        "ship": ship.title,
        "length": L,
        "breadth": p.get("B", L / 6),  # to draw the hull alone
        "lengths": list(lengths),
        "inputs": [
            {"name": name, "words": words, "unit": unit}
            for name in ship.inputs
            if name != "time"
            for words, unit in [(INPUTS | WIND)[name]]
        ],
        "models": [
            {"kind": m.kind, "label": m.label, "run": m.run, "band": m.bands is not None, "roles": list(names)}
            for m, names in zip(campaign.models, roles, strict=True)
        ],
        "places": places,
        "runs": [
            {
                "name": view.trial.name,
                "role": view.role,
                "kind": view.trial.kind,
                "duration": view.trial.duration,
                "samples": len(view.trial),
                "position": view.trial.has_position,
                "missing": bool(marked and view.trial.name in marked.missing),
            }
            for view in campaign.trials
        ],
        "diagnosis": {key: getattr(marked, key) for key in ("folder", "verdict", "sentence")} if marked else None,
        "notes": list(campaign.notes),
    }


def _asset(name: str) -> str:
    """The text of a file that comes with this package."""
    return resources.files("delivery.view").joinpath("assets").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """The source expression of a content security policy that allows an element with this ``text``."""
    return "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"


def policy(scripts: Sequence[str], styles: Sequence[str]) -> str:
    """The content security policy of a page with these ``scripts`` and ``styles`` and nothing else."""
    parts = {
        "default-src": ["'none'"],
        "script-src": [_hash(text) for text in scripts],
        "style-src": [_hash(text) for text in styles],
        "base-uri": ["'none'"],
        "form-action": ["'none'"],
    }
    return "; ".join(" ".join([name, *sources]) for name, sources in parts.items())


def _rendered(campaign: Campaign, header: str, runs: Sequence[str]) -> str:
    """The template with policy, styles, data and scripts; what comes from files is escaped."""
    scripts = [_asset(name).strip() for name in SCRIPTS]
    styles = [_asset(name).strip() for name in STYLES]
    return rendered(
        "view", "delivery.view", ship=campaign.ship.title, policy=policy(scripts, styles), scripts=scripts,
        styles=styles, licence=_asset("uplot/LICENSE").strip(), header=header, runs=runs,
    )  # fmt: skip


def write_view(campaign: Campaign, out: Path, lengths: Sequence[float] = LENGTHS) -> int:
    """Write the page on a ``campaign`` to the file ``out``, whole or not at all; returns its bytes.

    lengths: as of ``view_page``. Raises UserError as ``view_page`` does, and where the file cannot be written.
    """
    text = view_page(campaign, lengths)
    write_page(text, out)
    return len(text.encode())


def predictions(
    model: ViewModel, trials: Sequence[Trial], lengths: Sequence[float]
) -> list[tuple[list[list[Window]], Forces]]:
    """What ``model`` predicts of each of ``trials``: windows of each of ``lengths`` [s] (0: the whole run) end to end,
    and forces.

    Raises UserError for a trial that lacks an input of the model.
    """
    simulator, bands = model.simulator, model.bands
    longest = max(trial.duration for trial in trials) + 1.0  # a stride from which no second window begins
    results = [predict_all(simulator, trials, s, s or longest, short_last=True, bands=bands) for s in lengths]
    forces = [forces_along(simulator, trial) for trial in trials]
    return [
        ([windows for windows, _ in of_trial], f)
        for of_trial, f in zip(zip(*results, strict=True), forces, strict=True)
    ]


def rows_per_run(campaign: Campaign, lengths: Sequence[float], roles: Sequence[Sequence[str]]) -> int:
    """Rows of each run for which the page stays within its budget.

    campaign: what is shown; lengths: of windows; roles: of each model.
    """
    # ten: time, states and about three inputs; six states of each window, as many deviations; X, Y, N of each role
    columns = 10.0 + sum(len(lengths) * (12 if m.bands else 6) for m in campaign.models) + 3 * sum(map(len, roles))
    # two bytes a number, four thirds of them in base64
    return int(np.clip(BUDGET / (len(campaign.trials) * columns * 2 * 4 / 3), FEWEST, MOST))


def shown_rows(count: int, starts: Sequence[int], most: int) -> np.ndarray:
    """Rows (K,) of a trial of ``count`` samples that the page shows: evenly spaced, with the ``starts`` of windows and
    the last one; K is about ``most``."""
    even = np.arange(0, count, max(1, math.ceil(count / most)))
    return np.unique(np.concatenate([even, np.asarray(starts, dtype=int), [count - 1]]))


def run_content(
    trial: Trial,
    inputs: Sequence[str],
    predicted: Sequence[tuple[list[list[Window]], Forces]],
    most: int,
    missing: MissingForce | None = None,
) -> dict[str, Any]:
    """The columns of one ``trial``, as the script of the page reads them.

    inputs: names of the inputs of the models; predicted: for each model the windows by window length, and the forces
    (N, 3) by role; most: rows, about; missing: force that a diagnosis found missing.
    """
    starts = [w.first for windows, _ in predicted for same_length in windows for w in same_length]
    rows = shown_rows(len(trial), starts, most)
    columns = dict(zip(inputs, model_inputs(trial, inputs).array.T, strict=True))
    shown = [name for name in inputs if name != "time"]
    content: dict[str, Any] = {
        "t": packed_times(trial.t[rows] - trial.t[0]),
        "measured": [packed(column) for column in trial.states[rows].T],
        "inputs": [packed(columns[name][rows]) for name in shown],
        "models": [
            {
                "windows": [_window_columns(same_length, rows) for same_length in windows],
                "forces": [[packed(column) for column in force[rows].T] for force in forces.values()],
            }
            for windows, forces in predicted
        ],
    }
    if missing is not None:
        content["missing"] = {"t": packed_times(missing.t), "force": [packed(column) for column in missing.force.T]}
    return content


def _window_columns(windows: Sequence[Window], rows: np.ndarray) -> dict[str, Any]:
    """The windows joined at the shown ``rows``: where they start, the six states, their deviations if known."""
    states = np.full((len(rows), 6), np.nan)
    deviations = np.full((len(rows), 6), np.nan)
    starts = []
    for window in windows:
        inside = np.flatnonzero((rows >= window.first) & (rows <= window.last))
        if not len(inside):
            continue
        starts.append(int(inside[0]))  # the first row of a window takes the place of the last one of the window before
        states[inside] = window.states[rows[inside] - window.first]
        if window.std is not None:
            deviations[inside] = window.std[rows[inside] - window.first]
    content: dict[str, Any] = {"starts": starts, "states": [packed(column) for column in states.T]}
    if any(window.std is not None for window in windows):
        content["std"] = [packed(column) for column in deviations.T]
    return content


def packed(values: np.ndarray) -> list[Any]:
    """A column (N,) as [offset, scale, text]: value = offset + scale k, with k the 16-bit integers in base64.

    values: numbers that are not finite become MISSING. The error is at most half a scale, 1/65534 of the range.
    """
    column = np.asarray(values, dtype=float)
    good = np.isfinite(column)
    low, high = (float(column[good].min()), float(column[good].max())) if good.any() else (0.0, 0.0)
    offset, scale = 0.5 * low + 0.5 * high, (0.5 * high - 0.5 * low) / LARGEST  # halved first: no overflow
    steps = np.full(len(column), MISSING, dtype="<i2")
    # 1.0: of a column that does not change, all of whose steps are 0
    steps[good] = np.clip(np.rint((column[good] - offset) / (scale or 1.0)), -LARGEST, LARGEST).astype("<i2")
    return [offset, scale, base64.b64encode(steps.tobytes()).decode()]


def packed_times(t: np.ndarray) -> str:
    """Times ``t`` (N,) [s] since the start, as 32-bit floats in base64."""
    return base64.b64encode(np.asarray(t, dtype="<f4").tobytes()).decode()


def safe_json(data: Any) -> str:
    """``data`` as JSON that may stand in a script element: no text in it ends the element or begins a comment."""
    text = json.dumps(plain(data), separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    # </script>, <!-- and ]]> would end it; as escapes the parser of JSON reads the same text
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
