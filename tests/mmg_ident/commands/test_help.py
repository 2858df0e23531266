"""Help of the verbs, and settings by name: panels, sizes, files and options that went; no prose."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import mmg_ident
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate, write_trial
from fitting.settings import Rules, Settings, Wish
from mmg.errors import BadValue, UnknownName
from mmg_ident.commands import output
from mmg_ident.commands.main import PANELS, VERBS, main
from mmg_ident.commands.output import each, narration, progress, working
from mmg_ident.settings import GONE, checked_settings, given_settings, settings_of
from residual.settings import BlackBoxSettings, TrainSettings
from tests.support.commands import refusal

MOST = 8


def page(capsys: pytest.CaptureFixture[str], *words: str) -> list[str]:
    """Lines of a help page."""
    capsys.readouterr()
    assert main([*words, "--help"]) == 0
    return capsys.readouterr().out.splitlines()


def panels(lines: list[str]) -> dict[str, list[str]]:
    """Title of each panel of a page -> its options, arguments or verbs."""
    found: dict[str, list[str]] = {}
    for line in lines:
        if title := re.match(r"(\w+):$", line):
            found[title[1]] = []
        elif found and (row := re.match(r"  (\S+)", line)):
            found[list(found)[-1]].append(row[1])
    return found


def test_the_first_page_has_every_verb_in_its_panel(capsys: pytest.CaptureFixture[str]) -> None:
    lines = page(capsys)
    found = panels(lines)
    assert {title: found[title] for title in PANELS} == {title: list(verbs) for title, verbs in PANELS.items()}
    assert len(lines) <= 50


@pytest.mark.parametrize("verb", VERBS)
def test_options_stand_in_panels_that_read_at_a_glance(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    lines = page(capsys, verb)
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
