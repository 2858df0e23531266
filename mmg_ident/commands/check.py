"""`mmg check`: what trial files say about themselves before anything is fitted to them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg.errors import UserError, together
from mmg.messages import listed
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from cases.checks import CheckReport


ORDER = ("contradictory", "doubtful", "info", "consistent", "ok")  # Levels and verdicts, the worst first


def check(
    trials: o.Trials,
    ship: Annotated[str | None, Option(help="Ship whose coefficients the trials are to excite.")] = None,
    every: Annotated[bool, Option("--all", help="Every sentence on every file, not only what is wrong.")] = False,
    json: o.Json = False,
) -> None:
    """Check trial files: units, signs, frames, gaps, duplicates, lags, excitation; a verdict per file and per folder.

    Example: mmg check data/turning data/zigzag/run_07.csv --ship esso_osaka_3m

    Exit code 0 when every file could be read, whatever its verdict; 2, after the report on the others, when one could
    not.
    """
    from cases.checks import check as check_trials
    from cases.checks.single import doubtful_revolutions, pooled
    from cases.inputs import model_inputs
    from cases.io.read import read_trial, trial_files
    from cases.shipfiles.ship_file import load_ship

    model = load_ship(ship) if ship else None
    read, files = [], []
    unreadable: dict[Path, UserError] = {}
    for path in trials:
        try:
            files += trial_files([path])
        except UserError as error:
            unreadable[path] = error
    for path in cli.each(list(dict.fromkeys(files)), "reading"):
        try:
            read.append(read_trial(path))
        except UserError as error:
            unreadable[path] = error
    if not read:
        raise together([*unreadable.values()], f"{len(unreadable)} files cannot be read")
    with cli.working(f"checking {len(read)} trials"):
        reports = check_trials(read)
        seconds, sentences = pooled(reports, model)
        doubts: list[str] = []
        if model:
            doubts += doubtful_revolutions(model, read)
            for trial in read:  # what the ship assumes of it or ignores, or why she cannot have made it
                try:
                    doubts += model_inputs(trial, model.inputs).notices
                except UserError as error:
                    doubts.append(str(error))
        sentences = [*(f"{doubt[0].upper()}{doubt[1:]}." for doubt in doubts), *sentences]
    if json:
        of_all = {"group_seconds": dict(seconds), "sentences": list(sentences)}
        cli.print_json(_document(reports, unreadable) | {"pooled": of_all})
    else:
        every = every or len(reports) == 1  # a table of what files share says less of one
        _print(reports, every, unreadable)
        if len(reports) > 1 or model:
            print("\nAll files together")
            for text in sentences or ["Every coefficient group is excited."]:
                cli.print_wrapped("     ", text)
        if not every:
            print("\nEvery sentence on every file: --all")
    if unreadable:
        many = f"{len(unreadable)} of {len(read) + len(unreadable)} files cannot be read"
        raise together([*unreadable.values()], many)


def _document(reports: list[CheckReport], unreadable: Mapping[Path, UserError]) -> dict[str, Any]:
    """{"files": [report, ...], "folders": [{"path", "verdict", "files"}, ...]}.

    A file that could not be read is a report with the verdict "contradictory" and no numbers. The verdict of a folder
    is the worst of its files.
    """
    files: list[dict[str, Any]] = [report.as_dict() for report in reports]
    for path, error in unreadable.items():
        finding = {"topic": "reading", "level": "contradictory", "code": "unreadable", "text": str(error)}
        head = {"name": path.stem, "path": str(path), "verdict": "contradictory"}
        files.append({**head, "findings": [finding], "numbers": {}})
    folders: dict[str, list[str]] = {}  # folder -> verdicts of its files
    for row in files:
        folders.setdefault(str(Path(row["path"]).parent), []).append(row["verdict"])
    rows = [{"path": p, "verdict": min(v, key=ORDER.index), "files": len(v)} for p, v in folders.items()]
    return {"files": files, "folders": rows}


def _print(reports: list[CheckReport], every: bool, unreadable: Mapping[Path, UserError]) -> None:
    """A table with one line per file, and what is wrong, for all files that share it (``every``: and all else)."""
    rows = [(report.name, report.verdict, *_cells(report)) for report in reports]
    rows += [(path.stem, "unreadable", *[""] * 5) for path in unreadable]
    cli.print_table(("trial", "verdict", "rows|n", "s|n", "dt|n", "wind/U|n", "n, rps|n"), rows)
    marks = {"info": "     ", "doubtful": "  !  ", "contradictory": "  !! "}
    if every:
        for report in reports:
            print(f"\n{report.name}: {report.verdict}")
            for finding in sorted(report.findings, key=lambda f: f.level == "info"):
                cli.print_wrapped(marks[finding.level], finding.text)
        return
    shared: dict[tuple[str, str], list[str]] = {}  # level and text -> names of the files that share it
    for report in reports:
        for finding in report.findings:
            if finding.level != "info" or finding.code in ("broken_stretch", "not_checked"):
                shared.setdefault((finding.level, finding.text), []).append(report.name)
    for (level, text), names in sorted(shared.items(), key=lambda item: ORDER.index(item[0][0])):
        whose = "all files" if len(names) == len(reports) else listed(names, 4)
        cli.print_wrapped(marks[level], f"{whose}: {text}")


def _cells(report: CheckReport) -> list[str]:
    """Rows, duration, step, wind ratio and range of revolutions of one file as short text."""
    sampling = report.numbers["sampling"]
    revolutions = report.numbers.get("excitation", {}).get("n_range_rps", (None, None))
    wind = report.numbers["wind"]["ratio_to_ship_speed"]
    return [
        str(sampling["rows"]),
        f"{sampling['duration_s']:.0f}",
        f"{sampling['dt_s']:.3g}",
        "-" if wind is None else f"{wind:.1f}",
        "..".join("-" if n is None else f"{n:.3g}" for n in revolutions),
    ]
