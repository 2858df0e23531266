"""A small calibration on synthetic trials, shared by the tests of figures and report."""

from __future__ import annotations

from functools import cache

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.settings import Settings
from mmg.ship import Ship

FREE = ("X_0F", "Y_v", "N_r", "k_0", "gamma_P", "Y_A1")


@cache
def small_calibration(iterations: int = 100) -> tuple[Calibration, Ship, list[Trial], list[Trial]]:
    """(calibration, ship before, trials, held-out trials): six free coefficients on one run, without a compiler."""
    start = load_ship("esso_osaka_3m")
    start = start.fixing([s for s in start.symbols if s not in FREE])
    train, held_out = demo_trials(3, dt=0.5)
    settings = Settings(passes=2, max_iterations=iterations, compiled=False)
    return estimate_coefficients(start, train[:1], settings), start, train[:1], held_out[-1:]
