"""Bad logs: one line that says what, where and what to do; all of a folder at once; nothing half-written."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from cases.importing.import_logs import import_logs
from cases.importing.import_map import read_map
from mmg.errors import UserError
from mmg_ident.commands.main import main
from tests.support import raw_logs
from tests.support.raw_logs import UNITS, chosen, plain, rows


def problem(path: Path) -> str:
    found = import_logs([path])
    assert len(found.problems) == 1, found.problems
    assert "\n" not in found.problems[0] and found.problems[0].startswith((str(path.parent), "files of"))
    return found.problems[0]


HEADER = "time;lat;lon;sog [kn];heading [deg];rpm;rudder [deg]"
GRID = "time;northing [m];easting [m];zone;heading [deg];rpm;rudder [deg]"
Make = Callable[[Path], Path]


def line(i: int, **changed: str) -> str:
    cells = {"t": raw_logs.stamp(0.5 * i), "lat": f"34.7{i:04d}", "lon": "135.4", "sog": "2.1", "psi": f"{i % 360}.5"}
    cells |= {"rpm": "700", "delta": f"{(i % 7) - 3}.5"} | changed
    return ";".join(cells.values())


def lines(count: int = 60, **at: dict[str, str]) -> list[str]:
    return [line(i, **at.get(f"row{i}", {})) for i in range(count)]


def log(header: str = HEADER, body: Sequence[str] | None = None) -> Make:
    """Writes a log of this header and body."""
    return lambda path: rows(path, header, lines() if body is None else list(body))


def row_31(text: str) -> Make:
    """Writes a log whose 31st row is another one."""
    return log(HEADER, [*lines(30), text, *lines()[31:]])


def beside(header: str, cell: Callable[[int], object]) -> Make:
    """Writes a log with one more column."""
    return log(f"{HEADER};{header}", [f"{text};{cell(i)}" for i, text in enumerate(lines())])


def in_zone(zone: Callable[[int], str], northing: float) -> Make:
    """Writes a log of eastings and northings [m] in a UTM zone."""
    return log(GRID, [f"{raw_logs.stamp(i)};{northing + i};{4e5 + i};{zone(i)};1;700;2" for i in range(60)])


def days_or_months(i: int) -> str:
    return line(i, t=f"03/04/2026 10:00:{i % 60:02d}")


JUMPING = [f"{raw_logs.stamp(i)};{5e6 + i};{4e5 + i + 4e5 * (i >= 40)};1;700;2" for i in range(80)]
FAR = [f"{t};1;60;{t % 7};1" for t in (*range(30), 2e9)]
CASES: dict[str, tuple[Make, str]] = {
    "empty": (log("", []), "is empty"),
    "only a header": (log(body=[]), "below a header|no separator"),
    "binary": (lambda path: path.write_bytes(bytes(range(256)) * 40) and path, "is no text"),
    "words": (log("It was a fine day", ["and we went out", "to sea again"]), "no separator|below a header"),
    "no header": (log(line(0), lines()[1:]), "has no headers"),
    "a short row": (row_31("2026;1;2"), "line 32 has 3 cells, the header 7"),
    "a long row": (row_31(line(30) + ";7;8"), "line 32 has 9 cells"),
    "mixed separators": (row_31(line(30).replace(";", ",")), "separated by ','"),
    "another separator in the header": (
        log(HEADER.replace(";", ",")), "header's cells are separated by ',', those of the rows by ';'"),
    "only comments": (log("# a", ["# b", "% c"]), "nothing but comments"),
    "comments of AIS": (log("#AIVDM,1,1", ["#AIVDM,1,2"]), "nothing but comments"),
    "two clocks": (beside("utc", lambda i: i), "two columns hold a time"),
    "no clock": (log(HEADER.replace("time", "foo")), "no clock"),
    "backwards": (log(body=lines(row20={"t": raw_logs.stamp(2)})), "runs backwards by 7.5 s after row 20"),
    "no time": (log(body=lines(row9={"t": "noon"})), "row 10: 'noon' is no time"),
    "minus in a time": (log("time;psi [deg]", ["09:30:0-7;1"] * 2 + ["09:30:-1;1"] * 9), "is no time"),
    "a clock that jumps by years": (log("t [s];psi [deg];n [rpm];delta [deg];u [m/s]", FAR), r"2e\+09"),
    "one time": (log("t [s];psi [deg];n [rpm];delta [deg]", ["1e3;1e308;1e308;1"] * 12), "fewer than two"),
    "day or month": (log(body=[days_or_months(i) for i in range(60)]), "day and month could be"),
    "text in numbers": (log(body=lines(row11={"rpm": "stop"})), "row 12, column 'rpm': 'stop' is not a number"),
    "unit": (log(HEADER.replace("sog [kn]", "sog [Bft]")), "unknown unit 'Bft' for sog"),
    "two headings": (beside("gyro [deg]", lambda i: 1), "two columns are psi"),
    "no heading": (log(HEADER.replace("heading [deg]", "foo")), "missing psi.*foo .*not known"),
    "no propeller": (log(HEADER.replace("rpm", "foo")), "missing n"),
    "ships in rows": (beside("mmsi", lambda i: i % 2), "several ships"),
    "zones": (in_zone(lambda i: f"{32 + i // 40}N", 5e6), "several UTM zones"),
    "hemisphere": (in_zone(lambda i: "54", 5e6), "which hemisphere"),
    "band or south": (in_zone(lambda i: "54S", 3.9e6), "35 deg north in band S, or 55 deg south"),
    "jump of zones": (log(GRID.replace("zone;", ""), JUMPING), "two UTM zones"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "words"), CASES.values(), ids=CASES)
def test_a_bad_log_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Make, words: str
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


SHIPS = ("Vessel: MV {}", "# ship name = {};;;", '"MMSI";21100000{}', "// IMO no.: 900{}")


@pytest.mark.parametrize("said", ["a column", *SHIPS])
def test_files_of_two_vessels_are_no_run(tmp_path: Path, said: str) -> None:
    """Told by a column or by a first line."""

    def write(ship: int) -> None:
        if said in SHIPS:
            rows(tmp_path / f"{ship}.csv", said.format(min(ship, 2)), [HEADER, *lines()])
        else:
            body = [f"{t} 0.1 1.0 {min(ship, 2)}" for t in range(40)]
            rows(tmp_path / f"{ship}.csv", "time_s heading_rad surge_mps ship", body)

    for ship in (2, 3):
        write(ship)
    assert not any("ships" in p for p in import_logs([tmp_path]).problems)
    write(1)
    assert any("1.csv" in p and "ships" in p for p in import_logs([tmp_path]).problems)


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
        assert len(import_logs(paths, chosen(files=files)).problems) == problems
    header, *rows = paths[1].read_text().splitlines()  # with a clock of another zone
    zoned = [f"{int(row.partition(',')[0]) + 3600_000},{row.partition(',')[2]}" for row in rows]
    raw_logs.rows(paths[1], header, zoned)
    said = import_logs(paths).problems
    assert any("clock_offset = 3" in problem for problem in said), said
    apart = chosen(files={paths[1].name: {"clock_offset": -3600.0}})
    assert len(import_logs(paths, apart).runs) == 1


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
    absent, own = chosen(files={"b.txt": {"skip": True}}), chosen(files={"a.txt": {"columns": {"psi": "Kurs"}}})
    assert any('[files."b.txt"]' in p for p in import_logs([path], absent).problems)
    assert "'Kurs'" in import_logs([path], own).problems[0]
