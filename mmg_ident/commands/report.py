"""``mmg report``: a self-contained HTML page on one or several run folders, and the same as PDF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


def report(
    runs: o.Runs,
    out: Annotated[Path | None, Option(help="HTML file; default RUN/report.html, of several ./report.html.")] = None,
    pdf: Annotated[bool, Option("--pdf", help="Also a PDF beside it (needs WeasyPrint: the extra pdf).")] = False,
    full_load_draught: Annotated[float | None, Option(help="[m] to which tested IMO figures are corrected.")] = None,
    imo: Annotated[bool, Option(help="Without the form for IMO, whose figures are simulated.")] = True,
    json: o.Json = False,
) -> None:
    """Write one self-contained HTML page on a run, or on several side by side.

    Example: mmg report runs/first runs/second --out comparison.html
    """
    from mmg_ident.api import write_report

    folders = list({folder.absolute(): folder for folder in runs}.values())
    target = out or (folders[0] / "report.html" if len(folders) == 1 else Path("report.html"))
    # pages of the runs themselves are made anew; any other file is somebody's
    targets = cli.page_targets(target, pdf, [folder / "report.html" for folder in folders])
    cli.positive("--full-load-draught", full_load_draught)
    with cli.working("writing the report"):
        write_report(folders, target, targets[1] if pdf else None, full_load_draught, imo)
    if json:
        written = {"report": str(target), "pdf": str(targets[1]) if pdf else None}
        cli.print_json(written | {"runs": [str(folder) for folder in folders]})
    else:
        for path in targets:
            cli.say(f"report: {path}")
