"""Run folders of earlier releases, with other names, and with what is gone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from fitting.report.run_folder import read_result
from fitting.result import read_fit
from mmg.errors import UserError
from mmg.messages import has_code
from tests.support.calibrated import small_result

pytestmark = pytest.mark.usefixtures("blank_figures")


def test_a_run_of_an_earlier_release_is_read_with_present_names(tmp_path: Path) -> None:
    """Else the errors of its coefficients would not find the ship's, and its prediction bands would be too narrow."""
    old = {
        "kind": "fit",
        "coefficients": {"velocity_lag.tau": {"std": 0.1}, "Y_v": {"std": 0.2}},
        "correlation": {"symbols": ["Y_v", "velocity_lag.tau"], "matrix": [[1.0, 0.5], [0.5, 1.0]]},
        "settings": {"words": "the velocity_lag. stays"},
    }
    (tmp_path / "result.json").write_text(json.dumps(old), encoding="utf-8")
    found = read_result(tmp_path)
    assert list(found["coefficients"]) == ["velocity_filter.tau", "Y_v"] and found["settings"] == old["settings"]
    assert found["correlation"]["symbols"] == ["Y_v", "velocity_filter.tau"]


def test_a_run_whose_loss_was_still_to_be_chosen_is_read(tmp_path: Path) -> None:
    """Earlier versions left loss and weight open, said how they were chosen, and could choose the model."""
    small_result().save(tmp_path / "run")
    file = tmp_path / "run" / "result.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    content |= {"weighting": {"loss": "student", "tried": []}, "auto": [{"varied": "start"}]}
    content["settings"] |= {"loss": None, "weight": None, "horizon": 40.0}
    file.write_text(json.dumps(content), encoding="utf-8")
    settings = read_fit(tmp_path / "run").settings
    assert settings.loss == "gaussian" and settings.weight == 1.0


def test_a_ship_with_random_forces_is_read_without_them() -> None:
    text = dump_ship(load_ship("esso_osaka_3m").with_effect("tow"))
    ship = parse_ship(text.replace('effects = ["tow"]', 'effects = ["tow", "disturbance"]') + (
        '\n[coefficients."disturbance.X"]\nvalue = 0.3\nfixed = true\nunit = "N"\n'
    ))  # fmt: skip
    assert ship.effects == ("tow",) and has_code(ship.notices, "effect_gone")
    with pytest.raises(UserError, match="disturbance"):
        freeing_effects(ship, ["disturbance"])
