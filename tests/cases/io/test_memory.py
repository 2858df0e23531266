"""Trials from DataFrames and arrays: as from a file, and the same refusals, by the name of the column."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow
import pytest

from cases.io.read import read_trial
from cases.quantities import UNITS
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from cases.trial_set import TrialSet
from mmg.errors import UserError
from tests.support.diagnosis_cases import RUNS, pushed_trials

N = 60
T = np.arange(N) * 0.5
COLUMNS: dict[str, np.ndarray] = {
    "t": T, "x": 0.5 * T, "y": 0.01 * T**2, "psi": 0.02 * T, "u": 0.5 + 0.01 * np.sin(T), "v": 0.01 * np.cos(T),
    "r": np.full(N, 0.02), "n": np.full(N, 9.0), "delta": np.where(T > 10, 0.3, 0.0),
}  # fmt: skip


def test_a_frame_in_degrees_and_knots_is_the_trial_of_arrays_in_si() -> None:
    """And so is a table of pyarrow."""
    arrays = Trial.from_arrays(name="run", kind="turning", **COLUMNS)
    frame = pd.DataFrame({k: v for k, v in COLUMNS.items() if k not in ("psi", "delta", "u")})
    frame["psi [deg]"], frame["delta [deg]"] = np.degrees(COLUMNS["psi"]), np.degrees(COLUMNS["delta"])
    frame["u"] = COLUMNS["u"] * 3600 / 1852
    units = {"t": "s", "x": "m", "y": "m", "v": "m/s", "r": "rad/s", "n": "rps", "u": "kn"}
    found = Trial.from_pandas(frame, units=units, name="run", kind="turning")
    table = Trial.from_pandas(pyarrow.table({f"{name} [{UNITS[name]}]": v for name, v in COLUMNS.items()}))
    for name in COLUMNS:
        np.testing.assert_allclose(found[name], arrays[name], rtol=1e-12)
        assert np.array_equal(table[name], arrays[name])
    assert found.kind == arrays.kind == "turning" and found.sha256 != arrays.sha256
    assert {m.code for m in found.notices} >= {"unit_converted"}  # type: ignore[union-attr]


def test_a_dataset_of_xarray_says_its_own_units() -> None:
    xarray = pytest.importorskip("xarray")
    t = np.arange(0.0, 5.0, 0.5)
    units = {"psi": "deg", "u": "kn", "v": "kn", "r": "deg/s", "n": "rpm", "delta": "deg"}
    columns = {name: ("t", np.linspace(1.0, 2.0, len(t)), {"units": unit}) for name, unit in units.items()}
    found = Trial.from_pandas(xarray.Dataset(columns, coords={"t": ("t", t, {"units": "s"})}))
    assert np.array_equal(found.t, t) and found["n"] == pytest.approx(np.linspace(1.0, 2.0, len(t)) / 60)
    assert found["psi"][-1] == pytest.approx(np.radians(2.0)) and found["u"][0] == pytest.approx(1852 / 3600)


def test_time_stamps_of_a_zone_are_read_in_utc() -> None:
    """As index, as column, of pyarrow, and as objects of Python; across the change from summer time, too."""
    frame = pd.DataFrame({f"{name} [{UNITS.get(name, 'rps')}]": values for name, values in COLUMNS.items()})
    start = pd.Timestamp("2024-10-27 00:59:50", tz="UTC")
    stamps = pd.Series((start + pd.to_timedelta(T, unit="s")).tz_convert("Europe/Berlin"))
    others = frame.drop(columns="t [s]")
    columns = [stamps, stamps.astype(object), pd.Series([stamp.to_pydatetime() for stamp in stamps], dtype=object)]
    columns += [stamps.dt.tz_convert("UTC").astype("timestamp[us, UTC][pyarrow]"), stamps.dt.tz_convert(None)]
    for column in columns:
        read = (
            Trial.from_pandas(frame.assign(**{"t [s]": column})),
            Trial.from_pandas(others.set_index(pd.Index(column))),
        )
        for trial in read:
            np.testing.assert_allclose(trial.t, T, atol=1e-9)
    mixed = [stamps[0].tz_localize(None), *stamps[1:]]
    with pytest.raises(UserError):
        Trial.from_pandas(frame.assign(**{"t [s]": pd.Series(mixed, dtype=object)}))


def test_a_frame_and_its_file_are_the_same_trial(tmp_path: Path) -> None:
    """What ``to_pandas`` gives is read as what was written; settings are those of trials.toml."""
    trial = pushed_trials(3, [], RUNS[:1])[0]
    write_trial(trial, tmp_path / "run.csv")
    settings: dict[str, Any] = {"reference_point": {"x": -0.5, "y": 0.1}, "inputs": "sampled", "role": "test"}
    file = read_trial(tmp_path / "run.csv", settings)
    made = Trial.from_pandas(read_trial(tmp_path / "run.csv", {}).to_pandas(), name="run", **settings)
    for name in file.columns:
        np.testing.assert_allclose(made[name], file[name], rtol=1e-12, atol=1e-15)
    assert (made.role, made.meta["inputs"]) == (file.role, file.meta["inputs"]) == ("test", "sampled")
    by_index = file.to_pandas().set_index("t [s]")
    np.testing.assert_array_equal(Trial.from_pandas(by_index).t, file.t)


def frame(given: Any) -> Callable[[], Trial]:
    return lambda: Trial.from_pandas(given)


def arrays(**changed: Any) -> Callable[[], Trial]:
    return lambda: Trial.from_arrays(**{**COLUMNS, **changed})


HEADER = {name: f"{name} [{UNITS[name]}]" for name in COLUMNS} | {"psi": "psy [deg]"}  # misspelt
WRONG: dict[str, tuple[Callable[[], Trial], str]] = {
    "lengths": (arrays(u=np.ones(3)), "u 3"),
    "two dimensions": (arrays(u=np.ones((N, 2))), "(60, 2)"),
    "time backwards": (arrays(t=T[::-1]), "backwards"),
    "text": (arrays(u=np.full(N, "fast")), "'u'"),
    "not a number": (arrays(r=np.full(N, np.nan)), "column r"),
    "unit": (arrays(units={"psi": "grad"}), "accepted: rad, deg"),
    "unit of no column": (arrays(units={"phi": "deg"}), "did you mean 'psi'"),
    "setting": (arrays(rudder_positiv="port"), "did you mean 'rudder_positive'"),
    "value of a setting": (arrays(rudder_positive="left"), "rudder_positive"),
    "no rows": (frame(pd.DataFrame({"t [s]": T}).iloc[:0]), "missing column psi"),
    "units of none": (frame(pd.DataFrame({f"{k} [1]": v for k, v in COLUMNS.items()})), "unknown unit"),
    "no units": (frame(pd.DataFrame(COLUMNS)), "column 't' has no unit"),
    "misspelt": (frame(pd.DataFrame({HEADER[k]: v for k, v in COLUMNS.items()})), "psi; is it 'psy [deg]'?"),
    "a dict": (frame(COLUMNS), "takes a DataFrame"),
}


@pytest.mark.parametrize(("make", "words"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_is_said_by_the_name_of_the_column(make: Callable[[], Trial], words: str) -> None:
    with pytest.raises(UserError) as error:
        make()
    assert words in str(error.value) and "\n" not in str(error.value)


def test_a_trial_is_checked_when_it_is_made() -> None:
    for changed in ({"u": np.ones(3)}, {"t": T[::-1]}, {"t": np.zeros(N)}):
        with pytest.raises(UserError):
            Trial("run", {**COLUMNS, **changed})


def test_slices_are_by_time_and_a_sum_is_a_set() -> None:
    trial = Trial.from_arrays(name="run", **COLUMNS)
    part = trial[5.0:10.0]
    assert part.t[0] == 5.0 and part.t[-1] == 10.0 and len(part) == 11 and len(trial[20.0:]) == 20
    with pytest.raises(UserError):
        trial[100.0:200.0]
    both = trial + part
    assert isinstance(both, TrialSet) and [len(t) for t in both] == [N, 11] and len(both + both) == 4
    assert len(repr(trial).splitlines()) == len(repr(both).splitlines()) == 1
    assert (pickle.loads(pickle.dumps(trial))["u"] == trial["u"]).all()


def test_a_resampled_trial_goes_along_lines_and_holds_its_inputs() -> None:
    psi = np.angle(np.exp(1j * (3.0 + 0.1 * T)))  # goes through south
    u = np.where((T > 4) & (T < 6), np.nan, COLUMNS["u"])
    trial = Trial.from_arrays(**{**COLUMNS, "psi": psi, "r": np.full(N, 0.1), "u": u})
    found = trial.resample(0.2)
    assert found.t[1] == pytest.approx(0.2) and found.t[-1] <= trial.t[-1] + 1e-9
    np.testing.assert_allclose(found.psi_unwrapped, 3.0 + 0.1 * found.t, atol=1e-9)
    assert set(found["delta"]) == {0.0, 0.3} and found["delta"][found.t <= 10.4].max() == 0.0
    gap = (found.t > 4.01) & (found.t < 5.99)
    assert np.isnan(found["u"][gap]).all() and np.isfinite(found["u"][(found.t < 3.9) | (found.t > 6.1)]).all()
    sampled = Trial.from_arrays(**COLUMNS, inputs="sampled").resample(0.2)
    at = np.flatnonzero(np.isclose(sampled.t, 10.2))[0]
    assert sampled["delta"][at] == pytest.approx(0.3 * 0.4)
    for dt in (0.0, math.nan, 1e6):
        with pytest.raises(UserError):
            trial.resample(dt)
