"""Raw logs as people have them, of a simulated run whose truth is known: other formats, clocks, units and signs."""

from __future__ import annotations

import datetime
import re
import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cases.importing.import_logs import Imported, import_logs
from cases.importing.import_map import ImportMap
from cases.io.toml_file import validated
from cases.trial import Trial
from mmg_ident import simulate

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

BEGIN = datetime.datetime(2026, 5, 4, 9, 30, tzinfo=datetime.timezone.utc)
ORIGIN = (34.7, 135.4)
KNOT = 1852.0 / 3600.0
M_PER_DEG = 110942.0, 91565.0
"""Metres of a degree of latitude and longitude there, on the WGS 84 ellipsoid, within 1e-4."""


@lru_cache
def run(maneuver: str = "zigzag:20/20", seed: int = 1) -> Trial:
    """A run of a 7 m tanker model without noise, every 0.5 s."""
    return simulate("kvlcc2_l7", maneuver, dt=0.5, duration=180, seed=seed)


def stamp(t: float, begin: datetime.datetime = BEGIN) -> str:
    """ISO 8601 of ``t`` [s] after the begin."""
    return (begin + datetime.timedelta(seconds=float(t))).isoformat(timespec="milliseconds")


def globe(trial: Trial, origin: tuple[float, float] = ORIGIN) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude [deg] of the positions about an ``origin``."""
    M = M_PER_DEG if origin == ORIGIN else (110942.0, 111320.0 * float(np.cos(np.radians(origin[0]))))
    return origin[0] + trial["x"] / M[0], origin[1] + trial["y"] / M[1]


def ground(trial: Trial) -> tuple[np.ndarray, np.ndarray]:
    """Speed [kn] and course [deg] over ground."""
    psi, u, v = trial["psi"], trial["u"], trial["v"]
    north, east = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
    return np.hypot(north, east) / KNOT, np.degrees(np.arctan2(east, north)) % 360


def semicolons(path: Path, trial: Trial) -> Path:
    """Semicolons, decimal commas, ISO times, positions on the globe, knots, degrees, rpm, rudder positive to port."""
    log = bridge(trial)
    log |= {"Rudder Angle [deg]": -np.asarray(log.pop("Rudder [deg]")), "Mood": ["good"] * len(trial)}
    style = {"sep": ";", "decimal": ",", "float_format": "%.8f", "index": False, "lineterminator": "\r\n"}
    path.write_bytes(f"Exported by LOGGER 3000\r\n{pd.DataFrame(log).to_csv(**style)}".encode("cp1252"))
    return path


def excel(path: Path, trial: Trial) -> Path:
    """A workbook with a title, headers, a line of units, and times of Excel."""
    import openpyxl

    book = openpyxl.Workbook()
    when = [(BEGIN + datetime.timedelta(seconds=float(t))).replace(tzinfo=None) for t in trial.t]
    angles = [np.degrees(trial["psi"]), np.degrees(trial["r"]) * 60]
    columns = [trial["x"], trial["y"], *angles, 60 * trial["n"], np.degrees(trial["delta"])]
    book.active.append(["Sea trial of the model"])
    book.active.append(["timestamp", "North", "East", "Yaw", "Yaw rate", "Shaft speed", "Rudder"])
    book.active.append(["", "m", "m", "deg", "deg/min", "rpm", "deg"])
    for row in zip(when, *(column.tolist() for column in columns), strict=True):
        book.active.append(row)
    book.save(path)
    return path


def sentence(body: str) -> str:
    """A sentence of NMEA 0183 with its checksum."""
    return f"${body}*{reduce(lambda a, c: a ^ ord(c), body, 0):02X}"


def nmea(path: Path, trial: Trial) -> Path:
    """Sentences of a satellite receiver, a gyro, a rudder indicator and a shaft, with a damaged line."""
    lat, lon = globe(trial)
    sog, cog = ground(trial)
    lines = []
    for i, t in enumerate(trial.t):
        now = BEGIN + datetime.timedelta(seconds=float(t))
        a, b = (f"{int(d):02d}{60 * (d - int(d)):09.6f}" for d in (lat[i], lon[i]))
        clock = f"{now:%H%M%S}.{now.microsecond // 10000:02d}"
        lines.append(sentence(f"GPRMC,{clock},A,{a},N,{b},E,{sog[i]:.4f},{cog[i]:.3f},{now:%d%m%y},,,A"))
        lines.append(sentence(f"HEHDT,{np.degrees(trial['psi'][i]) % 360:.3f},T"))
        lines.append(sentence(f"TIROT,{np.degrees(trial['r'][i]) * 60:.3f},A"))
        lines.append(sentence(f"AGRSA,{np.degrees(trial['delta'][i]):.3f},A,,V"))
        lines.append(sentence(f"IIRPM,S,1,{60 * trial['n'][i]:.3f},100,A"))
    lines[7] = lines[7][:12] + "9" + lines[7][13:]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def apart(folder: Path, trial: Trial) -> list[Path]:
    """One run in three files: satellites every second, gyro five times a second, actuators twice a second."""
    lat, lon = globe(trial)
    sog, cog = ground(trial)
    paths = [folder / f"run7_{name}.csv" for name in ("gnss", "gyro", "actuators")]

    def at(times: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.interp(times, trial.t, values)

    def epochs(times: np.ndarray) -> list[str]:
        return [f"{1000 * (BEGIN.timestamp() + t):.0f}" for t in times]

    end = trial.t[-1]
    one, two, three = np.arange(0, end, 1.0), np.arange(-3.0, end + 2, 0.2), np.arange(0.3, end, 0.5)
    course = np.degrees(at(one, np.unwrap(np.radians(cog)))) % 360
    gnss = {"utc": [stamp(t) for t in one], "lat": at(one, lat), "lon": at(one, lon)}
    table(paths[0], gnss | {"sog_kn": at(one, sog), "cog_deg": course})
    heading, rate = np.degrees(at(two, trial.psi_unwrapped)) % 360, np.degrees(at(two, trial["r"])) * 60
    table(paths[1], {"time": epochs(two), "heading_deg": heading, "rot_deg_min": rate})
    rpm, rudder = 60 * at(three, trial["n"]), np.degrees(at(three, trial["delta"]))
    table(paths[2], {"time": epochs(three), "rpm": rpm, "rudder_deg": rudder})
    return paths


def rows(path: Path, header: str, lines: list[str]) -> Path:
    """A file of lines below a header."""
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def plain(path: Path, header: str, **changed: np.ndarray) -> Path:
    """A run in SI with blanks between its cells and another ``header``; columns ``changed``."""
    truth = run()
    columns = {name: truth[name] for name in ("t", "x", "y", "psi", "u", "v", "r", "n", "delta")} | changed
    lines = [" ".join(repr(float(c[i])) for c in columns.values()) for i in range(len(truth))]
    return rows(path, header, lines)


UNITS = "time_s north_m east_m heading_rad surge_mps sway_mps yaw_rate_rad_s shaft_rps rudder_rad"


def bridge(trial: Trial, origin: tuple[float, float] = ORIGIN) -> dict[str, Any]:
    """The columns of a bridge's log of a ``trial``, by header, its first position at ``origin`` [deg]."""
    sog, cog = ground(trial)
    latitude, longitude = globe(trial, origin)
    return {
        "Time": [stamp(t) for t in trial.t],
        "Latitude": latitude,
        "Longitude": longitude,
        "SOG [kn]": sog,
        "COG [deg]": cog,
        "Heading [deg]": np.degrees(trial["psi"]) % 360,
        "RPM": 60 * trial["n"],
        "Rudder [deg]": np.degrees(trial["delta"]),
    }


def table(path: Path, columns: Mapping[str, Sequence[object] | np.ndarray], keep: np.ndarray | None = None) -> Path:
    """A file of ``columns`` by header, separated by commas; keep: the rows that are written."""
    lines = [
        ",".join(cells) for cells in zip(*([_cell(v) for v in values] for values in columns.values()), strict=True)
    ]
    kept = lines if keep is None else [line for line, wanted in zip(lines, keep, strict=True) if wanted]
    return rows(path, ",".join(columns), kept)


def _cell(value: object) -> str:
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


def chosen(**said: Any) -> ImportMap:
    """The map of an import that says so."""
    return validated(ImportMap, said, "map")


def imported(path: Path, given: ImportMap | None = None) -> Imported:
    """What comes of the log or folder ``path``, without a problem; given: the map."""
    found = import_logs([path], given)
    assert not found.problems, found.problems
    return found


def codes(found: Imported) -> set[str]:
    """Codes of what is said of the first run."""
    return {getattr(m, "code", "") for m in found.runs[0].notices}


def errors(columns: Mapping[str, np.ndarray], truth: Trial, late: float = 0.0, inside: float = 5.0) -> dict[str, float]:
    """Largest difference of each column from the ``truth``, whose clock is so ``late`` [s], but for the seconds
    ``inside`` which the ends lie."""
    t = columns["t"]
    rows = (t > inside) & (t < t[-1] - inside)
    out = {}
    for name in ("x", "y", "psi", "u", "v", "r", "n", "delta"):
        if name in columns:
            error = columns[name] - np.interp(t + late, truth.t, truth.psi_unwrapped if name == "psi" else truth[name])
            error = np.angle(np.exp(1j * error)) if name == "psi" else error
            out[name] = float(np.abs(error[rows]).max())
    return out


def answers(path: Path) -> list[ImportMap]:
    """The maps of the lines that the only problem of the log ``path`` prints, one for each answer."""
    (problem,) = import_logs([path]).problems
    _, printed, lines = problem.partition("; say in the map ")
    assert printed, problem
    maps = []
    for line in re.split(r", or (?=[^]}]+: [\[\w])", lines):
        change = re.search(r": ((?:\[columns\]|ignore|rows|decimal).*)$", line)
        assert change, line
        text = change[1].replace("] and [", "]\n[").replace("} and [", "}\n[").replace("[columns] ", "columns.")
        maps.append(validated(ImportMap, tomllib.loads(text), line))
    return maps
