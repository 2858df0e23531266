"""Trials cut into stretches, and into the arrays of a multiple-shooting problem.

``pieces_of`` puts trials on a uniform grid of time: pieces without gaps, interpolated states, mean inputs over each
step. What is fitted, filtered, trained on and predicted are ``Stretch``es of these, or of the samples as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cases.inputs import STANDARD, model_inputs, step_means
from cases.trial import Trial
from mmg.errors import TooFewData
from mmg.messages import Message
from mmg.motion.flow import STATES
from mmg.motion.froude import reference_speed


@dataclass(frozen=True)
class Record:
    """A run at its samples: t (N,) [s], logged states (N, 6), inputs of the model (N, C), usable rows (N,).

    Or a piece of it without gaps on a grid, its inputs (N - 1, C) the mean over each step, its states NaN where they
    were not measured. has_position: whether positions were; at samples x and y are zero without them. values: all
    coefficients (P,) of the ship in this run, None: those of the simulator.
    """

    t: np.ndarray
    states: np.ndarray
    controls: np.ndarray
    good: np.ndarray
    has_position: bool = True
    values: np.ndarray | None = None


@dataclass(frozen=True)
class Stretch:
    """Rows ``first`` .. ``last`` (inclusive) of a record; run: number of its trial."""

    record: Record
    first: int
    last: int
    run: int = 0

    @property
    def steps(self) -> int:
        return self.last - self.first

    @property
    def t(self) -> np.ndarray:
        """Times of its rows [s], (steps + 1,)."""
        return self.record.t[self.first : self.last + 1]

    @property
    def logged(self) -> np.ndarray:
        """The logged states, (steps + 1, 6)."""
        return self.record.states[self.first : self.last + 1]

    @property
    def controls(self) -> np.ndarray:
        """Inputs over its steps, (steps, C)."""
        return self.record.controls[self.first : self.last]

    def evenly(self, parts: int) -> list[Stretch]:
        """So many ``parts`` of nearly the same length that share only their end rows."""
        edges = self.first + np.linspace(0, self.steps, parts + 1).round().astype(int)
        return [replace(self, first=a, last=b) for a, b in pairwise(edges.tolist())]


def pieces_of(
    trials: Sequence[Trial], h: float, inputs: Sequence[str] = STANDARD, means: Callable[..., np.ndarray] = step_means
) -> list[Stretch]:
    """The gap-free pieces of ``trials`` on grids of step h [s], for a model with these ``inputs``, by run.

    means: how samples of the inputs (N, C) become means over steps (``step_means``: each is held until the next).
    """
    result = []
    for run, trial in enumerate(trials):
        states, controls = trial.states, model_inputs(trial, inputs).array
        # without x and y, which may be missing
        good = np.flatnonzero(np.isfinite(np.column_stack([states[:, 2:], controls])).all(axis=1))
        # two samples lost, and two steps; set by hand
        gaps = np.flatnonzero(np.diff(trial.t[good]) > max(2.5 * trial.dt, 2.0 * h)) + 1
        for rows in np.split(good, gaps) if len(good) else []:
            t = trial.t[rows]
            count = int(np.floor((t[-1] - t[0]) / h + 1e-9))  # 1e-9: a whole number of steps, but for rounding
            if count < 1:
                continue
            edges = t[0] + h * np.arange(count + 1)
            on_grid = np.column_stack([_interpolate(edges, t, states[rows, j]) for j in range(6)])
            record = Record(edges, on_grid, means(t, controls[rows], edges), np.ones(count + 1, dtype=bool))
            result.append(Stretch(record, 0, count, run))
    return result


def _interpolate(at: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Linear interpolation; NaN where a neighbouring sample is missing."""
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(len(at), np.nan)
    result = np.interp(at, t[good], values[good])
    if not good.all():  # numpy interpolates across what is missing; 1e-9 [s]: a sample that is hit but for rounding
        after = np.clip(np.searchsorted(t, at - 1e-9), 0, len(t) - 1)
        result[~(good[after] & good[np.maximum(after - 1, 0)])] = np.nan
    return result


def default_step(trials: Sequence[Trial], length: float) -> float:
    """Integration step [s] for ``trials`` of a ship of this ``length`` [m].

    A twentieth of the time to travel a ship length at rms speed, at least the sampling time, rounded to 1, 2 or 5 times
    a power of ten, and then to whole samples: states are compared where they were measured, not interpolated.
    """
    u2 = np.concatenate([t["u"] ** 2 + t["v"] ** 2 for t in trials])
    # a ship that hardly moves: Froude number .02
    speed = max(float(np.sqrt(np.nanmean(u2))), 0.02 * reference_speed(length))
    dt = max(t.dt for t in trials)
    wanted = max(0.05 * length / speed, dt)  # a twentieth of a length: set by hand
    decade = 10 ** np.floor(np.log10(wanted))
    step = float(min((c * decade for c in (1, 2, 5, 10)), key=lambda s: abs(np.log(s / wanted))))  # nearest by ratio
    samples = max(1, int(np.floor(step / dt + 0.5 - 1e-6)))  # halves go down: more samples are compared
    return step if abs(step / dt - samples) < 1e-3 else samples * dt  # a round number where it is whole samples


@dataclass(frozen=True)
class Chains:
    """The intervals of each of W windows, from its last one on: numbers (M,), those of window w from first (W + 1,) [w]
    on; start, end: (M,) nodes of each interval."""

    first: np.ndarray
    number: np.ndarray
    start: np.ndarray
    end: np.ndarray

    @classmethod
    def of(cls, window: np.ndarray, start: np.ndarray, end: np.ndarray) -> Chains:
        """window, start, end: (M,) of each interval; nodes follow each other in time."""
        order = np.lexsort((-start, window))  # the last key sorts first: by window, then backwards in time
        first = np.concatenate([[0], np.cumsum(np.bincount(window))])
        return cls(*(np.ascontiguousarray(a, dtype=np.int64) for a in (first, order, start, end)))


@dataclass(frozen=True)
class Segments:
    """Windows cut into shooting intervals of at most K steps, sorted by their number of steps, longest first.

    M intervals, B nodes (one at each interval start and one at each window end), W windows.

    h: step [s].
    steps: (M,) steps of each interval; start, end: (M,) node at its start and end.
    controls: (K, C, M); targets, mask: (K - 1, 6, M) interior samples, mask 0 where none was measured.
    nodes, node_mask: (B, 6) measured states at the nodes.
    node_controls: (C, B) inputs at the nodes.
    window: (M,) and node_window: (B,) number of the window; run: (W,) number of the trial of each window.
    trials: names of the trials; duration: seconds of data in the windows.
    dropped: messages on what was left out.
    variance: (W, 6) of the measured states where they were derived, as their trials state it; None: 0 everywhere.
    began: (W,) time of the trial at which each window begins [s]; empty where nobody asks.
    """

    h: float
    steps: np.ndarray
    start: np.ndarray
    end: np.ndarray
    controls: np.ndarray
    targets: np.ndarray
    mask: np.ndarray
    nodes: np.ndarray
    node_mask: np.ndarray
    node_controls: np.ndarray
    window: np.ndarray
    node_window: np.ndarray
    run: np.ndarray
    trials: tuple[str, ...]
    duration: float
    dropped: tuple[Message, ...] = ()
    variance: np.ndarray | None = None
    began: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def intervals(self) -> int:
        return len(self.steps)

    @cached_property
    def chains(self) -> Chains:
        """The intervals of each window, from its last one on."""
        return Chains.of(self.window, self.start, self.end)

    def variances(self, sigma: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Variances of samples at nodes (B, 6) and inside (1, 6, M): ``sigma`` (6,) squared, and where a state was
        derived the variance that its trial states, as often as residuals of the channel are correlated, ``tau`` (6,).
        """
        noise = sigma**2
        if self.variance is None:
            return np.broadcast_to(noise, self.nodes.shape), noise[None, :, None]
        derived = self.variance * tau
        return noise + derived[self.node_window], noise[None, :, None] + derived[self.window].T[None]

    def pinned(self) -> np.ndarray:
        """Node mask (B, 6) in which a channel that a window never measures is pinned at the window's first node."""
        mask = self.node_mask.copy()
        measured = np.zeros((len(self.run), 6))
        np.add.at(measured, self.node_window, self.node_mask)  # .at: many nodes belong to one window
        np.add.at(measured, self.window, self.mask.sum(axis=0).T)
        first = np.unique(self.node_window, return_index=True)[1]
        for w, b in enumerate(first):
            mask[b, measured[w] == 0] = 1.0  # else nothing holds that channel, and the Hessian is singular
        return mask

    def subset(self, windows: np.ndarray) -> Segments:
        """Only these windows (numbers in increasing order), renumbered from 0."""
        kept, nodes = np.isin(self.window, windows), np.isin(self.node_window, windows)
        names = ("steps", "start", "end", "window", "controls", "targets", "mask")
        part = {name: np.ascontiguousarray(getattr(self, name)[..., kept]) for name in names}
        position = np.cumsum(nodes) - 1  # new number of each node that stays
        renumbered = {name: position[part[name]] for name in ("start", "end")}
        return replace(
            self,
            **{**part, **renumbered, "window": np.searchsorted(windows, part["window"])},
            nodes=self.nodes[nodes],
            node_mask=self.node_mask[nodes],
            node_controls=self.node_controls[:, nodes],
            node_window=np.searchsorted(windows, self.node_window[nodes]),
            run=self.run[windows],
            variance=None if self.variance is None else self.variance[windows],
            began=self.began[windows] if len(self.began) else self.began,
            duration=float(part["steps"].sum() * self.h),
        )


def cut(
    trials: Sequence[Trial],
    h: float,
    window: float,
    K: int = 10,
    shortest: float | None = None,
    inputs: Sequence[str] = STANDARD,
) -> Segments:
    """Segments of ``trials``: windows of about ``window`` [s], cut into intervals of at most K steps of h [s].

    inputs: names of the model's. A piece without gaps is divided evenly into windows; one shorter than ``shortest`` [s]
    (default 10 steps) is left out, with a message. Raises UserError when nothing is left.
    """
    least = round((10 * h if shortest is None else shortest) / h)
    nodes: list[np.ndarray] = []
    node_window: list[int] = []
    run: list[int] = []
    began: list[float] = []
    short: dict[str, float] = {}
    spans: list[_Span] = []
    for piece in pieces_of(trials, h, inputs):
        if piece.steps < least:
            name = trials[piece.run].name
            short[name] = short.get(name, 0.0) + piece.steps * h
            continue
        # evenly: no short rest
        for part in piece.evenly(max(1, round(piece.steps * h / window))):
            joints = [*range(0, part.steps, K), part.steps]  # the last interval may be shorter
            for s, e in pairwise(joints):
                spans.append(_Span(len(nodes) + s // K, len(run), part.controls[s:e], part.logged[s + 1 : e]))
            nodes += [part.logged[row] for row in joints]
            node_window += [len(run)] * len(joints)
            run.append(piece.run)
            began.append(float(part.t[0]))
    dropped = [
        Message(f"{name}: {s:.0f} s in pieces too short between gaps were left out", "short_pieces_left_out")
        for name, s in short.items()
    ]
    if not spans:
        raise TooFewData(
            f"{', '.join(t.name for t in trials)}: nothing to fit, no piece is longer than {least * h:g} s "
            "without a gap; use longer records or a smaller --step"
        )
    # of the states that trials say were derived
    variance = np.array([[trials[number].std.get(name, 0.0) ** 2 for name in STATES] for number in run])
    spans.sort(key=lambda span: -len(span.controls))  # vectors of the kernel are filled with intervals of like length
    start, steps = np.array([s.start for s in spans]), np.array([len(s.controls) for s in spans])
    measured = np.array(nodes)
    controls = np.zeros((K, spans[0].controls.shape[1], len(spans)))
    targets, mask = np.zeros((2, max(K - 1, 0), 6, len(spans)))
    for i, span in enumerate(spans):
        controls[: len(span.controls), :, i] = span.controls
        targets[: len(span.inside), :, i] = np.nan_to_num(span.inside)
        mask[: len(span.inside), :, i] = np.isfinite(span.inside)
    node_controls = np.empty((controls.shape[1], len(nodes)))
    # last nodes have no interval of their own
    node_controls[:, start + 1] = np.transpose([span.controls[-1] for span in spans])
    node_controls[:, start] = controls[0]  # after the line before, so that inner nodes have what follows them
    return Segments(
        h=h,
        steps=steps,
        start=start,
        end=start + 1,
        controls=controls,
        targets=targets,
        mask=mask,
        nodes=np.nan_to_num(measured),
        node_mask=np.isfinite(measured).astype(float),
        node_controls=node_controls,
        window=np.array([s.window for s in spans]),
        node_window=np.array(node_window),
        run=np.array(run),
        trials=tuple(t.name for t in trials),
        duration=float(steps.sum() * h),
        dropped=tuple(dropped),
        variance=variance if any(trial.std for trial in trials) else None,
        began=np.array(began),
    )


class _Span(NamedTuple):
    """A shooting interval: its first node (the next one is its last), its window, inputs and states inside."""

    start: int
    window: int
    controls: np.ndarray
    inside: np.ndarray
