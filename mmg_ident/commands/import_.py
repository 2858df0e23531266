"""``mmg import``: raw logs, as a ship or a basin writes them, to canonical trial files."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg.messages import listed
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from cases.importing.assembled_run import ImportedRun
    from cases.importing.import_logs import Imported
    from cases.importing.import_map import ImportMap, Question


@o.options(Headers="rudder_positive wind_direction velocity_frame zone_hours")
def import_(
    logs: Annotated[list[Path], Argument(help="Raw logs (text, Excel, NMEA, Parquet), or folders.", metavar="FILE...")],
    out: Annotated[Path, Option(help="Folder to write: a file for each run, trials.toml, import.toml.")],
    map: Annotated[Path | None, Option("--map", help="What the headers leave unsaid (docs/how-to/import.md).")] = None,
    rudder_positive: Annotated[str | None, Option(help="Side of positive rudder angles: starboard, port.")] = None,
    wind_direction: Annotated[str | None, Option(help="Where wind directions point: from or to.")] = None,
    velocity_frame: Annotated[str | None, Option(help="Frame of u and v: body or earth.")] = None,
    zone_hours: Annotated[float | None, Option(help="Of stamps without a time zone, ahead of UTC.")] = None,
    separate: Annotated[bool, Option("--separate", help="Every file is a run; none are joined.")] = False,
    force: Annotated[bool, Option("--force", help="Write into a folder that holds files.")] = False,
    json: o.Json = False,
) -> None:
    """Turn raw logs into canonical trials: separators, units, clocks, positions on the globe, derived velocities.

    Example: mmg import logs/ --out trials

    On a terminal it asks for what the headers leave open; import.toml in the folder repeats the answers. Nothing is
    written while a file has a problem: all problems are said at once.
    """
    from cases.checks import check
    from cases.importing.import_logs import write_import
    from cases.io.read import read_trials
    from mmg_ident.studies import import_map

    chosen = import_map(
        map, rudder_positive=rudder_positive, wind_direction=wind_direction, velocity_frame=velocity_frame,
        zone_hours=zone_hours, separate=separate or None,  # None: as the map says
    )  # fmt: skip
    logged, chosen = imported(logs, chosen, ask=not json)
    with cli.working("writing trials"):
        files = write_import(logged, chosen, out, force)
    checks = check(read_trials(files))  # of the files as written, as any other command will read them
    if json:
        rows = [_row(r, f, c) for r, f, c in zip(logged.runs, files, checks, strict=True)]
        cli.print_json({"out": str(out), "origin": logged.origin, "runs": rows})
    else:
        _print(logged, files, checks)
        cli.say(f"next: mmg check {out}, then mmg fit SHIP {out} --out runs/first")


def imported(logs: list[Path], chosen: ImportMap, ask: bool) -> tuple[Imported, ImportMap]:
    """The import of ``logs`` by a map.

    chosen: the map to begin with; ask: a person at the terminal, where there is one. Returns the import and the map
    with the answers. Raises UserError for all that is open.
    """
    from cases.importing.import_logs import import_logs
    from mmg_ident.studies import complete

    logged = import_logs(logs, chosen, lambda files: cli.each(files, "reading"))
    asked: set[tuple[Path, str]] = set()
    while ask and sys.stdin.isatty() and sys.stderr.isatty():
        answered = _answered(logged, chosen, asked)
        if answered is chosen:
            break
        chosen = answered  # an answer may leave a unit open
        logged = import_logs(logs, chosen, lambda files: cli.each(files, "reading"))
    return complete(logged), chosen


def _answered(imported: Imported, chosen: ImportMap, before: set[tuple[Path, str]]) -> ImportMap:
    """The map with the answers of the person at the terminal; the same map where there is nothing to ask that was not
    asked ``before``. What several files leave open alike is asked once."""
    from mmg_ident.studies import changed_map

    together: dict[tuple[str, tuple[str, ...]], list[Question]] = {}  # by words and answers, of whatever file
    for question in imported.questions:
        if (question.file, question.words) not in before:
            together.setdefault((question.words, tuple(question.choices)), []).append(question)
    for (words, choices), questions in together.items():
        names = [imported.names.get(question.file, "") for question in questions]
        before |= {(question.file, words) for question in questions}
        cli.say(f"{listed(names)}: {words}".removeprefix(": "))
        answer = _choice(choices)
        if point := _point(answer):
            chosen = changed_map(chosen, {"reference_point": list(point)})
        elif not names[0]:  # of all files
            chosen = changed_map(chosen, dict(questions[0].choices[answer]))
        else:
            for name, question in zip(names, questions, strict=True):
                chosen = chosen.answered(name, question.choices[answer])
    return chosen


def _choice(choices: tuple[str, ...]) -> str:
    """The one of the ``choices`` that the person types; an empty line is the last one."""
    import typer

    from cases.importing.import_map import POINT

    while True:
        answer = str(typer.prompt("  " + " / ".join(choices), default=choices[-1], err=True)).strip()
        if answer in choices and answer != POINT:
            return answer
        if POINT in choices and _point(answer):
            return answer
        cli.say(f"  '{answer}' is none of them")


def _point(answer: str) -> tuple[float, float] | None:
    """The two numbers [m] of an ``answer`` such as "12.0 0.0"; None of another."""
    from cases.quantities import as_number

    numbers = [as_number(word) for word in answer.replace(",", " ").split()]
    # to 600 m, longer than any ship; as_number gives nan for a word, which is not within it
    return (numbers[0], numbers[1]) if len(numbers) == 2 and all(abs(n) <= 600 for n in numbers) else None


def _row(run: ImportedRun, file: Path, report: Any) -> dict[str, Any]:
    """What JSON says of a run."""
    from mmg.messages import message_rows

    return {
        "name": run.name,
        "file": str(file),
        "from": [log.name for log in run.logs],
        "rows": len(run.columns["t"]),
        "columns": list(run.columns),
        "std": run.std,
        "account": [{"log": log.name, **dataclasses.asdict(row)} for log in run.logs for row in log.accounts],
        "notices": message_rows(run.notices),
        "verdict": report.verdict,
    }


def _print(imported: Imported, files: list[Path], checks: list[Any]) -> None:
    """One table of the runs, and below it what was done, once for all runs that share it."""
    rows = []
    for run, file, report in zip(imported.runs, files, checks, strict=True):
        t, sources = run.columns["t"], ", ".join(dict.fromkeys(log.table.path.name for log in run.logs))
        rows.append((file.name, sources, str(len(t)), f"{t[-1]:.0f}", report.verdict))
    cli.print_table(("trial", "from", "rows|n", "s|n", "verdict of check"), rows)
    cli.print_table(("column", "used as", "because"), _account(imported))
    shared: dict[str, list[str]] = {}  # sentence -> names of the runs that share it
    for run, report in zip(imported.runs, checks, strict=True):
        wrong = [f"[check] {finding.text}" for finding in report.findings if finding.level == "contradictory"]
        for sentence in [*map(str, run.notices), *wrong]:
            shared.setdefault(sentence, []).append(run.name)
    for sentence, names in shared.items():
        whose = "" if len(names) == len(imported.runs) else f"{', '.join(names)}: "
        cli.print_wrapped("  ", f"{whose}{sentence}")


def _account(imported: Imported) -> list[tuple[str, str, str]]:
    """A row for each column of the logs, once for all logs that share it."""
    rows = [row for run in imported.runs for log in run.logs for row in log.accounts]
    read = ((row.what, ", ".join(row.used_as) or "not used", row.why) for row in rows)
    derived = ((name, "derived from " + (", ".join(of) or "nothing: assumed"), "") for run in imported.runs
               for name, of in run.ancestors.items())  # fmt: skip
    return list(dict.fromkeys([*read, *derived]))  # each once, in the order of the logs
