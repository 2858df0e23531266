"""``mmg train`` and a hybrid in the other commands: run folder, decision, envelope, one clear line for bad input."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file

import mmg_ident as mi
from cases.io.read import read_trial
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import write_trial
from fitting.prediction.predict import outside_share, predict
from fitting.report.run_folder import read_result
from mmg.progress import Progress
from mmg.rollout import Simulator
from mmg_ident.commands.main import main
from residual.result import page_of, read_training
from residual.settings import TrainSettings
from tests.support import hybrids
from tests.support.commands import interrupted, refusal, shown
from tests.support.trial_files import write_trials

QUICK = ["--seeds", "2", "--epochs", "12", "--width", "8", "--rate", "1e-2", "--penalty", "0.001", "--step", "1"]
LONG = [*QUICK[:2], "--epochs", "3000", "--step", "1"]


def training(folder: Path, out: Path, *more: str) -> list[str]:
    return ["train", "esso_osaka_3m", str(folder / "trials"), *more, "--out", str(out)]


def judged(folder: Path, out: Path) -> list[str]:
    """The training of the fixture ``folder``, into ``out``."""
    return training(folder, out, "--validate", str(folder / "held_out.csv"), *QUICK)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trials of the ship that lacks a force, and the run folder of a training on them."""
    folder = tmp_path_factory.mktemp("train")
    write_trials(folder / "trials", hybrids.trials(hybrids.lacking(), 3, 400))
    write_trial(hybrids.trials(hybrids.lacking(), 1, 300, seed=7)[0], folder / "held_out.csv")
    assert main(judged(folder, folder / "run")) == 0
    return folder


@pytest.mark.slow
def test_the_run_folder_tells_how_it_came_about(folder: Path) -> None:
    content = read_result(folder / "run")
    assert content["kind"] == "training" and content["kept"]
    assert content["seeds"] == [0, 1] and len(content["per_seed"]) == 2
    assert [row["name"] for row in content["data"]] == ["run0", "run1", "run2"]
    assert all(row["sha256"] for row in content["data"]) and content["versions"]["torch"]
    pair = content["scores"]["validation"]
    assert pair["after"]["window"] < pair["before"]["window"]
    for name in ("ship.toml", "network.safetensors", "figures/learning.png", "figures/error_growth.png"):
        assert (folder / "run" / name).is_file()


@pytest.mark.slow
def test_a_hybrid_is_a_ship_with_the_calibrated_one_beside_it(folder: Path) -> None:
    ship, calibrated = load_ship(folder / "run"), load_ship(folder / "run" / "calibrated")
    assert calibrated.network is None and ship.without_network().coefficients == calibrated.coefficients
    assert ship.network is not None and len(ship.network.members) == 2
    bound = read_result(folder / "run")["bound"]
    np.testing.assert_allclose([bound[a] for a in ("du", "dv", "dr")], ship.network.bound)
    models = shown("score", "esso_osaka_3m", folder / "run", folder / "held_out.csv")["models"]
    assert models[str(folder / "run")]["window"] < models["esso_osaka_3m"]["window"]


@pytest.mark.slow
def test_prediction_says_which_share_lies_outside_the_envelope(folder: Path) -> None:
    trial = read_trial(folder / "held_out.csv")
    fast = trial.with_columns(n=3.0 * trial["n"])
    simulator = Simulator(load_ship(folder / "run"))
    known = outside_share(simulator, trial, predict(simulator, trial, 30.0, 30.0)[0])
    beyond = outside_share(simulator, fast, predict(simulator, fast, 30.0, 30.0)[0])
    assert known is not None and beyond is not None and known < 0.25 and beyond > 0.6
    bare = Simulator(load_ship("esso_osaka_3m"))
    assert outside_share(bare, trial, predict(bare, trial, 30.0, 30.0)[0]) is None
    (found,) = mi.predict(folder / "run", [fast])
    assert "outside_training" in {note.code for note in found.notes}


@pytest.fixture(scope="module")
def declined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trials of the ship itself, on which nothing is left to learn, and the run folder of a training on them."""
    folder = tmp_path_factory.mktemp("declined")
    write_trials(folder / "trials", hybrids.trials(hybrids.ship(), 3, 300))
    for out, keep in (("run", "better"), ("always", "always")):
        assert main(training(folder, folder / out, *QUICK[:3], "2", "--step", "1", "--keep", keep)) == 0
    return folder


@pytest.mark.slow
def test_a_declined_residual_is_not_recommended_and_can_still_be_used(folder: Path, declined: Path) -> None:
    run = declined / "run"
    content = read_result(run)
    assert not content["kept"]
    assert (content["recommended"], content["other"]) == ("calibrated", "hybrid")
    assert not (run / "network.safetensors").exists() and load_ship(run).network is None
    assert load_ship(run / "hybrid").network is not None
    models = shown("score", run, run / "hybrid", folder / "held_out.csv")["models"]
    assert len({m["window"] for m in models.values()}) == 2
    assert "<code>hybrid/</code>" in (run / "report.html").read_text()


@pytest.mark.slow
def test_always_recommends_the_hybrid_and_says_that_the_decision_declines_it(declined: Path) -> None:
    run = declined / "always"
    content = read_result(run)
    assert content["kept"] and not content["decision"]["kept"]
    assert (content["recommended"], content["other"]) == ("hybrid", "calibrated")
    assert load_ship(run).network is not None and load_ship(run / "calibrated").network is None
    assert [m["code"] for m in content["messages"] if m["level"] == "notice"] == ["kept_always", "no_wind"]


KEYS = {
    "kind", "schema_version", "created", "command", "ship", "model", "settings", "seed", "seeds", "versions",
    "timings_s", "data", "validation_data", "per_seed", "sigma", "envelope", "outside", "scores", "figures", "warnings",
    "notices", "messages",
}  # fmt: skip
OF_A_HYBRID = {"kept", "recommended", "other", "decision", "bound", "output_scale", "residual_size", "calibration"}


@pytest.mark.slow
def test_the_keys_of_result_json_are_these(folder: Path, tmp_path: Path) -> None:
    content = read_result(folder / "run")
    assert set(content) == KEYS | OF_A_HYBRID and content["schema_version"] == 1
    assert set(content["per_seed"][0]) == {
        "seed", "status", "judged_by_part", "judged_window", "judged_restarts", "judged_runs", "stop_window",
        "training_windows", "learning_rate", "restarts", "seconds", "history",
    }  # fmt: skip
    assert set(content["decision"]) == {
        "kept", "words", "improvement", "spread", "restarts", "restarts_spread", "runs_error",
        "reason", "lowest", "highest", "groups", "past_s",
    }  # fmt: skip
    box = ("--model", "fnn", "--seeds", "1", "--epochs", "2", "--step", "1")
    assert main(training(folder, tmp_path / "box", *box)) == 0
    assert set(read_result(tmp_path / "box")) == KEYS | {"beside"}
    again = read_training(tmp_path / "box")
    assert again.to_dict() == read_result(tmp_path / "box") and again.black_box is not None


@pytest.mark.slow
def test_a_run_folder_is_read_as_the_result_that_was_written(folder: Path, tmp_path: Path) -> None:
    result = read_training(folder / "run")
    assert result.to_dict() == read_result(folder / "run")
    assert result.ship.network is not None and result.hybrid is not None
    table = result.to_pandas()
    assert list(table.index) == [0, 1] and table["window_after"].notna().all()
    assert "<table>" in result._repr_html_()
    result.save(tmp_path / "copy")
    assert load_ship(tmp_path / "copy").network is not None


@pytest.mark.slow
def test_the_command_and_the_function_leave_the_same_folder(folder: Path, tmp_path: Path) -> None:
    settings = TrainSettings(seeds=2, epochs=12, width=8, rate=1e-2, penalty=0.001, step=1.0)
    events: list[Progress] = []
    result = mi.train("esso_osaka_3m", folder / "trials", folder / "held_out.csv", settings, progress=events.append)
    result.save(tmp_path / "run")
    one, other = (read_result(run) for run in (folder / "run", tmp_path / "run"))
    timed = {"created", "command", "timings_s", "per_seed"}
    assert {k: v for k, v in one.items() if k not in timed} == {k: v for k, v in other.items() if k not in timed}
    assert {p.name for p in (folder / "run").iterdir()} - {"training"} == {p.name for p in (tmp_path / "run").iterdir()}
    assert {e.task for e in events} == {"seed 0", "seed 1", "seeds"} and max(e.step for e in events) == 12


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_weights_so_far(folder: Path, tmp_path: Path) -> None:
    code, words, _ = interrupted(training(folder, tmp_path / "run", *LONG), 15.0)
    content = read_result(tmp_path / "run")
    assert code == 130 and "seeds_stopped" in {row["code"] for row in content["messages"]}
    assert {row["status"] for row in content["per_seed"]} == {"stopped"}
    assert all(row["judged_window"]["after"] <= row["judged_window"]["before"] for row in content["per_seed"])
    assert [p.name for p in tmp_path.iterdir()] == ["run"] and "--resume" in words


@pytest.mark.parametrize("wait", [2.0, 6.5])
@pytest.mark.slow
def test_ctrl_c_in_the_first_seconds_leaves_no_process_and_no_traceback(
    wait: float, folder: Path, tmp_path: Path
) -> None:
    code, words, left = interrupted(training(folder, tmp_path / "run", *LONG, "--workers", "2"), wait)
    assert code == 130 and "interrupted" in words and not left
    assert "Traceback" not in words and "resource_tracker" not in words


def resumable(folder: Path, tmp_path: Path) -> tuple[Path, list[str]]:
    """A copy of the finished run from which a seed and the result are missing, as after an end without notice."""
    out = tmp_path / "run"
    shutil.copytree(folder / "run" / "training", out / "training")
    (out / "training" / "seed_1.json").unlink()
    return out, [*judged(folder, out), "--resume"]


@pytest.mark.slow
def test_resume_trains_what_is_missing_and_gives_the_same_weights(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, arguments = resumable(folder, tmp_path)
    assert main(arguments) == 0
    capsys.readouterr()
    one, other = (load_file(run / "network.safetensors") for run in (folder / "run", out))
    assert one.keys() == other.keys() and all((one[k] == other[k]).all() for k in one)
    before, after = (read_result(run)["per_seed"] for run in (folder / "run", out))
    assert all(a[k] == b[k] for a, b in zip(before, after, strict=True) for k in ("history", "judged_runs", "status"))
    assert main(arguments) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: [*a, "--epochs", "5"], "12"),
        (lambda a: [*a, "--model", "fnn"], "--model"),
        (lambda a: [a[0], "kvlcc2_l7", *a[2:]], "ship"),
        (lambda a: [*a[:2], a[4], *a[5:]], "trial"),
        (lambda a: [*a[:3], *a[5:]], "--validate"),
    ],
)
def test_resume_of_something_else_is_one_line(change: Any, words: str, folder: Path, tmp_path: Path) -> None:
    out, arguments = resumable(folder, tmp_path)
    assert words in refusal(*change(arguments))
    assert (out / "training" / "seed_0.json").exists() and not (out / "result.json").exists()


@pytest.mark.slow
def test_a_folder_without_a_training_is_not_resumed(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")  # empty: what a run leaves that was killed at once
    refusal(*training(folder, tmp_path, "--resume"))
    assert (tmp_path / "notes.txt").read_text() == "mine" and not (tmp_path / "result.json").exists()


@pytest.mark.slow
def test_a_time_limit_leaves_a_folder_to_resume(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    arguments = training(folder, out, *QUICK)
    assert main([*arguments, "--time-limit", "0.01"]) == 0
    assert "--resume" in capsys.readouterr().err
    assert {row["status"] for row in read_result(out)["per_seed"]} == {"stopped"}
    assert main([*arguments, "--resume"]) == 0
    assert {row["status"] for row in read_result(out)["per_seed"]} == {"finished"}


@pytest.mark.slow
def test_the_report_says_what_was_decided_can_be_made_again_and_needs_no_figure(folder: Path) -> None:
    page = folder / "run" / "report.html"
    text = page.read_text()
    assert text.index("seed 1") > text.index("<table")
    for words in ("run0", "held_out", "2 training(s)"):
        assert words in text, words
    assert text.count("data:image/png;base64,") == 2
    page.unlink()
    assert main(["report", str(folder / "run"), "--no-imo"]) == 0 and page.read_text() == text
    # trials without positions show no growth of the error, and a figure that failed is none
    content = {**read_result(folder / "run"), "figures": []}
    bare = page_of([("run", folder / "run", content, load_ship(folder / "run"))])
    assert "<figure>" not in bare and "data:image" not in bare


@pytest.mark.slow
def test_the_report_of_a_hybrid_has_the_form_for_imo(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fitting.report.imo_form.DRAWS", 20)
    assert main(["report", str(folder / "run"), "--out", str(tmp_path / "page.html")]) == 0
    text = (tmp_path / "page.html").read_text()
    assert "appendix 6" in text and "starboard" in text
    assert "section 13" not in text


def test_a_torch_that_cannot_be_imported_is_said_before_anything_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(mi.UserError, match="torch"):
        mi.train("esso_osaka_3m", "nowhere")
