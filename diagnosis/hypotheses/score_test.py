"""Score tests of all candidates at once: which effects would explain the residuals of a fitted hypothesis.

At the optimum of a hypothesis the slope of the marginal likelihood along a parameter that is not in it should vanish
but for chance (score test, Rao 1948). The slopes are those of residuals whitened by the filter, plus that of the log
determinant; what the coefficients of the hypothesis (with their priors) and the states at the start could imitate is
projected out. All slopes are jointly normal with a known covariance, which gives the law of the largest of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc

from diagnosis.estimation.candidates import Candidate, Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import DrivenColumns
from diagnosis.estimation.linearisation import Point, linearise_and_filter, path_of_all_states, timing_columns
from diagnosis.estimation.parameters import Priors, active_in_window
from diagnosis.estimation.transition_model import TransitionModel
from mmg.effects import EFFECTS
from mmg.motion.froude import time_scale

MEMORY = 5.0  # Time [s of a 3 m model] over which residuals may be correlated. Set by hand.


def memory_steps(length: float, h: float) -> int:
    """Steps of h [s] of that time for a ship of this ``length`` [m]."""
    return max(1, round(MEMORY * time_scale(length) / h))


def dispersion(
    columns: np.ndarray, white: np.ndarray, g: np.ndarray, S: np.ndarray, lags: int, rows: np.ndarray | None = None
) -> float:
    """Variance of the slopes g (c,) of some columns over their information S (c, c), in the mean, at least 1.

    columns: (K + 1, R, 6, c) whitened, free parameters projected out; white: (K + 1, R, 6) negative residual; lags:
    steps over which residuals may be correlated; rows: (k,) grid times of which alone columns and residual are given,
    which are zero at all others. The variance is that of Newey & West (1987), about what the columns explain.
    """
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))  # rounding
    kept = values > 1e-6 * max(values.max(), 1e-300)
    if not kept.any():
        return 1.0
    root = vectors[:, kept] / np.sqrt(values[kept])
    along = columns @ root
    size = (root.T @ g) * values[kept] / (1 + values[kept])  # shrunk as by a prior of unit variance: g is noisy
    each = np.einsum("krca,krc->kra", along, white + along @ size)
    if rows is not None:
        given, each = each, np.zeros((rows[-1] + 1, *each.shape[1:]))
        each[rows] = given
    lags = min(lags, len(each) - 1)
    weight = 1 - np.arange(1, lags + 1) / (lags + 1)  # Bartlett's, which keeps the sum positive
    covariances = [(each[lag:] * each[:-lag]).sum() for lag in range(1, lags + 1)]
    return max(1.0, float(((each**2).sum() + 2 * weight @ covariances) / kept.sum()))


@dataclass(frozen=True)
class Projected:
    """C columns with P free parameters projected out: slopes g (C,) of the log likelihood, their information S (C, C),
    and the multiples (P, C) of the free parameters' columns that were taken off."""

    g: np.ndarray
    S: np.ndarray
    taken: np.ndarray


def projected(gram: np.ndarray, logdet: np.ndarray, p: np.ndarray) -> Projected:
    """The columns after the first P of a linearisation without what these could imitate.

    gram: (P + C + 1, P + C + 1) products of the whitened columns, the negative residual last; logdet: (P + C,) slopes
    of half the log determinant; p: (P,) free parameters, in prior standard deviations.
    """
    P = len(p)
    slope = -(gram[:-1, -1] + logdet)
    slope[:P] -= p  # the prior pulls, too: at the optimum both vanish together
    taken = np.linalg.solve(gram[:P, :P] + np.eye(P), gram[:P, P:-1])
    # Schur complement of the free parameters
    return Projected(slope[P:] - taken.T @ slope[:P], gram[P:-1, P:-1] - gram[P:-1, :P] @ taken, taken)


# Draws of the joint law of all slopes, for the probability of the largest. Set by hand: a probability of 1 % is known
# to 0.16 %.
DRAWS = 4000
# Information on a parameter, in its typical sizes to the power -2, below which the trials do not move it.
EXCITED = 1e-3  # set by hand
SHOWS = 3.0  # Standard errors from which an effect would show. Set by hand.


@dataclass(frozen=True)
class Slopes:
    """The slopes of all candidates at a fitted hypothesis.

    columns: the parameters, P of them, in units of their typical size; g: (P,) slopes of the log likelihood, the
    hypothesis projected out; S: (P, P) their covariance; own: (P,) information before the projection; dispersion: ratio
    of the slopes' variance to that covariance where it is larger: of faults of instruments, as of sensors with a memory
    (the memory of forces is in the model), and of what a small error in the time of the inputs looks like; taken: (F,
    P) by how many prior standard deviations each free parameter of the hypothesis falls where a candidate's grows by
    its typical size, to first order; without rows where it was not asked.
    """

    columns: tuple[Column, ...]
    g: np.ndarray
    S: np.ndarray
    own: np.ndarray
    dispersion: Mapping[Candidate, float] = field(default_factory=dict)
    taken: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True)
class ScoreTest:
    """A candidate's test: T (chi-squared with ``degrees``), its probability by itself and as the largest of all;
    phi: (p,) first-order estimates [typical sizes]; absorbed: share of its information that coefficients imitate;
    errors: (p,) standard errors of phi, infinite where nothing is seen; dispersion: by which T was divided; taken: (F,
    p) as of ``Slopes``."""

    candidate: Candidate
    T: float
    degrees: int
    p_single: float
    p_value: float
    phi: np.ndarray
    absorbed: float
    excited: bool
    errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    dispersion: float = 1.0
    taken: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


def slopes(steps: TransitionModel, data: GriddedTrials, found: Point, candidates: Sequence[Candidate]) -> Slopes:
    """Linearise about a fit with all candidates as further columns.

    steps: the transition model; data: the trials; found: the fit; candidates: those tested. Returns the slopes.
    """
    active = np.arange(steps.S)  # a candidate's memory takes part in the slope of the log determinant
    each = [x for c in candidates for x in c.columns]
    sizes = {s: size for c in candidates for s, size in zip(c.symbols, c.typical, strict=True)}
    symbols = list(sizes)
    typical, free, n = np.array([sizes[s] for s in symbols]), found.free, len(symbols)
    both = free + Priors(tuple(map(Column, symbols)), np.zeros(n), typical, np.full(n, -np.inf), np.full(n, np.inf))
    point = Point(found.theta, both, np.zeros(len(both.columns)), path_of_all_states(steps, data, found), found.noise)
    timing = timing_columns(steps, data, point, active)
    pushed = DrivenColumns.pushing(timing)
    linearised = linearise_and_filter(steps, data, point, active, lambda _: [pushed], is_brief=True)
    P, c = len(free.symbols), timing.shape[3]
    every, broken = linearised.white, ~np.isfinite(linearised.white).all(axis=(0, 1, 2))
    broken[[*range(P), -1]] = False  # the fit itself is finite, or there is none
    every[..., broken] = 0.0  # a candidate whose response explodes at this step is not tested
    grams = np.einsum("krca,krcb->rab", every, every, optimize=True)
    logdet_gradient = np.hstack([np.where(broken[:-1], 0.0, linearised.logdet_gradient), np.zeros((len(data.run), 1))])
    # a parameter of one run has the column of the ship's parameter in that run's windows and nothing elsewhere
    pick = np.array([*range(P), *range(P + n, P + n + c), *(P + symbols.index(x.symbol) for x in each), P + n + c])
    acts = np.hstack([np.ones((len(data.run), P + c)), active_in_window(each, data), np.ones((len(data.run), 1))])
    grams = grams[:, pick[:, None], pick[None]] * acts[:, :, None] * acts[:, None]
    # runs are independent
    gram, logdet_gradients = grams.sum(axis=0), (logdet_gradient[:, pick] * acts).sum(axis=0)[:-1]
    own = np.diag(gram)[P + c : -1].copy()
    rest = projected(gram, logdet_gradients, found.p)
    apart = every[..., pick[P:-1]] * acts[:, None, P:-1] - every[..., :P] @ rest.taken
    lags, at, ratios = memory_steps(steps.ship.particulars["L"], data.h), c, {}
    for candidate in candidates:
        i = slice(at, at + len(candidate.columns))
        at = i.stop
        ratio = 1.0
        if EFFECTS[candidate.effect].measures:
            ratio = dispersion(apart[..., i], every[..., -1], rest.g[i], rest.S[i, i], lags, linearised.rows)
        with_timing = rest.S[i, :c]  # what errors in the time of the inputs add to the variance of the slopes
        inverse = np.linalg.pinv(rest.S[i, i], rcond=1e-8, hermitian=True)  # two parameters may look alike
        ratio += float(np.trace(inverse @ with_timing @ with_timing.T)) / len(inverse)
        if ratio > 1.0:
            ratios[candidate] = ratio
    return Slopes(tuple(each), rest.g[c:], rest.S[c:, c:], own, ratios, rest.taken[:, c:])


def score_tests(s: Slopes, candidates: Sequence[Candidate], seed: int = 0) -> list[ScoreTest]:
    """Tests of all ``candidates`` with slopes ``s``, the smallest probability first; seed: of the drawn law of the
    largest."""
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(s.S)
    # rounding: a little below 0
    draws = rng.standard_normal((DRAWS, len(values))) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    largest: dict[tuple[int, bool], np.ndarray] = {}
    tests = [_test(s, c, draws, largest) for c in candidates]
    # the smallest of all candidates (DRAWS,)
    least = np.min([_by_chance(T, *law) for law, T in largest.items()], axis=0) if largest else np.ones(DRAWS)
    count = sum(row.excited for row in tests)
    rows = [replace(row, p_value=_largest(row.p_single, least, count) if row.T > 0 else 1.0) for row in tests]
    return sorted(rows, key=lambda r: (r.p_single, -r.T))


def _by_chance(T: np.ndarray, degrees: int, is_one_sided: bool) -> np.ndarray:
    """Probability that chance gives a larger statistic than T, which is 0 where a one-sided one has the wrong sign."""
    p = chdtrc(degrees, T)  # chi2.sf without its checks of each call
    return np.where(T > 0, 0.5 * p, 1.0) if is_one_sided else p


def _test(s: Slopes, c: Candidate, draws: np.ndarray, largest: dict[tuple[int, bool], np.ndarray]) -> ScoreTest:
    """The test of one candidate; ``largest`` statistics (DRAWS,) that chance gives by degrees and sidedness, in which
    its own are put: the largest of one law has the smallest probability."""
    at = np.array([s.columns.index(x) for x in c.columns])
    S, own = s.S[np.ix_(at, at)], s.own[at]
    excited = own > EXCITED
    seen = excited & (np.diag(S) > EXCITED)
    if not seen.any():
        absorbed = 1.0 if excited.any() else 0.0
        nowhere = np.full(len(at), np.inf)
        return ScoreTest(c, 0.0, len(at), 1.0, 1.0, np.zeros(len(at)), absorbed, bool(excited.any()), nowhere)
    S = S[np.ix_(seen, seen)]
    inverse = np.linalg.pinv(S, rcond=1e-8, hermitian=True)
    # fewer where two parameters look alike
    degrees = int(np.linalg.matrix_rank(S, tol=1e-8 * np.trace(S), hermitian=True))
    phi = np.zeros(len(at))
    phi[seen] = inverse @ s.g[at][seen]
    ratio = s.dispersion.get(c, 1.0)
    T = float(phi[seen] @ s.g[at][seen]) / ratio  # g' S^-1 g (Rao 1948)
    d = draws[:, at[seen]]
    drawn = ((d @ inverse) * d).sum(axis=1)
    law = degrees, len(at) == 1 and bool(c.neutral[0] <= c.lower[0])  # one that can only be positive
    if law[1]:
        drawn[d[:, 0] <= 0] = 0.0
        if phi[0] <= 0:
            T, phi = 0.0, np.zeros(1)
    largest[law] = np.maximum(largest[law], drawn) if law in largest else drawn
    p = float(_by_chance(np.asarray(T), *law))
    absorbed = float(np.clip(1 - np.mean(np.diag(S) / own[seen]), 0.0, 1.0))  # information lost by the projection
    errors = np.full(len(at), np.inf)
    errors[seen] = np.sqrt(ratio * np.diag(inverse))
    taken = s.taken[:, at] if len(s.taken) else s.taken
    return ScoreTest(c, T, degrees, p, 1.0, phi, absorbed, True, errors, ratio, taken)


def followed(before: Point, score: ScoreTest, first: np.ndarray) -> dict[Column, float]:
    """Values of the free parameters of the fit ``before``, to first order, where the candidate of its ``score`` has the
    ``first`` values (p,) [their units]."""
    c, free = score.candidate, before.free
    if len(score.taken) != len(before.p):
        return {}
    p = np.clip(before.p - score.taken @ ((first - c.neutral) / c.typical), *free.scaled_bounds)
    return dict(zip(free.columns, (free.mean + free.std * p).tolist(), strict=True))


def _largest(p: float, least: np.ndarray, count: int) -> float:
    """Probability that chance gives a smaller single probability anywhere; beyond the draws by Bonferroni."""
    seen = float((least <= p).mean())
    return seen if seen > 20 / DRAWS else min(1.0, p * count, max(seen, 20 / DRAWS))
