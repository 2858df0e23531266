"""Small synthetic trials shared by the tests of the diagnosis: a known ship, known effects, known noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np

from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from diagnosis.estimation.candidates import Candidate, Column, FullModel, find, ship_with_all_effects
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.linearisation import Trajectory, initial_trajectory
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.residual_checks import with_correlation_time
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.refit import SearchProblem
from mmg.effects import EFFECTS
from mmg.ship import Ship
from tests.support.disturbed_trials import Disturbed, disturbed_trials, process

Act = Callable[[int, np.ndarray, np.ndarray, np.ndarray], None]
"""What acts on windows: number of the step, states, forces and coefficients, the last two to be changed."""
SHIP = load_ship("esso_osaka_3m")
RUNS = (("zigzag:20/20", 80.0), ("random:11", 80.0), ("turning:-20", 80.0))
ASTERN = (("zigzag:20/20", 80.0), ("random:11", 80.0), ("berthing", 80.0))
WHITE = np.array([0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006]) * 1.25**0.5
"""Sizes of the white noise of ``quiet``: a half and a whole of each sensor's, independent."""
FREE = ("X_0F", "Y_v", "N_r", "k_0", "gamma_P", "t_R")
"""A few coefficients, so that a case stays quick."""
FEW = SHIP.fixing([s for s in SHIP.symbols if s not in FREE])
"""The ship with nothing else free."""

BANK = {"distance": 6.0, "bearing": -np.pi / 2}
"""Of the bank line [m] and [rad]."""
OFF_NEUTRAL = {
    "current.x": 0.03, "current.y": -0.02, "wind_force.X": 1.3, "wind_force.Y": 0.7, "wind_force.N": 1.2,
    "wind_sensor_bias.x": 0.4, "wind_sensor_bias.y": -0.3, "shallow_water.d_h": 0.25, "bank.suction": 0.03,
    "bank.moment": 0.01, "wave_drift.x": 0.06, "wave_drift.y": -0.05, "rudder_lag.T": 0.7, "rudder_backlash.b": 0.05,
    "rudder_offset.delta": 0.04, "propeller_side_force.factor": 1.8, "rudder_stall.loss": 0.3, "fouling.share": 0.2,
    "draft.share": 0.08, "antenna_offset.x": 0.2, "antenna_offset.y": -0.15, "heading_bias.psi": 0.02,
    "log_scale.share": 0.03, "control_delay.tau": 0.5, "gnss_delay.tau": 0.4, "velocity_filter.tau": 0.3,
    "gyro.share": -0.02, "hull_memory.T": 1.0, "tow.X": 0.05, "tow.Y": -0.06, "tow.N": 0.04,
    "antenna_offset.alone_x": 0.1, "antenna_offset.alone_y": 0.12, "heading_bias.alone": -0.015,
    "gnss_delay.alone": 0.3, "gnss_delay.finished": 0.25,
}  # fmt: skip
"""A value of every screened parameter at which it acts."""


def quiet(**changed: object) -> Disturbed:
    """Small random forces, white sensor noise of WHITE, exact sensors."""
    how = Disturbed(X=0.05, Y=0.15, N=0.1, tau=5.0, noise_tau=1e-6, defects=())
    return replace(how, **changed)  # type: ignore[arg-type]


def pushed_trials(
    seed: int, effects: Sequence[str] = (), runs: Sequence[tuple[str, float]] = RUNS, ship: Ship = SHIP,
    how: Disturbed | None = None,
) -> list[Trial]:  # fmt: skip
    """Runs of the ship with effects, pushed by random forces and logged with noise; sensor effects are defects."""
    seen = [e for e in effects if EFFECTS[e.partition(":")[0]].measures]
    acting = with_effects(ship, [e for e in effects if e not in seen])
    return disturbed_trials(acting, runs, seed, replace(how or quiet(), defects=tuple(seen)))


@lru_cache(maxsize=1)
def full_model() -> FullModel:
    """ESSO OSAKA with every effect, a bank line 6 m to the west known."""
    return ship_with_all_effects(SHIP, None, {"bank": BANK})


@lru_cache(maxsize=4)
def full_steps(h: float = 1.0, compiled: bool = True) -> TransitionModel:
    """Steps of it with a few coefficients and all effects as possible columns."""
    return TransitionModel(full_model().ship, [*FREE, *full_model().symbols], h, compiled)


def candidate(effect: str, form: str = "") -> Candidate:
    """One of its candidates."""
    return find(full_model().candidates, effect, form)


def priors_of(ship: Ship, symbols: Sequence[str]) -> Priors:
    """Priors of these coefficients as the file of the ship states them."""
    rows = [ship.coefficients[s] for s in symbols]
    return Priors(
        tuple(Column(s) for s in symbols),
        *(np.array([getattr(c, k) for c in rows]) for k in ("value", "std", "lower", "upper")),
    )


def problem_of(trials: Sequence[Trial], h: float = 0.5) -> tuple[SearchProblem, Estimate]:
    """The problem that trials pose with FREE coefficients free, and its fit without any effect.

    Inputs are held between samples, as the generator has them."""
    steps, base = full_steps(h), priors_of(SHIP, FREE)
    data = grid_trials(trials, steps.ship, h)
    start = initial_point(steps, data, steps.ship.values, base, initial_noise(steps.ship))
    null = estimate(steps, data, start, iterations=12)
    return SearchProblem(steps, data, base, full_model().candidates), with_correlation_time(steps, data, null)


@cache
def pushed_problem(
    seed: int, *effects: str, runs: tuple[tuple[str, float], ...] = RUNS, h: float = 0.5, how: Disturbed | None = None
) -> tuple[SearchProblem, Estimate]:
    """The problem that ``pushed_trials`` pose, and its fit, made once for all tests. Nobody may change them."""
    return problem_of(pushed_trials(seed, effects, runs, how=how), h)


def theta_of(steps: TransitionModel, changed: dict[str, float]) -> np.ndarray:
    """Coefficients of the ship with all effects with some changed."""
    theta = steps.ship.values.copy()
    for symbol, value in changed.items():
        theta[steps.ship.symbols.index(symbol)] = value
    return theta


def off_neutral(steps: TransitionModel) -> np.ndarray:
    """Coefficients at which every effect acts."""
    return theta_of(steps, OFF_NEUTRAL)


def states_about(steps: TransitionModel, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random states (S, M) of a ship under way, memory disturbed, and inputs (C, M)."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((steps.S, count))
    scale = np.concatenate([[3.0, 3.0, 1.0, 0.08, 0.06, 0.03], steps.model.sizes])
    z *= scale[:, None]
    z[3] += 0.35
    c = np.zeros((steps.C, count))
    values = {
        "n": (9.0, 2.0),
        "delta": (0.0, 0.3),
        "wind_north": (0.5, 1.0),
        "wind_east": (-0.5, 1.0),
        "time": (30.0, 5.0),
    }
    for name, (mean, spread) in values.items():
        if name in steps.model.controls:
            c[steps.model.controls.index(name)] = mean + spread * rng.standard_normal(count)
    return z, c


def short_data(h: float = 1.0) -> GriddedTrials:
    """Two short windows of unlike length with a gap in one sensor."""
    trials = pushed_trials(3, runs=(("zigzag:20/20", 40.0), ("random:11", 28.0)))
    data = grid_trials(trials, full_model().ship, h)
    good, measured = data.good.copy(), data.measured.copy()
    good[9:12, 0, 4] = measured[9:12, 0, 4] = False
    good[5, 1] = measured[5, 1] = False
    return replace(data, good=good, measured=measured)


def path_near(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> Trajectory:
    """A path that is neither the measured nor the simulated one, with a force."""
    rng = np.random.default_rng(0)
    path = initial_trajectory(steps, data, theta)
    passive = np.arange(6, steps.S)
    z = steps.with_passive_states(path.z, data.inputs, theta, path.force[:-1], passive) if len(passive) else path.z
    return Trajectory(z, path.force + 0.02 * rng.standard_normal(path.force.shape))


FORMS = {
    "nn": lambda psi, n: (n / 10.0) ** 2,
    "cos": lambda psi, n: np.cos(psi),
    "sin 2": lambda psi, n: np.sin(2 * psi),
}
"""Forces that none of the fitted coefficients and no random force can give, by heading and revolutions."""


def acted_windows(problem: SearchProblem, seed: int, act: Act) -> GriddedTrials:
    """The problem's windows once more with random forces and white noise, and what ``act`` does at each step k to the
    forces (3, R) and coefficients (C, R) where the states are z (S, R)."""
    steps, data, rng = problem.steps, problem.data, np.random.default_rng(seed)
    K, R = data.inputs.shape[:2]
    how = quiet()
    sizes = np.array([how.X, how.Y, how.N])[:, None]
    chance = np.array([[process(K, data.h, how.tau, rng) for _ in range(R)] for _ in range(3)])
    y, z = data.y.copy(), steps.settled(data.y[0].T, data.inputs[0].T, steps.ship.values)
    for k in range(K):
        force, theta = sizes * chance[:, :, k], np.tile(steps.ship.values[:, None], R)
        act(k, z, force, theta)
        z = steps.advance(z, data.controls[k].T, steps.coefficients(theta, force))
        y[k + 1] = z[:6].T
    return replace(data, y=y + WHITE * rng.standard_normal(y.shape))


def pushed_windows(problem: SearchProblem, seed: int, axis: int, form: str, size: float) -> GriddedTrials:
    """The problem's windows once more with a force [N, N m] besides random ones, and white noise."""
    n = problem.steps.model.controls.index("n")

    def act(k: int, z: np.ndarray, force: np.ndarray, theta: np.ndarray) -> None:
        force[axis] += size * FORMS[form](z[2], problem.data.inputs[k, :, n])

    return acted_windows(problem, seed, act)


def pushed_by(
    problem: SearchProblem, seed: int, axis: int, form: str, size: float
) -> tuple[TransitionModel, GriddedTrials, Estimate]:
    """Steps, ``pushed_windows`` and the fit to them."""
    return fitted_to(problem, pushed_windows(problem, seed, axis, form, size))


def fitted_to(problem: SearchProblem, seen: GriddedTrials) -> tuple[TransitionModel, GriddedTrials, Estimate]:
    """Steps, the windows ``seen`` and the fit to them."""
    steps = problem.steps
    start = initial_point(steps, seen, steps.ship.values, problem.base, initial_noise(steps.ship))
    return steps, seen, estimate(steps, seen, start, iterations=12)
