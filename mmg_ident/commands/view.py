"""``mmg view``: one interactive page on runs, a single file that the browser opens."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from mmg.errors import BadValue
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


def view(
    runs: o.Runs,
    out: Annotated[Path | None, Option(help="HTML file; default RUN/view.html, of several ./view.html.")] = None,
    trials: Annotated[list[Path] | None, Option(help="To show; default those of the runs.", metavar="TRIAL...")] = None,
    window: Annotated[list[float] | None, Option(help="Seconds between restarts, 0: none; default 30, 100, 0.")] = None,
    force: o.Force = False,
    json: o.Json = False,
) -> None:
    """Write one page with tracks, histories, bands and forces of measured and predicted runs; it loads nothing.

    Of a diagnosis among the runs it marks the missing force.

    Example: mmg view runs/first --out first.html
    """
    from delivery.view.page import LENGTHS, gather, write_view

    folders = list({folder.absolute(): folder for folder in runs}.values())
    target = out or (folders[0] / "view.html" if len(folders) == 1 else Path("view.html"))  # of one run in its folder
    cli.refuse_target("--out", out, force)
    if out is None and target.is_dir():
        raise BadValue(f"{target}: is a folder; name the HTML file to write with --out")
    campaign = gather(folders, trials or ())
    cli.say_notes(campaign.notes)
    with cli.working("writing the page"):
        size = write_view(campaign, target, tuple(dict.fromkeys(window or LENGTHS)))  # each length once
    if json:
        trials_shown, labels = ([s.trial.name for s in campaign.trials], [model.label for model in campaign.models])
        folder = campaign.diagnosis.folder if campaign.diagnosis else None
        content = {"view": str(target), "bytes": size, "trials": trials_shown, "models": labels}
        cli.print_json(content | {"diagnosis": folder, "notes": list(campaign.notes)})
    else:
        cli.say(f"page: {target} ({size / 1e6:.1f} MB, {len(campaign.trials)} trials); open it in a browser")
