"""The loss of a calibration as single shooting: what is calibrated by can train a network on the same ship.

Multiple shooting joins its intervals at the optimum, so that each window is one rollout from its first state. What is
kept of the problem is what a rollout needs to be weighed as there: first states, inputs, targets, weights, the cost
with its correlation times, and values by campaign. It lies beside ``result.json``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from cases.trial import Trial
from fitting.calibration import Calibration
from fitting.nlp.loss import Loss
from fitting.nlp.problem import Problem
from fitting.report.run_folder import hashes_of_trials
from mmg.errors import BadValue, Unreadable

SCHEMA = 1  # Of that file; it grows when an older reader would misread it


@dataclass(frozen=True, repr=False)
class RolloutLoss:
    """W windows of at most N steps of ``h`` [s], SI: half the sum of the costs of the ``weights`` is the objective.

    starts: (S, W) states at their begin; controls: (N, C, W), held over each step; targets: (N + 1, 6, W) logged
    columns, the start among them; weights: of the same shape, 1 / sigma^2, 0 where nothing was measured and after the
    end of a window; cost: of residuals; symbols: the V coefficients that campaigns have for themselves; values: (V, W)
    of these; run: (W,) trial; began: (W,) its time at the start [s]; trials: their sha256.
    """

    h: float
    starts: np.ndarray
    controls: np.ndarray
    targets: np.ndarray
    weights: np.ndarray
    cost: Loss
    symbols: tuple[str, ...]
    values: np.ndarray
    run: np.ndarray
    began: np.ndarray
    trials: tuple[str, ...] = ()

    def __repr__(self) -> str:
        steps, _, windows = self.controls.shape
        return f"<RolloutLoss of {windows} windows of at most {steps * self.h:.4g} s, steps of {self.h:.3g} s>"

    @classmethod
    def of(cls, problem: Problem, x: np.ndarray) -> RolloutLoss:
        """The part of the objective of ``problem`` that samples have, as rollouts from the first nodes of ``x`` (n,).

        Captive tests, priors and the memory of first states are not in it: no network changes them.
        """
        seg, (nodes, p) = problem.segments, problem.split(x)
        W = len(seg.run)
        length = np.bincount(seg.window, seg.steps, W).astype(int)  # steps of each window
        controls = np.zeros((length.max(), seg.controls.shape[1], W))
        targets, weights = np.zeros((2, length.max() + 1, 6, W))
        row = np.zeros(W, dtype=int)
        for i in np.lexsort((seg.start, seg.window)):  # window by window, in time
            w, n, k = seg.window[i], seg.steps[i], row[seg.window[i]]
            # held beyond the end of the window, so that its rollout stays where ships are
            controls[k:, :, w] = seg.controls[n - 1, :, i]
            controls[k : k + n, :, w] = seg.controls[:n, :, i]
            targets[k + 1 : k + n, :, w] = seg.targets[: n - 1, :, i]
            weights[k + 1 : k + n, :, w] = problem.weight[: n - 1, :, i]
            for at, node in ((k, seg.start[i]), (k + n, seg.end[i])):
                targets[at, :, w], weights[at, :, w] = seg.nodes[node], problem.node_weight[node]
            row[w] += n
        first = np.unique(seg.node_window, return_index=True)[1]
        theta = np.atleast_2d(problem.coefficients(p))[problem.columns.window]
        symbols = problem.prior.constants
        own = [problem.ship.symbols.index(s) for s in symbols]
        starts, values = nodes[first].T.copy(), theta[:, own].T.copy()
        return cls(seg.h, starts, controls, targets, weights, problem.loss, symbols, values, seg.run, seg.began)

    @classmethod
    def of_calibration(cls, found: Calibration, trials: Sequence[Trial] = ()) -> RolloutLoss | None:
        """That of ``found`` on ``trials``, from the states with which multiple shooting ended; None of a draft, and
        where each run has constants of its own, which the calibrated ship lacks."""
        prior = found.problem.prior
        if found.draft or (prior.constants and not prior.campaign):
            return None
        return replace(cls.of(found.problem, found.solution.x), trials=_hashes(trials))

    def of_trials(self, trials: Sequence[Trial]) -> RolloutLoss | None:
        """With runs numbered as in ``trials``; None where these are not those of the calibration."""
        hashes = _hashes(trials)
        if sorted(hashes) != sorted(self.trials):
            return None
        return replace(self, trials=hashes, run=np.array([hashes.index(self.trials[k]) for k in self.run]))

    def save(self, path: Path) -> None:
        """Write it to ``path``. Raises OSError."""
        arrays = {name: np.ascontiguousarray(getattr(self, name)) for name in _ARRAYS}
        words = {"h": self.h, "cost": self.cost.name, "trials": self.trials, "symbols": self.symbols}
        about = {"schema": str(SCHEMA), "words": json.dumps(words)}
        save_file(arrays | {"tau": np.ascontiguousarray(self.cost.tau)}, path, about)
        path.chmod(0o644)  # safetensors gives it to its owner alone

    @classmethod
    def load(cls, path: Path) -> RolloutLoss:
        """That in the file ``path``. Raises UserError where it cannot be read or is of another version."""
        try:
            with safe_open(path, "np") as file:
                arrays, about = {name: file.get_tensor(name) for name in (*_ARRAYS, "tau")}, file.metadata()
            if (version := about["schema"]) == str(SCHEMA):
                words = json.loads(about["words"])
                cost, symbols = Loss(words["cost"], arrays.pop("tau")), tuple(words["symbols"])
                return cls(words["h"], cost=cost, trials=tuple(words["trials"]), symbols=symbols, **arrays)
        except (OSError, SafetensorError, KeyError, ValueError, TypeError):
            advice = "fit again, or train without --loss calibration"
            raise Unreadable(f"{path}: is no loss of a calibration; {advice}") from None
        raise BadValue(f"{path}: is of version {version}, this program reads {SCHEMA}; fit again")


def loss_in(path: Path) -> RolloutLoss | None:
    """That in the file ``path``; None where there is none. Raises UserError as ``RolloutLoss.load``."""
    return RolloutLoss.load(path) if path.exists() else None


def _hashes(trials: Sequence[Trial]) -> tuple[str, ...]:
    """Of each trial the sha256 of its file, or of its content where it has none."""
    return tuple(t.sha256 or own for t, own in zip(trials, hashes_of_trials(trials), strict=True))


_ARRAYS = ("starts", "controls", "targets", "weights", "values", "run", "began")  # What of it is an array
