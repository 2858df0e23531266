"""Figures of many simulated runs of one manoeuvre, read side by side."""

from __future__ import annotations

import math

import numpy as np

from cases.criteria.figures import Since, initial_turning_of, stopping_of, turning_of, zigzag_of
from cases.maneuvers.definitions import STOPS, Maneuver
from cases.simulation.simulate_batch import SimulatedRuns


def figures_of_each(runs: SimulatedRuns, plan: Maneuver) -> list[dict[str, float]]:
    """Figures, SI and rad, of each of the ``runs`` of the manoeuvre ``plan``: turning, zigzag, crash stop or
    coasting.

    They are those of ``cases.criteria.standard_runs.figures_of`` but for the means of a steady turn. Empty for a run
    that diverged. Raises KeyError for another manoeuvre.
    """
    p = plan.parameters
    rudder = p.get("rudder", 0.0)
    ten = math.isclose(abs(rudder), math.radians(10), rel_tol=1e-6)

    def figures(run: Since) -> dict[str, float]:
        if plan.kind == "zigzag":
            return zigzag_of(run, rudder, p["heading"]) | (initial_turning_of(run, rudder) if ten else {})
        if plan.kind in STOPS:
            return stopping_of(run, p.get("least", 0.0))
        return {"turning": turning_of}[plan.kind](run, rudder)

    return [figures(run) if run is not None else {} for run in since_each(runs, p["order_time"])]


def since_each(runs: SimulatedRuns, order_time: float) -> list[Since | None]:
    """Each of the ``runs`` from the order at ``order_time`` [s] on to its end; None where it diverged."""
    t, (x, y, psi, u, v, r) = runs.t, np.moveaxis(runs.states, 1, 0)
    k = min(int(np.searchsorted(t, order_time + 1e-9)), len(t) - 1)
    share = (order_time - t[k - 1]) / (t[k] - t[k - 1]) if k else 0.0

    def cut(values: np.ndarray) -> np.ndarray:
        first = values[k - 1] + share * (values[k] - values[k - 1]) if k else values[0]
        return np.concatenate([first[None], values[k:]])

    times = np.concatenate([[order_time], t[k:]]) - order_time
    x, y, psi, u, v, r = (cut(values) for values in (x, y, psi, u, v, r))
    x, y, c, s = x - x[0], y - y[0], np.cos(psi[0]), np.sin(psi[0])
    speed, step = np.hypot(u, v), np.diff(times)[:, None]
    path = np.vstack([np.zeros(u.shape[1]), np.cumsum(0.5 * step * (speed[1:] + speed[:-1]), axis=0)])
    advance, transfer, change = x * c + y * s, y * c - x * s, psi - psi[0]
    delta = cut(np.asarray(runs.inputs[:, 1]))
    found: list[Since | None] = []
    columns = [np.ascontiguousarray(values.T) for values in (advance, transfer, path, change, u, r, delta)]
    for m, last in enumerate(runs.last):
        rows = slice(0, max(int(last) - k + 2, 2))
        one = Since(times[rows], *(values[m, rows].copy() for values in columns))
        found.append(one if all(np.isfinite(values).all() for values in (one.change, one.path)) else None)
    return found
