"""A log in parts is one log: in order of time, whatever its parts are called, without those that are damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cases.io.read import read_trials
from cases.operation.log import Cut, OperationLog, cut_log, cut_record, read_log, window_rows, write_cut
from cases.quantities import UNITS
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import Missing, Unreadable, UserError
from tests.support.records import long_record, sailed, write_log
from tests.support.trial_files import motion_columns


def columns_of(log: OperationLog) -> dict[str, np.ndarray]:
    pieces = list(log.pieces())
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


@pytest.mark.parametrize("parts", ["as they are", "other names", "one twice"])
def test_the_pieces_are_the_log_in_order_of_time_whatever_its_parts_are_called(tmp_path: Path, parts: str) -> None:
    """What overlaps is dropped."""
    columns = motion_columns(120.0)
    first, second, *_ = write_log(tmp_path / "log", columns, 2 if parts == "other names" else 4)
    if parts == "other names":
        first.rename(tmp_path / "log" / "z.parquet")
        second.rename(tmp_path / "log" / "a.parquet")
    elif parts == "one twice":
        (tmp_path / "log" / "again.parquet").write_bytes(first.read_bytes())
    found = columns_of(read_log(tmp_path / "log"))
    assert {name: values.tolist() for name, values in found.items()} == {n: v.tolist() for n, v in columns.items()}


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


def test_a_column_that_a_later_part_lacks_is_missing_there_and_said(tmp_path: Path) -> None:
    columns = motion_columns(60.0)
    paths = write_log(tmp_path, columns, 2)
    pd.read_parquet(paths[1]).drop(columns=["wind_speed [m/s]", "wind_direction [rad]"]).to_parquet(paths[1])
    log = read_log(tmp_path)
    speed = columns_of(log)["wind_speed"]
    assert np.isfinite(speed[:300]).all() and np.isnan(speed[300:]).all()


def test_units_time_stamps_and_the_sidecar_are_those_of_trial_files(tmp_path: Path) -> None:
    columns, begin = motion_columns(60.0), np.datetime64("2026-05-04T00:00:00")
    frame = pd.DataFrame({f"{name} [{UNITS[name]}]": columns[name] for name in ("x", "y", "u", "v", "r", "n", "delta")})
    frame["psi [deg]"] = np.degrees(columns["psi"])
    frame["t [s]"] = begin + (1e6 * columns["t"]).astype("timedelta64[us]")
    frame.to_parquet(tmp_path / "log.parquet")
    (tmp_path / "trials.toml").write_text('[default]\nrudder_positive = "port"\n')
    found = columns_of(read_log(tmp_path))
    np.testing.assert_allclose(found["t"], begin.astype(float) + columns["t"], atol=2e-6, rtol=0)
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


def test_bytes_that_read_as_numbers_are_seen_where_the_writer_kept_checksums(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    columns = motion_columns(300.0)
    path = write_log(tmp_path, columns, 3)[1]
    whole = {"compression": "none", "use_dictionary": False, "write_page_checksum": True}
    pq.write_table(pq.read_table(path), path, row_group_size=500, **whole)
    content, value = bytearray(path.read_bytes()), columns["u"][1700:1720]  # in the middle of the second part
    at = content.find(value.tobytes())
    assert at > 0
    content[at : at + value.nbytes] = (value * 1.7).tobytes()
    path.write_bytes(content)
    log = read_log(tmp_path)
    found = columns_of(log)
    assert len(log.left_out) == 1 and str(path) in log.left_out[0]
    assert np.isin(found["u"], columns["u"]).all() and found["t"][-1] == columns["t"][-1]


LENGTH = 3.0


@pytest.fixture(scope="module")
def log() -> dict[str, np.ndarray]:
    """Two hours: moored from 0:30 to 0:50, u missing from 1:00 to 1:05, a frozen heading at 1:20, a gap at 1:40."""
    columns = sailed(2.0)
    t = columns["t"]
    moored = (t >= 1800) & (t < 3000)
    for name in ("u", "v", "r", "n", "delta"):
        columns[name] = np.where(moored, 0.0, columns[name])
    columns["u"] = np.where((t >= 3600) & (t < 3900), np.nan, columns["u"])
    columns["psi"] = np.where((t >= 4800) & (t < 4860), columns["psi"][4800], columns["psi"])
    return {name: values[(t < 6000) | (t >= 6100)] for name, values in columns.items()}


def pieces(columns: dict[str, np.ndarray], rows: int) -> Iterator[dict[str, np.ndarray]]:
    for first in range(0, len(columns["t"]), rows):
        yield {name: values[first : first + rows] for name, values in columns.items()}


def seconds_in(cut: Cut, begin: float, end: float) -> float:
    """Seconds of windows between two times."""
    return sum(max(0.0, min(w.end, end) - max(w.begin, begin)) for w in cut.windows)


def test_no_window_lies_where_the_log_tells_nothing_however_it_is_read(log: dict[str, np.ndarray]) -> None:
    sailed = []
    for rows in (100_000, 1100):
        cut = cut_log(pieces(log, rows), LENGTH)
        sailed.append(cut.seconds["manoeuvring"] + cut.seconds["steady"])
        for begin, end in ((1830, 2970), (3600, 3900), (4805, 4855), (6000, 6100)):
            assert seconds_in(cut, begin, end) == 0, (rows, begin, end)
    assert sailed[1] == pytest.approx(sailed[0], rel=0.05)


def test_what_is_sound_is_cut_into_windows(log: dict[str, np.ndarray]) -> None:
    cut = cut_log(pieces(log, 100_000), LENGTH)
    sound = 7200 - 1200 - 300 - 60 - 100
    assert 0.85 * sound < sum(w.end - w.begin for w in cut.windows) <= sound
    assert cut.seconds["moored"] == pytest.approx(1200, abs=60) and cut.seconds["gaps"] == pytest.approx(101)
    assert cut.seconds["missing values"] == pytest.approx(300)  # without a speed she is not known to be moored
    assert sum(cut.seconds.values()) == pytest.approx(cut.end - cut.begin, rel=0.01)


def test_rudder_revolutions_and_turns_make_a_window_manoeuvring() -> None:
    t = np.arange(3600.0)
    still = {name: np.zeros(3600) for name in ("v", "r", "delta", "psi")}
    rng = np.random.default_rng(0)
    log = {"t": t, **still, "u": 0.8 + 0.01 * rng.standard_normal(3600), "n": np.full(3600, 10.0)}
    log = {name: values + (1e-4 * rng.standard_normal(3600) if name != "t" else 0) for name, values in log.items()}
    assert not any(w.manoeuvring for w in cut_log([log], LENGTH).windows)
    for name, step in (("delta", 0.2), ("n", -3.0), ("psi", 0.5)):
        changed = {**log, name: log[name] + step * ((t > 1000) & (t < 1020))}
        windows = [w for w in cut_log([changed], LENGTH).windows if w.manoeuvring]
        assert all(w.begin < 1020 and w.end > 1000 for w in windows)
        assert windows or name == "psi"  # a heading that jumps alone is broken, not a manoeuvre


def test_the_rows_of_a_window_are_those_of_the_log(log: dict[str, np.ndarray]) -> None:
    cut = cut_log(pieces(log, 900), LENGTH)
    for rows in (700, 100_000):
        found = list(window_rows(pieces(log, rows), cut.windows))
        assert [window for window, _ in found] == cut.windows
        for window, columns in found:
            inside = (log["t"] >= window.begin) & (log["t"] <= window.end)
            np.testing.assert_array_equal(columns["u"], log["u"][inside])


ORDERS = ("turning:35", "zigzag:10/10", "turning:-20", "zigzag:-20/10", "zigzag:15/5", "spiral:15/5", "crash-stop")
NAMES = [order.replace(":", "_").replace("/", "_") for order in ORDERS]

Record = tuple[Trial, list[float], float]


@pytest.fixture(scope="module", params=["esso_osaka_3m", "kvlcc2_full"])
def record(request: pytest.FixtureRequest) -> Record:
    model = request.param == "esso_osaka_3m"
    return long_record(request.param, ORDERS, 0.5 if model else 4.0, 3, "0.1:40" if model else "3:40")


def whole(trial: Trial) -> Trial:
    return trial


def with_gaps(trial: Trial) -> Trial:
    """A tenth of the rows is lost, a few of them together."""
    lost = np.repeat(np.random.default_rng(1).random(len(trial) // 2 + 1) < 0.1, 2)[: len(trial)]
    return replace(trial, columns={name: values[~lost] for name, values in trial.columns.items()})


def rounded(trial: Trial) -> Trial:
    degrees = {name: np.radians(np.round(np.degrees(trial[name]), 1)) for name in ("psi", "delta")}
    return trial.with_columns(**degrees)


def steered_by_pods(trial: Trial) -> Trial:
    columns = {name: values for name, values in trial.columns.items() if name not in ("n", "delta")}
    nothing = np.zeros(len(trial))
    columns |= {"n": nothing, "delta": nothing, "n_azimuth": trial["n"], "azimuth": -trial["delta"]}
    return replace(trial, columns=columns, ancestors={"n": (), "delta": ()})


@pytest.mark.parametrize("change", [whole, with_gaps, rounded, steered_by_pods])
@pytest.mark.parametrize("known", [True, False])
def test_manoeuvres_have_the_names_and_times_of_their_orders(
    record: Record, change: Callable[[Trial], Trial], known: bool
) -> None:
    trial, times, length = record
    parts = [part for part in cut_record(change(trial), length if known else None) if part.trial.kind != "acceleration"]
    assert [part.trial.name[3:] for part in parts] == NAMES
    unit = length / trial["u"][0]
    np.testing.assert_allclose([part.order_s for part in parts], times, atol=0.3 * unit)
    for part in parts:
        assert part.order_s - part.trial.t[0] > 10 * unit  # a straight approach
        assert abs(np.ptp(part.trial.psi_unwrapped[part.trial.t < part.order_s])) < 0.3
    ends = [(part.trial.t[0], part.trial.t[-1]) for part in parts]
    assert all(before[1] < after[0] for before, after in pairwise(ends))


def test_a_ship_that_gathers_way_is_cut_as_well() -> None:
    trial, _, length = long_record("esso_osaka_3m", ["acceleration", "random:3", "turning:20"], 0.5)
    assert [part.trial.kind for part in cut_record(trial, length)] == ["acceleration", "turning"]


def test_a_record_without_a_manoeuvre_says_why(record: Record) -> None:
    trial, times, length = record
    rows = trial.t < times[0] - trial.dt
    straight = replace(trial, columns={name: values[rows] for name, values in trial.columns.items()})
    for given in (length, None):
        with pytest.raises(Missing):
            cut_record(straight, given)


@pytest.mark.slow
def test_the_trials_keep_what_the_sidecar_of_the_record_says(record: Record, tmp_path: Path) -> None:
    trial, times, length = record
    write_trial(trial, tmp_path / "record.csv")
    middle, said = times[1], {"day": "2026-11-22", "group": "before", "inputs": "sampled"}
    (tmp_path / "trials.toml").write_text(
        '[default]\ninputs = "sampled"\nday = "2026-11-22"\ngroup = "before"\nrole = "validate"\n'
        'std = { r = 1e-4 }\nderived = { r = ["psi"] }\n'
        f'[files."record.csv"]\nexclude = [[{middle - 9}, {middle - 4}]]\n'
    )
    (read,) = read_trials(tmp_path / "record.csv")
    (tmp_path / "parts").mkdir()
    write_cut(cut_record(read, length), tmp_path / "parts")
    parts = read_trials(tmp_path / "parts")
    assert len(parts) >= len(ORDERS)
    for part in parts:
        assert part.kind and part.role == "validate" and part.std == {"r": 1e-4} and part.ancestors == {"r": ("psi",)}
        assert part.meta.items() >= said.items()
        rows = (trial.t >= part.t[0]) & (trial.t <= part.t[-1])
        for name in ("t", "n", "delta"):
            np.testing.assert_array_equal(part[name], trial[name][rows])
    missing = [name.name for name in parts if np.isnan(name["psi"]).any()]
    assert missing == [part.name for part in parts if part.t[0] < middle < part.t[-1]] and len(missing) == 1
