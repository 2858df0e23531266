"""Ship files: what is read, written, repaired and refused; the habits of the library's public functions."""

from __future__ import annotations

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.numpy import load_file

from cases.shipfiles.effects import freeing_effects, reduced_ship, with_instruments
from cases.shipfiles.generated_ship import generated_ship, structure_of
from cases.shipfiles.network_file import save_network, save_tensors
from cases.shipfiles.ship_file import (
    ShipFile,
    dump_ship,
    dump_ship_json,
    dump_whole_ship,
    library,
    load_ship,
    parse_ship,
)
from cases.simulation.harbour_inputs import harbour_inputs
from cases.simulation.simulate import simulate_controls
from mmg.components.coefficients import names
from mmg.components.wind import fujiwara
from mmg.errors import BadValue, Conflict, UserError
from mmg.model import assemble
from mmg.network import Network
from mmg.ship import Ship
from tests.support.actuator_ships import FERRY
from tests.support.networks import random_network

SHIP = load_ship("esso_osaka_3m")
TEXT = library()["esso_osaka_3m"].read_text(encoding="utf-8")

# A hull alone: every coefficient takes its default.
PARTICULARS = "L = 2.0\nB = 0.4\nd = 0.1\nm = 60.0\nx_G = 0.0\nrho = 1000.0"
SMALL = f'\n[ship]\nname = "small"\n{PARTICULARS}\n\n[model]\nhull = "unified"\n'


def coefficient(symbol: str, **entries: str) -> str:
    """The small ship with one coefficient table."""
    lines = "\n".join(f"{key} = {value}" for key, value in entries.items())
    return f"{SMALL}\n[coefficients.{symbol}]\n{lines}\n"


@settings(max_examples=25, deadline=None)
@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(0, 1e300),
    st.floats(0, 1e300) | st.just(np.inf),
    st.text(st.characters(exclude_categories=("Cc", "Cs")), min_size=1, max_size=20),
    st.none() | st.floats(-1e9, 1e9),
)
def test_any_number_and_text_survive_a_round_trip(
    value: float, std: float, room: float, words: str, prior: float | None
) -> None:
    """Text of one or more characters without control characters other than newline and tab."""
    small = parse_ship(SMALL)
    changed = small.coefficients["Y_v"].with_(
        value=value,
        std=std,
        lower=value - room,
        upper=value + room,
        fixed=std == 0 or value - room == value + room,
        source=words,
        verdict=f'"{words}" \\ \n\t',
        prior_value=prior,
        prior_std=None if prior is None else abs(prior),
    )
    ship = small.with_coefficients({"Y_v": changed})
    assert parse_ship(dump_ship(ship)).coefficients["Y_v"] == changed


def test_an_effect_is_known_by_the_name_of_earlier_releases() -> None:
    """velocity_lag is the velocity filter in the earth frame: in files, with its campaigns, and in options."""
    late = SHIP.with_effect("velocity_filter", {"tau": 0.7})
    late = replace(late, campaigns={"spring": {"velocity_filter.tau": 0.9}})
    text = dump_ship(late)
    kept = text[: text.index('[coefficients."velocity_filter.body_axes"]')]
    rest = text[text.index('[coefficients."velocity_filter.body_axes"]') :].partition("\n[")[2]
    old = parse_ship((kept + "[" * bool(rest) + rest).replace("velocity_filter", "velocity_lag"))
    assert old.effects == late.effects and old.campaigns == late.campaigns
    assert (old.values == late.values).all() and old.symbols == late.symbols
    assert with_instruments(SHIP, ["velocity_lag"]) == with_instruments(SHIP, ["velocity_filter"])
    assert freeing_effects(SHIP, ["velocity_lag:tau=0.7"]).values.tolist() == late.values.tolist()


def test_left_out_coefficients_take_the_defaults_of_the_model_in_the_fixed_order() -> None:
    ship = parse_ship(coefficient("N_v", value="-0.2"))
    assert ship.symbols == parse_ship(SMALL).symbols
    assert ship.coefficients["N_v"].value == -0.2
    assert ship.coefficients["N_v"].std == parse_ship(SMALL).coefficients["N_v"].std
    assert ship.coefficients["Y_v"] == parse_ship(SMALL).coefficients["Y_v"]
    assert not any(symbol.startswith(("t_P", "gamma", "X_A")) for symbol in ship.symbols)


@pytest.mark.parametrize(
    ("entries", "fixed"),
    [
        ({"value": "-0.3"}, False),
        ({"value": "-0.3", "fixed": "true"}, True),
        ({"value": "-0.3", "std": "0"}, True),
        ({"value": "-0.3", "std": "0.0", "fixed": "false"}, True),
        ({"value": "-0.3", "lower": "-0.3", "upper": "-0.3"}, True),
        ({"value": "-0.3", "std": "0.1", "fixed": "false"}, False),
    ],
)
def test_what_makes_a_coefficient_fixed(entries: dict[str, str], fixed: bool) -> None:
    ship = parse_ship(coefficient("Y_v", **entries))
    assert ship.coefficients["Y_v"].fixed is fixed
    assert ("Y_v" in ship.free) is not fixed


@pytest.mark.parametrize(
    ("value", "lower", "upper", "repaired"),
    [(-0.3, 0.0, 1.0, True), (2.0, 0.0, 1.0, True), (0.0, 0.5, 1.0, True), (0.0, 0.0, 1.0, False)],
)
def test_bounds_that_exclude_their_own_value_are_repaired_with_a_notice_and_others_left_alone(
    value: float, lower: float, upper: float, repaired: bool
) -> None:
    ship = parse_ship(coefficient("X_vr", value=str(value), lower=str(lower), upper=str(upper)))
    c, notices = ship.coefficients["X_vr"], [n for n in ship.notices if "bounds" in n]
    assert c.value == value and ((c.lower, c.upper) != (lower, upper)) is repaired
    assert c.lower <= lower and c.upper >= upper and (c.lower < value < c.upper or not repaired)
    assert len(notices) == repaired
    assert all("X_vr" in n and f"[{lower:g}, {upper:g}]" in n and f"{value:g}" in n for n in notices)
    assert any("default" in n and "Y_v" in n for n in ship.notices)  # left out of this file, and said


def without(key: str) -> str:
    """The library's ship file without one line."""
    text, count = re.subn(rf"(?m)^{key} = .*\n", "", TEXT, count=1)
    assert count == 1
    return text


REFUSED = {
    "unknown coefficient": (coefficient("Y_q", value="1.0"), ["Y_q", "hull unified", "N_v"]),
    "coefficients of a rudder that is gone": (
        without("rudder"),
        ["unknown coefficients t_R, a_H, x_H", "remove them, or name the model that has them under [model]"],
    ),
    "coefficient of a model the ship lacks": (coefficient("t_P", value="0.2"), ["t_P", "hull unified"]),
    "upper bound below the lower": (
        coefficient("Y_v", value="-0.3", lower="0.5", upper="-0.5"),
        ["Y_v", "upper = -0.5", "below", "lower = 0.5"],
    ),
    "value a truth": (coefficient("Y_v", value="true"), ["Y_v] value = true: must be a number"]),
    "value nan": (coefficient("Y_v", value="nan"), ["Y_v] value = nan: must be a finite number"]),
    "fixed in words": (coefficient("Y_v", value="-0.3", fixed='"yes"'), ['Y_v] fixed = "yes": must be true or false']),
    "misspelt key": (coefficient("Y_v", valeu="-0.3"), ["Y_v] unknown key 'valeu'", "did you mean 'value'?"]),
    "coefficient without a table": (SMALL + "\n[coefficients]\nY_v = -0.3\n", ["Y_v", "table"]),
    "coefficients not a table": ("coefficients = 3\n" + SMALL, ["coefficients"]),
    "missing particular": (without("A_R"), ["[ship]", "A_R", "rudder single"]),
    "length in words": (SMALL.replace("L = 2.0", 'L = "2 m"'), ['[ship] L = "2 m": must be a number in m']),
    "infinite length": (SMALL.replace("L = 2.0", "L = inf"), ["[ship]", "L", "inf"]),
    "unknown table": (SMALL + "\n[hull]\nx = 1\n", ["unknown section 'hull'", "ship, model"]),
    "unknown model": (SMALL.replace('"unified"', '"no"'), ['[model] hull = "no": must be "unified"']),
    "unknown role": (SMALL + 'sails = "square"\n', ["sails", "hull"]),
    "rudder without a propeller": (SMALL + 'rudder = "single"\n', ["rudder", "propeller"]),
    "empty": ("", ["[model] is missing", "[ship] is missing"]),
    "misspelt particular": (SMALL.replace("x_G", "x_g"), ["[ship] unknown key 'x_g'; did you mean 'x_G'?"]),
    "name that is no text": (SMALL.replace('"small"', "3"), ["[ship] name = 3: must be text"]),
    "magnitude beyond all numbers": (coefficient("Y_v", value="1" + "0" * 400), ["Y_v] value = 1000", "must be a"]),
    "nested beyond reading": ("a = " + "[" * 5000, ["not a valid TOML file"]),
}
"""Text of a ship file -> what the one line must name."""


def refusal(path: Path, kind: type[UserError] = BadValue) -> str:
    """The line with which the file at ``path`` is refused, which names it."""
    with pytest.raises(kind) as raised:
        load_ship(path)
    line = str(raised.value)
    assert "\n" not in line and path.name in line
    return line


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_ship_file_gives_one_line_that_names_file_and_key(case: str, tmp_path: Path) -> None:
    text, must_name = REFUSED[case]
    path = tmp_path / "my_ship.toml"
    path.write_text(text, encoding="utf-8")
    line = refusal(path)
    assert [word for word in must_name if word not in line] == []


def test_everything_wrong_with_a_file_is_said_at_once() -> None:
    wrong = SMALL.replace("L = 2.0", "L = -3\nlength = 2")
    tables = '[coefficients.Y_v]\nvalue = "x"\nstd = -1\n[coefficients.N_v]\nlower = nan\n'
    with pytest.raises(BadValue) as raised:
        parse_ship(wrong + tables, "mine.toml")
    line = str(raised.value)
    assert line.startswith("mine.toml: ") and "\n" not in line
    for problem in (
        "[ship] unknown key 'length'",
        "[ship] L = -3 m (length between perpendiculars) must be a positive number",
        '[coefficients.Y_v] value = "x": must be a number',
        "[coefficients.Y_v] std = -1: must be at least 0",
        "[coefficients.N_v] lower = nan: must be a number",
        "[coefficients.N_v] value is missing",
    ):
        assert problem in line


def test_the_schema_of_ship_files_can_be_printed() -> None:
    schema = ShipFile.model_json_schema()
    assert {"ship", "model", "coefficients"} <= set(schema["properties"])
    assert schema["$defs"]["ShipSection"]["properties"]["L"]["unit"] == "m"


# The library

WIND = ("X_A0", "X_A1", "X_A3", "X_A5", "Y_A1", "Y_A3", "Y_A5", "N_A1", "N_A2", "N_A3")
PUBLISHED = {
    "m_x": 0.0467, "m_y": 0.2579, "I_J_z": 0.0286, "X_0F": -0.02139, "X_0A": -0.03189, "X_vr": -0.0081,
    "Y_v": -0.3728, "Y_r": 0.116, "N_v": -0.1458, "N_r": -0.04849, "C_D": 0.9665, "C_rY": 2.217,
    "C_rN": 0.8097, "k_0": 0.3278, "k_1": -0.3323, "k_2": -0.156, "t_P": 0.22, "w_P0": 0.614, "tau": 0.871,
    "C_P": -0.359, "x_P": -0.517, "C_3": -0.251, "C_6": -0.175, "C_7": 0.330, "C_10": -0.233,
    "A_1": -7.90e-5, "A_2": 7.99e-3, "A_3": -4.93e-3, "A_4": -5.87e-3,
    "A_5": -5.58e-4, "A_6": 5.08e-3, "A_7": 1.70e-3, "A_8": 9.16e-4,
    "B_1": 3.50e-5, "B_2": -3.17e-3, "B_3": 1.96e-3, "B_4": 2.33e-3,
    "B_5": 2.25e-4, "B_6": -2.16e-3, "B_7": 6.27e-5, "B_8": 6.25e-5,
    "t_R": 0.19, "a_H": 0.393, "x_H": -0.45, "ell_R": -1.08, "k_x": 0.288, "epsilon": 1.42, "k_xR": 0.144,
    "C_PR": -0.176, "gamma_P": 0.3506, "gamma_N": 0.4406,
}  # fmt: skip
"""Captive-test values of ESSO OSAKA 3 m and of its reversing propeller (Miyauchi et al. 2022)."""


def test_published_values_and_the_wind_regression_are_all_there_is() -> None:
    assert {symbol: SHIP.coefficients[symbol].value for symbol in PUBLISHED} == PUBLISHED
    assert set(SHIP.symbols) == set(PUBLISHED) | set(WIND) | {"tau_a"}
    assert SHIP.coefficients["tau_a"].value == 0.0 and set(SHIP.symbols) - set(SHIP.free) == {"tau_a"}


@pytest.mark.parametrize("name", library())
def test_a_ship_of_the_library_reads_back_and_each_coefficient_has_source_prior_bounds_and_words(name: str) -> None:
    ship = load_ship(name)
    assert ship.notices == () and parse_ship(dump_ship(ship, "a comment\nof two lines")) == ship
    for symbol, c in ship.coefficients.items():
        assert c.symbol == symbol and c.description and c.prime in ("", "mmg"), symbol
        assert c.source and not c.source.startswith("default"), symbol
        assert (c.std > 0 and c.lower < c.value < c.upper) or (c.fixed and name == "vectwin_3m"), symbol


def test_wind_coefficients_default_to_the_regression_on_the_particulars_unless_given() -> None:
    other = parse_ship(TEXT.replace("A_L = 0.52038", "A_L = 0.6"))
    for ship in (SHIP, other):
        expected = fujiwara.regression(names(dict(ship.particulars)))
        assert {name: ship.coefficients[name].value for name in WIND} == expected
        assert all("Fujiwara" in ship.coefficients[name].source for name in WIND)
    assert other.coefficients["Y_A1"].value != SHIP.coefficients["Y_A1"].value
    given = parse_ship(TEXT + "\n[coefficients.X_A1]\nvalue = -0.9\n").coefficients
    assert given["X_A1"].value == -0.9 and given["X_A3"] == SHIP.coefficients["X_A3"]


def hybrid(name: str) -> Ship:
    """A ship with an effect, a verdict and a network of three members, of whose ranges some are not known."""
    ship = load_ship(name).with_effect("draft", {"share": 0.1})
    first = ship.symbols[0]
    known = ship.coefficients[first].with_(verdict="decided by the trials", prior_value=1 / 3, prior_std=0.1, std=1e-17)
    network = random_network(ship, members=3)
    lower = network.lower.copy()
    lower[0] = -np.inf
    return ship.with_coefficients({first: known}).with_network(replace(network, lower=lower))


PLAIN = ("feature_scales", "output_scales", "lower", "upper")


def same_network(a: Network, b: Network) -> bool:
    one, other = ([getattr(n, name) for name in PLAIN] + [x for m in n.members for x in (*m.weights, *m.biases)]
                  for n in (a, b))  # fmt: skip
    return a.features == b.features and all(np.array_equal(x, y) for x, y in zip(one, other, strict=True))


@pytest.mark.parametrize("name", library())
def test_a_whole_ship_reads_back_to_the_last_bit(name: str) -> None:
    ship = hybrid(name)
    back = parse_ship(dump_whole_ship(ship), "ship.toml")
    for field in fields(Ship):
        if field.name not in ("network", "notices"):
            assert getattr(back, field.name) == getattr(ship, field.name), field.name
    assert ship.network is not None and back.network is not None
    assert same_network(back.network, ship.network)


def test_a_network_of_a_ship_whose_sizes_were_whole_numbers_is_read_with_her_file(tmp_path: Path) -> None:
    ship = replace(SHIP, particulars={**SHIP.particulars, "L": 3, "x_G": np.int64(0), "d": np.float32(0.5)})
    ship = ship.with_network(random_network(ship))
    (tmp_path / "ship.toml").write_text(dump_ship(ship))
    save_network(tmp_path / "network.safetensors", ship.network, ship)
    assert load_ship(tmp_path).network is not None


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('features = ["u"]', "esso_osaka_3m"),
        ("members = 3", "= 3"),
        ("layers = 3", "'layers'"),
        ("members = [{weights = [[[1.0], [1.0, 2.0]]], biases = []}]", "rows of a matrix must be of one length"),
    ],
)
def test_a_wrong_network_table_is_refused_in_one_line(table: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "ship.toml"
    path.write_text(f"{dump_ship(SHIP)}\n[network]\n{table}\n")
    assert words in refusal(path, UserError)


def test_the_json_says_units_of_all_particulars_and_inputs() -> None:
    content = json.loads(dump_ship_json(SHIP))
    assert content["particulars"]["L"] == {"value": 3.0, "unit": "m", "description": "length between perpendiculars"}
    assert [(row["name"], row["unit"]) for row in content["inputs"]] == [
        ("n", "rps"), ("delta", "rad"), ("wind_north", "m/s"), ("wind_east", "m/s"),
    ]  # fmt: skip
    assert set(content["primes"]) == {c["prime"] for c in content["coefficients"].values() if c["prime"]}


def test_equal_content_gives_equal_bytes_whatever_its_order(tmp_path: Path) -> None:
    arrays = {"w": np.arange(6.0).reshape(2, 3).T, "b": np.array([1.5], dtype=np.float32)}
    about = {name: f"{name} of ä ship" for name in ("format", "ship", "members", "features", "ship_hash", "h")}
    contents = set()
    for k, words in enumerate((about, dict(reversed(about.items())))):
        path = tmp_path / f"{k}.safetensors"
        save_tensors(path, arrays, words)
        contents.add(path.read_bytes())
        with safe_open(path, framework="numpy") as file:
            assert file.metadata() == about
        found = load_file(path)
        assert set(found) == {"w", "b"} and all(np.array_equal(found[name], arrays[name]) for name in found)
        assert found["b"].dtype == np.float32
    assert len(contents) == 1


# Generated models are ships: counts, ship file and back, components, what is refused
VECTWIN = load_ship("vectwin_3m")


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
    assert json.loads(dump_ship_json(made))["coefficients"]["X_u_1"]["monomial"] == made.monomials["X_u_1"]
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
    made = generated_ship(SHIP, structure_of(SHIP, 2, "SM-1"), hard=hard, offset=True)
    assert made.components == {**SHIP.components, "expansion": "hard_submodels" if hard else "smooth_submodels"}
    state, controls = [0, 0, 0, 0.3, -0.05, 0.03], [10.0, 0.3, 0.5, 0.2]
    one, other = (np.array(assemble(ship).rates(state, controls, ship.values)) for ship in (SHIP, made))
    np.testing.assert_allclose(other, one, rtol=1e-12)
    assert not set(made.free) & {"Y_v", "C_D", "t_R"} and {"m_x", "X_A0"} & set(made.free)


def test_components_can_be_taken_out_but_not_the_only_force_under_water() -> None:
    made = generated(SHIP)
    calm = reduced_ship(made, ["wind"])
    assert calm.monomials == made.monomials and "wind" not in calm.components
    with pytest.raises(Conflict):
        reduced_ship(made, ["expansion"])
    offset = generated_ship(SHIP, structure_of(SHIP, 1, "SM-1"), offset=True)
    back = reduced_ship(offset, ["expansion"])
    assert not back.monomials and back.components == SHIP.components


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
    ship = SHIP.with_effect("hull_memory")
    with pytest.raises(UserError, match="hull_memory"):
        generated_ship(ship, structure_of(ship))
