"""The same command on the same trials writes the same bytes but for times, whatever the threads, workers and order of
hashes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file

from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import write_trials

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]
FEW = "--only X_0F,Y_v,N_r,k_0,gamma_P,Y_A1 --no-next-trial --window 20"
COMMANDS = {
    "fit": f"fit esso_osaka_3m trials {FEW} --starts 2 --bootstrap 3 --workers {{workers}} --out fit",
    "train": "train fit trials --seeds 2 --epochs 2 --width 4 --workers {workers} --out train",
    "fnn": "train fit trials --model fnn --seeds 1 --epochs 1 --width 4 --workers {workers} --out fnn",
    "diagnose": "diagnose fit trials --workers {workers} --out diagnose",
    "compare": "compare --train trials --test hold --seeds 1 --epochs 1 --models calibrated,fnn --workers {workers} "
    "--out compare",
    "report": "report fit --out report.html",
}
TIMES = {"created", "command", "seconds", "rollout_s", "path", "timings", "timings_s", "took_s", "workers"}
"""Keys whose values may differ: times, and what was asked for."""


def run(folder: Path, command: str, threads: int, workers: int = 1, **environment: str) -> None:
    text = command.format(workers=workers).split()
    names = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(threads))
    more = {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": str(threads), **names, **environment}
    code = [sys.executable, "-m", "mmg_ident.commands.main", *text]
    done = subprocess.run(code, cwd=folder, env={**os.environ, **more}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two folders in which all commands were run, by one thread and worker, and by four threads and three workers."""
    made = []
    for threads, workers in ((1, 1), (4, 3)):
        folder = tmp_path_factory.mktemp(f"threads{threads}")
        for place, runs in (("trials", slice(0, 2)), ("hold", slice(2, 3))):
            write_trials(folder / place, coarse_runs()[0][runs])
        for command in COMMANDS.values():
            run(folder, command, threads, workers)
        made.append(folder)
    return made[0], made[1]


def timeless(content: Any) -> Any:
    """What JSON holds but for times."""
    if isinstance(content, dict):
        return {key: timeless(value) for key, value in content.items() if key not in TIMES}
    return [timeless(value) for value in content] if isinstance(content, list) else content


def differing(first: Path, second: Path) -> Iterator[str]:
    """Files of two folders that differ in more than times."""
    names = [{str(path.relative_to(f)) for path in f.rglob("*") if path.is_file()} for f in (first, second)]
    yield from names[0] ^ names[1]
    for name in sorted(names[0] & names[1]):
        a, b = (folder / name for folder in (first, second))
        if a.read_bytes() == b.read_bytes():
            continue
        if a.suffix == ".json":
            same = timeless(json.loads(a.read_text())) == timeless(json.loads(b.read_text()))
        elif a.suffix == ".safetensors" and a.stem != "network":
            p, q = load_file(a), load_file(b)
            same = list(p) == list(q) and all(np.array_equal(p[k], q[k], equal_nan=True) for k in p if k != "times")
        elif a.name == "report.html":
            same = re.sub(r"[\d.−e]+", "#", a.read_text()) == re.sub(r"[\d.−e]+", "#", b.read_text())
        else:
            same = False
        if not same:
            yield name


@pytest.mark.parametrize("place", ["fit", "train", "fnn", "diagnose", "compare"])
def test_a_folder_is_the_same_for_every_number_of_threads_and_workers(place: str, folders: tuple[Path, Path]) -> None:
    assert any((folders[0] / place).iterdir())
    assert list(differing(folders[0] / place, folders[1] / place)) == []


def test_a_page_made_again_has_the_same_bytes(folders: tuple[Path, Path]) -> None:
    first = (folders[0] / "report.html").read_bytes()
    run(folders[0], COMMANDS["report"].replace("report.html", "again.html"), 1)
    assert first == (folders[0] / "again.html").read_bytes()
