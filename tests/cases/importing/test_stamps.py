"""Stamps that are coarser than the rows, and stamps of which only some have a time zone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.importing.import_logs import Imported, import_logs
from cases.importing.import_map import ImportMap
from tests.support import raw_logs
from tests.support.raw_logs import bridge, stamp, table

pytest.importorskip("pyproj", reason="needs the extra import")

CHANNELS = ("psi", "u", "v", "delta")
LIMIT = {"psi": 5e-3, "u": 5e-3, "v": 8e-3, "delta": 0.03}


def shifts(found: Imported) -> dict[str, float]:
    """By how much each channel of the import is late against the truth, as it fits best [s]."""
    assert not found.problems, found.problems
    run, truth = found.runs[0].columns, raw_logs.run()
    rows = (run["t"] > 10) & (run["t"] < run["t"][-1] - 10)
    tried = np.arange(-1.5, 1.51, 0.05)
    out = {}
    for name in CHANNELS:
        psi = name == "psi"
        values = np.unwrap(run[name]) if psi else run[name]
        true = truth.psi_unwrapped if psi else truth[name]
        off = [np.nanmean((np.interp(run["t"] + s, truth.t, true) - values)[rows] ** 2) for s in tried]
        out[name] = float(tried[int(np.argmin(off))])
    return out


def codes(found: Imported) -> set[str]:
    return {getattr(m, "code", "") for m in found.runs[0].notices}


@pytest.mark.parametrize("tick", [1.0, 2.0])
def test_rows_of_one_coarse_stamp_are_samples_of_it(tmp_path: Path, tick: float) -> None:
    """No channel is late against another, and the steps are those of the logger."""
    truth = raw_logs.run()
    times = [stamp(tick * np.floor(t / tick)) for t in truth.t]
    found = import_logs([table(tmp_path / "a.csv", {**bridge(truth), "Time": times})])
    late = shifts(found)
    assert max(abs(s) for s in late.values()) < 0.1, late
    assert np.diff(found.runs[0].columns["t"]) == pytest.approx(0.5) and "time_spread" in codes(found)


def test_a_missing_row_and_a_gap_leave_the_others_in_their_second(tmp_path: Path) -> None:
    """Also where the log begins within a second, and goes on within one after a pause."""
    truth = raw_logs.run()
    keep = np.ones(len(truth), bool)
    keep[[0, 101, *range(160, 167)]] = False
    times = [stamp(np.floor(t / 2) * 2) for t in truth.t]
    found = import_logs([table(tmp_path / "a.csv", {**bridge(truth), "Time": times}, keep)])
    t = found.runs[0].columns["t"] + 0.5  # the first row was that of half a second
    psi = np.interp(t, truth.t, truth.psi_unwrapped)
    off = np.abs(np.angle(np.exp(1j * (found.runs[0].columns["psi"] - psi))))
    assert np.nanmax(off) < 0.5 * np.abs(np.diff(truth.psi_unwrapped)).max() * 1.4


def test_rows_that_were_written_twice_are_one(tmp_path: Path) -> None:
    truth = raw_logs.run()
    columns = {name: np.repeat(values, 2) for name, values in bridge(truth).items()}
    found = import_logs([table(tmp_path / "a.csv", columns)])
    assert max(abs(s) for s in shifts(found).values()) < 0.05
    assert len(found.runs[0].columns["t"]) == len(truth) and "time_repeated" in codes(found)


@pytest.mark.parametrize("pod", ["azimuth_2", "Heading"])
def test_directions_of_the_same_time_on_both_sides_of_north_have_a_mean_there(tmp_path: Path, pod: str) -> None:
    """One row in a log was written twice, with 359 and 1 deg."""
    truth = raw_logs.run()
    columns = {**bridge(truth), "n_azimuth_2 [rps]": truth["n"], "azimuth_2 [deg]": np.full(len(truth), 359.0)}
    columns[f"{pod} [deg]"] = np.full(len(truth), 359.0)
    columns = {name: np.insert(np.array(values, dtype=object), 51, values[50]) for name, values in columns.items()}
    columns[f"{pod} [deg]"][51] = 1.0
    found = import_logs([table(tmp_path / "a.csv", columns)])
    values = found.runs[0].columns["psi" if pod == "Heading" else pod]
    assert np.cos(values).min() > np.cos(np.radians(1.01)) and values[50] == pytest.approx(0.0, abs=1e-6)


ZONES = {"Z, then none": ("+00:00", ""), "none, then +09:00": ("", "+09:00")}


@pytest.mark.parametrize("zones", list(ZONES))
@pytest.mark.parametrize("large", [False, True])
def test_stamps_with_and_without_a_zone_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zones: str, large: bool
) -> None:
    if large:
        monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)
    truth = raw_logs.run()
    hours = {"+00:00": 0, "+09:00": 9, "": 9}
    times = []
    for i, t in enumerate(truth.t):
        zone = ZONES[zones][i >= 180]
        times.append(stamp(t + 3600 * hours[zone])[:-6] + zone)
    path = table(tmp_path / "a.csv", {**bridge(truth), "Time": times})
    for chosen in (ImportMap(), ImportMap(zone_hours=9.0)):
        assert len(import_logs([path], chosen).problems) == 1


def test_a_zone_of_two_digits_is_one(tmp_path: Path) -> None:
    truth = raw_logs.run()
    times = [stamp(t)[:-6].replace("T", " ") + "+00" for t in truth.t]
    found = import_logs([table(tmp_path / "a.csv", {**bridge(truth), "Time": times})], ImportMap(zone_hours=9.0))
    assert found.runs[0].day == "2026-05-04" and found.runs[0].logs
