"""The FMU of a filter follows a ship as ``mmg_ident.Tracker`` does."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from delivery.c.tracker import TrackedShip
from delivery.fmi.binaries import MAIN
from delivery.fmi.variables import input_name
from delivery.fmi.write import fmu_files, write_fmu_tracker
from mmg.states import STATES
from mmg_ident.tracker import Tracker
from tests.delivery.c.test_tracker import record
from tests.support.c_products import STRICT, compiler, product
from tests.support.fmus import RunningFmu, needs_compiler, running

pytestmark = needs_compiler
EXACT = 1e-9
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
