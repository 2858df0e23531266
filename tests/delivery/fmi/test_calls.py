"""The C code of an FMU by itself: calls in right and wrong orders, saved states, a hundred instances, sanitizers."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from tests.support.c_products import STRICT
from tests.support.fmus import fmu, needs_compiler

SANITIZED = ("-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
HERE = Path(__file__).parent


def exercised(kind: str, version: int, command: list[str], folder: Path) -> int:
    """How many claims did not hold in all calls of an FMU compiled from its sources alone."""
    with zipfile.ZipFile(fmu(kind, version)) as archive:
        archive.extractall(folder, [n for n in archive.namelist() if n.startswith("sources/")])
    program = folder / "exercise"
    files = [str(folder / "sources" / "fmu-main.c"), str(HERE / f"exercise_fmi{version}.c")]
    whole = [
        *command,
        *STRICT,
        "-std=c99",
        "-I",
        str(folder / "sources"),
        *files,
        "-o",
        str(program),
        "-lm",
    ]
    built = subprocess.run(whole, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    run = subprocess.run([str(program)], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    return int(run.stdout.split()[0])


def slow(*values: object) -> object:
    """A case of the slow tests."""
    return pytest.param(*values, marks=pytest.mark.slow)


@needs_compiler
@pytest.mark.parametrize(("kind", "version"), [("plain", 2), ("plain", 3), slow("all", 2), slow("all", 3)])
def test_wrong_calls_are_errors_and_saved_states_are_exact(kind: str, version: int, tmp_path: Path) -> None:
    compiler = "clang" if kind == "plain" and shutil.which("clang") else "gcc"
    if shutil.which(compiler) is None:
        pytest.skip("neither gcc nor clang")
    assert exercised(kind, version, [compiler, *SANITIZED], tmp_path) == 0
