"""Pages that are notebooks run from top to bottom: their cells, without Jupyter."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT


def cells(path: Path) -> list[str]:
    """Code of the cells of a page, without their tags."""
    found = re.findall(r"(?ms)^```\{code-cell\} ipython3\n(.*?)^```", path.read_text(encoding="utf-8"))
    return [re.sub(r"(?m)^:.*\n", "", code) for code in found]


NOTEBOOKS = [path for path in PAGES if cells(path)]


def test_the_notebooks_are_known() -> None:
    names = {path.stem for path in NOTEBOOKS}
    assert names == {"tutorial", "own_ship", "mpc", "actuators"}


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_runs_to_its_end(path: Path, tmp_path: Path) -> None:
    code = "\n\n".join(cells(path))
    if "fmpy" in code and find_spec("fmpy") is None:
        pytest.skip("needs fmpy, which the extras dev and docs bring")
    script = tmp_path / f"{path.stem}.py"
    script.write_text(code, encoding="utf-8")
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", f"exec(compile(open({str(script)!r}).read(), 'page', 'exec'), globals())"]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-3000:]
