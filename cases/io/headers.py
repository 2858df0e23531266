"""Which column of a file is which quantity, and in which unit: canonical, FRT-DS-ESSO and mapped headers."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

from cases.io.sidecar import NAME, SidecarEntry, line_for
from cases.io.units import accepted
from cases.quantities import is_canonical
from mmg.errors import Conflict, Missing
from mmg.messages import Message
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS

FRT_NAMES = {
    "x_position_mid": "x",
    "y_position_mid": "y",
    "psi_hat": "psi",
    "u_velo": "u",
    "vm_velo": "v",
    "r_angvelo": "r",
    "n_prop": "n",
    "delta_rudder": "delta",
    "wind_velo_true": "wind_speed",
    "wind_dir_true": "wind_direction",
    "wind_velo_relative_mid": "apparent_wind_speed",
    "wind_dir_relative_mid": "apparent_wind_direction",
}
"""Header names of the FRT-DS-ESSO records -> canonical names (data set README, "Measurement items")."""

REQUIRED = ("t", "psi", "u", "v", "r", "n")
THRUSTERS = tuple(name for name, (_, unit) in INPUTS.items() if unit == "rps" and name not in PROPELLERS)
"""Columns that make a craft without propeller and rudder: it then needs neither n nor delta."""
MOST_SHOWN = 40
"""Most headers that a message lists."""


def match_headers(
    path: Path, header: list[str], entry: SidecarEntry, notices: list[Message]
) -> dict[str, tuple[int, str]]:
    """Canonical name -> (column index, unit) for every column of a file that is known.

    path: of the file, for messages; header: its cells; entry: what the sidecar says of it; notices: what was mapped
    or ignored is added. Raises UserError for a mapped header that is absent, two headers for one quantity, a missing
    unit or required column, and a sign of a column that the file lacks.
    """
    parts = [split_header(cell) for cell in header]
    taken: dict[str, tuple[int, str]] = {}
    for name, wanted in entry.columns.items():
        index = _find(path, wanted, header, parts)
        taken[name] = (index, parts[index][1])
        notices.append(Message(f"{name} is read from '{header[index]}' (sidecar)", "column_mapped"))
    mapped = {index for index, _ in taken.values()}
    ignored = []
    for index, (name, unit) in enumerate(parts):
        canonical = FRT_NAMES.get(name, name)
        if index in mapped:
            continue
        if not is_canonical(canonical) or canonical in entry.columns:
            ignored.append(header[index])
        elif canonical in taken:
            other = header[taken[canonical][0]]
            line = line_for(path, "", f'columns = {{ {canonical} = "{other}" }}')
            raise Conflict(f"{path}: both '{other}' and '{header[index]}' are {canonical}; say which: add to {line}")
        else:
            taken[canonical] = (index, unit)
    if any(ignored):
        notices.append(Message(f"columns not used: {', '.join(filter(None, ignored))}", "columns_ignored"))
    _require(path, header, taken)
    unsigned = [name for name in entry.sign if name not in taken]
    if unsigned:
        raise Missing(f"{path}: sign.{unsigned[0]} in {path.parent / NAME}: the file has no column {unsigned[0]}")
    return {name: (index, _unit(path, name, header[index], unit, entry, notices))
            for name, (index, unit) in taken.items()}  # fmt: skip


def split_header(cell: str) -> tuple[str, str]:
    """("u", "m/s") of "u [m/s]"; the unit is "" when the cell has none."""
    match = re.fullmatch(r"\s*(.*?)\s*\[([^\]]*)\]\s*", cell)
    return (match[1], match[2].strip()) if match else (cell.strip(), "")


def _find(path: Path, wanted: str, header: list[str], parts: list[tuple[str, str]]) -> int:
    """Index of the column a sidecar asks for by its whole header cell or by its name without the unit."""
    hits = [i for i, cell in enumerate(header) if cell == wanted.strip()]
    hits = hits or [i for i, (name, _) in enumerate(parts) if name == wanted.strip()]
    if len(hits) != 1:
        problem = "is not in the file" if not hits else "fits several columns"
        raise Missing(
            f"{path}: column '{wanted}' named in the sidecar {problem}; headers: {', '.join(header[:MOST_SHOWN])}"
        )
    return hits[0]


def _unit(path: Path, name: str, cell: str, unit: str, entry: SidecarEntry, notices: list[Message]) -> str:
    """The unit of a column: the sidecar's, else the header's. Raises UserError when neither says."""
    given = entry.units.get(name)
    if given is not None:
        if unit and unit != given:
            text = f"{name}: unit {given} from the sidecar used instead of {unit} in the header"
            notices.append(Message(text, "unit_overridden"))
        return given
    if not unit:
        units = accepted(name)
        line = f'units = {{ {name} = "{units[0]}" }}'
        raise Missing(
            f"{path}: column '{cell}' has no unit; write '{cell} [{units[0]}]' "
            f"(accepted: {', '.join(units)}), or add to {line_for(path, '', line)}"
        )
    return unit


def lacking(columns: Collection[str]) -> list[str]:
    """Required columns that are not among the canonical ``columns`` of a trial."""
    without = bool({*THRUSTERS} & {*columns}) and not {"n", *RUDDERS} & {*columns}
    missing = [name for name in REQUIRED if name not in columns and not (without and name == "n")]
    twins = [c for c in ("delta_port", "delta_starboard") if c not in columns]
    if twins and "delta" not in columns and not without:
        missing += ["delta"] if len(twins) == 2 else twins
    return missing


def _require(path: Path, header: list[str], taken: dict[str, tuple[int, str]]) -> None:
    """Raises UserError naming the required columns that are missing and how to map them."""
    if missing := lacking(taken):
        units = f"{missing[0]} [{accepted(missing[0])[0]}]"
        line = f'columns = {{ {missing[0]} = "HEADER" }}'
        raise Missing(
            f"{path}: missing column {', '.join(missing)}; found: {', '.join(header[:MOST_SHOWN])}. Name it '{units}', "
            f"or map it: add to {line_for(path, '', line)}"
        )
