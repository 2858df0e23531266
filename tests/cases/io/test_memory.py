"""Noise and bombs as large as files may be need less than 500 MB of memory, measured in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from cases.io.files import LARGEST
from cases.io.trial_table import MOST_ROWS
from tests.support.peak_memory import PEAK

LIMIT = 500
"""MB."""
HEAD = b"t [s],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad]\n"
PROGRAM = (
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


def a_hole(path: Path) -> None:
    path.touch()
    os.truncate(path, 2**30)


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
FILES: dict[str, Callable[[Path], None]] = {
    "texts.parquet": a_million_texts, "wide.parquet": many_columns, "hole.csv": a_hole, "zipped.csv": zipped,
}  # fmt: skip


def peak(path: Path) -> tuple[int, str]:
    """MB that a process needs which reads and checks the trial, and what it says."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path)], capture_output=True, text=True, check=True, timeout=300
    )
    size, _, words = done.stdout.strip().partition(" ")
    return int(size), words


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
    size, words = peak(path)
    print(f"{name}: {size} MB, {words}")
    path.unlink()
    assert size < LIMIT and words, words
