"""``mmg export --format fmu``, ``fmu3`` and ``fmu-tracker``: the ship, or a filter that follows her, as a functional
mock-up unit for co-simulation.

Its sources are the ship's C code, the tables of its variables, a wrapper, and the headers of the standard.

OSP interface specification 1.0: libcosim looks for its description by the name of the model, in the folder of the FMU
or of the system structure, never inside the FMU. Two groups of variables can be connected where their kinds and numbers
of variables agree.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
import uuid
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias
from xml.sax.saxutils import escape

from cases.shipfiles.ship_file import dump_ship
from delivery.c.source import c_files
from delivery.c.tracker import TrackedShip, tracker_files
from delivery.fmi.binaries import MAIN, PLATFORMS, build, build_here, platforms_of
from delivery.fmi.ship import TIME, CoSimulatedShip
from delivery.fmi.variables import SHOWN, VariableTable, tracker_table, variable_table
from delivery.product import Product, exponents, filled
from fitting.report.run_folder import plain, versions
from mmg.errors import TargetExists
from mmg.messages import Message

FmuShip: TypeAlias = CoSimulatedShip | TrackedShip
OWN, STANDARD = Path(__file__).parent / "c", Path(__file__).parent / "headers"  # Of this program, of FMI
# Kinds of groups in the order in which the schema wants them.
ORDER = ("Generic", "Force", "Torque", "LinearVelocity", "AngularVelocity", "LinearDisplacement",
         "AngularDisplacement")  # fmt: skip


def xml(text: str) -> str:
    """``text`` as the value of an attribute: on one line, without characters that XML cannot hold."""
    printable = "".join(c if c.isprintable() or c.isspace() else " " for c in text)
    return escape(" ".join(printable.split()), {'"': "&quot;"})


def description(ship: FmuShip, table: VariableTable, version: int, token: str, files: Sequence[str]) -> str:
    """modelDescription.xml of a ``ship`` and its variables ``table``.

    version: of FMI, 2 or 3; token: the GUID or instantiation token; files: sources, which FMI 2.0 lists here.
    """
    names = sorted({row.unit for row in table.rows if row.unit})
    # STEP, which a master takes by default: a fifth of the longest step, to one digit; set by hand
    return filled(
        OWN / "modelDescription.xml", ship, two=version == 2, NAME=ship.plain.ship.called, TOKEN=token,
        WORDS=" ".join(ship.plain.sentences), VERSION=versions()["mmg-ident"], IDENTIFIER=ship.identifier, FILES=files,
        UNITS=[(name, exponents(name), SHOWN.get(name)) for name in names], STEP=float(f"{ship.longest_step / 5:.1g}"),
        ROWS=table.rows, OUTPUTS=table.of("output"), SHOWN=SHOWN, INFINITE=math.inf, xml=xml,
    )  # fmt: skip


def osp_groups(table: VariableTable) -> list[tuple[str, str, tuple[str, ...]]]:
    """Groups of the variables of ``table``: kind, name, names of the variables."""

    def names(prefix: str, *axes: str) -> tuple[str, ...]:
        return tuple(f"{prefix}.{axis}" for axis in axes)

    groups = [
        ("LinearVelocity", "wind_velocity", names("wind_velocity", "north", "east")),
        ("LinearVelocity", "current_velocity", names("current_velocity", "north", "east")),
        ("LinearDisplacement", "position", names("ned_position", "north", "east")),
        ("LinearDisplacement", "ned_position", names("ned_position", "north", "east", "down")),
        ("AngularDisplacement", "heading", names("ned_position", "yaw")),
        ("AngularDisplacement", "attitude", names("ned_position", "roll", "pitch", "yaw")),
        ("LinearVelocity", "velocity", names("body_velocity", "surge", "sway")),
        ("LinearVelocity", "body_velocity", names("body_velocity", "surge", "sway", "heave")),
        ("AngularVelocity", "rate_of_turn", names("body_velocity", "yaw")),
        ("AngularVelocity", "angular_velocity", names("body_velocity", "roll", "pitch", "yaw")),
        ("Generic", "extrapolation", ("extrapolation",)),
    ]
    for row in table.of("input"):
        # a ShaftSpeed is in rad/s, and libcosim converts no units, so revolutions must not look like one
        kind = {"1/s": "Generic", "rad": "AngularDisplacement"}.get(row.unit or "")
        if kind:
            groups.append((kind, row.name, (row.name,)))
    parts = dict.fromkeys(row.name.split(".")[1] for row in table.rows if row.name.startswith("force."))
    for part in parts:
        groups.append(("Force", f"force.{part}", names(f"force.{part}", "X", "Y")))
        groups.append(("Torque", f"moment.{part}", names(f"force.{part}", "N")))
    return sorted(groups, key=lambda group: ORDER.index(group[0]))


def osp_description(ship: CoSimulatedShip, table: VariableTable) -> str:
    """The description of the FMU of ``ship`` with the variables of ``table``."""
    groups, unit_of = osp_groups(table), {row.name: row.unit or "" for row in table.rows}
    units = sorted({unit_of[name] for _, _, members in groups for name in members} - {""})
    return filled(
        OWN / "ospDescription.xml", ship, GROUPS=groups, UNIT_OF=unit_of,
        UNITS=[(unit, exponents(unit) or {}) for unit in units],
    )  # fmt: skip


INSTANCE, MODEL = ("fmu-instance.h", "fmu-instance.c"), "fmu-model.h"
CALCULATED = {CoSimulatedShip: "fmu-ship.c", TrackedShip: "fmu-tracker.c"}
WRAPPER = {2: "fmi2-functions.c", 3: "fmi3-functions.c"}
# Headers of the standard, under the 2-clause BSD licence that each of them holds.
HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
# Codes of what is said of an FMU.
SOURCES_ONLY, LATE_COLUMNS, OSP_DESCRIPTION = "no_binary", "columns_approximate", "osp_description"
LICENCE = "fmi-standard-headers.txt"  # File with the licence of the headers of the standard


def write_fmu(
    product: Product, target: Path, version: int, platforms: Sequence[str] = (), replace: bool = False
) -> list[Message]:
    """Write ``product`` as an FMU to the file ``target``, and its OSP description beside it.

    version: of FMI, 2 or 3. platforms: for which libraries are made, names of PLATFORMS or "none"; default this
    platform where there is a compiler. replace: whether a different OSP description may be replaced. Returns what is to
    be said of the FMU. Raises UserError for a ship that C cannot hold, for a platform without compiler, and where
    another OSP description lies that may not be replaced.
    """
    ship = CoSimulatedShip.of(product)
    # libcosim builds the name of the description from that of the model
    osp_file = target.parent / f"{ship.identifier}_OspModelDescription.xml"
    text = osp_description(ship, variable_table(ship))
    # before anything is compiled, which takes seconds
    if osp_file.exists() and not replace and osp_file.read_text(encoding="utf-8", errors="replace") != text:
        raise TargetExists(f"{osp_file}: describes another FMU; export to another folder, or add --force")
    files, messages = fmu_files(ship, version, platforms)
    write_archive(target, files)
    osp_file.write_text(text, encoding="utf-8", newline="\n")
    words = f"{osp_file.name}: groups of its variables for the Open Simulation Platform (docs/how-to/fmu.md)"
    return [*messages, Message(words, OSP_DESCRIPTION)]


def write_fmu_tracker(
    product: Product,
    target: Path,
    platforms: Sequence[str] = (),
    coefficients: Iterable[str] | Mapping[str, float] = (),
) -> list[Message]:
    """Write the filter of ``product`` as an FMU of version 2 to the file ``target``.

    platforms: as for ``write_fmu``; coefficients: as of ``TrackedShip.of``. Returns what is to be said of the FMU.
    Raises UserError for these, for a ship that C cannot hold and for a platform without compiler.
    """
    files, messages = fmu_files(TrackedShip.of(product, coefficients), 2, platforms)
    write_archive(target, files)
    return messages


def fmu_files(ship: FmuShip, version: int, platforms: Sequence[str] = ()) -> tuple[dict[str, bytes], list[Message]]:
    """Content of the archive of ``ship`` by name, and what is to be said of it. version: of FMI, 2 or 3; platforms: as
    for ``write_fmu``. Raises UserError as that does."""
    table = tracker_table(ship) if isinstance(ship, TrackedShip) else variable_table(ship)
    sources = fmu_sources(ship, version)
    token = _token(ship, table, version, sources)  # of all else, as the model's header holds it
    sources |= {MODEL: model_header(ship, table, token)}
    files = {f"sources/{name}": text.encode() for name, text in sources.items()}
    files["modelDescription.xml"] = description(ship, table, version, token, [MAIN]).encode()
    if version == 3:  # FMI 2.0 lists its sources in the model description
        text = filled(OWN / "buildDescription.xml", ship, IDENTIFIER=ship.identifier, MAIN=MAIN)
        files["sources/buildDescription.xml"] = text.encode()
    files |= _papers(ship)
    messages: list[Message] = []
    # a filter is that of the fit, with its approximations
    if isinstance(ship, CoSimulatedShip) and (late := ship.late_columns):
        words = f"logged.* approximates the lateness of {', '.join(late)}; mmg simulate has it exactly"
        messages.append(Message(words, LATE_COLUMNS))
    if platforms:
        libraries = build(sources, ship.identifier, platforms_of(platforms, version))
    else:
        libraries, why = build_here(sources, ship.identifier)
        if why:
            messages.append(Message(f"the FMU holds sources alone, compiled where it is used: {why}", SOURCES_ONLY))
    for name, content in libraries.items():
        folder = PLATFORMS[name].folder_2 if version == 2 else name
        files[f"binaries/{folder}/{ship.identifier}{PLATFORMS[name].suffix}"] = content
    return files, messages


def fmu_sources(ship: FmuShip, version: int) -> dict[str, str]:
    """Text of the files in the folder sources, by name, but for MODEL. ship: of the FMU; version: of FMI, 2 or 3.

    Raises UserError for equations that cannot be written in C.
    """
    calculated = CALCULATED[type(ship)]
    file_names = (*INSTANCE, calculated, WRAPPER[version])
    files = {name: (OWN / name).read_text(encoding="utf-8") for name in file_names}
    files |= {name: (STANDARD / name).read_text(encoding="utf-8") for name in HEADERS[version]}
    files |= tracker_files(ship) if isinstance(ship, TrackedShip) else c_files(ship)
    includes = (f"{ship.identifier}.c", INSTANCE[1], calculated, WRAPPER[version])
    note = "/* The one file to compile, with this folder among the include directories; link with libm. */\n"
    files[MAIN] = note + "".join(f'#include "{name}"\n' for name in includes)
    return files


def model_header(ship: FmuShip, table: VariableTable, token: str) -> str:
    """The file MODEL: sizes, start values and bounds. ship, table: of the FMU; token: GUID or instantiation token."""
    start = [row.start for row in table.rows[1:] if row.start is not None]  # FMU_SET numbers: all that can be set
    bounds = table.rows[1 + table.inputs + 6 :][: table.parameters]  # parameters alone: behind time, inputs, initial.*
    sizes = {
        "FMU_STATES": len(ship.model.states),
        "FMU_ACTUATORS": table.actuators,
        "FMU_INPUTS": table.inputs,
        "FMU_PARAMETERS": table.parameters,
        "FMU_ROLES": len(ship.model.roles),
        "FMU_TRACKS": int(isinstance(ship, TrackedShip)),
        **(_filter_sizes(ship, table) if isinstance(ship, TrackedShip) else _motion_sizes(ship, table)),
    }
    return filled(
        OWN / MODEL, ship, TOKEN=token, SIZES=sizes, START=_numbers(start),
        # infinite bounds as the largest number: the repr of an infinite one is no C
        LOWER=_numbers([max(row.lower, -sys.float_info.max) for row in bounds]),
        HIGHEST=_numbers([min(row.upper, sys.float_info.max) for row in bounds]),
    )  # fmt: skip


def _motion_sizes(ship: CoSimulatedShip, table: VariableTable) -> dict[str, int]:
    """Sizes and places that fmu-ship.c needs."""
    states = ship.model.states
    return {
        "FMU_TIMED": int(TIME in ship.model.controls),
        "FMU_DELAYED": int(ship.late is not None),
        "FMU_LOGS_LATE": int(ship.late_log is not None),
        # places in ``set`` of the delays, which follow the coefficients: of the actuators, and last of the log
        "FMU_DELAY": table.inputs + 6 + len(ship.coefficients),
        "FMU_LOG_DELAY": table.inputs + 6 + table.parameters - 1,
        "FMU_ROLL": states.index("phi") if "phi" in states else -1,
        "FMU_ROLL_RATE": states.index("p") if "p" in states else -1,
    }


def _filter_sizes(ship: TrackedShip, table: VariableTable) -> dict[str, int]:
    """Sizes and places that fmu-tracker.c needs."""
    return {
        "FMU_DELAYED": 0,
        "FMU_LOGS_LATE": 0,
        "FMU_ESTIMATES": 6 + len(ship.random.names),
        "FMU_NOISE": table.inputs + 6 + len(ship.coefficients),  # behind the coefficients
        "FMU_HORIZON": table.inputs + 6 + table.parameters - 1,  # the last parameter
    }


def _numbers(values: Sequence[float]) -> tuple[int, str]:
    """How many ``values`` there are, and their C text."""
    return len(values), ",\n  ".join("NAN" if math.isnan(x) else repr(float(x)) for x in values)


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write ``files``, by their names in it, to the archive ``path``; the same files give the same bytes."""
    with zipfile.ZipFile(path, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # the first date that a zip file can hold
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, whose permissions follow, on every system
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, files[name], compresslevel=9)


def _token(ship: FmuShip, table: VariableTable, version: int, sources: dict[str, str]) -> str:
    """A token that two FMUs share only where they are the same: made of all that it stands for."""
    # header and description without a token, which cannot be made of itself
    parts = [*sources.items(), (MODEL, model_header(ship, table, ""))]
    parts.append(("", description(ship, table, version, "", ())))
    # by a null between the parts: no two lists of parts then give the same text
    digest = hashlib.sha256("\0".join(f"{name}\0{text}" for name, text in parts).encode()).hexdigest()
    return f"{{{uuid.UUID(digest[:32])}}}"


def _papers(ship: FmuShip) -> dict[str, bytes]:
    """Files of an FMU for people and for this program: licences, the ship file, what is known of the ship."""
    header = (STANDARD / HEADERS[3][0]).read_text(encoding="utf-8")  # its first comment is the licence
    licence = header[header.index("Copyright (C)") : header.index("*/", header.index("Copyright (C)"))]
    files = {
        f"documentation/licenses/{LICENCE}": "The headers of the FMI standard in the folder sources:\n\n" + licence,
        "resources/ship.toml": dump_ship(ship.plain.ship, "The ship of this FMU."),
        "resources/product.json": json.dumps(plain(ship.plain.about()), indent=2, allow_nan=False) + "\n",
    }
    return {name: text.encode() for name, text in files.items()}
