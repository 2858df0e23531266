"""Unnamed forms: what could be wrong with the model in ways that the library of effects does not hold.

Forces in the three channels as products of velocities, inputs and wind; the rudder's and the propeller's action scaled
with the state, or late by several times; and errors of each sensor: bias, gain, lag, cross-talk, drift. Every column
is scaled so that its typical size is that of the latent force or of the sensor's noise. Whether the columns of a kind
explain more than chance is a ratio of marginal likelihoods (Bayes factor) with a Gaussian prior on their sizes,
averaged over SIZES: it grows only if there is something, since every column costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import ExtraColumns, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from mmg.motion.frames import relative_air
from mmg.motion.froude import time_scale

SIZES = (0.03, 0.1, 0.3, 1.0)
"""Prior standard deviations of a column's coefficient, in the sizes of what is random."""
DELAYS = (0.5, 1.0, 2.0, 4.0)
"""Times [s of a 3 m model] by which inputs may act late."""


@dataclass(frozen=True)
class UnnamedForms:
    """What the unnamed forms explain: log Bayes factor of each kind, and of their mixture in equal parts.

    single: log Bayes factor of the best force of OUTER alone, less the log of their number.
    """

    log_bayes: float
    by_kind: dict[str, float]
    single: float


def unnamed_forms(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> UnnamedForms:
    """Test the unnamed forms at a fitted hypothesis.

    steps: the transition model; data: the trials; found: the fit. Returns log Bayes factors.
    """
    active = active_states(steps, found.free.symbols, found.theta)
    columns, kinds, outer = _columns(steps, data, found, active)
    linearised = linearise_and_filter(steps, data, found, active, columns)
    flat = linearised.white.reshape(-1, linearised.white.shape[-1])
    gram = flat.T @ flat
    P = len(found.free.symbols)
    A = gram[:P, :P] + np.eye(P)
    project = np.linalg.solve(A, gram[:P, P:-1])
    S = gram[P:-1, P:-1] - gram[P:-1, :P] @ project
    slope = -(gram[:-1, -1] + linearised.logdet_gradient.sum(axis=0))
    slope[:P] -= found.p
    g = slope[P:] - project.T @ slope[:P]
    names = sorted(set(kinds))
    by_kind = {name: log_bayes(g, S, np.array([k == name for k in kinds])) for name in names}
    alone = max(log_bayes(g, S, np.arange(len(g)) == i) for i in outer) - float(np.log(len(outer)))
    mixture = float(np.logaddexp.reduce(list(by_kind.values())) - np.log(len(names)))
    return UnnamedForms(mixture, by_kind, alone)


def log_bayes(g: np.ndarray, S: np.ndarray, chosen: np.ndarray) -> float:
    """Log Bayes factor of the columns ``chosen`` (C,), averaged over the prior sizes SIZES.

    g: (C,) slopes of the log likelihood along all columns; S: (C, C) their information.
    """
    g, S = g[chosen], S[np.ix_(chosen, chosen)]
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    values, along = np.maximum(values, 0.0), (vectors.T @ g) ** 2
    logs = [0.5 * float((a**2 * along / (1 + a**2 * values)).sum() - np.log1p(a**2 * values).sum()) for a in SIZES]
    top = max(logs)
    return top + float(np.log(np.mean(np.exp(np.array(logs) - top))))


OUTER = (
    "1",
    "n",
    "nn",
    "n|n|",
    "back",
    "back|back|",
    "delta",
    "delta nn",
    "delta|delta|",
    "cos",
    "sin",
    "cos 2",
    "sin 2",
)
"""Functions of what does not answer to the random force within its memory. The slopes along the others are somewhat off
by chance alone, since the force moves the ship and so the function."""


def _columns(
    steps: TransitionModel, data: GriddedTrials, found: Estimate, active: np.ndarray
) -> tuple[ExtraColumns, list[str], list[int]]:
    """The dictionary as further columns of ``linearise_and_filter``, the kind of each, and which are OUTER."""
    z = found.path.z
    basis = _basis(steps, data, z)
    reach = _reach(steps, data, found, active)
    late = _late(data, steps)
    shape = {name: basis[name] for name in ("1", "u", "v", "r", "|r|", "delta", "n")}
    kinds = [f"{axis} force" for _ in basis for axis in ("surge", "sway", "yaw")]
    for name in reach:
        kinds += [f"action of {name}"] * len(shape) + [f"delay of {name}"] * len(late[name])
    sensors = _sensors(data, z)
    kinds += [f"sensor of {('position', 'position', 'heading', 'u', 'v', 'r')[channel]}" for channel, _ in sensors]

    def extra(linear: LinearModel) -> tuple[np.ndarray, np.ndarray]:
        pushed = [
            linear.force[..., c] * found.noise.force[c] * value[..., None] for value in basis.values() for c in range(3)
        ]
        strength = np.linalg.norm(linear.force * found.noise.force, axis=(2, 3))
        for name, slope in reach.items():
            unit = np.sqrt((strength[data.inside] ** 2).mean() / (slope[data.inside] ** 2).sum(axis=1).mean())
            pushed += [slope * unit * value[..., None] for value in shape.values()]
            pushed += [slope * unit * value[..., None] for value in late[name]]
        count = len(pushed)
        K, R, A = linear.F.shape[:3]
        forcing, seen = np.zeros((K, R, A, count + len(sensors))), np.zeros((K + 1, R, 6, count + len(sensors)))
        forcing[..., :count] = np.stack(pushed, axis=-1)
        for i, (channel, values) in enumerate(sensors):
            seen[:, :, channel, count + i] = found.noise.white[channel] * values
        return forcing, seen

    outer = [3 * i + c for i, name in enumerate(basis) if name in OUTER for c in range(3)]
    return extra, kinds, outer


def _scaled(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Divided by the root mean square where it counts."""
    size = float(np.sqrt((values[mask] ** 2).mean()))
    return values / size if size > 1e-12 else np.zeros_like(values)


def _basis(steps: TransitionModel, data: GriddedTrials, z: np.ndarray) -> dict[str, np.ndarray]:
    """Functions (K, R) of state, inputs, wind and heading, each of unit root mean square."""
    length = float(steps.ship.particulars["L"])
    middle = 0.5 * (z[:-1] + z[1:])
    psi, u, v, r = (middle[..., i] for i in (2, 3, 4, 5))
    r = r * length
    names = steps.model.controls
    inputs = {name: data.inputs[..., i] for i, name in enumerate(names)}
    n, delta = inputs.get("n", np.zeros_like(u)), inputs.get("delta", np.zeros_like(u))
    a_x, a_y = relative_air(inputs["wind_north"], inputs["wind_east"], psi, u, v)
    a_x, a_y = np.array(a_x, dtype=float), np.array(a_y, dtype=float)
    air = np.hypot(a_x, a_y)
    t = data.t[:-1]
    back = np.where(n < 0, n, 0.0)
    columns = {
        "1": np.ones_like(u), "u": u, "v": v, "r": r, "uu": u * u, "uv": u * v, "ur": u * r, "vr": v * r,
        "v|v|": v * abs(v), "r|r|": r * abs(r), "v|r|": v * abs(r), "r|v|": r * abs(v), "vv": v * v, "rr": r * r,
        "|v|": abs(v), "|r|": abs(r), "u|u|": u * abs(u), "uuu": u**3, "n": n, "nn": n * n, "n|n|": n * abs(n),
        "un": u * n, "back": back, "back|back|": back * abs(back), "delta": delta, "delta nn": delta * n * n,
        "delta uu": delta * u * u, "delta|delta|": delta * abs(delta), "rn": r * n, "vn": v * n,
        "air x": a_x * air, "air y": a_y * air, "air xy": a_x * a_y, "cos": np.cos(psi), "sin": np.sin(psi),
        "cos 2": np.cos(2 * psi), "sin 2": np.sin(2 * psi), "t": t - t.mean(),
        "x": middle[..., 0] - middle[..., 0][data.inside].mean(),
        "y": middle[..., 1] - middle[..., 1][data.inside].mean(),
    }  # fmt: skip
    return {name: _scaled(value, data.inside) for name, value in columns.items()}


def _reach(steps: TransitionModel, data: GriddedTrials, found: Estimate, active: np.ndarray) -> dict[str, np.ndarray]:
    """Change of the active states over a step (K, R, A) per unit of rudder angle and of revolutions."""
    K, R = data.inputs.shape[:2]
    z = found.path.z[:-1].reshape(K * R, -1).T
    every = steps.coefficients(found.theta, found.path.force[:-1].reshape(-1, 3).T)
    controls = data.inputs.reshape(K * R, -1).T
    result = {}
    for name, small in (("delta", 1e-3), ("n", 1e-2)):
        if name not in steps.model.controls:
            continue
        up, down = controls.copy(), controls.copy()
        i = steps.model.controls.index(name)
        up[i] += small
        down[i] -= small
        change = (steps.advance(z, up, every) - steps.advance(z, down, every)) / (2 * small)
        result[name] = change[active].T.reshape(K, R, -1)
    return result


def _late(data: GriddedTrials, steps: TransitionModel) -> dict[str, list[np.ndarray]]:
    """Inputs some time ago less now (K, R), scaled."""
    k = time_scale(steps.ship.particulars["L"])
    result: dict[str, list[np.ndarray]] = {}
    for name in ("delta", "n"):
        if name not in steps.model.controls:
            continue
        x = data.inputs[..., steps.model.controls.index(name)]
        result[name] = []
        for delay in DELAYS:
            rows = np.maximum(np.arange(len(x)) - max(1, round(delay * k / data.h)), 0)
            result[name].append(_scaled(x[rows] - x, data.inside))
    return result


def _sensors(data: GriddedTrials, z: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Errors (K + 1, R) of each logged column, of unit root mean square."""
    rows = np.asarray(data.good.any(axis=2))
    rate = np.gradient(data.y, data.h, axis=0)
    psi, u, v, r = (z[..., i] for i in (2, 3, 4, 5))
    one, t = np.ones_like(u), data.t - data.t.mean()
    forms: dict[int, list[np.ndarray]] = {
        0: [rate[..., 0], np.cos(psi), np.sin(psi)],
        1: [rate[..., 1], np.cos(psi), np.sin(psi)],
        2: [one, rate[..., 2], np.sin(psi), np.cos(psi), np.sin(2 * psi), np.cos(2 * psi), t],
        3: [one, rate[..., 3], u, v, r, u * u, t],
        4: [one, rate[..., 4], u, v, r, t],
        5: [one, rate[..., 5], r, r * np.abs(r), t],
    }
    return [(channel, _scaled(f, rows)) for channel, values in forms.items() for f in values]
