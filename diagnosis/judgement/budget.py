"""The budget of the prediction error: floor, what each named effect causes, what nothing explains.

The floor is what a complete model would leave that was fitted to the same trials: errors of the sensors, from whose
rows a prediction begins, random forces along its way, and the uncertainty of the coefficients. It comes from trials
that the fitted model simulates, and is at most the error that the model leaves with what was named. What lies above
could be avoided; an effect has the part by which the error falls as it is added, in the order of the selection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import initial_trajectory, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import LEFT_OUT, TESTS, Budget, BudgetShare
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unexplained_force import ForceEstimate
from diagnosis.validation.held_out import DRAWS, WindowErrors, errors, redrawn_means, window_length, window_words

SIMULATED = 16  # Simulated campaigns behind the floor. Its own scatter is part of the intervals. Set by hand.
UNITS = ("position_m", "heading_deg")  # What the errors at the end of a window are said in
# Probability that the error is not above the floor up to which there is a gap to account for.
SURE = 0.05  # set by hand: a usual level


def budget_of(
    problem: SearchProblem,
    selection: Selection,
    missing: ForceEstimate | None = None,
    seed: int = 0,
    given: np.ndarray | None = None,
) -> Budget | None:
    """Where the error of windows of trials that took no part comes from.

    problem: model, training trials, and tests, trials that took no part (None: then each training run is predicted by
    coefficients without it); selection: the effects, with the fits as each was added; missing: the force without a name
    that is left, None: nothing is; seed: of all draws; given: coefficients (all,) before any fit to these trials, None
    where there was one. Returns None where no whole window can be predicted, and where
    there is a single run that would have to be left out.
    """
    steps, data, tests, fits = problem.steps, problem.data, problem.tests, selection.fits
    names = [c.effect for c in selection.effects]
    if tests is None and len(np.unique(data.run)) < 2:
        return None
    seen, final, rng = data if tests is None else tests, fits[-1], np.random.default_rng(seed)
    predicted = [left_out_errors(steps, data, f) if tests is None else _errors(steps, seen, f.theta) for f in fits]
    floors = _floors(steps, seen, final, rng) if len(predicted[0].run) else []
    if not floors:
        return None
    mean = np.array([e.mean.mean() for e in predicted])
    simulated = WindowErrors.joined(floors)
    # a force that was fitted to the same runs would predict them too well
    complete = predicted[-1] if missing is None or tests is None else with_force(steps, seen, final, missing)
    floor = min(float(simulated.mean.mean()), mean[-1], float(complete.mean.mean()))
    drawn = _drawn([*predicted, complete], floors, rng)  # (DRAWS, fits and floor)
    gap = drawn[:, 0] - drawn[:, -1]  # what could be avoided, by draw
    rows: list[BudgetShare] = []
    if (gap <= 0).mean() <= SURE and mean[0] > floor:
        shares = -np.diff(drawn[gap > 0], axis=1) / gap[gap > 0, None]
        low, high = np.quantile(shares, [0.05, 0.95], axis=0)
        best = -np.diff([*mean, floor]) / (mean[0] - floor)
        for name, b, a, c in zip((*names, "unexplained"), best, low, high, strict=True):
            rows.append(BudgetShare(name, float(b), (float(a), float(c))))
    by_after = np.quantile(drawn[:, -1] / np.maximum(drawn[:, -2], 1e-300), [0.05, 0.95]).tolist()
    ends = [_ends(e) for e in (predicted[0], predicted[-1], simulated)]
    ends[2] = np.minimum(ends[1], ends[2])
    start = None if given is None else _errors(steps, seen, given)
    return Budget(
        metric=window_words(steps.ship),
        by=LEFT_OUT if tests is None else TESTS,
        before=float(mean[0]),
        after=float(mean[-1]),
        floor=float(floor),
        parts=tuple(rows[:-1]),
        unexplained=rows[-1] if rows else None,
        units={name: tuple(row) for name, row in zip(UNITS, np.transpose(ends).tolist(), strict=True)},
        as_given=None
        if start is None
        else {"error": float(start.mean.mean()), **dict(zip(UNITS, _ends(start).tolist(), strict=True))},
        floor_by_after=(by_after[0], by_after[1]),
    )


def _ends(found: WindowErrors) -> np.ndarray:
    """Root mean square errors (2,) at the ends of windows, in UNITS."""
    position, heading = np.sqrt(found.end.mean(axis=0))
    return np.array([position, np.degrees(heading)])


def _errors(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> WindowErrors:
    return errors(steps, data, theta, window_length(steps.ship))


def left_out_errors(steps: TransitionModel, data: GriddedTrials, fit: Estimate) -> WindowErrors:
    """Errors of each run of ``data`` by the coefficients that the ``fit`` of ``steps`` would have without it: a
    Gauss-Newton step from the fit to all (infinitesimal jackknife, Jaeckel 1972)."""
    here = linearise_and_filter(steps, data, fit)
    gram = np.einsum("krca,krcb->rab", here.white, here.white, optimize=True)
    slope = gram[:, :-1, -1] + here.logdet_gradient
    every = gram[:, :-1, :-1].sum(axis=0) + np.eye(len(fit.p))
    parts = []
    for run in np.unique(data.run):
        own = data.run == run
        without = every - gram[own, :-1, :-1].sum(axis=0)  # information of the other runs and the priors
        moved = fit.with_values(steps.ship, data, fit.p + np.linalg.solve(without, slope[own].sum(axis=0)))
        parts.append(_errors(steps, data.windows(own), moved.theta))
    return WindowErrors.joined(parts)


def with_force(steps: TransitionModel, data: GriddedTrials, fit: Estimate, missing: ForceEstimate) -> WindowErrors:
    """Errors in ``data`` of the ``fit`` of ``steps`` with a ``missing`` force and the coefficients that go with it."""
    z = initial_trajectory(steps, data, fit.theta).z
    force = missing.on(data, 0.5 * (z[:-1] + z[1:]))
    moved = fit.with_values(steps.ship, data, fit.p - missing.taken @ missing.mean.ravel())
    return errors(steps, data, moved.theta, window_length(steps.ship), force=force)


def _floors(steps: TransitionModel, data: GriddedTrials, fit: Estimate, rng: np.random.Generator) -> list[WindowErrors]:
    """Errors of ships as uncertain as the coefficients of a ``fit``, in trials that it simulates along ``data``."""
    errors_of_draws = []
    for seen in simulated_trials(steps, data, fit, SIMULATED, rng):
        # not by eigenvectors, whose signs rounding turns
        drawn = rng.multivariate_normal(fit.p, fit.covariance, method="cholesky")
        errors_of_draws.append(_errors(steps, seen, fit.with_values(steps.ship, data, drawn).theta))
    return [e for e in errors_of_draws if np.isfinite(e.mean).all()]


def simulated_trials(
    steps: TransitionModel, data: GriddedTrials, fit: Estimate, count: int, rng: np.random.Generator
) -> Iterator[GriddedTrials]:
    """``count`` times ``data`` with logged columns drawn from a ``fit`` of the model ``steps``: new random forces and
    gusts push the ship, new errors of the sensors are added; rng: of both."""
    noise, acted, path = fit.noise, acting(steps, data, fit.theta), initial_trajectory(steps, data, fit.theta)
    shape = data.y.shape[:2]
    for _ in range(count):
        path = replace(path, force=processes(shape, noise.force, noise.tau, data.h, rng))
        if data.gusts is not None:
            path = replace(path, gust=processes(shape, noise.gust, noise.gust_tau, data.h, rng), gusts=data.gusts)
        z = steps.follow(path.z, acted.controls, fit.theta, force=path.push[:-1])
        y = steps.logged(z, fit.theta) + noise.white * rng.standard_normal(data.y.shape)
        yield replace(data, y=np.where(data.measured, y, 0.0))


def _drawn(predicted: Sequence[WindowErrors], floors: Sequence[WindowErrors], rng: np.random.Generator) -> np.ndarray:
    """Mean errors (DRAWS, fits and floor) of runs drawn again, each with one of the ``floors``. predicted: by all
    fits and by the complete model; the floor is at most the last two."""
    means = redrawn_means([e.mean for e in (*predicted, *floors)], predicted[0].run, rng)
    which = len(predicted) + rng.choice(len(floors), DRAWS)
    last = len(predicted) - 1
    # the floor is at most what was reached
    floor = np.minimum(means[np.arange(DRAWS), which], means[:, last - 1 : last + 1].min(axis=1))
    return np.column_stack([means[:, :last], floor])


def processes(shape: tuple[int, ...], sizes: np.ndarray, tau: float, h: float, rng: np.random.Generator) -> np.ndarray:
    """Stationary first-order processes (*shape, c), in time along the first axis of steps h [s], of ``sizes`` (c,) and
    correlation time tau [s]; rng: of random numbers."""
    x = rng.standard_normal((*shape, len(sizes)))
    left = np.exp(-h / tau)
    for k in range(1, len(x)):
        x[k] = left * x[k - 1] + np.sqrt(1 - left**2) * x[k]  # variance 1 at every step
    return x * sizes
