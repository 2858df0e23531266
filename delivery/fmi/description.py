"""What is written about an FMU: modelDescription.xml of FMI 2.0 and 3.0, the build description of FMI 3.0, the page
inside, and the description that the Open Simulation Platform reads beside it.

OSP interface specification 1.0: libcosim looks for its description by the name of the model, in the folder of the FMU
or of the system structure, never inside the FMU. Two groups of variables can be connected where their kinds and numbers
of variables agree.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree as Xml

from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.variables import SHOWN, FmuVariable, VariableTable, exponents
from delivery.product import filled
from fitting.report.run_folder import versions

CATEGORIES = {
    "logStatusError": "errors, such as calls in a wrong order",
    "logStatusWarning": "values outside their bounds",
    "logStatusDiscard": "values that were refused",
    "logAll": "everything else",
}
PAGE = Path(__file__).parent / "c" / "page.html"
NAMESPACE = "https://open-simulation-platform.com/OspModelDescription/1.0.0"
ORDER = ("Generic", "Force", "Torque", "LinearVelocity", "AngularVelocity", "LinearDisplacement",
         "AngularDisplacement")  # fmt: skip
"""Kinds of groups in the order in which the schema wants them."""


def text_of(root: Xml.Element) -> str:
    """The document of ``root``, indented."""
    Xml.indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"


def printable_words(words: str) -> str:
    """``words`` without characters that XML cannot hold, on one line."""
    return " ".join("".join(c if c.isprintable() or c.isspace() else " " for c in words).split())


def head(ship: CoSimulatedShip, version: str) -> dict[str, str]:
    """Attributes of the root of a description of ``ship`` that both versions have. version: of FMI."""
    return {
        "fmiVersion": version,
        "modelName": printable_words(ship.plain.ship.called),
        "description": printable_words(" ".join(ship.plain.sentences)),
        "version": versions()["mmg-ident"],
        "generationTool": f"mmg-ident {versions()['mmg-ident']}",
        "variableNamingConvention": "structured",
    }


def experiment(ship: CoSimulatedShip) -> dict[str, str]:
    """Attributes of the experiment that a description of ``ship`` proposes."""
    step = float(f"{ship.longest_step / 5:.1g}")
    return {"startTime": "0.0", "stopTime": "600.0", "stepSize": repr(step)}


def units(parent: Xml.Element, table: VariableTable) -> None:
    """Adds the definitions of all units of ``table`` to ``parent``."""
    names = sorted({row.unit for row in table.rows if row.unit})
    definitions = Xml.SubElement(parent, "UnitDefinitions")
    for name in names:
        unit, powers = Xml.SubElement(definitions, "Unit", name=name), exponents(name)
        if powers is not None:
            Xml.SubElement(unit, "BaseUnit", {base: str(n) for base, n in sorted(powers.items())})
        if name in SHOWN:
            shown, factor = SHOWN[name]
            Xml.SubElement(unit, "DisplayUnit", name=shown, factor=repr(factor))


def real_attributes(row: FmuVariable) -> dict[str, str]:
    """Attributes of the value of a real variable ``row`` that both versions have."""
    attributes = {}
    if row.unit:
        attributes["unit"] = row.unit
        if row.unit in SHOWN:
            attributes["displayUnit"] = SHOWN[row.unit][0]
    if math.isfinite(row.lower):
        attributes["min"] = repr(row.lower)
    if math.isfinite(row.upper):
        attributes["max"] = repr(row.upper)
    if row.start is not None:
        attributes["start"] = repr(row.start)
    return attributes


def description(ship: CoSimulatedShip, table: VariableTable, version: int, token: str, files: list[str]) -> str:
    """modelDescription.xml of a ``ship`` and its variables ``table``.

    version: of FMI, 2 or 3; token: the GUID or instantiation token; files: sources, which FMI 2.0 lists here.
    """
    two = version == 2
    state = "FMUstate" if two else "FMUState"
    root = Xml.Element(
        "fmiModelDescription", {**head(ship, f"{version}.0"), "guid" if two else "instantiationToken": token}
    )
    able = ("canHandleVariableCommunicationStepSize", f"canGetAndSet{state}", f"canSerialize{state}")
    attributes = {"modelIdentifier": ship.identifier, **dict.fromkeys(able, "true")}
    cosimulation = Xml.SubElement(root, "CoSimulation", attributes)
    if two:
        sources = Xml.SubElement(cosimulation, "SourceFiles")
        for name in files:
            Xml.SubElement(sources, "File", name=name)
    units(root, table)
    categories = Xml.SubElement(root, "LogCategories")
    for name, words in CATEGORIES.items():
        Xml.SubElement(categories, "Category", name=name, description=words)
    Xml.SubElement(root, "DefaultExperiment", experiment(ship))
    variables = Xml.SubElement(root, "ModelVariables")
    # the time is not needed in FMI 2.0, and some importers want it to have a start
    for row in table.rows[1 if two else 0 :]:
        attributes = {
            "name": row.name, "valueReference": str(row.reference), "description": printable_words(row.words),
            "causality": row.causality, "variability": row.variability,
        }  # fmt: skip
        if row.causality == "parameter":
            attributes["initial"] = "exact"
        elif row.causality in ("output", "local"):
            attributes["initial"] = "calculated"
        if two:
            kind = "Boolean" if row.unit is None else "Real"
            Xml.SubElement(Xml.SubElement(variables, "ScalarVariable", attributes), kind, real_attributes(row))
        else:
            kind = "Boolean" if row.unit is None else "Float64"
            Xml.SubElement(variables, kind, {**attributes, **real_attributes(row)})
    structure = Xml.SubElement(root, "ModelStructure")
    for name in ("Output", "InitialUnknown"):
        parent = Xml.SubElement(structure, f"{name}s") if two else structure
        for row in table.of("output"):
            reference = {"index" if two else "valueReference": str(row.reference)}
            Xml.SubElement(parent, "Unknown" if two else name, reference)
    return text_of(root)


def build_description(ship: CoSimulatedShip, files: list[str]) -> str:
    """sources/buildDescription.xml of FMI 3.0 for ``ship``. files: sources to compile."""
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    build = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=ship.identifier)
    sources = Xml.SubElement(build, "SourceFileSet", language="C99")
    for name in files:
        Xml.SubElement(sources, "SourceFile", name=name)
    words = "the mathematical functions of the C library, where they are a library of their own"
    Xml.SubElement(build, "Library", name="m", external="true", description=words)
    return text_of(root)


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


def fmu_page(ship: CoSimulatedShip, table: VariableTable) -> str:
    """The HTML page of ``ship`` with the variables of ``table``."""
    groups = [(title, table.of(title.lower()[:-1])) for title in ("Inputs", "Outputs", "Parameters")]
    return filled(
        PAGE, ship, markup=True, NAME=ship.identifier, STEP=f"{ship.longest_step:g}", WORDS=ship.plain.sentences,
        RANGES=ship.ranges, GROUPS=groups,
    )  # fmt: skip
