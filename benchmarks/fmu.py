"""Speed of exported FMUs: one step of 10 Hz by the library itself, and a hundred ships in libcosim.

python -m benchmarks.fmu [--ships 100] [--seconds 60]
The least of many batches is taken, so that other work on the machine counts little; the processor time says what a
machine of its own would reach on one core. libcosim is left out where libcosimpy is missing.
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import os
import subprocess
import tempfile
import time
import zipfile
from pathlib import Path
from xml.etree import ElementTree as Xml

from benchmarks.record import record, table
from delivery.fmi.sources import HEADERS, STANDARD
from delivery.fmi.write import write_fmu2
from mmg.compile.cache import compiler
from tests.support.c_products import product
from tests.support.fmus import ship_of

LIMITS_US = {"plain": 1.5, "hybrid": 5.0, "memory": None}
"""What a step with its inputs and outputs may take [us]; hybrid: two layers of 32."""
MOTION, FORCES = ("ned_", "body_"), ("ned_", "body_", "logged", "force.")
"""How the names of the outputs that are read begin."""
FASTER = 80.0
"""How many times faster than real time a hundred hybrid ships must run in libcosim."""


def fmu_in(folder: Path, kind: str) -> tuple[Path, Xml.Element]:
    """An FMU of a 3 m ship and its description."""
    path = folder / kind / "ship.fmu"
    path.parent.mkdir()
    write_fmu2(product(ship_of(kind)), path)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(path.parent)
        return path, Xml.fromstring(archive.read("modelDescription.xml"))


def program(folder: Path) -> Path:
    """The compiled timing program."""
    source, built = Path(__file__).with_name("fmu_step.c"), folder / "fmu_step"
    assert (STANDARD / HEADERS[2][0]).is_file()
    command = [
        compiler() or "cc",
        "-O2",
        "-std=gnu99",
        "-I",
        str(STANDARD),
        str(source),
        "-o",
        str(built),
        "-ldl",
        "-lm",
    ]
    subprocess.run(command, check=True)
    return built


def step_us(timer: Path, path: Path, root: Xml.Element, outputs: tuple[str, ...]) -> float:
    """Time [us] of a step of 0.1 s with all inputs set and the ``outputs`` whose names begin so read."""
    variables = [(v.get("name") or "", v.get("causality"), int(v.get("valueReference") or 0))
                 for v in root.iter("ScalarVariable")]  # fmt: skip
    read = [reference for name, _, reference in variables if name.startswith(outputs)]
    inputs = sum(causality == "input" for _, causality, _ in variables)
    library = next((path.parent / "binaries").rglob("*.*"))
    arguments = [str(library), root.get("guid") or "", str(inputs), str(min(read)), str(len(read))]
    return min(
        float(subprocess.run([str(timer), *arguments], check=True, capture_output=True).stdout) for _ in range(3)
    )


SYSTEM = """<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">
<StartTime>0.0</StartTime><BaseStepSize>0.1</BaseStepSize><Algorithm>fixedStep</Algorithm><Simulators>{ships}</Simulators>
</OspSystemStructure>"""
SHIP = """<Simulator name="ship{}" source="ship.fmu" stepSize="0.1"><InitialValues>
<InitialValue variable="initial.u"><Real value="0.4"/></InitialValue>
<InitialValue variable="propeller.n"><Real value="9.0"/></InitialValue>
<InitialValue variable="rudder.delta"><Real value="{}"/></InitialValue></InitialValues></Simulator>"""


def libcosim_factor(path: Path, ships: int, seconds: float, observed: bool) -> tuple[float, float]:
    """Simulated over real time of so many ships in libcosim, and over the processor time of all threads; best of three
    stretches. observed: whether position and heading of all are recorded."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.WARNING)
    rows = "".join(SHIP.format(i, 0.3 * (i - ships / 2) / ships) for i in range(ships))
    (path.parent / "OspSystemStructure.xml").write_text(SYSTEM.format(ships=rows), encoding="utf-8")
    execution = CosimExecution.from_osp_config_file(str(path.parent))
    if observed:
        observer = CosimObserver.create_time_series()
        execution.add_observer(observer)
        references = {v.name.decode(): v.reference for v in execution.slave_variables(0)}
        for i in range(ships):
            for name in ("ned_position.north", "ned_position.east", "ned_position.yaw"):
                observer.start_time_series(i, references[name], CosimVariableType.REAL)
    wall, processor = 0.0, 0.0
    for _ in range(3):
        began, used = time.perf_counter(), time.process_time()
        assert execution.step(round(10 * seconds))
        wall = max(wall, seconds / (time.perf_counter() - began))
        processor = max(processor, seconds / (time.process_time() - used))
    return wall, processor


def main() -> None:
    """Measure, print and record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ships", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    lines = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        timer, built = program(folder), {kind: fmu_in(folder, kind) for kind in LIMITS_US}
        rows = []
        for kind, limit in LIMITS_US.items():
            times = [step_us(timer, *built[kind], names) for names in (MOTION, FORCES)]
            rows.append([kind, *(f"{x:.2f}" for x in times), str(limit or "-")])
        lines += table(["set + step of 0.1 s + get [us]", "12 of motion", "and forces", "may take"], rows)
        if importlib.util.find_spec("libcosimpy") is None:
            lines += ["", "libcosim: libcosimpy is not installed"]
        else:
            rows = []
            for kind, observed in itertools.product(("plain", "hybrid"), (False, True)):
                factors = libcosim_factor(built[kind][0], given.ships, given.seconds, observed)
                what = "3 outputs of each recorded" if observed else "nothing recorded"
                rows.append([f"{kind}, {what}", *(f"{x:.0f}" for x in factors), f"{FASTER:.0f}"])
            head = [f"{given.ships} ships in libcosim, 10 Hz", "times real time", "times processor time", "wanted"]
            lines += ["", *table(head, rows)]
    lines += ["", f"Load of the machine while it ran: {os.getloadavg()[0]:.0f} processes on {os.cpu_count()} cores."]
    record("FMU", "python -m benchmarks.fmu", lines)


if __name__ == "__main__":
    main()
