"""Regression on velocities: finds the polynomial that made the trials, leaves out what it lacks, minds bounds, gaps."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.harbour_inputs import harbour_inputs
from cases.simulation.simulate import SensorNoise, add_noise, simulate_controls
from cases.trial import Trial
from fitting.calibrate import started_from
from fitting.calibration import estimate_coefficients
from fitting.selection.candidates import candidate
from fitting.selection.polynomial_regression import Regression, increments, regress
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.ship import Ship

ESSO = load_ship("esso_osaka_3m").without_network()
EMPTY = candidate(ESSO, "full-order2").ship
TRUE = {"X_u_absu_1": -0.02, "X_n_absn_1": 0.02, "Y_v_1": -0.15, "Y_v_absv_1": -0.4, "N_r_1": -0.02, "N_n_sd_1": -0.008}


def truth() -> Ship:
    """A ship whose polynomial has the terms of TRUE alone."""
    return EMPTY.with_values(dict.fromkeys(EMPTY.monomials, 0.0) | TRUE)


@lru_cache(maxsize=2)
def runs(count: int = 4) -> tuple[Trial, ...]:
    found = [simulate_controls(truth(), harbour_inputs(ESSO, 300.0, seed, 0.5)) for seed in range(count)]
    return tuple(add_noise(run, SensorNoise.for_length(3.0), seed) for seed, run in enumerate(found))


@lru_cache(maxsize=2)
def found(sparse: bool) -> Regression:
    return regress(EMPTY, increments(EMPTY, runs()), sparse)


@pytest.mark.parametrize("sparse", [False, True])
def test_the_terms_that_made_the_trials_are_found(sparse: bool) -> None:
    for symbol in ("X_n_absn_1", "N_r_1", "N_n_sd_1"):
        assert found(sparse).values[symbol] == pytest.approx(TRUE[symbol], rel=0.25), symbol


def test_terms_that_the_ship_lacks_vanish_and_those_that_she_has_stay() -> None:
    gone = set(found(True).vanished)
    assert not {"X_n_absn_1", "N_r_1", "N_n_sd_1"} & gone
    assert len(gone) > 0.5 * (len(EMPTY.monomials) - len(TRUE)) and not found(False).vanished
    thin = found(True).ship(EMPTY)
    assert set(thin.monomials) == set(EMPTY.monomials) - gone
    kept = thin.coefficients["N_r_1"]
    assert kept.value == 0.0 and kept.std == found(True).sizes["N_r_1"] and "evidence" in kept.source


def test_increments_of_the_true_ship_are_noise_of_the_sensors() -> None:
    system = increments(truth(), runs())
    sd = np.array([0.004, 0.004, 0.0006])
    np.testing.assert_allclose(system.noise, sd, rtol=0.1)
    rms = np.sqrt(np.mean(system.change[:, 1:] ** 2, axis=(0, 1)))
    np.testing.assert_allclose(rms, np.sqrt(2) * sd, rtol=0.25)  # of the sample and of the first one
    assert system.slope.shape == (*system.change.shape, len(EMPTY.free)) and system.symbols == EMPTY.free


def test_slopes_are_those_of_finite_differences() -> None:
    system, h = increments(EMPTY, runs(1)), 1e-4
    for symbol in ("X_n_absn_1", "m_y"):
        there = EMPTY.with_values({symbol: EMPTY.coefficients[symbol].value + h})
        change = system.change - increments(there, runs(1)).change
        slope = system.slope[..., system.symbols.index(symbol)]
        np.testing.assert_allclose(change / h, slope, atol=2e-3 * np.abs(slope).max() + 1e-9)


def test_values_stay_within_their_bounds() -> None:
    row = EMPTY.coefficients["X_n_absn_1"]
    bound = EMPTY.with_coefficients({"X_n_absn_1": replace(row, upper=0.01)})
    values = regress(bound, increments(bound, runs())).values
    assert values["X_n_absn_1"] == pytest.approx(0.01)
    assert all(c.lower <= values[s] <= c.upper for s in bound.free for c in [bound.coefficients[s]])


def test_velocities_that_were_not_measured_are_left_out_and_none_is_one_line() -> None:
    run = runs()[0]
    gap = run["v"].copy()
    gap[100:200] = np.nan
    broken = Trial("gap", {**run.columns, "v": gap})
    assert 0 < len(increments(EMPTY, [broken]).change) < len(increments(EMPTY, [run]).change)
    without = Trial("none", {**run.columns, "v": np.full(len(run), np.nan)})
    with pytest.raises(UserError, match=r"20 s.* u, v, r .*1 trials"):
        increments(EMPTY, [without])


@pytest.mark.slow
def test_held_coefficients_stay_where_the_solver_starts_and_still_have_errors() -> None:
    start, values = found(True).ship(EMPTY), found(True).values
    warm = started_from(start, values, hold=True)
    fit = estimate_coefficients(start, runs()[:1], Settings(window=30.0, passes=1), warm=warm)
    assert fit.converged
    for symbol, value in values.items():
        row = fit.ship.coefficients[symbol]
        assert row.value == pytest.approx(value, rel=1e-6, abs=1e-9), symbol
        assert 0 < row.std <= start.coefficients[symbol].std, symbol


def filtered(**values: float) -> Ship:
    """The polynomial with a velocity filter whose lag is free."""
    late = EMPTY.with_effect("velocity_filter", values)
    return late.with_coefficients({"velocity_filter.tau": late.coefficients["velocity_filter.tau"].with_(fixed=False)})


@pytest.mark.slow
def test_late_velocities_are_found_by_the_positions_and_put_right() -> None:
    late = filtered()
    assert increments(late, runs()).lag <= 0.15
    moved = [replace(run, columns={**run.columns, **_late(run, 1.5)}) for run in runs()]
    there = increments(late, moved)
    assert there.lag == pytest.approx(1.5, abs=0.15)
    values = regress(late, there).values
    assert values["velocity_filter.tau"] == there.lag
    assert values["X_n_absn_1"] == pytest.approx(TRUE["X_n_absn_1"], rel=0.25)


def test_velocities_that_are_late_in_body_axes_are_put_right_in_them() -> None:
    columns = [{x: np.interp(run.t - 1.5, run.t, run[x]) for x in "uv"} for run in runs()]
    moved = [replace(run, columns={**run.columns, **late}) for run, late in zip(runs(), columns, strict=True)]
    assert increments(filtered(body_axes=1.0), moved).lag == pytest.approx(1.5, abs=0.3)


def _late(run: Trial, lag: float) -> dict[str, np.ndarray]:
    """Columns u and v whose earth-fixed vector is late."""
    psi = np.unwrap(run["psi"])
    over_ground = (run["u"] + 1j * run["v"]) * np.exp(1j * psi)  # north + j east
    body = np.interp(run.t - lag, run.t, over_ground) * np.exp(-1j * psi)
    return {"u": body.real, "v": body.imag}
