"""Long trial files are read in pieces: the same numbers, means of rows where there are too many, little memory; also of
noise and bombs as large as files may be, measured in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from cases.io.files import LARGEST
from cases.io.read import read_trial
from cases.io.text_table import BlockMeans
from cases.io.trial_table import MOST_ROWS
from cases.trial import Trial
from mmg.errors import UserError
from tests.support.peak_memory import PEAK
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


def test_noise_is_averaged_and_a_column_that_is_logged_rarely_is_not_late(
    tmp_path: Path, few: Callable[[int], None]
) -> None:
    truth = columns()
    rng, rare = np.random.default_rng(0), dict(truth)
    rare["u"] = truth["u"] + 0.1 * rng.standard_normal(len(truth["t"]))
    for name in ("x", "y", "psi"):
        rare[name] = np.where(np.arange(len(truth["t"])) % 7 == 0, truth[name], np.nan)
    few(100)
    trial = read_trial(write_csv(tmp_path / "a.csv", rare, rows=None))
    assert len(trial) == 100 and np.isfinite(trial["x"]).all()
    assert np.abs(off(trial, truth, "x")).max() < 0.02 and np.abs(off(trial, truth, "psi")).max() < 0.01
    assert np.std(off(trial, truth, "u")) < 0.06


def test_numbers_for_nothing_are_in_no_mean(tmp_path: Path, few: Callable[[int], None]) -> None:
    truth = columns()
    spoiled = {**truth, "u": np.where(np.arange(1000) % 50 == 0, -999.0, truth["u"])}
    few(250)
    trial = read_trial(write_csv(tmp_path / "a.csv", spoiled, rows=None))
    assert np.abs(off(trial, truth, "u")).max() < 0.01
    assert sum("20 samples hold -999" in notice for notice in trial.notices) == 1
    kept = read_trial(tmp_path / "a.csv", {"sentinels": []})
    assert kept["u"].min() < -200


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


PROGRAM = (
    PEAK
    + """
from cases.io.read import read_trial
trial = read_trial(sys.argv[1])
print(f"{peak_mb():.0f} {len(trial)}")
"""
)


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no measure of the peak")
def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    """Four times the rows need no more memory: 200 MB of text."""
    rows = "".join(f",{k * 1e-3:.5f},0.1,0.30001,0.40001,0.01,0.001,9.0,0.1,5.0,1.0,7,8,9\n" for k in range(1000))
    cells = rows.splitlines()
    head = "t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad],wind_speed [m/s],"
    peaks = []
    for count in (700_000, 2_800_000):
        path = tmp_path / f"{count}.csv"
        with path.open("w") as file:
            file.write(head + "wind_direction [rad],a,b,c\n")
            for start in range(0, count, 1000):
                file.write("\n".join(f"{0.01 * (start + k):.2f}{cells[k]}" for k in range(1000)) + "\n")
        done = subprocess.run([sys.executable, "-c", PROGRAM, str(path)], capture_output=True, text=True, check=True)
        peak, kept = map(int, done.stdout.split())
        assert 300_000 < kept <= 400_000
        peaks.append(peak)
        path.unlink()
    print(peaks)
    assert peaks[1] < peaks[0] + 60 and peaks[1] < 500


LIMIT = 500  # MB
HEAD = b"t [s],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad]\n"
CHECK_OF_ONE = (
    PEAK
    + """
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
)


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


def a_million_texts(path: Path) -> None:
    """Parquet of a few kB in which every row of a column names the same long text."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows, names = 1_000_000, [cell.decode() for cell in HEAD.strip().split(b",")]
    table = pa.table({name: pa.array(np.zeros(rows)) for name in names})
    texts = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int32)), pa.array(["1" * 390]))
    pq.write_table(table.set_column(2, names[2], texts), path, compression="zstd")
    assert path.stat().st_size < 2**20


def many_columns(path: Path) -> None:
    """Parquet of a few MB whose columns unpacked are 8 GB."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    one = pa.array(np.zeros(1_000_000))
    names = [*(cell.decode() for cell in HEAD.strip().split(b",")), *(f"c{k}" for k in range(1000))]
    pq.write_table(pa.table(dict.fromkeys(names, one)), path, compression="zstd")
    assert path.stat().st_size < 2**24


def zipped(path: Path) -> None:
    import zipfile

    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.csv", "w") as file:
        file.write(HEAD)
        for _ in range(2**8):  # in pieces: a child begins with the peak of the process that it leaves
            file.write(b"0" * 2**20)


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
FILES: dict[str, Callable[[Path], object]] = {
    "texts.parquet": a_million_texts, "wide.parquet": many_columns, "zipped.csv": zipped,
    "hole.csv": lambda path: (path.touch(), os.truncate(path, 2**30)),
}  # fmt: skip


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no measure of the peak")
@pytest.mark.parametrize("name", [*MADE, *FILES])
def test_noise_and_bombs_need_little_memory(name: str, tmp_path: Path) -> None:
    path = tmp_path / (name if name in FILES else "noise.csv")
    if name in FILES:
        FILES[name](path)
    else:
        with path.open("wb") as file:
            file.writelines(MADE[name]())
    command = [sys.executable, "-c", CHECK_OF_ONE, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    size, _, words = done.stdout.strip().partition(" ")
    print(f"{name}: {size} MB, {words}")
    path.unlink()
    assert int(size) < LIMIT and words, words
