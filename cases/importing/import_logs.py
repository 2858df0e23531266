"""Raw logs to canonical trials: read all, join, convert, and write trial files, their sidecar, and the map that repeats
the import. All that is wrong is said at once; nothing is half-written."""

from __future__ import annotations

import itertools
import json
import re
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.array_files import MATLAB, is_hdf5, read_arrays
from cases.importing.assembled_run import CONVENTIONS, ImportedRun, assembled, globe_positions, with_units_of_size
from cases.importing.import_map import NAME as MAP
from cases.importing.import_map import POINT, ImportMap, OpenQuestion, Question, names_apart
from cases.importing.log_columns import Log, either, log_of
from cases.importing.message_logs import reader_of, with_local_ids
from cases.importing.raw_table import RawTable, split_unit
from cases.importing.robot_bags import MAGIC, bag_of, read_bag
from cases.importing.series import pivoted
from cases.importing.table_files import LARGEST_LOG, read_excel_tables, read_parquet, read_text_log
from cases.io.files import LARGEST, check_file, decoded, filled, opened, read_bytes
from cases.io.sidecar import NAME as SIDECAR
from cases.io.sidecar import ReferencePoint, read_sidecar
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import BadValue, Conflict, Missing, TooFewData, UserError
from mmg.messages import has_code

# Bytes by which the format of a file is known. Set by hand: more than the preamble of any format that is read.
BEGIN = 65536
JSON = (".json", ".jsonl", ".ndjson")
BAGS = (".bag", ".db3", ".mcap")
ARRAYS = (".mat", ".h5", ".hdf5", ".nc")
BINARY = (".xlsx", ".xlsm", ".xls", ".parquet", *BAGS, *ARRAYS)
TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".nmea", ".n2k")
# Files of a folder that are logs; of JSON those whose content is one. An old .xls is refused only where it is named.
SUFFIXES = (*TEXT, *JSON, *(suffix for suffix in BINARY if suffix != ".xls"))


@dataclass(frozen=True)
class Imported:
    """runs: as they can be written; problems: of files and runs that cannot, one line each; origin: latitude and
    longitude [deg] of the local frame, or None; questions: that the logs leave open; skipped: files that were not
    read, by the map; names: of all files, as the map calls them."""

    runs: tuple[ImportedRun, ...]
    problems: tuple[str, ...]
    origin: tuple[float, float] | None
    questions: tuple[Question, ...] = ()
    skipped: tuple[Path, ...] = ()
    names: Mapping[Path, str] = field(default_factory=dict)


def import_logs(
    paths: Iterable[Path], chosen: ImportMap | None = None, each: Callable[[Sequence[Path]], Iterable[Path]] = iter
) -> Imported:
    """The runs in the logs at ``paths`` (files, or folders of them), by the map ``chosen``. each: goes through the
    files, for a display. Raises UserError where there is no file at all."""
    chosen = chosen or ImportMap()
    all_files = [file for path in paths for file in _files_of(Path(path))]
    files = [file for file in all_files if not chosen.of(file).skip]
    if not files:
        raise Missing("no logs given")
    logs: list[Log] = []
    problems: list[str] = []
    questions: list[Question] = []

    def refused(error: UserError) -> None:
        problems.append(str(error))
        questions.extend([error.question] if isinstance(error, OpenQuestion) else [])

    for file in each(list(dict.fromkeys(files))):  # each once, also a bag of which several parts are given
        try:
            logs += [log_of(table, chosen) for table in _tables(file, chosen)]
        except UserError as error:
            refused(error)
    ends = {f"/{f.as_posix().lstrip('/')}" for f in all_files}
    unknown = [n for n in chosen.files if not any(e.endswith((f"/{n}", f"/{n}{Path(e).suffix}")) for e in ends)]
    problems += [f'the map: [files."{name}"] names none of the files' for name in unknown]
    headers = {header for log in logs for header in log.table.headers}
    for quantity, column in () if problems else chosen.columns.items():  # a file that is not read may have the header
        if not {column.header, split_unit(column.header)[0]} & headers:
            problems.append(f"the map: {quantity} is from '{column.header}', which is in none of the files")
    ships = {log.ship: log.table.path.name for log in logs if log.ship}
    if len(ships) > 1:
        named = ", ".join(f"{ship} ({file})" for ship, file in sorted(ships.items())[:4])
        problems.append(f"files of different ships: {named}; import each ship alone")
    if chosen.zone_hours is not None and logs and all(log.zoned for log in logs):
        words = f"zone_hours = {chosen.zone_hours:g} is for stamps without a time zone, and these have one"
        problems.append(f"{logs[0].name}: {words}; leave it out")
    origin = _origin(logs, chosen)  # one for all runs, so that their tracks lie in one frame
    runs: list[ImportedRun] = []
    for group in grouped(logs, chosen):
        try:
            runs.append(assembled(_run_name(group, chosen), group, chosen, origin))
        except UserError as error:
            refused(error)
            problems[-1] += _not_joined(group, logs) if isinstance(error, Missing) else ""
    questions += [question for log in logs for question in _questions(with_units_of_size(log))]
    if chosen.reference_point is None and any(has_code(run.notices, "reference_point_unknown") for run in runs):
        words = "where was the position measured, in m from midship: forward and to starboard, such as 12.0 0.0?"
        questions.append(Question(Path(), words, {POINT: {}, "unknown": {"reference_point": "unknown"}}))
    skipped, said = tuple(file for file in all_files if file not in files), tuple(dict.fromkeys(problems))
    return Imported(_with_own_names(runs), said, origin, tuple(questions), skipped, names_apart(all_files))


def _questions(log: Log) -> list[Question]:
    """What the headers of ``log`` leave open, though a run can be made without it."""
    questions = [Question(log.table.path, *either(header, may_be)) for header, may_be in log.unsure.items()]
    return questions + [log.unit_question(q) for q in log.unitless if q not in ("r", "sog", "u")]  # others show those


def _files_of(path: Path) -> list[Path]:
    """The logs of a folder, also of those in it; a file itself."""
    if not path.is_dir():
        return [bag_of(path)]
    files = sorted(p for p in path.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file() and p.name != SIDECAR)
    files = list(dict.fromkeys(bag_of(p) for p in files if p.suffix.lower() not in JSON or reader_of(_begin(p))))
    if not files:
        raise Missing(f"{path}: no logs in this folder ({', '.join(SUFFIXES)})")
    return files


def _begin(path: Path) -> bytes:
    with opened(path) as stream:
        return stream.read(BEGIN)


def _tables(file: Path, chosen: ImportMap) -> list[RawTable]:
    """The tables of a ``file``, whose kind its content tells, or, where none does, its name."""
    suffix, decimal = file.suffix.lower(), chosen.of(file).decimal or chosen.decimal
    check_file(file, LARGEST if suffix in BINARY and suffix not in BAGS else LARGEST_LOG)  # of bags topics are read
    if not file.stat().st_size:
        raise TooFewData(f"{file}: the file is empty")
    begin = _begin(file)
    # Binary formats come first: their first bytes are no accident, while lines of messages are told by a majority.
    if suffix in BAGS or begin.startswith(MAGIC):
        return [read_bag(file, chosen)]
    if suffix in ARRAYS or begin.startswith(MATLAB) or is_hdf5(begin):
        return read_arrays(file, chosen)
    if read := reader_of(begin, is_json=suffix in JSON):
        return [read(file, chosen)]
    if suffix == ".xls":
        raise BadValue(f"{file}: an old Excel file; save it as .xlsx or CSV")
    if suffix in (".xlsx", ".xlsm"):
        tables = read_excel_tables(file)
    else:
        tables = [read_parquet(file) if suffix == ".parquet" else read_text_log(file, decimal)]
    return [with_local_ids(pivoted(table, chosen)) for table in tables]


def _origin(logs: Sequence[Log], chosen: ImportMap) -> tuple[float, float] | None:
    """The origin of the map, or the first position of all logs, to a ten-thousandth of a degree."""
    if chosen.origin:
        return float(chosen.origin[0]), float(chosen.origin[1])
    for log in logs:
        if {"latitude", "longitude"} <= set(log.columns):
            place = log.columns["latitude"], log.columns["longitude"]
        elif log.zone and {"x", "y"} <= set(log.columns):
            try:
                place = globe_positions(log.columns["x"], log.columns["y"], log.zone, log.name)
            except UserError:  # of the zone, which the run of this log is refused for
                continue
        else:
            continue
        good = np.flatnonzero(np.isfinite(place[0]) & np.isfinite(place[1]))
        if len(good):
            return round(float(place[0][good[0]]), 4), round(float(place[1][good[0]]), 4)  # 4 digits: 11 m
    return None


def _with_own_names(runs: Sequence[ImportedRun]) -> tuple[ImportedRun, ...]:
    """Runs of the same name get that of their folder before it, or a number behind it."""
    out: list[ImportedRun] = []
    for i, run in enumerate(runs):
        folders = [other.logs[0].table.path.parent.name for other in runs if other.name == run.name]
        if len(folders) > 1:
            number = sum(other.name == run.name for other in runs[: i + 1])
            apart = len(set(folders)) == len(folders)
            run = replace(run, name=f"{folders[number - 1]}_{run.name}" if apart else f"{run.name}_{number}")
        out.append(run)
    return tuple(out)


OVERLAP = 0.5  # Least share of the shorter of two logs in which both run. Set by hand.
MOTION = {"x", "latitude", "sog", "u"}  # Each of them tells, with a heading, how the ship moves
ACTUATORS = {"n", "n_2", "n_bow", "n_stern", "n_azimuth", "delta"}


def grouped(logs: Sequence[Log], chosen: ImportMap) -> list[list[Log]]:
    """The ``logs`` of each run, in the order of their first files. chosen: the map. Logs of one run are those with the
    same ``run`` in it. Others are joined where they lie in one folder, their clocks are absolute and overlap, and one
    that is not complete by itself adds what the others lack."""
    runs: list[list[Log]] = []
    for log in logs:
        name = chosen.of(log.table.path).run
        alike = [run for run in runs if chosen.of(run[0].table.path).run == name]
        group = next((run for run in alike if name or (not chosen.separate and _completes(log, run))), None)
        if group is None:
            runs.append([log])
        else:
            group.append(log)
    return runs


def _complete(quantities: set[str]) -> bool:
    """Whether a run can be made of these ``quantities``: heading, motion and an actuator."""
    return "psi" in quantities and not quantities.isdisjoint(MOTION) and not quantities.isdisjoint(ACTUATORS)


def _run_name(run: Sequence[Log], chosen: ImportMap) -> str:
    """The map's, the stem of its file, or what the stems of its files have in common."""
    stems = [log.table.path.stem for log in run]
    if named := chosen.of(run[0].table.path).run:
        return named
    if len(set(stems)) == 1:
        sheet = re.search(r"(?:sheet|group) '(.*)'$", run[0].name)
        return f"{stems[0]}_{sheet[1]}" if sheet and len(run) == 1 else stems[0]
    same = itertools.takewhile(lambda letters: len(set(letters)) == 1, zip(*stems, strict=False))
    return "".join(letters[0] for letters in same).rstrip("_- .") or stems[0]


def _completes(log: Log, run: Sequence[Log]) -> bool:
    """Whether ``log`` completes the logs of a ``run``, at the same time."""
    if not log.absolute or not all(other.absolute for other in run):
        return False
    if log.table.path.parent != run[0].table.path.parent:
        return False
    quantities, theirs = set(log.columns), set().union(*(other.columns for other in run))
    # A log that is complete is a run; one that says what a complete run holds already is another ship or sensor.
    if _complete(quantities) or not quantities - theirs or (_complete(theirs) and quantities & theirs):
        return False
    begin, end = max(other.t[0] for other in run), min(other.t[-1] for other in run)
    common = min(end, log.t[-1]) - max(begin, log.t[0])
    return bool(common > OVERLAP * min(end - begin, log.t[-1] - log.t[0]))


def _not_joined(run: Sequence[Log], logs: Sequence[Log]) -> str:
    """Why another of the ``logs`` that lies beside those of a ``run`` and holds what it lacks is not joined with it; ""
    where there is none."""
    theirs, folder = set().union(*(log.columns for log in run)), run[0].table.path.parent
    more = (log for log in logs if log.table.path.parent == folder and not _complete(set(log.columns)))
    log = next((log for log in more if set(log.columns) - theirs), None)
    if log is None:
        return ""
    words = "a clock of both has no date: say the same run = ... of both in the map"
    if log.absolute and run[0].absolute:
        off = run[0].t[0] - log.t[0]
        words = (
            f"it begins {off:.6g} s before: where the clocks have different zones, say clock_offset = {off:.6g} of it"
        )
    return f"; not joined with {log.table.path.name}, as {words}"


def write_import(imported: Imported, chosen: ImportMap, folder: Path, force: bool = False) -> list[Path]:
    """Write the runs of ``imported`` into ``folder``; returns the trial files.

    chosen: the map that was used; force: files of the same names in a folder that exists are replaced, of its sidecar
    what an import wrote. The folder appears whole or not at all. Raises UserError where it holds something and
    ``force`` is false, where it cannot be written, and as ``sidecar_text`` does.
    """
    names = [f"{run.name}.csv" for run in imported.runs]
    sidecar = sidecar_text(imported, chosen, folder)  # before anything is written: it may be refused
    with filled(folder, force) as scratch:
        for run, name in zip(imported.runs, names, strict=True):
            write_trial(Trial(run.name, run.columns), scratch / name)
        (scratch / SIDECAR).write_text(sidecar, encoding="utf-8")
        (scratch / MAP).write_text(map_text(imported, chosen), encoding="utf-8")
    return [folder / name for name in names]


def map_text(imported: Imported, chosen: ImportMap) -> str:
    """The map, as TOML, that repeats an import without any question: every column of every file that was used.
    imported: the import; chosen: the map that it began with."""
    import tomlkit

    document = chosen.model_dump(exclude_defaults=True, exclude={"columns", "origin", "files"})
    if imported.origin is not None:  # said, so that an import of a part of the files has the same frame
        document["origin"] = list(imported.origin)
    files: dict[str, dict[str, Any]] = {}
    named = names_apart([*(log.table.path for run in imported.runs for log in run.logs), *imported.skipped])
    for run, log in [(one, log) for one in imported.runs for log in one.logs]:
        table, of_file = files.setdefault(named[log.table.path], {}), chosen.of(log.table.path)
        table |= of_file.model_dump(exclude_unset=True, include={"clock_offset", "clock_drift", "rows", "decimal"})
        if unused := [*of_file.ignore, *log.unsure]:
            table["ignore"] = list(dict.fromkeys([*table.get("ignore", []), *unused]))  # sheets share a file's entry
        if len(run.logs) > 1:
            table["run"] = run.name
        for quantity, column in log.of.items():
            row = tomlkit.inline_table()
            row.update({"from": column.header} | ({"unit": column.unit} if column.unit else {}))
            row.update({"sign": -1} if column.sign == -1 else {})
            table.setdefault("columns", {})[quantity] = row
    files |= {named[path]: {"skip": True} for path in imported.skipped}
    words = "# What mmg import did; mmg import FILE... --map import.toml --out DIR does it again.\n"
    account = [f"# {log.table.path.name}: {row}\n" for run in imported.runs for log in run.logs for row in log.accounts]
    return words + "".join(dict.fromkeys(account)) + tomlkit.dumps({**document, "files": files})


def sidecar_text(imported: Imported, chosen: ImportMap, folder: Path) -> str:
    """The sidecar of the runs ``imported``: what samples of actuators are, the day of each, what was derived from what
    and with which standard errors. What a person wrote into the one that ``folder`` has stays.

    chosen: the map. What is written here carries a mark with a checksum of its value: only that is replaced. Raises
    UserError for a sidecar that is wrong, and where it and the map both say how to turn or move columns.
    """
    import tomlkit

    path = folder / SIDECAR
    document = tomlkit.document()
    document.add(tomlkit.comment("Written by mmg import: --force replaces the lines that bear its mark, no others."))
    if path.exists():
        read_sidecar(path)  # a wrong one is refused, not overwritten
        document = tomlkit.parse(decoded(read_bytes(path), path))
    every = document["all"] if "all" in document else document.setdefault("default", tomlkit.table())
    files = document.setdefault("files", tomlkit.table(is_super_table=True))
    names = {f"{run.name}.csv": run for run in imported.runs}
    for name in list(files):
        exists = any((folder / f"{name}{suffix}").is_file() for suffix in ("", ".csv", ".parquet"))
        if not exists and name not in names and f"{name}.csv" not in names:
            del files[name]
    point = chosen.reference_point if isinstance(chosen.reference_point, ReferencePoint) else None
    at_midship = {"reference_point": {"x": 0.0, "y": 0.0}} if point else {}  # the columns are moved there already
    _replace(every, {"inputs": chosen.inputs, **at_midship})
    for name, run in names.items():
        key = run.name if run.name in files else name
        std = {column: float(f"{value:.3g}") for column, value in run.std.items()}
        derived = {column: list(parts) for column, parts in run.ancestors.items()}
        said = {"day": run.day, "std": std, "derived": derived}
        _replace(files.setdefault(key, tomlkit.table()), {key: value for key, value in said.items() if value})
    turned = [key for key in (*CONVENTIONS, "reference_point") if key in chosen.model_fields_set]
    for key in turned if point or chosen.reference_point is None else set(turned) - {"reference_point"}:
        if any(key in table and not _marked(table, key) for table in (every, *(files[name] for name in files))):
            raise Conflict(f"{path}: {key} is said here and in the map, and would be applied twice; keep one of them")
    return tomlkit.dumps(document)


def _mark(value: Any) -> str:
    """Stands behind a line that an import wrote; its checksum tells whether a person changed the value since."""
    return f"# mmg import {zlib.crc32(json.dumps(value).encode()):08x}"


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
            if isinstance(value, dict):  # on one line, which can bear a mark
                item = tomlkit.inline_table()
                item.update(value)
            table[key] = item.comment(_mark(value)[2:])
