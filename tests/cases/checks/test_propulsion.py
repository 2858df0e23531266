"""Revolutions that do not give the speed with the ship's propeller are told of before 300 iterations are spent."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cases.checks.single import doubtful_revolutions, steady_ahead
from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate, write_trial
from cases.trial import Trial
from mmg_ident.commands.main import app

SHIP = load_ship("esso_osaka_3m")


def zigzag(factor: float = 1.0) -> Trial:
    """A zigzag whose revolutions are logged with this ``factor``."""
    trial = simulate(SHIP, parse_maneuver("zigzag:20/20", SHIP, duration=80.0), 0.2)
    return trial.with_columns(n=factor * trial["n"])


def test_a_steady_approach_has_the_revolutions_of_self_propulsion() -> None:
    n, u = steady_ahead(zigzag(), SHIP.particulars["L"])
    assert revolutions_for(SHIP, u) == pytest.approx(n, rel=0.02)


@pytest.mark.parametrize(("factor", "said"), [(1.0, False), (1.3, False), (0.8, False), (0.5, True), (60.0, True)])
def test_revolutions_that_do_not_fit_are_told_of(factor: float, said: bool) -> None:
    found = doubtful_revolutions(SHIP, [zigzag(factor)])
    assert [doubt.code for doubt in found] == ["revolutions"] * said
    for words in found:
        needed, logged = zigzag()["n"][0], factor * zigzag()["n"][0]
        assert f"{needed:.3g}" in words and f"have {logged:.3g}" in words


def test_a_ship_made_of_particulars_fits_a_foreign_plant_and_trials_that_never_go_straight_say_nothing() -> None:
    length, speed = 7.0, 1.2
    particulars = {"L": length, "B": 1.18, "d": 0.443, "C_b": 0.775, "U_0": speed, "A_R": 0.0603, "x_G": 0.0}
    ship = new_ship("foreign", {**particulars, "rho": 1025.0, "D_P": 0.2414, "pitch_ratio": 0.698})
    t = np.arange(0.0, 60.0, 0.5)
    still = {name: np.zeros(len(t)) for name in ("x", "y", "psi", "v", "r", "delta")}
    n = revolutions_for(ship, speed)
    ahead = Trial("ahead", {"t": t, **still, "u": np.full(len(t), speed), "n": np.full(len(t), n)})
    assert doubtful_revolutions(ship, [ahead]) == []
    assert len(doubtful_revolutions(ship, [ahead.with_columns(n=ahead["n"] / 2.4)])) == 1
    turning = ahead.with_columns(n=ahead["n"] / 2.4, delta=np.full(len(t), 0.5))
    assert steady_ahead(turning, length) is None and doubtful_revolutions(ship, [turning]) == []


def test_the_check_says_it_with_a_ship(tmp_path) -> None:
    path = tmp_path / "zigzag_1.csv"
    write_trial(zigzag(0.5), path)
    plain = json.loads(CliRunner().invoke(app, ["check", str(path), "--json"]).stdout)
    own = json.loads(CliRunner().invoke(app, ["check", str(path), "--ship", "esso_osaka_3m", "--json"]).stdout)
    assert not any("propeller does not fit" in s for s in plain["pooled"]["sentences"])
    assert own["pooled"]["sentences"][0].startswith("The propeller does not fit: at ")
