"""NMEA logs: when a sentence was said, whether it is valid, and of what it speaks."""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap
from cases.importing.raw_table import Account
from tests.support import raw_logs
from tests.support.raw_logs import BEGIN, KNOT, chosen, codes, errors, globe, ground, imported, plain, sentence

pytest.importorskip("pynmeagps", reason="needs the extra import")
pytest.importorskip("pyproj", reason="needs the extra import")

TRUTH = raw_logs.run()
LENGTH = 100.0  # Seconds of the logs
Body = Callable[[float], str]


def at(t: float, name: str) -> float:
    values = TRUTH.psi_unwrapped if name == "psi" else TRUTH[name]
    return float(np.interp(t, TRUTH.t, values))


def heading(t: float) -> str:
    return f"{np.degrees(at(t, 'psi')) % 360:.3f}"


def hdt(t: float) -> str:
    return f"HEHDT,{heading(t)},T"


def rsa(t: float) -> str:
    return f"AGRSA,{np.degrees(at(t, 'delta')):.3f},A,,V"


def rpm(t: float) -> str:
    return f"IIRPM,S,0,{60 * at(t, 'n'):.3f},100,A"


def place(t: float, north: float = 0.0, decimals: int = 6) -> str:
    """The position, or one so many metres further north."""
    lat, lon = (float(np.interp(t, TRUTH.t, values)) for values in globe(TRUTH))
    lat += north / raw_logs.M_PER_DEG[0]
    a, b = (f"{int(d):02d}{60 * (d - int(d)):0{3 + decimals}.{decimals}f}" for d in (lat, lon))
    return f"{a},N,{b},E"


def clock(t: float, begin: datetime.datetime = BEGIN) -> tuple[str, str]:
    now = begin + datetime.timedelta(seconds=t)
    return f"{now:%H%M%S}.{now.microsecond // 10000:02d}", f"{now:%d%m%y}"


def motion(t: float) -> tuple[float, float]:
    sog, cog = ground(TRUTH)
    return float(np.interp(t, TRUTH.t, sog)), float(np.interp(t, TRUTH.t, np.unwrap(cog, period=360))) % 360


def rmc(t: float, begin: datetime.datetime = BEGIN, talker: str = "GP", north: float = 0.0, more: str = ",,A") -> str:
    sog, cog = motion(t)
    time, day = clock(t, begin)
    return f"{talker}RMC,{time},A,{place(t, north)},{sog:.4f},{cog:.3f},{day},{more}"


def gga(
    t: float, begin: datetime.datetime = BEGIN, talker: str = "GP", north: float = 0.0, quality: int = 1,
    decimals: int = 6,
) -> str:  # fmt: skip
    return f"{talker}GGA,{clock(t, begin)[0]},{place(t, north, decimals)},{quality},10,0.8,20.0,M,30.0,M,,"


def zda(t: float) -> str:
    return f"GPZDA,{clock(t)[0]},{BEGIN:%d,%m,%Y},00,00"


Delay = float | Callable[[np.random.Generator], float]


def log(
    path: Path,
    *said: tuple[Body, float] | tuple[Body, float, Delay],
    logger: Callable[[float], str] | None = None,
    gap: tuple[float, float] = (0.0, 0.0),
) -> Path:
    """A log of sentences: what each says at a time, every so many seconds, and how late; of those at the same time the
    first comes first. logger: what it writes before each at a time; gap: when it is silent [s]."""
    rng, events, lines = np.random.default_rng(1), [], []
    for order, (body, every, *late) in enumerate(said):
        for k in range(int(LENGTH / every) + 1):
            delay, at_time = late[0] if late else 0.0, round(k * every, 4)
            events.append((at_time + (delay(rng) if callable(delay) else delay), order, body(at_time)))
    for t, _, text in sorted(events, key=lambda event: (round(event[0], 4), event[1])):
        if text and not gap[0] < t < gap[1]:
            lines.append((logger(t) if logger else "") + (text if text[0] in "!\\" else sentence(text)))
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def off_clock(format: str, ahead: float = 12.12, hours: int = 7) -> Callable[[float], str]:
    """A logger's stamp in a strftime ``format`` with milliseconds, some hours and seconds ahead."""
    return lambda t: (BEGIN + datetime.timedelta(hours=hours, seconds=t + ahead)).strftime(format)[:-3] + " "


def columns(path: Path, given: ImportMap | None = None) -> dict[str, np.ndarray]:
    return imported(path, given).runs[0].columns


def off(found: dict[str, np.ndarray], *names: str) -> float:
    """Largest error of these columns, away from the ends."""
    wrong = errors(found, TRUTH)
    return float(np.max([wrong[name] for name in names]))


def late_by(least: float, most: float) -> Delay:
    return lambda rng: rng.uniform(least, most)


TURN = np.radians(0.15)  # The ship turns by this in 0.05 s at most
RATES: dict[str, tuple[Any, ...]] = {
    "gyro 10 Hz": ((rmc, 1.0), (hdt, 0.1), (rsa, 0.1), (rpm, 1.0)),
    "gyro 4 Hz, rudder 3 Hz": ((rmc, 1.0), (hdt, 0.25), (rsa, 1 / 3), (rpm, 2.0)),
    "gyro first": ((hdt, 1.0), (rsa, 1.0), (rpm, 1.0), (rmc, 1.0)),
    "receiver 10 Hz": ((rmc, 0.1), (hdt, 0.5), (rsa, 0.5), (rpm, 0.5)),
    "one each": ((rmc, 1.0), (hdt, 1.0), (rsa, 1.0), (rpm, 1.0)),
    "midnight": tuple((body, 1.0) for body in (lambda t: gga(t, NIGHT), lambda t: rmc(t, NIGHT), hdt, rsa, rpm)),
    "a slower receiver late": ((rmc, 1.0), (lambda t: late_gll(t), 1.0), (hdt, 0.1), (rsa, 0.1), (rpm, 0.1)),
    "a word": ((rmc, 1.0), (hdt, 0.1), (rsa, 0.1), (rpm, 1.0)),
    "late": ((rmc, 1.0, late_by(0.01, 0.26)), (hdt, 0.1), (rsa, 0.1), (rpm, 1.0)),
    "jitter, a clock": ((rmc, 1.0, 0.01), *((body, 0.1, late_by(0.0, 0.04)) for body in (hdt, rsa)), (rpm, 1.0)),
    "late, a clock": (
        (rmc, 1.0, late_by(0.01, 0.31)), *((body, 0.1, late_by(0.0, 0.04)) for body in (hdt, rsa)), (rpm, 1.0)),
}  # fmt: skip
CLOCKS = {
    "a word": lambda t: "12:00:00.5 ",
    "jitter, a clock": off_clock("%H:%M:%S.%f"),
    "late, a clock": off_clock("%H:%M:%S.%f", 0.0),
}
NIGHT = datetime.datetime(2026, 5, 4, 23, 59, 20)


def late_gll(t: float) -> str:
    before = max(t - 0.4, 0.0)
    return f"GPGLL,{place(before)},{clock(before)[0]},A,A"


@pytest.mark.slow
@pytest.mark.parametrize("name", RATES)
def test_what_is_said_belongs_to_the_moment_at_which_it_was_said(tmp_path: Path, name: str) -> None:
    """Of whatever rates and in whatever order: to 0.05 s, and straight lines over half a second."""
    given = imported(log(tmp_path / "run.nmea", *RATES[name], logger=CLOCKS.get(name)))
    found = given.runs[0].columns
    late = 0.0525 if name == "late" else 0.0  # s: a receiver whose sentences are late by up to 0.25 s
    assert off(found, "psi") < max(TURN, late * np.abs(TRUTH["r"]).max())
    assert off(found, "delta", "n", "x", "y") < 0.05 and off(found, "u", "v") < 0.02
    assert found["t"][-1] == pytest.approx(LENGTH, abs=0.05)
    steps = [every for body, every, *_ in RATES[name] if body != rsa]
    assert np.median(np.diff(found["t"])) == pytest.approx(min(steps), abs=1e-3)
    assert ("logger_clock" in codes(given)) == (name == "late, a clock")


@pytest.mark.parametrize("name", ["gyro 10 Hz", "gyro first"])
def test_a_gap_of_the_log_stays_one(tmp_path: Path, name: str) -> None:
    """What was said before it is not spread over it."""
    found = columns(log(tmp_path / "run.nmea", *RATES[name], gap=(40.95, 60.0)))
    t, known = found["t"], np.isfinite(found["psi"])
    assert not known[(t > 41.5) & (t < 59.5)].any() and known[(t > 61) | (t < 39)].all()
    error = np.angle(np.exp(1j * (found["psi"] - np.interp(t, TRUTH.t, TRUTH.psi_unwrapped))))
    assert np.abs(error[known][10:-10]).max() < TURN


EPOCH = BEGIN.timestamp() + 12.12
LOGGERS: dict[str, Callable[[float], str]] = {
    "ISO": off_clock("%Y-%m-%dT%H:%M:%S.%f"),
    "comma": lambda t: off_clock("%Y/%m/%d %H:%M:%S,%f")(t).strip() + ",",
    "zone": lambda t: off_clock("%Y-%m-%d %H:%M:%S.%f")(t).strip() + "+07:00 ",
    "day": lambda t: f"[{off_clock('%H:%M:%S.%f')(t).strip()}] ",
    "midnight": off_clock("%H:%M:%S.%f", hours=14, ahead=1740.0),
    "seconds": lambda t: f"{EPOCH + t:.3f};",
    "milliseconds": lambda t: f"{1e3 * (EPOCH + t):.0f}\t",
    "nanoseconds": lambda t: f"{1e3 * (EPOCH + t):.0f}000000 ",
    "tag block": lambda t: f"\\s:VDR1,c:{1e3 * (EPOCH + t):.0f}*00\\",
}


@pytest.mark.parametrize("name", LOGGERS)
def test_a_loggers_clock_tells_when_a_heading_was_said(tmp_path: Path, name: str) -> None:
    """The gyro speaks 0.6 s after the receiver."""
    late = lambda t: hdt(t + 0.6)  # noqa: E731
    path = log(tmp_path / "a.nmea", (rmc, 1.0), (late, 1.0, 0.6), (rsa, 1.0), (rpm, 1.0), logger=LOGGERS[name])
    assert off(columns(path), "psi") < 2 * TURN


def ship(*more: tuple[Body, float], without: Body | None = None) -> tuple[tuple[Body, float], ...]:
    """What a receiver says every second, a gyro, a rudder and a shaft every half, but ``without`` one; and more."""
    usual = ((rmc, 1.0), (hdt, 0.5), (rsa, 0.5), (rpm, 0.5))
    return (*(one for one in usual if one[0] is not without), *more)


@pytest.mark.parametrize(("unit", "speed"), [("M", 4.0), ("N", 4.0 * 3600 / 1852), ("K", 14.4), ("S", 8.9478)])
def test_the_true_wind_of_mwv_is_an_angle_from_the_bow(tmp_path: Path, unit: str, speed: float) -> None:
    def mwv(t: float) -> str:
        return f"WIMWV,{(200 - np.degrees(at(t, 'psi'))) % 360:.2f},T,{speed:.4f},{unit},A"

    found = columns(log(tmp_path / "run.nmea", *ship((mwv, 1.0))))
    direction = np.degrees(np.angle(np.exp(1j * (found["wind_direction"] - np.radians(200)))))
    assert np.nanmax(np.abs(direction)) < 0.3 and found["wind_speed"] == pytest.approx(4.0, abs=1e-3)


def test_the_apparent_wind_of_mwv_gives_the_true_one(tmp_path: Path) -> None:
    """With a unit that nobody knows, it says nothing."""

    def mwv(t: float, unit: str = "M") -> str:
        u, v, psi = (at(t, name) for name in ("u", "v", "psi"))
        north, east = 4 * np.cos(np.radians(200)), 4 * np.sin(np.radians(200))
        ahead = north * np.cos(psi) + east * np.sin(psi) + u
        right = -north * np.sin(psi) + east * np.cos(psi) + v
        return f"WIMWV,{np.degrees(np.arctan2(right, ahead)) % 360:.2f},R,{np.hypot(ahead, right):.4f},{unit},A"

    found = columns(log(tmp_path / "run.nmea", *ship((mwv, 0.5))))
    direction = np.angle(np.exp(1j * (found["wind_direction"] - np.radians(200))))
    assert np.nanmax(np.abs(direction)) < 0.02 and np.nanmax(np.abs(found["wind_speed"] - 4.0)) < 0.05
    strange = columns(log(tmp_path / "b.nmea", *ship((lambda t: mwv(t, "F"), 0.5))))
    assert "apparent_wind_speed" not in strange and "wind_speed" not in strange


def test_a_true_wind_angle_of_a_table_is_an_angle_from_the_bow(tmp_path: Path) -> None:
    more = {"w": np.full(len(TRUTH), 4.0), "d": (200 - np.degrees(TRUTH["psi"])) % 360}
    for header in ("twa_deg", "true_wind_angle_deg"):
        found = columns(plain(tmp_path / "a.txt", f"{raw_logs.UNITS} tws_mps {header}", **more))
        assert np.angle(np.exp(1j * (found["wind_direction"] - np.radians(200)))) == pytest.approx(0.0, abs=1e-6)


def angle(t: float, sign: int = 1) -> str:
    return f"{sign * np.degrees(at(t, 'delta')):.3f}"


def rudder(fields: Body) -> tuple[tuple[Body, float], ...]:
    return ship((lambda t: f"AGRSA,{fields(t)}", 0.5), without=rsa)


def shaft(instrument: str, factor: float = 1.0) -> tuple[Body, float]:
    return lambda t: f"IIRPM,{instrument},{factor * 60 * at(t, 'n'):.3f},100,A", 0.5


def magnetic(t: float) -> str:
    return f"{(np.degrees(at(t, 'psi')) + 7.5) % 360:.3f}"  # a variation of 7.5 deg to the west


def compass(more: str, fields: str) -> tuple[tuple[Body, float], ...]:
    """The variation is said by the receiver, or by a magnetic compass every 10 s, beside its deviation."""
    deviation = ",".join(fields.split(",")[:2])
    hdg: Body = lambda t: f"HCHDG,{magnetic(t)},{fields if t % 10 == 0 else f'{deviation},,'}"  # noqa: E731
    return (lambda t: rmc(t, more=more), 1.0), (hdg, 0.25), (rsa, 0.5), (rpm, 0.5)


GYRO_10 = RATES["gyro 10 Hz"]
MOVING: Body = lambda t: f"IIRPM,S,0,{60 * at(t, 'n'):.3f},{t:.1f},A"  # noqa: E731
BOTH = {"n": ("n", 1.0), "delta": ("delta", 1.0)}
# What is said -> the actuators that come of it, each as that of the truth times a factor, and what is said of it
SENTENCES: dict[str, tuple[tuple[Any, ...], dict[str, tuple[str, float]], str]] = {
    "starboard not valid": (rudder(lambda t: f"0.0,V,{angle(t)},A"), BOTH, ""),
    "no starboard": (rudder(lambda t: f",V,{angle(t)},A"), BOTH, ""),
    "port not valid": (rudder(lambda t: f"{angle(t)},A,0.0,V"), BOTH, ""),
    "no port": (rudder(lambda t: f"{angle(t)},A,,"), BOTH, ""),
    "two rudders": (
        rudder(lambda t: f"{angle(t)},A,{angle(t, -1)},A"),
        {"n": ("n", 1.0), "delta_starboard": ("delta", 1.0), "delta_port": ("delta", -1.0)}, ""),
    "a rudder that stays at zero": (rudder(lambda t: f"{angle(t)},A,0.0,A"), BOTH, ""),
    "a shaft and its engine": (ship(shaft("S,0"), shaft("E,0", 3.5), without=rpm), BOTH, ""),
    "two shafts and their engines": (
        ship(shaft("E,1", 3.5), shaft("S,1"), shaft("E,2", 3.4), shaft("S,2", 0.9), without=rpm),
        BOTH | {"n_2": ("n", 0.9)}, ""),
    "the second shaft alone": (ship(shaft("S,2"), without=rpm), BOTH, ""),
    "the first shaft alone": (ship(shaft("S,1"), without=rpm), BOTH, ""),
    "blades that move": (ship((MOVING, 0.5), without=rpm), BOTH, "pitch_moves"),
    "variation of the receiver": (compass("7.5,W,A", ",,,"), BOTH, ""),
    "variation of the compass": (compass(",,A", ",,7.5,W"), BOTH, ""),
    "deviation to the east": (compass("3.0,E,A", "1.0,E,8.5,W"), BOTH, ""),
    "deviation to the west": (compass(",,A", "9.0,W,1.5,E"), BOTH, ""),
    "a gyro that says less": (
        (*GYRO_10, (lambda t: f"GPHDT,{(np.degrees(at(t, 'psi')) + 3) % 360:.3f},T", 0.5)), BOTH, ""),
    "a compass beside a gyro": ((*GYRO_10, (lambda t: "HCHDG,10.0,,,7.5,W", 0.25)), BOTH, ""),
}  # fmt: skip


@pytest.mark.parametrize("name", SENTENCES)
def test_sentences_give_rudders_that_are_valid_shafts_not_engines_and_a_true_heading(tmp_path: Path, name: str) -> None:
    said, actuators, code = SENTENCES[name]
    given = imported(log(tmp_path / "run.nmea", *said))
    found = given.runs[0].columns
    assert {column for column in found if column.startswith(("n", "delta"))} == set(actuators)
    for column, (like, factor) in actuators.items():
        assert off({"t": found["t"], like: found[column] / factor}, like) < (0.01 if like == "n" else 0.05), column
    assert off(found, "psi") < 2 * TURN and code in {"", *codes(given)}


def test_a_rudder_that_is_never_valid_is_missing(tmp_path: Path) -> None:
    (problem,) = import_logs([log(tmp_path / "a.nmea", *rudder(lambda t: f"{angle(t)},V,0.0,V"))]).problems
    assert "delta" in problem


@pytest.mark.parametrize("fields", ["{0},A,,V,B", "0.0,V,{0},A,B", "{0},A,,"])
def test_what_was_ordered_of_a_rudder_stands_beside_it(tmp_path: Path, fields: str) -> None:
    order = (lambda t: f"AGROR,{fields.format(angle(t + 1.0))}", 0.5)
    found = columns(log(tmp_path / "run.nmea", *ship(order)))
    rows = found["t"] < found["t"][-1] - 5.0
    ahead = np.interp(found["t"] + 1.0, found["t"], found["delta"])
    assert np.sqrt(np.mean((found["delta_order"] - ahead)[rows] ** 2)) < 0.05 * np.std(found["delta"])


def test_an_engine_alone_is_asked_for(tmp_path: Path) -> None:
    """It is no shaft, but may turn as fast as one."""
    path = log(tmp_path / "run.nmea", *ship(shaft("E,0"), without=rpm))
    found = import_logs([path])
    assert not found.runs and "missing n" in found.problems[0] and '"RPM-E"' in found.problems[0]
    assert [list(q.choices) for q in found.questions] == [["n", "n_2", "nothing"]]
    assert off(columns(path, chosen(columns={"n": "RPM-E"})), "n") < 0.01


def broken(body: Body, void: Body) -> Body:
    return lambda t: void(t) if 40 <= t < 60 else body(t)


@pytest.mark.parametrize(
    ("name", "void"),
    [
        ("rmc", lambda t: f"GPRMC,{clock(t)[0]},V,0000.000000,N,00000.000000,E,0.0,0.0,{clock(t)[1]},,,N"),
        ("gll", lambda t: f"GPGLL,0000.0,N,00000.0,E,{clock(t)[0]},V,N"),
        ("vtg", lambda t: "GPVTG,0.00,T,,M,0.000,N,0.000,K,N"),
        ("rot", lambda t: "TIROT,0.0,V"),
        ("ths", lambda t: "HETHS,0.0,V"),
        ("rpm", lambda t: "IIRPM,S,0,0.0,0,V"),
        ("mwv", lambda t: "WIMWV,0.0,T,0.0,N,V"),
    ],
)
def test_what_is_not_valid_says_nothing(tmp_path: Path, name: str, void: Body) -> None:
    """For 20 s of the log a sentence holds zeros, and says that they are not valid."""

    def vtg(t: float) -> str:
        return "GPVTG,{1:.3f},T,,M,{0:.4f},N,,K,A".format(*motion(t))

    bodies = {
        "rmc": rmc, "ths": lambda t: f"HETHS,{heading(t)},A", "rsa": rsa, "rpm": rpm, "vtg": vtg,
        "gll": lambda t: f"GPGLL,{place(t)},{clock(t)[0]},A,A",
        "rot": lambda t: f"TIROT,{60 * np.degrees(at(t, 'r')):.3f},A", "mwv": lambda t: "WIMWV,20.0,T,9.0,N,A",
    }  # fmt: skip
    bodies[name] = broken(bodies[name], void)
    given = imported(log(tmp_path / "run.nmea", *((body, 0.5) for body in bodies.values())))
    found = given.runs[0].columns
    for column in ("x", "y", "psi", "u", "v", "r", "n", "delta"):
        known = np.isfinite(found[column])
        assert known.mean() > 0.75
        error = off({"t": found["t"][known], column: found[column][known]}, column)
        assert error < 0.05, (column, error)
    assert np.nanmin(found["wind_speed"]) == pytest.approx(9.0 * 1852 / 3600)


@pytest.mark.parametrize("body", [lambda t: f"HCHDG,{magnetic(t)},,,,", lambda t: f"HCHDM,{magnetic(t)},M"])
@pytest.mark.parametrize("more", [",,A", "0.0,E,A"])
def test_a_magnetic_heading_asks_for_the_variation(tmp_path: Path, body: Body, more: str) -> None:
    """Zeros of a receiver are none."""
    path = log(tmp_path / "run.nmea", (lambda t: rmc(t, more=more), 1.0), (body, 0.5), (rsa, 0.5), (rpm, 0.5))
    found = import_logs([path])
    assert not found.runs and "variation = " in found.problems[0]
    assert off(columns(path, chosen(variation=-7.5)), "psi") < 2 * TURN


def test_a_receiver_that_stands_still_is_seen_beside_a_faster_gyro(tmp_path: Path) -> None:
    def stopped(t: float) -> str:
        time, day = clock(t)
        return rmc(t) if not 40 < t < 70 else f"GPRMC,{time},A,{place(40)},2.0,0.0,{day},,,A"

    for receiver in (stopped, rmc):
        found = imported(log(tmp_path / "run.nmea", (receiver, 1.0), *RATES["gyro 10 Hz"][1:]))
        assert ("frozen" in codes(found)) == (receiver is stopped)


def accounts(path: Path) -> dict[str, list[Account]]:
    """What became of the sentences of a log, by sentence."""
    out: dict[str, list[Account]] = {}
    for one in import_logs([path]).runs[0].logs[0].table.accounts:
        out.setdefault(one.what, []).append(one)
    return out


FAR = partial(gga, talker="GN", north=250.0)
SECOND: dict[str, tuple[tuple[Any, ...], str, float | None]] = {
    "rarely": (((rmc, 1.0), (FAR, 5.0)), "GNGGA", 250.0),
    "antennas": (((rmc, 1.0), (partial(gga, north=12.0), 1.0)), "GPGGA", 12.0),
    "one talker": (((rmc, 1.0), (partial(rmc, north=12.0), 1.0)), "GPRMC", 12.0),
    "one talker, jitter": (((rmc, 1.0, lambda r: r.uniform(0, 0.2)),
                            (partial(rmc, north=12.0), 1.0, lambda r: r.uniform(0, 0.2))), "GPRMC", 12.0),
    "one talker, rates": (((partial(gga, north=12.0), 1.0), (gga, 0.2), (zda, 1.0)), "GPGGA", 12.0),
    "tag blocks": (((lambda t: f"\\s:A*00\\{sentence(rmc(t))}", 1.0),
                    (lambda t: f"\\s:B*00\\{sentence(rmc(t, north=12.0))}", 1.0)), "GPRMC of B", 12.0),
    "better": (((partial(rmc, north=12.0), 1.0), (partial(gga, talker="GN", quality=4), 1.0)), "GPRMC", 12.0),
    "speeds": (((gga, 0.5), (FAR, 1.0), (lambda t: "GNVTG,0.0,T,,M,9.0,N,,K,A", 1.0), (zda, 1.0)), "GNVTG", None),
}  # fmt: skip
"""Sentences of two receivers, that which is not used, and how far off it is [m]."""


@pytest.mark.parametrize("name", SECOND)
def test_two_receivers_are_never_mixed(tmp_path: Path, name: str) -> None:
    said, what, distance = SECOND[name]
    path = log(tmp_path / "run.nmea", *said, (hdt, 0.5), (rsa, 0.5), (rpm, 0.5))
    found = columns(path)
    for error in (found[c] - np.interp(found["t"], TRUTH.t, TRUTH[c]) for c in "xy"):
        assert np.nanstd(error) < 0.05 and np.isfinite(error).mean() > 0.95
    assert off(found, "u", "v") < 0.02
    left = [one for one in accounts(path)[what] if not one.used_as]
    assert len(left) == 1 and "receiver" in left[0].why
    if distance is not None:
        assert float(re.search(r"([\d.]+) m off", left[0].why)[1]) == pytest.approx(distance, rel=0.03)  # type: ignore[index]


@pytest.mark.parametrize(
    "said",
    [
        ((lambda t: rmc(t, talker="GP" if t < 50 else "GN"), 1.0),),
        ((lambda t: rmc(t, talker="GP" if t // 7 % 2 else "GN"), 1.0),),
        ((partial(rmc, talker="GN"), 1.0), (gga, 1.0), (partial(gga, talker="GL", decimals=3), 1.0)),
        ((lambda t: re.sub(r",(\d{6})\.\d\d,", r",\1,", rmc(t)), 0.2),),
        ((rmc, 1.0), (rmc, 1.0)),
    ],
)
def test_talkers_of_one_receiver_are_one(tmp_path: Path, said: Any) -> None:
    """Which changes with its satellites, or speaks of each kind of them, by whole seconds, or twice."""
    path = log(tmp_path / "run.nmea", *said, (hdt, 0.5), (rsa, 0.5), (rpm, 0.5))
    found = columns(path)
    assert off(found, "x", "y") < 0.05 and np.isfinite(found["x"]).mean() > 0.95
    assert all("latitude" in one.used_as for name, some in accounts(path).items() for one in some if name[2:5] != "VTG"
               and name[:2] in ("GP", "GN", "GL"))  # fmt: skip


def weeks_early(t: float) -> str:
    return rmc(t, BEGIN - datetime.timedelta(weeks=1024))


def cold(t: float) -> str:
    return rmc(t) if t >= 5 else f"GPRMC,00000{t:.2f},A,{place(t)},1.0,0.0,060180,,,A"


def set_late(t: float) -> str:
    """By the seconds that its satellites tell at last."""
    return rmc(t, BEGIN + datetime.timedelta(seconds=3.0 if t < 8 else 0.0))


DATES: dict[str, tuple[tuple[Any, ...], Callable[[float], str] | None, str, str]] = {
    "rollover": (((weeks_early, 1.0),), off_clock("%Y-%m-%d %H:%M:%S.%f"), "2026-05-04", "week_rollover"),
    "rollover within": (((lambda t: rmc(t) if t < 60 else weeks_early(t), 1.0),), None, "2026-05-04", ""),
    "early": (((weeks_early, 1.0),), None, "2006-09-18", "date_early"),
    "cold start": (((cold, 1.0), (lambda t: zda(t) if t > 9 else "GPZDA,000001.00,06,01,1980,00,00", 1.0)), None,
                   "2026-05-04", "clock_unset"),
    "seconds": (((set_late, 1.0),), None, "2026-05-04", "clock_unset"),
    "one ZDA": (((lambda t: zda(t) if t == 30 else "", 1.0), (gga, 1.0)), None, "2026-05-04", ""),
    "of the logger": (((gga, 1.0),), off_clock("%Y-%m-%d %H:%M:%S.%f"), "2026-05-04", ""),
    "none": (((gga, 1.0),), None, "", ""),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", DATES)
def test_dates_of_a_receiver(tmp_path: Path, name: str) -> None:
    said, logger, day, code = DATES[name]
    found = imported(log(tmp_path / "run.nmea", *said, *RATES["gyro 10 Hz"][1:], logger=logger))
    (run,) = found.runs
    first = LENGTH - run.columns["t"][-1]
    assert run.day == day and {code} - {""} <= codes(found) and first < 10
    assert off({**run.columns, "t": run.columns["t"] + first}, "psi") < TURN


def test_a_log_without_fixes_has_the_clock_of_its_logger(tmp_path: Path) -> None:
    """Of another file, with the receiver, it is a part."""
    log(tmp_path / "gyro.nmea", *RATES["gyro 10 Hz"][1:], logger=off_clock("%Y-%m-%dT%H:%M:%S.%f", 0.0))
    log(tmp_path / "gnss.nmea", (rmc, 1.0))
    assert off(columns(tmp_path, chosen(zone_hours=7.0)), "psi") < TURN


def test_every_sentence_is_accounted_for(tmp_path: Path) -> None:
    """And damaged ones keep their place in the order."""

    def water(t: float) -> str:
        return f"VDVBW,{at(t, 'u') / KNOT + 1:.4f},0.0,A,{at(t, 'u') / KNOT:.4f},{at(t, 'v') / KNOT:.4f},A,,V,,V"

    said = (
        "!AIVDM,1,1,,A,13u?etPv2;0n:dDPwUM1U1Cb069D,0", "PASHR,0,1,2", "SDDPT,1.0,0.5", "GPVTG,0.0,T,,M,0.0,N,0.0,K,N",
        "YXXDR,A,2.0,D,ROLL", "IIRPM,S,0,1.0,9.0,V", "WIMWD,200.0,T,,M,,N,4.0,M",
    )  # fmt: skip
    more = [water, *(partial(lambda text, t: text, text) for text in said)]
    path = log(tmp_path / "run.nmea", *RATES["gyro 10 Hz"], *((body, 1.0) for body in more))
    lines = path.read_text().splitlines()
    for i in range(200, len(lines), 97):
        lines[i] = lines[i][:-1] + ("0" if lines[i][-1] != "0" else "1")
    path.write_text("\n".join(lines))
    given, found = imported(path), accounts(path)
    run = given.runs[0].columns
    assert off(run, "psi") < TURN and off(run, "u") < 0.01 and run["wind_direction"] == pytest.approx(np.radians(200))
    assert sum(one.rows for name, some in found.items() for one in some if "water" not in name) == len(lines)
    assert found["HEHDT"][0].used_as == ("heading",) and found["VDVBW"][0].used_as == ("u", "v")
    assert sum(one.rows for one in found["HEHDT"]) == int(LENGTH / 0.1) + 1
    assert found["GPVTG"][0].why == "mode N" and found["VDVBW through the water"][0].why
    assert all(not one.used_as for name in ("AIVDM", "PASHR", "SDDPT", "YXXDR") for one in found[name])
    assert {"checksum wrong", "status V"} <= {one.why for some in found.values() for one in some}
