"""Bags of robots, buses of ships, JSON, arrays, long tables and columns without headers come in as they were."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.importing.import_logs import Imported, import_logs, write_import
from cases.importing.import_map import ImportMap, line_of, read_map
from cases.trial import Trial
from tests.support import raw_logs
from tests.support.raw_logs import BEGIN, KNOT, chosen, errors, globe, ground, imported, stamp

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

for needed in ("rosbags", "nmea2000", "h5py", "pyproj"):
    pytest.importorskip(needed, reason="needs the extras of the import")

# Logs of a run whose truth is known, written with the libraries of their formats
EPOCH = BEGIN.timestamp()
"""Seconds since 1970 at the begin of the logs."""
ENU, NED = ("map", "base_link"), ("map_ned", "base_link_frd")


def _quaternion(yaw: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))


def bag(
    path: Path,
    trial: Trial,
    kind: str = "db3",
    frames: tuple[str, str] = ENU,
    clock: float = 0.0,
    twice: bool = False,
    in_world: bool = False,
) -> Path:
    """A bag of odometry (2 Hz), rudder and revolutions (1 Hz, without stamps), and an order.

    kind: "bag" (ROS 1), "db3" or "mcap"; frames: of the odometry, north-east-down where they say so; clock: seconds by
    which the stamps are behind the receipt; twice: a second topic of odometry, 30 m off; in_world: velocities
    along east and north.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    first = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    types = store.types
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer: Any = Writer1(path) if first else Writer2(path, version=8, storage_plugin=plugin)
    down = "ned" in frames[0]
    with writer:
        topics = {"/odom": "nav_msgs/msg/Odometry", "/rudder_angle": "std_msgs/msg/Float64"}
        topics |= {"/shaft/rpm": "std_msgs/msg/Float32", "/cmd/rudder": "std_msgs/msg/Float64"}
        topics |= {"/odom/filtered": "nav_msgs/msg/Odometry"} if twice else {}
        at = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}

        def write(topic: str, t: float, message: Any) -> None:
            made = store.serialize_ros1 if first else store.serialize_cdr
            writer.write(at[topic], round((EPOCH + t + 0.01) * 1e9), made(message, topics[topic]))

        vector, point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
        for i, t in enumerate(trial.t):
            x, y, psi, u, v, r = (float(trial[name][i]) for name in ("x", "y", "psi", "u", "v", "r"))
            yaw, sign = (psi, 1.0) if down else (np.pi / 2 - psi, -1.0)
            ahead, aside = u, sign * v
            if in_world:
                ahead, aside = u * np.sin(psi) + v * np.cos(psi), u * np.cos(psi) - v * np.sin(psi)
            place = point(x=x, y=y, z=0.0) if down else point(x=y, y=x, z=0.0)
            pose = types["geometry_msgs/msg/Pose"](
                position=place, orientation=types["geometry_msgs/msg/Quaternion"](*_quaternion(yaw))
            )
            twist = types["geometry_msgs/msg/Twist"](
                linear=vector(x=ahead, y=aside, z=0.0), angular=vector(x=0.0, y=0.0, z=sign * r)
            )
            seconds, nanoseconds = divmod(round((EPOCH + t - clock) * 1e9), 10**9)
            when = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
            seq = {"seq": i} if first else {}
            header = types["std_msgs/msg/Header"](stamp=when, frame_id=frames[0], **seq)
            none = np.zeros(36)
            message = types["nav_msgs/msg/Odometry"](
                header=header, child_frame_id=frames[1],
                pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=none),
                twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=none),
            )  # fmt: skip
            write("/odom", t, message)
            if twice:
                place.x += 30.0
                write("/odom/filtered", t, message)
            if i % 2 == 0:
                write("/rudder_angle", t, types["std_msgs/msg/Float64"](data=float(np.degrees(trial["delta"][i]))))
                write("/shaft/rpm", t, types["std_msgs/msg/Float32"](data=float(60 * trial["n"][i])))
                write("/cmd/rudder", t, types["std_msgs/msg/Float64"](data=0.5))
    return path if first else next(path.glob(f"*.{kind}"))


def said_on_bus(
    trial: Trial, magnetic: float | None = None, variation: float | None = None
) -> Iterator[tuple[float, str, dict[str, Any], int]]:
    """Time [s], group of parameters, fields in SI and source of what a ship's bus says, in the order of its times.

    magnetic: variation [rad] by which the headings are magnetic; variation: that the bus says [rad].
    """
    lat, lon = globe(trial)
    sog, cog = ground(trial)
    for i, t in enumerate(trial.t):
        heading = (trial["psi"][i] - (magnetic or 0.0)) % (2 * np.pi)
        of = "True" if magnetic is None else "Magnetic"
        yield t, "positionRapidUpdate", {"latitude": lat[i], "longitude": lon[i]}, 3
        yield t, "cogSogRapidUpdate", {"cogReference": "True", "cog": np.radians(cog[i]), "sog": sog[i] * KNOT}, 3
        yield t, "vesselHeading", {"heading": heading, "reference": of}, 35
        yield t, "rateOfTurn", {"rate": trial["r"][i]}, 35
        if i % 2 == 0:
            yield t, "rudder", {"instance": 0, "position": trial["delta"][i]}, 8
            yield t, "engineParametersRapidUpdate", {"instance": 0, "speed": trial["n"][i]}, 9
        if i % 20 == 0 and variation is not None:
            yield t, "magneticVariation", {"variation": variation}, 3
        if i % 20 == 0:
            yield t, "heartbeat", {"dataTransmitOffset": 60}, 3


def bus(path: Path, trial: Trial, kind: str = "candump", **more: float | None) -> Path:
    """A log of NMEA 2000: "candump", "ascii" (Actisense), "plain" or "json" (canboat), "yacht" (Yacht Devices)."""
    from nmea2000.backend import DATABASE as data

    of = {info.id: info for info in data.pgns()}
    lines = ['{"version":"5.0.0","units":"std","showLookupValues":false}'] if kind == "json" else []
    for t, name, fields, source in said_on_bus(trial, **more):
        now, pgn = stamp(t), of[name].pgn
        content = data.encode(
            name, {key: v if isinstance(v, str) else float(v) if key != "instance" else v for key, v in fields.items()}
        )
        hexadecimal, can = content.hex().upper(), f"{2 << 26 | pgn << 8 | source:08X}"
        if kind == "candump":
            lines.append(f"({EPOCH + t:.6f}) can0 {can}#{hexadecimal}")
        elif kind == "yacht":
            lines.append(f"{now[11:23]} R {can} {' '.join(f'{b:02X}' for b in content)}")
        elif kind == "ascii":
            lines.append(f"A{now[11:23].replace(':', '')} {source:02X}FF7 {pgn:05X} {hexadecimal}")
        elif kind == "plain":
            listed = ",".join(f"{b:02x}" for b in content)
            lines.append(f"{now[:23].replace('T', '-')},2,{pgn},{source},255,{len(content)},{listed}")
        else:
            lines.append(json.dumps(_canboat(now, pgn, source, fields)))
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def _canboat(now: str, pgn: int, source: int, fields: Mapping[str, Any]) -> dict[str, Any]:
    """A message as canboat's analyzer writes it, in degrees and rpm."""
    names = {"cogReference": "COG Reference", "cog": "COG", "sog": "SOG"}
    scale = {f: 180 / np.pi for f in ("cog", "heading", "rate", "position", "variation")} | {"speed": 60.0}
    shown = {
        names.get(f, f.capitalize()): v if isinstance(v, str | int) else v * scale.get(f, 1) for f, v in fields.items()
    }
    return {"timestamp": f"{now[:23]}Z", "prio": 2, "src": source, "dst": 255, "pgn": pgn, "fields": shown}


def signal_k(path: Path, trial: Trial) -> Path:
    """Deltas of Signal K: the own ship's in SI, and those of another ship's AIS."""
    lat, lon = globe(trial)
    sog, cog = ground(trial)
    lines = [{"name": "signalk-server", "version": "1.7.0", "self": "vessels.urn:mrn:imo:mmsi:230099999"}]
    for i, t in enumerate(trial.t):
        place = {"latitude": lat[i], "longitude": lon[i]}
        said = {"navigation.position": place, "navigation.headingTrue": float(trial["psi"][i] % (2 * np.pi))}
        said |= {"navigation.speedOverGround": sog[i] * KNOT, "navigation.courseOverGroundTrue": np.radians(cog[i])}
        said |= {"navigation.rateOfTurn": float(trial["r"][i]), "environment.depth.belowKeel": 12.0}
        if i % 2 == 0:
            said |= {
                "steering.rudderAngle": float(trial["delta"][i]),
                "propulsion.main.revolutions": float(trial["n"][i]),
            }
        values = [{"path": name, "value": value} for name, value in said.items()]
        update = {"$source": "n2k.1", "timestamp": stamp(t).replace("+00:00", "Z"), "values": values}
        lines.append({"context": lines[0]["self"], "updates": [update]})
        far = {"path": "navigation.position", "value": {"latitude": 1.0, "longitude": 2.0}}
        lines.append({"context": "vessels.urn:mrn:imo:mmsi:1", "updates": [{**update, "values": [far]}]})
    path.write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")
    return path


LOCAL_IDS = {
    "psi": "/dnv-v2/vis-3-11a/N52/meta/qty-heading.true", "r": "/dnv-v2/vis-3-11a/N52/meta/qty-rate.of.turn",
    "u": "/dnv-v2/vis-3-11a/NS1/meta/qty-longitudinal.speed.over.ground",
    "v": "/dnv-v2/vis-3-11a/NS1/meta/qty-transverse.speed.over.ground",
    "delta": "/dnv-v2/vis-3-11a/421.2/HS5/meta/qty-angle",
    "n": "/dnv-v2/vis-3-11a/412.7/C321/meta/qty-rotational.frequency",
}  # fmt: skip


def iso19848(path: Path, trial: Trial) -> Path:
    """A time series package: heading and speeds as tabular data every 0.5 s, rudder and revolutions as events."""
    table = [LOCAL_IDS[name] for name in ("psi", "r", "u", "v")]
    rows = [
        {
            "TimeStamp": stamp(t),
            "Value": [f"{trial[name][i]:.9f}" for name in ("psi", "r", "u", "v")],
            "Quality": ["0"] * 4,
        }
        for i, t in enumerate(trial.t)
    ]
    rows[len(rows) // 2] |= {"Value": ["9.9"] * 4, "Quality": ["4"] * 4}
    events = [
        {"TimeStamp": stamp(t), "DataChannelID": LOCAL_IDS[name], "Value": f"{trial[name][i]:.9f}", "Quality": "0"}
        for i, t in enumerate(trial.t) if i % 2 == 0 for name in ("delta", "n")
    ]  # fmt: skip
    data = {"TabularData": [{"DataChannelID": table, "DataSet": rows}], "EventData": {"DataSet": events}}
    path.write_text(json.dumps({"Package": {"Header": {"ShipID": "IMO1234567"}, "TimeSeriesData": [data]}}), "utf-8")
    return path


STATES = {"x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s"}
INPUTS = {"n": "rps", "delta": "rad"}


def matlab(path: Path, trial: Trial, kind: str) -> Path:
    """A .mat file: "vectors", "struct" with a datenum, "series" (time and values each), or "runs" (an array)."""
    from scipy.io import savemat

    data = {name: trial[name] for name in (*STATES, *INPUTS)}
    struct = {"time_s": trial.t, **{f"{name}": values for name, values in data.items()}}
    if kind == "vectors":
        savemat(path, {**struct, "L_pp": 7.0})
    elif kind == "struct":
        days = 719529.0 + (EPOCH + trial.t) / 86400
        savemat(path, {"log": {**data, "time": days}})
    elif kind == "series":
        every = {name: 1 if name in STATES else 2 for name in data}
        savemat(path, {k: {"time": trial.t[:: every[k]], "values": v[:: every[k]]} for k, v in data.items()})
    else:
        savemat(path, {"run": [struct, {**struct, "delta": -struct["delta"]}]})
    return path


def hdf5(path: Path, trial: Trial, kind: str) -> Path:
    """An HDF5 file: "groups" of other rates, "runs" with equal names, "netcdf" (seconds since), or "matrix"."""
    import h5py

    with h5py.File(path, "w") as file:
        if kind == "matrix":
            names = ["time_s", *STATES, *INPUTS]
            file["data"] = np.column_stack([trial.t, *(trial[name] for name in names[1:])])
            file["data"].attrs["columns"] = names
            return path
        for run in ("run1", "run2") if kind == "runs" else ("",):
            for group, units, every in (
                (("nav", STATES, 1), ("machinery", INPUTS, 2)) if kind == "groups" else (("", STATES | INPUTS, 1),)
            ):
                top = file.require_group(f"{run}/{group}".strip("/")) if run or group else file
                top["time"] = trial.t[::every]
                top["time"].attrs["units"] = f"seconds since {stamp(0.0)[:19]}" if kind == "netcdf" else "s"
                for name, unit in units.items():
                    top[name] = trial[name][::every]
                    top[name].attrs["units"] = unit
                if kind == "netcdf":  # packed
                    del top["delta"]
                    top["delta"] = np.round((trial["delta"] - 0.1) * 1e8).astype("i4")
                    top["delta"].attrs.update({"units": "rad", "scale_factor": 1e-8, "add_offset": 0.1})
    return path


def netcdf_3(path: Path, trial: Trial) -> Path:
    """A file of netCDF before version 4."""
    from scipy.io import netcdf_file

    with netcdf_file(str(path), "w") as file:
        file.createDimension("time", len(trial))
        for name, unit in {"time": f"seconds since {stamp(0.0)[:19]}", **STATES, **INPUTS}.items():
            variable = file.createVariable(name, "f8", ("time",))
            variable[:], variable.units = trial.t if name == "time" else trial[name], unit
    return path


def long_rows(path: Path, trial: Trial) -> Path:
    """A row a quantity: time, name, value, unit; inputs every second, states every half."""
    lines = ["timestamp,signal,value,unit,quality"]
    for i, t in enumerate(trial.t):
        for name, unit in (STATES | INPUTS).items() if i % 2 == 0 else STATES.items():
            lines.append(f"{stamp(t)},{name},{trial[name][i]:.9f},{unit},ok")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def without_headers(path: Path, trial: Trial) -> Path:
    """Columns of numbers alone, as of the SIMMAN workshops: t, x, y, psi, u, v, r, n, delta."""
    columns = [trial.t, *(trial[name] for name in STATES | INPUTS)]
    np.savetxt(path, np.column_stack(columns), fmt="%.9f")
    return path


# They come in as they were
TRUTH = raw_logs.run("turning:35")
ENGINE = {"n": "127488 (source 9) Single Engine or Dual Engine Port speed"}
UNITS = STATES | INPUTS
# Columns by their names or numbers, with the units that the file does not say.
NAMED = {name: {"from": name, "unit": unit} for name, unit in UNITS.items()}
NUMBERED = {name: {"from": i, "unit": unit} for i, (name, unit) in enumerate({"t": "s", **UNITS}.items(), 1)}
LOCAL = {name: {"from": LOCAL_IDS[name], "unit": UNITS[name]} for name in LOCAL_IDS}
Write = Callable[[Path], Path]
EXACTLY, DERIVED = False, True
# Format -> how a log of it is written, columns of the map, and whether u and v are derived.
FORMATS: dict[str, tuple[Write, dict[str, Any], bool]] = {
    "ROS 1": (lambda d: bag(d / "a.bag", TRUTH, "bag"), {}, EXACTLY),
    "ROS 2": (lambda d: bag(d / "a", TRUTH, "db3"), {}, EXACTLY),
    "ROS 2, another clock": (lambda d: bag(d / "a", TRUTH, "db3", clock=5e8), {}, EXACTLY),
    "ROS 2, velocities along the axes of the world, told by the positions": (
        lambda d: bag(d / "a", TRUTH, in_world=True), {}, EXACTLY),
    "MCAP": (lambda d: bag(d / "a", TRUTH, "mcap"), {}, EXACTLY),
    "MCAP, north-east-down": (lambda d: bag(d / "a", TRUTH, "mcap", NED), {}, EXACTLY),
    "candump": (lambda d: bus(d / "a.log", TRUTH), ENGINE, DERIVED),
    "Actisense": (lambda d: bus(d / "a.log", TRUTH, "ascii"), ENGINE, DERIVED),
    "canboat": (lambda d: bus(d / "a.csv", TRUTH, "plain"), ENGINE, DERIVED),
    "canboat JSON": (lambda d: bus(d / "a.json", TRUTH, "json"), {"n": "127488 (source 9) 0 speed"}, DERIVED),
    "Yacht Devices": (lambda d: bus(d / "a.txt", TRUTH, "yacht"), ENGINE, DERIVED),
    "variation on the bus": (lambda d: bus(d / "a.log", TRUTH, magnetic=0.1, variation=0.1), ENGINE, DERIVED),
    "Signal K": (
        lambda d: signal_k(d / "a.jsonl", TRUTH), {"n": "propulsion.main.revolutions (n2k.1)"}, DERIVED,
    ),
    "ISO 19848": (lambda d: iso19848(d / "a.json", TRUTH), LOCAL, DERIVED),
    "MATLAB vectors": (lambda d: matlab(d / "a.mat", TRUTH, "vectors"), NAMED, EXACTLY),
    "MATLAB struct": (lambda d: matlab(d / "a.mat", TRUTH, "struct"), NAMED, EXACTLY),
    "MATLAB series": (lambda d: matlab(d / "a.mat", TRUTH, "series"), NAMED, EXACTLY),
    "HDF5 groups": (lambda d: hdf5(d / "a.h5", TRUTH, "groups"), {}, EXACTLY),
    "HDF5 matrix": (lambda d: hdf5(d / "a.h5", TRUTH, "matrix"), NAMED, EXACTLY),
    "netCDF": (lambda d: hdf5(d / "a.nc", TRUTH, "netcdf"), {}, EXACTLY),
    "netCDF 3": (lambda d: netcdf_3(d / "a.nc", TRUTH), {}, EXACTLY),
    "long table": (lambda d: long_rows(d / "a.csv", TRUTH), {}, EXACTLY),
    "SIMMAN": (lambda d: without_headers(d / "a.dat", TRUTH), NUMBERED, EXACTLY),
}  # fmt: skip


def off(found: Imported) -> dict[str, float]:
    """Largest difference of each column from the truth; of inputs at the seconds they have."""
    columns = found.runs[0].columns
    second = np.abs(columns["t"] - np.round(columns["t"])) < 1e-4
    inputs = {name: columns[name][second] for name in ("t", *INPUTS) if name in columns}
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
    for path in (bus(tmp_path / "a.log", TRUTH), signal_k(tmp_path / "a.jsonl", TRUTH)):
        (question,) = import_logs([path]).questions
        assert list(question.choices) == ["n", "n_2", "nothing"]
        line = re.search(r"\[columns\] (n = .*)", refusal(path))
        assert line
        imported(path, chosen(columns=tomllib.loads(line[1])))


def test_ships_of_ais_are_told_apart(tmp_path: Path) -> None:
    path = signal_k(tmp_path / "a.jsonl", TRUTH)
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
    words = refusal(without_headers(tmp_path / "a.dat", TRUTH))
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
