"""Trial files and raw logs of a gigabyte: memory and time of ``mmg check`` and ``mmg import``.

python -m benchmarks.long_files [--megabytes 1024] [--hertz 100] [--record]
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.process import measured
from benchmarks.record import record, table

ROWS = 100_000
"""Of a piece that is written at a time."""
KNOT, TURN = 1852.0 / 3600.0, 2 * np.pi / 90
NAMES = ("t [s]", "x [m]", "y [m]", "psi [rad]", "u [m/s]", "v [m/s]", "r [rad/s]", "n [rps]", "delta [rad]",
         "wind_speed [m/s]", "wind_direction [rad]")  # fmt: skip


def motion(hertz: float) -> Iterator[dict[str, np.ndarray]]:
    """A weaving ship with noise of its sensors, for ever, in pieces of ROWS: canonical columns."""
    rng, start, place = np.random.default_rng(0), 0, np.zeros(2)
    while True:
        t = (np.arange(ROWS + 1) + start) / hertz
        psi = 0.4 * np.sin(TURN * t) + 0.3 * np.sin(0.137 * TURN * t) + 2 * np.pi / 1800 * t
        r = 0.4 * TURN * np.cos(TURN * t) + 0.3 * 0.137 * TURN * np.cos(0.137 * TURN * t) + 2 * np.pi / 1800
        u, v = 1.2 + 0.1 * np.cos(2 * TURN * t), -r
        track = []
        over_ground = (u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi))
        for speed, begin in zip(over_ground, place, strict=True):
            track.append(begin + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / hertz]))
        place, start = np.array([track[0][-1], track[1][-1]]), start + ROWS
        delta, one = 0.5 * np.cos(TURN * (t + 3)), np.ones(ROWS + 1)
        exact = (t, *track, psi, u, v, r, 2 * one, delta, 5 * one, one)
        noise = (0, 0.01, 0.01, 1e-3, 5e-3, 5e-3, 2e-4, 0, 0, 0.3, 0.1)
        yield {name: values[:-1] + size * rng.standard_normal(ROWS) * (size > 0)
               for name, values, size in zip(NAMES, exact, noise, strict=True)}  # fmt: skip


def written(path: Path, megabytes: float, hertz: float, raw: bool) -> int:
    """Write a trial file, or a ``raw`` log as of a logger, of so many ``megabytes``; returns its rows."""
    import pandas as pd

    rows = 0
    with path.open("w", newline="") as file:
        for columns in motion(hertz):
            frame = pd.DataFrame(_logged(columns) if raw else {n: np.round(v, 6) for n, v in columns.items()})
            frame.to_csv(file, index=False, header=not rows, sep=";" if raw else ",")
            rows += ROWS
            if file.tell() > megabytes * 2**20:
                return rows
    return rows


def _logged(columns: dict[str, np.ndarray]) -> dict[str, object]:
    """ISO times, latitude and longitude, knots, degrees, rpm, and columns that nobody needs."""
    t, x, y, psi, u, v, _, n, delta = (columns[name] for name in NAMES[:9])
    north, east = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
    stamps = np.datetime64("2026-05-04T09:30:00.000") + np.round(1000 * t).astype("timedelta64[ms]")
    return {
        "Time": np.char.add(stamps.astype(str), "Z"), "Latitude": np.round(34.7 + x / 110942, 8),
        "Longitude": np.round(135.4 + y / 91565, 8), "SOG [kn]": np.round(np.hypot(north, east) / KNOT, 3),
        "COG [deg]": np.round(np.degrees(np.arctan2(east, north)) % 360, 2),
        "Heading [deg]": np.round(np.degrees(psi) % 360, 3), "RPM": np.round(60 * n, 2),
        "Rudder Angle [deg]": np.round(np.degrees(delta), 3), "Remark": "ok", "Fuel flow": np.round(12 + u, 4),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=1024)
    parser.add_argument("--hertz", type=float, default=100)
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    rows = []
    folder = Path(tempfile.mkdtemp())
    try:
        for raw in (False, True):
            path = folder / ("log.csv" if raw else "trial.csv")
            count = written(path, given.megabytes, given.hertz, raw)
            command = ["import", str(path), "--out", str(folder / "out")] if raw else ["check", str(path)]
            seconds, peak, words = measured(["-m", "mmg_ident", *command], errors=True)
            kept = next((line.strip() for line in words.splitlines() if "averaged" in line), "every row is kept")
            size = f"{path.stat().st_size / 2**20:.0f}"
            rows.append([f"mmg {command[0]}", size, str(count), f"{peak:.0f}", f"{seconds:.0f}", kept])
            path.unlink()
    finally:
        shutil.rmtree(folder)
    lines = table(["command", "file [MB]", "rows", "peak [MB]", "time [s]", "what it says"], rows)
    if given.record:
        line = f"python -m benchmarks.long_files --megabytes {given.megabytes:g} --hertz {given.hertz:g} --record"
        record("Files of a gigabyte", line, lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
