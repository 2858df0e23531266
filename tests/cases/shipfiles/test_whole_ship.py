"""One file holds a whole ship: as TOML with a table [network], and as JSON. Both read back exactly."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.network_file import save_network
from cases.shipfiles.ship_file import dump_ship, dump_whole_ship, library, load_ship, parse_ship
from cases.shipfiles.ship_json import dump_ship_json
from mmg.errors import BadValue, Missing, UserError
from mmg.network import Network
from mmg.ship import Ship
from tests.support.networks import random_network

WRITERS = {"toml": dump_whole_ship, "json": dump_ship_json}


def hybrid(name: str) -> Ship:
    """A ship with an effect, a verdict and a network of three members, of whose ranges some are not known."""
    ship = load_ship(name).with_effect("fouling", {"share": 0.1})
    first = ship.symbols[0]
    known = ship.coefficients[first].with_(verdict="decided by the trials", prior_value=1 / 3, prior_std=0.1, std=1e-17)
    network = random_network(ship, members=3)
    lower = network.lower.copy()
    lower[0] = -np.inf
    return ship.with_coefficients({first: known}).with_network(replace(network, lower=lower))


PLAIN = ("feature_scales", "output_scales", "lower", "upper")


def same_network(a: Network, b: Network) -> bool:
    pairs = [(getattr(a, name), getattr(b, name)) for name in PLAIN]
    for one, other in zip(a.members, b.members, strict=True):
        pairs += zip(one.weights, other.weights, strict=True)
        pairs += zip(one.biases, other.biases, strict=True)
    return a.features == b.features and all(np.array_equal(x, y) for x, y in pairs)


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("name", library())
def test_a_whole_ship_reads_back_to_the_last_bit(name: str, suffix: str, tmp_path: Path) -> None:
    ship, path = hybrid(name), tmp_path / f"ship.{suffix}"
    path.write_text(WRITERS[suffix](ship), encoding="utf-8")
    back = load_ship(path)
    for field in fields(Ship):
        if field.name not in ("network", "notices"):
            assert getattr(back, field.name) == getattr(ship, field.name), field.name
    assert ship.network is not None and back.network is not None
    assert same_network(back.network, ship.network)


def test_a_ship_file_may_name_the_file_of_its_network(tmp_path: Path) -> None:
    ship = hybrid("esso_osaka_3m")
    assert ship.network is not None
    save_network(tmp_path / "learned.safetensors", ship.network, ship)
    text = dump_ship(ship) + '\n[network]\nfile = "learned.safetensors"\n'
    (tmp_path / "mine.toml").write_text(text)
    back = load_ship(tmp_path / "mine.toml").network
    assert back is not None and same_network(back, ship.network)
    with pytest.raises(Missing):
        parse_ship(text)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('file = "../x.safetensors"', "must be plain words, no path"),
        ('file = "missing.safetensors"', "no such file"),
        ('features = ["u"]', "esso_osaka_3m"),
        ("members = 3", "= 3"),
        ("layers = 3", "'layers'"),
        ("members = [{weights = [[[1.0], [1.0, 2.0]]], biases = []}]", "rows of a matrix must be of one length"),
    ],
)
def test_a_wrong_network_table_is_refused_in_one_line(table: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "ship.toml"
    path.write_text(f"{dump_ship(load_ship('esso_osaka_3m'))}\n[network]\n{table}\n")
    with pytest.raises(UserError) as error:
        load_ship(path)
    assert words in str(error.value) and "ship.toml" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.pop("format"), "is no ship of this program"),
        (lambda c: c.pop("particulars"), "is incomplete"),
        (lambda c: c["particulars"].update(L=3.0), "is incomplete or holds a value of another kind"),
        (lambda c: c["model"].update(hull="sailing"), 'hull = "sailing"'),
        (lambda c: c["coefficients"]["Y_v"].update(value="much"), 'value = "much": must be a number'),
    ],
)
def test_a_wrong_json_is_refused_in_one_line(change, words: str, tmp_path: Path) -> None:
    content = json.loads(dump_ship_json(load_ship("esso_osaka_3m")))
    change(content)
    path = tmp_path / "ship.json"
    path.write_text(json.dumps(content))
    with pytest.raises(BadValue) as error:
        load_ship(path)
    assert words in str(error.value) and "ship.json" in str(error.value) and "\n" not in str(error.value)


def test_the_json_says_units_of_all_particulars_and_inputs() -> None:
    content = json.loads(dump_ship_json(load_ship("esso_osaka_3m")))
    assert content["particulars"]["L"] == {"value": 3.0, "unit": "m", "description": "length between perpendiculars"}
    assert [(row["name"], row["unit"]) for row in content["inputs"]] == [
        ("n", "rps"), ("delta", "rad"), ("wind_north", "m/s"), ("wind_east", "m/s"),
    ]  # fmt: skip
    assert set(content["primes"]) == {c["prime"] for c in content["coefficients"].values() if c["prime"]}
