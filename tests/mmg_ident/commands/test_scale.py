"""``mmg scale``: a run folder that the other verbs take, scaled once or twice, and bad input in one line."""

from __future__ import annotations

import html
import json
from pathlib import Path

import numpy as np
import pytest

import mmg_ident
from fitting.result import read_fit
from mmg_ident.commands.main import main
from tests.support.calibrated import small_result
from tests.support.commands import shown


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of a model and of the ship scaled from it."""
    root = tmp_path_factory.mktemp("scale")
    small_result().save(root / "model")
    assert main(["scale", str(root / "model"), "--length", "325", "--out", str(root / "ship")]) == 0
    return root


@pytest.mark.slow
def test_the_folder_says_what_changed_and_what_is_assumed(folder: Path) -> None:
    found = json.loads((folder / "ship" / "result.json").read_text())["scaling"]
    assert found["model"]["ship"] == "esso_osaka_3m" and found["scale"] == pytest.approx(325 / 3)
    rows = {row["symbol"]: row for row in found["coefficients"]}
    assert rows["X_0F"]["changed"] and rows["X_0F"]["model"] < rows["X_0F"]["ship"] < 0
    assert rows["X_0F"]["ship_std"] >= rows["X_0F"]["added_std"] > 0
    assert not rows["Y_v"]["changed"] and rows["Y_v"]["ship_std"] > rows["Y_v"]["model_std"]
    assert found["self_propulsion"]["ship"]["C_Th"] < 0.6 * found["self_propulsion"]["model"]["C_Th"]
    page = html.unescape((folder / "ship" / "report.html").read_text())
    assert (folder / "ship" / "figures" / "scaling.png").exists() and page.count("data:image/png") == 1
    assert all(words in page for words in found["assumptions"])


@pytest.mark.slow
def test_the_folder_is_read_back_and_its_model_with_it_and_exported(folder: Path, tmp_path: Path) -> None:
    assert main(["export", str(folder / "ship"), "--format", "toml", "--out", str(tmp_path / "ship.toml")]) == 0
    ship, model = read_fit(folder / "ship"), read_fit(folder / "model")
    assert ship.model.ship.values == pytest.approx(model.ship.values)
    assert ship.ship.particulars["L"] == pytest.approx(325.0)
    assert {c.value for c in ship.estimates.values()} == {ship.ship.coefficients[s].value for s in ship.estimates}
    assert ship.envelope and model.envelope
    assert ship.envelope["u"] == pytest.approx([v * np.sqrt(325 / 3) for v in model.envelope["u"]])


@pytest.mark.slow
def test_scaling_twice_is_scaling_once(folder: Path, tmp_path: Path) -> None:
    mmg_ident.scale(folder / "model", 30.0).save(tmp_path / "between")
    once, twice = read_fit(folder / "ship"), mmg_ident.scale(tmp_path / "between", 325.0)
    assert twice.ship.values == pytest.approx(once.ship.values, rel=1e-12)
    assert [c.std for c in twice.ship.coefficients.values()] == pytest.approx(
        [c.std for c in once.ship.coefficients.values()]
    )
    assert twice.ship.name == once.ship.name and twice.correlation == once.correlation
    again = mmg_ident.scale(mmg_ident.scale(folder / "model", 30.0), 325.0)
    assert again.ship.values == pytest.approx(once.ship.values, rel=1e-12)


@pytest.mark.slow
def test_the_ship_is_predicted_with_bands(folder: Path) -> None:
    trial = mmg_ident.simulate(folder / "ship", "turning:20", dt=2.0, duration=600.0)
    (found,) = mmg_ident.predict(folder / "ship", trial, window=300.0)
    assert "x_std [m]" in found.to_pandas()


@pytest.mark.longest
@pytest.mark.slow
def test_the_ship_is_judged_and_reported(folder: Path, tmp_path: Path) -> None:
    run = str(folder / "ship")
    assert shown("imo", run)["ship"] == "esso_osaka_3m_325m"
    assert main(["report", run, "--no-imo", "--out", str(tmp_path / "page.html")]) == 0
    assert main(["simulate", run, "--maneuver", "turning:35", "--scatter", "4"]) == 0


@pytest.mark.slow
def test_a_ship_of_the_library_is_scaled_with_its_priors(tmp_path: Path) -> None:
    found = shown("scale", "kvlcc2_l7", "--length", "320", "--name", "KVLCC2", "--out", tmp_path / "run")
    assert found["ship"] == "KVLCC2" and found["scaling"]["model"]["trials"] == []
    assert found["scaling"]["model"]["status"] == "not calibrated"
    assert set(found["correlation"]["symbols"]) == set(found["coefficients"])
