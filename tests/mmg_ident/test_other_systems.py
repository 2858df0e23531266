"""Windows and macOS as far as they can be simulated: no POSIX, spawned workers, cp1252, locked files, names, CRLF."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import unicodedata
from contextlib import nullcontext
from pathlib import Path

import pytest

from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import UserError, check_name
from tests.support.commands import refusal
from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import write_trials

ROOT = Path(__file__).parents[2]
FEW = "--only X_0F,N_r --no-next-trial --measurement none --window 10 --max-iterations 2"
QUICK = (
    "ships", "ships esso_osaka_3m", "effects", "effects bank", "check trials", "check no/such/folder",
    "simulate esso_osaka_3m --maneuver zigzag:20/20 --duration 20 --out zigzag.csv",
    "simulate esso_osaka_3m --maneuver zigzag:20/20 --duration 20 --force --out zigzag.csv",
    "predict esso_osaka_3m trials --window 30 --out predicted",
    f"fit esso_osaka_3m trials {FEW} --out fit",
)  # fmt: skip
SLOW = (
    f"fit esso_osaka_3m trials {FEW} --resume --out fit", "imo esso_osaka_3m", "score fit esso_osaka_3m trials",
    "predict fit trials --window 30 --force --out predicted", "report fit --out page.html",
    "export fit --format c --force --out source",
)  # fmt: skip
"""Commands in one process, one after the other; the second on what the first have made."""
ONE_AFTER_THE_OTHER = """
import json, sys
import mmg_ident
from mmg_ident.commands.main import main
codes = []
for line in sys.argv[1:]:
    try:
        codes.append(main(line.split()))
    except BaseException as error:
        codes.append(f"{type(error).__name__}: {error}")
print(json.dumps(codes), file=open("codes.json", "w"))
"""


def started_as_windows(folder: Path, *words: str) -> subprocess.Popen[bytes]:
    """Python with these words in the ``folder``, without what Windows does not have."""
    here = os.pathsep.join([str(ROOT / "tests/support/as_windows"), str(ROOT)])
    drive = folder.parent / f"{folder.name}_temporary"
    drive.mkdir(exist_ok=True)
    environment = {**os.environ, "PYTHONPATH": here, "PYTHONUTF8": "0", "TMPDIR": str(drive), "MPLBACKEND": "agg"}
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, *words], cwd=folder, env=environment, stdout=pipe, stderr=pipe)


def as_windows(folder: Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    """What it ended with."""
    with started_as_windows(folder, *words) as process:
        outputs = process.communicate()
    return subprocess.CompletedProcess(words, process.returncode, *outputs)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a trial whose name no console of cp1252 knows, its lines ended as on Windows, and its sidecar."""
    place = tmp_path_factory.mktemp("windows")
    (place / "trials").mkdir()
    file = place / "trials" / "Drehkreis_ä_舵.csv"
    write_trial(coarse_runs()[0][0], file)
    file.write_bytes(file.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    (place / "trials" / "trials.toml").write_bytes(b'[all]\r\nkind = "turning"\r\n')
    return place


def ended(folder: Path, lines: tuple[str, ...]) -> str:
    """What the commands print, once it is seen that each ended with its code and none with a traceback."""
    done = as_windows(folder, "-c", ONE_AFTER_THE_OTHER, *lines)
    said, complained = (text.decode("cp1252") for text in (done.stdout, done.stderr))
    assert done.returncode == 0 and "Traceback" not in said + complained, complained
    for line, code in zip(lines, json.loads((folder / "codes.json").read_text()), strict=True):
        right = (2,) if "no/such" in line else (0, 1) if line.startswith("fit") else (0,)  # too few iterations: 1
        assert code in right, (line, code, complained)
    return said


@pytest.fixture(scope="module")
def worked(folder: Path) -> str:
    """What the quick commands print."""
    return ended(folder, QUICK)


@pytest.mark.slow
def test_commands_run_without_posix_with_locked_files_and_a_narrow_console(folder: Path, worked: str) -> None:
    """A file is replaced while none holds it, names that the console does not know are written as escapes."""
    assert "\\u8235" in worked and worked.encode("cp1252")
    assert json.loads((folder / "fit/result.json").read_text())["compiled"] is False
    assert [p.name for p in (folder / "predicted").iterdir()] == ["Drehkreis_ä_舵.csv"]
    assert not list(folder.rglob(".*.part")), "a file that could not be renamed is left"


@pytest.mark.longest
@pytest.mark.slow
def test_what_was_made_without_posix_is_gone_on_with(folder: Path, worked: str) -> None:
    assert worked
    ended(folder, SLOW)
    assert (folder / "page.html").exists() and not list(folder.rglob(".*.part"))


@pytest.mark.longest
@pytest.mark.slow
def test_work_is_spread_over_spawned_processes_without_posix(folder: Path) -> None:
    """fit, train and compare with two workers; each worker is such a Python as well."""
    small = "--seeds 2 --epochs 1 --width 4"
    write_trials(folder / "more", demo_trials(3)[0][1:4])
    lines = (
        f"fit esso_osaka_3m trials {FEW} --bootstrap 2 --workers 2 --out spread/fit",
        f"train esso_osaka_3m more {small} --workers 2 --out spread/train",
        "compare --train more --test trials --models captive,fnn --epochs 1 --fractions 1 --seeds 2 --no-random "
        "--step 1 --workers 2 --out spread/compare",
    )
    for line in lines:
        done = as_windows(folder, "-m", "mmg_ident.commands.main", *line.split())
        assert done.returncode in (0, 1) and b"Traceback" not in done.stderr, done.stderr.decode("cp1252")
        assert (folder / line.split()[-1] / "result.json").exists()


HOLDS = """
import sys, time
from pathlib import Path
from fitting.report.run_folder import reserved
with reserved(Path("held")):
    print("held", flush=True)
    time.sleep(600)
"""
WRITES = """
from pathlib import Path
from fitting.report.run_folder import reserved, write_whole
with reserved(Path("held")):
    for _ in range(2):
        write_whole(Path("held"), lambda folder: (folder / "whole").write_text("written"), replace=True)
"""


@pytest.mark.slow
def test_two_processes_do_not_work_on_one_folder_without_posix(tmp_path: Path) -> None:
    """The lock of msvcrt ends with the process that is killed, and what that process left hinders none."""
    place = tmp_path / "here"
    place.mkdir()
    with started_as_windows(place, "-c", HOLDS) as holder:
        assert holder.stdout and holder.stdout.readline().strip() == b"held"
        refused = as_windows(place, "-c", WRITES)
        holder.kill()
    assert refused.returncode and b"Conflict: " in refused.stderr and b"another process" in refused.stderr
    assert [p.name for p in place.iterdir()] == [".held.lock"]
    (place / ".held.0123abcd").mkdir()
    done = as_windows(place, "-c", WRITES)
    assert done.returncode == 0, done.stderr.decode("cp1252")
    assert [p.name for p in place.iterdir()] == ["held"] and [p.name for p in (place / "held").iterdir()] == ["whole"]


# Names
DEVICES = ("CON", "nul", "Aux", "COM1", "lpt9", "con.first", "PRN .x")
"""On Windows a file NUL.csv is no file: what is written to it is lost. What only begins so is a name."""


@pytest.mark.parametrize(
    ("windows", "names", "said"),
    [
        (False, DEVICES, "device"),
        (True, ("10:30", "why?", "a*b", 'say "x"', "a|b", "<new>"), "Windows"),
        (False, ("10:30", "<new>", "console", "nullity", "COM10", "auxiliary 3", "my CON"), ""),
    ],
)
def test_devices_are_refused_everywhere_and_on_windows_what_its_files_cannot_be_called(
    windows: bool, names: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mmg.errors.WINDOWS", windows)
    for name in names:
        with pytest.raises(UserError, match=said) if said else nullcontext():
            check_name(name, "trial")


@pytest.mark.parametrize(
    "names", [("Run", "run"), ("Überführung", unicodedata.normalize("NFD", "Überführung"))], ids=["case", "accents"]
)
def test_names_that_are_one_file_on_windows_or_macos_are_not_overwritten(
    names: tuple[str, str], tmp_path: Path
) -> None:
    for number, name in enumerate(names):
        write_trials(tmp_path / str(number), [Trial(name, coarse_runs()[0][0].columns)])
    refusal("predict", "esso_osaka_3m", tmp_path / "0", tmp_path / "1", "--window", "30", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
