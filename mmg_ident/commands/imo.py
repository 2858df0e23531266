"""``mmg imo``: the standards for ship manoeuvrability, from a simulated ship or from measured runs."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg.errors import Conflict, TargetExists, writing
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fitting.prediction.figure_intervals import JudgedFigures


@o.options(
    Simulated="speed rudder_rate maneuver",
    Measured="ship length correct current",
    Solver="scatter seed workers scheduler",
)
def imo(
    ships_and_trials: Annotated[
        list[str],
        Argument(help="A ship to simulate, or trials.", metavar="SHIP|TRIAL...", autocompletion=cli.ship_names),
    ],
    speed: Annotated[float | None, Option(help="Test speed [m/s]; default U_0, else Fn 0.142.")] = None,
    rudder_rate: Annotated[float | None, Option(help="[deg/s]; default the ship's, else 20 at 3 m.")] = None,
    maneuver: Annotated[list[str] | None, Option(help="Also this: spiral:15/5, pull-out:20.")] = None,
    ship: Annotated[str | None, Option(help="Ship of the trials: gives L and its name.")] = None,
    length: Annotated[float | None, Option(help="L of the trials' ship [m].")] = None,
    scale: Annotated[float | None, Option(help="Ship length over model length: judged at ship scale.")] = None,
    correct: Annotated[bool, Option("--correct", help="To still water and calm air (MSC/Circ.1053).")] = False,
    current: Annotated[str | None, Option(help="SPEED:TOWARDS [m/s:deg]; default from circles.")] = None,
    scatter: Annotated[int | None, Option(help="Ships drawn for intervals, 0: none; default 500.")] = None,
    seed: o.Seed = 0,
    workers: o.Workers = 1,
    scheduler: o.Scheduler = None,
    plot: Annotated[Path | None, Option(help="Figure to write (.png, .svg or .pdf).")] = None,
    out: Annotated[Path | None, Option(help="New folder for imo.json, imo.png and simulated runs.")] = None,
    force: o.Force = False,
    unchecked: o.Unchecked = False,
    json: o.Json = False,
) -> None:
    """Judge a ship by IMO MSC.137(76): turning, initial turning, yaw checking, stopping; pass or fail per figure.

    A ship is simulated in calm air and deep water (turning +-35, zigzags +-10/10 and +-20/20, crash stop). Of measured
    runs the approach is cut off, and what cannot be judged says why.

    Example: mmg imo kvlcc2_full --plot imo.png
    """
    from mmg_ident import studies

    models = [a for a in ships_and_trials if cli.is_model(a)]
    files = [a for a in ships_and_trials if not cli.is_model(a)]
    if models and (files or ship or len(models) > 1):
        raise Conflict("give one ship to simulate, or trial files (with --ship or --length), not both")
    for option, value in (("speed", speed), ("rudder-rate", rudder_rate), ("length", length), ("scale", scale)):
        cli.positive(f"--{option}", value)
    cli.refuse_target("--plot", plot, force, cli.FIGURES)
    if out is not None and out.exists() and not (out.is_dir() and (force or not any(out.iterdir()))):
        raise TargetExists(f"--out {out}: exists already; name a new folder or add --force")
    values: dict[str, Any] = {
        "scatter": scatter, "speed": speed, "rudder_rate": rudder_rate, "maneuver": maneuver or None, "length": length,
        "correct": correct or None, "current": None,
    }  # fmt: skip
    if current is not None:
        values["current"] = numbers = cli.numbers_of(current, 2, "--current SPEED:TOWARDS", ":")
        cli.positive("--current SPEED:TOWARDS", numbers[0], or_zero=True)
    if models:
        values |= {"seed": seed, "workers": workers}
    with cli.working("judging the manoeuvres"):
        judged = studies.imo(models[0] if models else ship, files, scale, unchecked, **values)
    _write(plot, out, judged)
    if json:
        cli.print_json(judged.to_dict())
        return
    _print(judged)
    for path in filter(None, (plot, out)):
        cli.say(f"written: {path}")


def _write(plot: Path | None, out: Path | None, assessment: JudgedFigures) -> None:
    """The figure, and the folder with table, figure and simulated runs."""
    from cases.simulation.simulate import write_trial
    from fitting.report.plot_maneuvers import maneuver_figure
    from fitting.report.plot_style import FigureFolder
    from fitting.report.run_folder import write_json

    draw = partial(maneuver_figure, assessment.runs, assessment.heading, assessment.clouds)
    with writing(out or plot or ""):
        if plot is not None:
            draw().savefig(plot)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            write_json(out / "imo.json", assessment.to_dict())
            for run in assessment.runs:
                if not run.measured:  # a measured run lies where the user has it
                    write_trial(run.trial, out / f"{run.trial.name}.csv")
            FigureFolder(out).write("imo", draw, assessment.heading, "")


def _print(assessment: JudgedFigures) -> None:
    print(assessment.heading)
    # columns that no row fills are left out
    published, corrected, drawn = (
        any(getattr(row, name) is not None for row in assessment.rows)
        for name in ("reference", "measured", "interval_90")
    )
    heads = ["run", "figure", *(("measured|n", "corrected|n") if corrected else ("value|n",))]
    heads += ["90 % interval|n", "of one trial|n"] * drawn + ["limit|n"]
    heads += ["reference|n"] * published + ["meets|n"] * drawn
    remarks: dict[str, int] = {}  # Reason or remark of a row -> its number below the table
    rows: list[list[str]] = []
    last = ""
    for row in assessment.rows:
        if row.run != last:
            rows.append([""] * (len(heads) + 1))
        mark = f" [{remarks.setdefault(row.why, len(remarks) + 1)}]" if row.why else ""
        figure = row.figure.removesuffix("_track").replace("_", " ")
        values = [_number(row.measured, row.unit)] * corrected + [_number(row.value, row.unit)]
        intervals = [_interval(row.interval_90, row.unit), _interval(row.interval_90_trial, row.unit)] * drawn
        cells = ["" if row.run == last else row.run, figure, *values, *intervals, _number(row.limit, row.unit)]
        cells += [_number(row.reference, row.unit)] * published
        cells += ["" if row.probability is None else f"{100 * row.probability:.0f} %"] * drawn
        rows.append([*cells, row.verdict + mark])
        last = row.run
    cli.print_table([*heads, "verdict"], rows)
    print()
    for words, k in remarks.items():
        print(f"[{k}] {words}")
    for note in assessment.notices:
        print(f"note: {note}")
    print(assessment.conclusion)


def _interval(ends: Sequence[float] | None, unit: str) -> str:
    digits = 1 if unit == "deg" else 2  # an end is infinite where draws never come to the event
    return " .. ".join(f"{end:.{digits}f}" if end < math.inf else "never" for end in ends or ())


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    return f"{value:.1f} deg" if unit == "deg" else f"{value:.2f} L" if unit == "L" else f"{value:+.3f}"
