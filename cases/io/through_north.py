"""A heading that was interpolated straight through 360: false samples between 359 and 1, at each crossing of north.

A resampling of numbers from 0 to 360 puts them on a line that goes the long way round, through south. The ship did not
turn so: the turn rate says it, or, without one, the rest of the record. They are mended along the turn rate.
"""

from __future__ import annotations

import math

import numpy as np

from cases.inputs import integral

MOST = 20
"""False samples of a crossing at most: a record resampled by more is no interpolation."""

QUICK = 8.0
"""A step from sample to sample that is so many times the greater ones of the record is none of the ship."""

NEAR = 0.15
"""rad; the short way between both ends of a crossing, less the integrated turn rate, is no more."""


def through_north(t: np.ndarray, psi: np.ndarray, r: np.ndarray | None) -> tuple[np.ndarray, int]:
    """``psi`` (N,) [rad] without false samples between the ends of each crossing of north, and how many crossings had
    such.

    t: (N,) [s]; r: measured turn rate (N,) [rad/s], or None; NaN where something is missing.
    """
    if len(psi) < 10:
        return psi, 0
    angle = np.mod(psi, 2 * math.pi)
    step = np.diff(angle)
    short = np.angle(np.exp(1j * step))
    rate = r if r is not None else np.zeros(len(psi))
    turned = integral(t, np.nan_to_num(rate))
    off = np.abs(short - np.diff(turned)) if r is not None else np.abs(short)
    usual = float(np.nanquantile(off, 0.75)) if np.isfinite(off).any() else 0.0
    quick = off > max(QUICK * usual, 0.5 * NEAR)
    out, count, row = psi.copy(), 0, 0
    while row < len(step):
        if not quick[row]:
            row += 1
            continue
        end = row
        while end < len(step) and quick[end] and step[end] * step[row] > 0:
            end += 1
        way, back = float(angle[end] - angle[row]), float(turned[end] - turned[row])
        straight = float(np.angle(np.exp(1j * way)))
        middle = 1 < end - row <= MOST + 1 and abs(way) > math.pi
        if middle and abs(straight - back) < NEAR + (0.1 * abs(back) if r is not None else 0.0):
            share = (t[row + 1 : end] - t[row]) / (t[end] - t[row])
            own = turned[row + 1 : end] - turned[row] if r is not None else 0.0 * share
            out[row + 1 : end] = psi[row] + own + share * (straight - back)
            count += 1
        row = max(end, row + 1)
    return out, count
