"""``mmg export --format fmu`` and ``fmu3``: the ship as a functional mock-up unit for co-simulation."""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Sequence
from pathlib import Path

from cases.shipfiles.ship_file import dump_ship
from delivery.fmi.archive import write_archive
from delivery.fmi.binaries import PLATFORMS, build, build_here, platforms_of
from delivery.fmi.description import build_description, description_2, description_3
from delivery.fmi.osp import osp_description, osp_name
from delivery.fmi.page import fmu_page
from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.sources import HEADERS, MAIN, MODEL, STANDARD, fmu_sources, model_header
from delivery.fmi.variables import VariableTable, variable_table
from delivery.product import Product
from fitting.report.run_folder import plain
from mmg.errors import TargetExists
from mmg.messages import Message

SOURCES_ONLY, LATE_COLUMNS, OSP_DESCRIPTION = "no_binary", "columns_approximate", "osp_description"
"""Codes of what is said of an FMU."""
LICENCE = "fmi-standard-headers.txt"
"""File with the licence of the headers of the standard."""


def write_fmu2(product: Product, target: Path, platforms: Sequence[str] = (), replace: bool = False) -> list[Message]:
    """Write ``product`` as an FMU of FMI 2.0 to the file ``target``, and its OSP description beside it.

    platforms: for which libraries are made, names of PLATFORMS or "none"; default this platform where there is a
    compiler. replace: whether a different OSP description may be replaced. Returns what is to be said of the FMU.
    Raises UserError for a ship that C cannot hold, for a platform without compiler, and where another OSP description
    lies that may not be replaced.
    """
    return _write(product, target, 2, platforms, replace)


def write_fmu3(product: Product, target: Path, platforms: Sequence[str] = (), replace: bool = False) -> list[Message]:
    """As ``write_fmu2``, of FMI 3.0. product, target, platforms, replace: as there."""
    return _write(product, target, 3, platforms, replace)


def fmu_files(
    ship: CoSimulatedShip, version: int, platforms: Sequence[str] = ()
) -> tuple[dict[str, bytes], list[Message]]:
    """Content of the archive of ``ship`` by name, and what is to be said of it. version: of FMI, 2 or 3; platforms: as
    for ``write_fmu2``. Raises UserError as that does."""
    table = variable_table(ship)
    sources = fmu_sources(ship, version)
    token = _token(ship, table, version, sources)
    sources |= {MODEL: model_header(ship, table, token)}
    files = {f"sources/{name}": text.encode() for name, text in sources.items()}
    if version == 2:
        files["modelDescription.xml"] = description_2(ship, table, token, [MAIN]).encode()
    else:
        files["modelDescription.xml"] = description_3(ship, table, token).encode()
        files["sources/buildDescription.xml"] = build_description(ship, [MAIN]).encode()
    files |= _papers(ship, table)
    messages: list[Message] = []
    if ship.late_columns:
        words = f"logged.* approximates the lateness of {', '.join(ship.late_columns)}; mmg simulate has it exactly"
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


def _write(product: Product, target: Path, version: int, platforms: Sequence[str], replace: bool) -> list[Message]:
    ship = CoSimulatedShip.of(product)
    osp_file, text = target.parent / osp_name(ship), osp_description(variable_table(ship))
    if osp_file.exists() and not replace and osp_file.read_text(encoding="utf-8", errors="replace") != text:
        raise TargetExists(f"{osp_file}: describes another FMU; export to another folder, or add --force")
    files, messages = fmu_files(ship, version, platforms)
    write_archive(target, files)
    osp_file.write_text(text, encoding="utf-8", newline="\n")
    words = f"{osp_file.name}: groups of its variables for the Open Simulation Platform (docs/how-to/fmu.md)"
    return [*messages, Message(words, OSP_DESCRIPTION)]


def _token(ship: CoSimulatedShip, table: VariableTable, version: int, sources: dict[str, str]) -> str:
    """A token that two FMUs share only where they are the same: made of all that it stands for."""
    parts = [*sources.items(), (MODEL, model_header(ship, table, ""))]
    parts.append(("", description_2(ship, table, "", []) if version == 2 else description_3(ship, table, "")))
    digest = hashlib.sha256("\0".join(f"{name}\0{text}" for name, text in parts).encode()).hexdigest()
    return f"{{{uuid.UUID(digest[:32])}}}"


def _papers(ship: CoSimulatedShip, table: VariableTable) -> dict[str, bytes]:
    """Files of an FMU for people and for this program: a page, licences, the ship file, what is known of the ship."""
    header = (STANDARD / HEADERS[3][0]).read_text(encoding="utf-8")
    licence = header[header.index("Copyright (C)") : header.index("*/", header.index("Copyright (C)"))]
    files = {
        "documentation/index.html": fmu_page(ship, table),
        f"documentation/licenses/{LICENCE}": "The headers of the FMI standard in the folder sources:\n\n" + licence,
        "resources/ship.toml": dump_ship(ship.plain.ship, "The ship of this FMU."),
        "resources/product.json": json.dumps(plain(ship.plain.about()), indent=2, allow_nan=False) + "\n",
    }
    return {name: text.encode() for name, text in files.items()}
