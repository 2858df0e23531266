"""Figures of the standard manoeuvres from a trial: turning circle, zigzag overshoots, stopping distance.

Definitions of IMO MSC.137(76): origin and axes are midship and heading when the order is given; samples are
interpolated linearly. Lengths in metres, angles in radians, times in seconds; what was not reached is absent.
"""

from __future__ import annotations

import math

import numpy as np

from cases.trial import Trial


def _from_order(trial: Trial, order_time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t since the order, advance, transfer (to starboard), change of heading, each (M,)."""
    first = int(np.searchsorted(trial.t - trial.t[0], order_time - 1e-9))
    first = min(first, len(trial) - 1)
    states = trial.states[first:]
    x, y, psi = states[:, 0] - states[0, 0], states[:, 1] - states[0, 1], states[0, 2]
    advance, transfer = x * math.cos(psi) + y * math.sin(psi), y * math.cos(psi) - x * math.sin(psi)
    return trial.t[first:] - trial.t[first], advance, transfer, states[:, 2] - psi


def _when(change: np.ndarray, level: float) -> float | None:
    """Fractional row at which ``change`` first reaches ``level`` > 0, None if it never does."""
    reached = np.flatnonzero(change >= level)
    if len(reached) == 0:
        return None
    k = int(reached[0])
    return 0.0 if k == 0 else k - 1 + (level - change[k - 1]) / (change[k] - change[k - 1])


def turning_figures(trial: Trial, rudder: float, order_time: float) -> dict[str, float]:
    """advance, transfer (at 90 deg), tactical_diameter (at 180 deg) [m] and the times they take [s].

    rudder [rad] gives the side; order_time [s] after the first sample.
    """
    t, advance, transfer, change = _from_order(trial, order_time)
    side, rows, figures = math.copysign(1.0, rudder), np.arange(len(t)), {}
    quarter, half = _when(side * change, math.pi / 2), _when(side * change, math.pi)
    if quarter is not None:
        figures["advance"] = float(np.interp(quarter, rows, advance))
        figures["transfer"] = float(np.interp(quarter, rows, side * transfer))
        figures["time_90"] = float(np.interp(quarter, rows, t))
    if half is not None:
        figures["tactical_diameter"] = float(np.interp(half, rows, side * transfer))
        figures["time_180"] = float(np.interp(half, rows, t))
    return figures


def zigzag_figures(trial: Trial, rudder: float, heading: float, order_time: float) -> dict[str, float]:
    """overshoot_1, overshoot_2, ... [rad]: largest heading after each counter order, less the switch one.

    rudder [rad] gives the first side, heading [rad] > 0 is the switch heading. An overshoot counts once the
    heading has come back to the switch heading.
    """
    _, _, _, change = _from_order(trial, order_time)
    side, row, figures = math.copysign(1.0, rudder), 0, {}
    for k in range(1, len(change)):
        beyond = np.flatnonzero(side * change[row:] >= heading)
        if len(beyond) == 0:
            break
        row += int(beyond[0])
        back = np.flatnonzero(side * change[row:] < heading)
        if len(back) == 0:
            break
        end = row + int(back[0])
        figures[f"overshoot_{k}"] = float((side * change[row:end]).max() - heading)
        row, side = end, -side
    return figures


def stopping_figures(trial: Trial, order_time: float) -> dict[str, float]:
    """track_reach (along the path), head_reach (ahead) [m] and stopping_time [s] until headway is lost."""
    t, advance, transfer, _ = _from_order(trial, order_time)
    u = trial["u"][-len(t) :]
    stop = _when(u[0] - u, u[0]) if u[0] > 0 else None
    if stop is None:
        return {}
    path = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(advance), np.diff(transfer)))])
    rows = np.arange(len(t))
    series = {"track_reach": path, "head_reach": advance, "stopping_time": t}
    return {name: float(np.interp(stop, rows, values)) for name, values in series.items()}
