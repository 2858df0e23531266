from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cases.checks import check
from cases.io.conventions import heading_and_rate, mislabelled
from cases.io.read import read_controls, read_trial, read_trials
from cases.quantities import UNITS
from mmg.errors import UserError
from mmg.messages import has_code
from mmg.motion.frames import apparent_wind
from tests.support.trial_files import motion_columns, write_csv

DEG = np.pi / 180


def refused(path, said):
    with pytest.raises(UserError, match=said) as error:
        read_trial(path)
    text = str(error.value)
    assert "\n" not in text and path.name in text
    return text


def replaced(path, line, column, text):
    """Writes text into one cell of a CSV (line 0 = header)."""
    rows = [row.split(",") for row in path.read_text().splitlines()]
    rows[line][column] = text
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")


def test_canonical_csv_and_parquet_are_read_as_they_are(tmp_path):
    truth = motion_columns(20.0)
    pd.DataFrame({f"{c} [{UNITS[c]}]": v for c, v in truth.items()}).to_parquet(tmp_path / "run.parquet")
    for path in (write_csv(tmp_path / "run.csv", truth), tmp_path / "run.parquet"):
        trial = read_trial(path)
        assert trial.name == "run" and trial.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
        assert trial.notices == ()
        for name, values in truth.items():
            np.testing.assert_allclose(trial[name], values, rtol=1e-12, atol=1e-15)


def test_degrees_knots_and_rpm_are_converted_and_said(tmp_path):
    truth = motion_columns(20.0)
    stored = {**truth, "psi": truth["psi"] / DEG, "r": truth["r"] / DEG, "u": truth["u"] * 3600 / 1852}
    headers = {"psi": "psi [deg]", "r": "r [deg/s]", "u": "u [kn]"}
    trial = read_trial(write_csv(tmp_path / "run.csv", stored, headers))
    for name in ("psi", "r", "u"):
        np.testing.assert_allclose(trial[name], truth[name], rtol=1e-12, atol=1e-15)
    assert len([n for n in trial.notices if "converted" in n]) == 3


@pytest.mark.parametrize(
    ("line", "column", "text", "said"),
    [(17, 4, "fast", r"row 17, column 'u \[m/s\]': 'fast' is not a number"), (6, 0, "0.4", "repeats at row 6"),
     (6, 0, "0.2", "runs backwards at row 6"), (151, 0, "3.0", "backwards at row 151: t = 14.9 s, then 3 s"),
     (151, 4, "1e14", r"row 151, column 'u \[m/s\]': 1e\+14 is larger")],
)  # fmt: skip
def test_a_wrong_cell_is_named_with_its_row(tmp_path, monkeypatch, line, column, text, said):
    """Read at once, in pieces, and in pieces whose rows are averaged."""
    path = write_csv(tmp_path / "run.csv")
    replaced(path, line, column, text)
    for kept, block in ((10**6, 2**21), (10**6, 2000), (50, 2000)):
        monkeypatch.setattr("cases.io.text_table.MOST_KEPT", kept)
        monkeypatch.setattr("cases.io.text_table.BLOCK", block)
        refused(path, said)


def test_a_missing_column_or_unit_is_named_with_the_headers_found_and_the_mapping(tmp_path):
    columns = motion_columns(20.0)
    refused(write_csv(tmp_path / "unit.csv", headers={"t": "t"}), "column 't' has no unit")
    del columns["r"]
    text = refused(write_csv(tmp_path / "run.csv", columns), "missing column r; found: t ")
    assert "columns = { r =" in text


def test_all_nan_one_row_empty_files_and_those_without_headers_are_refused(tmp_path):
    columns = motion_columns(20.0)
    nothing = {name: np.full(len(v), np.nan) for name, v in columns.items()}
    refused(write_csv(tmp_path / "nan.csv", nothing), "no row holds a time and a state")
    refused(write_csv(tmp_path / "one.csv", columns, rows=1), "only one usable row")
    refused(write_csv(tmp_path / "none.csv", columns, rows=0), "no rows")
    header, rows = write_csv(tmp_path / "run.csv").read_text().split("\n", 1)
    texts = {"the file is empty": "", "numbers, not headers": rows, "first line is blank": f"\n{header}\n{rows}"}
    for said, text in texts.items():
        (tmp_path / "text.csv").write_text(text)
        refused(tmp_path / "text.csv", said)


def test_a_required_column_without_numbers_is_refused_an_optional_one_left_out(tmp_path):
    columns = motion_columns(20.0)
    empty = np.full(len(columns["t"]), np.nan)
    refused(write_csv(tmp_path / "a.csv", {**columns, "n": empty}), "column n holds no number")
    trial = read_trial(write_csv(tmp_path / "b.csv", {**columns, "wind_speed": empty}))
    assert not trial.has_wind and has_code(trial.notices, "no_wind")


def test_doubled_headers_and_two_columns_for_one_quantity_are_refused(tmp_path):
    columns = motion_columns(20.0)
    refused(write_csv(tmp_path / "a.csv", columns, {"v": "u [m/s]"}), "names 'u .m/s.' twice")
    both = {**columns, "u_velo": columns["u"]}
    path = write_csv(tmp_path / "b.csv", both, {"u_velo": "u_velo [m/s]"})
    refused(path, "both 'u .m/s.' and 'u_velo .m/s.' are u")


def test_unreadable_files_are_refused(tmp_path):
    refused(tmp_path / "nowhere.csv", "no such file")
    (tmp_path / "run.xlsx").write_text("x")
    refused(tmp_path / "run.xlsx", "expected .csv or .parquet")
    (tmp_path / "run.parquet").write_text("x")
    refused(tmp_path / "run.parquet", "not a readable Parquet")
    path = write_csv(tmp_path / "semicolon.csv")
    path.write_text(path.read_text().replace(",", ";"))
    refused(path, "not separated by commas")
    with pytest.raises(UserError, match=r"no \.csv"):
        read_trials([(tmp_path / "folder", (tmp_path / "folder").mkdir())[0]])


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


def test_twin_rudders_stand_for_delta_and_one_alone_does_not(tmp_path):
    columns = motion_columns(20.0)
    columns["delta_port"] = columns.pop("delta")
    both = {**columns, "delta_starboard": 0.5 * columns["delta_port"]}
    assert "delta_port" in read_trial(write_csv(tmp_path / "a.csv", both))
    refused(write_csv(tmp_path / "b.csv", columns), "missing column delta_starboard")


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
