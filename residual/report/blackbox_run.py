"""The run folder of a black box: its network, the ship that named its inputs, result.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path

from cases.shipfiles.network_file import NETWORK
from cases.shipfiles.ship_file import dump_ship
from cases.trial import STATES, Trial
from fitting.report.run_folder import RESULT, START, data_rows, versions, write_json
from mmg.network import features_of
from mmg.ship import Ship
from residual.blackbox.file import save_box
from residual.blackbox.models import TrainedBox
from residual.report.hybrid_run import seed_rows, write_kept
from residual.report.summary import outside_box
from residual.training.checkpoint import Store


def result(
    trained: TrainedBox,
    trials: Sequence[Trial],
    validation: Sequence[Trial],
    scores: Mapping[str, dict],
    command: str,
    beside: str = "",
) -> dict:
    """The content of ``result.json``. beside: what its scores before are of, in words."""
    scales, settings = trained.scales, trained.settings
    lower, upper = scales.seen.min(axis=1), scales.seen.max(axis=1)
    names = features_of(trained.box.actuators)
    return {
        "kind": "training",
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": command,
        "ship": trained.box.ship,
        "model": settings.kind,
        "settings": asdict(settings),
        "seed": settings.seed,
        "seeds": [o.seed for o in trained.outcomes],
        "versions": {**versions(), "torch": metadata.version("torch")},
        "timings_s": {"train": trained.seconds, "seeds": [o.seconds for o in trained.outcomes]},
        "data": data_rows(trials),
        "validation_data": data_rows(validation),
        "per_seed": seed_rows(trained.outcomes, validation or trials),
        "sigma": {
            "loss": dict(zip(STATES, scales.sigma, strict=True)),
            "held_out": dict(zip(STATES, scales.score, strict=True)),
        },
        "envelope": {name: [float(low), float(high)] for name, low, high in zip(names, lower, upper, strict=True)},
        "outside": outside_box(names, trained.box.actuators, validation, trained.box.h, scales.seen),
        "beside": beside,
        "scores": dict(scores),
        "warnings": list(trained.warnings),
        "notices": [],
    }


def write_box(
    folder: Path,
    trained: TrainedBox,
    ship: Ship,
    content: dict,
    decorate: Callable[[Path], None] | None = None,
    store: Store | None = None,
) -> None:
    """Write the run folder whole or not at all. No ship.toml: a black box is no ship. store: as of ``write_kept``."""

    def fill(scratch: Path) -> None:
        note = f"{ship.name}: the ship whose inputs the black box takes; nothing else of it is used."
        (scratch / START).write_text(dump_ship(ship.without_network(), note), encoding="utf-8")
        save_box(scratch / NETWORK, trained.box, trained.scales)
        write_json(scratch / RESULT, content)
        if decorate:
            decorate(scratch)

    write_kept(folder, fill, store)
