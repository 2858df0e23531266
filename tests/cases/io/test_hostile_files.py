"""Files that are damaged, huge, of another kind or made to harm: read where their meaning is clear, else one line."""

from __future__ import annotations

import decimal
import os
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.fuzz.damage import numbered
from cases.io.files import LARGEST, lines_and_hash, parse_json, read_json
from cases.io.read import read_controls, read_trial, read_trials
from cases.io.text_table import LONGEST_LINE
from cases.io.trial_table import MOST_ROWS, MOST_UNPACKED, trial_table
from cases.shipfiles.ship_file import load_ship
from fitting.nlp.captive import read_captive
from mmg.errors import BadValue, Missing, OutOfRange, UnknownName, UserError
from tests.support.trial_files import motion_columns, write_csv

NAMES = ("t [s]", "x [m]", "y [m]", "psi [rad]", "u [m/s]", "v [m/s]", "r [rad/s]", "n [rps]", "delta [rad]")


@pytest.fixture
def good(tmp_path: Path) -> Path:
    return write_csv(tmp_path / "good.csv")


def frame() -> pd.DataFrame:
    return pd.DataFrame({name: motion_columns(20.0)[name.split()[0]] for name in NAMES})


def refused(path: Path, *words: str) -> None:
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for read in (read_trial, read_controls):
            with pytest.raises(UserError) as error:
                read(path)
            assert "\n" not in str(error.value) and len(str(error.value)) < 1000
    assert all(word in str(error.value) for word in words), error.value
    assert time.perf_counter() - began < 10


@pytest.mark.skipif(os.name == "nt", reason="makes a FIFO")
def test_a_pipe_or_device_is_no_trial(tmp_path: Path, good: Path) -> None:
    for name in ("pipe.csv", "pipe.parquet", "trials.toml"):
        os.mkfifo(tmp_path / name)
    refused(tmp_path / "pipe.csv", "not an ordinary file")
    refused(tmp_path / "pipe.parquet", "not an ordinary file")
    refused(Path("/dev/null"), "")
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
    refused(Path("a\0b.csv"), "")
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
    refused(good, "")
    sidecar = good.with_name("trials.toml")
    good.write_text(text)
    sidecar.write_bytes('[default]\nkind = "zigzag"\n'.encode("utf-16"))
    refused(good, "trials.toml", "UTF-16", "save it in UTF-8")
    sidecar.write_bytes('[default]\nkind = "zigzag"\n'.encode("utf-8-sig"))
    assert read_trial(good).kind == "zigzag"


@pytest.mark.parametrize(
    "text",
    [
        "reference_point = {x = nan, y = 0.0}",
        "reference_point = {x = 1e300, y = 0.0}",
        "reference_point = {x = inf, y = 0.0}",
        f"reference_point = {{x = {'9' * 5000}, y = 0.0}}",
        f"reference_point = {{x = {'9' * 4000}, y = 0.0}}",
        f"sign = {{u = {'9' * 4000}}}",
        f"kind = {'[' * 3000}{']' * 3000}",
        f"kind = {'[' * 400}{']' * 400}",
        f"kind = {'{a = ' * 400}1{'}' * 400}",
        'name = "\\u0000"',
    ],
)
def test_a_sidecar_of_no_sense(good: Path, text: str) -> None:
    good.with_name("trials.toml").write_text(f"[default]\n{text}\n")
    refused(good, "trials.toml")


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
    for change in (lambda v: str(v), lambda v: decimal.Decimal(repr(v))):
        plain.assign(**{"u [m/s]": plain["u [m/s]"].map(change)}).to_parquet(path)
        np.testing.assert_allclose(read_trial(path).states, expected, rtol=1e-12)


def test_parquet_columns_of_no_clear_meaning_are_named(tmp_path: Path) -> None:
    path, plain = tmp_path / "a.parquet", frame()
    u = plain["u [m/s]"]
    times = pd.to_timedelta(u, unit="s")
    cells = [u.map(change) for change in (lambda v: [v], lambda v: {"a": v}, lambda v: b"1", lambda v: "fast")]
    for values in (times, pd.Timestamp("2026-11-22") + times, u > 0, *cells):
        plain.assign(**{"u [m/s]": values}).to_parquet(path)
        refused(path, "column 'u [m/s]'")


def test_a_parquet_bomb_is_refused(tmp_path: Path) -> None:
    """A hundred million equal rows are a file of a few kilobytes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    chunk = pa.table({name: pa.array(np.zeros(1_000_000)) for name in NAMES[:1]})
    with pq.ParquetWriter(tmp_path / "a.parquet", chunk.schema, compression="zstd") as writer:
        for _ in range(30):
            writer.write_table(chunk)
    refused(tmp_path / "a.parquet", "rows, more than")


def test_a_small_parquet_of_long_texts_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path, plain = tmp_path / "a.parquet", pa.Table.from_pandas(frame())
    at, N = plain.column_names.index("u [m/s]"), plain.num_rows
    texts = pa.DictionaryArray.from_arrays(pa.array(np.zeros(N, dtype=np.int32)), pa.array(["1" * 10_000_000]))
    pq.write_table(plain.set_column(at, "u [m/s]", texts), path, compression="zstd")
    assert path.stat().st_size < 50_000
    refused(path, "column 'u [m/s]' holds a text of 10000000 characters")
    most = MOST_UNPACKED // 50
    monkeypatch.setattr("cases.io.trial_table.MOST_UNPACKED", most)
    wide = pa.array([text := "7" * (most // N + 1)] * N)
    pq.write_table(plain.set_column(at, "u [m/s]", wide), path, compression="zstd", use_dictionary=False)
    assert path.stat().st_size < 100_000 and len(text) * N > most
    refused(path, "MB unpacked, more than")


def test_rows_are_counted_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_bytes(b"t [s],u [m/s]\n" + b"1,x\n" * (MOST_ROWS + 1))
    with pytest.raises(OutOfRange, match=f"has {MOST_ROWS + 1} rows, more than {MOST_ROWS}"):
        trial_table(path).numbers([0])


@pytest.mark.slow
def test_pieces_of_a_file_are_read_as_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    write_csv(path)
    seed, refused_both, read_both = b"\n".join(path.read_bytes().splitlines()[:12]), 0, 0
    for number in range(12):
        content, found = numbered("pieces", number, (seed,)), []
        for size in (2**22, 200):
            monkeypatch.setattr("cases.io.text_table.BLOCK", size)
            found.append(_columns_of(path, content))
        whole, parts = found
        assert (whole is None) == (parts is None), number
        refused_both, read_both = refused_both + (whole is None), read_both + (whole is not None)
        assert whole is None or whole == parts, number
    assert refused_both and read_both > 3


def _columns_of(path: Path, content: bytes) -> list[list[str] | str] | None:
    """The columns of a table in words, of a column that is refused the error; None for what is no table."""
    path.write_bytes(content)
    columns: list[list[str] | str] = []
    try:
        table = trial_table(path)
    except UserError:
        return None
    for k in range(len(table.header)):
        try:
            columns.append((table.numbers([k])[k] + 0.0).astype(str).tolist())  # no -0.0
        except UserError as error:
            columns.append(type(error).__name__)
    return columns


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


def test_a_million_columns_are_one_line_at_once(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(",".join(f"c{i}" for i in range(1_000_000)) + "\n1\n")
    refused(path, "line is longer")
    path.write_text(",".join("c" * 5001) + "\n1\n")
    refused(path, "5001 columns")


def test_a_gigabyte_of_noise_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "noise.csv"
    path.touch()
    os.truncate(path, LARGEST + 1)
    refused(path, "is no text")
    path.write_bytes(np.random.default_rng(1).bytes(3_000_000))
    refused(path, "noise.csv")


@pytest.mark.parametrize("text", ["[" * 200_000, "[]", '"x"', "3", "null", "", "{", "\x00", '{"a": ' * 90_000])
def test_json_that_is_no_object(tmp_path: Path, text: str) -> None:
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(UserError, match=r"result\.json"):
        read_json(tmp_path / "result.json")
    if len(text) > 1000:
        with pytest.raises(ValueError, match="nested"):
            parse_json(text)
