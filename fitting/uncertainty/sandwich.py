"""Covariance of the coefficients that holds on autocorrelated residuals: cluster-robust, prior included.

The error of the estimate is H^-1 (scores at the truth + score of the prior), H = sum of informations + I. The
model-based covariance H^-1 assumes that scores vary as the informations say. Here their variance J is measured, from
windows or runs as clusters (sandwich; White 1982, Liang & Zeger 1986), and the prior adds its own:
V = H^-1 (J + I) H^-1 (captive tests add theirs, by their stated accuracy).

Scores at the estimate are too small, as the estimate was fitted to each cluster. Leaving a cluster out changes the
estimate by (H - I_c)^-1 s_c, and the squares of these changes add up to the jackknife form CR3 of the sandwich (Bell &
McCaffrey 2002), which errs to the safe side. A variance from few clusters is itself uncertain: it is shrunk towards the
dispersion that all coefficients share (moderated variances, Smyth 2004) and widened by Student's t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.nlp.fisher_information import Information

# Degrees of freedom of the dispersion shared by all coefficients, against those of each coefficient's clusters. Set by
# hand; coverage of the intervals is in benchmarks/RESULTS.md (``coverage intervals``).
SHARED_FREEDOM = 5.0
# Degrees of freedom at which clusters by run and by window count alike. Set by hand, as are the next two.
RUNS_NEEDED = 10.0
ENOUGH = 30.0  # Degrees of freedom below which a variance may not be smaller than the model-based one. Set by hand.
ABSORBED = 0.9  # Prior's share of the model-based variance above which only the shared dispersion is used. Set by hand.
NORMAL = 1.959964  # Standard normal quantile at 97.5 %. (Abramowitz & Stegun 1964, chapter 26.)


@dataclass(frozen=True)
class Robust:
    """Covariances of scaled coefficients, in prior standard deviations squared.

    covariance: (P, P) robust; model: (P, P) inverse of information plus prior; freedom: (P,) effective degrees of
    freedom; dispersion: how much more the scores vary than the informations say, over all coefficients; clusters:
    numbers of windows and runs; moves: (runs, P) change of the estimate without each run, to first order.
    """

    covariance: np.ndarray
    model: np.ndarray
    freedom: np.ndarray
    dispersion: float
    clusters: tuple[int, int]
    moves: np.ndarray


def changes_without_each(info: Information) -> np.ndarray:
    """Change of the estimate when each row of ``info`` (a window or a run) is left out, to first order, (rows, P)."""
    remaining = info.hessian - info.fisher  # without the cluster itself: as the jackknife, less biased with few
    return np.linalg.solve(remaining, info.score[:, :, None])[:, :, 0]


def _clusters(info: Information, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moves without each cluster, the variance they add up to (P,), and its degrees of freedom (P,)."""
    moves = changes_without_each(info)
    expected = np.einsum("ij,wjk,ki->wi", inverse, info.fisher, inverse, optimize=True)  # share of each in the variance
    # equal shares: as many as clusters (Satterthwaite 1946)
    freedom = expected.sum(axis=0) ** 2 / np.maximum((expected**2).sum(axis=0), 1e-300)
    return moves, (moves**2).sum(axis=0), np.clip(freedom, 1.0, len(moves))


def robust(info: Information) -> Robust:
    """The robust covariance of an estimate from its windows' information and scores, ``info``.

    All NaN when they are not finite. With a single window there is nothing to measure: the model-based covariance
    is returned with one degree of freedom. A constant of one run has no other runs to be compared with: its
    clusters are windows alone, and leaving its run out counts as no move.
    """
    P, windows, by_run, H = len(info.p), len(info.run), info.by_run(), info.hessian
    clusters = (windows, len(by_run.run))
    if not (np.isfinite(H).all() and np.isfinite(info.score).all()):
        bad = np.full((P, P), np.nan)
        return Robust(bad, bad, np.full(P, np.nan), np.nan, clusters, np.full((clusters[1], P), np.nan))
    inverse = np.linalg.inv(H)
    model = 0.5 * (inverse + inverse.T)
    if windows < 2:
        return Robust(model, model, np.ones(P), 1.0, clusters, np.zeros((1, P)))
    # what the data alone would add by the model: V I V
    by_model = np.diag(model @ (H - info.prior_information) @ model)
    moves_w, observed, freedom = _clusters(info, model)
    moves_r = np.zeros((1, P))
    total = moves_w.T @ moves_w
    if clusters[1] > 1:
        moves_r, observed_r, freedom_r = _clusters(by_run, model)
        shared = np.ones(P, dtype=bool)
        if info.owner is not None:
            shared = info.owner < 0
            moves_r[by_run.run[:, None] == info.owner] = 0.0  # its constants have nothing without it
        weight = np.where(shared, freedom_r / (freedom_r + RUNS_NEEDED), 0.0)
        observed = weight * observed_r + (1 - weight) * observed
        freedom = weight * freedom_r + (1 - weight) * freedom
        mean = weight[shared].mean()  # one for the matrix, which must stay positive
        total = mean * moves_r.T @ moves_r + (1 - mean) * total
    excited = np.diag(model) < ABSORBED
    dispersion = max(1.0, float((observed[excited] / by_model[excited]).mean())) if excited.any() else 1.0
    own = np.where(excited, freedom, 0.0)  # what the prior decides shows no variance of its own
    total_freedom = SHARED_FREEDOM + own
    variance = (SHARED_FREEDOM * dispersion * by_model + own * observed) / total_freedom  # moderated (Smyth 2004)
    # few clusters may agree by chance
    variance = np.where(total_freedom < ENOUGH, np.maximum(variance, by_model), variance)
    from scipy.special import stdtrit  # late: slow to import

    variance *= (stdtrit(total_freedom, 0.975) / NORMAL) ** 2  # so that normal intervals are as wide as Student's
    share = SHARED_FREEDOM / (SHARED_FREEDOM + freedom.mean())
    # correlations by the same mixture; sizes are the variances above
    matrix = (1 - share) * total + share * dispersion * model @ (H - info.prior_information) @ model
    size = np.sqrt(np.maximum(variance, 0.0) / np.maximum(np.diag(matrix), 1e-300))
    noise = np.where(by_model[:, None] * by_model > 0, matrix * np.outer(size, size), 0.0)
    covariance = noise + model @ info.prior_information @ model  # the prior's part does not come from the residuals
    return Robust(0.5 * (covariance + covariance.T), model, total_freedom, dispersion, clusters, moves_r)
