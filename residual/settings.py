"""How a network is trained: settings of a learned residual and of a black box."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

LOSSES = ("state", "acceleration")
"""Eq. 23 and Eq. 16 of Wakita et al. (2022)."""
KEEP = ("better", "always")
"""Which ship is recommended: the better one as the decision says, or always the hybrid."""
PATH = (0.3, 0.03, 0.01, 0.001)
"""Weights of a residual's penalty that a training takes one after the other, each from where the one before ended
(a path of weights as of Friedman et al. 2010, J Stat Softw 33(1)): windows that it does not train on choose among
them. The first hardly lets a residual grow; the last asks nothing of one as large as the ship's own accelerations."""
KINDS = ("fnn", "rnn", "rnn-window")
"""Feedforward (Wakita et al. 2024, 2025), standard RNN (2022, Eq. 7), RNN with m rows of memory (2022, Eq. 9)."""


@dataclass(frozen=True)
class TrainSettings:
    """How to train a residual on a calibrated ship.

    seeds: networks trained from seeds seed, seed + 1, ...; workers: processes; width: of the hidden layers; symmetric:
    whether a residual treats port and starboard alike (half of its neurons are then those of the mirror image);
    penalty: weight of the network's own penalty, None: those of PATH; rate, last_rate: of Adam; clip: of the norm of
    gradients; batch: windows per gradient step; epochs: passes over the windows under a weight of the penalty, of which
    each stage (length [s], share) of the curriculum gets its share; stride: seconds between windows; jitter: multiples
    of the noise of the instruments added to the states, anew at every step; augment: a named set of
    ``residual.training.augmentation.SETS`` instead of stride, "" for none; loss: "state" (Eq. 23) or "acceleration"
    (Eq. 16); method: "rk4" or "euler"; step: of grid and integration [s], None as in a calibration; block: length of
    blocks [s] where there are few runs; time_limit: [s] of the whole training.
    """

    seeds: int = 5
    seed: int = 0
    workers: int = 1
    width: int = 32
    symmetric: bool = True
    penalty: float | None = None
    rate: float = 3e-3
    last_rate: float = 2e-5
    clip: float = 1.0
    batch: int = 64
    epochs: int = 40
    curriculum: tuple[tuple[float, float], ...] = ((10.0, 0.3), (30.0, 0.7))
    stride: float = 5.0
    jitter: float = 0.0
    loss: str = "state"
    method: str = "rk4"
    step: float | None = None
    block: float = 150.0
    augment: str = ""
    time_limit: float | None = None

    @property
    def weights(self) -> tuple[float, ...]:
        """Weights of the penalty, in their order."""
        return PATH if self.penalty is None else (self.penalty,)


@dataclass(frozen=True)
class BlackBoxSettings(TrainSettings):
    """How to train a black box, beside what ``TrainSettings`` says.

    kind: one of KINDS; layers: hidden layers of a feedforward network; memory: rows m that a recurrent one runs along
    (of the standard one: rows before the start that warm it up, plus one); zero: whether a feedforward network is zero
    at the origin; initial: rows before the start from which its velocities are estimated, 0: they are as measured.
    """

    width: int = 64
    penalty: float | None = 1e-4
    epochs: int = 60
    kind: str = "fnn"
    layers: int = 2
    memory: int = 2
    zero: bool = True
    initial: int = 0


def settings_from(values: dict[str, Any]) -> TrainSettings:
    """Settings from their plain ``values``, as ``dataclasses.asdict`` gives them; unknown names are left out."""
    kind = BlackBoxSettings if "kind" in values else TrainSettings
    known = {f.name: values[f.name] for f in fields(kind) if f.name in values}
    return kind(**known | {"curriculum": tuple((float(a), float(b)) for a, b in known["curriculum"])})
