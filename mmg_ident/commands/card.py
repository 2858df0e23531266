"""``mmg card``: pilot card, wheelhouse poster and manoeuvring booklet of a ship, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


@o.options(Simulated="speed rudder_rate", Solver="scatter seed")
def card(
    model: Annotated[str, Argument(help="A run folder, or a ship.", metavar="RUN", autocompletion=cli.ship_names)],
    out: Annotated[Path | None, Option(help="HTML file; default RUN/card.html, of a ship ./card.html.")] = None,
    pdf: Annotated[bool, Option("--pdf", help="Also a PDF beside it (needs WeasyPrint: the extra pdf).")] = False,
    speed: Annotated[float | None, Option(help="Test speed [m/s]; default as mmg imo.")] = None,
    rudder_rate: Annotated[float | None, Option(help="[deg/s]; default the ship's, else 20 at 3 m.")] = None,
    scatter: Annotated[int | None, Option(help="Ships drawn for intervals, 0: none; default 500.")] = None,
    seed: o.Seed = 0,
    force: o.Force = False,
    json: o.Json = False,
) -> None:
    """Write a ship's pilot card, wheelhouse poster and manoeuvring booklet (IMO A.601(15)).

    Engine orders, steering, turning circles, yaw checking and stopping in calm and deep water, with 90 % intervals
    where the trials tell them. What no model knows stays to be filled in aboard.

    Example: mmg card runs/first --pdf
    """
    from fitting.report.page import needs_weasyprint, write_page, write_pdf
    from mmg_ident.studies import card as made

    cli.positive("--speed", speed)
    cli.positive("--rudder-rate", rudder_rate)
    folder = Path(model)
    target = out or (folder / "card.html" if folder.is_dir() else Path("card.html"))
    targets = cli.page_targets(target, pdf, [folder / "card.html"] if folder.is_dir() else [], force)
    if pdf:
        needs_weasyprint()
    with cli.working("simulating the manoeuvres of the card"):
        one = made(model, speed=speed, rudder_rate=rudder_rate, scatter=scatter, seed=seed)
        text = one.page()
        write_page(text, target)
        if pdf:
            write_pdf(text, targets[1])
    if json:
        cli.print_json({**one.to_dict(), "files": [str(path) for path in targets]})
        return
    for notice in one.notices:
        cli.say(f"note: {notice}")
    for path in targets:
        cli.say(f"card: {path}")
