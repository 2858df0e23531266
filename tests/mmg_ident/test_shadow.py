"""Another package named mmg is met with one clear line; ours is found wherever it is installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from mmg_ident import shadowing_mmg

ROOT = Path(__file__).parents[2]


def run(code: list[str], folder: Path, first: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(first), str(ROOT)])}
    return subprocess.run([sys.executable, *code], cwd=folder, env=environment, capture_output=True, text=True)


def test_our_own_package_is_not_in_the_way() -> None:
    assert shadowing_mmg() == ""


def test_another_mmg_before_ours_stops_every_command_in_one_line(tmp_path: Path) -> None:
    other = tmp_path / "site" / "mmg"
    other.mkdir(parents=True)
    (other / "__init__.py").write_text("raise SystemExit('the other package was executed')\n")
    done = run(["-m", "mmg_ident", "ships"], tmp_path, tmp_path / "site")
    assert done.returncode == 2 and done.stdout == ""
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("mmg: ") and str(other) in line
