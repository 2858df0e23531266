"""A log in parts is one log: in order of time, whatever its parts are called, without those that are damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cases.operation.log import OperationLog, read_log
from mmg.errors import Missing, Unreadable, UserError
from tests.support.operation_logs import write_log
from tests.support.trial_files import motion_columns


def columns_of(log: OperationLog) -> dict[str, np.ndarray]:
    pieces = list(log.pieces())
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def test_the_pieces_are_the_log(tmp_path: Path) -> None:
    columns = motion_columns(120.0)
    write_log(tmp_path / "log", columns, 4)
    found = columns_of(read_log(tmp_path / "log"))
    assert {name: values.tolist() for name, values in found.items()} == {n: v.tolist() for n, v in columns.items()}


def test_parts_are_in_order_of_time_not_of_name(tmp_path: Path) -> None:
    columns = motion_columns(60.0)
    first, second = write_log(tmp_path, columns, 2)
    first.rename(tmp_path / "z.parquet")
    second.rename(tmp_path / "a.parquet")
    assert columns_of(read_log(tmp_path))["t"].tolist() == columns["t"].tolist()


@pytest.mark.parametrize("where", ["end", "middle", "nothing"])
def test_a_damaged_part_is_left_out_and_said(tmp_path: Path, where: str) -> None:
    columns = motion_columns(300.0)
    paths = write_log(tmp_path, columns, 3)
    content = bytearray(paths[1].read_bytes())
    if where == "middle":
        content[100 : len(content) // 2] = b"\xff" * (len(content) // 2 - 100)
    paths[1].write_bytes(b"" if where == "nothing" else content[: len(content) // 2] if where == "end" else content)
    log = read_log(tmp_path)
    t = columns_of(log)["t"]
    assert len(log.left_out) == 1 and str(paths[1]) in log.left_out[0] and "damaged" in log.left_out[0]
    assert t[0] == columns["t"][0] and t[-1] == columns["t"][-1] and 2 / 3 * len(columns["t"]) <= len(t) < 0.9 * 3000


def test_what_overlaps_is_dropped_and_said(tmp_path: Path) -> None:
    columns = motion_columns(60.0)
    paths = write_log(tmp_path, columns, 2)
    (tmp_path / "again.parquet").write_bytes(paths[0].read_bytes())
    log = read_log(tmp_path)
    assert columns_of(log)["t"].tolist() == columns["t"].tolist()


def test_a_column_that_a_later_part_lacks_is_missing_there_and_said(tmp_path: Path) -> None:
    columns = motion_columns(60.0)
    paths = write_log(tmp_path, columns, 2)
    pd.read_parquet(paths[1]).drop(columns=["wind_speed [m/s]", "wind_direction [rad]"]).to_parquet(paths[1])
    log = read_log(tmp_path)
    speed = columns_of(log)["wind_speed"]
    assert np.isfinite(speed[:300]).all() and np.isnan(speed[300:]).all()


def test_units_time_stamps_and_the_sidecar_are_those_of_trial_files(tmp_path: Path) -> None:
    columns = motion_columns(60.0)
    frame = pd.DataFrame({f"{name} [-]": values for name, values in columns.items()})
    frame = frame.rename(columns=lambda name: name.replace(" [-]", " [rad]") if name[:3] in ("psi", "del") else name)
    frame["psi [deg]"] = np.degrees(frame.pop("psi [rad]"))
    units = {"x": "m", "y": "m", "u": "m/s", "v": "m/s", "r": "rad/s", "n": "rps"}
    frame = frame.rename(columns={f"{name} [-]": f"{name} [{unit}]" for name, unit in units.items()})
    frame = frame.drop(columns=["wind_speed [-]", "wind_direction [-]"])
    stamps = np.datetime64("2026-05-04T00:00:00") + (1e6 * columns["t"]).astype("timedelta64[us]")
    frame["t [s]"] = stamps
    frame.drop(columns="t [-]").to_parquet(tmp_path / "log.parquet")
    (tmp_path / "trials.toml").write_text('[default]\nrudder_positive = "port"\n')
    found = columns_of(read_log(tmp_path))
    start = np.datetime64("2026-05-04T00:00:00").astype("datetime64[s]").astype(float)
    np.testing.assert_allclose(found["t"], start + columns["t"], atol=2e-6, rtol=0)
    np.testing.assert_allclose(found["psi"], columns["psi"], rtol=1e-12)
    np.testing.assert_array_equal(found["delta"], -columns["delta"])


def test_folders_without_a_log_are_refused(tmp_path: Path) -> None:
    with pytest.raises(Missing):
        read_log(tmp_path / "absent")
    with pytest.raises(UserError, match=r"\.parquet"):
        read_log(tmp_path)
    (tmp_path / "bad.parquet").write_bytes(b"nothing of the kind")
    with pytest.raises(Unreadable):
        read_log(tmp_path)


@pytest.mark.parametrize("checksums", [True, False])
def test_bytes_that_read_as_numbers_are_seen_where_the_writer_kept_checksums(tmp_path: Path, checksums: bool) -> None:
    import pyarrow.parquet as pq

    columns = motion_columns(300.0)
    paths = write_log(tmp_path, columns, 3)
    table = pq.read_table(paths[1])
    whole = {"compression": "none", "use_dictionary": False, "write_page_checksum": checksums}
    pq.write_table(table, paths[1], row_group_size=500, **whole)
    content = bytearray(paths[1].read_bytes())
    value = columns["u"][1700:1720].tobytes()  # in the middle of the second part
    at = content.find(value)
    assert at > 0
    content[at : at + len(value)] = (columns["u"][1700:1720] * 1.7).tobytes()
    paths[1].write_bytes(content)
    log = read_log(tmp_path)
    found = columns_of(log)
    if checksums:
        assert len(log.left_out) == 1 and str(paths[1]) in log.left_out[0]
        assert np.isin(found["u"], columns["u"]).all() and found["t"][-1] == columns["t"][-1]
    else:
        assert not log.left_out and len(found["t"]) == len(columns["t"])  # nothing tells
