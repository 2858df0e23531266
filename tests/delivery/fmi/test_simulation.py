"""An FMU moves as ``mmg simulate`` does, in FMPy and libcosim; that of a filter follows as ``Tracker``."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate_controls
from cases.trial import Trial
from delivery.c.tracker import TrackedShip
from delivery.fmi.binaries import MAIN
from delivery.fmi.variables import input_name
from delivery.fmi.write import fmu_files, write_fmu, write_fmu_tracker
from mmg.motion.flow import STATES
from mmg.motion.frames import earth_to_body
from mmg.ship import Ship
from mmg_ident.tracker import Tracker
from tests.delivery.c.test_source import record
from tests.support.c_products import STRICT, compiler, product
from tests.support.fmus import RunningFmu, fmu, input_rows, inputs_over, needs_compiler, running, ship_of

# An FMU moves as ``mmg simulate`` does, in FMPy and in libcosim
pytestmark = needs_compiler
MOTION = ["ned_position.north", "ned_position.east", "ned_position.yaw"]
MOTION += ["body_velocity.surge", "body_velocity.sway", "body_velocity.yaw"]
LOGGED = [f"logged.{name}" for name in STATES]
EXACT = 1e-9


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of columns of a motion (N, 6) from those ``expected`` (N, 6); angles modulo a turn."""
    error = found - expected
    error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return float(np.abs(error).max())


def without_lag(ship: Ship) -> Ship:
    """The ship as she moves: her filtered velocities are of the instruments."""
    return ship.without_effect("velocity_filter") if "velocity_filter" in ship.effects else ship


@pytest.mark.slow
@pytest.mark.parametrize("h", [0.07, 0.1, 0.25, 0.5])
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("kind", ["plain", "hybrid", "memory", "all"])
def test_ten_minutes_are_those_of_simulate(kind: str, version: int, h: float) -> None:
    """Also of a ship with memory, delay and network: "all"."""
    ship, trial = ship_of(kind), inputs_over(ship_of(kind), h, 600.0)
    with running(fmu(kind, version), version) as instance:
        found = instance.run(ship, trial, [*MOTION, *LOGGED])
    assert np.ptp(found[:, 2]) > 0.5, "it hardly turns"
    assert difference(found[:, 6:], simulate_controls(ship, trial).states) < EXACT
    assert difference(found[:, :6], simulate_controls(without_lag(ship), trial).states) < EXACT


@pytest.mark.slow
def test_logged_columns_are_those_of_the_instruments_and_the_current_is_where_its_inputs_start(tmp_path: Path) -> None:
    adrift = ship_of("plain").with_effect("current", {"x": 0.05, "y": -0.03, "x_rate": 1e-4, "y_rate": 2e-4})
    ship = adrift.with_effect("antenna_offset", {"x": 0.7, "y": -0.2}).with_effect("heading_bias", {"psi": 0.05})
    trial = inputs_over(ship, 0.25, 30.0)
    write_fmu(product(ship), tmp_path / "ship.fmu", 2)
    with running(tmp_path / "ship.fmu", 2) as instance:
        found = instance.run(ship, trial, [*MOTION, *LOGGED])
    assert difference(found[:, 6:], simulate_controls(ship, trial).states) < EXACT
    # the motion starts where the instruments say that it does: the states behind the first sample
    start = {name: np.full(len(trial), x) for name, x in zip(STATES, found[0, :6], strict=True)}
    assert difference(found[:, :6], simulate_controls(adrift, trial.with_columns(**start)).states) < EXACT


def test_the_current_is_an_input_of_every_ship() -> None:
    ship, water = ship_of("plain"), {"x": 0.06, "y": -0.04}
    trial = inputs_over(ship, 0.25, 30.0)
    with running(fmu("plain", 2), 2) as instance:
        instance[["current_velocity.north", "current_velocity.east"]] = list(water.values())
        found = instance.run(ship, trial, MOTION)
    assert difference(found, simulate_controls(ship.with_effect("current", water), trial).states) < EXACT


def test_a_ship_adrift_goes_with_water_and_air() -> None:
    with running(fmu("plain", 2), 2) as instance:
        start = dict(zip(("initial.u", "initial.v"), map(float, earth_to_body(0.1, 0.05, 0.4)), strict=True))
        for medium in ("current_velocity", "wind_velocity"):
            start |= {f"{medium}.north": 0.1, f"{medium}.east": 0.05}
        instance.begin({"initial.psi": 0.4, **start})
        for k in range(100):
            instance.fmu.doStep(0.1 * k, 0.1)
        assert np.allclose(instance[MOTION[:3]], [1.0, 0.5, 0.4], atol=1e-9)


SYSTEM = """<?xml version="1.0" encoding="UTF-8"?>
<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">
  <StartTime>0.0</StartTime><BaseStepSize>{h}</BaseStepSize><Algorithm>fixedStep</Algorithm>
  <Simulators>
    <Simulator name="ship" source="ship.fmu" stepSize="{h}"><InitialValues>{starts}</InitialValues></Simulator>
    <Simulator name="other" source="ship.fmu" stepSize="{h}"/>
  </Simulators>
  <Connections>
    <VariableGroupConnection>
      <VariableGroup simulator="ship" name="velocity"/><VariableGroup simulator="other" name="wind_velocity"/>
    </VariableGroupConnection>
  </Connections>
</OspSystemStructure>
"""


def cosimulated(path: Path, ship: Ship, trial: Trial, folder: Path) -> tuple[np.ndarray, list[float]]:
    """Motion (N - 1, 6) after the first sample in libcosim, and the wind on a second ship that is connected to it."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver

    for file in path.parent.iterdir():
        shutil.copy(file, folder)
    initial = '<InitialValue variable="initial.{}"><Real value="{!r}"/></InitialValue>'
    starts = "".join(initial.format(s, float(trial[s][0])) for s in STATES)
    h = float(trial.t[1] - trial.t[0])
    (folder / "OspSystemStructure.xml").write_text(SYSTEM.format(h=h, starts=starts), encoding="utf-8")
    execution = CosimExecution.from_osp_config_file(str(folder))
    inputs, outputs = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(inputs)
    execution.add_observer(outputs)
    first, second = (execution.slave_index_from_instance_name(name) for name in ("ship", "other"))
    references = {v.name.decode(): v.reference for v in execution.slave_variables(first)}
    names, rows = input_rows(ship, trial)
    found = []
    for row in rows[:-1]:
        inputs.slave_real_values(first, [references[name] for name in names], row.tolist())
        assert execution.step()
        found.append(outputs.last_real_values(first, [references[name] for name in MOTION]))
    air = [references["wind_velocity.north"], references["wind_velocity.east"]]
    return np.array(found), outputs.last_real_values(second, air)


@pytest.mark.parametrize("kind", ["plain", pytest.param("all", marks=pytest.mark.slow)])
def test_libcosim_moves_the_ship_as_simulate_and_connects_its_groups(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("libcosimpy")
    ship = ship_of(kind)
    for h in (0.07, 0.1, 0.25, 0.5) if kind == "all" else (0.25,):
        folder = tmp_path / str(h)
        folder.mkdir()
        trial = inputs_over(ship, h, 600.0 if kind == "all" else 30.0)
        found, wind = cosimulated(fmu(kind, 2), ship, trial, folder)
        assert difference(found, simulate_controls(without_lag(ship), trial).states[1:]) < EXACT
        assert np.allclose(wind, found[-2, 3:5], atol=1e-12)


# The FMU of a filter follows a ship as ``mmg_ident.Tracker`` does
SHIP = load_ship("esso_osaka_3m").with_effect("velocity_filter", {"tau": 1.0})
CHOSEN = {"X_0F": 0.002}
MEASURED = [f"measured.{s}" for s in STATES]
ROWS = 40


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("tracker") / "tracker.fmu"
    write_fmu_tracker(product(SHIP), found, coefficients=CHOSEN)
    return found


def fed(instance: RunningFmu, first: int, last: int, wanted: list[str]) -> np.ndarray:
    """Values (rows, W) of ``wanted`` after each step of 1 s from row ``first`` to ``last`` of the record."""
    _, logged, inputs = record(TrackedShip.of(product(SHIP)).ship)
    names = [*map(input_name, SHIP.actuators), "wind_velocity.north", "wind_velocity.east"]
    found = []
    for k in range(first, last):
        instance[[*MEASURED, *names]] = [*logged[k], *inputs[k, :-1]]
        instance.fmu.doStep(float(k), 1.0)
        found.append(instance[wanted])
    return np.array(found)


@pytest.mark.slow
def test_estimates_and_forecasts_are_those_of_python(path: Path) -> None:
    tracker = Tracker(SHIP, CHOSEN)
    _, logged, inputs = record(tracker.ship)
    names, expected = [*STATES, *TrackedShip.of(product(SHIP), CHOSEN).random.names], []
    for k in range(ROWS):
        *moved, north, east, _ = inputs[k]
        state = tracker.update(k, logged[k], [*moved, np.hypot(north, east), np.arctan2(-east, -north)])
        now, later = tracker.forecast(1.0), tracker.forecast(21.0)
        std = np.sqrt(now.std[-1] ** 2 - tracker.noise.sensors**2)
        expected.append([*now.states[-1], *std, *later.states[-1], *later.std[-1], state.nis, state.compared])
    wanted = [f"{kind}.{s}" for kind in ("estimate", "std", "forecast", "forecast_std") for s in STATES]
    with running(path, 2) as instance:
        assert names == [n.removeprefix("estimate.") for n in instance.references if n.startswith("estimate.")]
        instance.begin({"horizon": 20.0})
        assert not instance.valid() and instance[["extrapolation"]] == [-1.0]
        found = fed(instance, 0, ROWS, [*wanted, "nis", "compared"])
        force = instance[["estimate.tow.X", "std.X_0F"]]
    assert np.abs(found - expected).max() < EXACT
    assert force[0] != 0.0 and 0 < force[1] < CHOSEN["X_0F"]


@pytest.mark.slow
def test_it_waits_for_a_heading_and_goes_on_without_measurements(path: Path) -> None:
    with running(path, 2) as instance:
        instance.begin({"propeller.n": 10.0})
        instance.fmu.doStep(0.0, 1.0)
        assert instance[["std.x"]] == [0.0]
        instance[["measured.psi", "measured.u"]] = [0.3, 0.4]
        instance.fmu.doStep(1.0, 1.0)
        first = instance[["estimate.psi", "std.psi"]]
        instance[MEASURED] = [np.nan] * 6
        instance.fmu.doStep(2.0, 1.0)
        later = instance[["estimate.psi", "std.psi", "compared"]]
    assert first[0] == pytest.approx(0.3, abs=0.05) and later[1] > first[1] > 0 and later[2] == 0.0


@pytest.mark.slow
def test_a_saved_state_goes_on_as_it_did_and_less_noise_makes_it_surer(path: Path) -> None:
    wanted = ["estimate.x", "std.x", "nis"]
    with running(path, 2) as instance:
        instance.begin({})
        fed(instance, 0, 10, wanted)
        kept = instance.fmu.getFMUState()
        once = fed(instance, 10, 20, wanted)
        instance.fmu.setFMUState(kept)
        assert np.array_equal(fed(instance, 10, 20, wanted), once)
        instance.fmu.setFMUState(kept)
        instance[["noise.x"]] = [0.002]
        assert (fed(instance, 10, 20, wanted)[:, 1] < once[:, 1]).all()
        instance.fmu.freeFMUState(kept)


@pytest.mark.slow
def test_its_sources_compile_without_a_warning(tmp_path: Path) -> None:
    files, _ = fmu_files(TrackedShip.of(product(SHIP)), 2, ["none"])
    for name, content in files.items():
        if name.startswith("sources/"):
            (tmp_path / Path(name).name).write_bytes(content)
    command = [*compiler("gcc, C"), *STRICT, "-O1", "-I.", "-c", MAIN, "-o", "main.o"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr[:2000]
