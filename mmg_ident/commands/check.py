"""`mmg check`: what trial files say about themselves before anything is fitted to them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg.errors import UserError
from mmg_ident.commands.output import each, print_json, working

if TYPE_CHECKING:
    from cases.checks import CheckReport


def check(
    trials: Annotated[list[Path], Argument(help="Trial files (CSV, Parquet) or folders of them.")],
    json: Annotated[bool, Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Check trial files: units, signs, frames, gaps, duplicates, lags, excitation; a verdict per file.

    Example: mmg check data/turning data/zigzag/run_07.csv

    Exit code 0 when every file could be read, whatever its verdict; 2, after the report on the others, when one could
    not.
    """
    from cases.checks import check as check_trials
    from cases.io.read import read_trials

    found, unreadable = [], []
    for path in each(trials, "reading"):
        try:
            found += read_trials([path])
        except UserError as error:
            unreadable.append((path, error))
    if not found:
        raise unreadable[0][1]
    with working(f"checking {len(found)} trials"):
        reports = check_trials(found)
    if json:
        print_json(_document(reports, unreadable))
    else:
        _print(reports)
    if unreadable:
        raise UserError("; ".join(str(error) for _, error in unreadable))


def _document(reports: list[CheckReport], unreadable: list[tuple[Path, UserError]]) -> dict[str, Any]:
    """{"files": [report, ...], "pooled": {"group_seconds": {...}, "sentences": [...]}}.

    A file that could not be read is a report with the verdict "contradictory" and no numbers.
    """
    from cases.checks import pooled

    files = [report.as_dict() for report in reports]
    for path, error in unreadable:
        finding = {"topic": "reading", "level": "contradictory", "code": "unreadable", "text": str(error)}
        row = {"name": path.stem, "path": str(path), "verdict": "contradictory", "findings": [finding], "numbers": {}}
        files.append(row)
    seconds, sentences = pooled(reports)
    return {"files": files, "pooled": {"group_seconds": seconds, "sentences": sentences}}


def _print(reports: list[CheckReport]) -> None:
    """A table with one line per file, the sentences of each file, and what the files excite together."""
    from rich.console import Console
    from rich.markup import escape
    from rich.padding import Padding
    from rich.table import Table

    from cases.checks import pooled

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=max(console.width, 100))
    colours = {"ok": "green", "doubtful": "yellow", "contradictory": "red"}
    table = Table(box=None, padding=(0, 1), pad_edge=False)
    for title in ("trial", "verdict", "rows", "s", "dt", "lag u v r, s", "wind/U", "n, rps"):
        table.add_column(title, justify="left" if title in ("trial", "verdict") else "right", no_wrap=True)
    table.columns[0].overflow = "ellipsis"
    for report in reports:
        verdict = f"[{colours[report.verdict]}]{report.verdict}[/]"
        table.add_row(escape(report.name), verdict, *_cells(report))
    console.print(table)
    marks = {"info": "  ", "doubtful": "! ", "contradictory": "!!"}
    for report in reports:
        console.print(f"\n[bold]{escape(report.name)}[/]: [{colours[report.verdict]}]{report.verdict}[/]")
        for finding in sorted(report.findings, key=lambda f: f.level == "info"):
            line = Table.grid(padding=(0, 1))
            line.add_row(f"  {marks[finding.level]}", escape(finding.text))
            console.print(line)
    if len(reports) > 1:
        console.print("\n[bold]All files together[/]")
        for text in pooled(reports)[1] or ["Every coefficient group is excited."]:
            console.print(Padding(escape(text), (0, 0, 0, 5)))


def _cells(report: CheckReport) -> list[str]:
    """Rows, duration, step, lags, wind ratio and range of revolutions of one file as short text."""
    sampling, excitation = report.numbers["sampling"], report.numbers["excitation"]
    channels = report.numbers["kinematics"]["channels"]
    lags = [_short(channels[c]["lag_s"], "5.2f") if c in channels else "    -" for c in "uvr"]
    low, high = excitation.get("n_range_rps", (None, None))
    return [
        str(sampling["rows"]),
        f"{sampling['duration_s']:.0f}",
        f"{sampling['dt_s']:.3g}",
        " ".join(lags),
        _short(report.numbers["wind"]["ratio_to_ship_speed"], ".1f"),
        f"{_short(low, '.3g')}..{_short(high, '.3g')}",
    ]


def _short(value: float | None, form: str) -> str:
    return "-".rjust(int(form[0]) if form[0].isdigit() else 0) if value is None else format(value, form)
