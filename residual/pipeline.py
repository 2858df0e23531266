"""``train``: from a calibrated ship and trials to a ``TrainResult``: train, decide, score, say what is to be known."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from cases.inputs import assumed
from cases.shipfiles.ship_file import load_ship, ship_of
from cases.trial import Trial
from cases.trial_set import TrialSet, shared_rows
from fitting.parallel import with_one_thread
from fitting.prediction.envelope import envelope_of
from fitting.prediction.score import NO_SCORE, score_messages, score_pairs, scores_by_set
from fitting.record import read_record
from fitting.report import run_folder
from fitting.report.run_folder import Store
from fitting.result import FitResult
from fitting.solvers.control import OutOfTimeError
from fitting.solvers.rollout_loss import RolloutLoss, loss_in
from mmg.errors import Missing, UnknownName, UserError
from mmg.messages import Message, OnProgress
from mmg.motion.flow import STATES
from mmg.network import Network
from mmg.ship import Ship
from residual.decide import decide, judged_by_whole_runs
from residual.hybrid import HYBRID_KIND, OUTPUT, network_of
from residual.papers.black_box import BOX_KIND, box_of
from residual.result import CALIBRATED, HYBRID, TrainResult, read_training
from residual.settings import CALIBRATION, KEEP, STATE, BlackBoxSettings, TrainSettings
from residual.train import ModelKind, Outcome, Task, tasks_of, train_seeds
from residual.windows import LEAST_SCALE, Scales, campaign_symbols, windows

RATES = {"du": "m/s²", "dv": "m/s²", "dr": "rad/s²"}  # Channels of the residual and their units


@with_one_thread
def train(
    ship_or_fit: Ship | FitResult | TrainResult | str | Path,
    trials: Sequence[Trial],
    validation: Sequence[Trial] = (),
    settings: TrainSettings | None = None,
    keep: str = "better",
    progress: OnProgress | None = None,
    store: Store | None = None,
    kind: ModelKind | None = None,
) -> TrainResult:
    """Train a residual on a calibrated ship, or a black box, from several seeds; decide, score and say what to know.

    ship_or_fit: a ship, its library name, file or run folder, or the result of a calibration; trials: to train on, but
    for those whose sidecar holds them out; validation: trials to judge and to score by; settings: of a hybrid
    (default), or ``BlackBoxSettings`` for a black box; keep: "better": the decision recommends the hybrid or the
    calibrated ship, "always": the hybrid; progress: called after each epoch or seed; store: of finished seeds, which
    are not trained again; kind: of what is trained, default by the settings. Returns the result. Raises UserError where
    there is too little to train on, stop or judge by, KeyboardInterrupt after Ctrl-C before any training began.
    """
    began = time.perf_counter()
    if keep not in KEEP:  # before anything is read or trained
        raise UnknownName(f"keep: {keep!r} is unknown; choose one of {', '.join(KEEP)}")
    ship, calibration, name, read_loss = _start(ship_or_fit)
    trained_on, by_role = TrialSet.of(trials).training(validation)
    if not trained_on:
        raise Missing("no trials to train on: name at least one trial file")
    settings = settings or TrainSettings()
    taken = assumed([*trained_on, *validation], ship.inputs)
    # a hybrid starts from the calibrated ship below it, not from its network
    ship, black_box = ship.without_network(), isinstance(settings, BlackBoxSettings)
    settings, loss, other_loss = loss_of(settings, read_loss, ship, trained_on)
    kind = kind or (BOX_KIND if black_box else HYBRID_KIND)
    try:
        tasks = tasks_of(kind, ship, trained_on, settings, validation, judged_apart=not black_box, loss=loss)
        outcomes, interrupted = train_seeds(tasks, progress, store)
        task = tasks[0]
        more = bool(validation), calibration, keep
        of_kind = _black_box(task, outcomes, name) if black_box else _hybrid(tasks, outcomes, *more)
    except UserError as error:
        if store and not isinstance(error, OutOfTimeError):
            store.discard()  # too little data or a wrong setting: there is nothing to continue from
        raise
    of_kind["notices"] = (*of_kind.get("notices", ()), *taken, *other_loss)
    seconds, scales = time.perf_counter() - began, task.scales
    result = TrainResult(
        start=ship,
        settings=task.settings,
        per_seed=tuple(_seed_rows(outcomes, validation or trained_on)),
        scores={},
        data=tuple(run_folder.data_rows(trained_on)),
        validation_data=tuple(run_folder.data_rows(validation)),
        sigma={
            name: dict(zip(STATES, sigma.tolist(), strict=True))
            for name, sigma in (("loss", scales.sigma), ("held_out", scales.score))
        },
        envelope=envelope_of(ship.features, scales.features),
        outside=_outside(kind, task, validation),
        timings_s={"train": seconds, "seeds": [o.seconds for o in outcomes]},
        versions={**run_folder.versions(), "torch": metadata.version("torch")},
        created=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        command="",
        warnings=(
            *_seed_warnings(outcomes, task.settings),
            *by_role,
            *shared_rows(trained_on, validation),
            *_calibrated_on(calibration, validation),
        ),
        interrupted=interrupted,
        **of_kind,
    )
    models = tuple(result.models().values())
    if len(models) == 2:  # the calibrated ship alone where every training diverged
        sets = {"validation": validation, "training": trained_on}
        scores = score_pairs(*(scores_by_set(model, sets) for model in models))
        failed = [message for message in score_messages(scores) if message.code == NO_SCORE]
        result = replace(result, scores=scores, warnings=(*failed, *result.warnings))
    timings = {**result.timings_s, "wall": time.perf_counter() - began}
    return replace(result, timings_s=timings)


def _start(
    given: Ship | FitResult | TrainResult | str | Path,
) -> tuple[Ship, Mapping[str, Any], str, Callable[[], RolloutLoss | None]]:
    """The ship to start from, what is known of its calibration ({} for a bare ship), words for it, and what reads the
    loss of its calibration."""
    if isinstance(given, (str, Path)):
        stored = run_folder.described_in(Path(given)) / run_folder.LOSS
        return load_ship(given), _known(Path(given)), str(given), lambda: loss_in(stored)
    ship = ship_of(given)  # before what else is asked of it, so that what is none is refused
    record = {} if isinstance(given, Ship) else given.to_dict()
    return ship, record, ship.name, lambda: given.loss if isinstance(given, FitResult) else None


def loss_of(
    settings: TrainSettings, read: Callable[[], RolloutLoss | None], ship: Ship, trials: Sequence[Trial]
) -> tuple[TrainSettings, RolloutLoss | None, tuple[Message, ...]]:
    """The settings, and the loss of the calibration of ``ship`` where they ask for it and it is of the ``trials``; else
    that of states, with a notice. read: gives that loss, None where there is none; it raises UserError."""
    if settings.loss != CALIBRATION:
        return settings, None, ()
    # the windows of a calibration start from states of its ship, which a black box has not
    loss = None if isinstance(settings, BlackBoxSettings) else read()
    # the values by campaign are inputs of the system: they must be those that the loss was built with
    if loss and loss.symbols == campaign_symbols(ship) and (same := loss.of_trials(trials)):
        return settings, same, ()
    words = "the loss of a calibration of these trials is not known here: the network is trained by that of states"
    return replace(settings, loss=STATE), None, (Message(words, "loss_of_states"),)


def _known(folder: Path) -> Mapping[str, Any]:
    """The content of result.json on the ship in ``folder``, {} where there is none; UserError where it is not as
    written."""
    content, folder = run_folder.content_on(folder), run_folder.described_in(folder)
    if content.get("kind") == "training":
        return read_training(folder).to_dict()
    if content.get("kind") == "calibration":
        read_record(folder / run_folder.RESULT, content)
        return content
    return content and {**run_folder.of_predictions(content), "data": run_folder.trial_rows(folder)}


def _hybrid(
    tasks: Sequence[Task], outcomes: Sequence[Outcome], validated: bool, known: Mapping[str, Any], keep: str
) -> dict[str, Any]:
    """What only a hybrid has, as fields of ``TrainResult``; validated: other trials judged it."""
    decision = decide(outcomes, validated or judged_by_whole_runs(tasks))
    network, scales = network_of(tasks[0], outcomes), tasks[0].scales
    always = keep == "always" and network is not None and not decision.kept
    notice = Message(f"the hybrid is recommended by --keep always, although {decision.reason}", "kept_always")
    return {
        "model": HYBRID,
        "network": network,
        "decision": decision,
        "recommended": HYBRID if network is not None and (decision.kept or always) else CALIBRATED,
        "details": {
            "bound": dict(zip(RATES, network.bound.tolist(), strict=True)) if network else None,
            "output_scale": dict(zip(RATES, scales.output.tolist(), strict=True)),
            "residual_size": _residual_size(network, scales) if network else {},
            "calibration": _calibration_in(known) if known else None,
            **run_folder.of_predictions(known),
        },
        "notices": (notice,) if always else (),
    }


def _calibration_in(known: Mapping[str, Any]) -> dict[str, Any]:
    """What is ``known`` of the calibration itself: when and how it was made, and what plans and exports ask for."""
    if known.get("kind") == "training":
        return dict(known.get("calibration") or {})
    rows = {key: known.get(key) for key in ("created", "command", "converged", "settings", "sigma", "scaling")}
    identifiability = known.get("identifiability") or {}
    worth = (identifiability.get("next_trial") or {}).get("worth")
    kinds = {symbol: {"kind": row["kind"]} for symbol, row in (identifiability.get("coefficients") or {}).items()}
    return rows | {"identifiability": {"next_trial": {"worth": worth}, "coefficients": kinds}}


def _black_box(task: Task, outcomes: Sequence[Outcome], name: str) -> dict[str, Any]:
    """What only a black box has, as fields of ``TrainResult``."""
    box = box_of(task, outcomes)
    return {"model": box.settings.kind, "black_box": box, "details": {"beside": name}}


def _seed_warnings(outcomes: Sequence[Outcome], settings: TrainSettings) -> tuple[Message, ...]:
    """Warnings on the seeds that did not come to their end."""
    status = {o.seed: "restarted" if o.restarts and o.status == "finished" else o.status for o in outcomes}
    seeds = range(settings.seed, settings.seed + settings.seeds)
    kinds = {
        "diverged": "diverged, also at lower rates, and left out",
        "stopped": "stopped before the end",
        "restarted": "diverged at first and trained again at a lower rate",
        "missing": "not begun",
    }
    by_kind = {kind: ", ".join(str(s) for s in seeds if status.get(s, "missing") == kind) for kind in kinds}
    return tuple(Message(f"{kinds[k]}: seed(s) {which}", f"seeds_{k}") for k, which in by_kind.items() if which)


def _seed_rows(outcomes: Sequence[Outcome], judging: Sequence[Trial]) -> list[dict[str, Any]]:
    """How the training of each seed went, as plain values; judging: the trials whose runs judged it."""
    return [
        {
            "seed": o.seed,
            "status": o.status,
            "judged_by_part": o.fold,
            "judged_window": {"before": o.before[0], "after": o.after[0], "windows": o.held_out_windows},
            "judged_restarts": {"before": o.before[1], "after": o.after[1]},
            "judged_runs": _judged_runs(o, judging),
            "stop_window": {"before": o.history[0][3], "after": min(row[3] for row in o.history)},  # row 0: untrained
            "training_windows": o.windows,
            "learning_rate": o.rate,
            "restarts": o.restarts,
            "seconds": o.seconds,
            "history": [dict(zip(("epoch", "rollout_s", "loss", "stop"), h, strict=True)) for h in o.history],
        }
        for o in outcomes
    ]


def _judged_runs(outcome: Outcome, trials: Sequence[Trial]) -> list[dict]:
    """Per run that judged a training: name, number of its 30 s windows, errors before and after."""
    rows = []
    for run in np.unique(outcome.judged[:, 0]).astype(int):
        windows_of_run = outcome.judged[outcome.judged[:, 0] == run]
        before, after = windows_of_run[:, 2:].mean(axis=0).tolist()
        rows.append({"run": trials[run].name, "windows": len(windows_of_run), "before": before, "after": after})
    return rows


def _residual_size(network: Network, scales: Scales) -> dict[str, dict]:
    """Per channel the residual over the training rows [m/s2, rad/s2]; "ship_rms": of the ship without it."""
    sizes = np.abs(network.accelerations(scales.features))  # (3, R)
    ship_rms = (scales.output - LEAST_SCALE) / OUTPUT  # as ``hybrid_scales`` made the output scale of it
    return {
        name: {
            "rms": float(np.sqrt((size**2).mean())),
            "p95": float(np.quantile(size, 0.95)),
            "largest": float(size.max()),
            "bound": float(bound),
            "ship_rms": float(rms),
            "unit": RATES[name],
        }
        for name, size, bound, rms in zip(RATES, sizes, network.bound, ship_rms, strict=True)
    }


def _outside(kind: ModelKind, task: Task, trials: Sequence[Trial]) -> dict:
    """Shares of rows outside the range of the training rows, by trial and by feature, with the ends of the latter."""
    ship, h, training = task.ship, task.h, task.scales.features
    features_at = kind.features(ship)
    rows = {t.name: windows(kind.pieces(ship, [t], h), h, 1, 1) for t in trials}  # every row with one after it
    seen = {name: features_at(b.targets[0], b.controls[0]).numpy() for name, b in rows.items() if b}
    if not seen:
        return {}
    lower, upper = training.min(axis=1)[:, None], training.max(axis=1)[:, None]  # (F, 1)
    every = np.hstack(list(seen.values()))
    beyond = (every < lower) | (every > upper)
    return {
        "trials": {n: float(((a < lower) | (a > upper)).any(axis=0).mean()) for n, a in seen.items()},
        "features": {
            n: {"share": float(b.mean()), "lowest": float(a.min()), "highest": float(a.max())}
            for n, a, b in zip(ship.features, every, beyond, strict=True)
        },
    }


def _calibrated_on(known: Mapping[str, Any], validation: Sequence[Trial]) -> tuple[Message, ...]:
    """A warning on validation trials that the ship was calibrated on."""
    hashes = {row.get("sha256") for row in known.get("data", [])}  # by content: a copy under another name counts
    both = ", ".join(t.name for t in validation if t.sha256 and t.sha256 in hashes)
    words = f"{both}: the ship was calibrated on it, so its score is not held out"
    return (Message(words, "calibrated_on"),) if both else ()
