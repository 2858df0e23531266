"""A coaster that lies in port every night: sea legs, course changes, tugs, gaps, wind that is logged, tide that is not.

``coaster_month(folder, month)`` writes the days as partitioned Parquet. The motion is integrated by Runge-Kutta.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.operation.months import DAY, Month, late, legs, slow, steered, write_parts
from cases.shipfiles.effects import with_effects
from cases.shipfiles.new_ship import new_ship
from mmg.rollout import Simulator
from mmg.ship import Ship

PARTICULARS = {"L": 150.0, "B": 24.0, "d": 8.0, "C_b": 0.72, "U_0": 7.5, "A_T": 420.0, "A_L": 1900.0, "A_OD": 600.0,
               "H_BR": 24.0, "H_C": 9.0, "C": 0.0, "C_BR": -55.0}  # fmt: skip
NOISE = {"x": 1.0, "y": 1.0, "psi": 0.0015, "u": 0.05, "v": 0.05, "r": 1e-4, "n": 0.0, "delta": 0.001,
         "wind_speed": 0.4, "wind_direction": 0.05}  # fmt: skip


def coaster(seed: int | None = None) -> Ship:
    """The starting ship, or with a ``seed`` one whose coefficients differ from it as their priors say."""
    ship = new_ship("coaster", PARTICULARS)
    if seed is None:
        return ship
    rng, rows = np.random.default_rng([7, seed]), {}
    for symbol, c in ship.coefficients.items():
        value = c.value if c.fixed else c.value + 0.4 * c.std * rng.uniform(-1.5, 1.5)
        rows[symbol] = replace(c, value=float(np.clip(value, c.lower, c.upper)))
    return replace(ship, coefficients=rows)


def coaster_month(folder: Path, month: Month) -> dict[str, np.ndarray]:
    """Write the ``month`` below ``folder``; returns times that are touched or moored: "touched", "moored" (N,) bool."""
    truth = with_effects(
        coaster(month.ship), ["fouling:share=0", "draft:share=0", "current:x=0,y=0", "tow:X=0,Y=0,N=0"]
    )
    rng, days = np.random.default_rng([1, month.seed]), month.days
    plan = [_day(rng) for _ in range(days)]
    wanted, rps, moored, touched = (np.array([p[i] for p in plan]) for i in range(4))
    air = _wind(rng, days)
    states, n, delta = _sailed(Simulator(truth), month, rng, (wanted, rps, moored, touched), air)
    place = states[:2]
    offset = np.cumsum(np.vstack([np.zeros(2), (place[:, -1] - place[:, 0]).T[:-1]]), axis=0).T
    states[:2] += offset[:, None, :]
    flat = [np.ascontiguousarray(values.T).ravel() for values in (*states[:6], n, delta)]
    columns = dict(zip(("x", "y", "psi", "u", "v", "r", "n", "delta"), flat, strict=True))
    columns |= {"wind_speed": np.hypot(*air).T.ravel(),
                "wind_direction": np.arctan2(-air[1], -air[0]).T.ravel() % (2 * np.pi)}  # fmt: skip
    t = np.arange(days * DAY, dtype=float)
    columns["r"] = late(columns["r"], month.value("gyro.T", t / DAY), 1.0) * (1 + month.value("gyro.share", t / DAY))
    for name, size in NOISE.items():
        columns[name] = columns[name] + size * rng.standard_normal(len(t))
    columns["psi"] = np.remainder(columns["psi"], 2 * np.pi)
    _hurt(rng, columns)
    keep = np.ones(len(t), bool)
    for _ in range(max(1, days // 6)):
        at = rng.integers(0, len(t))
        keep[at : at + int(rng.uniform(600, 9000))] = False
    kept = {"t": t[keep], **{name: values[keep] for name, values in columns.items()}}
    write_parts(folder, kept, [int(np.searchsorted(kept["t"], DAY * k)) for k in range(days + 1)])
    return {"touched": touched.ravel(), "moored": moored.ravel()}


def _day(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Wanted heading, revolutions, whether moored, and force of a tug (-1, 0, 1) of a day, (DAY,) each."""
    depart, arrive = int(rng.uniform(4.5, 7) * 3600), int(rng.uniform(19, 22) * 3600)
    sea = int(rng.uniform(2000, 4000))
    heading = legs(rng, DAY, 900, 4500, lambda: float(rng.choice([-1, 1]) * rng.uniform(0.15, 1.6)))
    rps = np.full(DAY, 2.6)
    at = depart + sea
    while at < arrive:
        until = at + int(rng.uniform(3600, 14400))
        rps[at:until], at = rng.uniform(2.3, 2.9), until
    for _ in range(3):
        at = int(rng.uniform(depart + sea, arrive - sea))
        rps[at : at + int(rng.uniform(400, 1200))] = rng.uniform(0.9, 1.4)
    rps[depart : depart + sea], rps[arrive - sea : arrive - 900], rps[arrive - 900 : arrive] = 0.8, 0.8, 0.0
    moored, tug = np.ones(DAY, bool), np.zeros(DAY)
    moored[depart:arrive] = False
    rps[moored] = 0.0
    tug[depart : depart + 500], tug[arrive - 700 : arrive] = rng.choice([-1, 1], 2)
    return heading, rps, moored, tug


def _wind(rng: np.random.Generator, days: int) -> np.ndarray:
    """Air over ground, north and east (2, DAY, days): weather of a day and a half, gusts of half a minute."""
    hours = days * 24 + 1
    base = 4.5 * np.array([slow(rng, hours, 3600.0, 1.5 * DAY, 1.0) for _ in range(2)])
    t = np.arange(days * DAY)
    mean = np.array([np.interp(t, 3600.0 * np.arange(hours), row) for row in base])
    size = 0.12 * np.hypot(*mean)
    gusts = np.array([slow(rng, len(t), 1.0, 30.0, 1.0) * size for _ in range(2)])
    return (mean + gusts).reshape(2, days, DAY).transpose(0, 2, 1)


def _sailed(
    simulator: Simulator, month: Month, rng: np.random.Generator, plan: tuple[np.ndarray, ...], air: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States (6, DAY, days), revolutions and rudder (DAY, days): all days side by side, second by second."""
    ship, (wanted, rps, moored, tug), days = simulator.ship, plan, month.days
    theta = np.repeat(ship.values[:, None], days, axis=1)
    row = {name: ship.symbols.index(name) for name in ship.symbols}
    when = np.arange(days)[None] + np.arange(DAY)[:, None] / DAY
    tide = 2 * np.pi * when / (12.42 / 24) + rng.uniform(0, 6)
    force = 2.5e4
    push = np.array([slow(rng, days * DAY, 1.0, 60.0, force) for _ in range(2)]).reshape(2, days, DAY)
    states, n, delta = np.empty((6, DAY, days)), np.empty((DAY, days)), np.empty((DAY, days))
    state, rudder, shaft = np.zeros((6, days)), np.zeros(days), np.zeros(days)
    state[2] = wanted[:, 0]
    for k in range(DAY):
        state[3:, moored[:, k]] = 0.0
        states[:, k], n[k], delta[k] = state, shaft, rudder
        aim = steered(wanted[:, k], state[2], state[5], (1.2, 25.0), 0.44)
        rudder = rudder + np.clip(np.where(moored[:, k], 0.0, aim) - rudder, -0.045, 0.045)
        shaft = shaft + np.clip(rps[:, k] - shaft, -0.02, 0.02)
        theta[row["fouling.share"]] = month.value("fouling.share", when[k])
        theta[row["draft.share"]] = month.value("draft.share", when[k])
        theta[row["current.x"]], theta[row["current.y"]] = 0.15 * np.sin(tide[k]), 0.1 * np.sin(tide[k] + 0.8)
        theta[row["tow.X"]] = push[0, :, k] * ~moored[:, k]
        theta[row["tow.Y"]] = (push[1, :, k] + 1.5e5 * tug[:, k]) * ~moored[:, k]
        theta[row["tow.N"]] = 20 * (push[1, :, k] + 3e5 * tug[:, k]) * ~moored[:, k]
        inputs = _inputs(ship, shaft, rudder, air[:, k])
        moved = simulator.run(state, inputs[None], 1.0, theta)[-1]
        state = np.where(moored[:, k], state, moved)
    return states, n, delta


def _inputs(ship: Ship, n: np.ndarray, delta: np.ndarray, air: np.ndarray) -> np.ndarray:
    given = {"n": n, "delta": delta, "wind_north": air[0], "wind_east": air[1]}
    return np.array([given.get(name, np.zeros_like(n)) for name in ship.inputs])


def _hurt(rng: np.random.Generator, columns: dict[str, np.ndarray]) -> None:
    """Spells without a value, and a heading that stands still for some minutes."""
    rows = len(columns["u"])
    for name in ("u", "psi", "r", "wind_speed"):
        for _ in range(max(1, rows // (8 * DAY))):
            at = rng.integers(0, rows)
            columns[name][at : at + int(rng.uniform(5, 400))] = math.nan
    for _ in range(max(1, rows // (10 * DAY))):
        at = rng.integers(0, rows - 700)
        columns["psi"][at : at + 600] = columns["psi"][at]
