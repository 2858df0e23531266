"""What ``mmg train`` makes of its arguments: settings, and an interrupted run to continue."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mmg.errors import UserError, needs_torch

if TYPE_CHECKING:
    from residual.settings import TrainSettings

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
AGAIN = "the same command with --resume continues"
"""How to go on with a training that was stopped."""


def settings_of(model: str, **values: Any) -> TrainSettings:
    """Settings from the options, None where not given.

    model: of --model; values: of the other options by their names. Raises UserError for numbers that make no sense,
    and where torch cannot be imported.
    """
    from residual.settings import LOSSES, BlackBoxSettings, TrainSettings

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
    from residual.training.augmentation import SETS

    for name, known in (("loss", LOSSES), ("augment", ("", *SETS))):
        if values.get(name, known[0]) not in known:
            raise UserError(f"--{name} {values[name]}: unknown; choose one of {', '.join(k for k in known if k)}")
    strange = [name for name, kinds in ONLY.items() if name in values and model not in kinds]
    if strange:
        raise UserError(f"--{strange[0]} is not for --model {model}, only for {', '.join(ONLY[strange[0]])}")
    return TrainSettings(**values) if model == "hybrid" else BlackBoxSettings(kind=model, **values)


def is_complete(out: Path) -> bool:
    """Whether the run folder ``out`` holds a training of which no seed was stopped or left out.

    Raises UserError for a run of another command.
    """
    from fitting.report.run_folder import RESULT, read_result
    from residual.result import read_training

    if not (out / RESULT).exists():
        return False
    if read_result(out).get("kind") != "training":
        raise UserError(f"{out}: is no run of mmg train, so there is nothing to resume; choose another --out")
    return read_training(out).complete
