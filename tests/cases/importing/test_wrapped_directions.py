"""Directions over north: between samples they go the short way, and they are written within a turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.checks import check
from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap
from cases.importing.written_trials import write_import
from cases.io.read import read_trials
from cases.io.unit_sanity import implausible
from cases.trial import Trial
from tests.support import raw_logs
from tests.support.raw_logs import bridge, stamp, table

pytest.importorskip("pyproj", reason="needs the extra import")

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


def three_rounds() -> tuple[Trial, dict[str, object]]:
    """A circle of three rounds in a steady wind, and a bridge's log of it with the apparent wind."""
    t = np.arange(0.0, 400.0)
    u, v, r = 1.0, -0.2, 0.05
    psi = r * t
    path = (u + 1j * v) / (1j * r) * np.exp(1j * psi)
    columns = {"t": t, "x": path.real, "y": path.imag, "psi": np.angle(np.exp(1j * psi))}
    steady = {"u": u, "v": v, "r": r, "n": 10.0, "delta": 0.6}
    truth = Trial("turn", columns | {name: np.full(len(t), value) for name, value in steady.items()})
    air = -6.0 * np.exp(0.7j) - (truth["u"] + 1j * truth["v"]) * np.exp(1j * truth["psi"])
    seen = -air * np.exp(-1j * truth["psi"])
    wind = {"AWS [m/s]": np.abs(seen), "AWA [deg]": np.degrees(np.angle(seen)) % 360}
    return truth, {**bridge(truth), **wind}


def test_an_apparent_wind_of_three_rounds_is_written_within_a_turn(tmp_path: Path) -> None:
    _, log = three_rounds()
    found = import_logs([table(tmp_path / "turn.csv", log)])
    write_import(found, ImportMap(), tmp_path / "out")
    trial = read_trials(tmp_path / "out")[0]
    assert trial["apparent_wind_direction"].min() >= 0 and trial["apparent_wind_direction"].max() < 2 * np.pi
    direction = trial["wind_direction"][10:-10]
    assert np.cos(direction - 0.7).min() > 0.99
    assert check([trial])[0].verdict != "contradictory"


@pytest.mark.parametrize(("unit", "mislabelled"), [(1.0, False), (180 / np.pi, True)])
def test_a_unit_of_the_apparent_wind_is_advised_only_where_the_wind_agrees(
    tmp_path: Path, unit: float, mislabelled: bool
) -> None:
    """An angle that goes on with the turns of the ship reaches 18 rad; degrees labelled rad reach 360."""
    truth, log = three_rounds()
    angle = np.unwrap(np.radians(log["AWA [deg]"])) if not mislabelled else np.radians(log["AWA [deg]"])
    columns = {**truth.columns, "apparent_wind_speed": log["AWS [m/s]"], "apparent_wind_direction": angle * unit}
    columns = {name: v for name, v in columns.items() if name not in ("wind_speed", "wind_direction")}
    assert np.abs(columns["apparent_wind_direction"]).max() > 4 * np.pi
    (tmp_path / "trials").mkdir()
    Trial("turn", columns).to_pandas().to_csv(tmp_path / "trials" / "turn.csv", index=False)
    trial = read_trials(tmp_path / "trials", refuse=False)[0]
    report = check([trial])[0]
    advice = [f.text for f in report.findings if f.code == "unit"]
    assert bool(advice) is mislabelled, advice
    assert bool(implausible(trial.columns)) is mislabelled
