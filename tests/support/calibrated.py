"""A small calibration on synthetic trials, shared by the tests of figures, report and result."""

from __future__ import annotations

from functools import cache

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from fitting.calibrate import FitOptions, calibrate
from fitting.result import FitResult
from fitting.settings import Settings

FREE = ("X_0F", "Y_v", "N_r", "k_0", "gamma_P", "Y_A1")


@cache
def small_result(iterations: int = 100) -> FitResult:
    """Six free coefficients calibrated on one run and judged on another, without a compiler."""
    start = load_ship("esso_osaka_3m")
    start = start.fixing([s for s in start.symbols if s not in FREE])
    train, held_out = demo_trials(3, dt=0.5)
    settings = Settings(passes=2, max_iterations=iterations, compiled=False)
    options = FitOptions(next_trial=False, instruments=(), command="mmg fit ship a.csv --out run")
    return calibrate(start, train[:1], held_out[-1:], settings, options)
