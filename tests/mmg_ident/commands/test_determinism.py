"""The same bytes whatever the threads, workers and order of hashes; faults of the machine in one line."""

from __future__ import annotations

import errno
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

from cases.simulation.simulate import write_trial
from tests.support.commands import refusal
from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import write_trials

# The same command on the same trials writes the same bytes but for times, whatever the threads, workers and order of
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


# Faults of the machine: a full disk, no temporary folder, no compiler, a jumping clock, one core, the C locale
FEWER = ["--only", "X_0F", "--no-next-trial", "--measurement", "none", "--window", "10", "--max-iterations", "2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder ``trials`` with a short trial whose name is not ASCII."""
    place = tmp_path_factory.mktemp("machine")
    (place / "trials").mkdir()
    write_trial(coarse_runs()[0][0], place / "trials" / "Drehkreis_ä_舵.csv")
    return place


def python(folder: Path, *words: str, before: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """A command in a Python of its own; before: statements that it runs first."""
    program = f"{before}\nimport sys\nfrom mmg_ident.commands.main import main\nsys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", program, *words], cwd=folder, capture_output=True, text=True, encoding="utf-8",
        errors="replace", env={**os.environ, **environment}, check=False,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be chosen")
def test_one_core_without_a_temporary_folder_in_the_c_locale_is_enough(folder: Path) -> None:
    """Also where names are not ASCII."""
    one = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})"
    gone = "import tempfile; tempfile._candidate_tempdir_list = lambda: ['/no/such/folder']"
    given = ("predict", "esso_osaka_3m", "trials", "--window", "30", "--out", "forecast_c")
    made = python(folder, *given, before=f"{one}\n{gone}", LC_ALL="C")
    assert made.returncode == 0, made.stderr
    assert [p.name for p in (folder / "forecast_c").iterdir()] == ["Drehkreis_ä_舵.csv"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the encoding of file names is that of the system")
def test_where_python_may_not_read_utf_8_the_line_says_how(folder: Path) -> None:
    made = python(folder, "check", "trials", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert made.returncode == 2 and len(made.stderr.strip().splitlines()) == 1 and "PYTHONUTF8=1" in made.stderr


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_nothing_is_left(folder: Path) -> None:
    """RLIMIT_FSIZE makes every write beyond it fail, as a full disk does."""
    pytest.importorskip("resource")
    small = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))"
    before = sorted(p.name for p in folder.iterdir())
    made = python(folder, "predict", "esso_osaka_3m", "trials", "--window", "30", "--out", "full", before=small)
    assert made.returncode == 2 and len(made.stderr.strip().splitlines()) == 1 and "written" in made.stderr
    assert sorted(p.name for p in folder.iterdir()) == before


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux")
@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("ulimit -v 600000; $MMG fit esso_osaka_3m trials --out out", "586"),
        ("$MMG ships > /dev/full", os.strerror(errno.ENOSPC)),
        ("$MMG simulate esso_osaka_3m --maneuver turning:35 --out $(printf 'a%.0s' $(seq 300)).csv", "a" * 50),
        ("$MMG predict esso_osaka_3m trials --out /proc/1/x", "/proc/1/"),
    ],
)
def test_faults_of_the_machine_are_one_line(command: str, said: str, folder: Path) -> None:
    environment = {**os.environ, "MMG": f"{sys.executable} -m mmg_ident.commands.main", "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONUNBUFFERED", None)  # as for most people: what is printed waits until the end
    before = sorted(folder.iterdir())
    done = subprocess.run(["sh", "-c", command], cwd=folder, env=environment, capture_output=True, text=True)
    lines = done.stderr.strip().splitlines()
    assert done.returncode == 2 and len(lines) == 1 and said in lines[0], done
    assert sorted(folder.iterdir()) == before


@pytest.mark.slow
def test_without_a_compiler_the_fit_goes_on_and_says_so(folder: Path) -> None:
    made = python(folder, "fit", "esso_osaka_3m", "trials", *FEWER, "--out", "slow", MMG_CC="/no/such/compiler")
    assert made.returncode == 1 and "compiled" in made.stderr  # two iterations do not suffice
    assert (folder / "slow" / "result.json").exists() and "Glyph" not in made.stderr


@pytest.mark.slow
def test_a_clock_that_jumps_changes_nothing(folder: Path) -> None:
    """Durations are by clocks that never jump: a wall clock that goes back a year ends nothing early."""
    jumps = "import itertools, time; back = itertools.count(); time.time = lambda: 1e9 - 3e7 * next(back)"
    made = python(
        folder, "fit", "esso_osaka_3m", "trials", *FEWER, "--time-limit", "300", "--json", "--out", "jump", before=jumps
    )
    found = json.loads(made.stdout)
    assert found["status"] == "Maximum_Iterations_Exceeded" and found["timings_s"]["wall"] > 0


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_one_line(folder: Path) -> None:
    locked = folder / "locked"
    locked.mkdir(mode=0o500)
    refusal("predict", "esso_osaka_3m", folder / "trials", "--out", locked / "made")
