"""Whether trials that took no part show again an effect that was found in others.

What is found in some trials is the most of many directions in which they may err, so that chance alone makes it large.
Other trials are asked about that direction alone: no further correction for the number of candidates is due
(Cox 1975, A note on data-splitting for the evaluation of significance levels). The direction holds the coefficients as
well: what they made up for without the effect is seen nowhere. Their values by the first trials are open as far as
those left them, which is projected out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.evidence.tails import normal_quantile, normal_tail
from diagnosis.estimation.acting_inputs import acting, linearised
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.dispersion import dispersion, memory_steps
from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Linearisation, Point, linearise_and_filter, timing_columns
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.parameters import NO_PRIORS, Priors, active_states, set_values
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from diagnosis.hypotheses.projection import projected
from mmg.effects import EFFECTS

SHOWN, OTHER_SIZE = 0.05, 0.005
"""Probability by chance above which trials do not show what was found in others, and that below which they exclude its
size."""

CERTAIN = 1e-4
"""Probability by chance of every name, by training and test trials together, that excludes chance. Then windows and
steps of the test trials must surely become worse to contradict, since what they show of a weak effect is uncertain,
too; a name that is withdrawn leaves something unexplained, though no unnamed form does; and a fault of an instrument
may be small.
"""

EXCESS = 2.0
"""How many times better those that took no part would show something than the trials do from which they are not asked:
no linear response tells so much."""


@dataclass(frozen=True)
class FoundAgain:
    """The slope of the log likelihood of other trials along what was found, over its standard deviation by chance (z),
    and what z would be if it is there as large as it was found (expected)."""

    z: float
    expected: float

    @property
    def p_value(self) -> float:
        """Probability that chance gives such a slope in this direction."""
        return normal_tail(self.z)

    @property
    def gain(self) -> float:
        """Log likelihood that the other trials gain by what was found, as large as it was found."""
        return self.z * self.expected - 0.5 * self.expected**2

    def scaled(self, own: FoundAgain) -> FoundAgain:
        """What is expected here, as far as the response that it hangs on is right.

        own: the same of the trials in which it was found. There z is what is expected of a response that is linear in
        the size. A lag that is long or a mass, which changes how the ship answers to random forces, has less (a hull
        memory of 2 s: 2.4 of 15.8), or more.
        """
        if not (own.expected > 0 and own.z > 0):
            return NOTHING
        return FoundAgain(self.z, self.expected * own.z / own.expected)

    def denies(self, gain: float) -> bool:
        """Whether the other trials do not show it although they would if it had the size found: that is excluded.

        gain: of log likelihood in the first trials, by which the size is uncertain: its deviate there is the root of
        twice the gain.
        """
        if not self.expected > 0 or self.p_value < SHOWN:
            return False
        spread = math.hypot(1.0, self.expected / math.sqrt(max(2 * gain, 1.0)))
        return normal_tail((self.expected - self.z) / spread) < OTHER_SIZE


NOTHING = FoundAgain(0.0, 0.0)
"""What trials say that do not show it."""


def both_by_weight(p_value: float, gain: float, again: FoundAgain) -> float:
    """Probability that chance gives as much in both: a probability ``p_value`` by the first trials, in which the log
    likelihood gains ``gain``, and ``again`` in others.

    The two normal deviates are added with the weights that each should have if it is true (Stouffer's method with the
    weights of Liptak 1958). Trials that do not show it change nothing.
    """
    first, second = math.sqrt(max(2 * gain, 0.0)), max(again.expected, 0.0)
    if not second > 0 or not first > 0:
        return p_value
    deviate = normal_quantile(min(max(p_value, 1e-300), 1 - 1e-9))
    return normal_tail((first * deviate + second * again.z) / math.hypot(first, second))


ITERATIONS = 5
"""Linearisations of the fit of path and noise."""


@dataclass(frozen=True)
class OtherTrials:
    """Trials that took no part at the fit of others.

    point: coefficients of that fit, with path and noise of these trials; known: (P, P) inverse covariance of the
    coefficients by the others; off: (P,) how far they are from where that has them [prior std], None: not at all.
    """

    steps: TransitionModel
    data: GriddedTrials
    point: Point
    known: np.ndarray
    off: np.ndarray | None = None

    @np.errstate(all="ignore")
    def effect(self, candidate: Candidate, phi: np.ndarray, shift: np.ndarray) -> FoundAgain:
        """An effect that was found with parameters ``phi`` (p,) [typical sizes], and moved the coefficients by
        ``shift`` (P,) [prior std]: what these made up for without it shows in no trial.

        The response is that of the effect with the coefficients as they were moved: it is strong beside a coefficient
        that it multiplies.
        """
        steps, at = self.steps, self.point
        data = acting(steps, self.data, at.theta)
        c, active, z = candidate, np.arange(steps.S), at.path.z
        passive = np.setdiff1d(active, active_states(steps, at.free.symbols, at.theta))
        if len(passive):
            z = steps.with_passive_states(z, data.controls, at.theta, at.path.push, passive)
        open_ended = np.full(len(phi), np.inf)
        free = at.free + Priors(c.columns, c.neutral, c.typical, -open_ended, open_ended)
        point = Point(at.theta, free, np.append(at.p, phi * 0), at.path.along(z), at.noise)
        timing = timing_columns(steps, data, point, active)
        columns, along = [steps.symbols.index(s) for s in free.symbols], np.append(shift, phi)
        moved = at.free.mean + at.free.std * (at.p + shift)
        theta = set_values(steps.ship, data, at.theta, at.free.columns, moved)
        there = linearised(steps, data, theta, z, at.path.push[:-1], columns, active)

        def columns_of(_: LinearModel) -> list[DrivenColumns]:
            size = (free.std * along)[:, None]
            return [DrivenColumns.pushing(timing), DrivenColumns.dense(there.G @ size, there.D @ size)]

        here = linearise_and_filter(steps, data, point, active, columns_of)
        logdet = here.logdet_gradient.sum(axis=0)
        logdet[-1] = logdet[: len(along)] @ along
        rest = [*range(len(shift)), *range(len(along), len(logdet) - 1)]
        return self._last(here, logdet, rest, EFFECTS[c.effect].measures)

    def _last(self, here: Linearisation, logdet: np.ndarray, rest: Sequence[int], measures: bool) -> FoundAgain:
        """The slope of a linearisation along the last of its C columns, those of ``rest`` projected out: P
        coefficients, as far as they are open, and errors in the time of the inputs.

        logdet: (C,) slopes of half the log determinant; measures: the column is an error of instruments, whose
        residuals may be correlated in time.
        """
        P, C = len(self.point.p), len(logdet)
        chosen = np.array([*rest, C - 1, C])
        white = here.white[..., chosen]
        flat = white.reshape(-1, len(chosen))
        known = np.eye(len(rest))
        known[:P, :P] = self.known
        off = np.zeros(len(rest))
        off[:P] = 0.0 if self.off is None else self.off
        left = projected(flat.T @ flat, logdet[chosen[:-1]], off, known)
        if not left.S[0, 0] > 0:
            return NOTHING
        ratio = 1.0
        if measures:
            lags = memory_steps(float(self.steps.ship.particulars["L"]), self.data.h)
            column = white[..., -2:-1] - white[..., :-2] @ left.taken
            ratio = dispersion(column, white[..., -1], left.g, left.S, lags)
        size = float(np.sqrt(left.S[0, 0] / ratio))
        return FoundAgain(float(left.g[0]) / ratio / size, size)


def same_trials(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> OtherTrials:
    """The trials ``data`` of the fit ``found`` of ``steps`` themselves, asked in the same way: coefficients are as open
    as others leave them, and their slopes are those with the prior."""
    return OtherTrials(steps, data, found, np.linalg.inv(found.covariance), found.covariance @ found.p)


def other_trials(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> OtherTrials:
    """Follow ``data``, trials that took no part, by the model ``steps`` with the coefficients of the fit ``found``."""
    first = initial_point(steps, data, found.theta, NO_PRIORS, found.noise)
    path = estimate(steps, data, first, ITERATIONS)
    return OtherTrials(steps, data, replace(path.fixed(), free=found.free, p=found.p), np.linalg.inv(found.covariance))
