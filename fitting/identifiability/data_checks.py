"""Trials and priors that do not belong into a calibration: each function names them in messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from cases.evidence.signals import MAD
from cases.trial import Trial
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import Segments
from fitting.solvers.control import Control
from fitting.solvers.noise import residual_series
from fitting.solvers.solve import solve
from mmg.compile.batch import BatchFunction
from mmg.effects import effect
from mmg.errors import BadValue, Conflict, OutOfRange, TooFewData
from mmg.messages import Message
from mmg.model import assemble
from mmg.motion.flow import STATES
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.nlp.captive import CaptiveForces

# Residuals of a run, as a multiple of those of the median run, from which it is named. Runs of the 3 m model that
# belong reach 3.3 when they are left out of the fit; one whose rudder has the wrong sign 6 to 18. Set by hand between.
FAR = 4.0
# Multiple from which a run is judged by a fit without it, as it pulls the joint fit towards itself. Set by hand, well
# below FAR: lower only costs fits.
LOOK = 1.5
# Scatter of a run from sample to sample, by that of the median run, from which it is refused. Set by hand.
SCATTER = 10.0
# Lag-one autocorrelation of residuals below which they are outliers of sensors, not of the ship. Set by hand.
WHITE = 0.3
# Share of its effect going astern that a coefficient must have in the trials to count as excited. Set by hand.
ASTERN = 1e-3
# Standard deviations of prior and points together from which these contradict each other. Set by hand.
CONTRADICTED = 5.0
INFLUENCED = 300  # Most nodes at which influence is calculated. Set by hand: it bounds time.
# By what surge velocity and revolutions of the data are multiplied to see what acts astern; first as they are.
TURNED_ROUND = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -0.3), (-1.0, -0.3), (-1.0, 0.3))


def refuse_outliers(trials: Sequence[Trial], step: float) -> None:
    """Raises UserError for ``trials`` whose samples, ``step`` [s] apart, scatter SCATTER times as much as the others'.

    Scatter is the robust size of second differences of the states, the geometric mean over the channels both have.
    Needs three runs. Runs that belong differ by less than a factor of two.
    """
    if len(trials) < 3:
        return
    size = np.array([[_scatter(t, name, step) for name in STATES] for t in trials])
    far = [_multiple(row, np.delete(size, i, axis=0)) for i, row in enumerate(size)]
    bad = [f"{t.name} ({m:.0f} times)" for t, m in zip(trials, far, strict=True) if m > SCATTER]
    if bad:
        raise BadValue(
            f"{', '.join(bad)}: samples are outliers throughout, they scatter so much more from one to the next than "
            "those of the other runs; leave the run out, or mend its file (mmg check)"
        )


def _scatter(trial: Trial, name: str, step: float) -> float:
    """Robust rms of second differences of a column ``step`` [s] apart; NaN where it is hardly measured."""
    if name not in trial.columns:
        return float("nan")
    x = np.unwrap(trial[name]) if name == "psi" else trial[name]
    second = np.diff(x[:: max(1, round(step / trial.dt))], 2)
    second = second[np.isfinite(second)]
    return float(MAD * np.median(np.abs(second))) if len(second) > 10 else float("nan")


def outlying_runs(problem: Problem, x: np.ndarray, moves: np.ndarray) -> list[Message]:
    """Warnings on runs whose residuals are far beyond those of the others; none for fewer than three runs.

    problem, x: the program solved and its solution; moves: (runs, P) change of the scaled coefficients without each
    run, to first order (``sandwich.left_out``), as a run that stands out is judged by a fit without it.
    """
    size, correlations = run_residuals(problem, x)
    measured = np.isfinite(size).any(axis=1)
    if measured.sum() < 3:
        return []
    far = np.array([_multiple(row, np.delete(size, i, axis=0)) if measured[i] else 0.0 for i, row in enumerate(size)])
    move_of = dict(zip(np.unique(problem.segments.run).tolist(), moves, strict=True))
    for k in np.flatnonzero((far > LOOK) & (far < FAR)).tolist():
        # at the coefficients moved by its leaving, the run's own states and constants are fitted alone
        p = np.clip(problem.split(x)[1] + np.nan_to_num(move_of[k]), *problem.p_bounds())
        prior, own = problem.prior, np.arange(problem.P) >= problem.prior.shared
        theta = prior.mean + prior.std * p
        bounds = np.where(own, prior.lower, theta), np.where(own, prior.upper, theta)
        windows = problem.segments.subset(np.flatnonzero(problem.segments.run == k))
        alone = problem.with_changes(segments=windows).with_bounds(*bounds)
        # 60, 1e-3: set by hand, for a size
        held = solve(alone, alone.start(p), Control(iterations=60), 1e-3, rough=True)
        if np.isfinite(held.objective):
            left_out = run_residuals(alone, held.x)[0][k]
            far[k] = max(far[k], _multiple(left_out, np.delete(size, k, axis=0)))
    return [
        Message(
            f"{name}: its samples are outliers throughout, {multiple:.0f} times the residuals of the other runs "
            "and uncorrelated; leave it out, or use --loss student if only some of its samples are bad",
            "outlying_samples",
        )
        if correlation < WHITE
        else Message(
            f"{name}: residuals {multiple:.0f} times those of the other runs; it may be of another ship or "
            "loading, have a wrong unit or sign, or go where the others do not, as a tight circle does: leave it out "
            "and compare (mmg check, mmg score)",
            "outlying_run",
        )
        for name, multiple, correlation in zip(problem.segments.trials, far, correlations, strict=True)
        if multiple >= FAR
    ]


def _multiple(own: np.ndarray, others: np.ndarray) -> float:
    """Rms residuals (6,) of a run over the median of others (R, 6), geometric mean over the channels both have."""
    usual = np.array([np.median(c[np.isfinite(c)]) if np.isfinite(c).any() else np.nan for c in others.T])
    ratio = own / usual
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    return float(np.exp(np.mean(np.log(ratio)))) if len(ratio) else 1.0


def run_residuals(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By run of ``problem`` at ``x``: rms residual of each channel (R, 6), NaN where unmeasured; mean lag-one
    autocorrelation (R,)."""
    seg = problem.segments
    e, ei = problem.errors(x)
    squares, samples, lagged = np.zeros((3, len(seg.trials), 6))
    for run, part in zip(seg.run, residual_series(seg, np.where(seg.node_mask > 0, e, np.nan), ei), strict=True):
        squares[run] += np.nansum(part**2, axis=0)
        samples[run] += np.isfinite(part).sum(axis=0)
        lagged[run] += np.nansum(part[1:] * part[:-1], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(squares / samples)
        correlation = np.where(squares > 0, lagged / squares, np.nan)
    mean = np.array([np.mean(m[np.isfinite(m)]) if np.isfinite(m).any() else 0.0 for m in correlation])
    return np.where(samples > 0, size, np.nan), mean


def unexcited_astern(ship: Ship, segments: Segments) -> list[Message]:
    """A warning on free coefficients of ``ship`` that act only in motion astern or with reversed propellers, or ahead
    where the trials go astern, of which the trials show hardly anything.

    They are found by their influence on the accelerations, over the data (``segments``) and over the data with surge
    velocity, revolutions or both turned round. Raises UserError when no others are.
    """
    model, free = assemble(ship), [ship.symbols.index(s) for s in ship.free]
    pick = np.unique(np.linspace(0, len(segments.nodes) - 1, INFLUENCED).round().astype(int))
    z, c, t = (ca.SX.sym("a", n) for n in (len(model.states), len(model.controls), len(model.symbols)))
    rates = model.rates(z, c, t)[3:6] * ca.DM([1.0, 1.0, ship.particulars["L"]])  # r' L: all in m/s^2
    J = ca.jacobian(rates, ca.vertcat(*[t[i] for i in free]))
    squares = ca.Function("influence", [z, c, t], [ca.sum1(ca.densify(J) ** 2)], {"cse": True})
    propellers = [i for i, name in enumerate(ship.inputs) if name == "n" or name.startswith("n_")]
    ways = (1, len(TURNED_ROUND), 1)
    states = np.tile(segments.nodes[pick].T[:, None], ways)  # (6, ways, nodes)
    controls = np.tile(segments.node_controls[:, pick][:, None], ways)
    surge, turns = np.array(TURNED_ROUND).T[:, :, None]
    states[3] *= surge
    controls[propellers] *= turns
    states, controls = states.reshape(len(states), -1), controls.reshape(len(controls), -1)
    settled = model.at_points("initial", states, controls, ship.values)
    total = BatchFunction(squares, None).at(settled, controls, ship.values)[0]
    total = total.reshape(len(free), len(TURNED_ROUND), -1)
    points = np.isfinite(total)  # none of them where the model has no value when it is turned round
    mean = np.where(points, total, 0.0).sum(axis=2) / np.maximum(points.sum(axis=2), 1)
    # rms change of the scaled accelerations for one prior standard deviation (P, ways), the data as they are first
    influence = np.sqrt(mean) * Prior.of(ship).std[:, None]
    shown, turned = influence[:, 0], influence[:, 1:].max(axis=1)
    unmoved = [s for s, a, b in zip(ship.free, shown, turned, strict=True) if b > 0 and a < ASTERN * b]
    if not unmoved:
        return []
    where, wanted, code = "astern or with reversed propellers", "trials astern and stops", "not_excited_astern"
    if np.median(segments.nodes[:, 3]) < 0:
        where, wanted, code = "ahead", "a trial ahead", "not_excited_ahead"
    text = f"{', '.join(unmoved)}: act only in motion {where} that the trials hardly show"
    instruments = tuple(f"{name}." for name in ship.effects if effect(name).measures)
    if all(s in unmoved or s.startswith(instruments) for s in ship.free):
        raise TooFewData(f"{text}: nothing to identify; add {wanted}, or free other coefficients")
    return [Message(f"{text}; the prior decides them: add {wanted}", code)]


def contradictions(prior: Prior) -> list[Message]:
    """Warnings where ``prior`` is at odds with its own bounds.

    Raises UserError for a standard deviation that is not positive, and for crossed bounds.
    """
    bad = [s for s, std in zip(prior.symbols, prior.std, strict=True) if not std > 0 or not np.isfinite(std)]
    if bad:
        raise OutOfRange(
            f"{', '.join(bad)}: free, but the standard deviation of the prior is not a positive number; give std in "
            "the ship file, or fix them with --fix"
        )
    crossed = [s for s, lo, hi in zip(prior.symbols, prior.lower, prior.upper, strict=True) if lo >= hi]
    if crossed:
        raise Conflict(f"{', '.join(crossed)}: lower bound not below the upper one; correct the ship file, or --fix")
    low, high = prior.scaled_bounds
    return [
        Message(
            f"{symbol}: its prior {prior.mean[i]:.4g} +- {prior.std[i]:.2g} lies {outside:.1f} standard deviations "
            f"outside its bounds {prior.lower[i]:.4g} to {prior.upper[i]:.4g}: one of them is wrong",
            "prior_outside_bounds",
        )
        for i, (symbol, outside) in enumerate(zip(prior.symbols, np.maximum(low, -high), strict=True))
        if outside > 1
    ]


def against_captive(forces: CaptiveForces, base: np.ndarray, free: np.ndarray, prior: Prior) -> list[Message]:
    """Warnings on coefficients that the captive points alone put CONTRADICTED standard deviations from their prior.

    forces: of the points; base: values of all coefficients (C,), free: positions (P,) of those in ``prior``. The points
    are fitted with the prior 30 times wider; what they leave to that prior is not compared.
    """
    from fitting.nlp.captive import estimate_from_captive

    # 1 / sqrt(1e-3) = 30
    alone, covariance = estimate_from_captive(forces, base, free, prior.mean, prior.std, ridge=1e-3)
    spread = np.sqrt(np.diag(covariance))
    found = [
        (abs(p) / np.sqrt(1 + s**2), symbol, mean, std, mean + std * p)  # variances of prior and points add up
        for symbol, mean, std, p, s in zip(prior.symbols, prior.mean, prior.std, alone, spread, strict=True)
        if s < 3.0  # a tenth of the wide prior: the points tell it; set by hand
    ]
    return [
        Message(
            f"{symbol}: the captive points of {forces.points.name} put it at {value:.4g}, {far:.1f} standard "
            f"deviations from its prior {mean:.4g} +- {std:.2g}; check units, axes and sign of the points, or widen "
            "the prior",
            "captive_against_prior",
        )
        for far, symbol, mean, std, value in sorted(found, reverse=True)
        if far > CONTRADICTED
    ]
