"""The run folder of a training: ship, network where one was kept, result.json with everything that led to it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

from cases.shipfiles.network_file import NETWORK, save_network
from cases.shipfiles.ship_file import dump_ship
from cases.trial import STATES, Trial
from fitting.report.run_folder import RESULT, SHIP, data_rows, versions, write_json, write_whole
from residual.report.summary import judged_runs, outside_hybrid, residual_size
from residual.training.checkpoint import Store
from residual.training.hybrid import Trained
from residual.training.trainer import Outcome

CARRIED = ("coefficients", "correlation", "bands", "per_run")
"""Of the calibration's result.json, what still holds of the ship inside."""


def result(
    trained: Trained,
    model: str,
    trials: Sequence[Trial],
    validation: Sequence[Trial],
    scores: Mapping[str, dict],
    command: str,
    base: Mapping[str, Any],
) -> dict:
    """The content of ``result.json``. base: that of the run it started from, {} for a bare ship."""
    decision, scales, network = trained.decision, trained.scales, trained.network
    rates = ("du", "dv", "dr")
    assert trained.settings.step is not None
    return {
        "kind": "training",
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": command,
        "ship": trained.ship.name,
        "model": model,
        "kept": decision.kept,
        "decision": asdict(decision),
        "settings": asdict(trained.settings),
        "seed": trained.settings.seed,
        "seeds": [o.seed for o in trained.outcomes],
        "versions": {**versions(), "torch": metadata.version("torch")},
        "timings_s": {"train": trained.seconds, "seeds": [o.seconds for o in trained.outcomes]},
        "data": data_rows(trials),
        "validation_data": data_rows(validation),
        "per_seed": seed_rows(trained.outcomes, validation or trials),
        "bound": dict(zip(rates, network.bound, strict=True)) if network else None,
        "output_scale": dict(zip(rates, scales.output, strict=True)),
        "sigma": {
            "loss": dict(zip(STATES, scales.sigma, strict=True)),
            "held_out": dict(zip(STATES, scales.score, strict=True)),
        },
        "envelope": {
            name: [float(low), float(high)]
            for name, low, high in zip(
                trained.ship.features, scales.seen.min(axis=1), scales.seen.max(axis=1), strict=True
            )
        },
        "residual_size": residual_size(trained),
        "outside": outside_hybrid(trained.ship, validation, trained.settings.step, scales.seen),
        "scores": dict(scores),
        "calibration": {key: base.get(key) for key in ("created", "command", "converged")} if base else None,
        **{key: base[key] for key in CARRIED if key in base},
        "warnings": list(trained.warnings),
        "notices": [],
    }


def seed_rows(outcomes: Sequence[Outcome], judging: Sequence[Trial]) -> list[dict]:
    """How the training of each seed went, as plain values; judging: the trials whose runs judged it."""
    return [
        {
            "seed": o.seed,
            "status": o.status,
            "judged_by_part": o.fold,
            "judged_window": {"before": o.before[0], "after": o.after[0], "windows": o.held_out_windows},
            "judged_restarts": {"before": o.before[1], "after": o.after[1]},
            "judged_runs": judged_runs(o, judging),
            "stop_window": {"before": o.history[0][3], "after": min(row[3] for row in o.history)},
            "training_windows": o.windows,
            "learning_rate": o.rate,
            "restarts": o.restarts,
            "seconds": o.seconds,
            "history": [dict(zip(("epoch", "rollout_s", "loss", "stop"), h, strict=True)) for h in o.history],
        }
        for o in outcomes
    ]


def write_training(
    folder: Path,
    trained: Trained,
    content: dict,
    decorate: Callable[[Path], None] | None = None,
    store: Store | None = None,
) -> None:
    """Write the run folder whole or not at all; the network only where it was kept. store: as of ``write_kept``."""

    def fill(scratch: Path) -> None:
        what = "with a residual network (network.safetensors)" if trained.decision.kept else "no residual was kept"
        note = f"{trained.ship.name}, calibrated ship of mmg train: {what}."
        (scratch / SHIP).write_text(dump_ship(trained.ship.without_network(), note), encoding="utf-8")
        if trained.ship.network is not None:
            save_network(scratch / NETWORK, trained.ship.network, trained.ship)
        write_json(scratch / RESULT, content)
        if decorate:
            decorate(scratch)

    write_kept(folder, fill, store)


def write_kept(folder: Path, fill: Callable[[Path], None], store: Store | None) -> None:
    """A run folder written whole or not at all; one that holds nothing but finished seeds or an earlier, interrupted
    run of theirs (``store``) is replaced, and the seeds are kept.
    """

    def both(scratch: Path) -> None:
        if store:
            shutil.copytree(store.folder, scratch / store.folder.name)
        fill(scratch)

    write_whole(folder, both, replace=store is not None)
