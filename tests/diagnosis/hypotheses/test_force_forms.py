"""Forms of an unnamed force: their gradients and units; other ships' inputs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from diagnosis.estimation.gridded_trials import grid_trials
from diagnosis.estimation.linearisation import initial_trajectory
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.force_forms import DAMPING, SWINGS, ForceForms, Forms, SmoothBasis, spread_of
from tests.support.diagnosis_cases import full_steps, pushed_trials


@pytest.fixture(scope="module")
def arranged() -> tuple:
    steps = full_steps(0.5)
    data = grid_trials(pushed_trials(3), steps.ship.inputs, 3.0, steps.h)
    z = initial_trajectory(steps, data, steps.ship.values).z
    middle = 0.5 * (z[:-1] + z[1:])
    return steps, data, middle, ForceForms(steps, data, middle)


def test_gradients_are_those_of_finite_differences(arranged: tuple) -> None:
    _, data, middle, forms = arranged
    here = forms.on(data, middle)
    smooth = slice(len(forms.products), None)
    for s in range(2, 6):
        ends = []
        for sign in (1, -1):
            moved = middle.copy()
            moved[..., s] += sign * 1e-5
            ends.append(forms.on(data, moved).values[smooth])
        slope = (ends[0] - ends[1]) / 2e-5
        expected = here.gradients[smooth][..., s]
        assert np.abs(expected - slope).max() < 1e-4 * max(np.abs(slope).max(), 1e-3)


def test_units_are_those_of_the_first_trials(arranged: tuple) -> None:
    """On other trials a form keeps its unit, so that a coefficient means the same force there."""
    _, data, middle, forms = arranged
    u = forms.on(data, middle).at("u")
    twice = middle.copy()
    twice[..., 3] *= 2
    np.testing.assert_allclose(forms.on(data, twice).values[u], 2 * forms.on(data, middle).values[u])


def test_a_ship_with_twin_rudders_and_a_thruster_has_forms_of_each_input() -> None:
    ship = with_effects(load_ship("vectwin_3m"), ["tow:X=0.0,Y=0.0,N=0.0"])
    steps = TransitionModel(ship, [], 0.5, compiled=False)
    trials = pushed_trials(3, runs=(("random:11", 40.0),), ship=load_ship("vectwin_3m"))
    data = grid_trials(trials, ship.inputs, 3.0, steps.h)
    z = initial_trajectory(steps, data, ship.values).z
    middle = 0.5 * (z[:-1] + z[1:])
    names = ForceForms(steps, data, middle).on(data, middle).names
    assert {"delta_port", "delta_starboard|delta_starboard|"} <= set(names)


def test_what_swings_after_the_rudder_is_an_oscillator(arranged: tuple) -> None:
    """Against the differential equation with the rudder held over each step, by an integrator of scipy."""
    steps, data, _, forms = arranged
    made = forms.after_the_rudder(data)
    delta = data.inputs[:, 0, steps.model.controls.index("delta")]
    period = SWINGS[4]
    omega = 2 * np.pi / period

    def moved(_: float, q: np.ndarray, held: float) -> list[float]:
        return [omega * q[1], omega * (held - q[0]) - 2 * DAMPING * omega * q[1]]

    q, expected = np.array([delta[0], 0.0]), []
    for held in delta:
        q = solve_ivp(moved, (0.0, data.h), q, args=(held,), rtol=1e-9, atol=1e-12).y[:, -1]
        expected.append([q[0] - held, q[1]])
    for part, own in zip(("deflection", "speed"), np.array(expected).T, strict=True):
        values = made.values[made.at(f"{period:g} s {part}"), :, 0]
        np.testing.assert_allclose(values / np.abs(values).max(), own / np.abs(own).max(), atol=1e-3)
    assert not made.gradients.any() and len(made.names) == 2 * len(SWINGS)


EVERY = np.ones((40, 5), dtype=bool)


def known(values: np.ndarray) -> Forms:
    """Variables (m, K, R) of which the first is the first logged state."""
    gradients = np.zeros((*values.shape, 6))
    gradients[0, ..., 0] = 1.0
    return Forms(tuple(f"v{i}" for i in range(len(values))), values, gradients)


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(0).uniform(-2.0, 3.0, (3, 40, 5))


def test_functions_are_orthogonal_and_fall(values: np.ndarray) -> None:
    flat = values.reshape(3, -1)
    found = SmoothBasis(flat, 1.4, 12).on(known(values), "smooth", EVERY)
    gram = found.values.reshape(12, -1) @ found.values.reshape(12, -1).T / flat.shape[1]
    assert found.names[0] == "smooth 1" and np.abs(gram - np.diag(np.diag(gram))).max() < 1e-9
    assert np.diag(gram)[0] == pytest.approx(1.0) and (np.diff(np.diag(gram)) <= 1e-9).all()


@pytest.mark.parametrize("waves", [1.0, 2.0, 3.0])
def test_waves_of_one_variable_are_spanned(values: np.ndarray, waves: float) -> None:
    """As of an engine map: up to three of them over the range of the variable."""
    flat = values.reshape(3, -1)
    one = SmoothBasis(flat[:1], 0.35 * spread_of(flat)[0], 8)
    found = one.on(known(values[:1]), "one", EVERY).values.reshape(8, -1)
    wave = np.sin(2 * np.pi * waves * flat[0] / 5.0)
    wave -= wave.mean()
    left = wave - np.linalg.lstsq(found.T, wave, rcond=None)[0] @ found
    assert (left**2).mean() < 0.1 * (wave**2).mean()


def test_there_are_no_functions_where_nothing_is(values: np.ndarray) -> None:
    flat, some = values.reshape(3, -1), EVERY.copy()
    some[30:] = False
    basis = SmoothBasis(flat, 1.4, 8)
    every, part = (basis.on(known(values), "smooth", mask) for mask in (EVERY, some))
    np.testing.assert_array_equal(part.values[:, :30], every.values[:, :30])
    assert not part.values[:, 30:].any() and not part.gradients[:, 30:].any()
