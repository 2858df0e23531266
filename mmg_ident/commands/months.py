"""``mmg months``: months of operational data: check, cut, choose, fit, score, date what changed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from mmg.errors import UserError, name_fault
from mmg_ident.commands.output import command_line, print_json, progress, say, say_remarks, ship_names

if TYPE_CHECKING:
    from diagnosis.hypotheses.over_time.month_study import MonthStudy


def months(
    folder: Annotated[Path, Argument(help="Folder of the Parquet files of the log; folders in it are read too.")],
    ship: Annotated[
        str, Option(help="Ship to start from: library name, ship file or run folder.", autocompletion=ship_names)
    ],
    out: Annotated[Path, Option(help="Run folder to write; it must not exist.")],
    fit: Annotated[
        bool, Option(help="Calibrate the ship on the windows that tell most; else she is taken as she is.")
    ] = True,
    windows: Annotated[int, Option(help="Most windows to fit.")] = 24,
    time_limit: Annotated[float | None, Option(help="Wall-clock limit of the calibration [s].")] = None,
    seed: Annotated[int, Option(help="Seed of the bootstrap of the dates.")] = 0,
    compiled: Annotated[bool, Option(help="Use a C compiler if there is one.")] = True,
    json: Annotated[bool, Option("--json", help="Print months.json on stdout.")] = False,
) -> int:
    """Study months of operational data in partitioned Parquet: cut them, fit the windows that tell most, date changes.

    Example: mmg months logs/2026-05 --ship esso_osaka_3m --out runs/may
    """
    from cases.shipfiles.ship_file import load_ship
    from diagnosis.report.months_page import write_study
    from fitting.report.page import label_of
    from fitting.report.run_folder import check_target, reserved
    from fitting.settings import Settings
    from mmg_ident.months import MonthOptions, study_months

    if windows < 1:
        raise UserError(f"--windows {windows} must be at least 1")
    if time_limit is not None and not time_limit > 0:
        raise UserError(f"--time-limit {time_limit:g} must be positive")
    check_target(out)
    start = load_ship(ship)
    settings = Settings(loss="huber", time_limit=time_limit, compiled=compiled)
    with reserved(out):
        options = MonthOptions(
            fit, windows, seed, settings, command_line(), "" if name_fault(label_of(out)) else label_of(out)
        )
        study, result = study_months(folder, start, options, progress())
        write_study(study, result, out)
    if json:
        print_json(study)
    else:
        if result:
            say_remarks(result)
        _summary(study, out)
    return 0 if result is None or result.converged else 1


def _summary(study: MonthStudy, out: Path) -> None:
    """A few lines for a person."""
    cut = study.cut
    say(f"{study.days:.1f} days, {cut.rows} rows in {len(study.log.parts)} parts, every {cut.step:g} s")
    say("; ".join(f"{what} {seconds / 3600:.1f} h" for what, seconds in cut.seconds.items() if seconds))
    for name, errors in study.scores.items():
        words = ", ".join(f"{channel} {value:.3g}" for channel, value in errors.items())
        say(f"errors of all windows {name}: {words}")
    for row, company in zip(study.changes.named, study.changes.company, strict=True):
        say(study.words(row))
        if company:
            say(f"  {', '.join(company)} seem to change with it; the log does not tell them apart")
    if study.changes.tested and not study.changes.named:
        say(f"no change found in {len(study.changes.tested)} candidates")
    for line in study.warnings:
        say(f"warning: {line}")
    say(f"run folder: {out} (ship.toml, months.json, windows.parquet, months.html)")
