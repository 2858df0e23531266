"""Trials and ships of which no calibration can make sense are met with a statement, never with a confident answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from cases.checks import check
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import SensorNoise, add_noise, simulate_controls
from cases.trial import Trial
from fitting.calibrate import FitOptions, calibrate
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.ship import Ship

FREE = ("X_0F", "Y_v", "N_r", "k_0", "gamma_P", "Y_A1")
"""What is fitted: a resistance, two hull derivatives, thrust, and the rudder's inflow and lift."""
OPTIONS = FitOptions(next_trial=False, instruments=())
SETTINGS = Settings(passes=2, window=20.0)


def ship(scale: float = 1.0) -> Ship:
    """Esso Osaka, with ``scale`` times each of its coefficients."""
    found, rows = load_ship("esso_osaka_3m"), {}
    for s, c in found.coefficients.items():
        value = scale * c.value
        rows[s] = c.with_(value=value, fixed=s not in FREE, lower=min(c.lower, value), upper=max(c.upper, value))
    return found.with_coefficients(rows)


def runs(count: int = 2, dt: float = 0.5) -> list[Trial]:
    """A zigzag and a turn of the true ship, with the noise of its sensors."""
    return [demo_trials(3, dt=dt)[0][k] for k in (0, 2)][:count]


def driven(inputs: Callable[[np.ndarray], dict[str, np.ndarray]], model: str = "esso_osaka_3m") -> list[Trial]:
    """A run of the ship ``model`` under ``inputs`` as functions of time, with noise."""
    t = np.arange(0.0, 200.0, 0.5)
    nothing = np.zeros_like(t)
    columns = dict.fromkeys(("x", "y", "psi", "v", "r"), nothing) | {"t": t, "u": nothing + 0.4, **inputs(t)}
    true = load_ship(model)
    trial = simulate_controls(true, Trial("driven", columns), None, 0)
    return [add_noise(trial, SensorNoise.for_length(true.particulars["L"]), 1)]


def changed(trial: Trial, **columns: np.ndarray) -> Trial:
    """The ``trial`` with other columns."""
    return replace(trial, columns={**trial.columns, **columns}, sha256="")


def with_gap(trial: Trial, rows: int = 10_000) -> Trial:
    """The ``trial`` with so many rows without states in its middle."""
    half, dt, t = len(trial) // 2, trial.dt, trial["t"]
    late = {name: np.insert(a, half, np.full(rows, np.nan)) for name, a in trial.columns.items()}
    late["t"] = np.concatenate([t[:half], t[half - 1] + dt * np.arange(1, rows + 1), t[half:] + rows * dt])
    late |= {name: np.insert(trial[name], half, np.full(rows, trial[name][half])) for name in ("n", "delta")}
    return changed(trial, **late)


def with_spikes(trial: Trial, share: float = 0.01) -> Trial:
    """The ``trial`` with outliers of fifty times the usual size in its velocities."""
    draw = np.random.default_rng(0)
    found = {}
    for name in ("u", "v", "r"):
        a = trial[name].copy()
        at = draw.random(len(a)) < share
        a[at] += 50 * np.nanstd(a) * draw.choice((-1.0, 1.0), at.sum())
        found[name] = a
    return changed(trial, **found)


def thinned(trial: Trial, every: int) -> Trial:
    """Each so many-th row of the ``trial``."""
    return replace(trial, columns={name: a[::every] for name, a in trial.columns.items()})


def _weave(t: np.ndarray, n: float) -> dict[str, np.ndarray]:
    return {"n": np.full_like(t, n), "delta": 0.35 * np.sign(np.sin(2 * np.pi * t / 40.0))}


def _still(t: np.ndarray) -> dict[str, np.ndarray]:
    return {"n": np.full_like(t, 9.0), "delta": np.zeros_like(t)}


CASES: dict[str, Callable[[], tuple[Ship, Sequence[Trial]]]] = {
    "as it should be": lambda: (ship(), runs()),
    "all coefficients times 3": lambda: (ship(3.0), runs()),
    "trials of a 7 m ship": lambda: (ship(), driven(lambda t: _weave(t, 6.0), "kvlcc2_l7")),
    "trials of a ship of 320 m": lambda: (ship(), driven(lambda t: _weave(t, 1.0), "kvlcc2_full")),
    "constant inputs": lambda: (ship(), driven(_still)),
    "all astern": lambda: (ship(), driven(lambda t: _weave(t, -9.0))),
    "100 Hz": lambda: (ship(), runs(1, dt=0.01)),
    "0.1 Hz": lambda: (ship(), [thinned(trial, 20) for trial in runs()]),
    "10,000 rows of gaps": lambda: (ship(), [with_gap(trial) for trial in runs()]),
    "spikes": lambda: (ship(), [with_spikes(trial) for trial in runs()]),
    "one run fifty times": lambda: (ship(), [replace(runs(1)[0], name=f"run {k}", path=None) for k in range(50)]),
}
"""Name -> ship and trials."""
LONGEST = ("100 Hz", "one run fifty times")
"""Cases of 12 to 37 s of processor time."""


EXPECTED = {
    "all coefficients times 3": {"far_from_prior", "implausible", "not_described", "worse_than_persistence"},
    "trials of a 7 m ship": {"at_bound", "far_from_prior", "not_described"},
    "trials of a ship of 320 m": {"at_bound", "far_from_prior", "not_described"},
    "constant inputs": {"nothing_to_identify", "refused"},
    "all astern": {"not_excited_ahead"},
    "0.1 Hz": {"coarse_sampling", "refused"},
    "10,000 rows of gaps": {"gaps", "missing_samples"},
    "spikes": {"spikes", "worse_after", "worse_than_persistence"},
    "one run fifty times": {"duplicate", "copies_left_out"},
}
"""Case -> what must be said of it, at least."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(c, marks=pytest.mark.longest) if c in LONGEST else c for c in sorted(CASES)]
)
def test_what_is_said(name: str) -> None:
    model, trials = CASES[name]()
    codes, warnings = {f.code for report in check(trials) for f in report.findings}, {"refused"}
    with suppress(UserError):
        fit = calibrate(model, trials, (), SETTINGS, OPTIONS)
        warnings = {w.code for w in fit.warnings}
    assert EXPECTED.get(name, set()) <= codes | warnings, codes | warnings
    if name not in EXPECTED:
        assert fit.converged and warnings <= {"worse_than_persistence"}  # in u, which hardly changes
