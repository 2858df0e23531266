"""The registry of quantities agrees with itself, with the actuators of the model and with the units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from cases.checks import check
from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap
from cases.importing.vocabulary import meaning
from cases.io import text_table
from cases.io.conventions import through_north
from cases.io.read import read_trial
from cases.io.toml_file import validated
from cases.quantities import FACTORS, QUANTITIES, UNITS, is_canonical, quantity, to_si
from mmg.errors import UserError
from mmg.motion.flow import INPUTS, RUDDERS, STATES
from mmg_ident import simulate
from tests.support import raw_logs
from tests.support.trial_files import write_csv


def test_every_state_and_actuator_of_the_model_is_a_quantity_in_its_unit():
    assert {"t", *STATES, *INPUTS} <= set(UNITS)
    assert all(UNITS[name] == unit for name, (_, unit) in INPUTS.items())


@pytest.mark.parametrize("row", QUANTITIES.values(), ids=lambda row: row.name)
def test_a_row_agrees_with_itself(row):
    assert not row.unit or row.unit in FACTORS
    assert row.limits[0] < row.limits[1]
    assert not row.compass or row.wraps
    if row.canonical or row.unit:
        assert meaning(row.name).quantity == row.name


def test_a_third_propeller_is_as_the_second():
    assert quantity("n_3").unit == "rps" and is_canonical("n_3")
    with pytest.raises(KeyError):
        quantity("n_22")


N, DT = 240, 0.5
SHIFT, CENTRE = 1.234, complex(7.0, -3.0)
"""Turn [rad] and place [m] of a whole record."""


def record(seed: int = 0) -> dict[str, np.ndarray]:
    """Every canonical quantity (N,): directions cross north and south and go on for several rounds."""
    rng, t = np.random.default_rng(seed), DT * np.arange(N)
    out = {"t": t}
    for i, (name, unit) in enumerate(UNITS.items()):
        swing = np.sin(t / (9 + i) + rng.uniform(0, 6))
        size = {"m": 40.0, "rad": 0.5, "rps": 2.0, "m/s": 1.0, "rad/s": 0.1}.get(unit, 0.0)
        out[name] = t if name == "t" else size * swing + (3.0 if "wind_speed" in name or name == "u" else 0.0)
        if quantity(name).wraps:
            out[name] = (i % 3 - 1) * 0.11 * t + 0.4 * swing + rng.choice([0.0, np.pi])
    return out


def turned(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The record turned by SHIFT about the origin of the positions."""
    place = (columns["x"] + 1j * columns["y"]) * np.exp(1j * SHIFT)
    out = {name: values + SHIFT * quantity(name).compass for name, values in columns.items()}
    return out | {"x": place.real, "y": place.imag}


def moved(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return columns | {"x": columns["x"] + CENTRE.real, "y": columns["y"] + CENTRE.imag}


TO_STARBOARD = {"y", "v", "r", "phi", "p", "n_bow", "n_stern", *RUDDERS}
"""What is positive to starboard, beside the directions."""
_PAIRS = (("n", "n_2"), ("delta_port", "delta_starboard"), ("n_azimuth", "n_azimuth_2"), ("azimuth", "azimuth_2"))
OPPOSITE = {name: other for pair in _PAIRS for name, other in (pair, pair[::-1])}


def mirrored(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The record with port and starboard exchanged."""
    sign = {name: -1 if quantity(name).wraps or name in TO_STARBOARD else 1 for name in columns}
    return {name: sign[name] * columns[OPPOSITE.get(name, name)] for name in columns}


def assert_same(
    one: Mapping[str, np.ndarray], two: Mapping[str, np.ndarray], within: Mapping[str, float] | None = None
):
    """Of both records every column, directions over their period."""
    assert set(one) == set(two)
    for name, values in one.items():
        off, period = values - two[name], quantity(name).period
        off = np.remainder(off + period / 2, period) - period / 2 if period else off
        assert (np.isnan(values) == np.isnan(two[name])).all(), name
        assert np.nanmax(np.abs(off)) < (within or {}).get(name, 1e-9), name


def written(path: Path, columns: dict[str, np.ndarray], north: float, deg: bool) -> Path:
    """A trial file whose directions lie within a turn from ``north`` on, in degrees where ``deg``."""
    import pandas as pd

    cells = {}
    for name, values in columns.items():
        scale, unit = (180 / np.pi, "deg") if deg and quantity(name).unit == "rad" else (1.0, quantity(name).unit)
        if quantity(name).wraps:
            values = np.remainder(values - north, 2 * np.pi) + north
        cells[f"{name} [{unit}]"] = scale * values
    pd.DataFrame(cells).to_csv(path, index=False)
    return path


LATE = {name: 0.37 + 0.01 * i for i, name in enumerate(UNITS) if name not in "txy"} | {"x": 0.3, "y": 0.3}
READINGS = {
    "as it is": {},
    "late": {"lag": LATE},
    "antenna": {"reference_point": {"x": 3.0, "y": 0.5}},
    "wind to": {"wind_direction": "to"},
    "apparent wind": {},
    "gaps": {"lag": LATE},
    "averaged": {},
    "averaged gaps": {},
}


@pytest.mark.parametrize("north", [0.0, -np.pi])
@pytest.mark.parametrize("change", [turned, moved, mirrored])
@pytest.mark.parametrize("reading", READINGS)
def test_a_record_that_is_turned_moved_or_mirrored_is_read_as_the_same_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reading: str, change: Callable, north: float
) -> None:
    if "averaged" in reading:
        monkeypatch.setattr(text_table, "MOST_KEPT", N // 5)
    columns = record()
    if reading == "apparent wind":
        del columns["wind_speed"], columns["wind_direction"]
    for i, name in enumerate(columns if "gaps" in reading else ()):
        if name not in "txy":
            columns[name][20 + i : 24 + i] = columns[name][60 + i] = np.nan
    settings, deg = dict(READINGS[reading]), north == 0.0
    plain = read_trial(written(tmp_path / "a.csv", columns, north, deg), settings)
    if change is mirrored and "reference_point" in settings:
        settings["reference_point"] = {"x": 3.0, "y": -0.5}
    if change is mirrored and "lag" in settings:
        settings["lag"] = {name: LATE[OPPOSITE.get(name, name)] for name in LATE}
    other = read_trial(written(tmp_path / "b.csv", change(columns), north - 1.0, deg), settings)
    assert len(plain) < N or not {"lag"} & set(settings)
    assert_same(change(dict(plain.columns)), other.columns)


def receiver(columns: Mapping[str, np.ndarray], path: Path, origin: tuple[float, float], begin: str) -> Path:
    """A log of ``columns`` (N,) with positions on the globe about ``origin``, directions from 0 to 360."""
    import pandas as pd
    import pyproj

    frame = pyproj.Proj(proj="tmerc", lat_0=origin[0], lon_0=origin[1], k=1.0, ellps="WGS84")
    longitude, latitude = frame(columns["y"], columns["x"], inverse=True)
    stamps = pd.Timestamp(begin, tz="UTC") + pd.to_timedelta(columns["t"], unit="s")
    turn = np.radians(frame.get_factors(longitude, latitude).meridian_convergence)
    cells = {"Time": stamps.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), "Latitude": latitude, "Longitude": longitude}
    for name, values in columns.items():
        if name not in "txy":
            cells[f"{name} [{'deg' if quantity(name).wraps else quantity(name).unit}]"] = (
                np.degrees(values + turn * quantity(name).compass) % 360 if quantity(name).wraps else values
            )
    pd.DataFrame(cells).to_csv(path, index=False)
    return path


def sailed(wind: str) -> dict[str, np.ndarray]:
    """A turning circle as a receiver, a gyro, every actuator and the wind sensors log it; wind: which one is given."""
    truth, rng = raw_logs.run("turning:35"), np.random.default_rng(0)
    sog, cog = raw_logs.ground(truth)
    swing = record()
    out = {name: np.resize(values, len(truth)) for name, values in swing.items() if name not in STATES}
    out |= {"t": truth.t, "psi": truth.psi_unwrapped, "delta": truth["delta"], "n": truth["n"], "n_2": 0.9 * truth["n"]}
    out |= {c: truth[c] + 0.05 * rng.standard_normal(len(truth)) for c in "xy"}
    out |= {"sog": sog * raw_logs.KNOT, "cog": np.radians(cog), "true_wind_angle": out["wind_direction"] - out["psi"]}
    if wind == "apparent_wind_speed":
        del out["wind_speed"], out["true_wind_angle"]
    if wind != "wind_direction":
        del out["wind_direction"]
    return out


PLACES = {
    "wind_direction": [((-33.0, 151.0), "2024-02-29T23:58:30"), ((78.0, 15.0), "2016-12-31T23:59:00")],
    "true_wind_angle": [((10.0, 179.9999), "1999-12-31T23:59:00"), ((0.0001, 0.0001), "2026-03-29T00:59:00")],
    "apparent_wind_speed": [((-60.0, -179.9999), "2038-01-19T03:13:00")],
}
"""Latitude, longitude and begin of logs with this column of the wind."""


@pytest.mark.slow
@pytest.mark.parametrize("wind", list(PLACES))
def test_a_log_that_is_turned_mirrored_or_taken_to_another_place_and_day_gives_the_same_trial(
    tmp_path: Path, wind: str
) -> None:
    pytest.importorskip("pyproj", reason="needs the extra import")
    home, day, columns = (34.7, 135.4), "2026-05-04T09:30:00", sailed(wind)

    def imported(
        change: Callable, origin: tuple[float, float], begin: str, aside: float = 0.5
    ) -> dict[str, np.ndarray]:
        chosen = {"origin": list(origin), "reference_point": {"x": 3.0, "y": aside}, "columns": {"t": "Time"}}
        path = receiver(change(columns), tmp_path / "log.csv", origin, begin)
        found = import_logs([path], validated(ImportMap, chosen, "map"))
        assert not found.problems, found.problems
        return found.runs[0].columns

    plain = imported(dict, home, day)
    within = dict.fromkeys(("x", "y", "u", "v", "wind_speed", "wind_direction"), 1e-6)  # of the projection
    assert_same(turned(plain), imported(turned, home, day), within)
    assert_same(mirrored(plain), imported(mirrored, home, day, -0.5), within)
    for origin, begin in PLACES[wind]:
        assert_same(plain, imported(dict, origin, begin), within)
    far = {**columns, "x": columns["x"] + 4e4, "y": columns["y"] - 9e4}  # 90 km: a degree between both norths
    there = imported(lambda _: far, (65.0, 20.0), day)
    assert_same(plain, {**there, "x": there["x"] - 4e4, "y": there["y"] + 9e4}, dict.fromkeys(columns, 1e-6))


@pytest.mark.parametrize(
    ("column", "unit", "factor"),
    [
        ("psi", "deg", math.pi / 180), ("u", "kn", 1852 / 3600), ("r", "deg/s", math.pi / 180),
        ("n", "rpm", 1 / 60), ("n_3", "rpm", 1 / 60),
        ("t", "s", 1.0), ("x", "m", 1.0), ("delta", "Degrees", math.pi / 180),
    ],
)  # fmt: skip
def test_contract_units_convert_to_si(column, unit, factor):
    assert to_si(column, unit, "here") == pytest.approx(factor, rel=1e-15)


def test_an_unknown_unit_is_named_with_the_place_and_the_accepted_ones():
    with pytest.raises(UserError, match=r"run.csv.*'psi \[grad\]'.*'grad'.*rad, deg"):
        to_si("psi", "grad", "run.csv: column 'psi [grad]'")


RUN = simulate("kvlcc2_l7", "turning:35", dt=0.1, duration=300, noise=True)


def false_samples(every: int, shift: float) -> np.ndarray:
    """The heading of RUN, logged in numbers from 0 to 360 at each ``every``-th row and joined by straight lines."""
    angle = np.mod(RUN["psi"] + shift, 2 * np.pi)
    return np.interp(RUN.t, RUN.t[::every], angle[::every])


@pytest.mark.parametrize("every", [2, 5, 15])
@pytest.mark.parametrize("with_rate", [True, False])
def test_false_samples_are_mended(every: int, with_rate: bool) -> None:
    for shift in (0.0, 2.0):
        psi = false_samples(every, shift)
        mended, count = through_north(RUN.t, psi, RUN["r"] if with_rate else None)
        off = np.abs(np.angle(np.exp(1j * (mended - RUN["psi"] - shift))))
        assert count >= 1 and np.degrees(off.max()) < 1.5
        assert np.degrees(np.abs(np.angle(np.exp(1j * (psi - RUN["psi"] - shift)))).max()) > 20


def test_a_sound_heading_stays_as_it_is() -> None:
    for psi in (RUN["psi"], np.mod(RUN["psi"], 2 * np.pi), np.where(RUN.t > 100, RUN["psi"] + 0.3, RUN["psi"])):
        mended, count = through_north(RUN.t, psi, RUN["r"])
        assert count == 0 and (mended == psi).all()


def test_a_file_is_mended_on_reading_and_loses_no_row(tmp_path: Path) -> None:
    columns = {**RUN.columns, "psi": np.degrees(false_samples(5, 0.0))}
    path = write_csv(tmp_path / "turn.csv", columns, {"psi": "psi [deg]"}, rows=None)
    trial = read_trial(path)
    assert "heading_mended" in [note.code for note in trial.notices]
    (report,) = check([trial])
    assert report.numbers["stretches"]["broken"] == []
