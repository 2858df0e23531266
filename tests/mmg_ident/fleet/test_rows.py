"""What a row says of differences between campaigns: those named, and those with several names."""

from __future__ import annotations

from typing import Any

from diagnosis.findings import Between, GroupDifference, GroupParameter, GroupValue
from mmg_ident.fleet.rows import one_of_several


def candidate(name: str, nature: str, log_bayes: float, p_value: float = 1e-6) -> GroupDifference:
    values = {"old": GroupValue(0.0, 0.02, -0.3, 0.03), "new": GroupValue(0.3, 0.02, 0.3, 0.03)}
    parameters = {"share": GroupParameter("", "resistance larger by this share", values)}
    return GroupDifference(name, nature, "dynamics", "new", parameters, 30.0, 1, p_value, log_bayes)


def between(verdict: str, *candidates: GroupDifference) -> Between:
    return Between("group", {"old": ("a",), "new": ("b",)}, verdict, "", (), candidates, False)


def names(*given: Any) -> list[str]:
    return [row["name"] for row in one_of_several(between(*given))]


def test_names_that_explain_a_difference_equally_well_are_all_said() -> None:
    rows = (candidate("fouling", "ship", 20.0), candidate("tow", "surroundings", 19.0), candidate("X_vr", "ship", 0.8))
    (name,) = names("unknown", *rows)
    assert "fouling" in name and "tow" in name


def test_nothing_is_said_of_chance_instruments_and_what_is_named_already() -> None:
    assert names("named", candidate("fouling", "ship", 20.0)) == []
    assert names("unknown", candidate("fouling", "ship", 20.0, 0.2)) == []
    assert names("unknown", candidate("gyro", "instrument", 20.0), candidate("fouling", "ship", 15.0)) == []
    assert names("unknown") == []
