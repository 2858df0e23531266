"""Test of parameters for different values in groups of runs, such as two campaigns.

About a fit that is common to all runs, the log likelihood of each run is quadratic in values of its own. A parameter is
tested for different means in the groups while all others are the same in all runs, except surroundings, which scatter
from run to run. What the parameter itself scatters between the runs of a group is estimated (random effects,
DerSimonian & Laird 1986), so that a difference between groups must be larger than that between runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.candidates import LOCAL, Candidate, Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors, active_states
from diagnosis.estimation.transition_model import TransitionModel
from fitting.uncertainty.group_test import (
    LEAST,
    GroupTest,
    by_group,
    contrasts,
    group_test,
    members_of,
    scatter_between,
)

COMMON = 3.0
"""Prior standard deviation of what an effect beside the fit may have in all runs alike, in typical sizes."""


@dataclass(frozen=True)
class RunSlopes:
    """The log likelihood of each of n runs about a fit, g r - 1/2 r G r, for values r (C,) of its own.

    columns: C parameters in typical sizes, the free ones of the fit first; g: (n, C); G: (n, C, C); pull, precision:
    (C,) slope and precision of the priors of values that all runs share; group: (n,) number of each run's group.
    """

    columns: tuple[Column, ...]
    g: np.ndarray
    G: np.ndarray
    pull: np.ndarray
    precision: np.ndarray
    group: np.ndarray

    def at(self, c: Candidate) -> list[int]:
        """Positions of the parameters of a candidate ``c``."""
        return [self.columns.index(x) for x in c.columns]


def run_slopes(
    steps: TransitionModel, data: GriddedTrials, runs: np.ndarray, found: Estimate, candidates: Sequence[Candidate]
) -> RunSlopes:
    """Linearise about a fit.

    steps: the transition model; data: the trials, whose ``run`` is the number of the group; runs: (R,) run of each
    window; found: the fit; candidates: those to be tested. Returns the slopes of each run.
    """
    passive = np.setdiff1d(np.arange(steps.S), active_states(steps, found.free.symbols, found.theta))
    z = found.path.z
    if len(passive):
        controls = acting(steps, data, found.theta).controls
        z = steps.with_passive_states(z, controls, found.theta, found.path.push, passive)
    sizes = {x: size for c in candidates for x, size in zip(c.columns, c.typical, strict=True)}
    more = [x for x in sizes if x not in found.free.columns]
    n, typical = len(more), np.array([sizes[x] for x in more])
    free = found.free + Priors(tuple(more), np.zeros(n), typical, np.full(n, -np.inf), np.full(n, np.inf))
    p = np.concatenate([found.p, np.zeros(n)])
    point = Point(found.theta, free, p, found.path.along(z), found.noise)
    here = linearise_and_filter(steps, data, point, np.arange(steps.S))
    grams = np.einsum("krca,krcb->rab", here.white, here.white, optimize=True)
    slopes = -(grams[:, :-1, -1] + here.logdet_gradient)
    names = np.unique(runs)
    unit = np.array([sizes.get(x, std) / std for x, std in zip(free.columns, free.std, strict=True)])
    g = np.array([slopes[runs == r].sum(axis=0) for r in names]) * unit
    G = np.array([grams[runs == r, :-1, :-1].sum(axis=0) for r in names]) * np.outer(unit, unit)
    group = np.array([data.run[runs == r][0] for r in names])
    precision = np.concatenate([unit[: len(found.p)] ** 2, np.full(n, COMMON**-2.0)])
    return RunSlopes(free.columns, g, G, -p * unit, precision, group)


def with_scatter(s: RunSlopes, scatter: Mapping[Column, float], but: Sequence[Column] = ()) -> RunSlopes:
    """The slopes ``s`` with some parameters free to differ from run to run.

    scatter: parameter -> standard deviation between runs, in typical sizes; but: parameters that stay the same. Returns
    slopes along the others.
    """
    at = [i for i, x in enumerate(s.columns) if x in scatter and x not in but]
    if not at:
        return s
    precision = np.diag([scatter[s.columns[i]] ** -2.0 for i in at])
    part = np.linalg.solve(s.G[:, at][:, :, at] + precision, np.concatenate([s.G[:, at], s.g[:, at, None]], axis=2))
    back = s.G[:, :, at] @ part
    return replace(s, G=s.G - back[..., :-1], g=s.g - back[..., -1])


def surroundings_scatter(s: RunSlopes, candidates: Sequence[Candidate]) -> dict[Column, float]:
    """How the surroundings among ``candidates`` scatter between the runs of a group, by the slopes ``s``.

    Returns parameter -> standard deviation [typical sizes].
    """
    out: dict[Column, float] = {}
    for c in (c for c in candidates if c.effect in LOCAL):
        std = scatter_between(*_own(s, s.at(c)), members_of(s.group, len(c.columns)), len(c.columns))
        out |= dict(zip(c.columns, std.tolist(), strict=True))
    return out


def candidate_test(s: RunSlopes, c: Candidate) -> GroupTest | None:
    """The test of a candidate ``c`` by the slopes ``s``. Returns None where the trials do not show a difference."""
    return group_test(*_own(s, s.at(c)), s.group, len(c.columns))


def _own(s: RunSlopes, at: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (n p,) and information (n p, n p) of values by run of p parameters, what runs share projected out."""
    n, p = len(s.g), len(at)
    rows = s.G[:, at].reshape(n * p, -1)
    total = s.G.sum(axis=0) + np.diag(s.precision)
    solved = np.linalg.solve(total, np.column_stack([rows.T, s.g.sum(axis=0) + s.pull]))
    S = -rows @ solved[:, :-1]
    for r in range(n):
        k = slice(r * p, (r + 1) * p)
        S[k, k] += s.G[r][np.ix_(at, at)]
    return s.g[:, at].ravel() - rows @ solved[:, -1], 0.5 * (S + S.T)


def imitated(s: RunSlopes, c: Candidate, other: Candidate) -> float:
    """How much of the difference that a candidate ``c`` shows another one imitates.

    s: slopes; other: the other one. Returns 1 where both say the same of these trials.
    """
    own = len(c.columns)
    at = [*s.at(c), *s.at(other)]
    g, S = _own(s, at)
    members = members_of(s.group, len(at))
    score, J, _ = contrasts(*by_group(g, S, members, np.full(len(at), LEAST)), len(at))
    first = np.tile(np.arange(len(at)) < own, len(J) // len(at))
    J11, J12, J22 = J[np.ix_(first, first)], J[np.ix_(first, ~first)], J[np.ix_(~first, ~first)]
    size = np.linalg.lstsq(J11, score[first], rcond=1e-9)[0]
    whole = float(size @ J11 @ size)
    return float(size @ J12 @ np.linalg.pinv(J22, rcond=1e-9) @ J12.T @ size) / whole if whole > 0 else 0.0
