"""``mmg gap``: one call makes all parts, another goes on with them, bad input is one line."""

from __future__ import annotations

import inspect
import json
import time
from dataclasses import fields
from pathlib import Path

import pytest

import mmg_ident
from cases.shipfiles.ship_file import dump_ship
from cases.simulation.simulate import write_trial
from mmg_ident.commands.main import main
from mmg_ident.model_gap import GapOptions
from residual import settings as residual_settings
from tests.support.diagnosis_cases import FEW, RUNS, pushed_trials

PARTS = ("refitted", "hybrid", "diagnosis", "both")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Trials in a current to train on, others to test, and a ship file."""
    folder = tmp_path_factory.mktemp("gap")
    found: dict[str, list[str]] = {}
    for name, seed in (("train", 4), ("test", 5)):
        for trial in pushed_trials(seed, ["current:x=0.03,y=0.02"], RUNS):
            path = folder / name / f"{trial.name.replace('/', '_').replace(':', '_')}.csv"
            path.parent.mkdir(exist_ok=True)
            write_trial(trial, path)
            found.setdefault(name, []).append(str(path))
    (folder / "few.toml").write_text(dump_ship(FEW))
    return {**found, "ship": [str(folder / "few.toml")]}


@pytest.fixture(scope="module")
def compared(files: dict[str, list[str]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a comparison with short trainings."""
    out = tmp_path_factory.mktemp("out") / "gap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inspect.unwrap(residual_settings.TrainSettings.__init__), "__defaults__", trainings_of(2))
        assert main(gap(files, out)) == 0
    return out


def gap(files: dict[str, list[str]], out: Path, seeds: str = "1") -> list[str]:
    more = ["--out", str(out), "--no-report", "--seeds", seeds]
    return ["gap", *files["ship"], *files["train"], "--test", *files["test"], *more]


def trainings_of(epochs: int) -> tuple[object, ...]:
    """The defaults of the settings of a training with so many ``epochs``."""
    return tuple(epochs if f.name == "epochs" else f.default for f in fields(residual_settings.TrainSettings))


@pytest.mark.slow
def test_one_call_makes_all_lines_and_parts(compared: Path) -> None:
    found = json.loads((compared / "gap.json").read_text())
    rows = {row["name"]: row for row in found["rows"]}
    assert list(rows) == ["as given", "refitted", "hybrid", "named effects", "named + hybrid", "floor"]
    assert found["kind"] == "gap" and found["verdict"] == "named" and found["effects"] == ["current"]
    assert rows["named effects"]["closes"] > 0.8 > rows["hybrid"]["closes"]
    assert rows["named effects"]["position_m"] < rows["refitted"]["position_m"]
    assert all((compared / rows[name]["ship"] / "result.json").exists() for name in list(rows)[1:-1])
    assert [one["effect"] for one in found["witness"]] == ["current"]


@pytest.mark.slow
def test_another_call_goes_on_with_the_parts_that_are_there(
    compared: Path, files: dict[str, list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    before = {name: (compared / name / "result.json").stat().st_mtime_ns for name in PARTS}
    earlier = json.loads((compared / "gap.json").read_text())
    (compared / "gap.json").unlink()
    assert main([*gap(files, compared), "--resume"]) == 0
    said = capsys.readouterr().err  # of --no-report: the figure is not there
    assert "gap.json" in said and "gap.png" not in said
    after = {name: (compared / name / "result.json").stat().st_mtime_ns for name in PARTS}
    assert after == before and json.loads((compared / "gap.json").read_text())["rows"] == earlier["rows"]
    (compared / "gap.json").unlink()
    assert main([*gap(files, compared, "2"), "--resume"]) == 2  # other settings than the run has


@pytest.mark.longest
@pytest.mark.slow
def test_a_calibration_of_the_same_trials_is_not_made_again(compared: Path, files: dict[str, list[str]]) -> None:
    options = GapOptions(residual_settings.TrainSettings(seeds=1, epochs=2))
    found = mmg_ident.gap(compared / "refitted", files["train"], files["test"], options)
    assert found.row("as given") is None and found.row("refitted") is not None
    codes = {m.code for m in found.warnings}
    assert "not_refitted" in codes and "calibrated_on" not in codes
    # on fewer of its trials it is made again, and a test trial that it knows is said
    result = mmg_ident.load_run(compared / "refitted")
    few = mmg_ident.gap(result, files["train"][:2], files["train"][2:], options)
    codes = {m.code for m in few.warnings}
    assert few.row("as given") is not None and "calibrated_on" in codes and "not_refitted" not in codes


@pytest.mark.slow
def test_a_time_limit_ends_a_training_that_resume_goes_on_with(
    compared: Path, files: dict[str, list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inspect.unwrap(residual_settings.TrainSettings.__init__), "__defaults__", trainings_of(10**6))
    began, limit = time.monotonic(), ["--time-limit", "8"]
    assert main(gap({**files, "ship": [str(compared / "refitted")]}, tmp_path / "gap") + limit) == 130
    assert time.monotonic() - began < 8 + 12  # reading and importing come before it, and a machine may be busy
    assert {path.name for path in (tmp_path / "gap" / "hybrid").iterdir()} == {"training"}
