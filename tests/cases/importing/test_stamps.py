"""Stamps that are coarser than the rows, and stamps of which only some have a time zone."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pytest

from cases.importing.import_logs import Imported, import_logs
from cases.importing.import_map import ImportMap
from tests.support import raw_logs
from tests.support.raw_logs import bridge, codes, imported, stamp, table

pytest.importorskip("pyproj", reason="needs the extra import")

TRUTH = raw_logs.run()


def shifts(found: Imported) -> dict[str, float]:
    """By how much each channel of the import is late against the truth, as it fits best [s]."""
    run, truth = found.runs[0].columns, TRUTH
    rows = (run["t"] > 10) & (run["t"] < run["t"][-1] - 10)
    tried, out = np.arange(-1.5, 1.51, 0.05), {}
    for name in ("psi", "u", "v", "delta"):
        values, true = (np.unwrap(run[name]), truth.psi_unwrapped) if name == "psi" else (run[name], truth[name])
        off = [np.nanmean((np.interp(run["t"] + s, truth.t, true) - values)[rows] ** 2) for s in tried]
        out[name] = float(tried[int(np.argmin(off))])
    return out


@pytest.mark.parametrize("tick", [1.0, 2.0])
def test_rows_of_one_coarse_stamp_are_samples_of_it(tmp_path: Path, tick: float) -> None:
    """No channel is late against another, and the steps are those of the logger."""
    times = [stamp(tick * np.floor(t / tick)) for t in TRUTH.t]
    found = imported(table(tmp_path / "a.csv", {**bridge(TRUTH), "Time": times}))
    late = shifts(found)
    assert max(abs(s) for s in late.values()) < 0.1, late
    assert np.diff(found.runs[0].columns["t"]) == pytest.approx(0.5) and "time_spread" in codes(found)


def test_a_missing_row_and_a_gap_leave_the_others_in_their_second(tmp_path: Path) -> None:
    """Also where the log begins within a second, and goes on within one after a pause."""
    keep = np.ones(len(TRUTH), bool)
    keep[[0, 101, *range(160, 167)]] = False
    times = [stamp(np.floor(t / 2) * 2) for t in TRUTH.t]
    found = imported(table(tmp_path / "a.csv", {**bridge(TRUTH), "Time": times}, keep))
    t = found.runs[0].columns["t"] + 0.5  # the first row was that of half a second
    psi = np.interp(t, TRUTH.t, TRUTH.psi_unwrapped)
    off = np.abs(np.angle(np.exp(1j * (found.runs[0].columns["psi"] - psi))))
    assert np.nanmax(off) < 0.5 * np.abs(np.diff(TRUTH.psi_unwrapped)).max() * 1.4


def test_rows_that_were_written_twice_are_one(tmp_path: Path) -> None:
    columns = {name: np.repeat(values, 2) for name, values in bridge(TRUTH).items()}
    found = imported(table(tmp_path / "a.csv", columns))
    assert max(abs(s) for s in shifts(found).values()) < 0.05
    assert len(found.runs[0].columns["t"]) == len(TRUTH) and "time_repeated" in codes(found)


@pytest.mark.parametrize("pod", ["azimuth_2", "Heading"])
def test_directions_of_the_same_time_on_both_sides_of_north_have_a_mean_there(tmp_path: Path, pod: str) -> None:
    """One row in a log was written twice, with 359 and 1 deg."""
    columns = {**bridge(TRUTH), "n_azimuth_2 [rps]": TRUTH["n"], "azimuth_2 [deg]": np.full(len(TRUTH), 359.0)}
    columns[f"{pod} [deg]"] = np.full(len(TRUTH), 359.0)
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
    stamps = ((t, zones[i >= 180]) for i, t in enumerate(TRUTH.t))
    times = [stamp(t + 3600 * hours[zone])[:-6] + zone for t, zone in stamps]
    path = table(tmp_path / "a.csv", {**bridge(TRUTH), "Time": times})
    for chosen in (ImportMap(), ImportMap(zone_hours=9.0)):
        assert len(import_logs([path], chosen).problems) == 1


@pytest.mark.parametrize("dated", [True, False])
@pytest.mark.parametrize("form", ["%I:%M:%S %p", "%I:%M:%S.%fpm"])
def test_times_of_twelve_hours_stand_in_a_column_of_their_own(tmp_path: Path, dated: bool, form: str) -> None:
    """From before noon until after it."""
    begin = datetime.datetime(2026, 5, 14, 11, 59, 0)
    when = [begin + datetime.timedelta(seconds=float(t - TRUTH.t[0])) for t in TRUTH.t]
    half = [w.strftime("%p").lower()[0] for w in when]
    times = [w.strftime(form.replace("pm", f" {h}.m.")) for w, h in zip(when, half, strict=True)]
    columns = {**bridge(TRUTH), "Time": times} | ({"Date": [w.strftime("%m/%d/%Y") for w in when]} if dated else {})
    found = imported(table(tmp_path / "a.csv", columns))
    assert max(abs(s) for s in shifts(found).values()) < 0.3
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
    angle = 355.0 + 15.0 * np.sin(TRUTH.t / 12)
    wrapped, n = angle % 360, TRUTH["n"]
    log = bridge(TRUTH)
    nav = {name: log[name] for name in ("Time", "Latitude", "Longitude", "SOG [kn]", "COG [deg]", "Heading [deg]")}
    slow = {"Time": [stamp(t) for t in TRUTH.t], f"{pods[0]}{unit}": wrapped, f"{pods[1]}{unit}": wrapped}
    slow |= {f"{pods[2]} [rps]": n, f"{pods[3]} [rps]": n}
    slow |= {"True wind speed [m/s]": np.full(len(n), 4.0), f"True wind direction{unit}": wrapped}
    slow |= {"AWS [m/s]": np.full(len(n), 5.0), f"AWA{unit}": wrapped}
    table(tmp_path / "nav.csv", nav)
    table(tmp_path / "pods.csv", slow, np.arange(len(n)) % 8 == 0)
    found = imported(tmp_path)
    columns = found.runs[0].columns
    second = "azimuth_3" if "3" in pods[1] else "azimuth_2"
    true = np.radians(np.interp(columns["t"], TRUTH.t, angle))
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
