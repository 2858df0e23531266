"""The command line: exit codes, one clear line for bad input, nothing half-written, resume, help, settings by name."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import mmg_ident
import mmg_ident.commands.main
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import simulate, write_trial
from fitting.settings import Rules, Settings, Wish
from fitting.solvers.control import INTERRUPTED, OBSERVER, interrupts_noted
from mmg.errors import BadValue, UnknownName
from mmg_ident.commands import output
from mmg_ident.commands.main import PANELS, VERBS, expand, main
from mmg_ident.commands.output import each, narration, progress, working
from mmg_ident.settings import GONE, checked_settings, given_settings, settings_of
from residual.settings import BlackBoxSettings, TrainSettings
from tests.support import calibrated
from tests.support.commands import printed, refusal, shown
from tests.support.synthetic_runs import coarse_runs, points, runs, write_points
from tests.support.trial_files import motion_columns, write_csv, write_trials

# The command line: exit codes, one clear line for bad input, nothing half-written, resume
pytestmark = pytest.mark.usefixtures("blank_figures")
FREE = ",".join(calibrated.FREE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two training trials, one held-out trial and a finished run."""
    folder = tmp_path_factory.mktemp("cli")
    train, held_out = coarse_runs()
    write_trials(folder / "train", train[:2])
    write_trial(held_out[0], folder / "held_out.csv")
    assert main(fit(folder, folder / "run", "--validate", folder / "held_out.csv")) == 0
    return folder


def fit(folder: Path, out: Path, *more: str | Path) -> list[str]:
    """A calibration on the training trials into the run folder ``out``, without advice on the next trial: of FREE,
    unless ``more`` words say of what."""
    only = () if "--only" in more else ("--only", FREE)
    given = ["fit", "esso_osaka_3m", folder / "train", *only, "--no-next-trial", "--out", out, *more]
    return [str(word) for word in given]


def result_of(run: Path) -> dict[str, Any]:
    return json.loads((run / "result.json").read_text())


@pytest.mark.slow
def test_names_of_trials_are_no_paths(folder: Path, tmp_path: Path) -> None:
    """A sidecar cannot name a file above --out, nor anywhere else."""
    for name in ("../../evil", str(tmp_path / "evil")):
        trials = tmp_path / "trials"
        trials.mkdir(exist_ok=True)
        (trials / "a.csv").write_bytes((folder / "held_out.csv").read_bytes())
        (trials / "trials.toml").write_text(f"[files.'a.csv']\nname = '{name}'\n")
        line = refusal("predict", "esso_osaka_3m", trials, "--out", tmp_path / "out" / "deep")
        assert "trials.toml" in line
    assert not list(tmp_path.rglob("evil*")) and not (tmp_path / "out").exists()


def test_options_that_take_several_values_are_expanded() -> None:
    given = expand(["fit", "ship", "a.csv", "--validate", "b.csv", "c.csv", "--out", "run"])
    assert given == ["fit", "ship", "a.csv", "--validate", "b.csv", "--validate", "c.csv", "--out", "run"]
    assert expand(["fit", "--validate", "--out", "run"]) == ["fit", "--validate"]  # what is missing ends the line


def test_the_bare_command_prints_the_help_and_another_the_version() -> None:
    assert printed() == printed("--help")
    assert printed("--version").split() == ["mmg-ident", mmg_ident.__version__]


@pytest.mark.slow
def test_a_run_folder_is_complete(folder: Path) -> None:
    run = folder / "run"
    content = result_of(run)
    for name in ("ship.toml", "start.toml", "result.json", "iterate.safetensors", "report.html"):
        assert (run / name).stat().st_size > 0
    assert content["converged"] and content["status"] == "Solve_Succeeded"
    assert {*FREE.split(",")} <= {*content["coefficients"]} and content["versions"]["casadi"]
    assert all(len(row["sha256"]) == 64 for row in content["data"])
    assert content["scores"]["validation"]["after"]["window"] < content["scores"]["validation"]["before"]["window"]
    assert content["figures"] and all((run / "figures" / f["file"]).exists() or (run / f["file"]).exists()
                                      for f in content["figures"])  # fmt: skip
    assert not [p for p in folder.iterdir() if p.name.startswith(".")]


@pytest.mark.slow
def test_predictions_follow_the_contract(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "forecast.csv"
    arguments = ["predict", str(folder / "run"), str(folder / "held_out.csv"), "--window", "30", "--stride", "15"]
    assert main([*arguments, "--out", str(out)]) == 0
    header, *rows = out.read_text().splitlines()
    bare = "window,t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s]"
    assert header == bare + ",x_std [m],y_std [m],psi_std [rad],u_std [m/s],v_std [m/s],r_std [rad/s]"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    windows = table[:, 0].astype(int)
    assert (np.bincount(windows) == 61).all()
    assert windows.max() == 7  # 140 s: windows start at 0, 15, ..., 105 s
    assert main([*arguments, "--out", str(out)]) == 2  # never overwritten without being asked
    assert main(["predict", "esso_osaka_3m", str(folder / "train"), "--window", "0", "--out", str(tmp_path / "d")]) == 0
    files = list((tmp_path / "d").glob("*.csv"))
    assert len(files) == 2 and all(file.read_text().splitlines()[0] == bare for file in files)


@pytest.mark.slow
def test_scores_of_several_models_come_side_by_side(folder: Path) -> None:
    arguments = ["score", "esso_osaka_3m", str(folder / "run"), str(folder / "held_out.csv")]
    data = shown(*arguments)["models"]
    before, after = data["esso_osaka_3m"], data[str(folder / "run")]
    assert before["sigma"] == after["sigma"] and set(before["sigma"]) == {"x", "y", "psi", "u", "v", "r"}
    other = shown(*arguments, "--sigma", "1,1,1,1,1,1")["models"]["esso_osaka_3m"]
    assert set(other["sigma"].values()) == {1.0} and other["sigma_from"] == "--sigma"


@pytest.mark.slow
def test_an_iteration_limit_exits_1_and_resume_finishes(folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    arguments = fit(folder, run)
    assert main([*arguments, "--max-iterations", "2"]) == 1
    before = result_of(run)
    assert not before["converged"] and "NOT CONVERGED" in (run / "ship.toml").read_text()
    assert "--per-run" in refusal(*arguments, "--per-run", "current", "--resume")
    assert main([*arguments, "--resume"]) == 0
    after = result_of(run)
    assert after["converged"] and after["objective"] != before["objective"]
    for symbol, row in result_of(folder / "run")["coefficients"].items():
        assert all(after["coefficients"][symbol][key] == row[key] for key in ("prior_value", "prior_std"))
    assert main([*arguments, "--resume"]) == 0  # already converged: nothing to do


def raising(error: Exception) -> Callable[..., None]:
    """A function that raises the ``error``."""
    return Mock(side_effect=error)


def test_what_memory_does_not_hold_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mmg_ident.commands.main, "app", raising(MemoryError()))
    refusal("ships")


def test_what_a_library_makes_of_ctrl_c_is_an_interruption(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An import that is broken off may end in an error of its own."""

    pressed: list[int] = []
    monkeypatch.setattr(mmg_ident.commands.main, "app", raising(RuntimeError("could not be imported")))
    monkeypatch.setattr(mmg_ident.commands.main, "interruptions", pressed)
    with pytest.raises(RuntimeError):
        main(["ships"])
    with pytest.raises(KeyboardInterrupt):
        mmg_ident.commands.main.note_interruption(signal.SIGINT, None)
    assert main(["ships"]) == 130 and capsys.readouterr().err == "mmg: interrupted\n"


def test_a_ctrl_c_that_a_library_swallowed_is_raised_before_anything_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """A training went on without end: the exception was lost while torch was imported."""
    monkeypatch.setattr(mmg_ident.commands.main, "interruptions", [1])
    monkeypatch.setattr(OBSERVER, "told", mmg_ident.commands.main.observe)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), interrupts_noted():
        pytest.fail("held")
    assert signal.getsignal(signal.SIGINT) is before and not INTERRUPTED.active
    monkeypatch.setattr(mmg_ident.commands.main, "interruptions", [])
    with interrupts_noted():
        assert INTERRUPTED.active


@pytest.mark.slow
def test_rows_on_both_sides_of_a_split_are_said(folder: Path, tmp_path: Path) -> None:
    one = sorted((folder / "train").glob("*.csv"))[0]
    main(fit(folder, tmp_path / "run", "--validate", one, "--max-iterations", "1"))
    assert "not_held_out" in {row["code"] for row in result_of(tmp_path / "run")["messages"]}


@pytest.mark.slow
def test_a_readable_file_is_checked_even_when_another_is_broken(folder: Path, tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    broken = tmp_path / "broken.csv"
    broken.write_text("nonsense")
    capsys.readouterr()
    assert main(["check", str(broken), str(folder / "held_out.csv"), "--json"]) == 2
    out, err = capsys.readouterr()
    verdicts = {f["name"]: f["verdict"] for f in json.loads(out)["files"]}
    assert verdicts["broken"] == "contradictory" and verdicts["held_out"] == "ok" and len(err.splitlines()) == 1


@pytest.mark.parametrize("verb", ["check", "fit"])
def test_all_problems_of_a_folder_stand_in_one_table(verb: str, tmp_path: Path, capsys, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setenv("COLUMNS", "400")
    good = motion_columns(60.0)
    (tmp_path / "set").mkdir()
    write_csv(tmp_path / "set" / "good.csv", good, rows=None)
    write_csv(tmp_path / "set" / "short.csv", {name: column[:1] for name, column in good.items()}, rows=None)
    rows = (tmp_path / "set" / "good.csv").read_text().splitlines()
    rows[5] = "abc" + rows[5][rows[5].index(",") :]
    (tmp_path / "set" / "text.csv").write_text("\n".join(rows))
    given = [verb, *(["esso_osaka_3m", "--out", str(tmp_path / "run")] if verb == "fit" else []), str(tmp_path / "set")]
    assert main(given) == 2
    heads, short, text, *_, last = capsys.readouterr().err.splitlines()
    place, problem = heads.index("place"), heads.index("problem")
    assert short.startswith("short.csv") and not short[place:problem].strip() and short[problem:]
    assert text.startswith("text.csv") and "row 5" in text[place:problem] and "abc" in text[problem:]
    assert "2 of 3" in last
    assert main([*given, "--json"]) == 2 and len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.slow
def test_a_run_of_another_schema_is_refused_with_key_and_version(folder: Path, tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    content = result_of(folder / "run")
    (tmp_path / "ship.toml").write_bytes((folder / "run" / "ship.toml").read_bytes())
    (tmp_path / "result.json").write_text(json.dumps(content | {"schema_version": 2}))
    for words in (["predict", tmp_path, folder / "train", "--out", tmp_path / "p"], ["report", tmp_path]):
        line = refusal(*words)
        assert "result.json" in line and "schema_version = 2" in line


# ``mmg fit`` with a robust loss and captive points, from files to result.json and report
UNITS = "u [m/s],v [m/s],r [rad/s],n [rps],delta [deg],X [N],Y [N],N [N m]"


@pytest.mark.slow
def test_captive_points_and_a_robust_loss_go_into_the_run(tmp_path: Path) -> None:
    """The first 80 s of three training trials with positions, and captive points of the same ship."""
    write_trials(tmp_path / "train", [trial[:80.0] for trial in runs()[0][:3]])
    write_points(tmp_path / "tank.csv", UNITS, points(hidden_ship(), 1.0))
    captive = ("--captive", tmp_path / "tank.csv", "--captive-sigma", "0.5,0.5,0.3")
    assert main(fit(tmp_path, tmp_path / "run", *captive, "--loss", "student", "--starts", "2")) == 0
    result = result_of(tmp_path / "run")
    assert result["settings"]["loss"] == "student" and 1 <= result["condition_number"] < 1e12
    assert len(result["starts"]) == 2 and result["starts"][1]["apart"] == {}


# Help of the verbs, and settings by name: panels, sizes, files and options that went; no prose
MOST = 8


def page(*words: str) -> list[str]:
    """Lines of a help page."""
    return printed(*words, "--help").splitlines()


def panels(lines: list[str]) -> dict[str, list[str]]:
    """Title of each panel of a page -> its options, arguments or verbs."""
    found: dict[str, list[str]] = {}
    for line in lines:
        if title := re.match(r"(\w+):$", line):
            found[title[1]] = []
        elif found and (row := re.match(r"  (\S+)", line)):
            found[list(found)[-1]].append(row[1])
    return found


def test_the_first_page_has_every_verb_in_its_panel() -> None:
    lines = page()
    found = panels(lines)
    assert {title: found[title] for title in PANELS} == {title: list(verbs) for title, verbs in PANELS.items()}
    assert len(lines) <= 50


@pytest.mark.parametrize("verb", VERBS)
def test_options_stand_in_panels_that_read_at_a_glance(verb: str) -> None:
    lines = page(verb)
    found = panels(lines)
    assert "\n".join(lines).encode("cp1252")  # on every console of Windows
    assert all(len(rows) <= MOST for rows in found.values()) and len(lines) <= 60
    assert all(len(line) <= 80 for line in lines) and any("Example:" in line for line in lines)
    options = [row for title, rows in found.items() if title != "Arguments" for row in rows]
    assert len(options) == len(set(options)) and all(row.startswith("--") for row in options)


@pytest.mark.parametrize("kind", [Settings, Rules, Wish, BlackBoxSettings])
def test_every_default_lies_within_its_limits(kind: type) -> None:
    values = {name: field.default for name, field in settings_of(kind).items()}
    assert checked_settings(kind, values) == values


def test_an_option_wins_over_the_file(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text("tolerance = 1e-5\nwindow = 20\nsigma = [1, 1, 0.1, 1, 1, 1]\n")
    found = given_settings(Settings, {"window": 30.0}, file)
    assert found == {"tolerance": 1e-5, "window": 30.0, "sigma": (1, 1, 0.1, 1, 1, 1)}


def test_numbers_in_a_list_of_lists_are_read_from_a_file_and_keep_the_limits(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text("curriculum = [[10, 0.5], [30.0, 0.5]]")
    assert given_settings(TrainSettings, {}, file) == {"curriculum": ((10.0, 0.5), (30.0, 0.5))}
    for value in ((), [], 3, [3], [[10.0]], [[10.0, 1.0, 1.0]], ((-10, 1),), ((10, 0),), [["a", 1]]):
        with pytest.raises(BadValue) as found:
            checked_settings(TrainSettings, {"curriculum": value})
        assert str(found.value).count("curriculum") == 1


def test_members_is_another_name_of_the_seeds_of_an_ensemble() -> None:
    assert "--seeds 0" in refusal("train", "ship", "trials", "--members", "0", "--out", "run")


@pytest.mark.parametrize("text", ["windw = 3", "window = '3'", "starts = 1.5", "loss = 'auto'", "interval = 0", "a ="])
def test_a_settings_file_with_a_fault_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "settings.toml").write_text(text)
    refusal("fit", "esso_osaka_3m", ".", "--settings", tmp_path / "settings.toml", "--out", tmp_path / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["settings.toml"]


def test_only_files_that_are_there_are_named(tmp_path: Path) -> None:
    (tmp_path / "ship.toml").touch()
    assert output.those_in(tmp_path, "ship.toml report.html") == "ship.toml"


@pytest.mark.parametrize("gone", GONE, ids=str)
def test_what_went_says_so_on_the_line_and_in_python(gone: str | tuple[str, str]) -> None:
    name, value = (gone, "1") if isinstance(gone, str) else gone
    assert (
        refusal("fit", "ship", "trials", f"--{name.replace('_', '-')}", value, "--out", "run") == f"mmg: {GONE[gone]}"
    )
    with pytest.raises(UnknownName):
        mmg_ident.calibrate("esso_osaka_3m", [], **{name: value})


def test_an_option_that_is_a_key_now_says_so() -> None:
    line = refusal("fit", "ship", "trials", "--tolerance", "1e-5", "--out", "run")
    assert "--settings" in line and "tolerance" in line


# Completion of a shell, and a line of progress that only a person at a terminal sees
MMG = "from mmg_ident.commands.main import run; import sys; sys.argv[0] = 'mmg'; run()"


def completed(*given: str) -> list[str]:
    """What a shell would offer for the last of the words that are ``given`` after mmg."""
    words, count = " ".join(("mmg", *given)), str(len(given))
    environment = {**os.environ, "COMP_WORDS": words, "COMP_CWORD": count, "_MMG_COMPLETE": "complete_bash"}
    run = subprocess.run([sys.executable, "-c", MMG], capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr
    return run.stdout.split()


@pytest.mark.slow
def test_a_shell_completes_verbs_ships_options_and_formats() -> None:
    assert completed("") == list(VERBS)
    assert completed("export", "kvl") == ["kvlcc2_full", "kvlcc2_l7"]
    assert {"c", "casadi"} <= set(completed("export", "esso_osaka_3m", "--format", "c"))


class Terminal(io.StringIO):
    """A stderr that is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    made = Terminal()
    monkeypatch.setattr(output, "sys", SimpleNamespace(stderr=made, argv=["mmg"]))
    return made


def test_progress_is_one_line_that_is_cleared_and_quiet_for_machines_and_without_a_terminal(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work() -> str:
        terminal.truncate(0)
        assert list(each([5, 6], "reading")) == [5, 6]
        with working("exporting"):
            pass
        return terminal.getvalue()

    text = work()
    assert "reading:   1 of 2" in text and "exporting ..." in text and "\n" not in text and text.endswith("\r\033[K")
    with narration(for_machines=True):
        assert progress() is None and work() == ""
    assert progress() is not None
    monkeypatch.setattr(terminal, "isatty", lambda: False)
    assert progress() is None and work() == ""


@pytest.mark.parametrize(
    "words",
    [
        ["check", "run.csv"],
        ["simulate", "esso_osaka_3m", "--maneuver", "turning:35", "--duration", "20"],
        ["simulate", "kvlcc2_l7", "--maneuver", "turning:35", "--duration", "20", "--scatter", "20"],
        ["score", "esso_osaka_3m", "run.csv"],
        ["predict", "esso_osaka_3m", "run.csv", "--out", "p.csv", "--force"],
        ["export", "esso_osaka_3m", "--force", "--format", "toml", "--out", "ship.toml"],
    ],
    ids=lambda words: words[0],
)
def test_long_verbs_show_progress_on_a_terminal_and_none_with_json(
    words: list[str], terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ship = load_ship("esso_osaka_3m")
    write_trial(simulate(ship, parse_maneuver("zigzag:20/20", ship, duration=40.0), 0.5), tmp_path / "run.csv")
    assert main(words) == 0 and "\r" in terminal.getvalue()
    terminal.truncate(0)
    assert main([*words, "--json"]) == 0
    assert "\r" not in terminal.getvalue() and "\033" not in terminal.getvalue()
    assert output.progress() is not None
