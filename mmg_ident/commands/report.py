"""``mmg report``: a self-contained HTML page on one or several run folders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from mmg.errors import UserError
from mmg_ident.commands.output import print_json, say, working


def report(
    runs: Annotated[list[Path], Argument(help="Run folders of mmg fit, or of mmg train.", metavar="RUN...")],
    out: Annotated[
        Path | None, Option(help="HTML file to write; default RUN/report.html, ./report.html for several runs.")
    ] = None,
    json: Annotated[bool, Option("--json", help="Print where the report is as JSON.")] = False,
) -> None:
    """Write one self-contained HTML page on a run, or on several side by side.

    Example: mmg report runs/first runs/second --out comparison.html
    """
    from mmg_ident.api import write_report

    folders = list({folder.absolute(): folder for folder in runs}.values())
    target = out or (folders[0] / "report.html" if len(folders) == 1 else Path("report.html"))
    own = {(folder / "report.html").absolute() for folder in folders}
    if target.is_dir():
        raise UserError(f"{target}: is a folder; name the HTML file to write with --out")
    if target.exists() and target.absolute() not in own:
        raise UserError(f"{target}: already exists; choose another --out")
    with working("writing the report"):
        write_report(folders, target)
    if json:
        print_json({"report": str(target), "runs": [str(folder) for folder in folders]})
    else:
        say(f"report: {target}")
