"""Pilot card, poster and booklet: figures as elsewhere, with intervals, and empty lines for what is unknown."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

import mmg_ident as mi
from cases.criteria.imo import imo_figures
from cases.maneuvers.self_propulsion import speed_for
from cases.quantities import KNOT
from cases.shipfiles.ship_file import load_ship
from fitting.report.ship_card import ABOARD, SHARES, Figure
from mmg.messages import has_code
from mmg.rollout import Simulator
from mmg_ident.commands.main import main
from tests.support.commands import refused, shown

FREE = ("N_v", "N_r", "X_0F")
"""Coefficients of the 3 m ship that are drawn."""


def test_figures_are_those_of_the_criteria_and_speeds_those_of_the_surge_balance() -> None:
    ship = load_ship("kvlcc2_full")
    card, figures = mi.card(ship, scatter=0), imo_figures(ship)
    runs = {run.name: run.figures for run in figures.runs}
    for name in ("turning:35", "turning:-35"):
        for figure in ("advance", "transfer", "tactical_diameter", "time_90", "time_180"):
            assert card.tables["turning"][name][figure].value == pytest.approx(runs[name][figure], rel=1e-12)
    full, coasted = (card.tables["stopping"][text]["track_reach"].value for text in ("crash-stop", "coasting"))
    assert coasted > full == pytest.approx(runs["crash-stop"]["track_reach"], rel=1e-12)
    for share, n, speed in card.engine:
        assert speed.value == pytest.approx(speed_for(ship, n), rel=1e-6) and speed.interval is None
        assert speed.value == pytest.approx(share * card.speed, rel=0.02)  # resistance goes with the square
    assert [share for share, *_ in card.engine] == list(SHARES) and has_code(card.notices, "no_covariance")


def test_draws_give_every_figure_an_interval_that_holds_it() -> None:
    ship = load_ship("esso_osaka_3m")
    wide = {s: ship.coefficients[s].with_(std=0.1 * abs(ship.coefficients[s].value)) for s in FREE}
    others = {s: c.with_(std=0.0) for s, c in ship.coefficients.items() if s not in FREE}
    drawn = mi.card(ship.with_coefficients({**others, **wide}), scatter=60)
    figures = [f for columns in drawn.tables.values() for one in columns.values() for f in one.values()]
    for figure in [*figures, *(speed for *_, speed in drawn.engine)]:
        assert figure.interval is not None and figure.interval[0] <= figure.value <= figure.interval[1]
    # of the speed alone X_0F matters: R ~ X_0F u^2 against a thrust that falls with u
    low, high = drawn.engine[0][2].interval or (0.0, 0.0)
    assert 0.02 < (high - low) / drawn.speed < 0.2
    assert Simulator(drawn.ship).ship.symbols == ship.symbols


def test_a_ship_without_shaft_or_rudder_shows_what_she_can_do(capsys: pytest.CaptureFixture[str]) -> None:
    card = mi.card(load_ship("mariner"))
    assert card.engine == () and has_code(card.notices, "event_not_reached")  # no propeller in her model: no stop
    assert card.tables.keys() == {"turning", "course"} and card.page()
    assert "--scatter 3" in refused(capsys, "card", "mariner", "--scatter", "3")


@pytest.mark.parametrize(
    ("figure", "kind", "length", "words"),
    [
        (Figure(1021.4, (980.2, math.inf)), "way", 320.0, "1,021 m [980, never]; 3.19 L"),
        (Figure(-1e-9), "way", 3.0, "0.00 m; 0.00 L"),
        (Figure(math.radians(7.25)), "deg", 3.0, "7.3°"),
        (Figure(10 * KNOT, (9 * KNOT, 11 * KNOT)), "speed", 320.0, "10.0 kn [9.0, 11.0]"),
        (Figure(0.5), "speed", 3.0, "0.500 m/s"),
    ],
)
def test_figures_are_shown_in_the_units_of_a_bridge(figure: Figure, kind: str, length: float, words: str) -> None:
    assert figure.words(kind, length) == words


def test_the_command_writes_a_page_that_needs_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    content = shown("card", "mariner")
    assert content["files"] == ["card.html"] and content["tables"].keys() == {"turning", "course"}
    page = Path("card.html").read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", page) and "Draught increase" in page
    for lines in ABOARD.values():
        assert all(line in page for line in lines)
    assert "card.html" in refused(capsys, "card", "mariner")  # somebody's file stays
    assert main(["card", "mariner", "--force"]) == 0
    slow, fast = (mi.card("esso_osaka_3m", speed=0.3, scatter=0, rudder_rate=rate) for rate in (None, 10.0))
    assert slow.speed == 0.3 and slow.helm != fast.helm and "7 s" in fast.helm[1][1]
