"""Whether one candidate changed in the course of a log, and when.

Its estimates in the spells are a level, a change that runs straight from a first to a last day (a step where both are
the same), an error that the information of each spell says, and an error that lasts: weather, tide, what the model has
wrong at some speeds, an Ornstein-Uhlenbeck process whose size and duration are estimated along. The statistic is the
gain in log likelihood of the best change. Its law without a change comes from a bootstrap of the fitted noise: the
whitened residuals are drawn again, and everything is estimated again on each draw.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cases.evidence.tails import gamma_tail

TIMES = (0.3, 1.0)
"""Durations of the error that lasts [days], in a log of MONTH days or more; in proportion in a shorter one. An error of
three days would make slow growth over a month look like chance; without it chances are right for errors of up to a day
and a half."""

MONTH, EDGES = 30.0, 31
"""Days of a month, and possible first and last days of a ramp."""

RATIOS = (0.0, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0)
"""Its variance over the median variance of a spell."""

DRAWS = 200
SIMPLER = 2.0
"""A change is a step, or a ramp that lasts until the end of the log, unless a ramp that ends before has a log
likelihood larger by more than this."""


@dataclass(frozen=True)
class DatedChange:
    """A change of a candidate.

    begin, end: first and last day of it, with their 90 % intervals; half: day when half of it was reached; step:
    whether both are one; size: of the change, std: its standard error; gain: of the log likelihood; p_value: of it,
    for this candidate alone; profile: share of the change that was reached in each spell (B,).
    """

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

    @property
    def half(self) -> float:
        """Day when half of the change was reached."""
        return 0.5 * (self.begin + self.end)


@dataclass(frozen=True)
class _Noise:
    """A possible noise: whitening (B, B), log determinant, profiles of changes whitened and free of the level (C, B)
    with their lengths before (C,), whitened level (B,)."""

    whiten: np.ndarray
    log_det: float
    profiles: np.ndarray
    lengths: np.ndarray
    level: np.ndarray
    colour: np.ndarray


class ChangeTest:
    """The test for spells at these ``day`` (B,), of a log that lasts until ``last`` [days].

    variance: of the estimate in each spell (B,), up to a factor.
    """

    def __init__(self, day: np.ndarray, variance: np.ndarray, last: float) -> None:
        days = np.linspace(0.0, last, EDGES)
        edges = 0.5 * (day[1:] + day[:-1])
        ramps = [(a, b) for a, b in combinations(days, 2) if b - a >= 1.5 * days[1]]
        self.begin = np.array([*edges, *(a for a, _ in ramps)])
        self.end = np.array([*edges, *(b for _, b in ramps)])
        span = np.maximum(self.end - self.begin, 1e-9)[:, None]
        self.shape = np.clip((day[None] - self.begin[:, None]) / span, 0.0, 1.0)
        apart = np.abs(day[:, None] - day[None])
        typical = float(np.median(variance))
        self.noises = []
        times = [time * min(1.0, last / MONTH) for time in TIMES]
        for ratio in RATIOS:
            for time in times if ratio else times[:1]:
                lower = np.linalg.cholesky(np.diag(variance / typical) + ratio * np.exp(-apart / time))
                whiten = np.linalg.inv(lower)
                level = whiten.sum(axis=1)
                level /= np.linalg.norm(level)
                profiles = self.shape @ whiten.T
                profiles -= np.outer(profiles @ level, level)
                lengths = np.linalg.norm(profiles, axis=1)
                usable = np.where(lengths > 1e-6, lengths, np.inf)
                log_det = 2 * float(np.log(np.diag(lower)).sum())
                self.noises.append(_Noise(whiten, log_det, profiles / usable[:, None], usable, level, lower))

    def likelihoods(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log likelihood without a change (K, R) and with the best one (K, R) of series ``y`` (B, R), by noise."""
        B, none, best = len(y), [], []
        for noise in self.noises:
            z = noise.whiten @ y
            z = z - np.outer(noise.level, noise.level @ z)
            rest = (z**2).sum(axis=0)
            most = (noise.profiles @ z).__pow__(2).max(axis=0)
            none.append(-0.5 * (B * np.log(rest / B) + noise.log_det))
            best.append(-0.5 * (B * np.log(np.maximum(rest - most, 1e-12 * rest) / B) + noise.log_det))
        return np.array(none), np.array(best)

    def __call__(self, y: np.ndarray, rng: np.random.Generator) -> DatedChange:
        """The best change of the series ``y`` (B,); ``rng`` draws the bootstrap."""
        none, best = self.likelihoods(y[:, None])
        gain = float(best.max() - none.max())
        chosen = int(best[:, 0].argmax())
        noise, B = self.noises[chosen], len(y)
        z = noise.whiten @ y
        z = z - noise.level * (noise.level @ z)
        along = noise.profiles @ z
        rest = np.maximum((z**2).sum() - along**2, 1e-300)
        log = -0.5 * B * np.log(rest / B)
        log = log - SIMPLER * ((self.end > self.begin) & (self.end < self.end.max()))
        step = bool(self.end[int(log.argmax())] == self.begin[int(log.argmax())])
        log = np.where((self.end == self.begin) == step, log, -np.inf)
        at = int(log.argmax())
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        p_value = max(self._chance(y, gain, k, rng) for k in {chosen, int(none[:, 0].argmax())})
        return DatedChange(
            float(self.begin[at]),
            float(self.end[at]),
            _interval(self.begin, weight),
            _interval(self.end, weight),
            step,
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
        z = z - noise.level * (noise.level @ z)
        along = noise.profiles @ z
        best = int(np.abs(along).argmax())
        z = z - along[best] * noise.profiles[best]
        draws = noise.colour @ rng.choice(z - z.mean(), size=(len(y), DRAWS))
        none, with_change = self.likelihoods(draws)
        gains = with_change.max(axis=0) - none.max(axis=0)
        mean, spread = float(gains.mean()), float(gains.std()) + 1e-12
        shape = (mean / spread) ** 2
        return gamma_tail(gain, shape, mean / shape)


def _interval(days: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """5 % and 95 % quantile of ``days`` with these weights."""
    order = np.argsort(days, kind="stable")
    share = np.cumsum(weight[order])
    low, high = (days[order][min(int(np.searchsorted(share, q)), len(days) - 1)] for q in (0.05, 0.95))
    return float(low), float(high)
