"""Small synthetic calibrations shared by the tests of fitting, and problems that hold more than coefficients."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import freeing_effects, varying_effects, with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import SensorNoise, Wind, add_noise, simulate
from cases.trial import Trial
from fitting.nlp.captive import Captive, CaptiveForces
from fitting.nlp.prior import Prior
from fitting.nlp.problem import Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import cut
from mmg.model import assemble
from mmg.ship import Ship

SIGMA = np.array([0.05, 0.05, 0.01, 0.01, 0.01, 0.002])


@lru_cache(maxsize=2)
def runs(seed: int = 5) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Training and held-out trials of the hidden ship of the demo."""
    train, held_out = demo_trials(seed)
    return tuple(train), tuple(held_out)


@lru_cache(maxsize=1)
def coarse_runs() -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Training and held-out trials of the hidden ship of the demo, sampled at 2 Hz."""
    train, held_out = demo_trials(3, dt=0.5)
    return tuple(train), tuple(held_out)


@lru_cache(maxsize=4)
def kernel(free: tuple[str, ...] | None = None):  # type: ignore[no-untyped-def]
    """Derivative kernels of ESSO OSAKA for these free coefficients (default: all that are free)."""
    ship = load_ship("esso_osaka_3m")
    chosen = free or ship.free
    return Kernels(assemble(ship), np.array([ship.symbols.index(s) for s in chosen]), True)


def problem(K: int = 5, window: float = 40.0, trials: tuple[Trial, ...] | None = None) -> Problem:
    """A problem over the first three training runs with step 1 s."""
    ship = load_ship("esso_osaka_3m")
    segments = cut(trials or runs()[0][:3], 1.0, window, K)
    return Problem(ship, Prior.of(ship), kernel(), segments, SIGMA)


def matrix(sparsity: ca.Sparsity, values: np.ndarray) -> sp.csc_matrix:
    """The matrix of this pattern with these nonzeros."""
    return sp.csc_matrix((values, np.array(sparsity.row()), np.array(sparsity.colind())), shape=sparsity.shape)


def assert_exact_derivatives(p: Problem, x: np.ndarray, *directions: np.ndarray) -> None:
    """Gradient, Jacobian and Hessian of the Lagrangian at x agree with central differences along these directions
    (none: one at random).
    """
    rng, e = np.random.default_rng(1), 1e-6
    lam = rng.normal(size=p.m)

    def slope(x: np.ndarray) -> np.ndarray:
        return 0.7 * p.gradient(x) + matrix(p.patterns[0][0], p.jacobian(x)).T @ lam

    H = matrix(p.patterns[1][0], p.hessian(x, 0.7, lam))
    H = H + sp.triu(H, 1).T
    for d in directions or (rng.normal(size=p.n),):
        ahead, behind = x + e * d, x - e * d
        change = (p.objective(ahead) - p.objective(behind)) / (2 * e)
        assert p.gradient(x) @ d == pytest.approx(change, rel=1e-5, abs=1e-5)
        moved = (p.defects(ahead) - p.defects(behind)) / (2 * e)
        J = matrix(p.patterns[0][0], p.jacobian(x))
        np.testing.assert_allclose(J @ d, moved, atol=1e-6 * max(np.abs(moved).max(), 1e-3))
        bent = (slope(ahead) - slope(behind)) / (2 * e)
        np.testing.assert_allclose(H @ d, bent, atol=2e-5 * np.abs(bent).max())


# Problems of a fit that hold more than coefficients: effects at once, constants of runs, captive points
ESSO = load_ship("esso_osaka_3m")
CROWD = ("hull_memory", "control_delay", "rudder_backlash", "antenna_offset", "gnss_delay", "heading_bias", "log_scale")
# Manoeuvre, heading [rad] and mean wind [m/s] of the runs that an effect is looked for in
IN_WIND = (("zigzag:20/20", 0.0, 0.6), ("turning:-35", 1.5, 1.2), ("random:3", 3.0, 0.9), ("berthing", 4.5, 1.5))
CURRENTS = {"zigzag:20/20": (0.03, -0.02), "turning:35": (-0.025, 0.03), "random:3": (0.0, -0.035)}
SHARED = ("Y_v", "N_v", "Y_r", "N_r", "k_0")


def trials_in_wind(ship: Ship, runs: tuple = IN_WIND, duration: float = 70.0, dt: float = 0.2) -> list[Trial]:
    """Noisy ``runs`` of the ship."""
    made = []
    for seed, (text, heading, wind) in enumerate(runs):
        plan = parse_maneuver(text, ESSO, n=10.0, duration=duration)
        start = plan.start
        start[2] = heading
        run = simulate(ship, plan, dt, Wind(wind, 1.0 + seed, True), seed, start)
        made.append(add_noise(run, SensorNoise(), seed))
    return made


def shifted_ship() -> Ship:
    """A ship that differs from ESSO OSAKA in the coefficients SHARED, by 8 %."""
    return ESSO.with_values({s: 1.08 * ESSO.coefficients[s].value for s in SHARED})


@lru_cache(maxsize=2)
def trials_in_currents(duration: float = 120.0) -> tuple[Trial, ...]:
    """Noisy runs of ``shifted_ship``, each in a current of its own."""
    made = []
    for seed, (text, (x, y)) in enumerate(CURRENTS.items()):
        ship = with_effects(shifted_ship(), [f"current:x={x},y={y}"])
        run = simulate(ship, parse_maneuver(text, ESSO, n=10.0, duration=duration), 0.1)
        made.append(replace(add_noise(run, SensorNoise(), seed), name=text.split(":")[0]))
    return tuple(made)


def points(ship: Ship, noise: float = 0.0, seed: int = 0, count: int = 120) -> Captive:
    """A campaign of oblique tows, turns, revolutions and rudder angles of a ship."""
    rng = np.random.default_rng(seed)
    motion = np.array([rng.uniform(0.2, 0.6, count), rng.uniform(-0.15, 0.15, count), rng.uniform(-0.08, 0.08, count)])
    actuators = {"n": rng.uniform(0, 12, count), "delta": rng.uniform(-0.6, 0.6, count)}
    blank = Captive("tank", motion, actuators, np.zeros((3, count)), np.ones((3, count)))
    F = CaptiveForces(assemble(ship), np.arange(2), blank, compiled=False).residuals(ship.values)
    sigma = np.repeat(0.02 * np.sqrt((F**2).mean(axis=1))[:, None], count, axis=1)
    return Captive("tank", motion, actuators, F + noise * sigma * rng.normal(size=F.shape), sigma)


def write_points(path: Path, header: str, tank: Captive, scale: float = 1.0) -> Path:
    """The points as a table with this ``header``, their forces times ``scale``."""
    rows = np.vstack([tank.motion, tank.actuators["n"], np.degrees(tank.actuators["delta"]), tank.forces * scale])
    np.savetxt(path, rows.T, "%.17g", ",", header=header, comments="")
    return path


@lru_cache(maxsize=4)
def crowded(K: int) -> Problem:
    """A problem with memory, a place-dependent force and measurement effects at once, a few coefficients free."""
    ship = ESSO.fixing([s for s in ESSO.symbols if s not in ("Y_v", "N_r", "C_D", "k_0")])
    ship = freeing_effects(ship, ["bank:distance=6,decay=3", *CROWD])
    true = with_effects(ESSO, ["bank:suction=0.2,moment=0.03,distance=6,decay=3", "hull_memory", "gnss_delay"])
    free = np.array([ship.symbols.index(s) for s in ship.free])
    runs = trials_in_wind(true, IN_WIND[:1] + IN_WIND[3:], 45.0, 0.1)
    segments = cut(runs, 1.0, 40.0, K, inputs=ship.inputs)
    return Problem(ship, Prior.of(ship), Kernels(assemble(ship), free, False), segments, SIGMA)


@lru_cache(maxsize=4)
def with_constants(K: int, captive: bool = False) -> Problem:
    """Two short runs with a shared lag, each with a current (prior off zero) and a compass error of its own, without
    or with captive points."""
    ship = freeing_effects(ESSO.fixing([s for s in ESSO.symbols if s not in SHARED]), ["velocity_filter"])
    ship, constants = varying_effects(ship, ["current:x=0.01", "heading_bias"])
    segments = cut([*trials_in_currents()[:2]], 1.0, 30.0, K, inputs=ship.inputs)
    few = segments.subset(np.flatnonzero(np.isin(np.arange(len(segments.run)), (0, 1, 5))))
    prior = Prior.of(ship, constants, few.trials)
    positions = prior.positions(ship)
    kernel = Kernels(assemble(ship), positions, False)
    tank = points(shifted_ship())
    forces = CaptiveForces(kernel.model, positions[: prior.shared], tank, False) if captive else None
    return Problem(ship, prior, kernel, few, SIGMA, captive=forces)


def somewhere(p: Problem, seed: int = 0) -> np.ndarray:
    """Variables of ``p`` near its start, coefficients inside their bounds and off the neutral values of effects."""
    rng = np.random.default_rng(seed)
    x = p.start(0.3 + 0.05 * rng.normal(size=p.P))
    x[: -p.P] += 0.02 * rng.normal(size=p.n - p.P)
    return x
