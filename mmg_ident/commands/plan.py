"""``mmg plan``: the next trial, designed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from mmg.errors import BadValue, NotWritable, OutOfRange
from mmg_ident.commands import options as o
from mmg_ident.commands.output import names_of, print_json, progress, refuse_target, say, working

if TYPE_CHECKING:
    from fitting.design.planned_trial import PlannedTrial


@o.options(Limits="speed_limit margin start ahead rudder_limit", Solver="time_limit seed effort workers scheduler")
def plan(
    run: Annotated[Path, Argument(help="Run folder of mmg fit, or of mmg train on one.", metavar="RUN")],
    area: Annotated[str, Option(help="Basin or sea area, length x width [m], such as 60x25.")],
    time: Annotated[float, Option(help="Length of the trial [s].")],
    out: Annotated[Path, Option(help="CSV file for the autopilot; a map comes with it.")],
    coefficients: Annotated[str | None, Option(help="Symbols, hull, propeller, rudder or all; default hull.")] = None,
    figures: Annotated[
        str | None, Option(help="Instead: advance, transfer, tactical_diameter, track_reach, first_overshoot_10, ...")
    ] = None,
    speed_limit: Annotated[float | None, Option(help="Highest [m/s]; default that of the trials.")] = None,
    margin: Annotated[float | None, Option(help="From the edges [m]; default half a beam.")] = None,
    start: Annotated[str | None, Option(help="x:y:heading [m, m, deg]; default where most room is.")] = None,
    ahead: Annotated[bool, Option("--ahead", help="The propeller is not reversed.")] = False,
    rudder_limit: Annotated[float, Option(help="Largest rudder angle ordered [deg].")] = 35.0,
    time_limit: Annotated[float, Option(help="Limit of the search [s].")] = 150.0,
    seed: o.Seed = 0,
    effort: Annotated[float, Option(help="Factor on the length of the search.")] = 1.0,
    workers: o.Workers = 1,
    scheduler: o.Scheduler = None,
    force: o.Force = False,
    json: o.Json = False,
) -> None:
    """Design the next trial: rudder and revolutions that make chosen coefficients or figures known best.

    The ship stays inside the area (x north from 0 to the length, y east from 0 to the width), also by draws of the
    coefficients from their covariance; calm air. mmg simulate RUN --controls takes the file, mmg report RUN shows it.

    Example: mmg plan runs/first --area 60x25 --time 180 --out next.csv
    """
    from fitting.design.plan import Wish
    from fitting.design.planned_trial import plan_trial
    from fitting.report.plan_section import in_words
    from fitting.report.run_folder import read_result
    from mmg_ident.api import load_run

    if out.suffix.lower() != ".csv":
        raise BadValue(f"--out {out}: the file for the autopilot ends in .csv")
    for path in (out, out.with_suffix(".png")):
        refuse_target("--out", path, force)
    if not (math.isfinite(effort) and 0 < effort <= 100):
        raise OutOfRange(f"--effort {effort:g}: give a number above 0, at most 100")
    symbols, wanted = (tuple(names_of([text or ""])) for text in (coefficients, figures))
    wish = Wish(
        area, time, symbols, wanted, speed_limit, margin, _start(start), ahead, seed, effort,
        math.radians(rudder_limit), time_limit, workers,
    )  # fmt: skip
    kind = read_result(run)["kind"]
    if kind not in ("calibration", "training"):
        raise BadValue(f"{run}: kind {kind!r} cannot be planned from; give a run folder of mmg fit or mmg train")
    result = load_run(run)
    with working("planning"):
        planned = plan_trial(result.ship, result.to_dict(), wish, progress())
    _write(planned, out, run)
    content = planned.to_dict()
    if json:
        print_json(content | {"out": str(out), "map": str(out.with_suffix(".png"))})
        return
    for note in planned.notes:
        say(f"note: {note}")
    print("\n".join(in_words(content, out.name)))
    say(f"written: {out}, {out.with_suffix('.png')}")


def _start(text: str | None) -> tuple[float, float, float] | None:
    """x, y [m], psi [rad] of words such as 5:12:90."""
    if text is None:
        return None
    try:
        x, y, heading = (float(word) for word in text.split(":"))
    except ValueError:
        x = y = heading = math.nan
    if not all(math.isfinite(v) for v in (x, y, heading)):
        raise BadValue(f"--start {text}: give x:y:heading in metres and degrees, such as 5:12:90")
    return x, y, math.radians(heading)


def _write(planned: PlannedTrial, out: Path, run: Path) -> None:
    """The file for the autopilot and the map beside it; the run keeps the plan for its report."""
    from fitting.report.plan_section import keep_plan, plan_map

    try:
        planned.write(out)
        plan_map(planned).savefig(out.with_suffix(".png"), dpi=120)
    except OSError as error:
        raise NotWritable(f"{error.filename or out}: cannot be written ({error.strerror or error})") from None
    try:
        keep_plan(planned, run, out)
    except OSError as error:
        say(f"note: the report of {run} will not show this plan: {error.strerror or error}")
