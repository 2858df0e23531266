"""What a ship's model leaves unexplained in short stretches of a long log, and how each candidate would change it.

A stretch begins at the measured state and lasts as long as the ship takes for ``LENGTHS`` ship lengths. The motion is
predicted under the logged inputs. The error of the prediction in six channels, along and across the heading at the
start, heading, u, v and r, is averaged over each quarter of the stretch: 24 numbers. A candidate is a parameter of an
effect that may change over the months. Its sensitivity is the change of the prediction at half its typical size,
divided by that half. Errors of an instrument that can be taken out of the log are: there the change is that of start
and measured motion. Along the prediction, which runs off where the rudder holds against a force that is not modelled,
a late turn rate would be late in turns that never were, and its size come out at a third.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from types import SimpleNamespace

import numpy as np

from cases.evidence.signals import MAD
from cases.inputs import model_inputs
from cases.operation.log import USUAL
from cases.shipfiles.effects import parameters, with_effects
from cases.shipfiles.ship_file import check_needs
from cases.trial import Trial
from fitting.nlp.prior import group_sums
from mmg.effects import EFFECTS
from mmg.errors import TooFewData, UserError
from mmg.motion.flow import STATES
from mmg.motion.frames import earth_to_body
from mmg.motion.froude import reference_speed
from mmg.rollout import Simulator
from mmg.ship import Ship

# Parameters that change with the months: of hull and loading, of instruments, of the steering gear.
CANDIDATES = ("fouling.share", "draft.share", "gyro.T", "gyro.share", "log_scale.share", "heading_bias.psi",
              "heading_bias.alone", "rudder_offset.delta", "control_delay.tau")  # fmt: skip

LENGTHS = 5.0  # Ship lengths travelled in a stretch at the usual speed. Set by hand.
QUARTERS = 4  # Parts of a stretch over each of which its errors are averaged. Set by hand.
CHANNELS = ("along", "across", "psi", "u", "v", "r")
# Degrees of freedom of Student's t that the errors of stretches are taken to follow, and passes of its estimate. The
# first is that of ``student`` (fitting/nlp/loss.py). Passes were set by hand.
FREEDOM, PASSES = 4.0, 20
SIZE = 0.5  # Share of its typical size at which the sensitivity to a candidate is taken. Set by hand.
# A stretch whose squared distance is so many usual ones was moved by what the log does not hold. Set by hand.
UNEXPLAINED = 8.0
BATCH = 300  # Windows that are predicted at a time. It bounds memory.


@dataclass(frozen=True)
class Innovations:
    """Of S stretches, F errors, J candidates.

    t: middle of each [s], (S,); window: number of its window, (S,); errors: measured less predicted, (S, F), SI;
    gains: errors by candidate, (S, F, J); candidates: their names; typical: their typical sizes (J,);
    channels: number of the channel of each error in CHANNELS (F,), fewer than 24 where a log has no positions.
    """

    t: np.ndarray
    window: np.ndarray
    errors: np.ndarray
    gains: np.ndarray
    candidates: tuple[str, ...]
    typical: np.ndarray
    channels: np.ndarray


def candidates_of(ship: Ship) -> tuple[str, ...]:
    """Those of CANDIDATES that ``ship`` can have, and does not have already."""
    possible = []
    for name in CANDIDATES:
        effect, _, symbol = name.partition(".")
        with suppress(UserError):  # she lacks what the effect changes
            check_needs(ship, effect, name)
            if effect not in ship.effects and symbol in {p.symbol for p in parameters(ship, effect)}:
                possible.append(name)
    return tuple(possible)


class Stretches:
    """Predicts the stretches of windows with a ``ship`` and its ``candidates``, one batch of windows after the other.
    symbols: coefficients of the ship that are candidates too; their prior standard deviations are the typical sizes."""

    def __init__(
        self, ship: Ship, candidates: Sequence[str], lengths: float = LENGTHS, symbols: Sequence[str] = ()
    ) -> None:
        names = list(dict.fromkeys(name.partition(".")[0] for name in candidates))
        rows = [f"{name}:{','.join(f'{p.symbol}={p.neutral}' for p in parameters(ship, name))}" for name in names]
        self.candidates, self.lengths = (*candidates, *symbols), lengths
        nothing = Trial("nothing", {"t": np.arange(3.0), **dict.fromkeys(STATES, np.zeros(3))})
        self.logs = [j for j, name in enumerate(candidates) if corrected(nothing, ship, name, 0.0) is not None]
        self.simulator = Simulator(with_effects(ship, rows))
        sizes = {f"{name}.{p.symbol}": p.typical for name in names for p in parameters(ship, name)}
        self.typical = np.array([sizes.get(name) or ship.coefficients[name].std for name in self.candidates])
        self.duration = lengths * ship.particulars["L"] / (USUAL * reference_speed(ship.particulars["L"]))

    def of(self, rows: Iterable[tuple[int, Mapping[str, np.ndarray]]]) -> Innovations:
        """Innovations of windows given as (number, columns (N,)). Raises UserError where no stretch fits into any."""
        parts, windows = list[tuple[np.ndarray, ...]](), iter(rows)
        while batch := list(islice(windows, BATCH)):
            part = self._batch(batch)
            parts += [] if part is None else [part]
        if not parts:
            raise TooFewData("the log has no stretch under way that is long enough to compare with the model")
        t, window, errors, gains = (np.concatenate(values) for values in zip(*parts, strict=True))
        measured = np.isfinite(errors).any(axis=0)  # a log without positions has no errors along and across
        good = np.isfinite(errors[:, measured]).all(axis=1) & np.isfinite(gains[:, measured]).all(axis=(1, 2))
        channels = np.arange(errors.shape[1])[measured] % len(CHANNELS)
        errors, gains = errors[good][:, measured], gains[good][:, measured]
        return Innovations(t[good], window[good], errors, gains, self.candidates, self.typical, channels)

    def _batch(self, windows: Sequence[tuple[int, Mapping[str, np.ndarray]]]) -> tuple[np.ndarray, ...] | None:
        """t, window, errors and gains of a batch of windows; None where none is long enough."""
        step, cut = 0.0, []
        for number, columns in windows:
            t = columns["t"]
            if len(t) < 2:  # the files changed while they were read
                continue
            step = step or float(np.median(np.diff(t)))
            cut += [(number, piece) for piece in self._cut(columns, step)]
        if not cut:
            return None
        t = np.array([piece[0] for _, piece in cut])
        starts, controls, logs = (np.stack([piece[i] for _, piece in cut], axis=-1) for i in (1, 2, 3))
        h, start, measured = self._step(step)[1], starts[0], logs[0]
        base = self._predicted(start, controls, h, None)
        errors = _quarters(measured - base, start[2])
        gains = np.empty((*errors.shape, len(self.candidates)))
        for j, size in enumerate(self.typical):
            if j in self.logs:  # the log without that error, predicted from its own start
                k = 1 + self.logs.index(j)
                corrected_errors = _quarters(logs[k] - self._predicted(starts[k], controls, h, None), start[2])
                gains[:, :, j] = (errors - corrected_errors) / (SIZE * size)
            else:
                gains[:, :, j] = _quarters(self._predicted(start, controls, h, j) - base, start[2]) / (SIZE * size)
        return t, np.array([n for n, _ in cut]), errors, gains

    def _step(self, step: float) -> tuple[int, float, int]:
        """Rows that make a step of the integration, its length [s], and steps of a stretch."""
        together = max(1, round(self.duration / (100 * step)))  # so that a stretch has about 100 steps
        return together, together * step, max(QUARTERS, round(self.duration / (together * step)) // QUARTERS * QUARTERS)

    def _cut(
        self, columns: Mapping[str, np.ndarray], step: float
    ) -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
        """Middle [s], start (V, 6), inputs (N, C) and measured states (V, N, 6) of each stretch of a window: the V are
        the log as it is, and with each of ``logs`` taken out at half its typical size."""
        together, h, N = self._step(step)
        trial = Trial("window", dict(columns))
        controls = model_inputs(trial, self.simulator.ship.inputs).array
        ship, sizes = self.simulator.ship, SIZE * self.typical
        logs = [corrected(trial, ship, self.candidates[j], sizes[j]) for j in self.logs]
        states = np.stack([trial.states, *(log for log in logs if log is not None)])
        side = max(1, round(0.015 * N)) * together  # rows to either side of the start whose mean it is: less noise
        need, pieces = N * together + 2 * side, []
        around = np.arange(2 * (together // 2) + 1) - together // 2  # rows about a node whose mean is its measurement
        for first in range(0, len(trial) - need + 1, N * together):
            begin = first + side
            start = states[:, first : first + 2 * side + 1].mean(axis=1)
            nodes = begin + together * np.arange(1, N + 1)
            measured = states[:, nodes[:, None] + around].mean(axis=2)
            inputs = controls[begin : begin + N * together].reshape(N, together, -1).mean(axis=1)
            pieces.append((float(trial.t[begin] + 0.5 * N * h), start, inputs, measured))
        return pieces

    def _predicted(self, start: np.ndarray, controls: np.ndarray, h: float, j: int | None) -> np.ndarray:
        """Logged columns (N, 6, S) that the model predicts with the candidate ``j`` off by SIZE of its typical size."""
        theta = self.simulator.ship.values.copy()
        if j is not None:
            theta[self.simulator.ship.symbols.index(self.candidates[j])] += SIZE * self.typical[j]
        states = self.simulator.start(start, controls[0], theta)
        out = self.simulator.run(states, controls, h, theta)[1:]
        return self.simulator.columns(out, theta)


def corrected(trial: Trial, ship: Ship, name: str, size: float) -> np.ndarray | None:
    """States (N, 6) of a ``trial`` without the error of an instrument, the candidate ``name`` of a ``ship``, beyond its
    neutral value by ``size``; None where the error cannot be taken out of logged samples."""
    effect, _, symbol = name.partition(".")
    values = {p.symbol: p.neutral for p in parameters(ship, effect)}
    e, p = SimpleNamespace(**(values | {symbol: values[symbol] + size})), SimpleNamespace(**ship.particulars)
    states = EFFECTS[effect].corrected(trial.t, list(trial.states.T), e, p)
    return None if states is None else np.stack(states, axis=1)


def _quarters(difference: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Means (S, 24) over quarters of ``difference`` (N, 6, S), positions turned by the first ``heading`` (S,)."""
    d = difference.copy()
    d[:, 0], d[:, 1] = earth_to_body(difference[:, 0], difference[:, 1], heading)
    means = d.reshape(QUARTERS, -1, *d.shape[1:]).mean(axis=1)
    return means.transpose(2, 0, 1).reshape(len(heading), -1)


def scatter(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (F, F) and squared distances (S,) of ``errors`` (S, F) under Student's t about their
    median (Lange, Little and Taylor 1989, J Am Stat Assoc 84:881-896)."""
    centred = errors - np.median(errors, axis=0)
    size = MAD * np.median(np.abs(centred), axis=0) + 1e-300
    z, F = centred / size, errors.shape[1]  # metres and rad/s are of one order so: the inverse needs it
    cov = np.eye(F)
    for _ in range(PASSES):  # expectation-maximisation: weights, then the weighted covariance
        distance = np.einsum("sf,sf->s", z @ np.linalg.inv(cov + 1e-9 * np.eye(F)), z)
        weight = (FREEDOM + F) / (FREEDOM + distance)
        cov = (z * weight[:, None]).T @ z / len(z)
    return cov * np.outer(size, size), distance


def information_of(
    innovations: Innovations, explained: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information (S, J, J) and score (S, J) of each stretch on the candidates, and its squared distance over the usual
    one (S,), under the robust covariance of the errors.

    innovations: of the stretches; explained: errors (S, F) that are known, and count neither for the covariance nor the
    distance.
    """
    cov, distance = scatter(innovations.errors if explained is None else innovations.errors - explained)
    size = np.sqrt(np.diag(cov))
    inverse = np.linalg.inv(cov / np.outer(size, size) + 1e-9 * np.eye(len(cov)))
    g = innovations.gains / size[None, :, None]
    pulled = np.swapaxes(g, 1, 2) @ inverse
    return pulled @ g, np.einsum("sjf,sf->sj", pulled, innovations.errors / size), distance / np.median(distance)


# The choice ends where a further window adds less than this to the mean log information of a coefficient. Set by hand:
# 0.02 nats are 1 % of a standard deviation.
LEAST = 0.02


@dataclass(frozen=True)
class ChosenWindows:
    """Chosen windows. windows: their numbers, the one that tells most first; gains: log determinant of the information
    that each adds; of: windows that were looked at; all: log determinant that all of them together add."""

    windows: tuple[int, ...]
    gains: tuple[float, ...]
    of: int
    all: float


def window_information(innovations: Innovations) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the windows (W,) and their information (W, P, P) on the candidates of ``innovations``, in units of
    their typical sizes. Windows with a stretch that was moved by something else are left out."""
    information, _, distance = information_of(innovations)
    windows, position = np.unique(innovations.window, return_inverse=True)
    information *= np.outer(innovations.typical, innovations.typical)  # by candidate in SI -> in typical sizes
    total, worst = group_sums(position, information, len(windows)), np.zeros(len(windows))
    np.maximum.at(worst, position, distance)
    sound = worst < UNEXPLAINED
    return windows[sound], total[sound]


def choose_windows(innovations: Innovations, most: int) -> ChosenWindows:
    """Up to ``most`` windows of ``innovations``, whose candidates are coefficients: each adds most to the log
    determinant of the information that those before it have, beginning with the prior (typical sizes are its standard
    deviations)."""
    numbers, information = window_information(innovations)
    P = len(innovations.typical)
    precision, remaining, chosen, gains = np.eye(P), np.ones(len(numbers), bool), list[int](), list[float]()
    total = float(np.linalg.slogdet(precision + information.sum(axis=0))[1]) if len(numbers) else 0.0
    while remaining.any() and len(chosen) < most:  # greedy D-optimal design
        now = np.linalg.slogdet(precision)[1]
        gain = np.where(remaining, np.linalg.slogdet(precision + information)[1] - now, -np.inf)
        best = int(gain.argmax())
        if chosen and gain[best] < LEAST * P:
            break
        chosen.append(int(numbers[best]))
        gains.append(float(gain[best]))
        precision, remaining[best] = precision + information[best], False
    return ChosenWindows(tuple(chosen), tuple(gains), len(numbers), total)
