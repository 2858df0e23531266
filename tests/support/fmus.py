"""FMUs of small ships, built once for all tests, and one that runs in FMPy."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from delivery.fmi import binaries
from delivery.fmi.variables import input_name
from delivery.fmi.write import write_fmu
from mmg.compile.cache import compiler
from mmg.motion.flow import STATES
from mmg.motion.frames import wind_vector
from mmg.network import Network
from mmg.ship import Ship
from tests.support.c_products import product
from tests.support.networks import random_network

binaries.FLAGS = tuple(flag.replace("-O2", "-O0") for flag in binaries.FLAGS)  # a fifth of the time to compile
needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")
MEMORY = {
    "control_delay": {"tau": 0.43},
    "velocity_filter": {"tau": 0.37},
    "rudder_lag": {"T": 0.8},
    "hull_memory": {"T": 1.2},
}
STARTS = {"x": 3.0, "y": -2.0, "psi": 0.3, "u": 0.4, "v": 0.01, "r": 0.002}


def network(ship: Ship, width: int = 32) -> Network:
    """A random network on ``ship`` whose accelerations stay small over minutes."""
    made, unknown = random_network(ship, width=width), np.full(len(ship.features), np.inf)
    return replace(made, output_scales=np.full(3, 5e-4), lower=-unknown, upper=unknown)


@cache
def ship_of(kind: str) -> Ship:
    """A 3 m ship: "plain", "hybrid", with "memory", or "all" of it."""
    ship = load_ship("esso_osaka_3m")
    if kind in ("memory", "all"):
        for name, values in MEMORY.items():
            ship = ship.with_effect(name, values)
    return ship.with_network(network(ship)) if kind in ("hybrid", "all") else ship


@cache
def fmu(kind: str, version: int) -> Path:
    """The FMU of ``ship_of(kind)``, in a folder of its own, with a library for this platform."""
    path = Path(mkdtemp(prefix="fmu")) / "ship.fmu"
    write_fmu(product(ship_of(kind)), path, version)
    return path


def inputs_over(ship: Ship, h: float, duration: float) -> Trial:
    """Inputs of ``ship`` each ``h`` [s] over ``duration`` [s] that swing and jump, and the state of the start."""
    t = h * np.arange(round(duration / h) + 1)
    columns = {"t": t, **{name: np.full_like(t, start) for name, start in STARTS.items()}}
    for name in ship.actuators:
        jump = np.sign(np.sin(t / 33))
        columns[name] = 8 + 3 * np.sin(t / 20) + 4 * jump if name.startswith("n") else 0.5 * np.sin(t / 7) + 0.1 * jump
    columns["wind_speed"] = 2 + np.sin(t / 9)
    columns["wind_direction"] = np.mod(t / 50, 2 * math.pi) - math.pi
    return Trial("inputs", columns)


def input_rows(ship: Ship, trial: Trial) -> tuple[list[str], np.ndarray]:
    """Names of the inputs of an FMU of ``ship``, and their values (N, C) in ``trial``."""
    air = wind_vector(trial["wind_speed"], trial["wind_direction"])
    names = [*map(input_name, ship.actuators), "wind_velocity.north", "wind_velocity.east"]
    return names, np.column_stack([*(trial[name] for name in ship.actuators), *air])


class RunningFmu:
    """An instance of an FMU in FMPy, addressed by names."""

    def __init__(self, path: Path, folder: str, version: int) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        known = fmpy.read_model_description(str(path))
        self.references = {v.name: v.valueReference for v in known.modelVariables}
        kind, token = (FMU2Slave, known.guid) if version == 2 else (FMU3Slave, known.instantiationToken)
        identifier = known.coSimulation.modelIdentifier
        self.fmu: Any = kind(guid=token, unzipDirectory=folder, modelIdentifier=identifier, instanceName="ship")
        self.fmu.instantiate()
        self.two = version == 2

    def __getitem__(self, names: Sequence[str]) -> list[float]:
        read = self.fmu.getReal if self.two else self.fmu.getFloat64
        return list(read([self.references[name] for name in names]))

    def __setitem__(self, names: Sequence[str], values: Sequence[float]) -> None:
        write = self.fmu.setReal if self.two else self.fmu.setFloat64
        write([self.references[name] for name in names], [float(x) for x in values])

    def valid(self) -> bool:
        """The output of that name."""
        return bool(self.fmu.getBoolean([self.references["valid"]])[0])

    def begin(self, values: dict[str, float], time: float = 0.0) -> None:
        """Through the initialization, with these ``values`` set, from ``time`` [s] on."""
        if self.two:
            self.fmu.setupExperiment(startTime=time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=time)
        self[list(values)] = list(values.values())
        self.fmu.exitInitializationMode()

    def run(self, ship: Ship, trial: Trial, wanted: Sequence[str]) -> np.ndarray:
        """Values (N, W) of ``wanted`` at the samples of ``trial``, whose inputs are held from one to the next."""
        names, rows = input_rows(ship, trial)
        starts = {f"initial.{s}": float(trial[s][0]) for s in STATES}
        self.begin({**starts, **dict(zip(names, rows[0], strict=True))}, float(trial.t[0]))
        found = [self[wanted]]
        for k, h in enumerate(np.diff(trial.t)):
            self[names] = rows[k]
            self.fmu.doStep(currentCommunicationPoint=float(trial.t[k]), communicationStepSize=float(h))
            found.append(self[wanted])
        return np.array(found)


@contextmanager
def running(path: Path, version: int) -> Iterator[RunningFmu]:
    """An instance of the FMU ``path``, freed at the end."""
    fmpy = pytest.importorskip("fmpy")
    folder = fmpy.extract(str(path))
    instance = RunningFmu(path, folder, version)
    try:
        yield instance
    finally:
        instance.fmu.freeInstance()
        shutil.rmtree(folder, ignore_errors=True)
