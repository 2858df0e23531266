"""Clocks of the logs of one run that differ or drift are named with their size, and the proposed line mends them."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap, read_map
from cases.trial import Trial
from mmg_ident import simulate
from tests.support import raw_logs

pytest.importorskip("pyproj", reason="needs the extra import")

GYRO = "run7_gyro.csv"


@lru_cache
def long_run(ship: str, maneuver: str, duration: float) -> Trial:
    return simulate(ship, maneuver, dt=0.5, duration=duration, seed=1)


def logs(folder: Path, truth: Trial, offset: float = 0.0, drift: float = 0.0) -> list[Path]:
    """Three files of a run; the gyro's clock shows so much more than the time [s], and gains ``drift`` [s per s]."""
    paths = raw_logs.apart(folder, truth)
    head, *lines = paths[1].read_text().splitlines()
    times = np.array([float(line.split(",")[0]) for line in lines])
    wrong = times + 1000 * offset + drift * (times - times[0])
    rest = [line.split(",", 1)[1] for line in lines]
    paths[1].write_text("\n".join([head, *(f"{t:.0f},{r}" for t, r in zip(wrong, rest, strict=True))]) + "\n")
    return paths


@pytest.mark.parametrize(
    ("ship", "maneuver", "duration"),
    [("kvlcc2_l7", "zigzag:20/20", 180), ("kvlcc2_l7", "zigzag:10/10", 300), ("kvlcc2_l7", "turning:35", 300),
     ("kvlcc2_full", "zigzag:10/10", 1500), ("kvlcc2_full", "turning:-35", 1500), ("esso_osaka_3m", "random:7", 300)],
)  # fmt: skip
def test_clocks_that_agree_are_no_problem(tmp_path: Path, ship: str, maneuver: str, duration: float) -> None:
    """Also in turns, where the course is late for long and the ship loses half its speed."""
    found = import_logs(logs(tmp_path, long_run(ship, maneuver, duration)))
    assert not found.problems and len(found.runs[0].logs) == 3


@pytest.mark.parametrize(
    ("maneuver", "duration", "offset", "drift", "words"),
    [
        ("zigzag:20/20", 180, 5.0, 0.0, r"differ: the course changes 1\.\d s before the heading"),
        ("zigzag:20/20", 180, -6.0, 0.0, r"differ: the course changes 9\.\d s after the heading"),
        ("zigzag:10/10", 300, 0.0, 0.03, r"drift apart by 8\.\d s in 299 s.*gyro.csv is fast"),
        ("zigzag:10/10", 300, 0.0, -0.04, r"drift apart by 1[12] s in 2\d\d s.*gyro.csv is slow"),
        ("zigzag:10/10", 300, 20.0, 0.04, r"drift apart by 1[12] s.*clock_drift = -0.0\d+, clock_offset = -2\d"),
    ],
)
def test_clocks_that_do_not_agree_are_named_and_mended_by_the_line(
    tmp_path: Path, maneuver: str, duration: float, offset: float, drift: float, words: str
) -> None:
    truth = long_run("kvlcc2_l7", maneuver, duration)
    paths = logs(tmp_path, truth, offset, drift)
    found = import_logs(paths)
    assert not found.runs and len(found.problems) == 1 and re.search(words, found.problems[0]), found.problems
    table, line = re.search(r"add to the map: (\[files\.\"[^]]*\]) (.*?) \(or", found.problems[0]).groups()
    (tmp_path / "import.toml").write_text("\n".join([table, *line.split(", ")]) + "\n")
    mended = import_logs(paths, read_map(tmp_path / "import.toml"))
    assert not mended.problems
    run = mended.runs[0]
    # the actuators begin last, at 0.3 s
    inside = (run.columns["t"] > 15) & (run.columns["t"] < run.columns["t"][-1] - 15)
    psi = np.interp(run.columns["t"] + 0.3, truth.t, truth.psi_unwrapped)
    off = np.angle(np.exp(1j * (run.columns["psi"] - psi)))[inside]
    assert np.sqrt(np.mean(off**2)) < 0.06  # rad; a few seconds at 0.02 rad/s


def test_clocks_that_a_person_keeps_are_kept(tmp_path: Path) -> None:
    paths = logs(tmp_path, long_run("kvlcc2_l7", "zigzag:20/20", 180), 5.0)
    keep = ImportMap.model_validate({"files": {GYRO: {"clock_offset": 0.0}}})
    assert not import_logs(paths, keep).problems
