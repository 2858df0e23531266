"""``mmg diagnose`` and ``mmg gap``: folders, verdicts and lines, what they warn of, and how they go on."""

from __future__ import annotations

import inspect
import json
import shutil
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import mmg_ident
from cases.io.read import read_trial
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.result import is_complete, read_diagnosis
from fitting.solvers.control import OutOfTimeError
from mmg.effects import EFFECTS
from mmg.ship import Ship
from mmg_ident import simulate
from mmg_ident.commands.main import main
from mmg_ident.model_gap import GapOptions
from residual import settings as residual_settings
from tests.support.commands import refusal, shown
from tests.support.diagnosis_cases import FEW, RUNS, pushed_trials
from tests.support.figures import unrendered

# ``mmg diagnose``: the folder that it writes, what it warns of, and one clear line for bad input
EFFECT = "current:x=0.03,y=-0.02"
OPTIONS = ["--step", "1"]


def calibrated() -> Ship:
    """A ship as ``mmg fit`` would leave it: its priors are kept beside its estimates."""
    rows = {s: FEW.coefficients[s] for s in FEW.free}
    return FEW.with_coefficients({s: c.with_(prior_value=c.value, prior_std=c.std) for s, c in rows.items()})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibrated ship, three training trials in a current and two that are kept back."""
    folder = tmp_path_factory.mktemp("diagnose")
    (folder / "ship.toml").write_text(dump_ship(calibrated()))
    for role, seed, runs in (
        ("train", 1, (("zigzag:20/20", 80.0), ("random:11", 80.0), ("turning:-20", 80.0))),
        ("test", 2, (("zigzag:-10/10", 60.0), ("random:4", 75.0))),
    ):
        (folder / role).mkdir()
        for trial in pushed_trials(seed, [EFFECT], runs):
            write_trial(trial, folder / role / f"{trial.kind}.csv")
    return folder


@pytest.fixture(scope="module")
def content(folder: Path) -> dict[str, Any]:
    """What ``mmg diagnose`` prints of it; the folder is ``run``."""
    return diagnosed(folder, "--test", folder / "test", "--between", "KIND", "--out", folder / "run")


def diagnosed(folder: Path, *options: object, trials: Path | None = None) -> dict[str, Any]:
    """What ``mmg diagnose`` prints of the ship in a ``folder`` and ``trials``, default those in it."""
    return shown("diagnose", folder / "ship.toml", trials or folder / "train", *options, *OPTIONS)


@pytest.mark.slow
def test_the_effect_is_named_with_its_size_groups_are_compared_and_nothing_is_warned_of(
    content: dict[str, Any],
) -> None:
    (effect,) = content["effects"]
    assert content["verdict"] == "named" and effect["name"] == "current" and effect["evidence"] > ODDS
    x, y = (effect["parameters"][k]["value"] for k in "xy")
    assert (x, y) == pytest.approx((0.03, -0.02), abs=0.004)
    codes = {row["code"] for row in content["messages"]}
    assert not codes & {"no_positions", "no_wind", "one_kind", "not_calibrated", "shared_rows", "no_tests"}
    between = content["between"]
    assert between["by"] == "kind" and list(between["groups"]) == ["random", "turning", "zigzag"]
    assert between["verdict"] == "none" and between["differences"] == []
    assert {"current", "gyro", "velocity_filter", "X_0F"} <= {c["name"] for c in between["candidates"]}


@pytest.mark.slow
def test_candidates_are_all_that_could_be_screened_by_their_evidence_and_shares_add_up(content: dict[str, Any]) -> None:
    names = [c["name"] for c in content["candidates"]]
    assert len(names) == len(set(names)) and set(content["not_screened"]) == {"bank"}
    assert set(names) | set(content["not_screened"]) == set(EFFECTS) - {"gyro"}  # fitted along
    for c in content["candidates"]:
        assert c["score"] >= 0 and 0 <= c["p_value"] <= 1 and 0 <= c["absorbed_share"] <= 1
    gains = [c["evidence"] for c in content["candidates"] if c["evidence"] is not None]
    assert len(gains) >= 6 and gains == sorted(gains, reverse=True) and names[0] == "current"
    where, held = content["where"], content["held_out"]
    assert sum(c["share"] for c in where["channels"].values()) == pytest.approx(1.0)
    assert where["regions"] and where["bands"]
    assert {row["channel"] for row in where["phases"]} <= set(where["channels"]) == {"surge", "sway", "yaw"}
    low, high = held["interval_90"]
    assert held["windows"] == 3 + 4 and 0 < low <= held["reduction"] <= high < 1
    assert held["reduction"] == pytest.approx(1 - held["mse_after"] / held["mse_before"])


@pytest.mark.slow
def test_the_folder_holds_what_was_printed_with_the_trials_that_it_is_of(folder: Path, content: dict[str, Any]) -> None:
    run = folder / "run"
    assert json.loads((run / "diagnosis.json").read_text()) == content
    result = json.loads((run / "result.json").read_text())
    for key, role, count in (("data", "train", 3), ("test", "test", 2)):
        assert len(result[key]) == count and all(len(row["sha256"]) == 64 for row in result[key])
        assert {Path(row["path"]).parent.name for row in result[key]} == {role}
    assert result["figures"] and all((run / f["file"]).stat().st_size > 5000 for f in result["figures"])
    assert result["warnings"] == content["warnings"] and not [p for p in folder.iterdir() if p.name.startswith(".")]


@pytest.mark.slow
def test_the_ship_of_the_folder_has_what_was_named_and_can_be_used_again(folder: Path, content: dict[str, Any]) -> None:
    ship = load_ship(folder / "run")
    assert set(ship.effects) == {"current"}
    assert ship.parameters_of("current").x == pytest.approx(content["effects"][0]["parameters"]["x"]["value"])
    for s in FEW.free:
        c = ship.coefficients[s]
        assert c.source == "mmg diagnose" and c.std < FEW.coefficients[s].std
        assert (c.prior_value, c.prior_std) == (FEW.coefficients[s].value, FEW.coefficients[s].std)
    scores = shown("score", folder / "ship.toml", folder / "run", folder / "test" / "random.csv")["models"]
    assert scores[str(folder / "run")]["window"] < scores[str(folder / "ship.toml")]["window"]


def bare(trial: Trial, *names: str) -> Trial:
    return replace(trial, columns={k: v for k, v in trial.columns.items() if k not in names})


@pytest.fixture(scope="module")
def poor(folder: Path) -> Path:
    """Three zigzags, one without positions, one without wind, beside a trial whose role is test; the first, twice, as
    tests."""
    poor = folder / "poor"
    (poor / "train").mkdir(parents=True)
    (poor / "test").mkdir()
    (poor / "ship.toml").write_text(dump_ship(FEW))
    a, b, c = pushed_trials(3, [EFFECT], [(f"zigzag:{angles}", 60.0) for angles in ("20/20", "-20/20", "15/15")])
    write_trial(a, poor / "train" / "zigzag_a.csv")
    write_trial(bare(b, "x", "y"), poor / "train" / "zigzag_b.csv")
    write_trial(bare(c, "wind_speed", "wind_direction"), poor / "train" / "zigzag_c.csv")
    shutil.copy(poor / "train" / "zigzag_a.csv", poor / "test" / "again.csv")
    late = {**a.columns, "t": a.t + 1000.0}
    write_trial(replace(a, columns={k: v[100:] for k, v in late.items()}), poor / "test" / "renamed.csv")
    shutil.copy(folder / "test" / "random.csv", poor / "train")
    (poor / "train" / "trials.toml").write_text('[files."random.csv"]\nrole = "test"\n')
    return poor


@pytest.mark.slow
def test_what_poor_trials_cannot_say_is_said_and_the_rest_is_concluded(poor: Path) -> None:
    with unrendered():
        content = diagnosed(poor, "--test", poor / "test", "--out", poor / "run")
    rows = [(row["code"], row["text"]) for row in content["messages"]]
    for code, words in (
        ("not_calibrated", ""), ("role_held_out", "random"), ("no_positions", "zigzag_b"), ("no_wind", "zigzag_c"),
        ("one_kind", "zigzag"), ("shared_rows", "again"), ("shared_rows", "renamed"),
        ("not_excited", "propeller_side_force"),
    ):  # fmt: skip
        assert sum(code == its and words in text for its, text in rows) == 1, (code, words, rows)
    assert content["verdict"] in ("none", "named", "unknown") and content["candidates"]
    assert list(content["held_out"]["by_run"]) == ["random"]
    assert "zigzag_b" in (poor / "run" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_without_test_trials_and_without_any_wind_it_still_concludes(folder: Path, poor: Path) -> None:
    """One run, no wind, and no test trial left."""
    trial, calm = read_trial(poor / "train" / "zigzag_a.csv"), poor / "calm.csv"
    write_trial(bare(trial, "wind_speed", "wind_direction"), calm)
    with unrendered():
        content = diagnosed(folder, "--test", poor / "test" / "again.csv", "--out", poor / "one", trials=calm)
    assert {"no_test_left", "no_tests"} <= {row["code"] for row in content["messages"]}
    assert content["held_out"] is None
    assert set(content["not_screened"]) == {"bank", "wind_force", "wind_sensor_bias"}
    assert {c["name"] for c in content["candidates"]}.isdisjoint(content["not_screened"])


@pytest.mark.slow
def test_a_breakdown_of_the_numerics_is_unknown_with_the_reason(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = Mock(side_effect=np.linalg.LinAlgError("Matrix is not positive definite"))
    monkeypatch.setattr("diagnosis.diagnose.prepare", broken)
    content = shown("diagnose", folder / "ship.toml", folder / "train", "--out", tmp_path / "run")
    assert content["verdict"] == "unknown"
    assert content["messages"][0]["code"] == "model_breaks_down" and not content["effects"]
    assert read_diagnosis(tmp_path / "run").verdict == "unknown"


@pytest.mark.slow
def test_a_time_limit_without_a_verdict_is_one_line(folder: Path, tmp_path: Path) -> None:
    given = ["diagnose", folder / "ship.toml", folder / "train", "--out", tmp_path / "run", "--time-limit", "0.01"]
    assert "0.01" in refusal(*given)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_what_comes_after_the_verdict_is_left_out_at_the_limit_and_made_by_resume(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = ("--out", tmp_path / "run")
    with unrendered(), monkeypatch.context() as patched:
        patched.setattr("diagnosis.diagnose.next_test", Mock(side_effect=OutOfTimeError("the time limit was reached")))
        first = diagnosed(folder, *out, "--time-limit", "600")
        assert "out_of_time" in {row["code"] for row in first["messages"]} and not is_complete(tmp_path / "run")
    with unrendered():
        again = diagnosed(folder, *out, "--resume")
    assert again["verdict"] == first["verdict"] and is_complete(tmp_path / "run")
    assert "out_of_time" not in {row["code"] for row in again["messages"]}


@pytest.mark.slow
def test_records_without_noise_and_tests_that_are_too_short_are_concluded_from_with_a_caveat(
    folder: Path, tmp_path: Path
) -> None:
    for role, kind, order, seconds in (
        ("train", "zigzag", "20/20", 40.0), ("train", "turning", "25", 40.0), ("test", "random", "3", 8.0)
    ):  # fmt: skip
        (tmp_path / role).mkdir(exist_ok=True)
        write_trial(simulate(FEW, f"{kind}:{order}", duration=seconds), tmp_path / role / f"{kind}.csv")
    where = ("--test", tmp_path / "test", "--out", tmp_path / "run")
    with unrendered():
        content = diagnosed(folder, *where, trials=tmp_path / "train")
    said = {row["code"]: row["text"] for row in content["messages"]}
    assert {"no_noise", "tests_too_short"} <= set(said) and "no_tests" not in said
    assert content["verdict"] in ("none", "named", "unknown") and content["held_out"] is None
    assert "NaN" not in (tmp_path / "run" / "diagnosis.json").read_text()


# ``mmg gap``: one call makes all parts, another goes on with them, bad input is one line
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
    assert found.rows[0].name == "refitted"
    codes = {m.code for m in found.warnings}
    assert "not_refitted" in codes and "calibrated_on" not in codes
    # on fewer of its trials it is made again, and a test trial that it knows is said
    result = mmg_ident.load_run(compared / "refitted")
    few = mmg_ident.gap(result, files["train"][:2], files["train"][2:], options)
    codes = {m.code for m in few.warnings}
    assert few.rows[0].name == "as given" and "calibrated_on" in codes and "not_refitted" not in codes


@pytest.mark.slow
def test_a_time_limit_ends_a_training_that_resume_goes_on_with(
    compared: Path, files: dict[str, list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inspect.unwrap(residual_settings.TrainSettings.__init__), "__defaults__", trainings_of(10**6))
    began, limit = time.monotonic(), ["--time-limit", "8"]
    assert main(gap({**files, "ship": [str(compared / "refitted")]}, tmp_path / "gap") + limit) == 130
    assert time.monotonic() - began < 8 + 12  # reading and importing come before it, and a machine may be busy
    assert {path.name for path in (tmp_path / "gap" / "hybrid").iterdir()} == {"training"}
