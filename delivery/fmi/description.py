"""What is written about an FMU: modelDescription.xml of FMI 2.0 and 3.0, the build description of FMI 3.0, the page
inside, and the description that the Open Simulation Platform reads beside it.

OSP interface specification 1.0: libcosim looks for its description by the name of the model, in the folder of the FMU
or of the system structure, never inside the FMU. Two groups of variables can be connected where their kinds and numbers
of variables agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import escape

from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.variables import SHOWN, VariableTable, exponents
from delivery.product import filled
from fitting.report.run_folder import versions

TEMPLATES = Path(__file__).parent / "c"
ORDER = ("Generic", "Force", "Torque", "LinearVelocity", "AngularVelocity", "LinearDisplacement",
         "AngularDisplacement")  # fmt: skip
"""Kinds of groups in the order in which the schema wants them."""


def xml(text: str) -> str:
    """``text`` as the value of an attribute: on one line, without characters that XML cannot hold."""
    printable = "".join(c if c.isprintable() or c.isspace() else " " for c in text)
    return escape(" ".join(printable.split()), {'"': "&quot;"})


def description(ship: CoSimulatedShip, table: VariableTable, version: int, token: str, files: Sequence[str]) -> str:
    """modelDescription.xml of a ``ship`` and its variables ``table``.

    version: of FMI, 2 or 3; token: the GUID or instantiation token; files: sources, which FMI 2.0 lists here.
    """
    names = sorted({row.unit for row in table.rows if row.unit})
    return filled(
        TEMPLATES / "modelDescription.xml", ship, two=version == 2, NAME=ship.plain.ship.called, TOKEN=token,
        WORDS=" ".join(ship.plain.sentences), VERSION=versions()["mmg-ident"], IDENTIFIER=ship.identifier, FILES=files,
        UNITS=[(name, exponents(name), SHOWN.get(name)) for name in names], STEP=float(f"{ship.longest_step / 5:.1g}"),
        ROWS=table.rows, OUTPUTS=table.of("output"), SHOWN=SHOWN, INFINITE=math.inf, xml=xml,
    )  # fmt: skip


def build_description(ship: CoSimulatedShip, main: str) -> str:
    """sources/buildDescription.xml of FMI 3.0 for ``ship``. main: the source to compile."""
    return filled(TEMPLATES / "buildDescription.xml", ship, IDENTIFIER=ship.identifier, MAIN=main)


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
        TEMPLATES / "ospDescription.xml", ship, GROUPS=groups, UNIT_OF=unit_of,
        UNITS=[(unit, exponents(unit) or {}) for unit in units],
    )  # fmt: skip


def fmu_page(ship: CoSimulatedShip, table: VariableTable) -> str:
    """The HTML page of ``ship`` with the variables of ``table``."""
    groups = [(title, table.of(title.lower()[:-1])) for title in ("Inputs", "Outputs", "Parameters")]
    return filled(
        TEMPLATES / "page.html", ship, markup=True, NAME=ship.identifier, STEP=f"{ship.longest_step:g}",
        WORDS=ship.plain.sentences, RANGES=ship.ranges, GROUPS=groups,
    )  # fmt: skip
