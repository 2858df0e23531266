"""The example of docs/how-to/fmu.md steers a ship, and its system description is one that libcosim takes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mmg_ident.commands.main import main
from tests.docs.pages import ROOT, blocks
from tests.support.fmus import needs_compiler

PAGE = ROOT / "docs" / "how-to" / "fmu.md"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the FMU of the page's first command, in which the tests work."""
    (command,) = (line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("mmg export"))
    folder = tmp_path_factory.mktemp("example")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(command.split()[1:]) == 0
        yield folder


@needs_compiler
def test_the_course_keeper_of_the_page_keeps_its_course(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("fmpy")
    (code,) = blocks(PAGE, "python")
    exec(compile(code, str(PAGE), "exec"), {})
    words = capsys.readouterr().out.split()
    assert words[0] == "heading" and abs(float(words[1]) - 0.5) < 0.02


@needs_compiler
def test_libcosim_takes_the_system_of_the_page(exported: Path) -> None:
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution

    (text,) = blocks(PAGE, "xml")
    text = text.replace("wind.fmu", "ship.fmu").replace('name="true_wind"', 'name="velocity"')
    (exported / "OspSystemStructure.xml").write_text(text, encoding="utf-8")
    assert CosimExecution.from_osp_config_file(str(exported)).step(10)


def test_bad_requests_are_one_line_and_leave_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    base = ["export", "esso_osaka_3m", "--format", "fmu"]
    (tmp_path / "there.fmu").write_text("mine")
    for words, said in (
        ([*base, "--out", "ship.fmu"], "--force"),
        ([*base, "--out", "there.fmu", "--force", "--platforms", "amiga"], "amiga"),
        ([*base, "--out", "ship.zip", "--force"], ".fmu"),
        (["export", "esso_osaka_3m", "--format", "c", "--out", "c", "--force", "--platforms", "win64"], "--platforms"),
    ):
        capsys.readouterr()
        assert main(words) == 2
        err = capsys.readouterr().err.strip()
        assert said in err and "\n" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["there.fmu"]
    assert (tmp_path / "there.fmu").read_text() == "mine"
