"""How a network is trained: settings of a learned residual and of a black box."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from fitting.settings import setting
from mmg.errors import UnknownName, refusing

# Eq. 23 and Eq. 16 of Wakita et al. (2022), and that of the calibration of the ship
LOSSES = STATE, ACCELERATION, CALIBRATION = "state", "acceleration", "calibration"
KEEP = ("better", "always")  # Which ship is recommended: the better one as the decision says, or always the hybrid
# Augmentation of Wakita et al. (2024, Table 4): windows of I rows begin every I / first number, each is replaced by so
# many noisy copies as the second says. d-ref is ref on twice the data: who compares gives it all trials, others half.
SETS = {
    "ref": (1, 0), "sli2": (2, 0), "sli10": (10, 0), "jit2": (1, 2), "jit10": (1, 10), "sli2+jit2": (2, 2),
    "sli10+jit10": (10, 10), "d-ref": (1, 0),
}  # fmt: skip
# Feedforward (Wakita et al. 2024, 2025), standard RNN (2022, Eq. 7), RNN with m rows of memory (2022, Eq. 9).
KINDS = ("fnn", "rnn", "rnn-window")
MODELS = ("hybrid", *KINDS)  # What is trained


@refusing
@dataclass(frozen=True)
class TrainSettings:
    """How to train a residual on a calibrated ship: seeds seed, seed + 1, ...

    Each stage (length [s], share) of the ``curriculum`` gets its share of the epochs; ``clip`` limits the norm of
    gradients. ``sigma``: default a third of a ship length, 0.3 rad and the deviations of u, v, r. ``stop_after``: from
    this epoch on the rule of Wakita et al. (2024, Eq. 25) ends a training.
    """

    seeds: int = setting(5, "Trainings, from seeds one apart.", ge=1)
    seed: int = setting(0, "The first seed.")
    workers: int = setting(1, "Processes over which tasks are spread.", ge=1)
    width: int = setting(32, "Neurons of a hidden layer; default 32, black box 64.", ge=1)
    symmetric: bool = setting(True, "hybrid: port and starboard may differ.")
    penalty: float = setting(0.001, "Weight of residual^2; black box: of weights^2, default 1e-4.", ge=0)
    rate: float = setting(3e-3, "First learning rate of Adam.", gt=0)
    last_rate: float = setting(2e-5, "Last learning rate of Adam.", gt=0)
    clip: float = setting(1.0, "Largest norm of gradients.", gt=0)
    batch: int = setting(64, "Windows per gradient step.", ge=1)
    epochs: int = setting(80, "Passes over windows; default 80, black box 60.", ge=1)
    curriculum: tuple[tuple[float, float], ...] = setting(
        ((10.0, 0.3), (30.0, 0.7)), "Length [s] of windows and share of the epochs.", gt=0
    )
    stride: float = setting(5.0, "Seconds between windows.", gt=0)
    loss: str = setting("state", "state, acceleration or calibration.", choices=LOSSES)
    sigma: tuple[float, ...] | None = setting(None, "Sigma of x,y,psi,u,v,r in the loss.", count=6)
    method: str = setting("rk4", "Integration.", choices=("rk4", "euler"))
    step: float | None = setting(None, "Step of integration [s]; default 0.05 L/U.", gt=0)
    augment: str = setting("", "Of Wakita 2024: sli2, jit10, d-ref, ...", choices=(*SETS, ""))
    stop_after: int = setting(0, "Epochs after which a risen error ends it; 0: none.", ge=0)
    time_limit: float | None = setting(None, "Limit of the training [s].", gt=0)


MEMBERS = "Members of an ensemble (also --members): trainings from seeds one apart."
_OF = {f.name: f.metadata for f in fields(TrainSettings)}  # Help and limits, which other defaults do not change


@refusing
@dataclass(frozen=True)
class BlackBoxSettings(TrainSettings):
    """How to train a black box, beside what ``TrainSettings`` says; kind: one of KINDS."""

    seeds: int = field(default=5, metadata={**_OF["seeds"], "help": MEMBERS, "alias": "--members"})
    width: int = field(default=64, metadata=_OF["width"])
    penalty: float = field(default=1e-4, metadata=_OF["penalty"])
    epochs: int = field(default=60, metadata=_OF["epochs"])
    kind: str = "fnn"
    layers: int = setting(2, "fnn: hidden layers.", ge=1)
    memory: int = setting(2, "rnn-window: rows m; rnn: rows to warm up.", ge=1)
    zero: bool = setting(True, "fnn: need not be zero at the origin.")
    initial: int = setting(0, "Black box: rows that estimate first velocities.", ge=0)


def defaults_of(model: str) -> TrainSettings:
    """The settings of a ``model`` of MODELS, all of them the usual ones. Raises UserError for another name."""
    if model not in MODELS:
        raise UnknownName(f"--model {model}: unknown; choose one of {', '.join(MODELS)}")
    return TrainSettings() if model == "hybrid" else BlackBoxSettings(kind=model)


def settings_from(values: dict[str, Any]) -> TrainSettings:
    """Settings from their plain ``values``, as ``dataclasses.asdict`` gives them; unknown names are left out."""
    kind = BlackBoxSettings if "kind" in values else TrainSettings
    # version 0.1 wrote null for some of what now has a default
    known = {f.name: values[f.name] for f in fields(kind) if values.get(f.name) is not None}
    known["sigma"] = tuple(map(float, known.get("sigma") or ())) or None
    return kind(**known | {"curriculum": tuple((float(a), float(b)) for a, b in known["curriculum"])})
