"""Bags of robots, buses of ships, JSON, arrays, long tables and columns without headers come in as they were."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.importing.import_logs import Imported, import_logs, write_import
from cases.importing.import_map import ImportMap, line_of, read_map
from tests.support import format_logs, raw_logs
from tests.support.raw_logs import chosen, errors, imported

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

for needed in ("rosbags", "nmea2000", "h5py", "pyproj"):
    pytest.importorskip(needed, reason="needs the extras of the import")

TRUTH = raw_logs.run("turning:35")
ENGINE = {"n": "127488 (source 9) Single Engine or Dual Engine Port speed"}
UNITS = format_logs.STATES | format_logs.INPUTS
# Columns by their names or numbers, with the units that the file does not say.
NAMED = {name: {"from": name, "unit": unit} for name, unit in UNITS.items()}
NUMBERED = {name: {"from": i, "unit": unit} for i, (name, unit) in enumerate({"t": "s", **UNITS}.items(), 1)}
LOCAL = {name: {"from": format_logs.LOCAL_IDS[name], "unit": UNITS[name]} for name in format_logs.LOCAL_IDS}
Write = Callable[[Path], Path]
bag, bus, matlab, hdf5 = format_logs.bag, format_logs.bus, format_logs.matlab, format_logs.hdf5
EXACTLY, DERIVED = False, True
# Format -> how a log of it is written, columns of the map, and whether u and v are derived.
FORMATS: dict[str, tuple[Write, dict[str, Any], bool]] = {
    "ROS 1": (lambda d: bag(d / "a.bag", TRUTH, "bag"), {}, EXACTLY),
    "ROS 2": (lambda d: bag(d / "a", TRUTH, "db3"), {}, EXACTLY),
    "ROS 2, another clock": (lambda d: bag(d / "a", TRUTH, "db3", clock=5e8), {}, EXACTLY),
    "ROS 2, velocities along the axes of the world, told by the positions": (
        lambda d: bag(d / "a", TRUTH, in_world=True), {}, EXACTLY),
    "MCAP": (lambda d: bag(d / "a", TRUTH, "mcap"), {}, EXACTLY),
    "MCAP, north-east-down": (lambda d: bag(d / "a", TRUTH, "mcap", format_logs.NED), {}, EXACTLY),
    "candump": (lambda d: bus(d / "a.log", TRUTH), ENGINE, DERIVED),
    "Actisense": (lambda d: bus(d / "a.log", TRUTH, "ascii"), ENGINE, DERIVED),
    "canboat": (lambda d: bus(d / "a.csv", TRUTH, "plain"), ENGINE, DERIVED),
    "canboat JSON": (lambda d: bus(d / "a.json", TRUTH, "json"), {"n": "127488 (source 9) 0 speed"}, DERIVED),
    "Yacht Devices": (lambda d: bus(d / "a.txt", TRUTH, "yacht"), ENGINE, DERIVED),
    "variation on the bus": (lambda d: bus(d / "a.log", TRUTH, magnetic=0.1, variation=0.1), ENGINE, DERIVED),
    "Signal K": (
        lambda d: format_logs.signal_k(d / "a.jsonl", TRUTH), {"n": "propulsion.main.revolutions (n2k.1)"}, DERIVED,
    ),
    "ISO 19848": (lambda d: format_logs.iso19848(d / "a.json", TRUTH), LOCAL, DERIVED),
    "MATLAB vectors": (lambda d: matlab(d / "a.mat", TRUTH, "vectors"), NAMED, EXACTLY),
    "MATLAB struct": (lambda d: matlab(d / "a.mat", TRUTH, "struct"), NAMED, EXACTLY),
    "MATLAB series": (lambda d: matlab(d / "a.mat", TRUTH, "series"), NAMED, EXACTLY),
    "HDF5 groups": (lambda d: hdf5(d / "a.h5", TRUTH, "groups"), {}, EXACTLY),
    "HDF5 matrix": (lambda d: hdf5(d / "a.h5", TRUTH, "matrix"), NAMED, EXACTLY),
    "netCDF": (lambda d: hdf5(d / "a.nc", TRUTH, "netcdf"), {}, EXACTLY),
    "netCDF 3": (lambda d: format_logs.netcdf_3(d / "a.nc", TRUTH), {}, EXACTLY),
    "long table": (lambda d: format_logs.long_rows(d / "a.csv", TRUTH), {}, EXACTLY),
    "SIMMAN": (lambda d: format_logs.without_headers(d / "a.dat", TRUTH), NUMBERED, EXACTLY),
}  # fmt: skip


def off(found: Imported) -> dict[str, float]:
    """Largest difference of each column from the truth; of inputs at the seconds they have."""
    columns = found.runs[0].columns
    second = np.abs(columns["t"] - np.round(columns["t"])) < 1e-4
    inputs = {name: columns[name][second] for name in ("t", *format_logs.INPUTS) if name in columns}
    return errors(columns, TRUTH) | errors(inputs, TRUTH)


# Of what was derived from positions, in the resolution of the bus, or where a row is left out.
LIMITS = {"x": 0.02, "y": 0.02, "psi": 1e-3, "u": 3e-3, "v": 6e-3, "r": 2e-4, "n": 1e-3, "delta": 1e-4}
EXACT = dict.fromkeys(LIMITS, 1e-6) | {"x": 1e-5, "y": 1e-5}  # Of what was logged with all digits


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_a_turning_circle_comes_back(name: str, tmp_path: Path) -> None:
    write, said, derived = FORMATS[name]
    (tmp_path / "logs").mkdir()
    write(tmp_path / "logs")
    given = chosen(columns=said)
    found = imported(tmp_path / "logs", given)
    wrong, limits = off(found), LIMITS if derived else EXACT
    assert {"psi", "u", "v", "r", "n", "delta"} <= set(wrong)
    assert all(error < limits[column] for column, error in wrong.items()), wrong
    first = write_import(found, given, tmp_path / "one")
    again = read_map(tmp_path / "one" / "import.toml")
    second = write_import(imported(tmp_path / "logs", again), again, tmp_path / "two")
    assert [file.read_bytes() for file in first] == [file.read_bytes() for file in second]


def refusal(path: Path, **said: Any) -> str:
    """The one line by which the log ``path`` is refused."""
    found = import_logs([path], chosen(**said))
    assert len(found.problems) == 1 and not found.runs, found
    assert "\n" not in found.problems[0]
    return found.problems[0]


def test_two_topics_of_odometry_are_asked_for(tmp_path: Path) -> None:
    path = bag(tmp_path / "a", TRUTH, twice=True)
    (question,) = import_logs([path]).questions
    answer = question.choices["'/odom'"]
    assert answer == {"ignore": ["/odom/filtered"]} and line_of(answer) in refusal(path)
    found = imported(path, chosen(**answer))
    assert off(found)["psi"] < 1e-6
    used = {account.what: account.used_as for account in found.runs[0].logs[0].table.accounts}
    assert used["/odom linear y"] == ("v",) and used["/odom/filtered"] == used["/cmd/rudder"] == ()


def test_sensors_that_say_the_same_twice_need_no_choice(tmp_path: Path) -> None:
    path = bus(tmp_path / "a.log", TRUTH)
    (tmp_path / "about.json").write_text('{"ship": "AURORA"}')  # no log, and none of the files of a folder
    assert imported(tmp_path, chosen(columns=ENGINE)).runs
    content = path.read_text().splitlines()
    again = [line.replace("09F10D08#00", "09F10DAC#FC") for line in content if "09F10D08#00" in line]  # another source
    path.write_text("\n".join(sorted([*content, *again])))
    assert off(imported(path, chosen(columns=ENGINE)))["delta"] < 1e-4
    others = [line[:-8] + "0001" + line[-4:] for line in again]  # which stands still
    path.write_text("\n".join(sorted([*content, *others])))
    assert "delta is said by" in refusal(path, columns=ENGINE)


def test_a_bag_of_several_files_is_read_once(tmp_path: Path) -> None:
    path = bag(tmp_path / "a", TRUTH, "mcap")
    assert len(import_logs([tmp_path]).runs) == len(import_logs([path]).runs) == 1
    assert off(imported(Path(shutil.copy(path, tmp_path / "alone.mcap"))))["v"] < 1e-6


def test_the_map_says_the_axes_where_frames_do_not(tmp_path: Path) -> None:
    path = bag(tmp_path / "a", TRUTH, frames=("ned", "frd"))
    plain = tmp_path / "plain.db3"
    content = path.read_bytes().replace(b"\x04\0\0\0ned\0", b"\x04\0\0\0map\0")
    plain.write_bytes(content.replace(b"\x04\0\0\0frd\0", b"\x04\0\0\0hul\0"))
    assert off(imported(plain, ImportMap(axes="ned")))["psi"] < 1e-6
    assert off(imported(plain))["psi"] > 1.0


def test_revolutions_of_an_engine_are_asked_for(tmp_path: Path) -> None:
    for path in (bus(tmp_path / "a.log", TRUTH), format_logs.signal_k(tmp_path / "a.jsonl", TRUTH)):
        (question,) = import_logs([path]).questions
        assert list(question.choices) == ["n", "n_2", "nothing"]
        line = re.search(r"\[columns\] (n = .*)", refusal(path))
        assert line
        imported(path, chosen(columns=tomllib.loads(line[1])))


def test_ships_of_ais_are_told_apart(tmp_path: Path) -> None:
    path = format_logs.signal_k(tmp_path / "a.jsonl", TRUTH)
    path.write_text(path.read_text().partition("\n")[2])
    found = imported(path, chosen(columns=FORMATS["Signal K"][1]))
    assert off(found)["x"] < 0.02
    used = {account.what: account.rows for account in found.runs[0].logs[0].table.accounts}
    assert used["vessels.urn:mrn:imo:mmsi:1"] == 2 * len(TRUTH.t)


def test_groups_with_the_same_names_are_runs(tmp_path: Path) -> None:
    found = import_logs([hdf5(tmp_path / "a.h5", TRUTH, "runs")])
    assert [run.name for run in found.runs] == ["a_run1", "a_run2"]
    found = imported(matlab(tmp_path / "b.mat", TRUTH, "runs"), chosen(columns=NAMED))
    assert np.array_equal(found.runs[0].columns["delta"], -found.runs[1].columns["delta"])


def test_a_file_without_headers_names_the_line_of_the_map(tmp_path: Path) -> None:
    words = refusal(format_logs.without_headers(tmp_path / "a.dat", TRUTH))
    line = re.search(r"\bcolumns = .*", words)
    assert line and "0.0, 0.0, 0.0" in words
    said = tomllib.loads(line[0].partition(" in the map")[0].removesuffix(" and so on"))
    assert chosen(**said).columns["x"].header == "column 2"


@pytest.mark.parametrize(
    ("module", "name"), [("rosbags.highlevel", "MCAP"), ("h5py", "HDF5 groups"), ("nmea2000.decoder", "candump")]
)
def test_what_is_not_installed_is_named(
    module: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = FORMATS[name][0](tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    assert "pip install 'mmg-ident[import]'" in refusal(path)


@pytest.mark.parametrize("name", ["ROS 1", "ROS 2", "MCAP", "MATLAB vectors", "HDF5 groups", "ISO 19848"])
@pytest.mark.parametrize("damage", ["cut off", "empty", "other bytes"])
def test_damaged_files_are_refused_in_one_line(name: str, damage: str, tmp_path: Path) -> None:
    good = FORMATS[name][0](tmp_path)
    content, path = good.read_bytes(), tmp_path / f"damaged{good.suffix}"
    cut = content[: len(content) // 2]
    path.write_bytes({"cut off": cut, "empty": b"", "other bytes": bytes(range(256)) * 40}[damage])
    assert str(path) in refusal(path)


def test_objects_of_matlab_are_named(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["T"] = np.zeros((6, 1), dtype="uint32")
        file["T"].attrs["MATLAB_class"] = np.bytes_("table")
    assert "T is a table" in refusal(tmp_path / "a.mat")
