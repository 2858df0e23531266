"""What was ordered in a measured zigzag: rudder and heading by name, from what the record shows.

The rudder begins to move when the heading has passed the one that was ordered, by what passes in a sample and in the
reaction of helmsman and steering gear. Orders are usual angles; another one is believed where the record shows it.
"""

from __future__ import annotations

import math

import numpy as np

STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
"""Angles that are ordered as a rule [deg]."""

NAMED, SHARE = 0.6, 0.07
"""A measured angle is called one of STEPS within this [deg], or this share of it."""

SMALL, NAMED_SMALL = 5.0, 0.4
"""Below this [deg] the usual steps are close together, and a measured angle must be within the second."""

RESOLUTION = math.radians(0.1)
"""To which a heading is read [rad]."""

FARTHER = 3.0
"""Headings at reversals that are so many times nearer to one heading than to a reaction after a usual one were ordered
there."""


def nominal(angle: float, late: float = 0.0, early: float = 0.0, rudder: float = 0.0) -> float:
    """The usual angle [deg] that an ``angle`` >= 0 [rad] stands for, or its whole degrees where it is none.

    late, early: what the order may have come too late or too early [rad]; a small step stands back behind one of 5 deg
    and more, and each behind that of the ``rudder`` [deg], as in the zigzags of the standard.
    """
    degrees, more, less = (math.degrees(x) for x in (angle, late, early))
    large = max(NAMED, SHARE * degrees)

    def off(step: float) -> float:
        """How far the angle is from ``step``, by how far it may be."""
        near, beyond = min(large, NAMED_SMALL) if step < SMALL else large, degrees - step
        return beyond / (near + more) if beyond > 0 else -beyond / (near + less)

    fits = [step for step in STEPS if off(step) <= 1]
    return min(fits, key=lambda step: (step != rudder, step < SMALL, off(step))) if fits else float(round(degrees))


def ordered_at_once(psi: np.ndarray, signs: np.ndarray, rates: np.ndarray, named: float, near: float) -> bool:
    """Whether the rudder was reversed at one heading, and not a time after the heading ``named`` [deg].

    psi, signs, rates: headings [rad] at the reversals, signs of the turn, yaw rates [rad/s] (N,). After a
    reaction she has turned farther where she turns faster; near: to which either explains the headings, beside their
    RESOLUTION [rad].
    """
    if len(psi) < 3:
        return False

    def off(shape: np.ndarray, given: np.ndarray) -> float:
        """What is left of ``given`` by a base course and a multiple of ``shape``."""
        columns = np.column_stack([np.ones(len(psi)), shape])
        return float(np.abs(given - columns @ np.linalg.lstsq(columns, given, rcond=None)[0]).max())

    near += RESOLUTION
    at_one, after = off(signs, psi), off(signs * rates, psi - signs * math.radians(named))
    return at_one <= near < after and FARTHER * at_one < after
