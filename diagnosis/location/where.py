"""Where the gap lies: the smoothed latent force by channel, phase of the manoeuvre, region of state, band, and run.

The latent force is what must be added to the forces of the model so that it follows the trials. It is smoothed, so its
rms is below that of the force itself where the sensors are noisy. Surge, sway and yaw are compared by X^2/(m + m_x),
Y^2/(m + m_y), N^2/(I_z + J_z), proportional to the kinetic energy that each gives to the free ship in the same time.
"relative" is the rms divided by that of the net force of the channel (mass times acceleration in the body frame).

A region is a bin of a variable: ratio is its rms over that of all samples, z the difference of the means by the
standard error of its own, which is that of half as many samples as the region lasts correlation times tau.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.residual_checks import periodogram
from mmg.components.rigid_body import Inertia, inertia
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS
from mmg.motion.frames import body_to_earth, relative_air
from mmg.motion.froude import time_scale
from mmg.ship import Ship

STEADY, CHANGING = "steady turning", "entering a turn / yaw changing"
STRAIGHT, ACCELERATING = "straight ahead", "accelerating"
STOPPING, SLOW = "stopping / astern (n<0)", "drifting slow"
PHASES = (STRAIGHT, ACCELERATING, CHANGING, STEADY, STOPPING, SLOW)
# Shares of the usual speed of the trials: below the first a ship is slow; faster astern than the second, it backs.
SLOW_SHARE, ASTERN_SHARE = 0.25, 0.05  # set by hand: they name bins
# r L/U, r' (L/U)^2 and u' L/U^2 from which a ship turns, changes its turn, changes its speed.
TURNING, TURN_CHANGE, SPEED_CHANGE = 0.1, 0.1, 0.03  # set by hand: they name bins
FEW = 12  # An input with no more different values than this has a bin for each of them. Set by hand: display.


@dataclass(frozen=True)
class Variable:
    """A variable that a force may depend on: values (M,) by sample, rising edges (B + 1,) of its bins."""

    name: str
    unit: str
    values: np.ndarray
    edges: np.ndarray


def quantile_edges(values: np.ndarray, bins: int = 6) -> np.ndarray:
    """Edges (B + 1,) of at most ``bins`` bins with about equally many of ``values`` (M,), the last a little above."""
    different = np.unique(values)
    if len(different) <= FEW:
        middles = 0.5 * (different[1:] + different[:-1])
        ends = np.array([different[0], different[-1] + 1e-9 * max(1.0, abs(different[-1]))])
        return np.concatenate([ends[:1], middles, ends[1:]])
    edges = np.unique(np.quantile(values, np.linspace(0, 1, bins + 1)))
    edges[-1] += 1e-9 * max(1.0, abs(edges[-1]))
    return edges


def signed_edges(values: np.ndarray) -> np.ndarray:
    """Edges (B + 1,) by quantiles of negative and positive ``values`` (M,), one of them 0: port and starboard apart."""
    halves = [quantile_edges(part, 3) for part in (values[values < 0], values[values >= 0]) if len(part)]
    if len(halves) < 2 or len(np.unique(values)) <= FEW:
        return quantile_edges(values)
    return np.concatenate([halves[0][:-1], [0.0], halves[1][1:]])


# Edges [rad] of eight equal sectors of the circle, the first centred at 0.
SECTORS = np.linspace(-np.pi / 8, 2 * np.pi - np.pi / 8, 9)


def in_sectors(values: np.ndarray) -> np.ndarray:
    """``values`` (M,) [rad] turned by whole circles into the range of SECTORS."""
    return np.mod(values - SECTORS[0], 2 * np.pi) + SECTORS[0]


def variables_of(names: Sequence[str], data: GriddedTrials, z: np.ndarray) -> list[Variable]:
    """All variables that vary over the samples of ``data``, wind only where it was logged.

    names: of the model's inputs; z: (K + 1, R, S) states.
    """
    inside = data.inside
    middle = 0.5 * (z[:-1] + z[1:])[inside]
    x, y, psi, u, v, r = middle[:, :6].T
    inputs = {name: data.inputs[..., i][inside] for i, name in enumerate(names)}
    variables = [
        Variable("u", "m/s", u, quantile_edges(u)),
        Variable("v", "m/s", v, signed_edges(v)),
        Variable("r", "rad/s", r, signed_edges(r)),
    ]
    for name in (n for n in INPUTS if n in inputs):
        variables.append(Variable(name, INPUTS[name][1], inputs[name], signed_edges(inputs[name])))
        if name in RUDDERS:
            rate = (np.gradient(data.inputs[..., names.index(name)], data.h, axis=0))[inside]
            edges = np.abs(rate).max() * np.array([-1.0001, -0.1, 0.1, 1.0001])  # to port, at rest, to starboard
            variables.append(Variable(f"rate of {name}", "rad/s", rate, edges))
    if any(np.any(inputs.get(name, 0.0)) for name in ("wind_north", "wind_east")):
        a_x, a_y = relative_air(inputs["wind_north"], inputs["wind_east"], psi, u, v)
        speed, angle = np.hypot(a_x, a_y), in_sectors(np.arctan2(-a_y, -a_x))
        variables.append(Variable("apparent wind speed", "m/s", speed, quantile_edges(speed)))
        variables.append(Variable("apparent wind angle", "rad", angle, SECTORS))
    variables.append(Variable("heading", "rad", in_sectors(psi), SECTORS))
    variables.append(Variable("x, north", "m", x, quantile_edges(x, 4)))
    variables.append(Variable("y, east", "m", y, quantile_edges(y, 4)))
    clock = data.t[:-1][inside]
    variables.append(Variable("time since the start", "s", clock, quantile_edges(clock, 4)))
    return [f for f in variables if len(f.edges) > 2 and np.ptp(f.values) > 1e-6 * np.abs(f.values).max()]


def phases(names: Sequence[str], data: GriddedTrials, z: np.ndarray, length: float) -> np.ndarray:
    """Phase (M,) of every sample of ``data``, as a position in PHASES.

    names: of the model's inputs; z: (K + 1, R, S) states; length: of the ship [m]. Thresholds refer to the time L/U of
    the ship, with U not below a share of the usual speed of the trials.
    """
    inside = data.inside
    u, v, r = (0.5 * (z[:-1, :, i] + z[1:, :, i]) for i in (3, 4, 5))
    # over several steps, so that the noise of the path does not count as a change
    reach = max(1, round(0.25 * length / max(float(np.abs(u[inside]).mean()), 1e-6) / data.h))
    du, dr = (_change(z[..., i], reach, data.steps) / (reach * data.h) for i in (3, 5))
    speed = np.hypot(u, v)
    usual = float(np.quantile(speed[inside], 0.8))
    U = np.maximum(speed, max(SLOW_SHARE * usual, 1e-9))
    back = (data.inputs[..., [names.index(name) for name in PROPELLERS if name in names]] < 0).any(axis=-1)
    rules = {
        STOPPING: back | (u < -ASTERN_SHARE * usual),
        SLOW: speed < SLOW_SHARE * usual,
        CHANGING: np.abs(dr) * (length / U) ** 2 > TURN_CHANGE,
        STEADY: np.abs(r) * length / U > TURNING,
        ACCELERATING: np.abs(du) * length / U**2 > SPEED_CHANGE,
    }
    phase = np.select(list(rules.values()), [PHASES.index(name) for name in rules], PHASES.index(STRAIGHT))
    return phase[inside]


def _change(z: np.ndarray, reach: int, steps: np.ndarray) -> np.ndarray:
    """Change (K, R) of z (K + 1, R) over ``reach`` steps about each step, never beyond the end of its window."""
    k = np.arange(len(z) - 1)[:, None]
    start = np.clip(k - reach // 2, 0, np.maximum(steps - reach, 0)[None])
    end = np.minimum(start + reach, steps[None])
    return np.take_along_axis(z, end, axis=0) - np.take_along_axis(z, start, axis=0)


CHANNELS, UNITS = ("surge", "sway", "yaw"), ("N", "N", "N m")
MOST = 30  # Regions listed at most. Set by hand: display.
ENOUGH = 5.0  # Correlation times tau of the latent force that a region must last to be listed. Set by hand.


@dataclass(frozen=True)
class Samples:
    """M samples of the latent force [N, N, N m]: force (M, 3), after (M, 3) with the named effects, or None; run: (M,)
    trial of each; h: step [s]; tau: correlation time [s]."""

    force: np.ndarray
    after: np.ndarray | None
    run: np.ndarray
    h: float
    tau: float

    def summary(self, member: np.ndarray, channel: int) -> dict[str, float]:
        """Rms and mean of the force of one channel (0 to 2) over the samples ``member`` (M,), later force included."""
        row: dict[str, float] = {}
        for end, force in (("", self.force), ("_after", self.after)):
            if force is not None:
                part = force[member, channel]
                row[f"force_rms{end}"] = float(np.sqrt((part**2).mean())) if len(part) else 0.0
                row[f"mean{end}"] = float(part.mean()) if len(part) else 0.0
        return row


def means(force: np.ndarray, member: np.ndarray) -> np.ndarray:
    """Means (bins, 3) of ``force`` (M, 3) over the samples of each bin; member: (bins, M)."""
    return member.astype(float) @ force / np.maximum(member.sum(axis=1), 1)[:, None]


def by_variable(variables: Sequence[Variable], s: Samples) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The force averaged in bins: rows by variable and channel (for the figure), the best explained first, and of the
    bins the regions, those with clearly more force than all samples, the clearest first, at most MOST.

    variables; s: samples. "explained": share of the mean square due to the mean by bin, less that expected by chance.
    """
    rows: list[dict[str, Any]] = []
    regions: list[dict[str, Any]] = []
    square, average = (s.force**2).mean(axis=0), s.force.mean(axis=0)
    for one in variables:
        member = (one.values >= one.edges[:-1, None]) & (one.values < one.edges[1:, None])
        used = np.flatnonzero(member.sum(axis=1) * s.h / s.tau >= 1.0)
        if len(used) < 2:
            continue
        member = member[used]
        count = member.sum(axis=1)
        at, lasts = member.astype(float) @ one.values / count, count * s.h / s.tau
        mean, rms = means(s.force, member), np.sqrt(means(s.force**2, member))
        later = means(s.after, member) if s.after is not None else None
        spread = np.sqrt(np.maximum(rms**2 - mean**2, 0.0) / np.maximum(lasts / 2, 1.0)[:, None])
        chance = 2 * s.tau * len(count) / (len(s.force) * s.h)  # each bin's mean takes one of the independent samples
        ratio = np.where(square > 0, rms / np.sqrt(np.maximum(square, 1e-300)), 1.0)
        z = (mean - average) / np.maximum(spread, 1e-12 * np.sqrt(square) + 1e-300)
        for c, channel in enumerate(CHANNELS):
            named = {"variable": one.name, "unit": one.unit, "channel": channel, "force_unit": UNITS[c]}
            share = float((count * mean[:, c] ** 2).sum() / len(s.force) / square[c]) if square[c] > 0 else 0.0
            row = {"explained": share - chance, "at": at.tolist(), "mean": mean[:, c].tolist()}
            row |= {"std": spread[:, c].tolist(), "rms": rms[:, c].tolist()}
            if later is not None:
                row["mean_after"] = later[:, c].tolist()
            rows.append(named | row)
            for i in np.flatnonzero((lasts >= ENOUGH) & (ratio[:, c] > 1.0)):
                region = {"low": float(one.edges[used[i]]), "high": float(one.edges[used[i] + 1])}
                region |= {"ratio": float(ratio[i, c]), "z": float(z[i, c])}
                regions.append(named | region | s.summary(member[i], c))
    rows.sort(key=lambda row: -row["explained"])
    return rows, sorted(regions, key=lambda row: -abs(row["z"]) * row["ratio"])[:MOST]


PERIODS = (60.0, 20.0, 5.0)  # Periods [s] between the bands, of a 3 m model (Froude's law). Set by hand.


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
    followed, regions = by_variable(variables, samples)
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
        "regions": regions,
        "bands": _bands(data, estimate, after, float(ship.particulars["L"])),
        "runs": [row | {"seconds": float(own.sum() * data.h)} for row, own, _ in _rows("run", by_run, samples)],
        "earth": _earth(data, estimate, z),
        "variables": followed,
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
        result[0] += steps * part.mean(axis=0) ** 2  # the periodogram is of the force less its mean
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
