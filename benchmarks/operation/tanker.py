"""A tanker that never stops: her own ship, Euler steps, no wind in the log, heavy-tailed and rounded sensors.

``tanker_month(folder, month)`` writes files of six hours beside each other. Weather is a force that nobody logs, with a
fast and a slow part. Each day begins anew in another place after a gap of some minutes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.operation.months import DAY, Month, late, legs, slow, steered, write_parts
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from mmg.rollout import Simulator
from mmg.ship import Ship

NOISE = {"x": 2.0, "y": 2.0, "psi": 0.001, "u": 0.04, "v": 0.04, "r": 5e-5, "n": 0.002, "delta": 0.002}
ROUNDED = {
    "psi": 0.1 * np.pi / 180,
    "r": 0.01 * np.pi / 180,
    "u": 0.02,
    "v": 0.02,
    "n": 1 / 600,
    "delta": 0.1 * np.pi / 180,
}


def tanker(seed: int | None = None) -> Ship:
    """The starting ship, or with a ``seed`` one with other coefficients."""
    ship = load_ship("kvlcc2_full")
    if seed is None:
        return ship
    rng, rows = np.random.default_rng([9, seed]), {}
    for symbol, c in ship.coefficients.items():
        value = c.value if c.fixed else c.value + 0.5 * c.std * rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 1.0)
        rows[symbol] = replace(c, value=float(np.clip(value, c.lower, c.upper)))
    return replace(ship, coefficients=rows)


def tanker_month(folder: Path, month: Month) -> None:
    """Write the ``month`` into ``folder``."""
    ship = with_effects(tanker(month.ship), ["fouling:share=0", "draft:share=0", "tow:X=0,Y=0,N=0"])
    rng, days = np.random.default_rng([2, month.seed]), month.days
    states, n, delta = _sailed(Simulator(ship), month, rng)
    t = np.arange(days * DAY, dtype=float)
    columns = dict(
        zip(("x", "y", "psi", "u", "v", "r"), (np.ascontiguousarray(s.T).ravel() for s in states), strict=True)
    )
    columns |= {"n": n.T.ravel(), "delta": delta.T.ravel()}
    columns["r"] = late(columns["r"], month.value("gyro.T", t / DAY), 1.0) * (1 + month.value("gyro.share", t / DAY))
    for name, size in NOISE.items():
        columns[name] = columns[name] + size * rng.standard_t(5, len(t)) * 0.77
    for name, grain in ROUNDED.items():
        columns[name] = np.round(columns[name] / grain) * grain
    columns["psi"] = np.remainder(columns["psi"], 2 * np.pi)
    keep = np.remainder(t, DAY) >= 600
    for _ in range(days // 4):
        at = rng.integers(0, len(t))
        keep[at : at + int(rng.uniform(300, 20000))] = False
    kept = {"t": 1.7e9 + t[keep], **{name: values[keep] for name, values in columns.items()}}
    write_parts(folder, kept, np.searchsorted(t[keep], 0.25 * DAY * np.arange(4 * days + 1)).tolist(), hive=False)


def _sailed(simulator: Simulator, month: Month, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States (6, DAY, days), revolutions and rudder (DAY, days)."""
    ship, days = simulator.ship, month.days
    wanted = np.array([legs(rng, DAY, 1500, 7000, lambda: float(rng.normal(0, 0.7))) for _ in range(days)])
    rps = np.array([_telegraph(rng) for _ in range(days)])
    theta = np.repeat(ship.values[:, None], days, axis=1)
    row = {name: ship.symbols.index(name) for name in ship.symbols}
    size = {"tow.X": 9e4, "tow.Y": 1.5e5, "tow.N": 1.2e7}
    push = {}
    for name, most in size.items():
        hours = np.arange(days * 24 + 1) * 3600.0
        weather = np.interp(np.arange(days * DAY), hours, slow(rng, len(hours), 3600.0, DAY, most))
        push[name] = (weather + slow(rng, days * DAY, 1.0, 40.0, 1.5 * most)).reshape(days, DAY)
    states, n, delta = np.empty((6, DAY, days)), np.empty((DAY, days)), np.empty((DAY, days))
    state, rudder, shaft = np.zeros((6, days)), np.zeros(days), rps[:, 0].copy()
    state[2], state[3] = wanted[:, 0], 7.0
    for k in range(DAY):
        states[:, k], n[k], delta[k] = state, shaft, rudder
        aim = steered(wanted[:, k], state[2], state[5], (0.9, 60.0), 0.35)
        rudder = rudder + np.clip(aim - rudder, -0.04, 0.04)
        shaft = shaft + np.clip(rps[:, k] - shaft, -0.005, 0.005)
        when = np.arange(days) + k / DAY
        theta[row["fouling.share"]], theta[row["draft.share"]] = (
            month.value("fouling.share", when),
            month.value("draft.share", when),
        )
        for name, values in push.items():
            theta[row[name]] = values[:, k]
        given = {"n": shaft, "delta": rudder}
        inputs = np.array([given.get(name, np.zeros(days)) for name in ship.inputs])
        state = simulator.run(state, np.stack([inputs, inputs]), 0.5, theta, method="euler")[-1]
    return states, n, delta


def _telegraph(rng: np.random.Generator) -> np.ndarray:
    """Revolutions ordered over a day (DAY,)."""
    out, at = np.empty(DAY), 0
    while at < DAY:
        until = at + int(rng.uniform(4000, 20000))
        out[at:until], at = rng.uniform(1.2, 1.75), until
    return out
