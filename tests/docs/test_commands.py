"""What README and docs say to type works, and prints the figures that the page shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mmg_ident.commands.main import VERBS, main
from tests.docs.pages import PAGES, ROOT, Command, arguments, blocks, commands, make_workspace, missing
from tests.support.figures import unrendered

PUBLIC_DATA = ("compare",)
"""Verbs that need the public records, which are tested where these are."""
OWN_TRIALS = ("effects.md",)
"""Pages that make the trials that they use."""


def run_page(path: Path, folder: Path, chosen: list[Command], capsys: pytest.CaptureFixture[str]) -> None:
    """Run the ``chosen`` commands of a page in the working ``folder``; each must work and print what it says."""
    make_workspace(folder, path.name not in OWN_TRIALS)
    for command in chosen:
        words = arguments(command)
        if words[0] in PUBLIC_DATA:
            continue
        refused = any(line.startswith("mmg: ") for line in command.shown)
        capsys.readouterr()
        code = main(words)
        out, err = capsys.readouterr()
        assert code == (2 if refused else 0) or (words[0] == "fit" and code == 1), (words, err)
        assert not missing(command.shown, err + out), (words, err + out)


def test_the_first_commands_of_the_readme_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    first = commands(ROOT / "README.md")[:3]
    assert [c.words[0] for c in first] == ["import", "check", "ships"]
    run_page(ROOT / "README.md", tmp_path, first, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("path", [p for p in PAGES if commands(p)], ids=lambda p: p.name)
def test_the_commands_of_a_page_work_and_print_what_it_shows(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run_page(path, tmp_path, commands(path), capsys)


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.name)
def test_every_option_that_a_page_names_exists(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inline = re.findall(r"`(mmg [^`]+)`", re.sub(r"(?ms)^```.*?^```", "", path.read_text()))
    for text in inline:
        words = text.split()[1:]
        if not words[0].islower() or words[0] == "select":
            continue
        verb = words[0].rstrip(",.")
        capsys.readouterr()
        if verb.startswith("--"):
            assert main(["--help"]) == 0
        else:
            assert verb in VERBS, text
            assert main([verb, "--help"]) == 0
        page = capsys.readouterr().out
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text):
            assert option in page or option == "--help", text


@pytest.mark.slow
def test_python_of_the_readme_uses_one_import_and_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_workspace(tmp_path)
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(ROOT / "README.md", "python")
    assert re.findall(r"^(?:import|from) .*", code, re.MULTILINE) == ["import mmg_ident as mi"]
    with unrendered():
        exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "runs" / "notebook" / "report.html").exists()
    after, before = map(float, capsys.readouterr().out.splitlines()[1].split())
    assert after < before
