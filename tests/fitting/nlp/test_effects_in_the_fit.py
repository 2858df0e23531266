"""Effects in the fit: exact derivatives with memory, place and measurement, and recovery of every parameter."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import freeing_effects, with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.gusts import Wind
from cases.simulation.simulate import SensorNoise, add_noise, simulate
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import cut
from fitting.settings import Settings
from fitting.solvers.solve import solve
from mmg.effects import EFFECTS
from mmg.model import assemble
from mmg.ship import Ship
from tests.support.synthetic_runs import SIGMA, assert_exact_derivatives

ESSO = load_ship("esso_osaka_3m")
# Manoeuvre, heading [rad] and mean wind [m/s] of the runs that an effect is looked for in
RUNS = (("zigzag:20/20", 0.0, 0.6), ("turning:-35", 1.5, 1.2), ("random:3", 3.0, 0.9), ("berthing", 4.5, 1.5))
SWITCHED_ON = {
    "bank": "bank:suction=0.3,moment=0.05,distance=6,decay=3",
    "shallow_water": "shallow_water:d_h=0.5",
    "wind_force": "wind_force:X=1.5,Y=0.7,N=1.3",
    "gyro": "gyro:share=-0.02,T=0.6",
    "current": "current:x=0.03,y=-0.02,x_rate=-0.0002",
}
FREED = {"bank": "bank:distance=6,decay=3", "current": "current:x_rate", "gyro": "gyro:T"}


def trials(ship: Ship, runs: tuple = RUNS, duration: float = 70.0, dt: float = 0.2) -> list[Trial]:
    made = []
    for seed, (text, heading, wind) in enumerate(runs):
        plan = parse_maneuver(text, ESSO, n=10.0, duration=duration)
        start = plan.start
        start[2] = heading
        run = simulate(ship, plan, dt, Wind(wind, 1.0 + seed, True), seed, start)
        made.append(add_noise(run, SensorNoise(), seed))
    return made


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_fit_with_the_effect_freed_recovers_its_parameters(name: str) -> None:
    """Within 4 standard errors, or 4 % of a typical size where the grid of 1 s and the all-pass delay set the limit."""
    truth = with_effects(ESSO, [SWITCHED_ON.get(name, name)])
    start = freeing_effects(ESSO.fixing(ESSO.symbols), [FREED.get(name, name)])
    found = estimate_coefficients(start, trials(truth), Settings(compiled=False))
    assert found.converged
    sizes = {f"{name}.{p.symbol}": p.typical for p in EFFECTS[name].parameters(ESSO.namespace, dict(ESSO.components))}
    for symbol in start.free:
        true, c = truth.coefficients[symbol].value, found.ship.coefficients[symbol]
        assert abs(c.value - true) < max(4 * c.std, 0.04 * sizes[symbol]), (symbol, true, c.value, c.std)
        assert c.std < 0.3 * sizes[symbol], f"{symbol} is not determined by these runs"


CROWD = ("hull_memory", "control_delay", "rudder_backlash", "antenna_offset", "gnss_delay", "heading_bias", "log_scale")


@lru_cache(maxsize=4)
def crowded(K: int) -> Problem:
    """A problem with memory, a place-dependent force and measurement effects at once, a few coefficients free."""
    ship = ESSO.fixing([s for s in ESSO.symbols if s not in ("Y_v", "N_r", "C_D", "k_0")])
    ship = freeing_effects(ship, ["bank:distance=6,decay=3", *CROWD])
    true = with_effects(ESSO, ["bank:suction=0.2,moment=0.03,distance=6,decay=3", "hull_memory", "gnss_delay"])
    free = np.array([ship.symbols.index(s) for s in ship.free])
    segments = cut(trials(true, RUNS[:1] + RUNS[3:], 45.0, 0.1), 1.0, 40.0, K, inputs=ship.inputs)
    return Problem(ship, Prior.of(ship), Kernels(assemble(ship), free, False), segments, SIGMA)


def away_from_kinks(p: Problem, seed: int = 0) -> np.ndarray:
    """Near the start, coefficients inside their bounds and off the neutral values."""
    rng = np.random.default_rng(seed)
    x = p.start(0.3 + 0.05 * rng.normal(size=p.P))
    x[: -p.P] += 0.02 * rng.normal(size=p.n - p.P)
    return x


@pytest.mark.slow
@pytest.mark.parametrize("K", [1, 5])
def test_derivatives_with_memory_place_and_measurement_are_exact(K: int) -> None:
    p = crowded(K)
    assert p.S > 6 and p.kernels.first == 0 and not p.kernels.measurement.identity
    assert_exact_derivatives(p, away_from_kinks(p))


@pytest.mark.longest
@pytest.mark.slow
def test_the_optimum_with_effects_does_not_depend_on_the_shooting_interval() -> None:
    ours, whole = (solve(p, p.start()) for p in (crowded(5), crowded(200)))
    assert ours.converged and whole.converged
    assert whole.objective == pytest.approx(ours.objective, rel=1e-5)
