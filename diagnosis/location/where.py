"""Where the gap lies: the smoothed latent force by channel, phase of the manoeuvre, region of state, band, and run.

The latent force is what must be added to the forces of the model so that it follows the trials. It is smoothed, so its
rms is below that of the force itself where the sensors are noisy. Surge, sway and yaw are compared by X^2/(m + m_x),
Y^2/(m + m_y), N^2/(I_z + J_z), proportional to the kinetic energy that each gives to the free ship in the same time.
"relative" is the rms divided by that of the net force of the channel (mass times acceleration in the body frame).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.residual_checks import periodogram
from diagnosis.location.regions import CHANNELS, UNITS, Samples, all_bins, by_variable, regions
from diagnosis.location.situations import PHASES, phases, variables_of
from mmg.components.rigid_body import Inertia, inertia
from mmg.motion.frames import body_to_earth
from mmg.motion.froude import time_scale
from mmg.ship import Ship

PERIODS = (60.0, 20.0, 5.0)
"""Periods [s] between the bands, of a 3 m model (Froude's law)."""


def where(
    controls: Sequence[str], data: GriddedTrials, estimate: Estimate, ship: Ship, after: Estimate | None = None
) -> dict:
    """The entry "where" of ``diagnosis.json``; plain floats in SI units.

    controls: names of the inputs of ``data``; estimate: the fit without effects, with the latent force; ship: diagnosed
    one, for its masses; after: the fit with the named effects, in keys that end in "_after".
    """
    inside = data.inside
    z = estimate.path.z
    values = {symbol: c.value for symbol, c in ship.coefficients.items()}
    mass = inertia(ship.namespace, type(ship.namespace)(**values))
    force = estimate.path.force[:-1][inside]
    later = after.path.force[:-1][inside] if after is not None else None
    samples = Samples(force, later, np.broadcast_to(data.run, inside.shape)[inside], data.h, estimate.noise.tau)
    variables = variables_of(list(controls), data, z)
    bins, member = all_bins(variables, z, inside)
    phase = phases(list(controls), data, z, float(ship.particulars["L"]))
    by_phase = {name: phase == i for i, name in enumerate(PHASES) if (phase == i).any()}
    by_run = {data.trials[i]: samples.run == i for i in np.unique(samples.run)}
    overall = np.sqrt((force**2).mean(axis=0))
    rows_of_phases = [
        row
        | {"share_of_time": float(own.mean())}
        | {"ratio": row["force_rms"] / float(overall[c]) if overall[c] > 0 else 1.0}
        for row, own, c in _rows("phase", by_phase, samples)
    ]
    return {
        "channels": _channels(data, z, mass, samples),
        "phases": sorted(rows_of_phases, key=lambda row: -row["ratio"]),
        "regions": regions(bins, member, samples),
        "bands": _bands(data, estimate, after, float(ship.particulars["L"])),
        "runs": [row | {"seconds": float(own.sum() * data.h)} for row, own, _ in _rows("run", by_run, samples)],
        "earth": _earth(data, estimate, z),
        "variables": by_variable(variables, samples),
    }


def _channels(data: GriddedTrials, z: np.ndarray, mass: Inertia, s: Samples) -> dict[str, dict[str, Any]]:
    """By channel: rms, mean, share of the comparable energy, and the rms by that of the net force."""
    masses = np.array([mass.m + mass.m_x, mass.m + mass.m_y, mass.I_z])
    square = (s.force**2).mean(axis=0)
    energy = square / masses
    later = (s.after**2).mean(axis=0) / masses if s.after is not None else None
    velocity = [0.5 * (z[:-1, :, i] + z[1:, :, i]) for i in (3, 4, 5)]
    rates = [(z[1:, :, i] - z[:-1, :, i]) / data.h for i in (3, 4, 5)]
    net_force = np.stack(mass.net_force(velocity, rates), axis=-1)[data.inside]  # of the smoothed motion, (M, 3)
    net = np.sqrt((net_force**2).mean(axis=0))
    every = np.ones(len(s.force), dtype=bool)
    result: dict[str, dict[str, Any]] = {}
    for c, name in enumerate(CHANNELS):
        row: dict[str, Any] = {"unit": UNITS[c], **s.summary(every, c)}
        row["share"] = float(energy[c] / energy.sum()) if energy.sum() > 0 else 1 / 3
        row["relative"] = float(math.sqrt(square[c]) / net[c]) if net[c] > 0 else 0.0
        if later is not None and energy.sum() > 0:
            row["share_after"] = float(later[c] / later.sum()) if later.sum() > 0 else 1 / 3
        result[name] = row
    return result


def _bands(data: GriddedTrials, before: Estimate, after: Estimate | None, length: float) -> list[dict[str, Any]]:
    """Energy of each channel by frequency band, first that of the mean of each window."""
    k = time_scale(length)
    longest = float(data.steps.max()) * data.h
    edges = [1 / (p * k) for p in PERIODS if p * k < longest]
    edges = [0.0, *edges, 0.5 / data.h] if edges and edges[-1] < 0.5 / data.h else [0.0, 0.5 / data.h]
    parts = [_energies(data, e.path.force, edges) for e in (before, after) if e is not None]
    ends = [(0.0, 1 / longest, "mean of each run"), *((a, b, "") for a, b in itertools.pairwise(edges))]
    rows: list[dict[str, Any]] = []
    for (i, (low, high, words)), (c, channel) in itertools.product(enumerate(ends), enumerate(CHANNELS)):
        energies, total = [part[i, c] for part in parts], float(parts[0][:, c].sum())
        row: dict[str, Any] = {"from_hz": max(low, 0.0 if i < 1 else 1 / longest), "to_hz": high, "channel": channel}
        row |= {"share": float(energies[0] / total) if total > 0 else float(i == 0), "words": words, "unit": UNITS[c]}
        rows.append(row | {f"force_rms{e}": math.sqrt(x) for e, x in zip(("", "_after"), energies, strict=False)})
    return rows


def _energies(data: GriddedTrials, force: np.ndarray, edges: Sequence[float]) -> np.ndarray:
    """Mean square of the force (1 + bands, 3) in the means of the windows and in each band."""
    result = np.zeros((len(edges), 3))
    for w, steps in enumerate(data.steps):
        part = force[:steps, w]
        frequency, square = periodogram(part, data.h)
        at = np.clip(np.digitize(frequency, edges), 1, len(edges) - 1)
        result[0] += steps * part.mean(axis=0) ** 2
        np.add.at(result, at, steps * square)
    return result / data.steps.sum()


def _earth(data: GriddedTrials, estimate: Estimate, z: np.ndarray) -> list[dict[str, Any]]:
    """By trial: mean of the force in the earth frame [N], its size and where it points to [rad, clockwise of north].

    Wind, waves or a current that the model does not have leave a mean here, whatever the headings.
    """
    rows: list[dict[str, Any]] = []
    for i, name in enumerate(data.trials):
        inside = data.inside & (data.run == i)
        if inside.any():
            force, psi = estimate.path.force[:-1][inside], z[:-1][inside][:, 2]
            north, east = (float(np.mean(x)) for x in body_to_earth(force[:, 0], force[:, 1], psi))
            size, towards = math.hypot(north, east), math.atan2(east, north) % (2 * math.pi)
            rows.append({"run": name, "north": north, "east": east, "force": size, "towards": towards, "unit": "N"})
    return rows


def _rows(key: str, members: Mapping[str, np.ndarray], s: Samples) -> Iterator[tuple[dict[str, Any], np.ndarray, int]]:
    """Rows by name, under ``key``, and channel, with the samples (M,) of each name and the place of the channel."""
    for (name, member), (c, channel) in itertools.product(members.items(), enumerate(CHANNELS)):
        yield {key: name, "channel": channel, "unit": UNITS[c], **s.summary(member, c)}, member, c
