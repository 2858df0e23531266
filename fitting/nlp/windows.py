"""From trials to the arrays of a multiple-shooting problem: grid, windows, intervals, nodes, targets, inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cases.inputs import STANDARD
from cases.trial import Trial
from fitting.nlp.elimination_c import Chains
from fitting.nlp.grid import grids
from mmg.errors import TooFewData
from mmg.messages import Message
from mmg.states import STATES


@dataclass(frozen=True)
class Segments:
    """Windows cut into shooting intervals of at most K steps, sorted by their number of steps, longest first.

    M intervals, B nodes (one at each interval start and one at each window end), W windows.

    h: step [s]; K: steps per interval.
    steps: (M,) steps of each interval; start, end: (M,) node at its start and end.
    controls: (K, C, M); targets, mask: (K - 1, 6, M) interior samples, mask 0 where none was measured.
    nodes, node_mask: (B, 6) measured states at the nodes.
    node_controls: (C, B) inputs at the nodes.
    window: (M,) and node_window: (B,) number of the window; run: (W,) number of the trial of each window.
    trials: names of the trials; duration: seconds of data in the windows.
    dropped: messages on what was left out.
    variance: (W, 6) of the measured states where they were derived, as their trials state it; None: 0 everywhere.
    """

    h: float
    K: int
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
        own = sigma**2
        if self.variance is None:
            return np.broadcast_to(own, self.nodes.shape), own[None, :, None]
        more = self.variance * tau
        return own + more[self.node_window], own[None, :, None] + more[self.window].T[None]

    def pinned(self) -> np.ndarray:
        """Node mask (B, 6) in which a channel that a window never measures is pinned at the window's first node."""
        mask = self.node_mask.copy()
        measured = np.zeros((len(self.run), 6))
        np.add.at(measured, self.node_window, self.node_mask)
        np.add.at(measured, self.window, self.mask.sum(axis=0).T)
        first = np.unique(self.node_window, return_index=True)[1]
        for w, b in enumerate(first):
            mask[b, measured[w] == 0] = 1.0
        return mask

    def subset(self, windows: np.ndarray) -> Segments:
        """Only these windows (numbers in increasing order), renumbered from 0."""
        kept, nodes = np.isin(self.window, windows), np.isin(self.node_window, windows)
        names = ("steps", "start", "end", "window", "controls", "targets", "mask")
        part = {name: np.ascontiguousarray(getattr(self, name)[..., kept]) for name in names}
        position = np.cumsum(nodes) - 1
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
    short: dict[str, float] = {}
    spans: list[_Span] = []
    for number, trial in enumerate(trials):
        for grid in grids(trial, h, inputs):
            total = len(grid.controls)
            if total < least:
                short[trial.name] = short.get(trial.name, 0.0) + total * h
                continue
            edges = np.linspace(0, total, max(1, round(total * h / window)) + 1).round().astype(int).tolist()
            for first, last in pairwise(edges):
                joints = [*range(first, last, K), last]
                for s, e in pairwise(joints):
                    node = len(nodes) + (s - first) // K
                    spans.append(_Span(node, len(run), grid.controls[s:e], grid.states[s + 1 : e]))
                nodes += [grid.states[row] for row in joints]
                node_window += [len(run)] * len(joints)
                run.append(number)
    dropped = [
        Message(f"{name}: {s:.0f} s in pieces too short between gaps were left out", "short_pieces_left_out")
        for name, s in short.items()
    ]
    if not spans:
        raise TooFewData(
            f"{', '.join(t.name for t in trials)}: nothing to fit, no piece is longer than {least * h:g} s "
            "without a gap; use longer records or a smaller --step"
        )
    spans.sort(key=lambda span: -len(span.controls))
    start, steps = np.array([s.start for s in spans]), np.array([len(s.controls) for s in spans])
    measured = np.array(nodes)
    controls = np.zeros((K, spans[0].controls.shape[1], len(spans)))
    targets, mask = np.zeros((2, max(K - 1, 0), 6, len(spans)))
    for i, span in enumerate(spans):
        controls[: len(span.controls), :, i] = span.controls
        targets[: len(span.inside), :, i] = np.nan_to_num(span.inside)
        mask[: len(span.inside), :, i] = np.isfinite(span.inside)
    node_controls = np.empty((controls.shape[1], len(nodes)))
    node_controls[:, start + 1] = np.transpose([span.controls[-1] for span in spans])
    node_controls[:, start] = controls[0]
    return Segments(
        h=h,
        K=K,
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
        variance=_variance(trials, run),
    )


def _variance(trials: Sequence[Trial], run: Sequence[int]) -> np.ndarray | None:
    """Variance (W, 6) of the states that trials say were derived, by window; None where none were."""
    if not any(trial.std for trial in trials):
        return None
    return np.array([[trials[number].std.get(name, 0.0) ** 2 for name in STATES] for number in run])


class _Span(NamedTuple):
    """A shooting interval: its first node (the next one is its last), its window, inputs and states inside."""

    start: int
    window: int
    controls: np.ndarray
    inside: np.ndarray
