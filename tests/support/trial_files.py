"""Synthetic trials and trial files whose faults are known."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cases.quantities import UNITS
from cases.simulation.simulate import write_trial
from cases.trial import Trial


def motion_columns(seconds: float = 300.0, dt: float = 0.1, seed: int = 0) -> dict[str, np.ndarray]:
    """A weaving ship going ahead: rudder steps, first-order yaw, consistent track, wind (house units)."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, dt)
    delta = np.repeat(rng.uniform(-0.5, 0.5, len(t) // 100 + 1), 100)[: len(t)]
    r, u = np.zeros(len(t)), np.zeros(len(t))
    for i in range(1, len(t)):
        r[i] = r[i - 1] + dt * (0.12 * delta[i - 1] - r[i - 1]) / 4.0
        u[i] = 0.3 + (u[i - 1] - 0.3 if i > 1 else 0.0) * (1 - dt / 10.0) + dt * 0.02 * rng.standard_normal()
    v = -0.6 * r + 0.01 * np.sin(0.3 * t)
    psi = 0.3 + np.concatenate([[0.0], np.cumsum(0.5 * (r[1:] + r[:-1]) * dt)])
    w = (u + 1j * v) * np.exp(1j * psi)
    place = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * dt)])
    n = 10.0 + np.where(np.sin(0.05 * t) > 0, 1.0, 0.0)
    wind = {"wind_speed": 1.0 + 0.1 * np.sin(t), "wind_direction": np.full(len(t), 1.0)}
    states = {"t": t, "x": place.real, "y": place.imag, "psi": psi, "u": u, "v": v, "r": r}
    return {**states, "n": n, "delta": delta, **wind}


def make_trial(name: str = "run", **changes: np.ndarray) -> Trial:
    """The trial of ``motion_columns`` with columns replaced."""
    return Trial(name=name, columns={**motion_columns(), **changes})


def shifted(values: np.ndarray, seconds: float, dt: float = 0.1) -> np.ndarray:
    """The signal late by some seconds, held at the start."""
    t = np.arange(len(values)) * dt
    return np.interp(t - seconds, t, values)


def write_csv(
    path: Path,
    columns: dict[str, np.ndarray] | None = None,
    headers: dict[str, str] | None = None,
    rows: int | None = 200,
) -> Path:
    """A CSV of the columns with canonical headers, or with those given per column."""
    columns = columns or motion_columns(20.0)
    names = [(headers or {}).get(c, f"{c} [{UNITS.get(c, '-')}]") for c in columns]
    data = np.column_stack(list(columns.values()))[:rows]
    lines = [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in data]
    path.write_text("\n".join([",".join(names), *lines]) + "\n")
    return path


def write_trials(folder: Path, trials: Iterable[Trial]) -> None:
    """The trials as files of the new ``folder``, each called after its trial."""
    folder.mkdir(parents=True)
    for trial in trials:
        write_trial(trial, folder / f"{trial.name}.csv")
