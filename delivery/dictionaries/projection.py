"""Least-squares projection of a ship's forces on the form of another model, and the sentence on its error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from delivery.dictionaries.motions import Motions
from mmg.errors import Unsupported
from mmg.messages import Message

CHANNELS = (("surge", "X", "N"), ("sway", "Y", "N"), ("yaw", "N", "N m"))
WORST = 0.5
"""Share [-] of a channel's force (RMS) beyond which a projection is refused: judgement."""
PULL = 0.1
"""Weight [-] with which a parameter is drawn to where it starts, by that of an error as large as the force: judgement,
little enough to leave what the motions determine."""


@dataclass(frozen=True)
class ChannelError:
    """How far a projection is off in one channel over M motions.

    force, error: RMS [N or N m] of the force that the target needs, and of what its form lacks of it.
    """

    channel: str
    symbol: str
    unit: str
    force: float
    error: float

    @property
    def share(self) -> float:
        """Error by force [-]."""
        return self.error / self.force if self.force > 0 else 0.0


def channel_errors(needed: np.ndarray, projected: np.ndarray) -> tuple[ChannelError, ...]:
    """Errors in surge, sway and yaw. needed, projected: X, Y, N (3, M): needed by the target, and given by its form."""
    force, error = (np.sqrt(np.mean(a**2, axis=1)) for a in (needed, projected - needed))
    return tuple(ChannelError(*words, float(f), float(e)) for words, f, e in zip(CHANNELS, force, error, strict=True))


def check_errors(errors: tuple[ChannelError, ...], target: str, instead: str) -> None:
    """Raises UserError where a channel's error is too large a share. errors: by channel; target: words;
    instead: what to do."""
    worst = max(errors, key=lambda e: e.share)
    if worst.share > WORST:
        raise Unsupported(
            f"{target} cannot hold this ship: the error in {worst.channel} is {100 * worst.share:.0f} % of the force "
            f"(RMS), more than {100 * WORST:.0f} %; {instead}"
        )


def error_messages(errors: tuple[ChannelError, ...], samples: Motions, target: str) -> list[Message]:
    """What is to be said of a projection: error per channel, range, what is left out.

    errors: by channel; samples: motions of the ship; target: words.
    """
    shares = ", ".join(f"{e.channel} {100 * e.share:.1f} %" for e in errors)
    limits = ", ".join(f"{name} {low:.3g} .. {high:.3g}" for name, (low, high) in samples.limits.items())
    words = f"projected on {target}: error by net force (RMS) {shares}, over {len(samples.u)} motions"
    messages = [Message(words, "projection_error"), Message(f"range of the projection (SI): {limits}", "range")]
    return messages + [Message(line, "left_out") for line in samples.left_out]


def error_rows(errors: tuple[ChannelError, ...]) -> list[dict[str, float | str]]:
    """``errors`` as plain rows."""
    return [
        {"channel": e.channel, "force_rms": e.force, "error_rms": e.error, "unit": e.unit, "share": e.share}
        for e in errors
    ]


def fit_parameters(
    residual: Callable[[np.ndarray], np.ndarray], start: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """Parameters by name that make ``residual`` (a function of their values, (P,) -> (R,)) small in the mean square.

    start: values; bounds: of each; a parameter that the residual hardly knows stays near its start.
    """
    names, x0 = list(start), np.array(list(start.values()), dtype=float)
    low, high = (np.array([bounds[name][side] for name in names]) for side in (0, 1))
    x0 = np.clip(x0, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
    size = high - low

    def weighted(z: np.ndarray) -> np.ndarray:
        errors = residual(x0 + size * z)
        return np.concatenate([errors / np.sqrt(len(errors)), PULL * z])

    solution = least_squares(weighted, np.zeros(len(x0)), bounds=((low - x0) / size, (high - x0) / size), x_scale="jac")
    return dict(zip(names, (x0 + size * solution.x).tolist(), strict=True))


def linear_parameters(terms: Mapping[str, np.ndarray], force: np.ndarray) -> dict[str, float]:
    """Factors of ``terms`` (name -> (M,)) that add up to ``force`` (M,) in the least-squares sense."""
    columns = np.array(list(terms.values())).T
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0] = 1.0
    factors = np.linalg.lstsq(columns / size, force, rcond=1e-6)[0] / size
    return dict(zip(terms, factors.tolist(), strict=True))
