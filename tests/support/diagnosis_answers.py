"""Fits, searches and checks on test trials that a test makes up, to see what is answered."""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Trajectory
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import RefittedEffect

NOISE = NoiseModel(np.ones(3), 5.0, np.ones(6), np.zeros(6), 4.0)


def held(
    reduction: float, interval: tuple[float, float], gain: float | None = 0.0, sure: tuple[float, float] | None = None
) -> HeldOut:
    return HeldOut(1.0, 1.0 - reduction, reduction, interval, 8, {}, gain, sure)


def a_fit(nll: float) -> Estimate:
    """A fit of which only the likelihood matters."""
    zero = np.zeros(0)
    path = Trajectory(np.zeros((2, 1, 6)), np.zeros((2, 1, 3)))
    return Estimate(zero, Priors((), zero, zero, zero, zero), zero, path, NOISE, np.zeros((0, 0)), nll, 1, True)


def made_up(label: str) -> Candidate:
    """A candidate of this label without parameters."""
    effect, form = (*label.split(" "), "")[:2]
    return Candidate(effect, form, (), *4 * [np.zeros(0)])


def tried(name: str, delta_bic: float, p_value: float = 1e-6) -> RefittedEffect:
    return RefittedEffect(made_up(name), a_fit(0.0), 0.5 * delta_bic, delta_bic, p_value)
