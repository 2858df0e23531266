"""From trials to the arrays of a multiple-shooting problem: grid, windows, intervals, nodes, targets, inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.inputs import STANDARD
from cases.trial import Trial
from fitting.nlp.grid import grids
from mmg.errors import UserError
from mmg.messages import Message


@dataclass(frozen=True)
class Segments:
    """Windows cut into shooting intervals of at most K steps, sorted by their number of steps, longest first
    (``by_run``: those of each run, one run after the other).

    M intervals, B nodes (one at each interval start and one at each window end), W windows.

    Attributes
    ----------
    h: step [s]; K: steps per interval.
    steps: (M,) steps of each interval; start, end: (M,) node at its start and end.
    controls: (K, C, M); targets, mask: (K - 1, 6, M) interior samples, mask 0 where none was measured.
    nodes, node_mask: (B, 6) measured states at the nodes.
    node_controls: (C, B) inputs at the nodes.
    window: (M,) and node_window: (B,) number of the window; run: (W,) number of the trial of each window.
    trials: names of the trials; duration: seconds of data in the windows.
    dropped: messages on what was left out.
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

    @property
    def intervals(self) -> int:
        return len(self.steps)

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

    def by_run(self) -> Segments:
        """The same with its intervals sorted by run, and longest first within each."""
        order = np.argsort(self.run[self.window], kind="stable")
        return replace(
            self,
            steps=self.steps[order],
            start=self.start[order],
            end=self.end[order],
            controls=np.ascontiguousarray(self.controls[:, :, order]),
            targets=self.targets[:, :, order],
            mask=self.mask[:, :, order],
            window=self.window[order],
        )

    def subset(self, windows: np.ndarray) -> Segments:
        """Only these windows (numbers in increasing order), renumbered from 0."""
        kept, nodes = np.isin(self.window, windows), np.isin(self.node_window, windows)
        position = np.cumsum(nodes) - 1
        number = {int(w): i for i, w in enumerate(windows)}
        return replace(
            self,
            steps=self.steps[kept],
            start=position[self.start[kept]],
            end=position[self.end[kept]],
            controls=np.ascontiguousarray(self.controls[:, :, kept]),
            targets=self.targets[:, :, kept],
            mask=self.mask[:, :, kept],
            nodes=self.nodes[nodes],
            node_mask=self.node_mask[nodes],
            node_controls=self.node_controls[:, nodes],
            window=np.array([number[int(w)] for w in self.window[kept]]),
            node_window=np.array([number[int(w)] for w in self.node_window[nodes]]),
            run=self.run[windows],
            duration=float(self.steps[kept].sum() * self.h),
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
    run: list[int] = []
    short: dict[str, float] = {}
    # start node, end node, window, inputs, interior
    spans: list[tuple[int, int, int, np.ndarray, np.ndarray]] = []
    node_window: list[int] = []
    seconds = 0.0
    for number, trial in enumerate(trials):
        for grid in grids(trial, h, inputs):
            total = len(grid.controls)
            if total < least:
                short[trial.name] = short.get(trial.name, 0.0) + total * h
                continue
            parts = max(1, round(total * h / window))
            for first, last in _even(total, parts):
                w = len(run)
                run.append(number)
                seconds += (last - first) * h
                starts = list(range(first, last, K))
                nodes.append(grid.states[first])
                node_window.append(w)
                for s in starts:
                    e = min(s + K, last)
                    nodes.append(grid.states[e])
                    node_window.append(w)
                    spans.append((len(nodes) - 2, len(nodes) - 1, w, grid.controls[s:e], grid.states[s + 1 : e]))
    dropped = [
        Message(f"{name}: {s:.0f} s in pieces too short between gaps were left out", "short_pieces_left_out")
        for name, s in short.items()
    ]
    if not spans:
        raise UserError(
            f"{', '.join(t.name for t in trials)}: nothing to fit, no piece is longer than {least * h:g} s "
            "without a gap; use longer records or a smaller --step"
        )
    spans.sort(key=lambda span: -len(span[3]))
    controls, targets, mask, node_controls = _stacked(spans, K, len(nodes))
    measured = np.array(nodes)
    return Segments(
        h=h,
        K=K,
        steps=np.array([len(s[3]) for s in spans]),
        start=np.array([s[0] for s in spans]),
        end=np.array([s[1] for s in spans]),
        controls=controls,
        targets=targets,
        mask=mask,
        nodes=np.nan_to_num(measured),
        node_mask=np.isfinite(measured).astype(float),
        node_controls=node_controls,
        window=np.array([s[2] for s in spans]),
        node_window=np.array(node_window),
        run=np.array(run),
        trials=tuple(t.name for t in trials),
        duration=seconds,
        dropped=tuple(dropped),
    )


def _stacked(
    spans: list[tuple[int, int, int, np.ndarray, np.ndarray]], K: int, nodes: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Inputs (K, C, M), interior samples and their mask (K - 1, 6, M), inputs at the nodes (C, B)."""
    M = len(spans)
    controls = np.zeros((K, spans[0][3].shape[1], M))
    targets, mask = np.zeros((max(K - 1, 0), 6, M)), np.zeros((max(K - 1, 0), 6, M))
    for i, (_, _, _, held, interior) in enumerate(spans):
        controls[: len(held), :, i] = held
        targets[: len(interior), :, i] = np.nan_to_num(interior)
        mask[: len(interior), :, i] = np.isfinite(interior)
    node_controls = np.empty((controls.shape[1], nodes))
    for _, end, _, held, _ in spans:
        node_controls[:, end] = held[-1]
    for start, _, _, held, _ in spans:
        node_controls[:, start] = held[0]
    return controls, targets, mask, node_controls


def _even(total: int, parts: int) -> list[tuple[int, int]]:
    """``total`` steps divided into ``parts`` nearly equal ranges."""
    edges = np.linspace(0, total, parts + 1).round().astype(int)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
