"""``mmg start``: one call from logs to a ship, an FMU and answers; a second goes on, and bad input costs nothing."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest

from cases.criteria.standard_runs import simulated_trial
from cases.io.read import read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship, load_ship
from delivery.fmi import binaries
from fitting.report import imo_form
from mmg_ident import start as steps
from mmg_ident.commands.main import main
from tests.support.commands import refusal, shown
from tests.support.diagnosis_cases import FEW, pushed_trials

RUNS = (("zigzag:20/20", 60.0), ("turning:35", 60.0), ("random:11", 60.0))
SIZES = "3,0.48925,0.20125,0.831,D_P=0.084"


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """Intervals by 40 ships, of which the 90 % are as wide within a fifth; an FMU that no optimiser has seen."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(imo_form, "DRAWS", 40)
        patch.setattr(binaries, "FLAGS", tuple(f for f in binaries.FLAGS if f != "-O2"))
        yield


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw logs in degrees, knots and revolutions a minute, of a ship in a current."""
    folder = tmp_path_factory.mktemp("raw")
    for trial in pushed_trials(4, ["current:x=0.02,y=0.01"], RUNS):
        knots, angle = 3600 / 1852, np.degrees
        columns = {
            "Time [s]": trial.t, "North [m]": trial["x"], "East [m]": trial["y"], "Heading [deg]": angle(trial["psi"]),
            "u [kn]": knots * trial["u"], "v [kn]": knots * trial["v"], "ROT [deg/min]": 60 * angle(trial["r"]),
            "RPM [rpm]": 60 * trial["n"], "Rudder [deg]": angle(trial["delta"]),
        }  # fmt: skip
        pd.DataFrame(columns).to_csv(folder / f"{trial.name.replace('/', '_').replace(':', '_')}.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def ship(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ship file with few free coefficients."""
    path = tmp_path_factory.mktemp("ship") / "few.toml"
    path.write_text(dump_ship(FEW))
    return path


@pytest.fixture(scope="module")
def started(logs: Path, ship: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a first call."""
    out = tmp_path_factory.mktemp("out") / "start"
    assert main(["start", str(logs), "--ship", str(ship), "--out", str(out), "--yes"]) == 0
    return out


@pytest.mark.slow
def test_one_call_goes_from_logs_to_a_ship_an_fmu_and_answers(started: Path) -> None:
    assert {p.name for p in started.iterdir()} >= {"trials", "run", "ship.fmu", "answers.toml"}
    assert (started / "run" / "report.html").is_file() and len(read_trials([started / "trials"])) == len(RUNS)
    result = json.loads((started / "run" / "result.json").read_text())
    current = result["coefficients"]["current.x"]
    assert result["converged"] and abs(current["value"] - 0.02) < 3 * current["std"]
    known = steps.read_answers(started / "answers.toml")
    assert known.given == steps.Answers().given and known.record["asked"] == []
    assert set(known.record["assumed"]) == set(known.given) and known.record["measured"]


@pytest.mark.slow
def test_logs_whose_headers_say_nothing_are_imported_by_a_map(logs: Path, ship: Path, tmp_path: Path) -> None:
    names, units = (
        ["t", "x", "y", "psi", "u", "v", "r", "n", "delta"],
        ["s", "m", "m", "deg", "kn", "kn", "deg/min", "rpm", "deg"],
    )
    bare = tmp_path / "bare"
    bare.mkdir()
    for path in logs.glob("*.csv"):
        pd.read_csv(path).set_axis([f"c{k}" for k in range(len(names))], axis=1).to_csv(bare / path.name, index=False)
    rows = [f'{n} = {{ from = "c{k}", unit = "{u}" }}' for k, (n, u) in enumerate(zip(names, units, strict=True))]
    (tmp_path / "map.toml").write_text("\n".join(["[columns]", *rows]))
    given = [str(bare), "--ship", str(ship), "--out", str(tmp_path / "out"), "--yes"]
    assert main(["start", *given]) == 2
    assert main(["start", *given, "--map", str(tmp_path / "map.toml")]) == 0
    rates = [np.radians(pd.read_csv(path)["ROT [deg/min]"]) / 60 for path in sorted(logs.glob("*.csv"))]
    for trial, rate in zip(read_trials([tmp_path / "out" / "trials"]), rates, strict=True):
        np.testing.assert_allclose(trial["r"], rate, atol=1e-9)


@pytest.mark.slow
def test_a_second_call_makes_only_what_is_missing(started: Path, logs: Path, ship: Path) -> None:
    before = (started / "run" / "result.json").stat().st_mtime_ns
    (started / "ship.fmu").unlink()
    given = ["start", str(logs), "--ship", str(ship), "--out", str(started), "--yes"]
    printed = shown(*given)
    assert (started / "run" / "result.json").stat().st_mtime_ns == before and (started / "ship.fmu").is_file()
    assert printed["converged"] and printed["fmu"] == str(started / "ship.fmu")
    rows = {(row["figure"], row["side"]): row for row in printed["figures"]}
    low, high = rows["Advance", "starboard"]["interval_90"]
    assert low < rows["Advance", "starboard"]["tested"] < high


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "text"),
    [
        (f"--particulars {SIZES}", "one of them"), ("--answers answers.toml", "depht"),
        ("--answers aground.toml", "aground"), ("--out full", "holds no answers.toml"),
        ("--out theirs", "holds no answers.toml"), ("--out started", "other logs or another ship"), ("log.csv", ""),
        ("--map no.toml", "no.toml"), ("--map answers.toml", "depht"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_leaves_nothing(
    change: str, text: str, logs: Path, ship: Path, started: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    files = {"answers.toml": "depht = 20.0\n", "aground.toml": "depth = 0.1\n", "full/mine.txt": "mine",
             "theirs/trials/a.csv": "", "log.csv": "no,log\nat,all\n"}  # fmt: skip
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    (tmp_path / "started").symlink_to(started)
    log = change if change == "log.csv" else logs
    words = ["start", log, "--ship", "esso_osaka_3m" if "started" in change else ship, "--yes"]
    more = [word for word in change.split() if word != log]
    assert text in refusal(*words, *([] if "--out" in more else ["--out", "new"]), *more)
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_a_folder_goes_on_with_the_answers_that_it_has(started: Path, logs: Path, ship: Path, tmp_path: Path) -> None:
    """Other answers are refused; a folder that has only its mark, as where the import was stopped, asks again."""
    other = tmp_path / "answers.toml"
    other.write_text("depth = 3.0\n")
    given = ["start", str(logs), "--ship", str(ship), "--yes", "--answers", str(other)]
    assert "other answers" in refusal(*given, "--out", started)
    mark = steps.digest([logs], load_ship(str(ship)))
    steps.write_mark(tmp_path / "begun", mark)
    known = steps.check_folder(tmp_path / "begun", mark, steps.read_answers(other))
    assert known is not None and not known.is_asked
    with pytest.raises(steps.UserError):
        steps.starting_ship(str(ship), None, 0.3)


@pytest.mark.slow
def test_answers_reach_ship_and_sidecars(logs: Path, tmp_path: Path) -> None:
    """Trial files are taken as they are; the antenna goes into trials.toml, the depth into site.toml and the ship."""
    trials = tmp_path / "out" / "trials"
    files = [tmp_path / f"{name}.csv" for name in ("a", "b")]
    for path in files:
        path.write_text("t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad]\n" + "\n".join(
            f"{t},{t},0,0,1,0,0,10,{0.1 * (t % 3)}" for t in range(30)))  # fmt: skip
    assert steps.are_trials(files) and not steps.are_trials([logs])
    steps.copy_trials(files, trials)
    known = steps.Answers()
    for name, text in (("antenna", "-0.9 0"), ("depth", "0.6"), ("rudder_rate", "12"), ("current", "'per run'")):
        known = steps.answered(known, name, text)
    steps.write_sidecars(trials, {"reference_point": {"x": -0.9, "y": 0.0, "applies_to": "both"}})
    steps.write_depth(trials, float(known.depth))
    ship = steps.with_answers(load_ship("esso_osaka_3m"), known)
    started = steps.StartedRun(tmp_path / "out", ship, tuple(read_trials([trials])), known)
    depth = started.ship.coefficients["shallow_water.d_h"]
    assert depth.fixed and depth.value == pytest.approx(started.ship.particulars["d"] / 0.6)
    assert started.ship.particulars["rudder_rate"] == pytest.approx(math.radians(12)) and known.current == "per run"
    assert started.trials[0]["x"][0] == pytest.approx(0.9) and "0.6" in (trials / "site.toml").read_text()
    steps.write_answers(started, "mark", "mmg start")
    assert steps.read_answers(tmp_path / "out" / "answers.toml").given == known.given
    assert len(steps.questions(started.ship, started.trials, True, False)) <= 5
    for name, text in (("antenna", "aft"), ("current", "strong"), ("depth", "-3")):
        with pytest.raises(steps.UserError):
            steps.answered(known, name, text)


@pytest.mark.parametrize(("answer", "along"), [("none", False), ("unknown", True)])
def test_where_there_is_no_current_none_is_fitted_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str, along: bool
) -> None:
    monkeypatch.setattr("mmg_ident.api.calibrate", calibrate := Mock(return_value=Mock(messages=())))
    answers = steps.answered(steps.Answers(), "current", answer)
    steps.fitted(steps.StartedRun(tmp_path, steps.with_answers(FEW, answers), (), answers), "mmg start")
    ship, _, _, _, options, _ = calibrate.call_args.args
    assert (options.surroundings, ship.effects) == (along, FEW.effects)


@pytest.mark.slow
def test_tested_figures_are_of_midship_and_in_still_water() -> None:
    """The same circle with and without a current and a lever arm, both in the ship that looks at it."""
    arm, water = complex(-0.9, 0.2), complex(0.03, -0.02)
    ship = FEW.with_effect("current", {"x": 0.03, "y": -0.02}).with_effect("antenna_offset", {"x": -0.9, "y": 0.2})
    still = simulated_trial(FEW, parse_maneuver("turning:35", FEW, speed=0.5), dt=0.5)
    turn = np.exp(1j * still["psi"])
    place = still["x"] + 1j * still["y"] + arm * turn + water * still.t
    over = still["u"] + 1j * still["v"] + 1j * still["r"] * arm + water / turn
    seen = still.with_columns(x=place.real, y=place.imag, u=over.real, v=over.imag)
    remarks: list[str] = []
    wanted, found, raw = (
        imo_form.tested_figures(*given, remarks) for given in ((FEW, [still]), (ship, [seen]), (FEW, [seen]))
    )
    for figure in ("advance", "tactical_diameter"):
        value = wanted["turning:35", figure].value
        assert found["turning:35", figure].value == pytest.approx(value, rel=1e-3)
        assert raw["turning:35", figure].value != pytest.approx(value, rel=0.02)
    assert "current" in remarks[1] and "antenna" in remarks[1] and "current" not in remarks[2]
    logged = replace(seen, columns={name: values for name, values in seen.columns.items() if name not in ("x", "y")})
    alone = imo_form.tested_figures(ship, [logged], remarks)  # course and speed over ground of the antenna alone
    for figure in ("advance", "tactical_diameter"):
        assert alone["turning:35", figure].value == pytest.approx(wanted["turning:35", figure].value, rel=0.01)
