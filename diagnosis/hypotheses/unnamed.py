"""Test of unnamed forms: whether the dictionary explains more of the trials than chance does.

Whether the columns of a kind explain more than chance is a ratio of marginal likelihoods (Bayes factor) with a Gaussian
prior on their sizes, averaged over SIZES: it grows only if there is something, since every column costs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import DrivenColumns, ProductColumns
from diagnosis.estimation.linearisation import Point, linearise_and_filter, timing_columns
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from diagnosis.hypotheses.dictionary import FORCES, Dictionary
from diagnosis.hypotheses.events import Events, event_slopes
from diagnosis.hypotheses.score_test import dispersion, memory_steps, projected

SENSOR = "sensor of "  # Begin of the kinds that are errors of a sensor
# Prior standard deviations of a column's coefficient, in the sizes of what is random.
SIZES = (0.03, 0.1, 0.3, 1.0)  # set by hand: factors of three
# Prior variances of a force along each direction of its kind, in squared standard errors of what the trials say of it
# (Zellner 1986; Liang et al. 2008), but no more than the largest of SIZES. A force whose parts are small in each column
# alone, as a step made of polynomials is, gains by that.
MULTIPLES = (0.25, 1.0, 4.0)
# Errors of a sensor of this size, in standard deviations of its noise, are none: no instrument is exact.
TOLERANCE = 0.05  # set by hand
# Information from which a direction is seen: forms that add up to nothing on the trials may have a slope yet.
SEEN = 0.01  # set by hand


@dataclass(frozen=True)
class UnnamedSlopes:
    """Slopes g (C,) of the log likelihood along the columns of a ``dictionary``, the free parameters projected out, and
    their information S (C, C).

    dispersion: of errors of sensors, by kind, the ratio of the slopes' variance to that information, at least 1: it is
    larger where residuals are correlated in time, as of sensors with a memory; taken: (P, c) multiples of the free
    parameters that were projected out, by the columns of the dictionary, which are the first; those of ``events``
    follow, kind by kind, as if independent of all others; of_events: size of events, by kind, that is nothing.
    """

    g: np.ndarray
    S: np.ndarray
    dictionary: Dictionary
    dispersion: dict[str, float]
    taken: np.ndarray
    events: tuple[str, ...] = ()
    of_events: Mapping[str, float] = field(default_factory=dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each column."""
        return (*self.dictionary.kinds, *self.events)

    @property
    def allowed(self) -> np.ndarray:
        """What each column (C,) may be off where nothing is wrong."""
        return np.array([TOLERANCE if k.startswith(SENSOR) else self.of_events.get(k, 0.0) for k in self.kinds])

    def statistics(self, g: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Log Bayes factors (...) of all kinds in equal parts, of the best force alone less the log of their number,
        and of each kind, at slopes ``g`` (..., C)."""
        kinds, allowed = np.array(self.kinds), self.allowed
        ratio = np.array([self.dispersion.get(k, 1.0) for k in self.kinds])
        g, S = g / ratio, self.S / ratio  # an overdispersed kind says less, slopes and information alike
        single = np.isin(kinds, FORCES)
        own = {name: kinds == name for name in sorted(set(self.kinds))}
        logs = {
            name: log_bayes(g, S, at, allowed[at].max(), MULTIPLES if name in FORCES else ())
            for name, at in own.items()
        }
        # each kind as likely before
        mixture = np.logaddexp.reduce(np.stack(list(logs.values())), axis=0) - np.log(len(logs))
        alone = _logs_of(g[..., single, None], np.diag(S)[single, None], 0.0)  # each column by itself
        each = np.logaddexp.reduce(alone, axis=0) - np.log(len(alone))
        return mixture, each.max(axis=-1) - np.log(single.sum()), logs


@dataclass(frozen=True)
class UnnamedForms:
    """What the unnamed forms explain, as log Bayes factors: ``mixture`` of all kinds in equal parts, of each kind, and
    of the best force alone less the log of their number (single); slopes: of the likelihood along all columns."""

    mixture: float
    by_kind: dict[str, float]
    single: float
    slopes: UnnamedSlopes

    @property
    def evidence(self) -> float:
        """For something without a name, in log units."""
        return max(self.mixture, self.single)


def unnamed_forms(steps: TransitionModel, data: GriddedTrials, point: Point) -> UnnamedForms:
    """Test the unnamed forms at the fitted hypothesis ``point`` of ``steps`` to ``data``."""
    slopes = unnamed_slopes(steps, data, point)
    mixture, single, by_kind = slopes.statistics(slopes.g)
    return UnnamedForms(float(mixture), {kind: float(log) for kind, log in by_kind.items()}, float(single), slopes)


def unnamed_slopes(steps: TransitionModel, data: GriddedTrials, point: Point) -> UnnamedSlopes:
    """The slopes along all columns of the dictionary at a fit.

    steps: the transition model; data: the trials; point: the fit.
    """
    active = active_states(steps, point.free.symbols, point.theta)
    forms = Dictionary(steps, data, point, active)
    timing = timing_columns(steps, data, point, active)
    length, events = float(steps.ship.particulars["L"]), []

    def columns_of(linear: LinearModel) -> list[ProductColumns | DrivenColumns]:
        events.append(Events.of(data, forms, linear, length))
        # timing first: projected out with p
        return [DrivenColumns.pushing(timing), *forms.columns(linear), *events[0].columns]

    linearised = linearise_and_filter(steps, data, point, active, columns_of, is_brief=True)
    p = np.concatenate([point.p, np.zeros(timing.shape[3])])  # the time of the inputs is projected out, too
    P, C = len(p), len(p) + len(forms.kinds)
    by_free = linearised.logdet_gradient.sum(axis=0)[:P]
    white = linearised.white
    flat = white.reshape(-1, white.shape[3])
    own, gram = flat[:, :C], np.empty((C + 1, C + 1))
    gram[:C, :C], gram[C, :C] = own.T @ own, flat[:, -1] @ own  # products with the residual stand last
    gram[:, C] = np.append(gram[C, :C], flat[:, -1] @ flat[:, -1])
    rest = projected(gram, np.concatenate([by_free, forms.logdet_gradient(linearised)]), p)
    lags = memory_steps(length, data.h)
    ratios = {}
    for name in (k for k in dict.fromkeys(forms.kinds) if k.startswith(SENSOR)):
        own = np.flatnonzero([k == name for k in forms.kinds])
        columns = white[..., P + own] - white[..., :P] @ rest.taken[:, own]
        S = rest.S[np.ix_(own, own)]
        ratios[name] = dispersion(columns, white[..., -1], rest.g[own], S, lags, linearised.rows)
    others = white[..., [*range(P), *range(C, white.shape[3])]]
    there = event_slopes(others, by_free, p, events[0].logdet_gradient(linearised), events[0].kinds)
    g = np.concatenate([rest.g, *(each.g for each in there.values())])
    S = block_diag(rest.S, *(each.S for each in there.values()))
    kinds = tuple(kind for kind, each in there.items() for _ in each.g)
    return UnnamedSlopes(g, S, forms, ratios, rest.taken[: len(point.p)], kinds, events[0].allowed)


def log_bayes(
    g: np.ndarray,
    S: np.ndarray,
    chosen: np.ndarray,
    tolerance: float = 0.0,
    multiples: Sequence[float] = (),
) -> np.ndarray:
    """Log Bayes factors (...) of the columns ``chosen`` (C,), averaged over the prior SIZES above the tolerance.

    g: (..., C) slopes of the log likelihood along all columns; S: (C, C) their information; tolerance: standard
    deviation of what a column may be off where nothing is wrong, too; multiples: prior variances along each direction,
    in squared standard errors, over which is averaged as well.
    """
    g, S = g[..., chosen], S[np.ix_(chosen, chosen)]
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    seen = values > SEEN
    along = np.where(seen, g @ vectors, 0.0)  # rounding along what the trials do not see
    logs = _logs_of(along, np.maximum(values, 0.0), tolerance)
    squared = along**2 / np.where(seen, values, 1.0)
    for m in (np.where(seen, np.minimum(multiple, max(SIZES) ** 2 * values), 0.0) for multiple in multiples):
        # g-prior: variance m / S along each direction
        logs.append(0.5 * (squared * (m / (1 + m)) - np.log1p(m)).sum(axis=-1))
    return np.asarray(np.logaddexp.reduce(logs, axis=0) - np.log(len(logs)))


def _logs_of(along: np.ndarray, values: np.ndarray, tolerance: float) -> list[np.ndarray]:
    """The same for each of SIZES."""
    null = 1 + tolerance**2 * values
    logs = []
    for a in [a for a in SIZES if a > tolerance] or [3.0 * tolerance]:
        other = 1 + a**2 * values
        # of two Gaussian marginal likelihoods
        gain = along**2 * ((a**2 - tolerance**2) / (null * other)) - np.log(other / null)
        logs.append(0.5 * gain.sum(axis=-1))
    return logs
