"""The blocks of the page on refits, optimisers and samplers run, those on what is not installed are skipped."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from tests.docs.pages import ROOT, blocks, make_workspace

BLOCKS = blocks(ROOT / "docs" / "how-to" / "optimisers.md", "python")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Names that the first block, and the first on SciPy, leave for all others."""
    folder = tmp_path_factory.mktemp("page")
    make_workspace(folder)
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(Path(folder))
        for code in BLOCKS[:4]:
            exec(compile(code, "optimisers.md", "exec"), names)
    return names


@pytest.mark.slow
@pytest.mark.parametrize("code", BLOCKS[4:], ids=lambda code: code.split("\n")[0].split()[1].rstrip(","))
def test_other_optimisers_and_samplers_work_on_the_objective(code: str, session: dict[str, Any]) -> None:
    for package in re.findall(r"(?m)^(?:from|import) (\w+)", code):
        pytest.importorskip(package, reason=f"needs {package}, which is not required")
    exec(compile(code, "optimisers.md", "exec"), session)
