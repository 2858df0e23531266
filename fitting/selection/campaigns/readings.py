"""What the kinematics read of an instrument in each run, as data on its constants by campaign.

Heading and turn rate, position and velocities are tied by kinematics alone, so a reading holds whatever the model of
the ship lacks; in the fit the same constants are blurred by all that the model does not describe. A reading d_i of run
i is therefore one more observation N(d_i; constant of its campaign, s_i^2 + scatter between runs), which leaves with
its run where that is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.nlp.fisher_information import Information
from fitting.nlp.prior import Prior
from fitting.nlp.run_constants import ByCampaign
from fitting.selection.campaigns.spread import Reduced


@dataclass(frozen=True)
class RunReadings:
    """Readings of one constant by run: value, std (R,) in its unit, NaN where a run has none; std holds the scatter
    between runs; number: (R,) of the campaign of each run."""

    value: np.ndarray
    std: np.ndarray
    number: np.ndarray

    def precision(self) -> np.ndarray:
        """1 / std^2 (R,), 0 where there is no reading."""
        return np.where(np.isfinite(self.std), 1.0 / np.square(np.nan_to_num(self.std, nan=1.0)), 0.0)

    def of_campaigns(self, count: int) -> tuple[tuple[float, float], ...]:
        """Value and std of each of ``count`` campaigns; std is infinite for one without a reading."""
        weight = self.precision()
        total = np.bincount(self.number, weight, count)
        sums = np.bincount(self.number, weight * np.nan_to_num(self.value), count)
        good = total > 0
        value = np.where(good, sums / np.where(good, total, 1.0), 0.0)
        std = np.where(good, 1.0 / np.sqrt(np.where(good, total, 1.0)), np.inf)
        return tuple(zip(value.tolist(), std.tolist(), strict=True))


@dataclass(frozen=True)
class ReadConstant:
    """Where the constant of ``readings`` stands among scaled coefficients p: columns, centre, unit (campaigns,), so
    that its value in campaign c is centre[c] + unit[c] p[columns[c]]."""

    readings: RunReadings
    columns: np.ndarray
    centre: np.ndarray
    unit: np.ndarray


def with_readings(info: Information, read: Sequence[ReadConstant]) -> Information:
    """``info`` with one more row for each run: what its readings say of the constants that were ``read``."""
    if not read:
        return info
    runs = np.arange(len(read[0].readings.number))
    fisher = np.zeros((len(runs), len(info.p), len(info.p)))
    score = np.zeros((len(runs), len(info.p)))
    for one in read:
        c = one.readings.number
        at, weight = one.columns[c], one.unit[c] ** 2 * one.readings.precision()
        off = info.p[at] - (np.nan_to_num(one.readings.value) - one.centre[c]) / one.unit[c]
        fisher[runs, at, at] += weight
        score[runs, at] += weight * off
    return replace(
        info,
        fisher=np.concatenate([info.fisher, fisher]),
        score=np.concatenate([info.score, score]),
        run=np.concatenate([info.run, runs]),
    )


def reduced_with(info: Information, read: Sequence[ReadConstant], constants: np.ndarray, dispersion: float) -> Reduced:
    """The ``Reduced`` cost of ``info`` in the ``constants`` (K,) columns, the readings of those ``read`` with it.

    dispersion: of the windows; readings have their own standard errors.
    """
    windows, whole = Reduced.of(info, constants, dispersion), with_readings(info, read)
    new = slice(len(info.run), None)
    A, slope = whole.fisher[new].sum(axis=0), whole.score[new].sum(axis=0)
    return Reduced(windows.A + A[np.ix_(constants, constants)], windows.b + (slope - A @ info.p)[constants])


def readings_as_rows(
    info: Information, prior: Prior, own: ByCampaign, readings: Mapping[str, RunReadings]
) -> Information:
    """``info`` of a fit whose ``prior`` holds what ``own`` was told of its constants, with the ``readings`` (by symbol)
    as rows of their runs instead, so that a run that is left out takes its reading along."""
    shared, Q, C = prior.shared, len(own.symbols), len(own.names)
    read, known, slope = [], info.prior_information.copy(), info.prior_score.copy()
    for k, symbol in enumerate(own.symbols):
        if symbol not in readings:
            continue
        columns = shared + Q * np.arange(C) + k
        one = ReadConstant(readings[symbol], columns, prior.mean[columns], prior.std[columns])
        read.append(one)
        alone = with_readings(info, [one])
        rows = slice(len(info.run), None)
        total = alone.fisher[rows].sum(axis=0)
        known[np.ix_(columns, columns)] -= total[np.ix_(columns, columns)]
        slope[columns] -= alone.score[rows].sum(axis=0)[columns]
    return with_readings(replace(info, prior_information=known, prior_score=slope), read)
