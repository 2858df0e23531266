"""An import as a folder: canonical trial files, their sidecar, and the map that repeats it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cases.importing.import_logs import Imported
from cases.importing.import_map import NAME as MAP
from cases.importing.import_map import ImportMap, names_apart
from cases.io.files import filled
from cases.io.sidecar import NAME as SIDECAR
from cases.simulation.simulate import write_trial
from cases.trial import Trial


def write_import(found: Imported, chosen: ImportMap, folder: Path, force: bool = False) -> list[Path]:
    """Write the runs of ``found`` into ``folder``; returns the trial files.

    chosen: the map that was used; force: files of the same names in a folder that exists are replaced. The folder
    appears whole or not at all. Raises UserError where it holds something and ``force`` is false, and where it cannot
    be written.
    """
    names = [f"{run.name}.csv" for run in found.runs]
    with filled(folder, force) as scratch:
        for run, name in zip(found.runs, names, strict=True):
            write_trial(Trial(run.name, run.columns), scratch / name)
        (scratch / SIDECAR).write_text(_sidecar(found, chosen.inputs), encoding="utf-8")
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


def _sidecar(found: Imported, inputs: str) -> str:
    """The sidecar: what samples of the ``inputs`` are, the day of each run, what was derived from what and with
    which standard errors."""
    import tomlkit

    files: dict[str, dict[str, object]] = {}
    for run in found.runs:
        entry: dict[str, object] = {"day": run.day} if run.day else {}
        if run.std:
            entry["std"] = {name: float(f"{value:.3g}") for name, value in run.std.items()}
        if run.ancestors:
            entry["derived"] = {name: list(parts) for name, parts in run.ancestors.items()}
        if entry:
            files[f"{run.name}.csv"] = entry
    words = "# Written by mmg import; the files are canonical (SI, radians), what was done: import.toml\n"
    return words + tomlkit.dumps({"default": {"inputs": inputs}, "files": files})
