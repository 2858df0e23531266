"""Trial files: read where their meaning is clear, with what was converted said; else refused in one line, soon."""

from __future__ import annotations

import decimal
import hashlib
import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cases.checks import check
from cases.io.conventions import heading_and_rate, mislabelled
from cases.io.files import LARGEST, lines_and_hash, parse_json, read_json
from cases.io.read import read_controls, read_trial, read_trials
from cases.io.text_table import LONGEST_LINE
from cases.io.trial_table import MOST_ROWS, trial_table
from cases.quantities import UNITS
from cases.shipfiles.ship_file import load_ship
from fitting.nlp.captive import read_captive
from mmg.errors import BadValue, Missing, OutOfRange, UnknownName, UserError
from mmg.messages import has_code
from mmg.motion.frames import apparent_wind
from tests.support.trial_files import motion_columns, write_csv

DEG = np.pi / 180
TRUTH = motion_columns(20.0)
NOTHING = np.full(len(TRUTH["t"]), np.nan)
NAMES = ("t [s]", "x [m]", "y [m]", "psi [rad]", "u [m/s]", "v [m/s]", "r [rad/s]", "n [rps]", "delta [rad]")
Make = Callable[[Path], object]


@pytest.fixture
def good(tmp_path: Path) -> Path:
    return write_csv(tmp_path / "good.csv")


def frame() -> pd.DataFrame:
    return pd.DataFrame({name: TRUTH[name.split()[0]] for name in NAMES})


def refused(path: Path, said: str, *reads: Callable[[Path], object]) -> str:
    """The line by which those functions refuse a file, or else both that read a trial and controls."""
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for read in reads or (read_trial, read_controls):
            with pytest.raises(UserError, match=said) as error:
                read(path)
            assert "\n" not in str(error.value) and len(str(error.value)) < 1000
    assert time.perf_counter() - began < 10
    return str(error.value)


def csv(headers: dict[str, str] | None = None, rows: int = 200, **changed: np.ndarray) -> Make:
    """Writes the good columns, but those that are ``changed``."""
    return lambda path: write_csv(path, {**TRUTH, **changed}, headers, rows)


def without(name: str, **more: np.ndarray) -> Make:
    return lambda path: write_csv(path, {k: v for k, v in {**TRUTH, **more}.items() if k != name})


def cell(line: int, column: int, text: str) -> Make:
    """Writes a text into one cell of the good file; line 0 is the header."""

    def make(path: Path) -> None:
        rows = [row.split(",") for row in write_csv(path).read_text().splitlines()]
        rows[line][column] = text
        path.write_text("\n".join(",".join(row) for row in rows) + "\n")

    return make


def text(change: Callable[[str], str]) -> Make:
    return lambda path: path.write_text(change(write_csv(path).read_text()))


# Fault -> how its file is written, and what is said
FAULTS: dict[str, tuple[Make, str]] = {
    "a word": (cell(17, 4, "fast"), r"row 17, column 'u \[m/s\]': 'fast' is not a number"),
    "a time twice": (cell(6, 0, "0.4"), "repeats at row 6"),
    "a time earlier": (cell(6, 0, "0.2"), "runs backwards at row 6"),
    "a clock that begins anew": (cell(151, 0, "3.0"), "backwards at row 151: t = 14.9 s, then 3 s"),
    "1e14 m/s": (cell(151, 4, "1e14"), r"row 151, column 'u \[m/s\]': 1e\+14 is larger"),
    "no unit": (csv({"t": "t"}), "column 't' has no unit"),
    "no turn rate": (without("r"), r"missing column r; found: t .*columns = \{ r ="),
    "one rudder of two": (without("delta", delta_port=TRUTH["delta"]), "missing column delta_starboard"),
    "no number at all": (csv(**dict.fromkeys(TRUTH, NOTHING)), "no row holds a time and a state"),
    "one row": (csv(rows=1), "only one usable row"),
    "no rows": (csv(rows=0), "no rows"),
    "no header": (text(lambda text: text.partition("\n")[2]), "numbers, not headers"),
    "a blank line first": (text(lambda text: f"\n{text}"), "first line is blank"),
    "empty": (text(lambda text: ""), "the file is empty"),
    "no revolutions": (csv(n=NOTHING), "column n holds no number"),
    "a header twice": (csv({"v": "u [m/s]"}), "names 'u .m/s.' twice"),
    "a quantity twice": (csv({"u_velo": "u_velo [m/s]"}, u_velo=TRUTH["u"]), "both 'u .m/s.' and 'u_velo .m/s.' are u"),
    "semicolons": (text(lambda text: text.replace(",", ";")), "not separated by commas"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "said"), FAULTS.values(), ids=FAULTS)
def test_a_wrong_file_is_named_with_what_is_wrong_and_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Make, said: str
) -> None:
    """Read at once, in pieces, and in pieces whose rows are averaged."""
    make(tmp_path / "run.csv")
    for kept, block in ((10**6, 2**21), (10**6, 2000), (50, 2000)):
        monkeypatch.setattr("cases.io.text_table.MOST_KEPT", kept)
        monkeypatch.setattr("cases.io.text_table.BLOCK", block)
        assert "run.csv" in refused(tmp_path / "run.csv", said, read_trial)


def test_canonical_csv_and_parquet_are_read_as_they_are(tmp_path):
    truth = TRUTH
    pd.DataFrame({f"{c} [{UNITS[c]}]": v for c, v in truth.items()}).to_parquet(tmp_path / "run.parquet")
    for path in (write_csv(tmp_path / "run.csv", truth), tmp_path / "run.parquet"):
        trial = read_trial(path)
        assert trial.name == "run" and trial.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
        assert trial.notices == ()
        for name, values in truth.items():
            np.testing.assert_allclose(trial[name], values, rtol=1e-12, atol=1e-15)


def test_an_optional_column_without_numbers_is_left_out(tmp_path: Path) -> None:
    csv(wind_speed=NOTHING)(tmp_path / "b.csv")
    trial = read_trial(tmp_path / "b.csv")
    assert not trial.has_wind and has_code(trial.notices, "no_wind")


def test_what_is_no_trial_file_is_refused(tmp_path: Path) -> None:
    for name in ("run.xlsx", "run.parquet"):
        (tmp_path / name).write_text("x")
    refused(tmp_path / "nowhere.csv", "no such file", read_trial)
    refused(tmp_path / "run.xlsx", "expected .csv or .parquet", read_trial)
    refused(tmp_path / "run.parquet", "not a readable Parquet", read_trial)
    (tmp_path / "folder").mkdir()
    refused(tmp_path / "folder", r"no \.csv", read_trials)


def test_nan_ends_are_cut_and_inner_rows_kept_as_gaps(tmp_path):
    columns = {name: values.copy() for name, values in motion_columns(20.0).items()}
    for values in columns.values():
        values[-30:] = values[:4] = np.nan
    columns["u"][50:60] = np.nan
    trial = read_trial(write_csv(tmp_path / "run.csv", columns))
    assert len(trial) == 200 - 34 and np.isnan(trial["u"]).sum() == 10
    assert trial.meta["rows_before"] == "4"
    said = " ".join(trial.notices)
    assert "first 4 of 200" in said and "last 30 of 200" in said and "10 of 166" in said


def test_uneven_sampling_and_a_late_clock_are_fine(tmp_path):
    columns = motion_columns(60.0)
    rng = np.random.default_rng(1)
    keep = np.sort(rng.choice(len(columns["t"]), 300, replace=False))
    columns = {name: values[keep] for name, values in columns.items()}
    columns["t"] = columns["t"] + 1894.0
    trial = read_trial(write_csv(tmp_path / "run.csv", columns, rows=None))
    assert len(trial) == 300 and trial.t[0] >= 1894.0 and has_code(trial.notices, "clock_offset")


def test_twin_rudders_stand_for_delta(tmp_path: Path) -> None:
    without("delta", delta_port=TRUTH["delta"], delta_starboard=0.5 * TRUTH["delta"])(tmp_path / "a.csv")
    assert "delta_port" in read_trial(tmp_path / "a.csv")


def test_unknown_columns_are_ignored_with_a_notice(tmp_path):
    columns = {**motion_columns(20.0), "roll": np.zeros(200)}
    trial = read_trial(write_csv(tmp_path / "run.csv", columns, {"roll": "roll [rad]"}))
    assert "roll" not in trial and any("roll [rad]" in notice for notice in trial.notices)


def test_true_wind_follows_from_the_apparent_one_with_a_notice(tmp_path):
    truth = motion_columns(20.0)
    speed, angle = apparent_wind(*(truth[c] for c in ("wind_speed", "wind_direction", "psi", "u", "v")))
    columns = {c: v for c, v in truth.items() if not c.startswith("wind")}
    columns.update(apparent_wind_speed=speed, apparent_wind_direction=angle)
    trial = read_trial(write_csv(tmp_path / "run.csv", columns))
    np.testing.assert_allclose(trial["wind_speed"], truth["wind_speed"], rtol=1e-9)
    np.testing.assert_allclose(trial["wind_direction"], truth["wind_direction"], rtol=1e-9)
    assert any("derived" in notice for notice in trial.notices)


@pytest.mark.parametrize(
    ("column", "factor"), [("psi", 1 / DEG), ("psi", DEG), ("r", 1 / DEG), ("r", DEG), ("delta", 1 / DEG)]
)
def test_degrees_passed_off_as_radians_are_read_and_contradictory(tmp_path, column, factor):
    columns = motion_columns(60.0)
    columns[column] = columns[column] * factor
    trial = read_trial(write_csv(tmp_path / "run.csv", columns, rows=None))
    report = check([trial])[0]
    assert report.verdict == "contradictory" and {f.code for f in report.findings} >= {"unit"}
    assert (heading_and_rate(trial.columns) != "") == (column != "delta")  # of logs that are too long for a check
    if column == "delta":
        with pytest.raises(UserError, match=r"delta reaches .* degrees labelled rad"):
            read_controls(tmp_path / "run.csv")


def test_vectwin_rudders_and_many_turns_are_plausible():
    columns = motion_columns(300.0)
    columns["psi"] = columns["psi"] + 0.5 * columns["t"]
    columns["r"] = columns["r"] + 0.5
    columns["delta"] = columns["delta"] * (105 * DEG / np.abs(columns["delta"]).max())
    speed, angle = apparent_wind(*(columns[c] for c in ("wind_speed", "wind_direction", "psi", "u", "v")))
    columns |= {"apparent_wind_speed": speed, "apparent_wind_direction": np.unwrap(angle)}
    assert np.abs(columns["apparent_wind_direction"]).max() > 4 * np.pi
    assert mislabelled(columns) == [] and heading_and_rate(columns) == ""
    assert mislabelled({**columns, "apparent_wind_direction": angle / DEG}) != []


@pytest.mark.data
def test_every_real_record_is_read_and_the_nan_tail_cut(frt):
    trials = {trial.name: trial for trial in read_trials(frt)}
    assert len(trials) == 35
    tail = trials["zigzag_31-Jul-2020_13_50_28"]
    assert len(tail) == 2028 - 327 and any("last 327 of 2028" in notice for notice in tail.notices)
    assert trials["random_06-Aug-2020_16_24_25_4"].t[0] == pytest.approx(1894.0)
    assert all(trial.has_wind and trial.has_position for trial in trials.values())


@pytest.mark.slow
@pytest.mark.data
def test_of_real_records_a_wrong_angle_unit_shows(frt):
    for trial in read_trials(frt):
        assert heading_and_rate(trial.columns) == "" and mislabelled(trial.columns) == [], trial.name
        for column in ("psi", "r"):
            assert heading_and_rate({**trial.columns, column: trial[column] / DEG}), (trial.name, column)
        assert mislabelled({**trial.columns, "delta": trial["delta"] / DEG}), trial.name


def test_all_that_is_wrong_in_a_folder_is_said(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        write_csv(tmp_path / f"{name}.csv")
    for name, unit in (("a", "grad"), ("c", "turns")):
        text = (tmp_path / f"{name}.csv").read_text()
        (tmp_path / f"{name}.csv").write_text(text.replace("psi [rad]", f"psi [{unit}]"))
    with pytest.raises(UserError, match=r"2 of 3.*a.csv.*'grad'.*c.csv.*'turns'"):
        read_trials(tmp_path)


@pytest.mark.skipif(os.name == "nt", reason="makes a FIFO")
def test_a_pipe_or_device_is_no_trial(tmp_path: Path, good: Path) -> None:
    for name in ("pipe.csv", "pipe.parquet", "trials.toml"):
        os.mkfifo(tmp_path / name)
    refused(tmp_path / "pipe.csv", "not an ordinary file")
    refused(tmp_path / "pipe.parquet", "not an ordinary file")
    refused(Path("/dev/null"), "/dev/null")
    with pytest.raises(BadValue):
        read_trials(tmp_path)
    with pytest.raises(UserError, match=r"trials\.toml"):
        read_trial(good)
    with pytest.raises(UnknownName):
        load_ship(tmp_path / "trials.toml")
    with pytest.raises(BadValue):
        read_captive(tmp_path / "pipe.csv")


def test_a_folder_named_as_a_trial_hides_no_neighbour(tmp_path: Path, good: Path) -> None:
    (tmp_path / "x.csv").mkdir()
    assert [trial.name for trial in read_trials(tmp_path)] == ["good"]
    refused(tmp_path / "x.csv", "is a folder")
    (tmp_path / "deep" / "y.csv").mkdir(parents=True)
    write_csv(tmp_path / "deep" / "y.csv" / "inside.csv")
    assert [trial.name for trial in read_trials(tmp_path / "deep")] == ["inside"]


def test_names_that_no_file_can_have(tmp_path: Path) -> None:
    refused(tmp_path / ("a" * 300 + ".csv"), "cannot be read")
    refused(Path("a\0b.csv"), "a.*b")
    with pytest.raises(UserError):
        read_trials([tmp_path / ("a" * 300)])


@pytest.mark.parametrize("end", ["\r", "\r\n", "\n"])
def test_line_ends_of_any_system(good: Path, end: str) -> None:
    expected = read_trial(good)
    good.write_bytes(good.read_text().replace("\n", end).encode())
    np.testing.assert_array_equal(read_trial(good).states, expected.states)


@pytest.mark.parametrize(
    ("cell", "words"),
    [("7" * 130_000, "row 3"), ("x" * 130_000, "row 3"), ("9" * 400, "row 3"), ("1e300", "larger than anything"),
     ("-1e300", "larger than anything"), ("1_0", "'1_0'"), ("\x1b[2J", "\\x1b[2J")],
)  # fmt: skip
def test_cells_that_are_no_measurement(good: Path, cell: str, words: str) -> None:
    """As the third value of the surge velocity; and in the header."""
    lines = good.read_text().splitlines()
    cells = lines[3].split(",")
    cells[4] = cell
    good.write_text("\n".join([*lines[:3], ",".join(cells), *lines[4:]]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            trial = read_trial(good)
        except UserError as error:
            assert words in str(error) and len(str(error)) < 400
        else:
            assert np.isnan(trial["u"][2]) and cell.isdigit()
    good.write_text("\n".join([lines[0].replace("u [m/s]", f"{cell} [m/s]"), *lines[1:]]))
    with pytest.raises(Missing):
        read_trial(good)


@pytest.mark.parametrize("factor", [1e-310, 1e-9, 1e300, 1e306])
def test_times_of_no_clock(good: Path, factor: float) -> None:
    columns = motion_columns(20.0)
    with np.errstate(all="ignore"):
        write_csv(good, {**columns, "t": columns["t"] * factor})
    refused(good, "good.csv")


def test_encodings_are_named(good: Path) -> None:
    text = good.read_text()
    good.write_bytes(text.encode("utf-16"))
    assert len(read_trial(good)) == 200
    good.write_bytes(text.encode("utf-8-sig"))
    assert len(read_trial(good)) == 200
    good.write_bytes(text.encode("utf-32"))
    refused(good, "good")
    sidecar = good.with_name("trials.toml")
    good.write_text(text)
    sidecar.write_bytes('[default]\nkind = "zigzag"\n'.encode("utf-16"))
    refused(good, r"trials\.toml.*UTF-16.*save it in UTF-8")
    sidecar.write_bytes('[default]\nkind = "zigzag"\n'.encode("utf-8-sig"))
    assert read_trial(good).kind == "zigzag"


def test_parquet_is_read_where_its_meaning_is_clear(tmp_path: Path) -> None:
    path, plain = tmp_path / "a.parquet", frame()
    plain.to_parquet(path)
    expected = read_trial(path).states
    seconds = plain["t [s]"]
    passed = pd.to_timedelta(seconds, unit="s")
    for t in (passed, pd.Timestamp("2026-11-22 13:00") + passed):
        plain.assign(**{"t [s]": t}).to_parquet(path)
        trial = read_trial(path)
        np.testing.assert_allclose(trial.t, seconds, atol=1e-6)
        np.testing.assert_array_equal(trial.states, expected)
    plain.assign(**{"u [m/s]": plain["u [m/s]"].map(lambda v: decimal.Decimal(repr(v)))}).to_parquet(path)
    np.testing.assert_allclose(read_trial(path).states, expected, rtol=1e-12)


def test_parquet_columns_of_no_clear_meaning_are_named(tmp_path: Path) -> None:
    path, plain = tmp_path / "a.parquet", frame()
    u = plain["u [m/s]"]
    times = pd.to_timedelta(u, unit="s")
    cells = [u.map(change) for change in (lambda v: [v], lambda v: {"a": v}, lambda v: b"1", str)]
    for values in (times, pd.Timestamp("2026-11-22") + times, u > 0, *cells):
        plain.assign(**{"u [m/s]": values}).to_parquet(path)
        refused(path, r"column 'u \[m/s\]'")


def test_a_parquet_bomb_is_refused(tmp_path: Path) -> None:
    """A hundred million equal rows are a file of a few kilobytes."""
    chunk = pa.table({name: pa.array(np.zeros(1_000_000)) for name in NAMES[:1]})
    with pq.ParquetWriter(tmp_path / "a.parquet", chunk.schema, compression="zstd") as writer:
        for _ in range(30):
            writer.write_table(chunk)
    refused(tmp_path / "a.parquet", "rows, more than")


def test_rows_are_counted_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_bytes(b"t [s],u [m/s]\n" + b"1,x\n" * (MOST_ROWS + 1))
    with pytest.raises(OutOfRange, match=f"has {MOST_ROWS + 1} rows, more than {MOST_ROWS}"):
        trial_table(path).numbers([0])


def test_a_row_with_too_many_cells_is_told_wherever_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cases.io.text_table.BLOCK", 12)
    rows = [b"t [s],u [m/s]", *(b"%d,1" % k for k in range(8))]
    for at in range(2, 9):
        content = b"\n".join([*rows[:at], rows[at] + b",7,8", *rows[at + 1 :]])
        (tmp_path / "a.csv").write_bytes(content)
        with pytest.raises(BadValue, match=f"line {at + 1} has 4 cells, the header 2"):
            trial_table(tmp_path / "a.csv").numbers([0])


def test_lines_and_cells_are_counted_before_they_are_parsed(tmp_path: Path) -> None:
    path, head = tmp_path / "a.csv", b"t [s],u [m/s]\n"
    path.write_bytes(head + b"1,2\n" * 3 + b"7" * (LONGEST_LINE + 1))
    with pytest.raises(OutOfRange, match=f"a line is longer than {LONGEST_LINE} bytes"):
        trial_table(path).numbers([0])
    for content, count in ((b"a\r\nb\r\nc", 3), (b"a\nb\nc\n", 3), (b"a\rb\r", 2), (b"a", 1), (b"a\n\n", 2)):
        path.write_bytes(content)
        assert lines_and_hash(path)[0] == count, content


def test_what_is_too_wide_or_noise_is_refused_at_once(tmp_path: Path) -> None:
    """A gigabyte unread, a million columns in a line."""
    path = tmp_path / "noise.csv"
    path.write_text(",".join(f"c{i}" for i in range(1_000_000)) + "\n1\n")
    refused(path, "line is longer")
    path.write_text(",".join("c" * 5001) + "\n1\n")
    refused(path, "5001 columns")
    path.write_bytes(np.random.default_rng(1).bytes(3_000_000))
    refused(path, "noise.csv")
    os.truncate(path, 0)
    os.truncate(path, LARGEST + 1)
    refused(path, "is no text")


@pytest.mark.parametrize("text", ["[" * 200_000, "[]", '"x"', "3", "null", "", "{", "\x00", '{"a": ' * 90_000])
def test_json_that_is_no_object(tmp_path: Path, text: str) -> None:
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(UserError, match=r"result\.json"):
        read_json(tmp_path / "result.json")
    if len(text) > 1000:
        with pytest.raises(ValueError, match="nested"):
            parse_json(text)
