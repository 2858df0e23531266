"""One manoeuvre of many drawn ships: the intervals of the table of the standard, a criterion, tracks, a figure."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.criteria.imo import imo_figures
from cases.maneuvers.definitions import parse_maneuver
from fitting.prediction.figure_intervals import maneuver_scatter, with_intervals
from mmg.messages import has_code
from mmg_ident.commands.main import main
from tests.fitting.prediction.test_figure_intervals import SPEED, content, run_folder, some_ship


@pytest.fixture(scope="module")
def ship() -> Any:
    return some_ship()


@pytest.mark.slow
def test_one_manoeuvre_has_the_intervals_of_the_table_of_the_standard(ship: Any) -> None:
    plan = parse_maneuver("turning:35", ship, speed=SPEED)
    found, run, drawn = maneuver_scatter(ship, plan, content(ship), 60, seed=4)
    whole = imo_figures(ship, SPEED, scale=325 / 3)
    one = replace(whole, runs=tuple(r for r in whole.runs if r.name == "turning:35"))
    table = with_intervals(one, ship, content(ship), 60, seed=4).rows
    rows = {row.figure: row for row in found.rows}
    for row in (r for r in table if r.run == "turning:35"):
        mine = rows[row.figure]
        assert row.interval_90 == pytest.approx([x / 3 for x in mine.interval_90], rel=1e-9)
        assert row.interval_90_trial == pytest.approx([x / 3 for x in mine.interval_90_trial], rel=1e-9)
        assert mine.probability == row.probability
        assert mine.limit == (None if row.limit is None else pytest.approx(3 * row.limit))
        assert mine.value == pytest.approx(3 * row.value, rel=2e-3)
    assert run is not None and drawn is not None and not drawn.outside
    tracks = found.tracks()
    assert sorted(tracks["run"].unique()) == list(range(61)) and np.isfinite(tracks.to_numpy()).all()


def test_a_stop_that_no_trial_held_is_the_priors(ship: Any) -> None:
    plan = parse_maneuver("crash-stop", ship, speed=SPEED)
    narrow = content(ship, envelope={"u": [0.0, 0.8], "n": [0.0, 30.0]})
    found, _, drawn = maneuver_scatter(ship, plan, narrow, 20)
    (said,) = [str(m) for m in found.notices if has_code([m], "outside_the_trials")]
    assert "prior's" in said and drawn is not None


def test_without_a_calibration_the_coefficients_alone_are_drawn(ship: Any) -> None:
    plan = parse_maneuver("turning:35", ship, speed=SPEED)
    found, run, drawn = maneuver_scatter(ship, plan, {}, 10)
    assert run is None and drawn is None and all(row.interval_90_trial is None for row in found.rows)


@pytest.mark.slow
def test_the_command_prints_both_intervals_and_the_criterion_and_draws_the_tracks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [
        str(run_folder(tmp_path / "run", some_ship())),
        "--maneuver",
        "zigzag:10/10",
        "--scatter",
        "20",
        "--speed",
        str(SPEED),
    ]
    assert main(["simulate", *options, "--plot", str(tmp_path / "tracks.png"), "--json"]) == 0
    rows = {row["figure"]: row for row in json.loads(capsys.readouterr().out)["figures"]}
    first = rows["overshoot_1"]
    assert first["limit"] == pytest.approx(math.radians(20.0)) and 0 <= first["probability"] <= 1
    assert first["interval_90_trial"][0] < first["interval_90_trial"][1]
    assert (tmp_path / "tracks.png").stat().st_size > 10_000
    out = tmp_path / "tracks.csv"
    assert main(["simulate", *options, "--out", str(out)]) == 0
    assert "<= 20.00: " in capsys.readouterr().out
    assert out.read_text().startswith("run,t [s],x [m],y [m],psi [rad]")
    assert main(["simulate", *options[:3], "--plot", str(tmp_path / "a.png")]) == 2
    assert "--scatter" in capsys.readouterr().err
