"""Particulars of a new ship in wrong units, or that contradict each other: a refusal or one warning line."""

from __future__ import annotations

import pytest

from benchmarks.literature import SHIPS
from cases.shipfiles.new_ship import new_ship, parse_particulars
from cases.shipfiles.particulars import unusual
from mmg.errors import UserError
from mmg.messages import has_code
from mmg_ident.commands.main import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("320 58 20.8 0.81 9.86 0.72 112.5 15.5", "U_0=7.97"),
        ("180 32 11 0.8 U_0=14.5", "C_b = 0.8"),
        ("320 58 20.8 0.81 m=200e6", "m / .rho L B d C_b."),
    ],
)
def test_what_no_ship_has_is_refused(words: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        new_ship("mine", parse_particulars(words.split()))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("161 23.2 7.5 0.6 U_0=15", "U_0=7.72"),
        ("325 53 21.7 0.83 U_0=1.5", "Froude number 0.027"),
        ("180 30 10 0.7 A_R=6", "A_R / .L d. = 0.00333"),
        ("180 30 10 0.7 D_P=9.7", "D_P / d = 0.97"),
        ("180 60 10 0.7", "L / B = 3"),
        ("180 30 20 0.7", "B / d = 1.5"),
        ("180 30 10 0.7 m=42e6", "1.08"),
        ("180 30 10 0.95", "C_b = 0.95"),
    ],
)
def test_what_few_ships_have_is_one_warning(words: str, said: str) -> None:
    ship = new_ship("mine", parse_particulars(words.split()))
    found = [notice for notice in ship.notices if has_code([notice], "unusual_particular")]
    assert len(found) == 1
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(found[0])


@pytest.mark.parametrize("real", SHIPS, ids=lambda real: real.name)
def test_ships_of_the_literature_are_not_unusual(real) -> None:
    assert list(unusual({**real.particulars, "U_0": real.speed})) == []


def test_the_command_warns_and_says_how_far_the_ship_can_be_trusted(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ships", "--new", "161", "23.2", "7.5", "0.6", "U_0=15"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert sum(line.startswith("warning: U_0 = 15 m/s") for line in lines) == 1
