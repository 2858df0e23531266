"""Completion of a shell, and a line of progress that only a person at a terminal sees."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate, write_trial
from mmg_ident.commands import output
from mmg_ident.commands.main import VERBS, main
from mmg_ident.commands.output import each, narration, progress, working

MMG = "from mmg_ident.commands.main import run; import sys; sys.argv[0] = 'mmg'; run()"


def completed(*given: str) -> list[str]:
    """What a shell would offer for the last of the words that are ``given`` after mmg."""
    words, count = " ".join(("mmg", *given)), str(len(given))
    environment = {**os.environ, "COMP_WORDS": words, "COMP_CWORD": count, "_MMG_COMPLETE": "complete_bash"}
    run = subprocess.run([sys.executable, "-c", MMG], capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr
    return run.stdout.split()


def test_a_shell_completes_verbs_ships_options_and_formats() -> None:
    assert completed("") == list(VERBS)
    assert completed("export", "kvl") == ["kvlcc2_full", "kvlcc2_l7"]
    assert {"c", "casadi"} <= set(completed("export", "esso_osaka_3m", "--format", "c"))


def test_the_script_for_a_shell_is_printed() -> None:
    named = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}  # not the shell that runs the tests
    words = [sys.executable, "-c", MMG, "--show-completion", "bash"]
    run = subprocess.run(words, capture_output=True, text=True, env=named)
    assert run.returncode == 0 and "_mmg_completion" in run.stdout


class Terminal:
    """A stderr that is a terminal, and what was written to it."""

    def __init__(self) -> None:
        self.text = ""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None:
        pass


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    made = Terminal()
    monkeypatch.setattr(output, "sys", SimpleNamespace(stderr=made, argv=["mmg"]))
    return made


def test_progress_is_one_line_that_is_cleared(terminal: Terminal) -> None:
    assert list(each([5, 6], "reading")) == [5, 6]
    with working("exporting"):
        pass
    assert "reading:   1 of 2" in terminal.text and "exporting ..." in terminal.text
    assert "\n" not in terminal.text and terminal.text.endswith("\r\033[K")


def test_progress_is_quiet_for_machines_and_without_a_terminal(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    with narration(for_machines=True):
        assert progress() is None and list(each([1], "reading")) == [1]
        with working("exporting"):
            pass
    assert terminal.text == "" and progress() is not None
    monkeypatch.setattr(terminal, "isatty", lambda: False)
    assert progress() is None and list(each([1], "reading")) == [1] and terminal.text == ""


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
    assert main(words) == 0 and "\r" in terminal.text
    terminal.text = ""
    assert main([*words, "--json"]) == 0
    assert "\r" not in terminal.text and "\033" not in terminal.text
    assert output.progress() is not None
