"""Tables as people export them are read right, or refused with the cause and a line of the map that leads on."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases.importing.import_logs import Imported, import_logs, write_import
from cases.importing.import_map import ImportMap, read_map
from cases.importing.table_files import read_text_log
from cases.importing.vocabulary import factor, meaning
from mmg_ident.commands.main import main
from tests.support import raw_logs
from tests.support.raw_logs import BEGIN, UNITS, answers, bridge, chosen, codes, errors, imported, plain, stamp, table

pytest.importorskip("pyproj", reason="needs the extra import")
TRUTH = raw_logs.run()
N, T = len(TRUTH), TRUTH.t
LOST = (np.arange(N) > 100) & (np.arange(N) < 130)
Log = dict[str, Any]


def times(form: str, jump: float = 0.0, begin: datetime.datetime = BEGIN) -> list[str]:
    """Stamps of the run; ``jump`` [s] is added in its second half."""
    shifted = T + np.where(np.arange(N) >= N // 2, jump, 0.0)
    return [(begin + datetime.timedelta(seconds=float(t))).strftime(form) for t in shifted]


def after(log: Log, header: str, **more: object) -> Log:
    """The ``log`` with columns right of ``header``."""
    at = list(log).index(header) + 1
    return dict([*list(log.items())[:at], *more.items(), *list(log.items())[at:]])


def without(log: Log, *headers: str) -> Log:
    return {name: values for name, values in log.items() if name not in headers}


def lost(log: Log, *headers: str) -> Log:
    """The ``log`` with zeros in the LOST rows."""
    return {**log, **{h: np.where(LOST, 0.0, np.asarray(log[h], dtype=float)) for h in headers}}


def right(path: Path, given: ImportMap | None = None) -> bool:
    """Whether the run in the log ``path`` is the true one, at its own times, in SI and radians, x by its changes."""
    run = imported(path, given).runs[0].columns
    off = {name: run[name] - np.interp(run["t"], T, TRUTH[name]) for name in ("n", "delta", "x")}
    off["x"] -= off["x"][0]
    off["psi"] = np.angle(np.exp(1j * (run["psi"] - np.interp(run["t"], T, TRUTH.psi_unwrapped))))
    return all(
        np.nanmax(np.abs(off[c])) < most for c, most in {"psi": 0.02, "n": 0.02, "delta": 0.02, "x": 0.5}.items()
    )


def minutes(degrees: Any, form: str = "{:d}{:09.6f}") -> list[str]:
    return [form.format(int(d), d % 1 * 60) for d in np.abs(np.asarray(degrees, dtype=float))]


def degrees_and_minutes(log: Log) -> Log:
    for name, short in (("Latitude", "Lat"), ("Longitude", "Lon")):
        d = np.asarray(log[name], dtype=float)
        log = after(log, name, **{f"{short} (deg)": np.floor(d), f"{short} (min)": d % 1 * 60})
        del log[name]
    return log


READ: dict[str, Callable[[Log], Log]] = {
    "clock of seconds of the week": lambda log: {
        "GPS TOW": np.round((604710 + T) % 604800, 3), **without(log, "Time")},
    "clock set back an hour": lambda log: {**log, "Time": times("%Y-%m-%dT%H:%M:%S.%f", -3600)},
    "clock set on an hour": lambda log: {**log, "Time": times("%Y-%m-%dT%H:%M:%S.%f", 3600)},
    "1024 weeks": lambda log: {**log, "Time": times("%Y-%m-%dT%H:%M:%S.%f", -1024 * 604800)},
    "twelve hours": lambda log: {**log, "Time": times("%I:%M:%S.%f", 0, BEGIN.replace(hour=12, minute=59))},
    "minutes and seconds": lambda log: {
        **log, "Time": [s[:-5] for s in times("%M:%S.%f", 0, BEGIN.replace(minute=58))]},
    "date that stays": lambda log: {
        "Date": ["4.5.2026"] * N, **log, "Time": times("%H:%M:%S.%f", 0, BEGIN.replace(hour=23, minute=59))},
    "names of months": lambda log: {**log, "Time": times("%d-%b-%Y %H:%M:%S.%f")},
    "parts": lambda log: {
        "Year": [2026] * N, "Month": [5] * N, "Day": [4] * N, "Hour": [9] * N, "Minute": (30 + T // 60).astype(int),
        "Second": T % 60, **without(log, "Time")},
    "nanoseconds beside": lambda log: {
        "secs": (1777886000 + T // 1).astype(int), "nsecs": (T % 1 * 1e9).astype(int),
        **without(log, "Time")},
    **{f"epochs in {unit}": lambda log, unit=unit, second=second: {
        f"Time [{unit}]": second * (1.7779e9 + T), **without(log, "Time")}
       for unit, second in {"seconds": 1.0, "milliseconds": 1e3, "sec": 1.0, "ms": 1e3}.items()},
    "digits": lambda log: {**log, "Time": times("%Y%m%d_%H%M%S.%f")},
    "digits of a time": lambda log: {"UTC": times("%H%M%S.%f"), **without(log, "Time")},
    "digits of a date and time": lambda log: {**log, "Time": times("%Y%m%d%H%M%S.%f")},
    "days of MATLAB": lambda log: {**log, "Time": [f"{739740.4 + t / 86400:.10f}" for t in T]},
    "ddmm": lambda log: {**log, **{h: minutes(log[h]) for h in ("Latitude", "Longitude")}},
    "degrees, then minutes": degrees_and_minutes,
    "minutes with a comma": lambda log: {
        **log, "Latitude": [f'"{cell.replace(".", ",")}"' for cell in minutes(log["Latitude"], "{:d}° {:.6f}' N")]},
    "dashes": lambda log: {**log, "Latitude": minutes(log["Latitude"], "{:d}-{:09.6f}N")},
    "typesetter's minus": lambda log: {
        **log, "Rudder [deg]": [f"{d:.6f}".replace("-", "\u2212") for d in log["Rudder [deg]"]]},
    "status of the heading": lambda log: after(
        lost(log, "Heading [deg]"), "Heading [deg]", **{"Gyro state": np.where(LOST, "FAULT", "OK")}),
    "status behind the time": lambda log: after(
        lost(log, "Latitude", "Longitude", "SOG [kn]", "COG [deg]"), "Time", Status=np.where(LOST, "V", "A")),
    "quality of the fix": lambda log: {
        **lost(log, "Latitude", "Longitude", "SOG [kn]"), "GPS quality": np.where(LOST, 0, 4)},
    "reference": lambda log: after(log, "Heading [deg]", Ref=["T"] * N),
    "variation": lambda log: {
        **without(log, "Heading [deg]"), "Variation [deg]": [-7.5] * N,
        "HDG (M)": np.asarray(log["Heading [deg]"]) + 7.5},
    "variation and deviation beside their sides": lambda log: {
        **without(log, "Heading [deg]"), "Variation": [7.5] * N, "Variation E/W": ["W"] * N, "Deviation": [2.0] * N,
        "HDG (M)": np.asarray(log["Heading [deg]"]) + 5.5},
    "variation and deviation with a side": lambda log: {
        **without(log, "Heading [deg]"), "Mag var": ["7.5W"] * N, "Compass deviation": ["2.0 E"] * N,
        "HDG (M)": np.asarray(log["Heading [deg]"]) + 5.5},
    "orders beside": lambda log: {**log, "Rudder order [deg]": [20.0] * N, "Target heading [deg]": [90.0] * N},
    "the same twice": lambda log: {**log, "SOG [m/s]": np.asarray(log["SOG [kn]"]) * 1852 / 3600},
    "French": lambda log: dict(zip(
        ["Heure", "Latitude", "Longitude", "Vitesse fond (nœuds)", "Route fond (°)", "Cap (°)", "Régime (tr/min)",
         "Angle de barre (°)"], log.values(), strict=True)),
    "camels": lambda log: dict(zip(
        ["timeStamp", "gpsLat", "gpsLon", "speedOverGround_kn", "courseOverGround_deg", "trueHeading_deg", "shaftRPM",
         "rudderAngle_deg"], log.values(), strict=True)),
    "newest first": lambda log: {name: list(values)[::-1] for name, values in log.items()},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("make", READ.values(), ids=READ)
def test_a_table_is_read_as_it_is_meant_and_its_map_repeats_it(tmp_path: Path, make: Callable[[Log], Log]) -> None:
    path = table(tmp_path / "a.csv", make(bridge(TRUTH)))
    assert right(path)
    write_import(import_logs([path]), ImportMap(), tmp_path / "out")
    assert right(path, read_map(tmp_path / "out" / "import.toml"))


ASKED: dict[str, Callable[[Log], Log]] = {
    "status 0 and 1": lambda log: after(
        lost(log, "Heading [deg]"), "Heading [deg]", Status=np.where(LOST, 1, 0)),
    "two sensors": lambda log: {**log, "Sensor": np.where(np.arange(N) % 2, "B", "A"), "Heading [deg]": np.asarray(
        log["Heading [deg]"]) + 3.0 * (np.arange(N) % 2)},
    "two headings": lambda log: {**log, "Gyro [deg]": np.asarray(log["Heading [deg]"]) + 3.0},
    "speed in another unit": lambda log: {**log, "SOG [kn]": np.asarray(log["SOG [kn]"]) * 1.852},
    "positions in feet": lambda log: {
        "Time": log["Time"], "x [m]": TRUTH["x"] / 0.3048, "y [m]": TRUTH["y"] / 0.3048,
        **dict(list(log.items())[3:])},
    "heading in radians": lambda log: {**log, "Heading [deg]": TRUTH["psi"]},
    "a unit that none knows": lambda log: {**log, "Bow thruster [%]": 0.0 * T},
    "minutes at zero degrees": lambda log: {
        **log, "Latitude": 18.0 + 60 * TRUTH["x"] / 110575.0, "Longitude": 18.0 + 60 * TRUTH["y"] / 111319.0},
    "1e-7 degrees": lambda log: {
        **log, **{h: np.round(np.asarray(log[h]) * 1e7) for h in ("Latitude", "Longitude")}},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("make", ASKED.values(), ids=ASKED)
def test_what_stays_open_is_asked_and_the_printed_line_leads_on(tmp_path: Path, make: Callable[[Log], Log]) -> None:
    path = table(tmp_path / "a.csv", make(bridge(TRUTH)))
    maps = answers(path)
    questions = import_logs([path]).questions
    assert len(maps) == len(questions[0].choices) and right(path, maps[0])
    for given in maps[1:]:  # none asks the same again
        assert questions[0].words not in [q.words for q in import_logs([path], given).questions]


LANGUAGES = {
    "cp1252": ["Zeit (UTC)|Geogr. Breite [°]|Geogr. Länge [°]|FüG [kn]|KüG [Grad]|rwK [Grad]|Wellendrehzahl [1/min]|"
               "Ruderlage [°]",
               "Horodatage|Latitude|Longitude|Vitesse fond (nds)|Route fond|Cap vrai|Régime arbre|Angle de barre"],
    "utf-8": ["Tid|Breddegrad|Lengdegrad|Fart over grunn|Kurs over grunn|Gyrokurs|Akselturtall|Rorvinkel",
              "Tid|Latitud|Longitud|Fart över grund|Kurs över grund|Girokurs|Axelvarv [varv/min]|Rodervinkel",
              "Hora|Latitud|Longitud|Velocidad sobre el fondo (nudos)|Rumbo sobre el fondo|Rumbo verdadero|RPM eje|"
              "Ángulo de timón (grados)"],
    "cp932": ["時刻|緯度［度］|経度［度］|対地速力［ノット］|対地針路［度］|船首方位|主軸回転数［rpm］|舵角［度］"],
}  # fmt: skip


@pytest.mark.parametrize(("encoding", "lines"), LANGUAGES.items(), ids=LANGUAGES)
def test_headers_in_other_languages(tmp_path: Path, encoding: str, lines: list[str]) -> None:
    for line in lines:
        path = tmp_path / "a.csv"
        path.write_bytes("\n".join([line, *["|".join("12345678")] * 3]).encode(encoding))
        found = read_text_log(path)
        quantities = [meaning(header).quantity for header in found.headers]
        assert quantities == ["t", "latitude", "longitude", "sog", "cog", "psi", "n", "delta"], line
        known = zip(quantities[1:], found.units[1:], strict=True)
        assert all(factor(quantity, unit) for quantity, unit in known if unit), line


@pytest.mark.parametrize(
    ("port", "starboard"),
    [("{} P", "{} S"), ("{} (P)", "{} (S)"), ("{} Backbord", "{} Steuerbord"), ("babord {}", "{} tribord")],
)
def test_words_and_letters_of_a_side(tmp_path: Path, port: str, starboard: str) -> None:
    """A bracket with one is no unit, and "_s" of a rudder no second."""
    log = without(bridge(TRUTH), "RPM", "Rudder [deg]")
    for name, values in (("RPM", 60 * TRUTH["n"]), ("Rudder", np.degrees(TRUTH["delta"]))):
        log |= {port.format(name): values / 2, starboard.format(name): values}
    run = imported(table(tmp_path / "a.csv", log)).runs[0].columns
    assert run["n_2"] == pytest.approx(run["n"] / 2) and run["n"] == pytest.approx(TRUTH["n"])
    assert run["delta_port"] == pytest.approx(run["delta_starboard"] / 2)


@pytest.mark.parametrize("header", ["RPM 2", "Shaft2 rpm", "Rudder 2 [deg]"])
def test_a_second_actuator_without_a_side_is_asked_for(tmp_path: Path, header: str) -> None:
    path = table(tmp_path / "a.csv", bridge(TRUTH) | {header: 20.0 + T / T[-1]})
    assert len(answers(path)) == 3 and right(path, answers(path)[-1])


def test_a_letter_with_a_unit_of_something_else_is_nothing_of_the_ship(tmp_path: Path) -> None:
    more = {"p [hPa]": 1013 + 0 * T, "v [V]": 24 + 0 * T, "x [g]": 0.01 * np.sin(T), "COG [°M]": np.mod(T, 360)}
    path = table(tmp_path / "a.csv", without(bridge(TRUTH), "COG [deg]") | more)
    found = imported(path)
    assert right(path) and not {row.what for row in found.runs[0].logs[0].accounts if row.used_as} & {*"pvx", "COG"}


@pytest.mark.parametrize(("amidships", "is_asked"), [(0.0, False), (50.0, True)])
def test_a_rudder_without_a_unit_that_is_never_amidships_is_asked_for(
    tmp_path: Path, amidships: float, is_asked: bool
) -> None:
    log = without(bridge(TRUTH), "Rudder [deg]") | {"Rudder": amidships + np.degrees(TRUTH["delta"])}
    assert bool(import_logs([table(tmp_path / "a.csv", log)]).problems) is is_asked


def test_lines_before_the_header_and_a_separator_behind_each_row(tmp_path: Path) -> None:
    log = bridge(TRUTH) | {"Time": times("%d.%m.%y %H:%M:%S")}
    header, *lines = table(tmp_path / "a.csv", log).read_text().replace(",", ";").splitlines()
    raw_logs.rows(tmp_path / "a.csv", "Settings\n" * 100 + header, [f"{line};" for line in lines])
    assert right(tmp_path / "a.csv") and imported(tmp_path / "a.csv").runs[0].day == "2026-05-04"


def test_revolutions_that_lost_their_sign_are_asked_for(tmp_path: Path) -> None:
    from mmg_ident import simulate

    log = bridge(simulate("esso_osaka_3m", "crash-stop", dt=0.5, duration=90, seed=1))
    log["RPM"] = np.abs(np.asarray(log["RPM"]))
    ordered = np.where(log["RPM"] < 0, 1, -1)
    for more in ({}, {"RPM order": 700 * ordered}, {"Telegraph": ["FULL ASTERN"] * len(ordered)}):
        path = table(tmp_path / "a.csv", {**log, **more})
        assert len(import_logs([path], answers(path)[0]).problems) <= 1
    blades = {**log, "CPP pitch [deg]": np.linspace(20, -20, len(ordered))}
    imported(table(tmp_path / "a.csv", blades))  # blades that turn need no sign
    circle = simulate("esso_osaka_3m", "turning:35", dt=0.5, duration=150, effects=["current:x=0.18"])
    imported(table(tmp_path / "a.csv", bridge(circle)))  # over ground she goes astern where the current is ahead
    log["Heading [deg]"] = (np.asarray(log["Heading [deg]"]) + 180) % 360
    imported(table(tmp_path / "a.csv", without(log, "SOG [kn]", "COG [deg]")))  # she goes astern all the time


def test_a_stamp_after_the_year_9999_is_one_line(tmp_path: Path) -> None:
    log = {**bridge(TRUTH), "Time": np.datetime64("2026-05-04", "us") + (1e6 * T).astype("timedelta64[us]")}
    log["Time"][100:] += np.timedelta64(10000 * 365, "D")
    pd.DataFrame(log).to_parquet(tmp_path / "a.parquet")
    assert len(import_logs([tmp_path / "a.parquet"]).problems) == 1


def test_durations_are_a_clock(tmp_path: Path) -> None:
    """Also beyond a day, as cells "[hh]:mm:ss" of a workbook are."""
    frame = pd.DataFrame({**bridge(TRUTH), "Time": pd.to_timedelta(90000.0 + T, unit="s")})
    frame.to_parquet(tmp_path / "a.parquet")
    assert imported(tmp_path / "a.parquet").runs[0].columns["t"] == pytest.approx(T - T[0])


@pytest.mark.parametrize("index", [None, "time", "t [s]"])
@pytest.mark.parametrize("suffix", ["csv", "parquet", "xlsx"])
def test_the_index_of_a_frame_is_its_clock(tmp_path: Path, suffix: str, index: str | None) -> None:
    """pandas writes it without a header where it has no name, and to Parquet as no column of its own."""
    stamps = np.datetime64("2026-05-04T03:00:00", "us") + (1e6 * T).astype("timedelta64[us]")
    frame = pd.DataFrame(without(bridge(TRUTH), "Time"))
    frame.index = pd.Index(T if index == "t [s]" else stamps, name=index)
    getattr(frame, {"xlsx": "to_excel"}.get(suffix, f"to_{suffix}"))(tmp_path / f"a.{suffix}")
    (run,) = import_logs([tmp_path / f"a.{suffix}"]).runs
    assert run.day == ("" if index == "t [s]" else "2026-05-04")
    np.testing.assert_allclose(run.columns["t"], T - T[0], atol=1e-6)


def test_microseconds_since_a_logger_began_are_no_seconds_since_1970(tmp_path: Path) -> None:
    """As PX4 and ArduPilot count: a few minutes in them are of the size of a date in seconds."""
    count, rest = (123e6 + 1e6 * (T - T[0])).astype(int), without(bridge(TRUTH), "Time")
    (run,) = import_logs([table(tmp_path / "a.csv", {"TimeUS": count, **rest})]).runs
    np.testing.assert_allclose(run.columns["t"], T - T[0], atol=1e-6)
    (problem,) = import_logs([table(tmp_path / "b.csv", {"timestamp": count, **rest})]).problems
    assert "numbers without a unit" in problem


@pytest.mark.parametrize(
    ("header", "variation"), [("Heading (M)", None), ("Heading [°M]", None), ("Compass heading [deg]", -7.5)]
)
def test_a_magnetic_heading_needs_the_variation(tmp_path: Path, header: str, variation: float | None) -> None:
    log = {header if name.startswith("Heading") else name: values for name, values in bridge(TRUTH).items()}
    log[header] = np.asarray(log[header]) + 7.5
    path = table(tmp_path / "a.csv", log)
    (problem,) = import_logs([path]).problems
    assert "variation = " in problem and right(path, ImportMap(variation=-7.5))


STYLES = {
    "tabs": ("\t", ".", "{:,.0f}"), "quoted": (",", ".", '"{:,.1f}"'), "German": (";", ",", "{:_.0f}"),
    "with decimals": (";", ",", "{:_.2f}"), "blanks": (";", ".", "{:_.1f}"), "decimals": (";", ",", "{:.3f}"),
}  # fmt: skip


@pytest.mark.parametrize(("separator", "decimal", "form"), STYLES.values(), ids=STYLES)
def test_characters_between_thousands(tmp_path: Path, separator: str, decimal: str, form: str) -> None:
    """Around 1000 rpm, where the writing changes; and decimal commas with three places in all rows."""
    rpm = (990 + 25 * np.sin(T / 20)) / (100 if form == "{:.3f}" else 1)
    cells = [form.format(v).replace(".", decimal) for v in rpm]
    cells = [c.replace("_", "\u202f" if decimal == "." else ".") for c in cells]
    log = {**bridge(TRUTH), "RPM": cells}
    lines = [separator.join(log)]
    for row in zip(*log.values(), strict=True):
        words = [v if isinstance(v, str) else f"{v:.8f}".replace(".", decimal) for v in row]
        lines.append(separator.join(words))
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = imported(tmp_path / "a.csv")
    assert np.abs(found.runs[0].columns["n"] - rpm / 60).max() < 0.02


def test_three_places_in_all_columns_are_asked(tmp_path: Path) -> None:
    log = {"north [m]": TRUTH["x"] + 10, "east [m]": TRUTH["y"] + 300}
    lines = ["\t".join(["time", *log])]
    rows = zip(times("%Y-%m-%dT%H:%M:%S"), *log.values(), strict=True)
    lines += ["\t".join([when, *(f"{v:.3f}".replace(".", ",") for v in row)]) for when, *row in rows]
    path = tmp_path / "a.txt"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert {given.decimal for given in answers(path)} == {".", ","}


BOOKS: dict[str, tuple[list[list[str | None]], bool]] = {
    "two lines of headers": ([
        ["Time", "Position", None, "Speed", None, "Heading", "Shaft", "Rudder"],
        [None, "Latitude", "Longitude", "SOG [kn]", "COG [deg]", "true [deg]", "RPM", "actual [deg]"]], False),
    "groups, names and units": ([
        ["Trial 7", None, None, None, None, None, None, None],
        ["Zeit", "Position", None, "Fahrt", None, "Steuerkurs", "Welle", "Ruder"],
        [None, "Breite", "Länge", "SOG", "COG", None, "Drehzahl", "Ist"],
        [None, "Grad", "Grad", "Knoten", "Grad", "Grad", "U/min", "Grad"]], False),
    "since 1904": ([
        ["Time", "Latitude", "Longitude", "SOG [kn]", "COG [deg]", "Heading [deg]", "RPM", "Rudder [deg]"]], True),
    "Japanese": ([["Time", "Latitude", "Longitude", "SOG", "COG", "Heading", "RPM", "Rudder"],
                  [None, "度", "度", "ノット", "度", "度", "回転/分", "度"]], False),
}  # fmt: skip


def book(path: Path, heads: list[list[str | None]], since_1904: bool = False) -> Any:
    """A workbook of the run, saved at ``path``."""
    openpyxl = pytest.importorskip("openpyxl", reason="needs the extra import")
    from openpyxl.utils.datetime import CALENDAR_MAC_1904

    made = openpyxl.Workbook()
    if since_1904:
        made.epoch = CALENDAR_MAC_1904
    for head in heads:
        made.active.append(head)
    log = bridge(TRUTH)
    stamps = [(BEGIN + datetime.timedelta(seconds=float(t))).replace(tzinfo=None) for t in T]
    for i, when in enumerate(stamps):
        made.active.append([when, *(float(np.asarray(log[name])[i]) for name in list(log)[1:])])
    made.save(path)
    return made


@pytest.mark.slow
@pytest.mark.parametrize(("heads", "since_1904"), BOOKS.values(), ids=BOOKS)
def test_workbooks(tmp_path: Path, heads: list[list[str | None]], since_1904: bool) -> None:
    book(tmp_path / "a.xlsx", heads, since_1904)
    found = import_logs([tmp_path / "a.xlsx"])
    assert right(tmp_path / "a.xlsx") and found.runs[0].day == "2026-05-04"


@pytest.mark.slow
def test_hidden_sheets_are_left_out_and_formulas_without_a_value_named(tmp_path: Path) -> None:
    path = tmp_path / "a.xlsx"
    made = book(path, BOOKS["since 1904"][0])
    made.copy_worksheet(made.active).sheet_state = "hidden"
    made.save(path)
    found = imported(path)
    assert len(found.runs) == 1 and right(path) and {"hidden_sheets"} <= codes(found)
    made.active["G5"] = "=2*3"
    made.save(path)
    (problem,) = import_logs([path]).problems
    assert "cell G5" in problem


def test_every_column_is_accounted_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = {"Rudder order [deg]": [1.0] * N, "STW [kn]": [2.0] * N, "Mood": ["good"] * N, "Heading Status": ["A"] * N}
    path = table(tmp_path / "a.csv", {**bridge(TRUTH), **more})
    assert main(["import", str(path), "--out", str(tmp_path / "out"), "--json"]) == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    used = {row["what"]: (row["used_as"], bool(row["why"])) for row in run["account"]}
    assert set(used) == {name.split(" [")[0] for name in [*bridge(TRUTH), *more]}
    assert used["RPM"] == (["n"], False)
    assert used["Rudder order"] == (["delta_order"], False)
    assert all(used[name] == ([], True) for name in ("STW", "Mood", "Heading Status"))
    assert "# a.csv: Mood" in (tmp_path / "out" / "import.toml").read_text(encoding="utf-8")


def test_a_header_of_the_map_that_no_file_has_is_a_problem(tmp_path: Path) -> None:
    """Else a misspelt wind would be calm air, without a word."""
    given = chosen(columns={"wind_speed": "True wind (m/s)"})
    calm = table(tmp_path / "a.csv", bridge(TRUTH))
    (problem,) = import_logs([calm], given).problems
    assert "wind_speed" in problem and "'True wind (m/s)'" in problem
    windy = table(tmp_path / "b.csv", {**bridge(TRUTH), "True wind (m/s)": [5.0] * N})
    assert import_logs([calm, windy], given).problems == ()


def test_winds_by_their_reference(tmp_path: Path) -> None:
    """Rows of relative and of true wind in turns, as MWV gives them."""
    true = np.arange(N) % 2 == 1
    angle = np.where(true, np.degrees(1.0 - TRUTH["psi"]) % 360, 20.0)
    log = {**bridge(TRUTH), "Wind Angle [deg]": angle, "Wind Speed [kn]": np.where(true, 10.0, 12.0)}
    path = table(tmp_path / "a.csv", {**log, "Wind Reference": np.where(true, "T", "R")})
    write_import(import_logs([path]), ImportMap(), tmp_path / "out")
    run = import_logs([path], read_map(tmp_path / "out" / "import.toml")).runs[0].columns
    assert np.nanmax(np.abs(run["wind_direction"] - 1.0)) < 0.01
    assert np.nanmax(np.abs(run["apparent_wind_direction"] - np.radians(20))) < 1e-9
    assert np.nanmax(run["wind_speed"]) < np.nanmin(run["apparent_wind_speed"])


PORT = ImportMap(rudder_positive="port")


@pytest.fixture
def pieces(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Makes every log of text a large one, of which at most so many rows are kept."""

    def limit(rows: int = 10**6) -> None:
        monkeypatch.setattr("cases.io.text_table.MOST_KEPT", rows)
        monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)

    return limit


def commas(path: Path, *_: object) -> Path:
    """Times of a day over midnight, a date in a column of its own, comments, a sentinel, numbers in quotation marks."""
    truth = TRUTH
    lines = ["# logger", "time,date,north [m],east [m],heading [deg],u,v,r [rad/s],shaft [rpm],rudder [deg],ship"]
    lines.append("# end")
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


def daily(path: Path, *_: object) -> Path:
    """Times of a day without a date."""
    path.write_text(commas(path).read_text().replace("time,date,", "time,Foo,"))
    return path


GIVEN = chosen(columns={c: {"from": name, "unit": unit} for c, name, unit in (
    ("n", "shaft", "rpm"), ("u", "u", "m/s"), ("v", "v", "m/s"))})  # fmt: skip


@pytest.mark.parametrize(
    ("make", "given"),
    [(raw_logs.semicolons, PORT), (commas, GIVEN), (daily, GIVEN), (lambda path, _: plain(path, UNITS), ImportMap())],
)
def test_a_log_read_in_pieces_is_that_read_at_once(
    tmp_path: Path, pieces: Callable[..., None], make: Callable[..., Path], given: ImportMap
) -> None:
    path = make(tmp_path / "zigzag.csv", TRUTH)
    found = [imported(path, given)]
    pieces()
    found.append(imported(path, given))
    one, two = (f.runs[0] for f in found)
    assert sorted(map(str, one.notices)) == sorted(map(str, two.notices))
    assert one.day == two.day and one.std == pytest.approx(two.std, rel=1e-6)
    assert set(one.logs[0].unknown) == set(two.logs[0].unknown)
    for name, values in one.columns.items():
        assert np.allclose(values, two.columns[name], rtol=0, atol=1e-9, equal_nan=True), name
    files = [write_import(f, given, tmp_path / str(i))[0].parent / "import.toml" for i, f in enumerate(found)]
    assert files[0].read_text() == files[1].read_text()


def test_means_of_rows_of_a_log_hold_no_number_for_nothing(tmp_path: Path, pieces: Callable[..., None]) -> None:
    pieces(100)
    run = imported(commas(tmp_path / "a.csv"), GIVEN).runs[0]
    t = run.columns["t"]
    assert 85 < len(t) <= 100
    middle = 0.75  # s: the mean of the first four rows
    inside = slice(3, -3)
    for name, least in {"x": 0.1, "y": 0.1, "u": 0.03, "v": 0.03, "r": 4e-3, "n": 1e-3}.items():
        off = (run.columns[name] - np.interp(t + middle, T, TRUTH[name]))[inside]
        assert np.abs(off).max() < least, (name, np.abs(off).max())
    turned = run.columns["psi"] - np.interp(t + middle, T, TRUTH.psi_unwrapped)
    assert np.abs(np.angle(np.exp(1j * turned)))[inside].max() < 5e-3
    assert np.abs(run.columns["delta"]).max() < 0.7 and any("-999" in m for m in run.notices)


def test_a_last_line_that_is_cut_off_is_left_out(tmp_path: Path, pieces: Callable[..., None]) -> None:
    """Also where the cut leaves a number that is no number, or another one, and of a log that is read in pieces."""
    path = raw_logs.semicolons(tmp_path / "a.csv", TRUTH)
    content = path.read_bytes()
    for cut, large in ((30, False), (40, False), (47, False), (60, False), (60, True)):
        path.write_bytes(content[:-cut])
        if large:
            pieces()
        found = imported(path, PORT)
        assert len(found.runs[0].columns["t"]) == N - 1 and "last_line_cut" in codes(found)


def late(found: Imported) -> float:
    """About how late or early a channel is at most [s]: its largest error in its fastest changes."""
    wrong = errors(found.runs[0].columns, TRUTH, inside=10.0)
    rates = {c: np.gradient(TRUTH.psi_unwrapped if c == "psi" else TRUTH[c], T) for c in ("psi", "x", "y", "delta")}
    return max(wrong[c] / float(np.abs(rate).max()) for c, rate in rates.items())


@pytest.mark.parametrize("tick", [1.0, 2.0])
def test_rows_of_one_coarse_stamp_are_samples_of_it(tmp_path: Path, tick: float) -> None:
    """No channel is late against another, and the steps are those of the logger."""
    times = [stamp(tick * np.floor(t / tick)) for t in T]
    found = imported(table(tmp_path / "a.csv", {**bridge(TRUTH), "Time": times}))
    assert late(found) < 0.1
    assert np.diff(found.runs[0].columns["t"]) == pytest.approx(0.5) and "time_spread" in codes(found)


def test_a_missing_row_and_a_gap_leave_the_others_in_their_second(tmp_path: Path) -> None:
    """Also where the log begins within a second, and goes on within one after a pause."""
    keep = np.ones(N, bool)
    keep[[0, 101, *range(160, 167)]] = False
    times = [stamp(np.floor(t / 2) * 2) for t in T]
    found = imported(table(tmp_path / "a.csv", {**bridge(TRUTH), "Time": times}, keep))
    t = found.runs[0].columns["t"] + 0.5  # the first row was that of half a second
    psi = np.interp(t, T, TRUTH.psi_unwrapped)
    off = np.abs(np.angle(np.exp(1j * (found.runs[0].columns["psi"] - psi))))
    assert np.nanmax(off) < 0.5 * np.abs(np.diff(TRUTH.psi_unwrapped)).max() * 1.4


def test_rows_that_were_written_twice_are_one(tmp_path: Path) -> None:
    columns = {name: np.repeat(values, 2) for name, values in bridge(TRUTH).items()}
    found = imported(table(tmp_path / "a.csv", columns))
    assert late(found) < 0.05
    assert len(found.runs[0].columns["t"]) == N and "time_repeated" in codes(found)


@pytest.mark.parametrize("pod", ["azimuth_2", "Heading"])
def test_directions_of_the_same_time_on_both_sides_of_north_have_a_mean_there(tmp_path: Path, pod: str) -> None:
    """One row in a log was written twice, with 359 and 1 deg."""
    columns = {**bridge(TRUTH), "n_azimuth_2 [rps]": TRUTH["n"], "azimuth_2 [deg]": np.full(N, 359.0)}
    columns[f"{pod} [deg]"] = np.full(N, 359.0)
    columns = {name: np.insert(np.array(values, dtype=object), 51, values[50]) for name, values in columns.items()}
    columns[f"{pod} [deg]"][51] = 1.0
    found = imported(table(tmp_path / "a.csv", columns))
    values = found.runs[0].columns["psi" if pod == "Heading" else pod]
    assert np.cos(values).min() > np.cos(np.radians(1.01)) and values[50] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("zones", [("+00:00", ""), ("", "+09:00")], ids=["Z, then none", "none, then +09:00"])
@pytest.mark.parametrize("large", [False, True])
def test_stamps_with_and_without_a_zone_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zones: tuple[str, str], large: bool
) -> None:
    if large:
        monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)
    hours = {"+00:00": 0, "+09:00": 9, "": 9}
    stamps = ((t, zones[i >= 180]) for i, t in enumerate(T))
    times = [stamp(t + 3600 * hours[zone])[:-6] + zone for t, zone in stamps]
    path = table(tmp_path / "a.csv", {**bridge(TRUTH), "Time": times})
    for given in (ImportMap(), ImportMap(zone_hours=9.0)):
        assert len(import_logs([path], given).problems) == 1


@pytest.mark.parametrize("dated", [True, False])
@pytest.mark.parametrize("form", ["%I:%M:%S %p", "%I:%M:%S.%fpm"])
def test_times_of_twelve_hours_stand_in_a_column_of_their_own(tmp_path: Path, dated: bool, form: str) -> None:
    """From before noon until after it."""
    begin = datetime.datetime(2026, 5, 14, 11, 59, 0)
    when = [begin + datetime.timedelta(seconds=float(t - T[0])) for t in T]
    half = [w.strftime("%p").lower()[0] for w in when]
    times = [w.strftime(form.replace("pm", f" {h}.m.")) for w, h in zip(when, half, strict=True)]
    columns = {**bridge(TRUTH), "Time": times} | ({"Date": [w.strftime("%m/%d/%Y") for w in when]} if dated else {})
    found = imported(table(tmp_path / "a.csv", columns))
    assert late(found) < 0.6 and "clock_jump" not in codes(found)
    assert found.runs[0].columns["t"][-1] == pytest.approx(TRUTH.duration, abs=1.0)


PODS = [
    ("azimuth", "azimuth_2", "n_azimuth", "n_azimuth_2"),
    ("azimuth", "azimuth_3", "n_azimuth", "n_azimuth_3"),
    ("azimuth_stbd", "azimuth_port", "n_azimuth_stbd", "n_azimuth_port"),
    ("Pod angle stbd", "Pod angle port", "Pod speed stbd", "Pod speed port"),
]


@pytest.mark.parametrize("pods", PODS, ids=[pods[1] for pods in PODS])
@pytest.mark.parametrize("unit", [" [deg]", ""])
def test_pods_and_winds_go_the_short_way_between_samples(tmp_path: Path, pods: tuple[str, ...], unit: str) -> None:
    """They are logged every 4 s beside a heading every half second."""
    angle = 355.0 + 15.0 * np.sin(T / 12)
    wrapped, n = angle % 360, TRUTH["n"]
    log = bridge(TRUTH)
    nav = {name: log[name] for name in ("Time", "Latitude", "Longitude", "SOG [kn]", "COG [deg]", "Heading [deg]")}
    slow = {"Time": [stamp(t) for t in T], f"{pods[0]}{unit}": wrapped, f"{pods[1]}{unit}": wrapped}
    slow |= {f"{pods[2]} [rps]": n, f"{pods[3]} [rps]": n}
    slow |= {"True wind speed [m/s]": np.full(len(n), 4.0), f"True wind direction{unit}": wrapped}
    slow |= {"AWS [m/s]": np.full(len(n), 5.0), f"AWA{unit}": wrapped}
    table(tmp_path / "nav.csv", nav)
    table(tmp_path / "pods.csv", slow, np.arange(len(n)) % 8 == 0)
    found = imported(tmp_path)
    columns = found.runs[0].columns
    second = "azimuth_3" if "3" in pods[1] else "azimuth_2"
    true = np.radians(np.interp(columns["t"], T, angle))
    for name in ("azimuth", second, "wind_direction", "apparent_wind_direction"):
        assert np.cos(columns[name] - true).min() > np.cos(np.radians(1.0)), name
        assert columns[name].max() - columns[name].min() <= 2 * np.pi and np.abs(columns[name]).max() < 2 * np.pi, name


def test_a_position_over_the_date_line_stays_there(tmp_path: Path) -> None:
    log = bridge(raw_logs.run("turning:35"), (-17.0, 179.99995))
    log["Longitude"] = (np.asarray(log["Longitude"], dtype=float) + 180) % 360 - 180
    split = ("Time", "Latitude", "Longitude", "SOG [kn]", "COG [deg]")
    table(tmp_path / "gnss.csv", {name: log[name] for name in split}, np.arange(len(log["Time"])) % 4 == 3)
    table(tmp_path / "bridge.csv", {name: v for name, v in log.items() if name not in split[1:]})
    y = imported(tmp_path).runs[0].columns["y"]
    assert np.abs(y).max() < 100 and np.isfinite(y).mean() > 0.9
