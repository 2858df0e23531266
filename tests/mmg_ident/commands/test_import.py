"""mmg import as a person uses it: questions on a terminal, asked once, and a map that repeats the answers."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mmg_ident.commands.main import main
from tests.support import raw_logs
from tests.support.commands import talk
from tests.support.raw_logs import UNITS, plain

pytestmark = pytest.mark.skipif(os.name == "nt", reason="talks on a terminal")
HEADER = UNITS.replace("shaft_rps", "shaft_speed") + " wind_speed wind_dir_rad ws_kn"


def open_logs(folder: Path) -> Path:
    """Two logs that leave the same open: a unit of the shaft, and which winds they hold."""
    folder.mkdir()
    truth = raw_logs.run()
    n = len(truth)
    more = {"w": np.full(n, 5.0), "d": np.full(n, 1.0), "ws": np.full(n, 9.0)}
    for name, speed in (("a", 1.0), ("b", 1.0001)):
        plain(folder / f"{name}.txt", HEADER, u=speed * truth["u"], **more)
    return folder


def same_folders(one: Path, two: Path) -> bool:
    names = sorted(p.name for p in one.iterdir())
    return names == sorted(p.name for p in two.iterdir()) and all(
        (one / name).read_bytes() == (two / name).read_bytes() for name in names
    )


@pytest.mark.slow
def test_what_is_open_is_asked_once_and_the_map_repeats_it_to_the_bit(tmp_path: Path) -> None:
    open_logs(tmp_path / "logs")
    asked = ["wind_direction", "", "fathoms", "rps", "m/s"]
    code, shown, left = talk(["import", "logs", "--out", "one"], asked, tmp_path)
    assert code == 0 and left == [], shown
    assert shown.count("a.txt, b.txt: 'shaft_speed' (n)") == 1
    assert shown.count("'fathoms'") == 1 and shown.count(" [nothing]: ") == 5
    text = (tmp_path / "one" / "import.toml").read_text()
    assert text.count('ignore = ["ws_kn"]') == 2 or text.count('ignore = ["ws"]') == 2
    code, shown, left = talk(["import", "logs", "--map", "one/import.toml", "--out", "two"], ["kn"] * 3, tmp_path)
    assert code == 0 and left == ["kn"] * 3 and "[nothing]" not in shown
    assert same_folders(tmp_path / "one", tmp_path / "two")


@pytest.mark.slow
def test_logs_of_the_same_names_in_two_folders_stay_apart(tmp_path: Path) -> None:
    pytest.importorskip("pyproj", reason="needs the extra import")
    for number, maneuver in enumerate(("zigzag:20/20", "zigzag:10/10")):
        folder = tmp_path / "logs" / f"day{number}"
        folder.mkdir(parents=True)
        raw_logs.apart(folder, raw_logs.run(maneuver))
    one, two = tmp_path / "one", tmp_path / "two"
    assert main(["import", str(tmp_path / "logs"), "--out", str(one)]) == 0
    assert sorted(p.name for p in one.glob("*.csv")) == ["day0_run7.csv", "day1_run7.csv"]
    assert '[files."day1/run7_gyro.csv"]' in (one / "import.toml").read_text()
    assert main(["import", str(tmp_path / "logs"), "--map", str(one / "import.toml"), "--out", str(two)]) == 0
    assert same_folders(one, two)


def test_a_file_that_is_skipped_is_skipped_again(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for name in ("a", "b"):
        plain(logs / f"{name}.txt", UNITS)
    (tmp_path / "map.toml").write_text('[files."b"]\nskip = true\n')
    one, two = tmp_path / "one", tmp_path / "two"
    assert main(["import", str(logs), "--map", str(tmp_path / "map.toml"), "--out", str(one)]) == 0
    assert main(["import", str(logs), "--map", str(one / "import.toml"), "--out", str(two)]) == 0
    assert sorted(p.name for p in two.iterdir()) == ["a.csv", "import.toml", "trials.toml"] and same_folders(one, two)
