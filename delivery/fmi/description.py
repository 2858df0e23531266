"""modelDescription.xml of FMI 2.0 and 3.0, and the build description of FMI 3.0."""

from __future__ import annotations

import math
from xml.etree import ElementTree as Xml

from delivery.c.header import about
from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.units import SHOWN, exponents
from delivery.fmi.variables import FmuVariable, VariableTable
from fitting.report.run_folder import versions

CATEGORIES = {
    "logStatusError": "errors, such as calls in a wrong order",
    "logStatusWarning": "values outside their bounds",
    "logStatusDiscard": "values that were refused",
    "logAll": "everything else",
}


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
        "description": printable_words(" ".join(about(ship.plain))),
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


def description_2(ship: CoSimulatedShip, table: VariableTable, token: str, files: list[str]) -> str:
    """modelDescription.xml of FMI 2.0 of a ``ship`` and its variables ``table``. token: the GUID; files: sources."""
    root = Xml.Element("fmiModelDescription", {**head(ship, "2.0"), "guid": token})
    cosimulation = Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=ship.identifier,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    sources = Xml.SubElement(cosimulation, "SourceFiles")
    for name in files:
        Xml.SubElement(sources, "File", name=name)
    units(root, table)
    categories = Xml.SubElement(root, "LogCategories")
    for name, words in CATEGORIES.items():
        Xml.SubElement(categories, "Category", name=name, description=words)
    Xml.SubElement(root, "DefaultExperiment", experiment(ship))
    variables = Xml.SubElement(root, "ModelVariables")
    for row in table.rows[1:]:  # the time is not needed in FMI 2.0, and some importers want it to have a start
        attributes = {
            "name": row.name,
            "valueReference": str(row.reference),
            "description": printable_words(row.words),
            "causality": row.causality,
            "variability": row.variability,
        }
        if row.causality == "parameter":
            attributes["initial"] = "exact"
        elif row.causality in ("output", "local"):
            attributes["initial"] = "calculated"
        kind = "Boolean" if row.unit is None else "Real"
        Xml.SubElement(Xml.SubElement(variables, "ScalarVariable", attributes), kind, real_attributes(row))
    structure = Xml.SubElement(root, "ModelStructure")
    for name in ("Outputs", "InitialUnknowns"):
        unknowns = Xml.SubElement(structure, name)
        for row in table.of("output"):
            Xml.SubElement(unknowns, "Unknown", index=str(row.reference))
    return text_of(root)


def description_3(ship: CoSimulatedShip, table: VariableTable, token: str) -> str:
    """modelDescription.xml of FMI 3.0 of a ``ship`` with the variables of ``table``. token: instantiation token."""
    root = Xml.Element("fmiModelDescription", {**head(ship, "3.0"), "instantiationToken": token})
    Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=ship.identifier,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    units(root, table)
    categories = Xml.SubElement(root, "LogCategories")
    for name, words in CATEGORIES.items():
        Xml.SubElement(categories, "Category", name=name, description=words)
    Xml.SubElement(root, "DefaultExperiment", experiment(ship))
    variables = Xml.SubElement(root, "ModelVariables")
    for row in table.rows:
        attributes = {
            "name": row.name,
            "valueReference": str(row.reference),
            "description": printable_words(row.words),
            "causality": row.causality,
            "variability": row.variability,
        }
        if row.causality == "parameter":
            attributes["initial"] = "exact"
        elif row.causality in ("output", "local"):
            attributes["initial"] = "calculated"
        Xml.SubElement(variables, "Boolean" if row.unit is None else "Float64", {**attributes, **real_attributes(row)})
    structure = Xml.SubElement(root, "ModelStructure")
    for name in ("Output", "InitialUnknown"):
        for row in table.of("output"):
            Xml.SubElement(structure, name, valueReference=str(row.reference))
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
