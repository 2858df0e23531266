"""How probable it is that an instrument is the same in all campaigns and only seems to differ.

Two sources. Heading and turn rate, position and velocities follow from one another: they show some instruments in each
run without any model of the ship (cases/evidence/kinematics), and so free of what the model lacks in one kind of
manoeuvre. For the others the windows of each run say what value of its own it would have, linearised at the
calibration. Either way values by run are compared between campaigns as random effects: a difference must exceed what
the runs of one campaign scatter (fitting/uncertainty/group_test). A standard error over all runs would ask another
question: whether most runs gain, and what differs on a single day would never be found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.evidence.kinematic_words import TRACK, TURN, Quantity
from cases.evidence.kinematics import Kinematics
from fitting.selection.campaigns.candidates import Beside, Instrument
from fitting.selection.campaigns.readings import RunReadings
from fitting.uncertainty.group_test import GroupTest, group_test, holm
from mmg.motion.froude import time_scale

LEVEL = 0.05
"""Probability by chance, corrected for the number of instruments, below which an instrument differs."""
SEEN_BY = {"gyro.T": "lag_r", "gyro.share": "gain_r", "log_scale.share": "gain_u"}
"""What the kinematics call the constants that they show."""


@dataclass(frozen=True)
class ByChance:
    """Of an instrument: the probability p by chance, corrected for their number, and its readings by run where it was
    measured by the kinematics, None where by the model."""

    p: float
    readings: RunReadings | None

    @property
    def measured(self) -> bool:
        """Whether the kinematics show it."""
        return self.readings is not None

    @property
    def differs(self) -> bool:
        """Whether the instrument differs between campaigns, beyond chance."""
        return self.p < LEVEL


def chances(
    beside: Beside,
    logs: Kinematics | None,
    number: Sequence[int],
    started: Sequence[int],
    dispersion: float,
) -> list[ByChance]:
    """Of each candidate of ``beside`` a calibration, whether it differs between campaigns.

    logs: of the trials, as ``kinematics_of`` (cases/evidence/kinematics) gives them; None where no candidate is seen by
    them; number: of the campaign of each trial; started: numbers of the candidates that the calibration has already,
    with one value for all; dispersion: how much more the scores of windows vary than their information says.
    """
    group = np.array(number)
    p: list[float] = []
    readings: list[RunReadings | None] = []
    for i, candidate in enumerate(beside.candidates):
        quantity = _quantity(candidate) if logs else None
        measured = _measured_test(logs, quantity, beside, group) if logs and quantity else None
        test = measured[0] if measured else _model_test(beside, i, group, started, dispersion)
        readings.append(measured[1] if measured else None)
        p.append(test.p_single if test else 1.0)
    return [ByChance(float(q), r) for q, r in zip(holm(p), readings, strict=True)]


def seen_by_kinematics(candidates: Sequence[Instrument]) -> bool:
    """Whether heading and turn rate, position and velocities show one of the ``candidates``."""
    return any(_quantity(c) for c in candidates)


def _quantity(candidate: Instrument) -> Quantity | None:
    """What the kinematics show of a ``candidate``, None for what they do not."""
    name = SEEN_BY.get(candidate.symbols[0]) if len(candidate.symbols) == 1 else None
    return next((q for q in (*TRACK, *TURN) if q.symbol == name), None)


def _measured_test(
    logs: Kinematics, q: Quantity, beside: Beside, group: np.ndarray
) -> tuple[GroupTest, RunReadings] | None:
    """The test of the readings of ``q`` by run, in units of the least size that matters, and the readings; None where
    too few runs have one."""
    size = q.threshold * time_scale(float(beside.problem.ship.particulars["L"])) ** (2 * q.power)
    readings = [run[q.symbol] for run in logs.runs]
    value, std = (np.array([getattr(x, a) for x in readings]) / size for a in ("value", "std"))
    usable = [not run.faults for run in logs.runs]
    good = np.isfinite(value) & np.isfinite(std) & (std > 0) & np.array(usable)
    if len(np.unique(group[good])) < 2 or good.sum() <= len(np.unique(group[good])):
        return None
    test = group_test(value[good] / std[good] ** 2, np.diag(std[good] ** -2.0), group[good], 1)
    if test is None:
        return None
    both = np.where(good, size * np.sqrt(std**2 + test.scatter[0] ** 2), np.nan)
    return test, RunReadings(np.where(good, size * value, np.nan), both, group)


def _model_test(
    beside: Beside, number: int, group: np.ndarray, started: Sequence[int], dispersion: float
) -> GroupTest | None:
    """The test of what the model says of the candidate of this ``number`` in each run, in its typical sizes.

    What all runs share is free: the coefficients, and one value of the instruments that are ``started``.
    """
    info = beside.info.by_run()
    own = _columns(beside, np.flatnonzero(beside.block == number))
    n, Q = len(info.run), own.shape[1]
    first = beside.constants[0]
    whole = [own[:, q] for q in range(Q) if number in started]
    whole += [_columns(beside, np.flatnonzero(beside.block == k))[:, 0] for k in started if k != number]
    basis = np.zeros((len(info.p), first + len(whole)))
    basis[:first, :first] = np.eye(first)
    for k, columns in enumerate(whole):
        basis[columns, first + k] = 1.0
    at = own[group[info.run]]
    F = np.array([H[columns] @ basis for H, columns in zip(info.fisher, at, strict=True)]).reshape(n * Q, -1)
    score = np.array([s[columns] for s, columns in zip(info.score, at, strict=True)]).ravel()
    free = np.eye(first + len(whole)) * 1e-9
    free[:first, :first] += info.prior_information[:first, :first]
    total = basis.T @ info.fisher.sum(axis=0) @ basis + free
    slope = basis.T @ info.score.sum(axis=0)
    slope[:first] += info.prior_score[:first]
    solved = np.linalg.solve(total, np.column_stack([F.T, slope]))
    S = -F @ solved[:, :-1]
    for k, (H, columns) in enumerate(zip(info.fisher, at, strict=True)):
        part = slice(k * Q, (k + 1) * Q)
        S[part, part] += H[np.ix_(columns, columns)]
    g = -score + F @ solved[:, -1]
    return group_test(g / dispersion, 0.5 * (S + S.T) / dispersion, group[info.run], Q)


def _columns(beside: Beside, constants: np.ndarray) -> np.ndarray:
    """Columns (campaigns, Q) of these ``constants`` (numbers among all) of one candidate."""
    symbols = np.unique(beside.symbol[constants])
    return np.array([beside.constants[constants[beside.symbol[constants] == s]] for s in symbols]).T
