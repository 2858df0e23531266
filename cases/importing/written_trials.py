"""An import as a folder: canonical trial files, their sidecar, and the map that repeats it."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from pathlib import Path

from cases.importing.assembled_run import ImportedRun
from cases.importing.import_logs import Imported
from cases.importing.import_map import NAME as MAP
from cases.importing.import_map import ImportMap, names_apart
from cases.io.sidecar import NAME as SIDECAR
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import BadValue, NotWritable, TargetExists

KEYS = (
    "rudder_positive", "wind_direction", "velocity_frame", "inputs", "zone_hours", "sentinels", "separate", "step",
    "ignore",
)  # fmt: skip
"""Of the map, for all files."""


def write_import(found: Imported, chosen: ImportMap, folder: Path, force: bool = False) -> list[Path]:
    """Write the runs of ``found`` into ``folder``; returns the trial files.

    chosen: the map that was used; force: files of the same names in a folder that exists are replaced. The folder
    appears whole or not at all. Raises UserError where it holds something and ``force`` is false, and where it cannot
    be written.
    """
    if folder.exists() and not folder.is_dir():
        raise BadValue(f"--out {folder}: is a file; name a folder")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise TargetExists(f"--out {folder}: holds files already; choose another name or add --force")
    scratch = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.part")
    try:
        scratch.mkdir(parents=True)
        names = [f"{run.name}.csv" for run in found.runs]
        for run, name in zip(found.runs, names, strict=True):
            write_trial(Trial(run.name, run.columns), scratch / name)
        (scratch / SIDECAR).write_text(_sidecar(found, chosen.inputs), encoding="utf-8")
        (scratch / MAP).write_text(map_text(found, chosen), encoding="utf-8")
        if folder.is_dir():
            for path in scratch.iterdir():
                os.replace(path, folder / path.name)
        else:
            os.replace(scratch, folder)
    except OSError as error:
        raise NotWritable(f"--out {folder}: cannot be written ({error.strerror or error}); check the path") from None
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(scratch)
    return [folder / name for name in names]


def map_text(found: Imported, chosen: ImportMap) -> str:
    """The map, as TOML, that repeats an import without any question: every column of every file that was used.

    found: the import; chosen: the map that it began with.
    """
    import tomlkit

    document = tomlkit.document()
    document.add(tomlkit.comment("What mmg import did; mmg import FILE... --map import.toml --out DIR does it again."))
    for key in KEYS:
        value = getattr(chosen, key)
        if value is not None and value != ImportMap.model_fields[key].get_default(call_default_factory=True):
            document.add(key, value)
    if found.origin is not None:
        document.add("origin", list(found.origin))
    files = tomlkit.table(is_super_table=True)
    named = names_apart([*(log.table.path for run in found.runs for log in run.logs), *found.skipped])
    for run in found.runs:
        for log in run.logs:
            name = named[log.table.path]
            table = files.get(name) or tomlkit.table()
            own = chosen.of(log.table.path)
            for key in ("clock_offset", "clock_drift"):
                if key in own.model_fields_set:
                    table[key] = getattr(own, key)
            unused = [*own.ignore, *log.unsure]
            if unused:
                table["ignore"] = list(dict.fromkeys([*table.get("ignore", []), *unused]))
            if len(run.logs) > 1:
                table["run"] = run.name
            columns = table.get("columns") or tomlkit.table()
            for quantity, column in log.of.items():
                row = tomlkit.inline_table()
                row["from"] = column.header
                if column.unit:
                    row["unit"] = column.unit
                if column.sign == -1:
                    row["sign"] = -1
                columns[quantity] = row
            table["columns"] = columns
            files[name] = table
    for path in found.skipped:
        files[named[path]] = tomlkit.table()
        files[named[path]]["skip"] = True
    document.add("files", files)
    return tomlkit.dumps(document)


def _sidecar(found: Imported, inputs: str) -> str:
    """The sidecar: what samples of the ``inputs`` are, the day of each run, and the standard errors of what was
    derived."""
    import tomlkit

    document = tomlkit.document()
    document.add(
        tomlkit.comment("Written by mmg import; the files are canonical (SI, radians), what was done: import.toml")
    )
    default = tomlkit.table()
    default["inputs"] = inputs
    document.add("default", default)
    files = tomlkit.table(is_super_table=True)
    for run in found.runs:
        entry = _entry(run)
        if entry:
            table = tomlkit.table()
            for key, value in entry.items():
                table[key] = value
            files[f"{run.name}.csv"] = table
    document.add("files", files)
    return tomlkit.dumps(document)


def _entry(run: ImportedRun) -> dict[str, object]:
    import tomlkit

    entry: dict[str, object] = {"day": run.day} if run.day else {}
    if run.std:
        row = tomlkit.inline_table()
        for name, value in run.std.items():
            row[name] = float(f"{value:.3g}")
        entry["std"] = row
    return entry
