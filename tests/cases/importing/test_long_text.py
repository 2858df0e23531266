"""Large raw logs are read in pieces: the same runs, means of rows where there are too many, little memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap
from cases.importing.written_trials import write_import
from tests.support import raw_logs
from tests.support.peak_memory import PEAK
from tests.support.raw_logs import UNITS, plain

pytest.importorskip("pyproj", reason="needs the extra import")

PORT = ImportMap(rudder_positive="port")


@pytest.fixture
def pieces(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Makes every log of text a large one, of which at most so many rows are kept."""

    def limit(rows: int = 10**6) -> None:
        monkeypatch.setattr("cases.io.block_means.MOST_KEPT", rows)
        monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)

    return limit


def commas(path: Path, *_: object) -> Path:
    """Times of a day over midnight, a date in a column of its own, comments, a sentinel, numbers in quotation marks."""
    truth = raw_logs.run()
    lines = [
        "# logger",
        "time,date,north [m],east [m],heading [deg],u,v,r [rad/s],shaft [rpm],rudder [deg],ship",
        "# end",
    ]
    for i, t in enumerate(truth.t):
        cells = [truth["x"][i], truth["y"][i], np.degrees(truth["psi"][i]) % 360, truth["u"][i], truth["v"][i]]
        cells += [truth["r"][i], 60 * truth["n"][i], np.degrees(truth["delta"][i]) if i % 50 else -999.0]
        second = 86300 + t
        clock = f"{int(second // 3600) % 24:02d}:{int(second // 60) % 60:02d}:{second % 60:06.3f}"
        words = ",".join(f'"{c:.9f}"' if i % 7 == 0 else f"{c:.9f}" for c in cells)
        lines.append(f"{clock},2026-05-{4 + int(second // 86400):02d},{words},Tanker")
        lines += ["# a remark"] if i == 200 else []
    path.write_text("\n".join(lines) + "\n")
    return path


def blanks(path: Path, *_: object) -> Path:
    return plain(path, UNITS)


def daily(path: Path, *_: object) -> Path:
    """Times of a day without a date."""
    commas(path)
    text = path.read_text().replace("time,date,", "time,Foo,")
    path.write_text(text)
    return path


CHOSEN = ImportMap.model_validate({"columns": {"n": {"from": "shaft", "unit": "rpm"}, "u": {"from": "u", "unit": "m/s"},
                                               "v": {"from": "v", "unit": "m/s"}}})  # fmt: skip


@pytest.mark.parametrize(
    ("make", "chosen"), [(raw_logs.semicolons, PORT), (commas, CHOSEN), (daily, CHOSEN), (blanks, ImportMap())]
)
def test_a_log_read_in_pieces_is_that_read_at_once(
    tmp_path: Path, pieces: Callable[..., None], make: Callable[..., Path], chosen: ImportMap
) -> None:
    path = make(tmp_path / "zigzag.csv", raw_logs.run())
    found = [import_logs([path], chosen)]
    pieces()
    found.append(import_logs([path], chosen))
    assert not found[0].problems and not found[1].problems, (found[0].problems, found[1].problems)
    one, two = (f.runs[0] for f in found)
    assert sorted(map(str, one.notices)) == sorted(map(str, two.notices))
    assert one.day == two.day and one.std == pytest.approx(two.std, rel=1e-6)
    assert set(one.logs[0].unknown) == set(two.logs[0].unknown)
    for name, values in one.columns.items():
        assert np.allclose(values, two.columns[name], rtol=0, atol=1e-9, equal_nan=True), name
    files = [write_import(f, chosen, tmp_path / str(i))[0].parent / "import.toml" for i, f in enumerate(found)]
    assert files[0].read_text() == files[1].read_text()


def test_means_of_rows_of_a_log(tmp_path: Path, pieces: Callable[..., None]) -> None:
    truth = raw_logs.run()
    pieces(100)
    found = import_logs([raw_logs.semicolons(tmp_path / "a.csv", truth)], PORT)
    assert not found.problems
    run = found.runs[0]
    t = run.columns["t"]
    assert 85 < len(t) <= 100
    late = 0.75  # the mean of the first four rows
    inside = slice(3, -3)
    for name, least in {"x": 0.1, "y": 0.1, "u": 0.03, "v": 0.03, "r": 4e-3, "n": 1e-3}.items():
        off = (run.columns[name] - np.interp(t + late, truth.t, truth[name]))[inside]
        assert np.abs(off).max() < least, (name, np.abs(off).max())
    turned = run.columns["psi"] - np.interp(t + late, truth.t, truth.psi_unwrapped)
    assert np.abs(np.angle(np.exp(1j * turned)))[inside].max() < 5e-3


def test_numbers_for_nothing_are_in_no_mean(tmp_path: Path, pieces: Callable[..., None]) -> None:
    pieces(100)
    found = import_logs([commas(tmp_path / "a.csv")], CHOSEN)
    assert not found.problems, found.problems
    assert np.abs(found.runs[0].columns["delta"]).max() < 0.7
    assert any("-999" in m for m in found.runs[0].notices)


Change = Callable[[list[str]], list[str]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lines: [*lines[:300], lines[100], *lines[301:]], "99.5"),
        (lambda lines: [*lines[:300], lines[300].replace(";", ","), *lines[301:]], "301"),
        (lambda lines: [*lines[:300], lines[300] + ";7;8", *lines[301:]], "line 301 has 11 cells"),
        (lambda lines: [*lines[:300], lines[300].replace(";good", "T;good"), *lines[301:]], "row 299, column 'Rudder"),
        (lambda lines: [*lines[:300], "noon" + lines[300][23:], *lines[301:]], "row 299: 'noon"),
        (lambda lines: [line.replace("Time", "Foo") for line in lines], "no clock"),
        (lambda lines: [x + (";Ship" if i == 1 else f";{i % 2}") for i, x in enumerate(lines)], "several ships"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_large_log_is_told_by_its_row(
    tmp_path: Path, pieces: Callable[..., None], change: Change, words: str
) -> None:
    path = raw_logs.semicolons(tmp_path / "a.csv", raw_logs.run())
    path.write_text("\n".join(change(path.read_text(encoding="cp1252").splitlines())) + "\n", encoding="cp1252")
    small = import_logs([path], PORT).problems
    for rows in (10**6, 100):
        pieces(rows)
        found = import_logs([path], PORT)
        assert not found.runs and len(found.problems) == 1 and words in found.problems[0], found.problems
    assert len(small) == 1 and words in small[0]


def test_a_last_line_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path: Path, pieces: Callable[..., None]) -> None:
    path = raw_logs.semicolons(tmp_path / "a.csv", raw_logs.run())
    path.write_bytes(path.read_bytes()[:-60])
    small = import_logs([path], PORT)
    pieces()
    large = import_logs([path], PORT)
    assert not small.problems and not large.problems
    assert len(small.runs[0].columns["t"]) == len(large.runs[0].columns["t"])


@pytest.mark.slow
def test_damaged_bytes_of_large_logs_raise_nothing_but_a_line(tmp_path: Path, pieces: Callable[..., None]) -> None:
    pieces(60)
    good = [raw_logs.semicolons(tmp_path / "a.csv", raw_logs.run()).read_bytes()[:9000]]
    good.append(plain(tmp_path / "c.txt", UNITS).read_bytes()[:9000])
    rng = np.random.default_rng(8)
    parts = [
        b"\0",
        b"\xff\xfe",
        b";;",
        b",",
        b"\r",
        b'"',
        b"-999",
        b"1e400",
        b"nan",
        b"9" * 400,
        b"\t",
        b"T25:61",
        b"\n",
    ]
    read = 0
    for i in range(150):
        content = bytearray(good[i % 2])
        for _ in range(int(rng.integers(1, 6))):
            at, part = int(rng.integers(0, len(content))), parts[int(rng.integers(0, len(parts)))]
            content[at : at + len(part) * int(rng.integers(0, 2))] = part
        path = tmp_path / "damaged.csv"
        path.write_bytes(bytes(content[: int(rng.integers(200, len(content)))]))
        found = import_logs([path])
        assert bool(found.problems) or bool(found.runs)
        read += bool(found.runs)
    assert 10 < read < 140


PROGRAM = (
    PEAK
    + """
from pathlib import Path
from cases.importing.import_logs import import_logs
found = import_logs([Path(sys.argv[1])])
assert not found.problems, found.problems
print(f"{peak_mb():.0f} {len(found.runs[0].columns['t'])}")
"""
)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no measure of the peak")
def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """Four times the rows, 150 MB of text, need no more memory."""
    peaks = []
    t = np.arange(1000)
    cells = [f"{0.3 * np.sin(0.01 * k):.6f};1.2;{0.05 * np.cos(0.01 * k):.6f};{0.01 * k:.3f};120.0;5.0;fine" for k in t]
    for count in (600_000, 2_400_000):
        path = tmp_path / f"{count}.csv"
        with path.open("w") as file:
            file.write("time;heading [rad];surge [m/s];sway [m/s];rot [deg/s];rpm;rudder [deg];mood\n")
            for start in range(0, count, 1000):
                file.write("\n".join(f"{1.7e9 + 0.05 * (start + k):.2f};{cells[k]}" for k in range(1000)) + "\n")
        done = subprocess.run([sys.executable, "-c", PROGRAM, str(path)], capture_output=True, text=True, check=True)
        peak, kept = map(int, done.stdout.split())
        assert 250_000 < kept <= 400_000
        peaks.append(peak)
        path.unlink()
    print(peaks)
    assert peaks[1] < 1.3 * peaks[0] and peaks[1] < 500
