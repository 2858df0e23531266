"""Long trial files are read in pieces: the same numbers, means of rows where there are too many, little memory; also of
noise and bombs as large as files may be, measured in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from cases.io.files import LARGEST
from cases.io.read import read_trial
from cases.io.text_table import BlockMeans
from cases.io.trial_table import MOST_ROWS
from cases.trial import Trial
from mmg.errors import UserError
from tests.support.trial_files import motion_columns, write_csv


def columns(seconds: float = 100.0) -> dict[str, np.ndarray]:
    found = motion_columns(seconds)
    found["psi"] = np.angle(np.exp(1j * (found["psi"] + 3.0)))  # wraps
    return found


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Makes a file long that has more rows, and none small."""

    def limit(rows: int) -> None:
        monkeypatch.setattr("cases.io.text_table.MOST_KEPT", rows)
        monkeypatch.setattr("cases.io.text_table.BLOCK", 4000)

    return limit


def off(trial: Trial, truth: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Difference from the ``truth`` at the times of the trial, away from its ends."""
    values, t = truth[name], truth["t"]
    if name == "psi":
        wanted = np.interp(trial.t, t, np.unwrap(values))
        return np.angle(np.exp(1j * (trial[name] - wanted)))[2:-2]
    return (trial[name] - np.interp(trial.t, t, values))[2:-2]


def test_a_file_read_in_pieces_is_that_read_at_once(tmp_path: Path, few: Callable[[int], None]) -> None:
    path = write_csv(tmp_path / "zigzag.csv", columns(), rows=None)
    whole = read_trial(path)
    few(10_000)
    pieces = read_trial(path)
    assert pieces.sha256 == whole.sha256 and pieces.notices == whole.notices
    assert all(np.array_equal(pieces[name], whole[name], equal_nan=True) for name in whole.columns)


def test_means_of_rows_are_late_in_no_column(tmp_path: Path, few: Callable[[int], None]) -> None:
    truth = columns()
    few(250)
    trial = read_trial(write_csv(tmp_path / "a.csv", truth, rows=None))
    assert len(trial) == 250 and np.allclose(np.diff(trial.t), 0.4)
    assert any(getattr(m, "code", "") == "rows_averaged" and "4: 250" in m for m in trial.notices)
    for name, least in {"x": 2e-3, "y": 2e-3, "psi": 5e-4, "u": 5e-3, "r": 2e-3}.items():
        error = off(trial, truth, name)
        assert np.abs(error).max() < least and abs(error.mean()) < least / 5, name


def test_means_are_of_noise_and_of_rare_values_and_of_no_number_for_nothing(
    tmp_path: Path, few: Callable[[int], None]
) -> None:
    truth, rows = columns(), np.arange(1000)
    spoiled = {**truth, "u": truth["u"] + 0.1 * np.random.default_rng(0).standard_normal(1000)}
    spoiled |= {name: np.where(rows % 7 == 0, truth[name], np.nan) for name in ("x", "y", "psi")}
    spoiled["v"] = np.where(rows % 50 == 0, -999.0, truth["v"])
    few(100)
    trial = read_trial(write_csv(tmp_path / "a.csv", spoiled, rows=None))
    assert len(trial) == 100 and np.isfinite(trial["x"]).all()
    for name, least in {"x": 0.02, "psi": 0.01, "v": 0.02}.items():
        assert np.abs(off(trial, truth, name)).max() < least, name
    assert np.std(off(trial, truth, "u")) < 0.06
    assert sum("20 samples hold -999" in notice for notice in trial.notices) == 1
    assert read_trial(tmp_path / "a.csv", {"sentinels": []})["v"].min() < -90


def test_no_mean_is_taken_across_a_gap(tmp_path: Path, few: Callable[[int], None]) -> None:
    truth = columns()
    keep = (truth["t"] < 30.25) | (truth["t"] > 60)
    few(100)
    trial = read_trial(write_csv(tmp_path / "a.csv", {n: v[keep] for n, v in truth.items()}, rows=None))
    assert not ((trial.t > 30.25) & (trial.t < 60)).any() and np.diff(trial.t).max() > 29
    assert np.abs(off(trial, truth, "x")).max() < 5e-3


def test_means_do_not_depend_on_the_pieces() -> None:
    truth = columns()
    found = []
    for size in (1000, 61, 1):
        means = BlockMeans(7, {"psi": 2 * np.pi})
        for start in range(0, 1000, size):
            means.add({name: values[start : start + size] for name, values in truth.items()})
        found.append(means.columns())
    for other in found[1:]:
        assert all(np.allclose(other[name], found[0][name], atol=1e-12) for name in truth)


def test_empty_rows_at_the_end_of_a_long_file_and_an_unknown_unit(tmp_path: Path, few: Callable[[int], None]) -> None:
    few(250)
    path = write_csv(tmp_path / "a.csv", columns(), rows=None)
    last = read_trial(path).t[-1]
    path.write_text("\n".join([path.read_text().rstrip(), "0" + "," * 10, "1" + "," * 10]))  # the clock starts anew
    assert np.abs(read_trial(path).t[-1] - last) < 1.0
    path.write_bytes(path.read_bytes().replace(b"psi [rad]", b"psi [grad]"))
    with pytest.raises(UserError, match="'grad'"):
        read_trial(path)


LIMIT = 500  # MB
PEAK = '''
import sys
from pathlib import Path
def peak_mb():
    """Largest memory of this process [MB]. Linux hands ru_maxrss of the parent on to it, but not VmHWM."""
    status = Path("/proc/self/status")
    if status.is_file():
        return next(int(line.split()[1]) for line in status.open() if line.startswith("VmHWM")) / 1024
    import resource
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
'''
"""Source of ``peak_mb``, for the program of a process of its own."""
HEAD = b"t [s],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad]\n"
CHECK_OF_ONE = """
from pathlib import Path
from cases.checks import check
from cases.io.read import read_trial
from mmg.errors import UserError
try:
    check([read_trial(Path(sys.argv[1]))])
    words = "read"
except UserError as error:
    words = str(error)
print(f"{peak_mb():.0f} {words}")
"""
IMPORT_OF_ONE = """
from pathlib import Path
from cases.importing.import_logs import import_logs
found = import_logs([Path(sys.argv[1])])
assert not found.problems, found.problems
print(f"{peak_mb():.0f} {len(found.runs[0].columns['t'])}")
"""


def filled(head: bytes, block: bytes) -> Iterator[bytes]:
    """As much as a file may hold: the head, and the block over and over."""
    yield head
    for _ in range((LARGEST - len(head)) // len(block)):
        yield block


def cells(letters: bytes) -> bytes:
    """A hundred thousand rows of seven cells of ten of these letters."""
    draw = np.random.default_rng(0).choice(np.frombuffer(letters, np.uint8), (100_000, 77))
    draw[:, 10::11] = ord(",")
    draw[:, -1] = ord("\n")
    return draw.tobytes()


MADE: dict[str, Callable[[], Iterator[bytes]]] = {
    "random bytes": lambda: filled(HEAD, np.random.default_rng(0).bytes(2**24)),
    "random letters": lambda: filled(HEAD, cells(b"abcdefgh123")),
    "random digits": lambda: filled(HEAD, cells(b"0123456789")),
    "commas": lambda: filled(b",".join(b"c%d" % k for k in range(5000)) + b"\n", b"," * 4999 + b"\n"),
    "line ends": lambda: filled(HEAD, b"\r" * 2**20),
    "one line": lambda: filled(HEAD + b'"', b"1,2,3,4,5,6,7," * 2**16),
    "short cells": lambda: filled(HEAD, b",,,,,,\n" * 2**16),
    "rows of good numbers": lambda: iter(
        [HEAD, *(b"%.1f,0.1,0.4,0.01,0.002,9,0.1\n" % (0.1 * k) for k in range(MOST_ROWS))]
    ),
}


def spent(program: str, path: Path, lines: Iterable[bytes]) -> tuple[int, str]:
    """Most memory [MB] of a program of its own that reads a file of these lines, and its words."""
    with path.open("wb") as file:
        file.writelines(lines)
    command = [sys.executable, "-c", PEAK + program, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    path.unlink()
    size, _, words = done.stdout.strip().partition(" ")
    print(f"{path.name}: {size} MB, {words}")
    return int(size), words


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no measure of the peak")
@pytest.mark.parametrize("name", MADE)
def test_noise_and_the_longest_files_need_little_memory(name: str, tmp_path: Path) -> None:
    size, words = spent(CHECK_OF_ONE, tmp_path / "noise.csv", MADE[name]())
    assert size < LIMIT and words


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no measure of the peak")
def test_the_memory_of_an_import_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """Four times the rows, 150 MB of text, need no more memory."""
    k = np.arange(1000)
    motion = np.column_stack([0.3 * np.sin(0.01 * k), 0.05 * np.cos(0.01 * k), 0.01 * k])
    cells = [f"{a:.6f};1.2;{b:.6f};{c:.3f};120.0;5.0;fine\n" for a, b, c in motion]
    head = b"time;heading [rad];surge [m/s];sway [m/s];rot [deg/s];rpm;rudder [deg];mood\n"
    peaks = []
    for count in (600_000, 2_400_000):
        lines = (f"{1.7e9 + 0.05 * i:.2f};{cells[i % 1000]}".encode() for i in range(count))
        size, kept = spent(IMPORT_OF_ONE, tmp_path / f"{count}.csv", chain((head,), lines))
        assert 250_000 < int(kept) <= 400_000
        peaks.append(size)
    assert peaks[1] < 1.3 * peaks[0] and peaks[1] < LIMIT
