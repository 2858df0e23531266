"""Faults of the machine: a full disk, no temporary folder, no compiler, a jumping clock, one core, the C locale."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cases.simulation.simulate import write_trial
from tests.support.commands import refusal
from tests.support.synthetic_runs import coarse_runs

ROOT = Path(__file__).parents[3]
FEW = ["--only", "X_0F", "--no-next-trial", "--measurement", "none", "--window", "10", "--max-iterations", "2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder ``trials`` with a short trial whose name is not ASCII."""
    place = tmp_path_factory.mktemp("machine")
    (place / "trials").mkdir()
    write_trial(coarse_runs()[0][0], place / "trials" / "Drehkreis_ä_舵.csv")
    return place


def run(folder: Path, *words: str, before: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
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
    made = run(folder, *given, before=f"{one}\n{gone}", LC_ALL="C")
    assert made.returncode == 0, made.stderr
    assert [p.name for p in (folder / "forecast_c").iterdir()] == ["Drehkreis_ä_舵.csv"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the encoding of file names is that of the system")
def test_where_python_may_not_read_utf_8_the_line_says_how(folder: Path) -> None:
    made = run(folder, "check", "trials", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert made.returncode == 2 and len(made.stderr.strip().splitlines()) == 1 and "PYTHONUTF8=1" in made.stderr


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_nothing_is_left(folder: Path) -> None:
    """RLIMIT_FSIZE makes every write beyond it fail, as a full disk does."""
    pytest.importorskip("resource")
    small = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))"
    before = sorted(p.name for p in folder.iterdir())
    made = run(folder, "predict", "esso_osaka_3m", "trials", "--window", "30", "--out", "full", before=small)
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
    made = run(folder, "fit", "esso_osaka_3m", "trials", *FEW, "--out", "slow", MMG_CC="/no/such/compiler")
    assert made.returncode == 1 and "compiled" in made.stderr  # two iterations do not suffice
    assert (folder / "slow" / "result.json").exists() and "Glyph" not in made.stderr


@pytest.mark.slow
def test_a_clock_that_jumps_changes_nothing(folder: Path) -> None:
    """Durations are by clocks that never jump: a wall clock that goes back a year ends nothing early."""
    jumps = "import itertools, time; back = itertools.count(); time.time = lambda: 1e9 - 3e7 * next(back)"
    made = run(
        folder, "fit", "esso_osaka_3m", "trials", *FEW, "--time-limit", "300", "--json", "--out", "jump", before=jumps
    )
    found = json.loads(made.stdout)
    assert found["status"] == "Maximum_Iterations_Exceeded" and found["timings_s"]["wall"] > 0


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_one_line(folder: Path) -> None:
    locked = folder / "locked"
    locked.mkdir(mode=0o500)
    refusal("predict", "esso_osaka_3m", folder / "trials", "--out", locked / "made")
