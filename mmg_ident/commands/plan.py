"""``mmg plan``: the next trial, designed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from fitting.settings import Wish
from mmg.errors import writing
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


@o.options(
    Wish, file=False, Options="coefficients figures", Limits="speed_limit margin rudder_limit",
    Solver="time_limit seed effort workers scheduler",
)  # fmt: skip
def plan(
    run: Annotated[Path, Argument(help="Run folder of mmg fit, or of mmg train on one.", metavar="RUN")],
    area: Annotated[str, Option(help="Basin or sea area, length x width [m], such as 60x25.")],
    time: Annotated[float, Option(help="Length of the trial [s].")],
    out: Annotated[Path, Option(help="CSV file for the autopilot; a map comes with it.")],
    settings: o.Given,
    rudder_limit: Annotated[float, Option(help="Largest rudder angle ordered [deg].")] = 35.0,
    scheduler: o.Scheduler = None,
    force: o.Force = False,
    json: o.Json = False,
) -> None:
    """Design the next trial: rudder and revolutions that make chosen coefficients or figures known best.

    The ship stays inside the area (x north from 0 to the length, y east from 0 to the width), also by draws of the
    coefficients from their covariance; calm air. mmg simulate RUN --controls takes the file.

    Example: mmg plan runs/first --area 60x25 --time 180 --out next.csv
    """
    from fitting.design.planned_trial import in_words, plan_map
    from mmg_ident import studies

    cli.refuse_target("--out", out, force, (".csv",))
    cli.refuse_target("--out", out.with_suffix(".png"), force)  # the map, beside it
    with cli.working("planning"):
        planned = studies.plan(run, area, time, rudder_limit, cli.progress(), **settings)
    with writing(out):
        planned.write(out)
        plan_map(planned).savefig(out.with_suffix(".png"), dpi=120)
    content = planned.to_dict()
    if json:
        cli.print_json(content | {"out": str(out), "map": str(out.with_suffix(".png"))})
        return
    cli.say_notes(planned.notes)
    print("\n".join(in_words(content, out.name)))
    cli.say(f"written: {out}, {out.with_suffix('.png')}")
