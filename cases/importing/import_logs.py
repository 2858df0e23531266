"""Raw logs to canonical trials: read all, join, convert; all that is wrong is said at once, nothing is half-written."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.array_files import is_hdf5, is_matlab, read_arrays
from cases.importing.assembled_run import ImportedRun, assembled, with_units_of_size
from cases.importing.import_map import POINT, ImportMap, OpenQuestion, Question, names_apart
from cases.importing.json_logs import is_iso19848, is_signal_k, read_iso19848, read_signal_k, with_local_ids
from cases.importing.log_columns import Log, log_of
from cases.importing.long_table import pivoted
from cases.importing.nmea2000_log import is_nmea2000, read_nmea2000
from cases.importing.nmea_log import is_nmea, read_nmea
from cases.importing.raw_table import RawTable
from cases.importing.robot_bags import MAGIC, bag_of, read_bag
from cases.importing.table_files import LARGEST_LOG, read_excel_tables, read_parquet, read_text_log
from cases.io.files import LARGEST, check_file, opened
from cases.io.sidecar import NAME as SIDECAR
from mmg.errors import BadValue, Missing, TooFewData, UserError
from mmg.messages import has_code

BEGIN = 65536
"""Bytes by which the format of a file is known."""
JSON = (".json", ".jsonl", ".ndjson")
BAGS = (".bag", ".db3", ".mcap")
ARRAYS = (".mat", ".h5", ".hdf5", ".nc")
BINARY = (".xlsx", ".xlsm", ".xls", ".parquet", *BAGS, *ARRAYS)
SUFFIXES = (
    ".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".nmea", ".n2k", *JSON,
    *(suffix for suffix in BINARY if suffix != ".xls"),
)  # fmt: skip
"""Files of a folder that are logs; of JSON those whose content is one."""


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
    """The runs in the logs at ``paths`` (files, or folders of them), by the map ``chosen``.

    each: goes through the files, for a display. Raises UserError where there is no file at all.
    """
    chosen = chosen or ImportMap()
    all_files = [file for path in paths for file in _files_of(Path(path))]
    files = [file for file in all_files if not chosen.of(file).skip]
    if not files:
        raise Missing("no logs given")
    logs: list[Log] = []
    problems: list[str] = []
    asked: list[Question] = []
    for file in each(list(dict.fromkeys(files))):
        try:
            logs += [log_of(table, chosen) for table in _tables(file, chosen)]
        except UserError as error:
            problems.append(str(error))
            asked += [error.question] if isinstance(error, OpenQuestion) else []
    ends = {f"/{f.as_posix().lstrip('/')}" for f in all_files}
    unknown = [n for n in chosen.files if not any(e.endswith((f"/{n}", f"/{n}{Path(e).suffix}")) for e in ends)]
    problems += [f'the map: [files."{name}"] names none of the files' for name in unknown]
    problems += _several_ships(logs)
    if chosen.zone_hours is not None and logs and all(log.zoned for log in logs):
        words = f"zone_hours = {chosen.zone_hours:g} is for stamps without a time zone, and these have one"
        problems.append(f"{logs[0].name}: {words}; leave it out")
    origin = _origin(logs, chosen)
    runs: list[ImportedRun] = []
    for group in grouped(logs, chosen):
        try:
            runs.append(assembled(run_name(group, chosen), group, chosen, origin))
        except UserError as error:
            problems.append(str(error))
            asked += [error.question] if isinstance(error, OpenQuestion) else []
    asked += [question for log in logs for question in _questions(with_units_of_size(log))]
    if chosen.reference_point is None and any(has_code(run.notices, "reference_point_unknown") for run in runs):
        words = "where was the position measured, in m from midship: forward and to starboard, such as 12.0 0.0?"
        asked.append(Question(Path(), words, {POINT: {}, "unknown": {"reference_point": "unknown"}}))
    skipped = tuple(file for file in all_files if file not in files)
    return Imported(
        tuple(_with_own_names(runs)),
        tuple(dict.fromkeys(problems)),
        origin,
        tuple(asked),
        skipped,
        names_apart(all_files),
    )


def _questions(log: Log) -> list[Question]:
    """What the headers of ``log`` leave open, though a run can be made without it."""
    found = []
    for header, may_be in log.unsure.items():
        names = [word for word in re.split(r" or |\s*\([^)]*\)", may_be) if word and word != "nothing"]
        choices: dict[str, dict[str, Any]] = {name: {"columns": {name: {"from": header}}} for name in names}
        choices["nothing"] = {"ignore": [header]}
        found.append(Question(log.table.path, f"'{header}' may be {may_be}", choices))
    for quantity in log.unitless:
        if quantity in ("r", "sog", "u"):  # other columns show it
            continue
        found.append(log.unit_question(quantity))
    return found


def _files_of(path: Path) -> list[Path]:
    """The logs of a folder, also of those in it; a file itself."""
    if not path.is_dir():
        return [bag_of(path)]
    found = sorted(p for p in path.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file() and p.name != SIDECAR)
    found = list(dict.fromkeys(bag_of(p) for p in found if p.suffix.lower() not in JSON or _is_log(p)))
    if not found:
        raise Missing(f"{path}: no logs in this folder ({', '.join(SUFFIXES)})")
    return found


def _is_log(path: Path) -> bool:
    """Whether a file of JSON is a log of one of the formats that are read."""
    with opened(path) as stream:
        begin = stream.read(BEGIN)
    return is_signal_k(begin) or is_iso19848(begin) or is_nmea2000(begin)


def _tables(file: Path, chosen: ImportMap) -> list[RawTable]:
    """The tables of a ``file``, whose kind its content tells, or, where none does, its name."""
    suffix = file.suffix.lower()
    check_file(file, LARGEST if suffix in BINARY and suffix not in BAGS else LARGEST_LOG)  # of bags topics are read
    if not file.stat().st_size:
        raise TooFewData(f"{file}: the file is empty")
    with opened(file) as stream:
        begin = stream.read(BEGIN)
    if suffix in BAGS or begin.startswith(MAGIC):
        return [read_bag(file, chosen)]
    if suffix in ARRAYS or is_matlab(begin) or is_hdf5(begin):
        return read_arrays(file, chosen)
    if is_nmea2000(begin):
        return [read_nmea2000(file, chosen)]
    if is_nmea(begin):
        return [read_nmea(file, chosen)]
    if is_iso19848(begin):
        return [read_iso19848(file, chosen)]
    if is_signal_k(begin) or suffix in JSON:
        return [read_signal_k(file, chosen)]
    if suffix in (".xlsx", ".xlsm"):
        tables = read_excel_tables(file)
    elif suffix == ".xls":
        raise BadValue(f"{file}: an old Excel file; save it as .xlsx or CSV")
    else:
        decimal = chosen.of(file).decimal or chosen.decimal
        tables = [read_parquet(file) if suffix == ".parquet" else read_text_log(file, decimal)]
    return [with_local_ids(pivoted(table, chosen)) for table in tables]


def _several_ships(logs: Sequence[Log]) -> list[str]:
    """A line where files name different ships."""
    ships = sorted({log.ship for log in logs if log.ship})
    if len(ships) < 2:
        return []
    own = {ship: next(log.table.path.name for log in logs if log.ship == ship) for ship in ships}
    return ["files of different ships: " + ", ".join(f"{s} ({own[s]})" for s in ships[:4]) + "; import each ship alone"]


def _origin(logs: Sequence[Log], chosen: ImportMap) -> tuple[float, float] | None:
    """The origin of the map, or the first position of all logs, to a ten-thousandth of a degree."""
    if chosen.origin:
        return float(chosen.origin[0]), float(chosen.origin[1])
    for log in logs:
        if {"latitude", "longitude"} <= set(log.columns):
            good = np.isfinite(log.columns["latitude"]) & np.isfinite(log.columns["longitude"])
            if good.any():
                i = int(np.argmax(good))
                return round(float(log.columns["latitude"][i]), 4), round(float(log.columns["longitude"][i]), 4)
        if log.zone and {"x", "y"} <= set(log.columns):
            from cases.importing.assembled_run import globe_positions

            lat, lon = globe_positions(log.columns["x"][:1], log.columns["y"][:1], log.zone, log.name)
            return round(float(lat[0]), 4), round(float(lon[0]), 4)
    return None


def _with_own_names(runs: Sequence[ImportedRun]) -> list[ImportedRun]:
    """Runs of the same name get that of their folder before it, or a number behind it."""
    names = Counter(run.name for run in runs)
    seen: Counter[str] = Counter()
    out = []
    for run in runs:
        if names[run.name] > 1:
            parents = {r.logs[0].table.path.parent.name for r in runs if r.name == run.name}
            seen[run.name] += 1
            folder = run.logs[0].table.path.parent.name
            new = f"{folder}_{run.name}" if len(parents) == names[run.name] else f"{run.name}_{seen[run.name]}"
            run = replace(run, name=new)
        out.append(run)
    return out


OVERLAP = 0.5
"""Least share of the shorter of two logs in which both run."""
HEADING, WHERE, ROTATION = (
    {"psi"},
    {"x", "latitude", "sog", "u"},
    {"n", "n_2", "n_bow", "n_stern", "n_azimuth", "delta"},
)


def grouped(logs: Sequence[Log], chosen: ImportMap) -> list[list[Log]]:
    """The ``logs`` of each run, in the order of their first files.

    chosen: the map. Logs of one run are those with the same ``run`` in it. Others are joined where they lie in one
    folder, their clocks are absolute and overlap, and one that is not complete by itself adds what the others lack.
    """
    runs: list[list[Log]] = []
    for log in logs:
        name = chosen.of(log.table.path).run
        for run in runs:
            other = chosen.of(run[0].table.path).run
            same = bool(name) and name == other
            if same or (not name and not other and not chosen.separate and _completes(log, run)):
                run.append(log)
                break
        else:
            runs.append([log])
    return runs


def complete(quantities: set[str]) -> bool:
    """Whether a run can be made of these ``quantities``: heading, motion and an actuator."""
    return bool(quantities & HEADING) and bool(quantities & WHERE) and bool(quantities & ROTATION)


def run_name(run: Sequence[Log], chosen: ImportMap) -> str:
    """The name of a ``run``: that of the map ``chosen``, the stem of its file, or what the stems of its files have in
    common."""
    named = chosen.of(run[0].table.path).run
    if named:
        return named
    stems = [log.table.path.stem for log in run]
    if len(set(stems)) == 1:
        sheet = re.search(r"(?:sheet|group) '(.*)'$", run[0].name)
        return f"{stems[0]}_{sheet[1]}" if sheet and len(run) == 1 else stems[0]
    least, most = min(stems), max(stems)
    same = next((i for i, (a, b) in enumerate(zip(least, most, strict=False)) if a != b), len(least))
    return least[:same].rstrip("_- .") or stems[0]


def _completes(log: Log, run: Sequence[Log]) -> bool:
    """Whether ``log`` completes the logs of a ``run``, at the same time."""
    if not log.absolute or not all(other.absolute for other in run):
        return False
    if log.table.path.parent != run[0].table.path.parent:
        return False
    own, theirs = set(log.columns), set().union(*(other.columns for other in run))
    if complete(own) or not own - theirs or (complete(theirs) and own & theirs):
        return False
    a, b = max(other.t[0] for other in run), min(other.t[-1] for other in run)
    both = min(b, log.t[-1]) - max(a, log.t[0])
    return bool(both > OVERLAP * min(b - a, log.t[-1] - log.t[0]))
