"""The sources of an FMU: the ship's C code, the tables of its variables, the wrapper, the headers of the standard."""

from __future__ import annotations

import sys
from pathlib import Path

from delivery.c.source import c_files
from delivery.fmi.ship import TIME, CoSimulatedShip
from delivery.fmi.variables import VariableTable

OWN, STANDARD = Path(__file__).parent / "c", Path(__file__).parent / "headers"
INSTANCE, MODEL = ("fmu-instance.h", "fmu-instance.c"), "fmu-model.h"
WRAPPER = {2: "fmi2-functions.c", 3: "fmi3-functions.c"}
HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
"""Headers of the standard, under the 2-clause BSD licence that each of them holds."""
MAIN = "fmu-main.c"
"""The one file to compile: it includes the others. File names with a hyphen cannot be those of a ship."""


def fmu_sources(ship: CoSimulatedShip, version: int) -> dict[str, str]:
    """Text of the files in the folder sources, by name, but for MODEL. ship: of the FMU; version: of FMI, 2 or 3.

    Raises UserError for equations that cannot be written in C.
    """
    file_names = (*INSTANCE, WRAPPER[version])
    files = {name: (OWN / name).read_text(encoding="utf-8") for name in file_names}
    files |= {name: (STANDARD / name).read_text(encoding="utf-8") for name in HEADERS[version]}
    files |= c_files(ship)
    includes = (f"{ship.identifier}.c", INSTANCE[1], WRAPPER[version])
    note = "/* The one file to compile, with this folder among the include directories; link with libm. */\n"
    files[MAIN] = note + "".join(f'#include "{name}"\n' for name in includes)
    return files


def model_header(ship: CoSimulatedShip, table: VariableTable, token: str) -> str:
    """The file MODEL: sizes, start values and bounds. ship, table: of the FMU; token: GUID or instantiation token."""
    states, start = ship.model.states, [row.start for row in table.rows[1:] if row.start is not None]
    bounds = table.rows[1 + table.inputs + 6 :][: len(table.parameters)]
    sizes = {
        "FMU_STATES": len(states),
        "FMU_ACTUATORS": table.actuators,
        "FMU_INPUTS": table.inputs,
        "FMU_PARAMETERS": len(table.parameters),
        "FMU_ROLES": len(ship.model.roles),
        "FMU_TIMED": int(TIME in ship.model.controls),
        "FMU_DELAYED": int(ship.late is not None),
        "FMU_LOGS_LATE": int(ship.late_log is not None),
        "FMU_DELAY": table.inputs + 6 + len(ship.coefficients),
        "FMU_LOG_DELAY": table.inputs + 6 + len(table.parameters) - 1,
        "FMU_ROLL": states.index("phi") if "phi" in states else -1,
        "FMU_ROLL_RATE": states.index("p") if "p" in states else -1,
    }
    p = ship.identifier
    return "\n".join(
        [
            "/* Names and numbers of this FMU: the same as in modelDescription.xml. */",
            "#ifndef FMU_MODEL_H",
            "#define FMU_MODEL_H",
            "#include <float.h>",
            f'#include "{p}.h"',
            f'#define FMU_TOKEN "{token}"',
            f"#define SHIP(name) {p}_##name",
            "/* settles the memory of a state whose first six are given: of the ship's source, included before */",
            "#define FMU_SETTLE settle",
            *(f"#define {name} {value if value >= 0 else f'({value})'}" for name, value in sizes.items()),
            _array("fmu_start", start),
            _array("fmu_lower", [max(row.lower, -sys.float_info.max) for row in bounds]),
            _array("fmu_upper", [min(row.upper, sys.float_info.max) for row in bounds]),
            "#endif\n",
        ]
    )


def _array(name: str, values: list[float]) -> str:
    """C text of a constant array of doubles."""
    rows = ",\n  ".join(repr(float(x)) for x in values)
    return f"static const double {name}[{len(values)}] = {{\n  {rows}}};"
