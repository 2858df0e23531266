"""The manoeuvre that would tell two explanations apart, from the model alone.

Each manoeuvre of the library is run with the ship as diagnosed. If the first effect is what it was found to be, a fit
with another one in its place leaves a misfit (non-centrality of the likelihood ratio) of phi_1' (S_11 - S_12 S_22^+
S_21) phi_1, the coefficients projected out of S with what the present trials say of them; the manoeuvre with the
largest is named. With one explanation only, it is the one that would make its size surest.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cases.trial import Trial
from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.gusts import trials_in_gusts
from diagnosis.estimation.kalman import DrivenColumns
from diagnosis.estimation.linearisation import Point, Trajectory, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import NO_PRIORS, Priors, get_values, priors_of_effects
from diagnosis.estimation.transition_model import LinearModel
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unexplained_force import ForceEstimate
from fitting.design.next_trial import Option, library, runs
from mmg.motion.froude import time_scale
from mmg.ship import AIR, Ship

SECONDS = 150.0  # Time at sea of each manoeuvre [s of a 3 m model]. Set by hand.
AIM = 10.0  # Standard error of a size that is good to have [% of it]. Set by hand.
TOGETHER = 8  # Manoeuvres that are linearised together. Set by hand: bounds memory.
TELLS_APART = 6.6  # Misfit that tells two explanations apart at 1 %: 99 % quantile of chi-squared of 1 degree, 6.63
MANY = 50  # Repetitions of a manoeuvre that nobody would run. Set by hand.


def next_test(problem: SearchProblem, first: Estimate, candidates: Sequence[Candidate], ship: Ship) -> str:
    """The manoeuvre that would separate the first of ``candidates`` from each of the others, in a sentence.

    problem: the search; first: a fit with the first candidate; ship: with that effect.
    """
    k = time_scale(ship.particulars["L"])
    options, trials = _simulated(problem, ship)
    if not options:
        return ""
    one, *others = candidates
    rows = np.vstack([_misfits(problem, first, one, others, some) for some in _together(trials)])
    if not others:
        best = int(np.argmax(rows[:, 0]))
        percent = 100 / max(np.sqrt(rows[best, 0]), 1e-9)
        words = f"To know the size of {one.effect} better: {_order(options[best])} of {SECONDS * k:.0f} s, "
        if percent <= 2 * AIM:
            return f"{words}which alone would measure it to {percent:.{'1f' if percent < 10 else '0f'}} % of its value."
        return words + f"about {np.ceil((percent / AIM) ** 2):.0f} times for {AIM:.0f} % of its value."
    worst = rows.min(axis=1)
    best = int(np.argmax(worst))
    rivals = f"{one.effect} from {' and '.join(c.effect for c in others)}"
    words = f"To tell {rivals}: {_order(options[best])} of {SECONDS * k:.0f} s"
    if worst[best] >= TELLS_APART:
        return words + f" (expected misfit of the wrong one: {worst[best]:.0f}, 6.6 suffices)."
    times = TELLS_APART / max(worst[best], 1e-6)
    if times > MANY:
        return f"No manoeuvre of the library would tell {rivals}: look at the instruments and the place instead."
    return words + f", about {np.ceil(times):.0f} times (one is expected to bring {worst[best]:.1f} of 6.6)."


def telling_test(problem: SearchProblem, fit: Estimate, force: ForceEstimate, ship: Ship) -> str:
    """The manoeuvre in which the unexplained ``force`` would show most, in a sentence.

    problem: the search; fit: at which the force was estimated; ship: as fitted there. The misfit of a ship without the
    force is what is left of its whitened response when the free coefficients have taken what they can.
    """
    options, trials = _simulated(problem, ship)
    if not options:
        return ""
    kept = [c.run is None for c in fit.free.columns]
    rows = [_informations(problem, fit, kept, NO_PRIORS, some, force) for some in _together(trials)]
    misfits = np.concatenate(rows)[:, 0, 0]
    best = int(np.argmax(misfits))
    seconds = SECONDS * time_scale(ship.particulars["L"])
    words = f"To know more of it: {_order(options[best])} of {seconds:.0f} s, in which it would show most"
    times = int(np.ceil(TELLS_APART / max(misfits[best], 1e-6)))
    if times > MANY:
        return "No manoeuvre of the library would show it clearly: repeat the trials in which it is largest."
    return words + ("." if times == 1 else f", about {times} times.")


def _together(trials: Sequence[Trial]) -> list[Sequence[Trial]]:
    """The ``trials`` in parts that are linearised together."""
    return [trials[first : first + TOGETHER] for first in range(0, len(trials), TOGETHER)]


def _informations(
    problem: SearchProblem,
    fit: Estimate,
    kept: Sequence[bool],
    more: Priors,
    trials: Sequence[Trial],
    force: ForceEstimate | None = None,
) -> np.ndarray:
    """Information (runs, c, c) in each of ``trials`` on parameters ``more`` or on the size of a ``force``, without what
    the free parameters that are ``kept`` of the ``fit`` take, by what the present trials say of them; 0 where a run is
    too short for a window, or the ship explodes."""
    data, path = _rolled_out(problem, fit.theta, trials)
    free, P = fit.free.only(kept) + more, sum(kept)
    point = Point(fit.theta, free, np.zeros(len(free.columns)), path, fit.noise)

    def pushed(linear: LinearModel) -> list[DrivenColumns]:
        if force is None:
            return []
        acts = force.on(data, 0.5 * (path.z[:-1] + path.z[1:]))
        return [DrivenColumns.pushing(np.einsum("krac,krc->kra", linear.force, acts)[..., None])]

    white = np.nan_to_num(linearise_and_filter(problem.steps, data, point, extra=pushed).white[..., :-1])
    grams = np.zeros((len(trials), white.shape[3], white.shape[3]))
    np.add.at(grams, data.run, np.einsum("krca,krcb->rab", white, white, optimize=True))
    known = np.linalg.inv(fit.covariance[np.ix_(kept, kept)])
    taken = np.linalg.solve(grams[:, :P, :P] + known, grams[:, :P, P:])
    return np.asarray(grams[:, P:, P:] - grams[:, P:, :P] @ taken)


def _simulated(problem: SearchProblem, ship: Ship) -> tuple[list[Option], list[Trial]]:
    """The manoeuvres of the library that the ``ship`` can run, and a run of each."""
    air = [i for i, name in enumerate(problem.steps.ship.inputs) if name in AIR]
    windy = bool(np.nan_to_num(problem.data.inputs[:, :, air]).any())  # never in a towing tank
    chosen = [o for o in library(ship, windy) if "half speed" not in o.name or o.maneuver.startswith("zigzag:20")]
    seconds = SECONDS * time_scale(ship.particulars["L"])
    return runs(ship, chosen, seconds, problem.data.h)[:2]


def _rolled_out(problem: SearchProblem, theta: np.ndarray, trials: Sequence[Trial]) -> tuple[GriddedTrials, Trajectory]:
    """The ``trials`` on the grid of the ``problem``, and paths of the model from their begin without latent force."""
    steps = problem.steps
    data = trials_in_gusts(steps, trials)
    data = acting(steps, data, theta)
    K, R = data.inputs.shape[:2]
    z = np.repeat(steps.settled(data.y[0].T, data.inputs[0].T, theta).T[None], K + 1, axis=0)
    return data, Trajectory(steps.follow(z, data.controls, theta), np.zeros((K + 1, R, 3)))


def _order(option: Option) -> str:
    """A manoeuvre in words, with what ``mmg simulate`` takes."""
    return f"{option.name} (mmg simulate SHIP --maneuver {option.arguments})"


def _misfits(
    problem: SearchProblem, first: Estimate, one: Candidate, others: Sequence[Candidate], trials: Sequence[Trial]
) -> np.ndarray:
    """Misfit (runs, others) in one run of each manoeuvre of each other effect, or of none, in place of the first."""
    effects = [one, *others]
    more, tested = priors_of_effects(effects), {c.effect for c in effects}
    kept = [s in problem.base.symbols and s.partition(".")[0] not in tested for s in first.free.symbols]
    q = len(one.columns)
    size = get_values(problem.steps.ship, problem.data, first.theta, one.columns)
    phi = (size - one.neutral) / more.std[:q]
    ends = np.cumsum([q, *(len(e.symbols) for e in others)])
    misfits = []
    for S in _informations(problem, first, kept, more, trials):
        row = [] if others else [phi @ S[:q, :q] @ phi]
        for begin, end in pairwise(ends):
            own = slice(begin, end)
            rest = S[:q, :q] - S[:q, own] @ np.linalg.pinv(S[own, own], rcond=1e-8, hermitian=True) @ S[own, :q]
            row.append(float(phi @ rest @ phi))
        misfits.append(row)
    return np.array(misfits)
