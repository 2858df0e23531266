"""``mmg select``: lists, terms and ship files of generated models; bad input in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from cases.shipfiles.ship_file import load_ship
from mmg_ident.commands.main import main
from tests.support.commands import shown


def test_the_list_has_the_counts_of_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    rows = {row["name"]: row for row in shown("select", "vectwin_3m", "--list")["candidates"]}
    counts = {name: rows[name]["unknowns"] for name in rows if name.startswith(("sm2", "sm3", "sm4"))}
    wanted = {"sm2-order2": 133, "sm3-order2": 193, "sm4-order2": 253, "sm2-order3": 413, "sm3-order3": 613}
    assert wanted.items() <= counts.items()
    assert rows["mmg"]["unknowns"] == len(load_ship("vectwin_3m").free)
    assert main(["select", "vectwin_3m", "--list", "--order", "2"]) == 0
    text = capsys.readouterr().out
    assert "sm2-order2" in text and "order3" not in text


def test_terms_are_printed_with_their_monomials(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["select", "esso_osaka_3m", "--terms", "quadrants-order1"]) == 0
    text = capsys.readouterr().out
    assert "X: 12 terms" in text
    found = shown("select", "esso_osaka_3m", "--terms", "quadrants-order1")
    assert len(found["terms"]) == 36 and found["unknowns"] == 49


def test_a_candidate_is_written_as_a_ship_file_that_is_read(tmp_path: Path) -> None:
    out = tmp_path / "hybrid.toml"
    assert main(["select", "kvlcc2_full", "--write", "sm2-order2", "--out", str(out)]) == 0
    ship = load_ship(out)
    assert ship.components == {"expansion": "smooth_submodels"} and len(ship.monomials) == 74
    assert main(["select", "kvlcc2_full", "--write", "sm2-order2", "--out", str(out)]) == 2
    assert main(["select", "kvlcc2_full", "--write", "sm2-order2", "--hard", "--out", str(out), "--force"]) == 0
    assert load_ship(out).components == {"expansion": "hard_submodels"}
