"""What chance gives, and what is left unexplained beside a name or without one, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fitting.report.run_folder import Real


@dataclass(frozen=True)
class Chance:
    """Probabilities that chance leaves as much in trials of a ship that lacks nothing: of all unnamed forms
    (anything_left), and of any candidate (largest_candidate); None without candidates.

    by: "law", the law of the tests to first order, or "simulation", a parametric bootstrap; draws: of either.
    """

    by: str
    draws: int
    anything_left: Real
    largest_candidate: float | None


@dataclass(frozen=True)
class UnexplainedChannel:
    """A channel of the unexplained force: rms with its 90 % interval, mean, and share of the energy of all channels."""

    force_rms: Real
    interval_90: tuple[Real, Real]
    mean: Real
    unit: str
    share: Real


@dataclass(frozen=True)
class UnexplainedTime:
    """A stretch of a trial in which the unexplained force is largest, in the channel that stands out most there.

    start, end: since the begin of the trial [s]; force_rms, mean: in the ``unit`` of the channel.
    """

    trial: str
    start: Real
    end: Real
    channel: str
    force_rms: Real
    mean: Real
    unit: str


@dataclass(frozen=True)
class UnexplainedForce:
    """What is left unexplained, as one force that depends on motion, inputs, wind and place in an unnamed way.

    p_value: probability that chance leaves as much; follows: rows variable, channel, explained (share of the channel's
    mean square), at, mean, the best first, of the force less its mean; times: where it is largest; advice: the
    manoeuvre that would tell more. force, std: (K, R, 3) [N, N, N m] and standard deviation, None after reading.
    """

    p_value: Real
    channels: Mapping[str, UnexplainedChannel]
    follows: tuple[Mapping[str, Any], ...]
    times: tuple[UnexplainedTime, ...]
    advice: str
    force: Any = None
    std: Any = None

    def to_dict(self) -> dict[str, Any]:
        """The part "unexplained_force" of ``diagnosis.json``."""
        return {name: value for name, value in vars(self).items() if name not in ("force", "std")}
