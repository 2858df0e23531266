"""The ship file and its JSON as products."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from delivery.export import export
from delivery.product import product_of
from mmg.errors import BadValue
from mmg.model import assemble
from mmg_ident.commands.main import main
from tests.support.c_products import product
from tests.support.networks import random_network


@pytest.mark.parametrize("form", ["toml", "json"])
def test_an_exported_ship_is_the_ship_again(form: str, tmp_path: Path) -> None:
    ship, path = load_ship("esso_osaka_3m"), tmp_path / f"ship.{form}"
    uncalibrated = product_of("esso_osaka_3m", force=True)
    export(uncalibrated, form, path)
    back = load_ship(path)
    assert back.coefficients == ship.coefficients and back.particulars == ship.particulars
    assert uncalibrated.caveats[0] in path.read_text()


@pytest.mark.parametrize("form", ["toml", "json"])
def test_a_command_takes_what_was_exported(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"ship.{form}"
    assert main(["export", "esso_osaka_3m", "--format", form, "--out", str(path), "--force"]) == 0
    capsys.readouterr()
    outputs = []
    for ship in ("esso_osaka_3m", str(path)):
        assert main(["simulate", ship, "--maneuver", "turning:35", "--duration", "20", "--json"]) == 0
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1]


def test_a_file_of_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadValue):
        export(product_of("esso_osaka_3m", force=True), "toml", tmp_path / "ship.json")


def test_a_hybrid_in_one_file_moves_as_the_hybrid(tmp_path: Path) -> None:
    ship = load_ship("esso_osaka_3m")
    hybrid, path = ship.with_network(random_network(ship)), tmp_path / "hybrid.toml"
    export(product(hybrid), "toml", path)
    state, inputs = [0, 0, 0, 0.4, 0.05, 0.02], [10.0, 0.3, 0.0, 0.0]
    rates = [np.array(assemble(s, symbols=()).rates(state, inputs, [])) for s in (hybrid, load_ship(path), ship)]
    assert np.array_equal(rates[0], rates[1]) and not np.allclose(rates[0], rates[2])
