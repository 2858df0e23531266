"""How a network is trained: settings of a learned residual and of a black box."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

LOSSES = ("state", "acceleration")
"""Eq. 23 and Eq. 16 of Wakita et al. (2022)."""
KEEP = ("better", "always")
"""Which ship is recommended: the better one as the decision says, or always the hybrid."""
SETS = {
    "ref": (1, 0), "sli2": (2, 0), "sli10": (10, 0), "jit2": (1, 2), "jit10": (1, 10), "sli2+jit2": (2, 2),
    "sli10+jit10": (10, 10), "d-ref": (1, 0),
}  # fmt: skip
"""Augmentation of Wakita et al. (2024, Table 4): windows of I rows begin every I / first number, each is replaced by so
many noisy copies as the second says. d-ref is ref on twice the data: who compares gives it all trials, others half."""
KINDS = ("fnn", "rnn", "rnn-window")
"""Feedforward (Wakita et al. 2024, 2025), standard RNN (2022, Eq. 7), RNN with m rows of memory (2022, Eq. 9)."""


@dataclass(frozen=True)
class TrainSettings:
    """How to train a residual on a calibrated ship: seeds seed, seed + 1, ...

    The metadata of a field say in "help" what it is, and within which limits it lies: the options of ``mmg train`` and
    the keys of its settings file are made from them (``mmg_ident.settings``). Each stage (length [s], share) of the
    ``curriculum`` gets its share of the epochs; ``clip`` limits the norm of gradients.
    """

    seeds: int = field(default=5, metadata={"help": "Trainings, from seeds one apart.", "ge": 1})
    seed: int = field(default=0, metadata={"help": "The first seed."})
    workers: int = field(default=1, metadata={"help": "Processes over which tasks are spread.", "ge": 1})
    width: int = field(default=32, metadata={"help": "Neurons of a hidden layer; default 32, black box 64.", "ge": 1})
    symmetric: bool = field(default=True, metadata={"help": "hybrid: port and starboard may differ."})
    penalty: float = field(
        default=0.01, metadata={"help": "Weight of residual^2; black box: of weights^2, default 1e-4.", "ge": 0}
    )
    rate: float = field(default=3e-3, metadata={"help": "First learning rate of Adam.", "gt": 0})
    last_rate: float = field(default=2e-5, metadata={"help": "Last learning rate of Adam.", "gt": 0})
    clip: float = field(default=1.0, metadata={"help": "Largest norm of gradients.", "gt": 0})
    batch: int = field(default=64, metadata={"help": "Windows per gradient step.", "ge": 1})
    epochs: int = field(default=80, metadata={"help": "Passes over windows; default 80, black box 60.", "ge": 1})
    curriculum: tuple[tuple[float, float], ...] = field(
        default=((10.0, 0.3), (30.0, 0.7)), metadata={"help": "Length [s] of windows and share of the epochs."}
    )
    stride: float = field(default=5.0, metadata={"help": "Seconds between windows.", "gt": 0})
    jitter: float = field(default=0.0, metadata={"help": "Noise on states, in the instruments' noise.", "ge": 0})
    loss: str = field(default="state", metadata={"help": "state or acceleration (Wakita 2022).", "choices": LOSSES})
    method: str = field(default="rk4", metadata={"help": "Integration.", "choices": ("rk4", "euler")})
    step: float | None = field(default=None, metadata={"help": "Step of integration [s]; default 0.05 L/U.", "gt": 0})
    block: float = field(default=150.0, metadata={"help": "Length of blocks [s] of few runs.", "gt": 0})
    augment: str = field(
        default="", metadata={"help": "Of Wakita 2024: sli2, jit10, d-ref, ...", "choices": (*SETS, "")}
    )
    time_limit: float | None = field(default=None, metadata={"help": "Limit of the training [s].", "gt": 0})


_HELP = {f.name: f.metadata for f in fields(TrainSettings)}


@dataclass(frozen=True)
class BlackBoxSettings(TrainSettings):
    """How to train a black box, beside what ``TrainSettings`` says; kind: one of KINDS."""

    width: int = field(default=64, metadata=_HELP["width"])
    penalty: float = field(default=1e-4, metadata=_HELP["penalty"])
    epochs: int = field(default=60, metadata=_HELP["epochs"])
    kind: str = "fnn"
    layers: int = field(default=2, metadata={"help": "fnn: hidden layers.", "ge": 1})
    memory: int = field(default=2, metadata={"help": "rnn-window: rows m; rnn: rows to warm up.", "ge": 1})
    zero: bool = field(default=True, metadata={"help": "fnn: need not be zero at the origin."})
    initial: int = field(default=0, metadata={"help": "Black box: rows that estimate first velocities.", "ge": 0})


def settings_from(values: dict[str, Any]) -> TrainSettings:
    """Settings from their plain ``values``, as ``dataclasses.asdict`` gives them; unknown names are left out."""
    kind = BlackBoxSettings if "kind" in values else TrainSettings
    known = {f.name: values[f.name] for f in fields(kind) if f.name in values}
    return kind(**known | {"curriculum": tuple((float(a), float(b)) for a, b in known["curriculum"])})
