"""``mmg months``: months of operational data: check, cut, choose, fit, score, date what changed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from fitting.settings import Settings
from mmg.errors import name_fault
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from diagnosis.groups.months import MonthStudy


@o.options(Settings, Solver="time_limit seed")
def months(
    folder: Annotated[Path, Argument(help="Folder of the Parquet files of the log, and folders in it.")],
    ship: Annotated[str, Option(help="Library ship, ship file or run folder.", autocompletion=cli.ship_names)],
    out: o.RunFolder,
    settings: o.Given,
    fit: Annotated[bool, Option(help="Take the ship as she is.")] = True,
    windows: Annotated[int, Option(min=1, help="Most windows to fit.")] = 24,
    json: o.Json = False,
) -> int:
    """Study months of operational data in partitioned Parquet: cut them, fit the windows that tell most, date changes.

    Example: mmg months logs/2026-05 --ship esso_osaka_3m --out runs/may
    """
    from cases.shipfiles.ship_file import load_ship
    from diagnosis.groups.months import study_months
    from diagnosis.report.months_page import write_study
    from fitting.calibrate import FitOptions
    from fitting.report.page import label_of
    from fitting.report.run_folder import check_target, reserved

    check_target(out)
    start = load_ship(ship)
    # huber unless another loss is given: nobody has looked through months of a log as through trials
    chosen, name = Settings(**{"loss": "huber", **settings}), label_of(out)
    options = FitOptions(command=cli.command_line(), name="" if name_fault(name) else name)
    with reserved(out):
        study, result = study_months(folder, start, chosen, options, windows if fit else 0, cli.progress())
        write_study(study, result, out)
    if json:
        cli.print_json(study)
    else:
        if result:
            cli.say_remarks(result)
        _summary(study, out)
    return 0 if result is None or result.converged else 1


def _summary(study: MonthStudy, out: Path) -> None:
    """A few lines for a person."""
    from cases.quantities import UNITS

    cut = study.cut
    cli.say(f"{study.days:.1f} days, {cut.rows} rows in {len(study.log.parts)} parts, every {cut.step:g} s")
    cli.say("; ".join(f"{what} {seconds / 3600:.1f} h" for what, seconds in cut.seconds.items() if seconds))
    for name, errors in study.scores.items():
        words = ", ".join(f"{channel} {value:.3g} {UNITS.get(channel, 'm')}" for channel, value in errors.items())
        cli.say(f"errors of all windows {name}: {words}")  # along and across the track: positions
    for row in study.changes.named:
        cli.say(study.words(row))
        if row.company:
            cli.say(f"  {', '.join(row.company)} seem to change with it; the log does not tell them apart")
    if study.changes.tested and not study.changes.named:
        cli.say(f"no change found in {len(study.changes.tested)} candidates")
    for line in study.warnings:
        cli.say(f"warning: {line}")
    cli.say(f"run folder: {out} (ship.toml, months.json, windows.parquet, months.html)")
