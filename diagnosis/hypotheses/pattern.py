"""Whether a named effect acts as the trials show: with one size in every run, phase and range of motion and inputs.

A stranger that looks like a known effect in the mean differs from it somewhere: a slow rudder is the later the more it
moves. At the fit with the effect its slopes are summed over parts of the trials; with one size for all they vanish in
each part but for chance (score test of heterogeneity).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.evidence.tails import chi2_tail
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.found_again import other_trials
from diagnosis.hypotheses.left_findings import Pattern
from diagnosis.location.partings import RUN, partings
from mmg.errors import UserError

TESTS = "training and test trials"
"""Name of the way that parts the trials from those that took no part."""
LEAST = 20
"""Grid times of a part that counts."""
LEVEL_OF_PATTERN = 0.01
"""Probability by chance below which something is left beside the name."""


def pattern(
    steps: TransitionModel,
    data: GriddedTrials,
    found: Estimate,
    effects: Sequence[Candidate],
    tests: GriddedTrials | None = None,
) -> Pattern:
    """Test the ``effects`` of the fit ``found`` of ``steps`` to ``data`` for one size in all parts.

    tests: trials that took no part, which are one more part, or None. Returns the probability over all ways of parting
    the trials, and the way in which the parts differ most.
    """
    here = linearise_and_filter(steps, data, found)
    own = np.array([found.free.columns.index(c) for e in effects for c in e.columns])
    there = data.good.any(axis=2)
    white = here.white
    score = -np.einsum("krca,krc->kra", white[..., own], white[..., -1])
    score -= here.logdet_gradient[:, own] * np.where(there, 1.0 / np.maximum(there.sum(axis=0), 1), 0.0)[..., None]
    flat = white[..., :-1].reshape(-1, white.shape[-1] - 1)
    A = flat.T @ flat + np.eye(flat.shape[1])
    chances: dict[str, float] = {}
    for name, part in partings(steps, data, found).items():
        if name == RUN and found.free.by_run:  # each has its own size already
            continue
        groups = [g for g in range(int(part.max()) + 1) if (there & (part == g)).sum() >= LEAST]
        if len(groups) < 2:
            continue
        sums, cross, blocks = [], [], []
        for g in groups:
            inside = there & (part == g)
            columns = white[inside][..., :-1].reshape(-1, flat.shape[1])
            sums.append(score[inside].sum(axis=0))
            cross.append(columns[:, own].T @ columns)
            blocks.append(cross[-1][:, own])
        s, C = np.concatenate(sums), np.concatenate(cross)
        V = -C @ np.linalg.solve(A, C.T)
        q = len(own)
        for i, block in enumerate(blocks):
            V[i * q : (i + 1) * q, i * q : (i + 1) * q] += block
        values, vectors = np.linalg.eigh(0.5 * (V + V.T))
        kept = values > 0.02 * max(values.max(), 1e-300)
        T = float((((s @ vectors)[kept]) ** 2 / values[kept]).sum())
        chances[name] = chi2_tail(T, max(int(kept.sum()), 1))
    if tests is not None and not found.free.by_run:
        chances[TESTS] = _in_tests(steps, tests, found, effects)
    if not chances:
        return Pattern(1.0, "")
    worst = min(chances, key=chances.__getitem__)
    return Pattern(min(1.0, len(chances) * chances[worst]), worst)


def _in_tests(steps: TransitionModel, tests: GriddedTrials, found: Estimate, effects: Sequence[Candidate]) -> float:
    """Probability that chance has the test trials ask for other sizes; 1 where the ship cannot be followed there, or no
    time is left for it."""
    try:
        return other_trials(steps, tests, found).differs(effects)
    except (UserError, np.linalg.LinAlgError):
        return 1.0
