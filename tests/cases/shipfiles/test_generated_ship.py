"""Generated models are ships: counts, ship file and back, effects, components, what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cases.shipfiles.generated_ship import generated_ship, structure_of
from cases.shipfiles.model_changes import reduced_ship
from cases.shipfiles.ship_file import dump_ship, library, load_ship, parse_ship
from cases.shipfiles.ship_json import dump_ship_json, tables
from cases.simulation.harbour_inputs import harbour_inputs
from cases.simulation.simulate import simulate_controls
from mmg.errors import BadValue, Conflict, UserError
from mmg.model import assemble
from mmg.ship import Ship
from tests.support.actuator_ships import FERRY

VECTWIN, ESSO = load_ship("vectwin_3m"), load_ship("esso_osaka_3m")


def generated(ship: Ship, order: int = 2, submodels: str = "SM-2", seed: int = 0) -> Ship:
    """A generated ship with small random coefficients."""
    made = generated_ship(ship, structure_of(ship, order, submodels), "made")
    rng = np.random.default_rng(seed)
    rows = {s: made.coefficients[s] for s in made.monomials}
    return made.with_values({s: min(max(0.1 * rng.normal() * c.std, c.lower), c.upper) for s, c in rows.items()})


@pytest.mark.parametrize("name", [name for name in library() if name != "mariner"])
def test_the_ship_file_of_a_generated_model_gives_it_back(name: str) -> None:
    made = generated(load_ship(name))
    read = parse_ship(dump_ship(made))
    assert read == made and not read.notices
    again = tables(json.loads(dump_ship_json(made)), "file")
    assert again["coefficients"]["X_u_1"]["monomial"] == made.monomials["X_u_1"]
    a, b = assemble(made), assemble(read)
    rng = np.random.default_rng(1)
    state, controls = rng.normal(size=6) * 0.1, rng.normal(size=len(a.controls))
    one, other = (np.array(model.rates(state, controls, ship.values)) for model, ship in ((a, made), (b, read)))
    np.testing.assert_array_equal(one, other)


def test_four_pods_exert_the_sum_of_their_forces_and_make_eight_variables() -> None:
    ferry = parse_ship(FERRY)
    assert ferry.actuators == tuple(f"{n}azimuth{i}" for i in ("", "_2", "_3", "_4") for n in ("n_", ""))
    model = assemble(ferry)
    turning = dict.fromkeys(model.controls, 0.0) | {"n_azimuth": 10.0, "n_azimuth_3": 10.0}  # both to starboard, ahead
    rates = np.array(model.rates(np.zeros(6), list(turning.values()), ferry.values)).ravel()
    assert rates[3] > 0 > rates[5] and rates[4] == pytest.approx(0.0, abs=1e-12)
    mirrored = dict.fromkeys(model.controls, 0.0) | {"n_azimuth_2": 10.0, "n_azimuth_4": 10.0}
    other = np.array(model.rates(np.zeros(6), list(mirrored.values()), ferry.values)).ravel()
    np.testing.assert_allclose(other[3:], rates[3:] * (1, -1, -1), atol=1e-15)
    structure = structure_of(ferry, 2, "SM-2")
    assert [str(device) for device in structure.devices] == ["azimuth+azimuth_2", "azimuth_3+azimuth_4"]
    made = generated_ship(ferry, structure)
    assert made.actuators == ferry.actuators and made.particulars["x_az_4"] == 1.2
    assert parse_ship(dump_ship(made)) == made


def test_a_generated_model_moves_by_its_own_actuators() -> None:
    """A thrust term alone drives the ship ahead, and one of two rudders turns it, as logged inputs say."""
    made = generated_ship(VECTWIN, structure_of(VECTWIN, 2, "SM-1"))
    made = made.with_values({"X_n_absn_1": 0.03, "X_u_absu_1": -0.05, "Y_v_1": -0.3, "N_r_1": -0.1, "N_n_sds_1": -0.02})
    run = simulate_controls(made, harbour_inputs(made, 100.0, 1, ranges={"n": (8, 8), "delta_starboard": (0.3, 0.3)}))
    assert run["u"][-1] > 0.2 and run["r"][-1] < -1e-3


@pytest.mark.parametrize("hard", [False, True])
def test_terms_on_top_leave_the_forces_of_the_ship_as_they_are(hard: bool) -> None:
    made = generated_ship(ESSO, structure_of(ESSO, 2, "SM-1"), hard=hard, offset=True)
    assert made.components == {**ESSO.components, "expansion": "hard_submodels" if hard else "smooth_submodels"}
    state, controls = [0, 0, 0, 0.3, -0.05, 0.03], [10.0, 0.3, 0.5, 0.2]
    one, other = (np.array(assemble(ship).rates(state, controls, ship.values)) for ship in (ESSO, made))
    np.testing.assert_allclose(other, one, rtol=1e-12)
    assert not set(made.free) & {"Y_v", "C_D", "t_R"} and {"m_x", "X_A0"} & set(made.free)


def test_components_can_be_taken_out_but_not_the_only_force_under_water() -> None:
    made = generated(ESSO)
    calm = reduced_ship(made, ["wind"])
    assert calm.monomials == made.monomials and "wind" not in calm.components
    with pytest.raises(Conflict):
        reduced_ship(made, ["expansion"])
    offset = generated_ship(ESSO, structure_of(ESSO, 1, "SM-1"), offset=True)
    back = reduced_ship(offset, ["expansion"])
    assert not back.monomials and back.components == ESSO.components


@pytest.mark.parametrize(
    ("symbol", "entries", "words"),
    [
        ("Y_q", 'std = 0.1\nmonomial = "u q"', "'q'"),
        ("K_q", 'std = 0.1\nmonomial = "u v"', "X_, Y_"),
        ("m_x", 'monomial = "u v"', "is a coefficient of another model"),
        ("Y_q", 'monomial = "u v"', "give its std"),
    ],
)
def test_a_wrong_term_of_a_ship_file_is_one_line(symbol: str, entries: str, words: str) -> None:
    body, table = dump_ship(generated(load_ship("kvlcc2_l7"))), f"[coefficients.{symbol}]\n"
    given = table in body
    body = body.replace(table, f"{table}{entries}\n") if given else f"{body}\n{table}value = 0.1\n{entries}\n"
    with pytest.raises(UserError, match=words):
        parse_ship(body)


def test_an_expansion_without_terms_and_terms_without_expansion_are_refused() -> None:
    text = dump_ship(generated(load_ship("kvlcc2_l7")))
    no_expansion = text.replace('expansion = "smooth_submodels"', 'hull = "unified"')
    for wrong in (no_expansion, text.split("[coefficients.X_")[0]):
        with pytest.raises(BadValue):
            parse_ship(wrong)


def test_symmetry_is_not_claimed_of_an_actuator_without_partner() -> None:
    ferry = parse_ship(FERRY)
    with pytest.raises(UserError, match="azimuth, azimuth_2, azimuth_3"):
        structure_of(ferry, actuators="azimuth, azimuth_2, azimuth_3")
    with pytest.raises(UserError, match="1 of 2"):
        structure_of(VECTWIN, actuators="n, delta_port")
    assert structure_of(VECTWIN, actuators="n, delta_port", symmetric=False).symmetric is False


def test_an_effect_that_needs_what_is_replaced_is_refused() -> None:
    ship = ESSO.with_effect("hull_memory")
    with pytest.raises(UserError, match="hull_memory"):
        generated_ship(ship, structure_of(ship))
