"""What ``mmg train`` makes of its arguments: settings, and what its two kinds of training need alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mmg_ident.commands.output import say

if TYPE_CHECKING:
    from cases.trial import Trial
    from mmg.ship import Ship
    from residual.training.checkpoint import Store
    from residual.training.trainer import Training


@dataclass(frozen=True)
class Order:
    """A training that was asked for. base: result.json of the run it starts from, {} for a bare ship; remarks: on the
    trials; store: where finished seeds are kept; began: ``time.perf_counter()`` at the start; say: takes what is told.
    """

    ship: Ship
    trials: Sequence[Trial]
    held_out: Sequence[Trial]
    settings: Training
    base: dict[str, Any]
    remarks: Sequence[str]
    command: str
    out: Path
    json: bool
    store: Store
    began: float
    say: Callable[[str], None] = say


def settings_of(model: str, **values: Any) -> Training:
    """Settings from the options, None where not given; UserError without torch and for numbers that make no sense."""
    from mmg.errors import UserError
    from mmg_ident.commands.output import needs_torch

    if model not in MODELS:
        raise UserError(f"--model {model}: unknown; choose one of {', '.join(MODELS)}")
    values = {name: value for name, value in values.items() if value is not None}
    for name in ("seeds", "workers", "epochs", "width", "batch", "layers", "memory"):
        if not values.get(name, 1) >= 1:
            raise UserError(f"--{name} {values[name]} must be at least 1")
    for name in ("rate", "step", "time_limit"):
        if not 0 < values.get(name, 1.0) < float("inf"):
            raise UserError(f"--{name.replace('_', '-')} {values[name]:g} must be positive")
    for name in ("penalty", "jitter", "initial"):
        if not 0 <= values.get(name, 0) < float("inf"):
            raise UserError(f"--{name} {values[name]:g} must not be negative")
    needs_torch("mmg train")
    from residual.blackbox.models import BoxTraining
    from residual.training.augmentation import SETS
    from residual.training.trainer import LOSSES, Training

    for name, known in (("loss", LOSSES), ("augment", ("", *SETS))):
        if values[name] not in known:
            raise UserError(f"--{name} {values[name]}: unknown; choose one of {', '.join(k for k in known if k)}")
    strange = [name for name, kinds in ONLY.items() if name in values and model not in kinds]
    if strange:
        raise UserError(f"--{strange[0]} is not for --model {model}, only for {', '.join(ONLY[strange[0]])}")
    return Training(**values) if model == "hybrid" else BoxTraining(kind=model, **values)


MODELS = ("hybrid", "fnn", "rnn", "rnn-window")
"""What --model may be."""
ONLY = {
    "layers": ("fnn",),
    "zero": ("fnn",),
    "memory": ("rnn", "rnn-window"),
    "initial": MODELS[1:],
    "symmetric": ("hybrid",),
}
"""Options that only some models take."""


def store_of(
    out: Path, resume: bool, model: str, settings: Training, ship: Ship, trials: Sequence[Trial], held: Sequence[Trial]
) -> Store:
    """Where the finished seeds of this training are, or will be, kept; with what must be the same to continue it."""
    from dataclasses import asdict

    from residual.training import checkpoint as c

    about = {
        "--model": model,
        "settings": c.settings_of(asdict(settings)),
        "ship": c.hash_of_ship(ship),
        "trial files": c.hashes_of_trials(trials),
        "--validate": c.hashes_of_trials(held),
    }
    return c.Store(out / "training", about, resume and out.exists())


def is_complete(out: Path) -> bool:
    """Whether a run folder holds a training of which no seed was stopped or left out. UserError for other runs."""
    from fitting.report.run_folder import RESULT, read_result
    from mmg.errors import UserError

    if not (out / RESULT).exists():
        return False
    result = read_result(out)
    if result.get("kind") != "training":
        raise UserError(f"{out}: is no run of mmg train, so there is nothing to resume; choose another --out")
    ended = [row["status"] for row in result["per_seed"]]
    return len(ended) == result["settings"]["seeds"] and "stopped" not in ended


def guarded(work: Callable[[], int], store: Store, again: str) -> int:
    """``work()``; what it began and is of no use is removed after an error, and kept after Ctrl-C.

    again: words on how to continue.
    """
    from mmg.errors import UserError

    try:
        return work()
    except UserError:
        store.discard()
        raise
    except KeyboardInterrupt:
        if not store.folder.is_dir():
            raise
        say(f"mmg: interrupted; what was finished is in {store.folder}: {again}")
        return 130


AGAIN = "the same command with --resume continues"
"""How to go on with a training that was stopped."""
