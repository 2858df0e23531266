"""Stamps that are coarser than the rows, and stamps of which only some have a time zone."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.checks import check
from cases.importing.import_logs import Imported, import_logs, write_import
from cases.importing.import_map import ImportMap
from cases.io.conventions import mislabelled
from cases.io.read import read_trials
from cases.io.toml_file import validated
from cases.trial import Trial
from tests.support import raw_logs
from tests.support.raw_logs import bridge, stamp, table

pytest.importorskip("pyproj", reason="needs the extra import")


def shifts(found: Imported) -> dict[str, float]:
    """By how much each channel of the import is late against the truth, as it fits best [s]."""
    assert not found.problems, found.problems
    run, truth = found.runs[0].columns, raw_logs.run()
    rows = (run["t"] > 10) & (run["t"] < run["t"][-1] - 10)
    tried, out = np.arange(-1.5, 1.51, 0.05), {}
    for name in ("psi", "u", "v", "delta"):
        values, true = (np.unwrap(run[name]), truth.psi_unwrapped) if name == "psi" else (run[name], truth[name])
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


@pytest.mark.parametrize("zones", [("+00:00", ""), ("", "+09:00")], ids=["Z, then none", "none, then +09:00"])
@pytest.mark.parametrize("large", [False, True])
def test_stamps_with_and_without_a_zone_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zones: tuple[str, str], large: bool
) -> None:
    if large:
        monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)
    truth, hours = raw_logs.run(), {"+00:00": 0, "+09:00": 9, "": 9}
    stamps = ((t, zones[i >= 180]) for i, t in enumerate(truth.t))
    times = [stamp(t + 3600 * hours[zone])[:-6] + zone for t, zone in stamps]
    path = table(tmp_path / "a.csv", {**bridge(truth), "Time": times})
    for chosen in (ImportMap(), ImportMap(zone_hours=9.0)):
        assert len(import_logs([path], chosen).problems) == 1


@pytest.mark.parametrize("dated", [True, False])
@pytest.mark.parametrize("form", ["%I:%M:%S %p", "%I:%M:%S.%fpm"])
def test_times_of_twelve_hours_stand_in_a_column_of_their_own(tmp_path: Path, dated: bool, form: str) -> None:
    """From before noon until after it."""
    truth = raw_logs.run()
    begin = datetime.datetime(2026, 5, 14, 11, 59, 0)
    when = [begin + datetime.timedelta(seconds=float(t - truth.t[0])) for t in truth.t]
    half = [w.strftime("%p").lower()[0] for w in when]
    times = [w.strftime(form.replace("pm", f" {h}.m.")) for w, h in zip(when, half, strict=True)]
    columns = {**bridge(truth), "Time": times} | ({"Date": [w.strftime("%m/%d/%Y") for w in when]} if dated else {})
    found = import_logs([table(tmp_path / "a.csv", columns)])
    assert max(abs(s) for s in shifts(found).values()) < 0.3
    assert found.runs[0].columns["t"][-1] == pytest.approx(truth.duration, abs=1.0)


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
    truth = raw_logs.run()
    angle = 355.0 + 15.0 * np.sin(truth.t / 12)
    wrapped, n = angle % 360, truth["n"]
    log = bridge(truth)
    nav = {name: log[name] for name in ("Time", "Latitude", "Longitude", "SOG [kn]", "COG [deg]", "Heading [deg]")}
    slow = {"Time": [stamp(t) for t in truth.t], f"{pods[0]}{unit}": wrapped, f"{pods[1]}{unit}": wrapped}
    slow |= {f"{pods[2]} [rps]": n, f"{pods[3]} [rps]": n}
    slow |= {"True wind speed [m/s]": np.full(len(n), 4.0), f"True wind direction{unit}": wrapped}
    slow |= {"AWS [m/s]": np.full(len(n), 5.0), f"AWA{unit}": wrapped}
    table(tmp_path / "nav.csv", nav)
    table(tmp_path / "pods.csv", slow, np.arange(len(n)) % 8 == 0)
    found = import_logs([tmp_path])
    assert not found.problems, found.problems
    columns = found.runs[0].columns
    second = "azimuth_3" if "3" in pods[1] else "azimuth_2"
    true = np.radians(np.interp(columns["t"], truth.t, angle))
    for name in ("azimuth", second, "wind_direction", "apparent_wind_direction"):
        assert np.cos(columns[name] - true).min() > np.cos(np.radians(1.0)), name
        assert columns[name].max() - columns[name].min() <= 2 * np.pi and np.abs(columns[name]).max() < 2 * np.pi, name


def test_a_position_over_the_date_line_stays_there(tmp_path: Path) -> None:
    log = bridge(raw_logs.run("turning:35"), (-17.0, 179.99995))
    log["Longitude"] = (np.asarray(log["Longitude"], dtype=float) + 180) % 360 - 180
    split = ("Time", "Latitude", "Longitude", "SOG [kn]", "COG [deg]")
    table(tmp_path / "gnss.csv", {name: log[name] for name in split}, np.arange(len(log["Time"])) % 4 == 3)
    table(tmp_path / "bridge.csv", {name: v for name, v in log.items() if name not in split[1:]})
    found = import_logs([tmp_path])
    assert not found.problems and np.abs(found.runs[0].columns["y"]).max() < 100
    assert np.isfinite(found.runs[0].columns["y"]).mean() > 0.9


def rounds(count: float = 3.2, heading: float = 0.0, wind: float = 0.7, side: int = 1) -> tuple[Trial, dict[str, Any]]:
    """Circles under a rudder that goes up and down, in a steady wind, begun at a ``heading`` [rad], and what a bridge
    logs of the apparent wind."""
    fine = np.arange(0.0, 2 * np.pi * count / 0.05, 0.01)
    r, u = 0.05 * side * (1 + 0.2 * np.sin(fine / 20)), 1.0 + 0.1 * np.cos(fine / 20)
    psi = heading + np.concatenate([[0.0], np.cumsum(r[1:] + r[:-1]) * 0.005])
    path = (u - 4j * r) * np.exp(1j * psi)
    path = np.concatenate([[0.0], np.cumsum(path[1:] + path[:-1]) * 0.005])
    delta, n = 0.5 * side * (1 + 0.2 * np.sin(fine / 20 + 0.5)), 10.0 + 0.3 * np.sin(fine / 30)
    columns = {"t": fine, "x": path.real, "y": path.imag, "psi": np.angle(np.exp(1j * psi)), "u": u, "v": -4 * r}
    truth = Trial("turn", {name: v[::100] for name, v in {**columns, "r": r, "n": n, "delta": delta}.items()})
    air = -6.0 * np.exp(1j * wind) - (truth["u"] + 1j * truth["v"]) * np.exp(1j * truth["psi"])
    seen = -air * np.exp(-1j * truth["psi"])
    return truth, {"AWS [m/s]": np.abs(seen), "AWA [deg]": np.degrees(np.angle(seen)) % 360}


LOGGERS = [",", ";", "\t", "excel", "parquet", "nmea"]
PLACES = [(34.7, 135.4), (-33.0, 151.0), (10.0, 179.9999), (-60.0, -179.9999), (0.0001, 0.0001), (78.0, 15.0)]
DAYS = ["2026-05-04T09:30", "2024-02-29T23:57", "1999-12-31T23:58", "2016-12-31T23:59"]


def written(
    logger: str, folder: Path, truth: Trial, more: dict[str, Any], place: tuple[float, float], day: str
) -> Path:
    """The log of a bridge as that ``logger`` writes it."""
    import pandas as pd

    begin = datetime.datetime.fromisoformat(f"{day}:00+00:00")
    if logger == "nmea":
        return raw_logs.nmea(folder / "log.nmea", truth, damaged=False, origin=place, begin=begin)
    frame = pd.DataFrame(bridge(truth, place) | more)
    frame["Longitude"] = (frame["Longitude"] + 180) % 360 - 180
    frame["Time"] = [stamp(t, begin) for t in truth.t]
    path = folder / {"excel": "log.xlsx", "parquet": "log.parquet"}.get(logger, "log.txt")
    if logger == "excel":
        frame.to_excel(path, index=False)
    elif logger == "parquet":
        frame.to_parquet(path)
    else:
        frame.round(7).to_csv(path, sep=logger, decimal="," if logger == ";" else ".", index=False)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_what_is_imported_is_right_to_the_check(tmp_path: Path, seed: int) -> None:
    """Circles of one to six rounds, either way, from any heading, in any wind, anywhere, on any day, by any logger."""
    rng = np.random.default_rng(seed)
    truth, wind = rounds(rng.uniform(1, 6), *rng.uniform(-np.pi, np.pi, 2), side=int(rng.choice([-1, 1])))
    logger, place = LOGGERS[seed], PLACES[(seed + 2) % len(PLACES)]
    path = written(logger, tmp_path, truth, wind, place, str(rng.choice(DAYS)))
    chosen = validated(ImportMap, {"reference_point": [0.0, 0.0]}, "map")
    found = import_logs([path], chosen)
    assert not found.problems, found.problems
    trial = read_trials(write_import(found, chosen, tmp_path / "out"))[0]
    report = check([trial])[0]
    assert report.verdict not in ("contradictory", "doubtful"), [f.text for f in report.findings]
    for name in ("psi", "wind_direction", "apparent_wind_direction"):
        if name in trial:
            values = trial[name]
            assert values.max() - values.min() <= 2 * np.pi and np.abs(values).max() < 2 * np.pi, name
    off = {name: np.abs(trial[name] - np.interp(trial.t, truth.t, truth[name])).max() for name in "uvr"}
    assert max(off["u"], off["v"]) < 0.02 and off["r"] < 0.002, off


def test_a_position_at_a_pole_is_refused(tmp_path: Path) -> None:
    truth, wind = rounds()
    found = import_logs([written(",", tmp_path, truth, wind, (89.99999, 0.0), DAYS[0])])
    assert found.problems and "Latitude" in found.problems[0]


@pytest.mark.parametrize(("unit", "wrong"), [(1.0, False), (180 / np.pi, True)])
def test_a_unit_of_the_apparent_wind_is_advised_only_where_the_wind_agrees(
    tmp_path: Path, unit: float, wrong: bool
) -> None:
    """An angle that goes on with the turns of the ship reaches 18 rad; degrees labelled rad reach 360."""
    truth, wind = rounds()
    log = {**bridge(truth), **wind}
    angle = np.unwrap(np.radians(log["AWA [deg]"])) if not wrong else np.radians(log["AWA [deg]"])
    columns = {**truth.columns, "apparent_wind_speed": log["AWS [m/s]"], "apparent_wind_direction": angle * unit}
    columns = {name: v for name, v in columns.items() if name not in ("wind_speed", "wind_direction")}
    assert np.abs(columns["apparent_wind_direction"]).max() > 4 * np.pi
    (tmp_path / "trials").mkdir()
    Trial("turn", columns).to_pandas().to_csv(tmp_path / "trials" / "turn.csv", index=False)
    trial = read_trials(tmp_path / "trials")[0]
    advice = [f.text for f in check([trial])[0].findings if f.code == "unit"]
    assert bool(advice) is wrong, advice
    assert bool(mislabelled(trial.columns)) is wrong
