"""Which windows of a long log tell most about the coefficients: D-optimal, one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.nlp.group_sums import group_sums
from fitting.prediction.innovations import UNEXPLAINED, Innovations, information_of

LEAST = 0.02
"""The choice ends where a further window adds less than this to the mean log information of a coefficient."""


@dataclass(frozen=True)
class ChosenWindows:
    """Chosen windows. windows: their numbers, the one that tells most first; gains: log determinant of the information
    that each adds; of: windows that were looked at; all: log determinant that all of them together add."""

    windows: tuple[int, ...]
    gains: tuple[float, ...]
    of: int
    all: float


def window_information(found: Innovations) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the windows (W,) and their information (W, P, P) on the candidates of ``found``, in units of their
    typical sizes. Windows with a stretch that was moved by something else are left out."""
    information, _, distance = information_of(found)
    windows, position = np.unique(found.window, return_inverse=True)
    information *= np.outer(found.typical, found.typical)
    total, worst = group_sums(position, information, len(windows)), np.zeros(len(windows))
    np.maximum.at(worst, position, distance)
    sound = worst < UNEXPLAINED
    return windows[sound], total[sound]


def choose_windows(found: Innovations, most: int) -> ChosenWindows:
    """At most so many windows of ``found``, whose candidates are coefficients: each adds most to the log determinant of
    the information that those before it have, beginning with the prior (typical sizes are its standard deviations)."""
    numbers, information = window_information(found)
    P = len(found.typical)
    known, left, chosen, gains = np.eye(P), np.ones(len(numbers), bool), list[int](), list[float]()
    whole = float(np.linalg.slogdet(known + information.sum(axis=0))[1]) if len(numbers) else 0.0
    while left.any() and len(chosen) < most:
        now = np.linalg.slogdet(known)[1]
        gain = np.where(left, np.linalg.slogdet(known + information)[1] - now, -np.inf)
        best = int(gain.argmax())
        if chosen and gain[best] < LEAST * P:
            break
        chosen.append(int(numbers[best]))
        gains.append(float(gain[best]))
        known, left[best] = known + information[best], False
    return ChosenWindows(tuple(chosen), tuple(gains), len(numbers), whole)
