"""The mixture of regressions behind a starting ship, its spread, and the intervals that it gives."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.estimates import CORRECTIONS, LINEAR, STARTING, estimates, is_starting_ship, spread
from cases.shipfiles.new_ship import HULLS, complete, new_ship
from cases.shipfiles.ship_file import dump_ship, load_ship
from mmg.components import empirical
from mmg_ident.commands.main import main

KVLCC2 = {"L": 7.0, "B": 1.27, "d": 0.455, "C_b": 0.81}


def test_the_mean_of_the_regressions_is_near_the_captive_tests_of_the_kvlcc2() -> None:
    """Published: Y_v -0.315, Y_r 0.083, N_v -0.137, N_r -0.049; single regressions are up to 42 % off."""
    found = empirical.linear_derivatives(**KVLCC2, m_x=0.022)
    assert len(found) == 6
    published = {s: load_ship("kvlcc2_l7").coefficients[s].value for s in LINEAR}
    for symbol, value in published.items():
        values = [each[symbol] for each in found.values()]
        assert np.mean(values) == pytest.approx(value, rel=0.17)
        assert min(values) <= value <= max(values) or symbol == "N_v"


def test_regressions_by_hand() -> None:
    """Norrbin: pi d/L (1.69 + 0.08 C_b B/(pi d)); Wagner Smitt: 1.59 pi d/L; Lee: -0.4545 + 0.065 C_b B/d."""
    found = empirical.linear_derivatives(**KVLCC2, m_x=0.022)
    unit, full = np.pi * 0.065, 0.81 * 1.27 / (np.pi * 0.455)
    assert found["Norrbin (1971)"]["Y_v"] == pytest.approx(-unit * (1.69 + 0.08 * full))
    assert found["Wagner Smitt (1971)"]["N_r"] == pytest.approx(-0.21 * unit)
    assert found["Lee (1998)"]["Y_v"] == pytest.approx(-0.4545 + 0.065 * 0.81 * 1.27 / 0.455)


@pytest.mark.parametrize("hull", HULLS)
def test_priors_are_no_narrower_than_the_regressions_scatter_and_factors_are_said(hull: str) -> None:
    p = complete(KVLCC2)[0]
    rows, scatter = estimates(p, hull), spread(p, 0.022)
    neutral = empirical.linear_derivatives(**KVLCC2, m_x=empirical.motora_added_mass(**KVLCC2)["m_x"])
    for symbol in LINEAR:
        value, share, source = rows[symbol]
        factor = CORRECTIONS[hull].get(symbol, 1.0)
        assert value == pytest.approx(factor * np.mean([each[symbol] for each in neutral.values()]))
        assert share >= 0.99 * scatter[symbol] and ("times" in source) == (factor != 1.0)


def test_imo_gives_a_starting_ship_intervals_and_a_ship_of_the_library_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fitting.prediction.figure_intervals.DRAWS", 20)
    ship = new_ship("mine", KVLCC2)
    assert ship.description == STARTING and is_starting_ship(ship) and not is_starting_ship(load_ship("kvlcc2_l7"))
    symbol = ship.symbols[0]
    calibrated = ship.coefficients[symbol].with_(prior_value=1.0, prior_std=1.0)
    assert not is_starting_ship(ship.with_coefficients({symbol: calibrated}))
    (tmp_path / "mine.toml").write_text(dump_ship(ship), encoding="utf-8")
    command = ["imo", str(tmp_path / "mine.toml"), "--json"]
    assert main(command) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    row = next(r for r in rows if r["figure"] == "tactical_diameter")
    low, high = row["interval_90"]
    assert low < 3.33 < high and low < row["value"] < high
    assert main([*command, "--scatter", "0"]) == 0
    assert all(r["interval_90"] is None for r in json.loads(capsys.readouterr().out)["rows"])
