"""``mmg view``: one interactive page on runs, a single file that the browser opens."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from mmg.errors import UserError
from mmg_ident.commands.output import print_json, refuse_target, say, working


def view(
    runs: Annotated[list[Path], Argument(help="Run folders of mmg fit, mmg train or mmg diagnose.", metavar="RUN...")],
    out: Annotated[
        Path | None, Option(help="HTML file to write; default RUN/view.html, ./view.html for several runs.")
    ] = None,
    trials: Annotated[
        list[Path] | None,
        Option(help="Trial files or folders to show; default those that the runs used, where they are as they were."),
    ] = None,
    diagnosis: Annotated[
        Path | None,
        Option(help="Folder of mmg diagnose whose missing force is marked; default one beside the run, if any."),
    ] = None,
    window: Annotated[
        list[float] | None,
        Option(help="Seconds from restart to restart, 0: the whole run; may be repeated; default 30, 100 and 0."),
    ] = None,
    force: Annotated[bool, Option("--force", help="Overwrite an existing --out.")] = False,
    json: Annotated[bool, Option("--json", help="Print where the page is, and what it shows, as JSON.")] = False,
) -> None:
    """Write one page with tracks, histories, bands and forces of measured and predicted runs; it loads nothing.

    Example: mmg view runs/first --out first.html
    """
    from delivery.view.page import LENGTHS, write_view
    from delivery.view.sources import gather

    folders = list({folder.absolute(): folder for folder in runs}.values())
    target = out or (folders[0] / "view.html" if len(folders) == 1 else Path("view.html"))
    if out is not None:
        refuse_target("--out", out, force)
    elif target.is_dir():
        raise UserError(f"{target}: is a folder; name the HTML file to write with --out")
    campaign = gather(folders, trials or (), diagnosis)
    for note in campaign.notes:
        say(f"note: {note}")
    with working("writing the page"):
        size = write_view(campaign, target, tuple(dict.fromkeys(window or LENGTHS)))
    if json:
        print_json(
            {
                "view": str(target),
                "bytes": size,
                "trials": [shown.trial.name for shown in campaign.trials],
                "models": [model.label for model in campaign.models],
                "diagnosis": campaign.found.folder if campaign.found else None,
                "notes": list(campaign.notes),
            }
        )
    else:
        say(f"page: {target} ({size / 1e6:.1f} MB, {len(campaign.trials)} trials); open it in a browser")
