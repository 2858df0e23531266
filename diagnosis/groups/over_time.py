"""What changed in the course of a log, and when: the groups are spells of hours, and have an order.

A spell gives an estimate of every candidate. Those of one candidate are a level, a change that runs straight from a
first to a last day (a step where both are the same), an error that the information of each spell says, and an error
that lasts: weather, tide, what the model has wrong at some speeds, an Ornstein-Uhlenbeck process whose size and
duration are estimated along. The statistic is the gain in log likelihood of the best change. Its law without a change
comes from a bootstrap of the fitted noise: the whitened residuals are drawn again, and everything is estimated again on
each draw. The strongest change is named, taken out of the estimates of all candidates, and the rest is tested again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from cases.evidence.tails import gamma_tail
from fitting.nlp.prior import group_sums
from fitting.prediction.innovations import UNEXPLAINED, Innovations, information_of

SPELL = 0.25  # Longest spell [days]. Set by hand.
PARTS = 100  # A spell of a log shorter than 25 days is this part of it. Set by hand: as many as of those 25 days.
DAY = 86400.0  # Seconds of a day (SI brochure of 2019, table 8)
MONTH = 30.0  # Days of a month. Set by hand.
INFORMED = 0.05  # Share of the median information below which a spell is left out. Set by hand.
FEWEST = 8  # Spells without which no change can be told. Set by hand.
# Durations of the error that lasts [days], in a log of MONTH days or more; in proportion in a shorter one. An error of
# three days would make slow growth over a month look like chance; without it chances are right for errors of up to a
# day and a half. Set by hand.
TIMES = (0.3, 1.0)
# Its variance over the median variance of a spell. Set by hand: factors of four.
RATIOS = (0.0, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0)
EDGES = 31  # Possible first and last days of a ramp. Set by hand: bounds time.
# A change is a step, or a ramp that lasts until the end of the log, unless a ramp that ends before has a log likelihood
# larger by more than this. Set by hand: as AIC counts a parameter twice.
SIMPLER = 2.0
DRAWS = 200  # Draws of the bootstrap. Set by hand.
# Chance of any change that is invented in a log. With an error that lasts for a day and is larger than that of a spell,
# small chances come out up to three times too small, so that it is 0.15 % at most. Set by hand.
LEVEL = 0.0005
LEAST = 0.1  # Share of a candidate's typical size below which a change does not matter. Set by hand.
MOST = 3  # Changes that are looked for in one log. Set by hand.
# Days, in a month, between changes of several candidates that are one event: the strongest is named, the others are its
# company. Set by hand.
APART = 1.0
AGAIN = 3  # How often a named change is estimated again, with weights by what it leaves. Set by hand.


@dataclass(frozen=True)
class Spells:
    """Estimates of J candidates in B spells.

    day: mean time of each since the log began (B,); information: (B, J, J) and score: (B, J) of the candidates, whose
    estimates one by one are score / information; distance: squared, of each stretch over the median (S,).
    """

    day: np.ndarray
    information: np.ndarray
    score: np.ndarray
    distance: np.ndarray

    @property
    def unexplained(self) -> float:
        """Share of the stretches that were moved by something else and count no more."""
        return float(np.mean(self.distance >= UNEXPLAINED))

    def change_of(
        self, j: int, score: np.ndarray, last: float, rng: np.random.Generator, name: str
    ) -> DatedChange | None:
        """The best change of candidate ``j``, called ``name``, by its ``score`` (B,) in a log that lasts until ``last``
        [days]; ``rng`` draws the bootstrap. Returns None where too few spells tell anything of it."""
        own = self.information[:, j, j]
        keep = own > INFORMED * np.median(own)
        if keep.sum() < FEWEST:
            return None
        day, variance, estimate = self.day[keep], 1 / own[keep], score[keep] / own[keep]
        return ChangeTest(day, variance, last)(estimate, rng, name)


def spells(log: Innovations, begin: float, end: float, explained: np.ndarray | None = None) -> Spells:
    """Estimates in spells of at most SPELL days from the innovations of a ``log`` from ``begin`` to ``end`` [s].

    explained: errors (S, F) that a change is known to make; they do not count for the weights of their stretches.
    """
    information, score, distance = information_of(log, explained)
    sound = distance < UNEXPLAINED
    number = np.floor((log.t - begin) / min(SPELL * DAY, (end - begin) / PARTS)).astype(int)
    kinds, spell = np.unique(number, return_inverse=True)
    B, day = len(kinds), (log.t - begin) / DAY
    A = group_sums(spell, information * sound[:, None, None], B)
    b = group_sums(spell, score * sound[:, None], B)
    return Spells(np.bincount(spell, day, B) / np.bincount(spell, minlength=B), A, b, distance)


@dataclass(frozen=True)
class DatedChange:
    """The best change of a candidate, given those that were named before.

    name: of the parameter; day: mean time of each of its spells (B,); estimate: in each (B,); begin, end: first and
    last day of the change, with their 90 % intervals; step: whether both are one; size: of the change, std: its
    standard error; gain: of the log likelihood; p_value: of it, for this candidate alone; profile: share of the change
    that was reached in each spell (B,); company: names of candidates that seem to change along with it.
    """

    name: str
    day: np.ndarray
    estimate: np.ndarray
    begin: float
    end: float
    begin_90: tuple[float, float]
    end_90: tuple[float, float]
    step: bool
    size: float
    std: float
    gain: float
    p_value: float
    profile: np.ndarray
    company: tuple[str, ...] = ()

    def days_from(self, other: DatedChange) -> float:
        """Days between this change and an ``other``, at the least that their dates allow; negative where they meet."""
        return max(self.begin_90[0], other.begin_90[0]) - min(self.end_90[1], other.end_90[1])

    def at(self, day: np.ndarray) -> np.ndarray:
        """How much of the change there is at each ``day``, any shape."""
        return self.size * np.interp(day, self.day, self.profile)


@dataclass(frozen=True)
class _Noise:
    """A possible noise: whitening free of the level (B, B), log determinant, profiles of changes whitened and free of
    the level (C, B) with their lengths before (C,), Cholesky factor of the covariance (B, B)."""

    whiten: np.ndarray
    log_det: float
    profiles: np.ndarray
    lengths: np.ndarray
    colour: np.ndarray


class ChangeTest:
    """The test for spells at these ``day`` (B,), of a log that lasts until ``last`` [days].

    variance: of the estimate in each spell (B,), up to a factor.
    """

    def __init__(self, day: np.ndarray, variance: np.ndarray, last: float) -> None:
        self.day, days = day, np.linspace(0.0, last, EDGES)
        edges = 0.5 * (day[1:] + day[:-1])
        ramps = [(a, b) for a, b in combinations(days, 2) if b - a >= 1.5 * days[1]]
        self.begin = np.array([*edges, *(a for a, _ in ramps)])
        self.end = np.array([*edges, *(b for _, b in ramps)])
        span = np.maximum(self.end - self.begin, 1e-9)[:, None]
        self.shape = np.clip((day[None] - self.begin[:, None]) / span, 0.0, 1.0)
        apart, typical = np.abs(day[:, None] - day[None]), float(np.median(variance))
        self.noises = []
        times = [time * min(1.0, last / MONTH) for time in TIMES]
        for ratio in RATIOS:
            for time in times if ratio else times[:1]:
                lower = np.linalg.cholesky(np.diag(variance / typical) + ratio * np.exp(-apart / time))
                whiten = np.linalg.inv(lower)
                level = whiten.sum(axis=1) / np.linalg.norm(whiten.sum(axis=1))
                whiten -= np.outer(level, level @ whiten)  # the level is free: nothing along it counts
                profiles = self.shape @ whiten.T
                lengths = np.linalg.norm(profiles, axis=1)
                usable = np.where(lengths > 1e-6, lengths, np.inf)
                log_det = 2 * float(np.log(np.diag(lower)).sum())
                self.noises.append(_Noise(whiten, log_det, profiles / usable[:, None], usable, lower))

    def likelihoods(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log likelihood without a change (K, R) and with the best one (K, R) of series ``y`` (B, R), by noise."""
        B, none, best = len(y), [], []
        for noise in self.noises:
            z = noise.whiten @ y
            rest = (z**2).sum(axis=0)
            most = ((noise.profiles @ z) ** 2).max(axis=0)
            none.append(-0.5 * (B * np.log(rest / B) + noise.log_det))  # the size of the noise is at its likeliest
            best.append(-0.5 * (B * np.log(np.maximum(rest - most, 1e-12 * rest) / B) + noise.log_det))
        return np.array(none), np.array(best)

    def __call__(self, y: np.ndarray, rng: np.random.Generator, name: str = "") -> DatedChange:
        """The best change of the series ``y`` (B,) of the candidate ``name``; ``rng`` draws the bootstrap."""
        none, best = self.likelihoods(y[:, None])
        gain = float(best.max() - none.max())
        chosen = int(best[:, 0].argmax())
        noise, B = self.noises[chosen], len(y)
        z = noise.whiten @ y
        along = noise.profiles @ z
        rest = np.maximum((z**2).sum() - along**2, 1e-300)
        log = -0.5 * B * np.log(rest / B)  # profile likelihood: the size of the noise is at its likeliest
        # a ramp that ends has a parameter more
        log = log - SIMPLER * ((self.end > self.begin) & (self.end < self.end.max()))
        is_step = self.end == self.begin
        log = np.where(is_step == is_step[log.argmax()], log, -np.inf)  # intervals are of changes of the same kind
        at = int(log.argmax())
        weight = np.exp(log - log.max())  # as a posterior of the dates with a flat prior
        weight /= weight.sum()
        # by the noise with and without it
        p_value = max(self._chance(y, gain, k, rng) for k in {chosen, int(none[:, 0].argmax())})
        return DatedChange(
            name,
            self.day,
            y,
            float(self.begin[at]),
            float(self.end[at]),
            _interval(self.begin, weight),
            _interval(self.end, weight),
            bool(is_step[at]),
            float(along[at] / noise.lengths[at]),
            float(np.sqrt(rest[at] / max(B - 4, 1)) / noise.lengths[at]),
            gain,
            p_value,
            self.shape[at],
        )

    def _chance(self, y: np.ndarray, gain: float, chosen: int, rng: np.random.Generator) -> float:
        """Chance of such a ``gain`` without a change under the noise ``chosen``, its residuals drawn again."""
        noise = self.noises[chosen]
        z = noise.whiten @ y
        along = noise.profiles @ z
        best = int(np.abs(along).argmax())
        z = z - along[best] * noise.profiles[best]  # what is left is the noise, whether there was a change or not
        none, with_change = self.likelihoods(noise.colour @ rng.choice(z - z.mean(), size=(len(y), DRAWS)))
        gains = with_change.max(axis=0) - none.max(axis=0)
        mean, spread = float(gains.mean()), float(gains.std()) + 1e-12
        shape = (mean / spread) ** 2  # a gamma law with their mean and spread reaches beyond DRAWS
        return gamma_tail(gain, shape, mean / shape)


def _interval(days: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """5 % and 95 % quantile of ``days`` with these weights."""
    order = np.argsort(days, kind="stable")
    share = np.cumsum(weight[order])
    low, high = (days[order][min(int(np.searchsorted(share, q)), len(days) - 1)] for q in (0.05, 0.95))
    return float(low), float(high)


@dataclass(frozen=True)
class Changes:
    """What changed: named, strongest first; tested: every candidate before anything was named; spells: of all."""

    named: tuple[DatedChange, ...]
    tested: tuple[DatedChange, ...]
    spells: Spells


def find_changes(log: Innovations, begin: float, end: float, seed: int = 0) -> Changes:
    """What changed between ``begin`` and ``end`` [s] of a ``log``; seed: of the bootstrap."""
    at, J, last = spells(log, begin, end), len(log.candidates), (end - begin) / DAY
    if len(at.day) < FEWEST:
        return Changes((), (), at)
    score, least = at.score.copy(), dict(zip(log.candidates, LEAST * log.typical, strict=True))
    named, tested = list[DatedChange](), tuple[DatedChange, ...]()
    while len(named) < MOST:
        draws = [np.random.default_rng([seed, j, len(named)]) for j in range(J)]
        every = [at.change_of(j, score[:, j], last, draws[j], log.candidates[j]) for j in range(J)]
        rows = [row for row in every if row]
        tested = tested or tuple(rows)
        # Bonferroni: J were tried
        sure = [row for row in rows if row.p_value * J <= LEVEL and abs(row.size) >= least[row.name]]
        alone = sure
        for k, other in enumerate(named):
            along = {row.name for row in sure if row.days_from(other) <= APART * last / MONTH}
            named[k] = replace(other, company=tuple(sorted({*other.company, *along} - {other.name})))
            alone = [row for row in alone if row.name not in along]
        if not alone:
            break
        best = max(alone, key=lambda row: row.gain)
        # what it makes of all others
        score -= at.information[:, :, log.candidates.index(best.name)] * best.at(at.day)[:, None]
        named.append(best)
    for k, row in enumerate(named):
        others = [other for other in named if other.name != row.name]
        rng = np.random.default_rng([seed, log.candidates.index(row.name), len(named)])
        named[k] = replace(_sized(log, (begin, end), row, others, rng), company=row.company)
    return Changes(tuple(named), tested, at)


def _sized(
    log: Innovations, span: tuple[float, float], best: DatedChange, others: list[DatedChange], rng: np.random.Generator
) -> DatedChange:
    """A named change, ``best``, estimated again with weights that do not hold it, and the ``others``, against the
    stretches that show them: where a change is large they looked as if something had moved the ship.

    log: innovations from a begin to an end [s], ``span``; rng: draws the bootstrap.
    """
    day, j = (log.t - span[0]) / DAY, log.candidates.index(best.name)
    other_changes = [(log.candidates.index(row.name), row) for row in others]
    for _ in range(AGAIN):
        made = sum(log.gains[:, :, i] * row.at(day)[:, None] for i, row in [(j, best), *other_changes])
        at = spells(log, *span, made)
        score = at.score[:, j] - sum(at.information[:, j, i] * row.at(at.day) for i, row in other_changes)
        best = at.change_of(j, score, (span[1] - span[0]) / DAY, rng, best.name) or best
    return best
