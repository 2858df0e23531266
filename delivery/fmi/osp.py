"""The description that the Open Simulation Platform reads beside an FMU: its variables in groups that can be connected.

OSP interface specification 1.0. libcosim looks for it by the name of the model, in the folder of the FMU or of the
system structure, never inside the FMU. Two groups can be connected where their kinds and numbers of variables agree.
"""

from __future__ import annotations

from xml.etree import ElementTree as Xml

from delivery.fmi.description import text_of
from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.units import exponents
from delivery.fmi.variables import VariableTable

NAMESPACE = "https://open-simulation-platform.com/OspModelDescription/1.0.0"
ORDER = ("Generic", "Force", "Torque", "LinearVelocity", "AngularVelocity", "LinearDisplacement",
         "AngularDisplacement")  # fmt: skip
"""Kinds of groups in the order in which the schema wants them."""


def osp_name(ship: CoSimulatedShip) -> str:
    """Name of the file for ``ship``: libcosim builds it from the name of the model."""
    return f"{ship.identifier}_OspModelDescription.xml"


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


def osp_description(table: VariableTable) -> str:
    """The description of an FMU with the variables of ``table``."""
    rows, groups = {row.name: row for row in table.rows}, osp_groups(table)
    root = Xml.Element("OspModelDescription", xmlns=NAMESPACE, version="1.0")
    definitions = Xml.SubElement(root, "UnitDefinitions")
    for unit in sorted({rows[name].unit or "" for _, _, members in groups for name in members} - {""}):
        powers = {base: str(n) for base, n in sorted((exponents(unit) or {}).items())}
        Xml.SubElement(Xml.SubElement(definitions, "Unit", name=unit), "BaseUnit", powers)
    parent = Xml.SubElement(root, "VariableGroups")
    for kind, name, members in groups:
        group = Xml.SubElement(parent, kind, name=name)
        for member in members:
            named = {"unit": rows[member].unit or ""}
            Xml.SubElement(group, "Variable", {"ref": member, **(named if named["unit"] else {})})
    return text_of(root)
