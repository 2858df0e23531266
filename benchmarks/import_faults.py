"""Raw logs with one fault each: does ``mmg import``, or ``mmg check`` after it, say what is wrong?

``python -m benchmarks.import_faults [--seed 1] [--ships 8] [--only WORDS] [--record]``: turning circles, zigzags, crash
stops and free sailing of 8 ships of 3 m to 320 m (single and twin screws, pods) at any heading, place and date, written
as loggers do: text, Excel, Parquet, NMEA, with headers and units of several styles.
right: imported, and every column within 5 % of its range of the truth at midship. named: refused, doubtful or
contradictory with the cause of the fault among the words. otherwise: refused or doubted for another cause.
consistent: wrong, and called consistent as far as it can be checked, as columns were derived from one another. silent:
imported and called ok, but wrong. crash: an exception that is not meant for people. Logs as they should be have to be
right, and "ok" or consistent.
"""

from __future__ import annotations

import datetime
import functools
import re
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.record import Figure, parser_of, report
from benchmarks.toml import tables
from cases.checks import check
from cases.checks.report import CONSISTENT
from cases.importing.import_logs import import_logs, write_import
from cases.importing.import_map import ImportMap
from cases.io.read import read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.quantities import wraps
from cases.shipfiles.effects import with_effects
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import Wind, simulate, simulate_controls
from cases.trial import Trial
from mmg.errors import UserError
from mmg.ship import Ship

Columns = dict[str, np.ndarray]
Rows = list[list[str]]
KN, DEG = 1852 / 3600, 180 / np.pi
TOLERANCE = 0.05
"""Share of the range of a column by which its root mean square error may differ from the truth."""
ROWS = 800
"""Most rows of a log."""
EPOCH = datetime.datetime(1970, 1, 1)
SHIPS: dict[str, tuple[Callable[[], Ship], float]] = {
    "3 m tanker": (lambda: load_ship("esso_osaka_3m"), 0.1),
    "3 m, two rudders": (lambda: load_ship("vectwin_3m"), 0.1),
    "7 m tanker": (lambda: load_ship("kvlcc2_l7"), 0.2),
    "28 m, twin screw": (lambda: new_ship("launch", dict(L=28.0, B=6.5, d=2.0, C_b=0.5, y_P=1.4, U_0=5.0)), 0.25),
    "60 m, pods": (lambda: load_ship(Path(__file__).with_name("import_pods.toml")), 0.5),
    "90 m coaster": (lambda: new_ship("coaster", dict(L=90.0, B=14.0, d=5.0, C_b=0.72, U_0=6.0)), 0.5),
    "230 m, twin screw": (lambda: new_ship("box", dict(L=230.0, B=32.2, d=10.8, C_b=0.65, U_0=11.0, y_P=7.0)), 1.0),
    "320 m tanker": (lambda: load_ship("kvlcc2_full"), 1.0),
}
"""What makes each ship, and the interval of her logs [s]."""
RUNS = {"turn": "turning:35", "zigzag": "zigzag:20/20", "stop": "crash-stop", "sail": "random:3"}
PLACES = ((54.1, 7.9), (-33.9, 151.3), (34.7, 135.4), (-23.1, -43.1), (37.7, -122.6), (1.2, 103.9), (10.3, 50.2))
WEST = (-33.4, -71.7)
AT = {"hemispheres missing": WEST, "hemispheres in columns of their own": WEST, "over the date line": (-17.0, 179.9999),
      "longitude without its sign": (37.7, -122.6), "latitude and longitude exchanged": (10.3, 50.2),
      "ddmm.mmmm as degrees": (0.31, 6.62)}  # fmt: skip
"""Latitude and longitude of a log: any of PLACES, and where the faults AT them show."""
HEADERS: dict[str, list[str]] = tables(Path(__file__).with_name("import_headers.toml"))
"""Quantity -> unit, and the words of its header in three styles."""
SCALES = {"kn": 1 / KN, "rpm": 60.0, "deg": DEG, "deg/s": DEG}
SIDES = {"n": "Stbd ", "n_2": "Port ", "delta_port": "Port ", "delta_starboard": "Stbd ", "azimuth": "Stbd ",
         "azimuth_2": "Port ", "n_azimuth": "Stbd ", "n_azimuth_2": "Port "}  # fmt: skip
POSITION, RECEIVER = ("latitude", "longitude"), ("latitude", "longitude", "sog", "cog")
TURNS, ANGLES = ("n", "n_azimuth"), ("delta", "azimuth")


class Fault(NamedTuple):
    """form: "any", "table" (all but NMEA), "text" or one of them; frame: "globe", "local" (x, y, u, v are logged) or ""
    for either; run: one of RUNS, or "" for any; cause: a pattern of the codes and words that name it."""

    form: str
    frame: str
    run: str
    cause: str


FORMS = {"any": ("comma", "semicolon", "tab", "excel", "parquet", "nmea"), "text": ("comma", "semicolon", "tab")}
FORMS["table"] = FORMS["any"][:-1]
FAULTS = {title: Fault(*row) for title, row in tables(Path(__file__).with_suffix(".toml")).items()}
"""Title -> what is known of each fault; SPOILERS, ``spoil``, ``said`` and ``written`` make them."""


def base(quantity: str) -> str:
    """The ``quantity`` without its side."""
    return re.sub(r"_(2|port|starboard)$", "", quantity)


def truths(ship: Ship, dt: float, rng: np.random.Generator) -> dict[str, Columns]:
    """The motion at midship in each of RUNS with wind and current, every ``dt`` [s]: columns of a trial, heading
    without jumps, velocity over ground "ground" and through the water "water" (north + 1j east), apparent wind "air"
    (from the bow)."""
    out = {}
    for kind, text in RUNS.items():
        plan = parse_maneuver(text, ship)
        current = 0.1 * plan.speed * np.exp(1j * rng.uniform(-3, 3))
        moved = with_effects(ship, [f"current:x={current.real:.4f},y={current.imag:.4f}"])
        begin = np.array([0, 0, rng.uniform(-np.pi, np.pi), plan.speed, 0, 0])
        wind = Wind(rng.uniform(0.5, 0.9) * plan.speed, rng.uniform(0, 2 * np.pi), gusty=True)
        trial = simulate(moved, plan, dt, wind, int(rng.integers(1000)), begin)
        if "n_2" in trial and kind == "sail":  # also steered by screws
            swing = 0.4 * np.sin(trial.t / trial.t[-1] * 20)
            trial = trial.with_columns(n=(1 - swing) * np.abs(trial["n"]), n_2=(1 + swing) * np.abs(trial["n_2"]))
            held = {q: 0.3 * trial[q] for q in trial.columns if q.startswith("delta")}
            trial = simulate_controls(moved, trial.with_columns(**held))
        unused = {"n_bow", *(("n", "delta") if "n_azimuth" in trial else ())}
        c = {name: values[:ROWS] for name, values in trial.columns.items() if name not in unused}
        c["psi"] = np.unwrap(c["psi"])
        c["ground"] = (c["u"] + 1j * c["v"]) * np.exp(1j * c["psi"])
        c["water"], c["length"] = c["ground"] - current, np.array(ship.particulars["L"])
        c["air"] = (c["wind_speed"] * np.exp(1j * c["wind_direction"]) + c["ground"]) * np.exp(-1j * c["psi"])
        out[kind] = c
    return out


@dataclass
class Log:
    """What a logger writes of a run.

    truth: of the run; form: how it is written; place: of its begin; clock: of the rows [s since 1970, UTC]; stamp: how
    times are written; q: quantity -> (N,) as measured, in SI, radians and degrees of latitude and longitude; names,
    units: that differ from those of the dialect; split: whether the receiver has a file of its own; bad: rows (N,) of
    bursts in which something is lost.
    """

    title: str
    truth: Columns
    rng: np.random.Generator
    form: str
    place: tuple[float, float]
    clock: np.ndarray
    stamp: str
    q: Columns = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    split: bool = False

    @functools.cached_property
    def bad(self) -> np.ndarray:
        N = len(self.clock)
        out = np.zeros(N, bool)
        for first in self.rng.integers(N // 20, N - N // 20, 5):
            out[first : first + max(3, N // 80)] = True
        return out

    def of(self, *names: str) -> list[str]:
        """The quantities that are logged of those with these ``names``, of either side."""
        return [q for q in self.q if base(q) in names]

    def measure(self, frame: str) -> None:
        """Fill ``q`` from the truth with noise, in a ``frame``: "globe" or "local"."""
        c, normal, N = self.truth, self.rng.standard_normal, len(self.clock)
        self.q = {k: v + 0.0 for k, v in c.items() if base(k) in ("n", "delta", "azimuth", "n_azimuth")}
        if frame == "globe":
            self.locate()
        else:
            noise, speed = min(0.002 * float(c["length"]), 0.3) * normal((2, N)), float(np.max(np.abs(c["ground"])))
            self.q |= {"x": c["x"] + noise[0] + 12.0, "y": c["y"] + noise[1] - 31.0}
            self.q |= {k: c[k] + 0.004 * speed * normal(N) for k in "uv"}
        self.q["psi"] = c["psi"] + 0.001 * normal(N)
        if frame == "local" or self.rng.random() < 0.5 or "turn rate" in self.title:
            self.q["r"] = c["r"] + 0.01 * np.max(np.abs(c["r"])) * normal(N)
        if self.rng.random() < 0.5 or "wind" in self.title:
            self.q |= {k: c[k] + 0.0 for k in ("wind_speed", "wind_direction")}

    def locate(self, arm: complex = 0.0, late: float = 0.0) -> None:
        """Positions, speed and course of a receiver at an ``arm`` [m] ahead + 1j to starboard, ``late`` [s]."""
        import pyproj

        c, normal, N = self.truth, self.rng.standard_normal, len(self.clock)
        turned, t = arm * np.exp(1j * c["psi"]), c["t"] - late
        noise = min(0.002 * float(c["length"]), 0.3) * (normal(N) + 1j * normal(N))
        path = np.interp(t, c["t"], c["x"] + 1j * c["y"] + turned) + noise
        ground = np.interp(t, c["t"], c["ground"] + 1j * c["r"] * turned)
        ground = ground + 0.004 * np.max(np.abs(ground)) * (normal(N) + 1j * normal(N))
        frame = pyproj.Proj(proj="tmerc", lat_0=self.place[0], lon_0=self.place[1], k=1.0, ellps="WGS84")
        lon, lat = frame(path.imag, path.real, inverse=True)
        self.q |= {"latitude": np.asarray(lat), "longitude": (np.asarray(lon) + 180) % 360 - 180}
        self.q |= {"sog": np.abs(ground), "cog": np.angle(ground)}

    def header(self, quantity: str, style: int) -> str:
        """The cell above a column, in a ``style``."""
        unit, side = self.units.get(quantity, HEADERS[base(quantity)][0]), SIDES.get(quantity, "")
        words = self.names.get(quantity, HEADERS[base(quantity)][1 + style])
        words = side + words if len(self.of(base(quantity))) > 1 else words
        if style == 1:
            words = words.lower().replace(" ", "_")
            return words if words.endswith(unit) else f"{words}_{unit.replace('/', '_')}"
        return f"{words} [{unit}]" if style == 0 else f"{words} ({unit})"

    def cells(self, quantity: str) -> list[str]:
        """The column as text."""
        unit = self.units.get(quantity, HEADERS[base(quantity)][0])
        if quantity in POSITION:
            return [f"{v:.8f}" for v in self.q[quantity]]
        values = self.q[quantity] * SCALES.get(unit, 1.0)
        return [f"{v:.3f}" for v in (np.mod(values, 360.0) if wraps(quantity) and unit == "deg" else values)]

    def stamps(self) -> tuple[str, list[str]]:
        """Header and cells of the clock."""
        if self.stamp in ("elapsed", "epoch"):
            since = self.clock - self.clock[0] if self.stamp == "elapsed" else self.clock
            return "Time [s]" if self.stamp == "elapsed" else "epoch", [f"{s:.3f}" for s in since]
        when = [EPOCH + datetime.timedelta(seconds=round(float(s), 3)) for s in self.clock]
        if self.stamp == "dotted":
            return "Time", [f"{w:%d.%m.%Y %H:%M:%S}.{w.microsecond // 1000:03d}" for w in when]
        return "Time", [w.isoformat(timespec="milliseconds") + "Z" for w in when]

    def table(self) -> Rows:
        """Rows of cells, the header first."""
        style, (name, times) = int(self.rng.integers(3)), self.stamps()
        columns = [times, *map(self.cells, self.q)]
        return [[name, *(self.header(q, style) for q in self.q)], *map(list, zip(*columns, strict=True))]

    def write(self, folder: Path) -> None:
        """The file, or both files, of the log in ``folder``."""
        if self.form == "nmea":
            lines = [f"${body}*{functools.reduce(lambda a, b: a ^ b, body.encode()):02X}" for body in said(self)]
            (folder / "run.nmea").write_text("\n".join(lines) + "\n")
            return
        rows = written(self, self.table())
        own = [i for i, q in enumerate(self.q, 1) if self.split and q in RECEIVER]
        for stem, at in (("run", [i for i in range(len(rows[0])) if i not in own]), ("gnss", [0, *own])):
            part = [[row[i] for i in at] for row in rows]
            if self.form in ("excel", "parquet") and len(at) > 1:
                workbook(self, folder, part)
            elif len(at) > 1:
                separator = {"comma": ",", "semicolon": ";", "tab": "\t"}[self.form]
                lines = [separator.join(row) for row in part]
                if self.form == "semicolon":
                    lines = [re.sub(r"(?<![\d.])(-?\d+)\.(\d+)(?=;|$)", r"\1,\2", line) for line in lines]
                (folder / f"{stem}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def workbook(log: Log, folder: Path, rows: Rows) -> None:
    """The ``rows`` as a workbook, or as a Parquet file."""
    import openpyxl
    import pandas as pd

    def value(cell: str) -> Any:
        if re.fullmatch(r"-?\d+(\.\d+)?", cell):
            return float(cell)
        is_time = re.fullmatch(r"\d{4}-\d\d-\d\dT\S+Z", cell)
        return datetime.datetime.fromisoformat(cell[:-1]) if is_time else cell or None

    cells = [list(map(value, row)) for row in rows]
    if log.form == "parquet":
        pd.DataFrame(cells[1:], columns=rows[0]).to_parquet(folder / "run.parquet")
        return
    book = openpyxl.Workbook()
    if log.title == "a workbook of 1904":
        book.epoch = datetime.datetime(1904, 1, 1)
    for row in cells:
        book.active.append(row)
    if log.title == "an old copy on a hidden sheet":  # with the rudder's other sign
        sheet = book.create_sheet("old")
        sheet.sheet_state = "hidden"
        at = [i for i, head in enumerate(rows[0]) if re.search("(?i)rudder|azimuth angle|pod angle", head)]
        for k, row in enumerate(cells):
            sheet.append([-c if i in at and k else c for i, c in enumerate(row)])
    book.save(folder / "run.xlsx")


def rmc(log: Log, k: int, kind: str = "GPRMC", status: str = "A", off: float = 0.0, days: float = 0.0) -> str:
    """A sentence of a receiver at row ``k``; off: degrees by which it lies north and east; days: of its date."""
    when = EPOCH + datetime.timedelta(seconds=round(float(log.clock[k]), 2), days=days)
    where = []
    for q, width, ways in (("latitude", 2, "NS"), ("longitude", 3, "EW")):
        whole, rest = divmod(round(abs(value := log.q[q][k] + off) * 60, 6), 60)
        where.append(f"{int(whole):0{width}d}{rest:09.6f},{ways[int(value < 0)]}")
    head = f"{kind},{when:%H%M%S}.{when.microsecond // 10000:02d}"
    if kind.endswith("GGA"):
        return f"{head},{','.join(where)},1,10,0.8,20.0,M,30.0,M,,"
    speed, course = log.q["sog"][k] / KN, log.q["cog"][k] * DEG % 360
    return f"{head},{status},{','.join(where)},{speed:.3f},{course:.2f},{when:%d%m%y},,,A"


def said(log: Log) -> Iterator[str]:
    """NMEA sentences: of a receiver at every other row, at least once a second, of all else at every row."""
    q, last, off = log.q, -np.inf, log.rng.uniform(30, 250) / 111e3
    every = min(1.0, 2 * float(np.median(np.diff(log.clock))))
    for k, second in enumerate(log.clock):
        if second - last > every - 1e-3:
            last = second
            early = -7168.0 if log.title == "1024 weeks early at first" and k < len(log.clock) // 3 else 0.0
            void = log.title == "rows of status V" and log.bad[k]
            yield rmc(log, k, status="V", off=0.4) if void else rmc(log, k, days=early)
            if log.title == "second receiver interleaved":
                yield rmc(log, k, "GNGGA", off=off)
        magnetic = log.title == "magnetic heading"
        yield f"{'HCHDM' if magnetic else 'HEHDT'},{q['psi'][k] * DEG % 360:.2f},{'M' if magnetic else 'T'}"
        if "r" in q:
            yield f"HEROT,{q['r'][k] * DEG * 60:.2f},A"
        angles = [f"{q[name][k] * DEG:.2f},A" if name in q else "," for name in ("delta_starboard", "delta_port")]
        yield f"AGRSA,{q['delta'][k] * DEG:.2f},A,," if "delta" in q else f"AGRSA,{','.join(angles)}"
        for number, name in enumerate(log.of("n"), 1):
            source = "E" if "engine" in log.title else "S"
            yield f"IIRPM,{source},{number if 'n_2' in q else 0},{q[name][k] * 60:.2f},,A"
        if "wind_speed" in q:
            angle = (q["wind_direction"][k] - q["psi"][k]) * DEG % 360
            yield f"WIMWV,{angle:.1f},T,{q['wind_speed'][k]:.2f},M,A"


Spoiler = Callable[[Log], object]


def stuck(share: float, *names: str) -> Spoiler:
    """The columns ``names`` keep a value over a ``share`` of the log."""

    def held(log: Log) -> None:
        rows = np.arange(N := len(log.clock))
        first = 0 if share == 1 else N // 3
        kept = np.where((rows >= first) & (rows < first + share * N), first, rows)
        log.q |= {q: log.q[q][kept] for q in names}

    return held


def changed(change: Callable[[np.ndarray], np.ndarray], *names: str) -> Spoiler:
    """``change`` of the columns with these ``names``, of either side."""
    return lambda log: log.q.update({q: change(log.q[q]) for q in log.of(*names)})


def exchanged(one: str, other: str) -> Spoiler:
    """Two columns, each under the name of the other."""
    return lambda log: log.q.update({one: log.q[other], other: log.q[one]})


SPOILERS: dict[str, Spoiler] = {
    "hemispheres missing": changed(np.abs, *POSITION),
    "hemispheres in columns of their own": changed(np.abs, *POSITION),
    "longitude without its sign": changed(np.abs, "longitude"),
    "latitude and longitude exchanged": exchanged(*POSITION),
    "ddmm.mmmm as degrees": changed(lambda v: 100 * np.floor(v) + 60 * (v % 1), *POSITION),
    "antenna off midship": lambda log: log.locate((0.35 - 0.1j) * float(log.truth["length"])),
    "receiver late by 1 to 3 s": lambda log: log.locate(late=log.rng.uniform(1, 3)),
    "heading frozen for a while": stuck(0.2, "psi"),
    "positions frozen for a while": stuck(0.2, *RECEIVER),
    "heading frozen": stuck(1, "psi"),
    "heading off by 10 deg": changed(lambda v: v + 10 / DEG, "psi"),
    "heading off by 180 deg": changed(lambda v: v + np.pi, "psi"),
    "heading counter-clockwise from east": changed(lambda v: np.pi / 2 - v, "psi"),
    "turn rate in deg/min called deg/s": changed(lambda v: 60 * v, "r"),
    "turn rate positive to port": changed(np.negative, "r"),
    "speed in km/h called kn": changed(lambda v: 1.852 * v, "sog"),
    "feet called m": changed(lambda v: v / 0.3048, "x", "y"),
    "u and v exchanged": exchanged("u", "v"),
    "v positive to port": changed(np.negative, "v"),
    "rudder positive to port": changed(np.negative, *ANGLES),
    "rudder in rad called deg": changed(lambda v: v / DEG, *ANGLES),
    "unsigned revolutions in a crash stop": changed(np.abs, *TURNS),
    "port and starboard screws exchanged": exchanged("n", "n_2"),
}
"""Faults of a few columns alone."""


def apparent(c: Columns) -> Columns:
    """The apparent wind of the truth ``c``, as a vane logs it."""
    return {"apparent_wind_speed": np.abs(c["air"]), "apparent_wind_direction": np.angle(c["air"])}


def spoil(log: Log) -> None:
    """The faults that are none of SPOILERS, but for those of writing."""
    c, q, length = log.truth, log.q, float(log.truth["length"])
    late = np.arange(len(log.clock)) > 0.5 * len(log.clock)
    match log.title:
        case "positions of low resolution":
            changed(lambda v: np.round(v / (step := length / 90e3)) * step, *POSITION)(log)
        case "GPS time beside UTC":
            log.split, log.stamp = True, "iso"
            log.locate(late=18.0)
        case "positions zero where lost":
            changed(lambda v: np.where(log.bad, 0.0, v), *RECEIVER)(log)
        case "a column of status V":
            changed(lambda v: v + np.where(log.bad, 6 * length / 111e3, 0.0), "latitude")(log)
        case "course in place of heading":
            q["psi"] = np.unwrap(np.angle(c["ground"]))
        case "magnetic heading":
            q["psi"], log.names["psi"] = q["psi"] + 12 / DEG, "Heading (M)"
        case "heading interpolated through 360":
            rows, at = np.arange(len(log.clock)), np.arange(0, len(log.clock), 5)
            q["psi"] = np.interp(rows, at, np.mod(q["psi"][at], 2 * np.pi))
        case "speed through the water as SOG" | "speed through the water as speed":
            q["sog"] = np.abs(c["water"])
            log.names |= {"sog": "Speed"} if log.title.endswith("as speed") else {}
        case "u and v north and east":
            log.q |= {"u": c["ground"].real, "v": c["ground"].imag}
        case "odometry east, north, up":
            log.q |= {"x": q["y"], "y": q["x"], "psi": np.pi / 2 - q["psi"], "v": -q["v"], "r": -q["r"]}
        case "only the rudder's order":
            log.names |= dict.fromkeys(log.of("delta"), "Rudder order")
        case "two rudders with toe-in":
            log.q |= {"delta_port": q["delta"] + 5 / DEG, "delta_starboard": log.q.pop("delta") - 5 / DEG}
        case "rpm called rps":
            changed(lambda v: 60 * v, *TURNS)(log)
            log.names |= dict.fromkeys(log.of(*TURNS), "Propeller speed" if log.of("n") else "Azimuth speed")
            log.units |= dict.fromkeys(log.of(*TURNS), "rps")
        case "revolutions of an engine ahead of a gear":
            changed(lambda v: 3.5 * v, "n")(log)
            log.names |= dict.fromkeys(log.of("n"), "Engine speed")
        case "pods or wind over north, seldom logged" if "azimuth" not in q:
            c["wind_direction"] = log.q["wind_direction"] = 0.3 * np.sin(40 * c["t"] / c["t"][-1])
        case "apparent wind called true":
            log.q |= {"wind_speed": np.abs(c["air"]), "wind_direction": np.angle(c["air"])}
        case "wind to instead of from":
            log.q |= {"wind_direction": q["wind_direction"] + np.pi} | apparent(c)
        case "wind from the bow called from north":
            log.q["wind_direction"] = q["wind_direction"] - q["psi"]
        case "wind in kn called m/s":
            log.q |= {"wind_speed": q["wind_speed"] / KN} | apparent(c)
        case "summer time begins" | "summer time ends":
            log.stamp, log.clock = "dotted", log.clock + (3600.0 if log.title.endswith("begins") else -3600.0) * late
        case "the day stays over midnight":
            log.clock += 86400 - log.clock[len(late) // 2] % 86400
            log.stamp, log.clock = "dotted", log.clock[0] // 86400 * 86400 + log.clock % 86400
        case "stamps of whole seconds":
            log.stamp, log.clock = "dotted", np.floor(log.clock)
        case "nanoseconds without leading zeros":
            log.stamp, log.clock = "epoch", log.clock + 0.013
        case "seconds of the week begin anew":
            log.stamp = "elapsed"
        case "local stamps among those in UTC" | "a workbook of 1904":
            log.stamp = "iso"


def written(log: Log, rows: Rows) -> Rows:
    """The ``rows`` of cells with the faults of writing."""
    head, body, N = rows[0], rows[1:], len(rows) - 1
    texts = ("NaN", "n/a", "---", "NULL", "#N/A", "invalid")
    lost = {"-999 or 9999 where lost": (("psi", "sog", "r"), ("-999", "9999")),
            "zeros where lost": (("psi", "sog", "delta"), ("0.000",)),
            "missing values as text": (("psi", "sog", "u", "n"), texts)}  # fmt: skip
    if log.title in lost:
        names, words = lost[log.title]
        body = [list(row) for row in body]
        for i in (1 + list(log.q).index(name) for name in log.of(*names)):
            word = str(log.rng.choice(words))
            for k in np.flatnonzero(log.bad):
                body[k][i] = word
    match log.title:
        case "hemispheres in columns of their own":
            return [[*head, "N/S", "E/W"], *([*row, "S", "W"] for row in body)]
        case "pods or wind over north, seldom logged":
            at = [1 + list(log.q).index(q) for q in (log.of("azimuth") or ["wind_direction"])]
            body = [["" if j in at and k % 3 else c for j, c in enumerate(row)] for k, row in enumerate(body)]
        case "pitch of the hull beside roll" | "pitch of the hull alone":
            swing = [f"{v:.2f}" for v in 1.5 * np.sin(0.9 * log.truth["t"])]
            motions = ["Pitch [deg]", "Roll [deg]"][: 1 if log.title.endswith("alone") else 2]
            return [[*head, *motions], *([*row, *[v] * len(motions)] for row, v in zip(body, swing, strict=True))]
        case "a column of status V":
            return [[*head, "GPS status"], *([*row, "AV"[int(bad)]] for row, bad in zip(body, log.bad, strict=True))]
        case "seconds of the week begin anew":
            head = ["GPS TOW [s]", *head[1:]]
            body = [[f"{(604780 + float(row[0])) % 604800:.3f}", *row[1:]] for row in body]
        case "local stamps among those in UTC":
            body = [[row[0].rstrip("Z") if k > N // 2 else row[0], *row[1:]] for k, row in enumerate(body)]
        case "nanoseconds without leading zeros":
            body = [[f"{float(r[0]) // 1:.0f}.{round(float(r[0]) % 1 * 1e3) * 10**6}", *r[1:]] for r in body]
        case "newest row first":
            body = body[::-1]
        case "rows logged twice":
            body = [row for row in body for _ in range(2)]
        case "a block of rows sent again":
            body = body[: N // 2] + body[N // 3 :]
        case "gaps":
            body = body[: N // 3] + body[N // 2 :]
        case "header repeated":
            body = [*body[: N // 2], head, *body[N // 2 :]]
        case "lines below the table":
            body += [["End of log", *[""] * (len(head) - 1)], ["Exported by", "2.1", *[""] * (len(head) - 2)]]
        case "second line of headers":
            body = [["recorded", *["actual"] * (len(head) - 1)], *body]
        case "a line of units in German":
            german = {"deg": "Grad", "rpm": "U/min", "deg/s": "Grad/s", "kn": "Knoten"}
            line = [log.units.get(q, HEADERS[base(q)][0]) for q in log.q]
            body = [["s", *(german.get(unit, unit) for unit in line)], *body]
            head = [re.split(r" [\[(]|_(?:deg|rpm|kn|m|s)\b|_(?:deg|m)_s$", word)[0] for word in head]
        case "thousands separators":
            i = 1 + list(log.q).index("x")
            body = [[*row[:i], f"{float(row[i]) + 1000:,.2f}", *row[i + 1 :]] for row in body]
        case "decimal commas in quotes":
            body = [[re.sub(r"^(-?\d+)\.(\d+)$", r'"\1,\2"', c) for c in row] for row in body]
    return [head, *body]


def drawn(title: str, how: Fault, truth: Columns, rng: np.random.Generator) -> Log:
    """The log of a run whose fault is called ``title``."""
    frame = how.frame or str(rng.choice(["globe", "local"]))
    forms = list(FORMS.get(how.form, (how.form,)))
    if "nmea" in forms and ("azimuth" in truth or frame != "globe"):
        forms.remove("nmea")
    place = AT.get(title, PLACES[int(rng.integers(len(PLACES)))])
    clock = round(1.67e9 + rng.uniform(0, 1e8)) + truth["t"] - truth["t"][0]
    stamp = str(rng.choice(["iso", "dotted", "epoch", "elapsed"]))
    log = Log(title, dict(truth), rng, str(rng.choice(forms)), place, clock, stamp)
    log.measure(frame)
    SPOILERS.get(title, spoil)(log)
    return log


def suits(title: str, how: Fault, truth: Columns) -> bool:
    """Whether the ship can have the fault."""
    needs = {"only the rudder's order": "delta.*", "two rudders with toe-in": "delta",
             "port and starboard screws exchanged": "n_2", "revolutions of an engine ahead of a gear": "n"}  # fmt: skip
    return any(re.fullmatch(needs.get(title, "psi"), q) for q in truth) and (how.form != "nmea" or "n" in truth)


def worst(trial: Trial, c: Columns) -> tuple[float, str]:
    """Greatest error of a column of ``trial`` over the range of its truth ``c``, and whose; time counts from the shift
    at which this is least. A column that is lost, or that is none of the ship, counts as infinite."""
    t, own, speed = c["t"] - c["t"][0], trial.t - trial.t[0], float(np.max(np.abs(c["ground"])))
    sizes = {q: max(float(np.ptp(c[q])), 0.3 * speed) for q in "uv"} | {"psi": 1.0}
    sizes |= dict.fromkeys("xy", max(float(np.ptp(c["x"])), float(np.ptp(c["y"])))) | {"r": float(np.ptp(c["r"]))}
    sizes |= {q: max(float(np.ptp(c[q])), float(np.max(np.abs(c[q]))), 0.1) for q in c if base(q) in INPUTS}
    got, want = {q: trial[q] for q in sizes if q in trial}, dict(c)
    if "delta" in sizes and "delta" not in got:
        got["delta"] = trial.rudder
    if trial.has_wind:  # gusty, and sometimes derived
        sizes["wind"], got["wind"] = 3 * float(np.max(c["wind_speed"])), trial.wind_vector @ (1, 1j)
        want["wind"] = -c["wind_speed"] * np.exp(1j * c["wind_direction"])
    rows = {q: own[np.isfinite(v)] for q, v in got.items()}
    lost = [q for q in sizes if q not in "xy" and (q not in rows or len(rows[q]) < 20 or np.ptp(rows[q]) < 0.5 * t[-1])]
    lost += [q for q in trial.columns if q not in c and base(q) not in ("n", "delta") and "apparent" not in q]
    if lost or own[-1] > 1.05 * t[-1] + 2:
        return np.inf, lost[0] if lost else "time"

    def errors(shift: float) -> dict[str, float]:
        at, out = own + shift, {}
        for q, v in got.items():
            off = (v - np.interp(at, t, want[q]))[np.isfinite(v) & (at >= t[0]) & (at <= t[-1])][3:-3]
            off = np.angle(np.exp(1j * off)) if wraps(q) else off - (np.median(off) if q in "xy" and len(off) else 0.0)
            out[q] = float(np.sqrt(np.mean(np.abs(off) ** 2))) / sizes[q] if len(off) > 10 else np.inf
        return out

    def cost(shift: float) -> float:
        return max(off for q, off in errors(shift).items() if q != "wind")

    dt = float(np.median(np.diff(t)))
    shift = min(np.arange(-10, 141, 2) * dt, key=cost)
    off = errors(min(shift + np.arange(-2, 2.1, 0.25) * dt, key=cost))
    name = max(off, key=lambda q: off[q])
    return off[name], name


INPUTS = ("n", "n_azimuth", "delta", "azimuth")
ROUTINE = {"clock", "local_frame", "derived", "joined", "inputs", "decimal_commas", "unit_found", "offset",
           "no_wind", "wind_angle"}  # fmt: skip
"""Codes of what an import says of every log."""


class Outcome(NamedTuple):
    """kind: as in the docstring of the module; words: what is off, and said."""

    kind: str
    words: str


def judged(log: Log, cause: str, folder: Path) -> Outcome:
    """What becomes of a ``log`` whose fault has a ``cause``, written into ``folder``."""
    (folder / "in").mkdir()
    log.write(folder / "in")
    try:
        found = import_logs([folder / "in"], chosen := ImportMap())
        if found.problems:
            raise UserError("; ".join(found.problems))
        files = write_import(found, chosen, folder / "out")
        trials = read_trials(files)
        reports = check(trials)
    except UserError as error:
        words = str(error).replace(str(folder), "")
        return Outcome("named" if re.search(f"(?i){cause}", words) else "otherwise", f"refused: {words}")
    except Exception as error:
        return Outcome("crash", f"{log.form}: {type(error).__name__}: {error}")
    notes = [f"{m.code}: {m}" for run in found.runs for m in run.notices if m.code not in ROUTINE]
    for log_used in (one for run in found.runs for one in run.logs):
        notes += [f"may be: {h}: {w}" for h, w in log_used.unsure.items()] + [f"unknown: {h}" for h in log_used.unknown]
    loud = [f"{f.code}: {f.text}" for r in reports for f in r.findings if f.level in ("doubtful", "contradictory")]
    codes = ", ".join(sorted({word.partition(":")[0] for word in loud})) or "ok"
    if len(trials) > 1:
        return Outcome(
            "named" if re.search(f"(?i){cause}", " ".join(loud + notes)) else "otherwise",
            f"{len(trials)} runs; {codes}",
        )
    off, name = worst(trials[0], log.truth)
    words = " | ".join([f"{log.form}: {name} off by {off:.0%}; {codes}", *notes])
    if off <= TOLERANCE:
        return Outcome("doubted" if loud else "right", words)
    named = any(re.search(f"(?i){cause}", word) for word in loud + notes)
    quiet = "consistent" if any(r.verdict == CONSISTENT for r in reports) else "silent"
    return Outcome("named" if named else "otherwise" if loud else quiet, words)


def outcomes(ship: str, seed: int, only: str) -> Iterator[tuple[str, Outcome]]:
    """Title and outcome of each log of a ``ship``; titles of those without a fault begin with "sound"."""
    make, dt = SHIPS[ship]
    runs = truths(make(), dt, np.random.default_rng([seed, zlib.crc32(ship.encode())]))
    sound = {f"sound, {form}, {run}": Fault(form, "globe" if form == "nmea" else "", run, "nothing")
             for form in FORMS["any"] for run in RUNS}  # fmt: skip
    for title, how in (sound | FAULTS).items():
        rng = np.random.default_rng([seed, zlib.crc32(f"{ship}{title}".encode())])
        truth = runs[how.run or str(rng.choice(list(RUNS)))]
        if only in title and suits(title, how, truth):
            with tempfile.TemporaryDirectory() as name:
                yield title, judged(drawn(title, how, truth, rng), how.cause, Path(name))


def main() -> None:
    """Prints each log that was not right or named, and the sums."""
    parser = parser_of("import_faults", __doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ships", type=int, default=len(SHIPS))
    parser.add_argument("--only", default="", help="faults whose name holds these words")
    args, count = parser.parse_args(), {"sound": Counter[str](), "faulty": Counter[str]()}
    for ship in list(SHIPS)[: args.ships]:
        for title, one in outcomes(ship, args.seed, args.only):
            is_sound = title.startswith("sound")
            count["sound" if is_sound else "faulty"][one.kind] += 1
            if one.kind not in ("right", "named", "doubted")[: 1 if is_sound else 3]:
                print(f"{title}: {one.kind}: {ship}: {one.words}", flush=True)
    faulty, sound = count["faulty"], count["sound"]
    named, of = sum(faulty[kind] for kind in ("right", "doubted", "named")), faulty.total()
    report({"import_faults": Figure("faults of raw logs: imported right, or named", named, of=of),
            "import_consistent": Figure("faulty raw logs called consistent as far as it can be checked",
                                        faulty["consistent"], of=of),
            "import_silent": Figure("faulty raw logs called ok though wrong", faulty["silent"], of=of),
            "import_sound": Figure("sound raw logs imported right and ok", sound["right"], of=sound.total())},
           f"import_faults --seed {args.seed}", args.record)  # fmt: skip


if __name__ == "__main__":
    main()
