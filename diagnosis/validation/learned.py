"""How much of the test error a learned residual removes: trained like ``mmg train``, measured like ``held_out``.

The test trials take no part in the training.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import torch

from cases.inputs import step_means, straight_means
from cases.trial import Trial
from diagnosis.estimation.gridded_trials import grid_trials
from diagnosis.findings import LearnedResidual
from diagnosis.validation.held_out import errors, interval_of, window_length
from fitting.report.parts import Store
from mmg.errors import NoSolution, TooFewData
from mmg.model import Model, columns
from mmg.progress import OnProgress
from mmg.ship import Ship
from residual.decide import chosen, decide, judged_by_whole_runs
from residual.hybrid import HYBRID_KIND, Hybrid
from residual.settings import TrainSettings
from residual.system import TrainableSystem
from residual.train import restored, tasks_of, train_seeds

SEEDS = 3
"""Trainings. They are judged on three fifths of the runs; the five of ``mmg train`` cover all runs. Set by hand."""
NOTHING = 0.005
"""Share of the error up to which a reduction or growth is called none. Set by hand."""


class SteppedHybrid(TrainableSystem):
    """A ship with the mean of some learned residuals: hybrids of one ship with their rates averaged.

    It goes a step of h [s] at a time, as ``held_out.errors`` takes it.
    """

    def __init__(self, members: Sequence[Hybrid], h: float) -> None:
        super().__init__()
        self.members, self.h = members, h
        self.ship: Ship = members[0].physics.ship
        self.model: Model = members[0].physics.model
        self.late: tuple[str, ...] = ()

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return torch.stack([m.rates(z, controls) for m in self.members]).mean(dim=0)

    def settled(self, six: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) that are logged as (6, M) under inputs (C, M), what they remember settled."""
        return self.members[0].start(torch.as_tensor(six), torch.as_tensor(controls)).numpy()

    def logged(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Logged columns (K + 1, R, 6) of a path z (K + 1, R, S); theta: coefficients."""
        return columns(self.model, z.swapaxes(1, 2), theta).swapaxes(1, 2)

    @torch.no_grad()
    def follow(
        self,
        z: np.ndarray,
        inputs: np.ndarray,
        theta: np.ndarray,
        carried: np.ndarray | None = None,
        whole: np.ndarray | None = None,
    ) -> np.ndarray:
        """Paths (K + 1, R, S) from the first states of z (K + 1, R, S) under the mean inputs, the first C of
        ``inputs``; carried, whole: as of ``TransitionModel.follow``."""
        z = z.copy()
        mine = np.full(z.shape[2], carried is None)
        mine[[] if carried is None else carried] = True
        for k, held in enumerate(torch.as_tensor(inputs[..., : len(self.model.controls)])):
            end = self.step(torch.as_tensor(z[k].T), held.T, self.h).numpy().T
            z[k + 1] = np.where(mine | (False if whole is None else whole[k][:, None]), end, z[k + 1])
        return z


def measure_learned_residual(
    ship: Ship,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    settings: TrainSettings | None = None,
    progress: OnProgress | None = None,
    store: Store | None = None,
    straight: bool = False,
) -> LearnedResidual:
    """Train residuals on the training trials and measure how far the 30 s error of the test trials falls.

    ship: with the named effects; trials: for training; tests: only measured on; settings: how to train (default: as
    ``mmg train`` with SEEDS seeds; its seed also draws the runs); progress: called as the training goes on; store: of
    finished seeds, which are not trained again; straight: inputs are joined by lines between samples, not held. Returns
    the errors before and after. Raises UserError for too little data and where every training diverged,
    KeyboardInterrupt after Ctrl-C.
    """
    torch.set_num_threads(1)
    # it is measured with the instruments at the mean of the campaigns, and trained so
    ship = replace(ship.without_network(), campaigns={})
    length = float(ship.particulars["L"])
    settings = settings or TrainSettings(seeds=SEEDS)
    tasks = tasks_of(HYBRID_KIND, ship, trials, settings, means=straight_means if straight else step_means)
    h, seed = tasks[0].h, settings.seed
    data = grid_trials(tests, ship.inputs, length, h, straight)
    seconds = window_length(ship)

    def measured(members: Sequence[Hybrid]) -> tuple[np.ndarray, np.ndarray]:
        found = errors(SteppedHybrid(members, h), data, ship.values[:0], seconds)
        return found.mean, found.run

    before, run = measured([cast(Hybrid, tasks[0].system())])
    if not len(before):
        raise TooFewData(f"no test trial holds {seconds:.0f} s without a gap")
    outcomes, interrupted = train_seeds(tasks, progress, store)
    if interrupted:
        raise KeyboardInterrupt
    outcomes = [o for o in chosen(outcomes) if o.status != "diverged"]
    if not outcomes:
        raise NoSolution("every training diverged, also at lower rates")
    members = [m for m in restored(tasks[0], outcomes) if isinstance(m, Hybrid)]
    one, together = np.array([measured([m])[0] for m in members]), measured(members)[0]
    reductions = 1 - one.sum(axis=1) / before.sum()
    after, decision = one.mean(axis=0), decide(outcomes, judged_by_whole_runs(tasks))
    several = len(np.unique(run)) > 1
    found = LearnedResidual(
        mse_before=float(before.mean()),
        mse_after=float(after.mean()),
        reduction=float(reductions.mean()),
        interval_90=interval_of(before, after, run, np.random.default_rng(seed)) if several else None,
        seeds=tuple(o.seed for o in outcomes),
        reductions=tuple(reductions.tolist()),
        spread=float(reductions.std(ddof=1)) if len(reductions) > 1 else 0.0,
        together=float(1 - together.sum() / before.sum()),
        windows=len(before),
        kept=decision.kept,
        decision=decision.words,
        sentence="",
    )
    return replace(found, sentence=sentence_of(found))


def sentence_of(learned: LearnedResidual) -> str:
    """One sentence on how much the residual of ``learned`` removes; no more than chance is called none."""
    size, least = f"{abs(learned.reduction):.1%}", max(learned.spread, NOTHING)
    low, high = learned.interval_90 or (-np.inf, np.inf)
    chance = (
        f"90 % interval {low:+.1%} to {high:+.1%}"
        if learned.interval_90
        else "a single test trial does not tell how much of that is chance"
    )
    figures = f"{chance}; {len(learned.seeds)} training(s), ± {learned.spread:.1%} among them"
    what = "of the error of 30 s predictions of the test trials"
    if low > 0 and learned.reduction > least:
        return f"A learned residual closes {size} {what} ({figures}): so much of the remainder can be learned."
    if high < 0 and learned.reduction < -least:
        return f"A learned residual does not close any {what} but makes it {size} larger ({figures})."
    return (
        f"A learned residual does not close any {what} beyond chance (reduction {learned.reduction:+.1%}; {figures}): "
        "the unexplained remainder was not learned from these trials."
    )
