"""An import as a folder: canonical trial files, their sidecar, and the map that repeats it."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

from cases.importing.assembled_run import CONVENTIONS, ImportedRun
from cases.importing.import_logs import Imported
from cases.importing.import_map import NAME as MAP
from cases.importing.import_map import ImportMap, names_apart
from cases.io.files import decoded, filled, read_bytes
from cases.io.sidecar import NAME as SIDECAR
from cases.io.sidecar import ReferencePoint, read_sidecar
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import Conflict


def write_import(found: Imported, chosen: ImportMap, folder: Path, force: bool = False) -> list[Path]:
    """Write the runs of ``found`` into ``folder``; returns the trial files.

    chosen: the map that was used; force: files of the same names in a folder that exists are replaced, of its sidecar
    what an import wrote. The folder appears whole or not at all. Raises UserError where it holds something and
    ``force`` is false, where it cannot be written, and as ``sidecar_text`` does.
    """
    names = [f"{run.name}.csv" for run in found.runs]
    sidecar = sidecar_text(found, chosen, folder)
    with filled(folder, force) as scratch:
        for run, name in zip(found.runs, names, strict=True):
            write_trial(Trial(run.name, run.columns), scratch / name)
        (scratch / SIDECAR).write_text(sidecar, encoding="utf-8")
        (scratch / MAP).write_text(map_text(found, chosen), encoding="utf-8")
    return [folder / name for name in names]


def map_text(found: Imported, chosen: ImportMap) -> str:
    """The map, as TOML, that repeats an import without any question: every column of every file that was used.

    found: the import; chosen: the map that it began with.
    """
    import tomlkit

    document = chosen.model_dump(exclude_defaults=True, exclude={"columns", "origin", "files"})
    if found.origin is not None:
        document["origin"] = list(found.origin)
    files: dict[str, dict[str, Any]] = {}
    named = names_apart([*(log.table.path for run in found.runs for log in run.logs), *found.skipped])
    for run, log in [(one, log) for one in found.runs for log in one.logs]:
        table, own = files.setdefault(named[log.table.path], {}), chosen.of(log.table.path)
        table |= own.model_dump(exclude_unset=True, include={"clock_offset", "clock_drift", "rows", "decimal"})
        if unused := [*own.ignore, *log.unsure]:
            table["ignore"] = list(dict.fromkeys([*table.get("ignore", []), *unused]))
        if len(run.logs) > 1:
            table["run"] = run.name
        for quantity, column in log.of.items():
            row = tomlkit.inline_table()
            row.update({"from": column.header} | ({"unit": column.unit} if column.unit else {}))
            row.update({"sign": -1} if column.sign == -1 else {})
            table.setdefault("columns", {})[quantity] = row
    files |= {named[path]: {"skip": True} for path in found.skipped}
    words = "# What mmg import did; mmg import FILE... --map import.toml --out DIR does it again.\n"
    account = [f"# {log.table.path.name}: {row}\n" for run in found.runs for log in run.logs for row in log.accounts]
    return words + "".join(dict.fromkeys(account)) + tomlkit.dumps({**document, "files": files})


def sidecar_text(found: Imported, chosen: ImportMap, folder: Path) -> str:
    """The sidecar of the runs ``found``: what samples of actuators are, the day of each, what was derived from what and
    with which standard errors. What a person wrote into the one that ``folder`` has stays.

    chosen: the map. What is written here carries a MARK with a checksum of its value: only that is replaced. Raises
    UserError for a sidecar that is wrong, and where it and the map both say how to turn or move columns.
    """
    import tomlkit

    path = folder / SIDECAR
    document = tomlkit.document()
    document.add(tomlkit.comment("Written by mmg import: --force replaces the lines that bear its mark, no others."))
    if path.exists():
        read_sidecar(path)
        document = tomlkit.parse(decoded(read_bytes(path), path))
    every = document["all"] if "all" in document else document.setdefault("default", tomlkit.table())
    files = document.setdefault("files", tomlkit.table(is_super_table=True))
    names = {f"{run.name}.csv": run for run in found.runs}
    for name in list(files):
        there = any((folder / f"{name}{suffix}").is_file() for suffix in ("", ".csv", ".parquet"))
        if not there and name not in names and f"{name}.csv" not in names:
            del files[name]
    point = chosen.reference_point if isinstance(chosen.reference_point, ReferencePoint) else None
    at_midship = {"reference_point": {"x": 0.0, "y": 0.0}} if point else {}
    _replace(every, {"inputs": chosen.inputs, **at_midship})
    for name, run in names.items():
        key = run.name if run.name in files else name
        _replace(files.setdefault(key, tomlkit.table()), _entry(run))
    turned = [key for key in (*CONVENTIONS, "reference_point") if key in chosen.model_fields_set]
    for key in turned if point or chosen.reference_point is None else set(turned) - {"reference_point"}:
        if any(key in table and not _marked(table, key) for table in (every, *(files[name] for name in files))):
            raise Conflict(f"{path}: {key} is said here and in the map, and would be applied twice; keep one of them")
    return tomlkit.dumps(document)


def _entry(run: ImportedRun) -> dict[str, Any]:
    """What the sidecar says of a ``run``."""
    std = {name: float(f"{value:.3g}") for name, value in run.std.items()}
    derived = {name: list(parts) for name, parts in run.ancestors.items()}
    return {key: value for key, value in {"day": run.day, "std": std, "derived": derived}.items() if value}


MARK = "mmg import"
"""Of a line of the sidecar that an import wrote, before the checksum of its value."""


def _mark(value: Any) -> str:
    return f"# {MARK} {zlib.crc32(json.dumps(value).encode()):08x}"


def _marked(table: Any, key: str) -> bool:
    """Whether an import wrote the ``key`` of a ``table``, and nobody changed it since."""
    trivia = getattr(table[key], "trivia", None)  # tomlkit gives true and false without theirs
    return trivia is not None and bool(trivia.comment == _mark(table[key].unwrap()))


def _replace(table: Any, values: dict[str, Any]) -> None:
    """Put the ``values`` into a ``table`` in place of what an import wrote; what a person wrote stays."""
    import tomlkit

    ours = [key for key in table if _marked(table, key)]
    for key in ours:
        if key not in values:
            del table[key]
    for key, value in values.items():
        if key in ours or key not in table:
            item = tomlkit.item(value)
            if isinstance(value, dict):
                item = tomlkit.inline_table()
                item.update(value)
            table[key] = item.comment(_mark(value)[2:])
