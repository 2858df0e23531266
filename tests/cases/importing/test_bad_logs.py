"""Bad logs: one line that says what, where and what to do; all of a folder at once; nothing half-written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap, read_map
from cases.io.toml_file import validated
from mmg.errors import UserError
from mmg_ident.commands.main import main
from tests.support import raw_logs
from tests.support.raw_logs import UNITS, plain, rows


def problem(path: Path, chosen: ImportMap | None = None) -> str:
    found = import_logs([path], chosen)
    assert len(found.problems) == 1, found.problems
    assert "\n" not in found.problems[0] and found.problems[0].startswith((str(path.parent), "files of"))
    return found.problems[0]


HEADER = "time;lat;lon;sog [kn];heading [deg];rpm;rudder [deg]"


def line(i: int, **changed: str) -> str:
    cells = {"t": raw_logs.stamp(0.5 * i), "lat": f"34.7{i:04d}", "lon": "135.4", "sog": "2.1", "psi": f"{i % 360}.5"}
    cells |= {"rpm": "700", "delta": f"{(i % 7) - 3}.5"} | changed
    return ";".join(cells.values())


def lines(count: int = 60, **at: dict[str, str]) -> list[str]:
    return [line(i, **at.get(f"row{i}", {})) for i in range(count)]


def in_zone(path: Path, zone: str, northing: float) -> Path:
    """A log of eastings and northings [m] in a UTM ``zone``."""
    made = [f"{raw_logs.stamp(i)};{northing + i};{4e5 + i};{zone};1;700;2" for i in range(60)]
    return rows(path, "time;northing [m];easting [m];zone;heading [deg];rpm;rudder [deg]", made)


CASES: list[tuple[str, Callable[[Path], Path], str]] = [
    ("empty", lambda p: rows(p, "", []), "is empty"),
    ("only a header", lambda p: rows(p, HEADER, []), "below a header|no separator"),
    ("binary", lambda p: p.write_bytes(bytes(range(256)) * 40) and p, "is no text"),
    ("words",
     lambda p: rows(p, "It was a fine day", ["and we went out", "to sea again"]),
     "no separator|below a header"),
    ("no header", lambda p: rows(p, line(0), lines()[1:]), "has no headers"),
    ("a short row",
     lambda p: rows(p, HEADER, [*lines(30), "2026;1;2", *lines()[31:]]),
     "line 32 has 3 cells, the header 7"),
    ("a long row", lambda p: rows(p, HEADER, [*lines(30), line(30) + ";7;8", *lines()[31:]]), "line 32 has 9 cells"),
    ("mixed separators",
     lambda p: rows(p, HEADER, [*lines(30), line(30).replace(";", ","), *lines()[31:]]),
     "separated by ','"),
    ("another separator in the header",
     lambda p: rows(p, HEADER.replace(";", ","), lines()),
     "header's cells are separated by ',', those of the rows by ';'"),
    ("only comments", lambda p: rows(p, "# a", ["# b", "% c"]), "nothing but comments"),
    ("two clocks",
     lambda p: rows(p, f"{HEADER};utc", [f"{t};{i}" for i, t in enumerate(lines())]),
     "two columns hold a time"),
    ("no clock", lambda p: rows(p, HEADER.replace("time", "foo"), lines()), "no clock"),
    ("backwards",
     lambda p: rows(p, HEADER, lines(row20={"t": raw_logs.stamp(2)})),
     "runs backwards by 7.5 s after row 20"),
    ("no time", lambda p: rows(p, HEADER, lines(row9={"t": "noon"})), "row 10: 'noon' is no time"),
    ("day or month",
     lambda p: rows(p, HEADER, [line(i, t=f"03/04/2026 10:00:{i % 60:02d}") for i in range(60)]),
     "day and month could be"),
    ("text in numbers",
     lambda p: rows(p, HEADER, lines(row11={"rpm": "stop"})),
     "row 12, column 'rpm': 'stop' is not a number"),
    ("unit", lambda p: rows(p, HEADER.replace("sog [kn]", "sog [Bft]"), lines()), "unknown unit 'Bft' for sog"),
    ("two headings", lambda p: rows(p, f"{HEADER};gyro [deg]", [f"{t};1" for t in lines()]), "two columns are psi"),
    ("no heading", lambda p: rows(p, HEADER.replace("heading [deg]", "foo"), lines()), "missing psi.*not known: foo"),
    ("no propeller", lambda p: rows(p, HEADER.replace("rpm", "foo"), lines()), "missing n"),
    ("ships in rows",
     lambda p: rows(p, f"{HEADER};mmsi", [f"{t};{i % 2}" for i, t in enumerate(lines())]),
     "several ships"),
    ("zones", lambda p: rows(p, "time;northing [m];easting [m];zone;heading [deg];rpm;rudder [deg]",
      [f"{raw_logs.stamp(i)};{5e6 + i};{4e5 + i};{32 + i // 40}N;1;700;2" for i in range(60)]), "several UTM zones"),
    ("hemisphere", lambda p: in_zone(p, "54", 5e6), "which hemisphere"),
    ("band or south", lambda p: in_zone(p, "54S", 3.9e6), "35 deg north in band S, or 55 deg south"),
    ("jump of zones", lambda p: rows(p, "time;northing [m];easting [m];heading [deg];rpm;rudder [deg]",
      [f"{raw_logs.stamp(i)};{5e6 + i};{4e5 + i + 4e5 * (i >= 40)};1;700;2" for i in range(80)]), "two UTM zones"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "words"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_a_bad_log_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[Path], Path], words: str
) -> None:
    """Read at once, in pieces, and in pieces whose rows are averaged."""
    pytest.importorskip("pyproj", reason="needs the extra import")
    path = make(tmp_path / "log.csv")
    for kept, block in ((10**6, 2**21), (10**6, 500), (30, 500)):
        monkeypatch.setattr("cases.io.text_table.MOST_KEPT", kept)
        monkeypatch.setattr("cases.io.text_table.BLOCK", block)
        said = problem(path)
        assert re.search(words, said), said


def test_all_problems_of_a_folder_are_said_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    logs = tmp_path / "logs"
    logs.mkdir()
    plain(logs / "good.txt", UNITS)
    rows(logs / "one.csv", HEADER, [*lines(30), "2026;1;2", *lines()[31:]])
    rows(logs / "two.csv", HEADER.replace("time", "foo"), lines())
    assert main(["import", str(logs), "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert err.count("one.csv") == 1 and err.count("two.csv") == 1 and "2 problems" in err
    assert len(err.strip().splitlines()) == 4  # heads, one line each, and how many
    assert sorted(p.name for p in tmp_path.iterdir()) == ["logs"]


def test_files_of_different_ships(tmp_path: Path) -> None:
    for name in ("a", "b"):
        rows(tmp_path / f"{name}.txt", "time_s heading_rad surge_mps ship", [f"{t} 0.1 1.0 {name}" for t in range(40)])
    assert any("a.txt" in p and "ships" in p for p in import_logs([tmp_path]).problems)


@pytest.mark.parametrize("line", ["Vessel: MV {}", "# ship name = {};;;", '"MMSI";21100000{}', "// IMO no.: 900{}"])
def test_files_whose_first_lines_name_different_ships(tmp_path: Path, line: str) -> None:
    for i, name in enumerate(("1", "2")):
        rows(tmp_path / f"{i}.csv", line.format(name), [HEADER, *lines()])
    assert any("ships" in p for p in import_logs([tmp_path]).problems)
    rows(tmp_path / "1.csv", line.format("1"), [HEADER, *lines()])
    assert not any("ships" in p for p in import_logs([tmp_path]).problems)


def test_files_that_are_cut_off_or_empty_are_a_line_each(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="needs the extra import")
    pytest.importorskip("pynmeagps", reason="needs the extra import")
    truth = raw_logs.run()
    raw_logs.excel(tmp_path / "a.xlsx", truth)
    truth.to_pandas().to_parquet(tmp_path / "b.parquet")
    raw_logs.nmea(tmp_path / "c.nmea", truth)
    for path, size in ((tmp_path / "a.xlsx", 5000), (tmp_path / "b.parquet", 2000), (tmp_path / "c.nmea", 1000)):
        path.write_bytes(path.read_bytes()[:size])
    for name in ("d.csv", "e.nmea", "f.parquet", "g.xlsx"):
        (tmp_path / name).touch()
    openpyxl.Workbook().save(tmp_path / "h.xlsx")
    found = import_logs([tmp_path])
    words = {"a.xlsx": "is cut off, damaged or no Excel", "b.parquet": "is cut off, damaged or none", "c.nmea": ": "}
    words |= dict.fromkeys(("d.csv", "e.nmea", "f.parquet", "g.xlsx"), "the file is empty")
    words["h.xlsx"] = "no sheet holds"
    assert not found.runs and len(found.problems) == 8, found.problems
    for name, what in words.items():
        assert sum(str(tmp_path / name) in p and what in p for p in found.problems) == 1, (name, found.problems)


def test_clocks_that_do_not_overlap(tmp_path: Path) -> None:
    pytest.importorskip("pyproj", reason="needs the extra import")
    paths = raw_logs.apart(tmp_path, raw_logs.run())
    for late, problems in ((0.0, 0), (1e4, 1)):
        files = {p.name: {"run": "seven", "clock_offset": late * i} for i, p in enumerate(paths)}
        assert len(import_logs(paths, validated(ImportMap, {"files": files}, "map")).problems) == problems


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("columns = 3", "columns"),
        ("[columns]\nfoo = 'bar'", "no quantity of a log"),
        ("[columns]\nn = { from = 'rpm', unit = 'kn' }", "does not belong to n"),
        ("rudder_positive = 'left'", "rudder_positive"),
        ("[columns]\nn = { unit = 'rpm' }", "columns.n.from"),
        ("origin = [1.0]", "origin"),
        ("zone_hours = 99.0", "zone_hours"),
        ("surprise = 1", "surprise"),
    ],
)
def test_a_bad_map_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "import.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=words) as refused:
        read_map(path)
    assert str(refused.value).startswith(str(path))


def test_a_map_for_a_file_that_is_not_there(tmp_path: Path) -> None:
    path = plain(tmp_path / "a.txt", UNITS)
    chosen = validated(ImportMap, {"files": {"b.txt": {"skip": True}}}, "map")
    assert any('[files."b.txt"]' in p for p in import_logs([path], chosen).problems)
    own = validated(ImportMap, {"files": {"a.txt": {"columns": {"psi": "Kurs"}}}}, "map")
    assert "'Kurs'" in import_logs([path], own).problems[0]


BYTES = (
    b"\0", b"\xff\xfe", b";;", b",", b"\r", b'"', b"-999", b"1e400", b"nan", b"9" * 400, b"$GPRMC,", b"\t", b"T25:61",
    b"\n",
)  # fmt: skip


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.parametrize("large", [False, True])
def test_damaged_bytes_raise_nothing_but_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, large: bool) -> None:
    """Hundreds of damaged logs, read at once or in pieces: read, or refused in a line."""
    if large:
        monkeypatch.setattr("cases.io.text_table.MOST_KEPT", 60)
        monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)
    good = [raw_logs.semicolons(tmp_path / "a.csv", raw_logs.run()).read_bytes()[:6000]]
    good.append(raw_logs.nmea(tmp_path / "b.nmea", raw_logs.run()).read_bytes()[:6000])
    good.append(plain(tmp_path / "c.txt", UNITS).read_bytes()[:6000])
    rng, read = np.random.default_rng(8), 0
    for i in range(300):
        content = bytearray(good[i % 3])
        for _ in range(int(rng.integers(1, 6))):
            at, piece = int(rng.integers(0, len(content))), BYTES[int(rng.integers(0, len(BYTES)))]
            content[at : at + len(piece) * int(rng.integers(0, 2))] = piece
        path = tmp_path / f"damaged{'.nmea' if i % 3 == 1 else '.csv'}"
        path.write_bytes(bytes(content[: int(rng.integers(200, len(content)))]))
        found = import_logs([path])
        assert bool(found.problems) or bool(found.runs)
        read += bool(found.runs)
    assert 20 < read < 280


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("far.csv", "t [s];psi [deg];n [rpm];delta [deg];u [m/s]\n" + "\n".join(
            f"{t};1;60;{t % 7};1" for t in (*range(30), 2e9)), "2e+09"),
        ("minus.csv", "time;psi [deg]\n" + "09:30:0-7;1\n" * 2 + "09:30:-1;1\n" * 9, "is no time"),
        ("ais.csv", "#AIVDM,1,1\n#AIVDM,1,2\n", "nothing but comments"),
        ("huge.csv", "t [s];psi [deg];n [rpm];delta [deg]\n" + "1e3;1e308;1e308;1\n" * 12, "fewer than two times"),
    ],
)  # fmt: skip
def test_what_fuzzing_found_is_one_line(name: str, text: str, words: str, tmp_path: Path) -> None:
    """A clock that jumps by years took five minutes; comments alone and huge numbers were tracebacks."""
    (tmp_path / name).write_text(text)
    found = import_logs([tmp_path / name])
    assert not found.runs and len(found.problems) == 1 and words in found.problems[0], found.problems
