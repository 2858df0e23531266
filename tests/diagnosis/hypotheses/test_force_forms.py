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
from diagnosis.hypotheses.force_forms import DAMPING, SWINGS, ForceForms
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
    for s in range(2, 6):
        ends = []
        for sign in (1, -1):
            moved = middle.copy()
            moved[..., s] += sign * 1e-5
            ends.append(forms.on(data, moved).values)
        slope = (ends[0] - ends[1]) / 2e-5
        smooth = np.abs(middle[..., s]) > 1e-4  # a modulus has a kink at 0
        np.testing.assert_allclose(here.gradients[:, smooth, s], slope[:, smooth], atol=1e-4 * np.abs(slope).max())


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
