"""``mmg imo``: the standards for ship manoeuvrability, from a simulated ship or from measured runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from mmg.errors import BadValue, Conflict, Missing, NotWritable, OutOfRange, TargetExists, UnknownName
from mmg_ident.commands import options as o
from mmg_ident.commands.output import is_model, print_json, print_table, refuse_target, say, ship_names, working

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from cases.criteria.assessment import Assessment
    from cases.criteria.figures import Since
    from cases.criteria.trial_correction import WaterVelocity
    from cases.trial import Trial
    from mmg.ship import Ship


@o.options(
    Simulated="speed rudder_rate maneuver",
    Measured="ship length kind correct current",
    Solver="scatter seed workers scheduler",
)
def imo(
    ships_and_trials: Annotated[
        list[str],
        Argument(help="A ship to simulate, or measured trials.", metavar="SHIP|TRIAL...", autocompletion=ship_names),
    ],
    speed: Annotated[float | None, Option(help="Test speed [m/s]; default U_0, else Fn 0.142.")] = None,
    rudder_rate: Annotated[float | None, Option(help="[deg/s]; default the ship's, else 20 at 3 m.")] = None,
    maneuver: Annotated[list[str] | None, Option(help="Also this: spiral:15/5, pull-out:20.")] = None,
    ship: Annotated[str | None, Option(help="Ship of the trials: gives L and its name.")] = None,
    length: Annotated[float | None, Option(help="L of the trials' ship [m].")] = None,
    kind: Annotated[str, Option(help="turning, zigzag or crash-stop; default from the data.")] = "",
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
    import math

    from cases.criteria.assessment import imo_figures, imo_figures_of_trials
    from cases.criteria.measured_maneuvers import KINDS
    from cases.shipfiles.ship_file import load_ship

    models = [a for a in ships_and_trials if is_model(a)]
    files = [a for a in ships_and_trials if not is_model(a)]
    if models and (files or len(models) > 1):
        raise Conflict("give one ship to simulate, or trial files (with --ship or --length), not both")
    for option, value in (("speed", speed), ("rudder-rate", rudder_rate), ("length", length), ("scale", scale)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise OutOfRange(f"--{option} {value:g} must be positive")
    if kind and kind not in KINDS:
        raise UnknownName(f"--kind {kind!r} is unknown; use {', '.join(KINDS)}")
    _check_targets(plot, out, force)
    if models:
        own: dict[str, object] = {"--ship": ship, "--length": length, "--kind": kind or None}
        own |= {"--correct": correct or None, "--current": current}
        for option in [name for name, value in own.items() if value is not None]:
            raise Conflict(f"{option} belongs to trial files; {models[0]} is simulated")
        rate = None if rudder_rate is None else math.radians(rudder_rate)
        simulated = load_ship(models[0])
        with working(f"simulating the manoeuvres of {simulated.name}"):
            found = imo_figures(simulated, speed, rate, maneuver or [], scale)
        found, clouds = _with_intervals(found, models[0], simulated, (scatter, seed, workers), rate)
    else:
        own = {"--scatter": scatter, "--speed": speed, "--rudder-rate": rudder_rate, "--maneuver": maneuver or None}
        for option in [name for name, value in own.items() if value is not None]:
            raise Conflict(f"{option} belongs to a ship that is simulated; trial files have their own")
        model = load_ship(ship) if ship is not None else None
        if model is None and length is None:
            raise Missing("trial files need the length of their ship: --ship SHIP or --length METRES")
        water = _current(current) if current is not None else correct
        found, clouds = imo_figures_of_trials(_trials(files, unchecked), model, length, kind, scale, water), {}
    _write(plot, out, found, clouds)
    if json:
        print_json(found.to_dict())
        return
    _print(found)
    for path in filter(None, (plot, out)):
        say(f"written: {path}")


def _with_intervals(
    found: Assessment, model: str, ship: Ship, draws: tuple[int | None, int, int], rudder_rate: float | None
) -> tuple[Assessment, dict[str, Sequence[Since]]]:
    """The figures with 90 % intervals, where a covariance is known or draws are asked for, and runs behind them; draws:
    how many, their seed, and processes."""
    from dataclasses import replace

    from cases.shipfiles.estimates import is_starting_ship
    from fitting.prediction.bands import correlation_in
    from fitting.prediction.figure_intervals import DRAWS, with_intervals
    from fitting.report.run_folder import content_on
    from mmg.messages import Message

    scatter, seed, workers = draws
    content = content_on(Path(model))
    known = correlation_in(content) is not None or (not content and is_starting_ship(ship))
    count = scatter if scatter is not None else DRAWS * known
    if count == 0:
        if content and scatter is None:
            words = f"no 90 % intervals: {model} holds no covariance; fit again, or give --scatter for its priors"
            found = replace(found, notices=(*found.notices, Message(words, "no_covariance")))
        return found, {}
    with working(f"simulating each manoeuvre {count} times"):
        judged = with_intervals(found, ship, content, count, seed, rudder_rate, workers)
    return judged.assessment, {name: one.shown for name, one in judged.scatter.items()}


def _current(text: str) -> WaterVelocity:
    """The current that --current names: speed [m/s] and the direction it goes to [deg]."""
    import math

    from cases.criteria.trial_correction import WaterVelocity

    try:
        speed, towards = (float(part) for part in text.split(":"))
    except ValueError:
        speed = towards = math.nan
    if not (math.isfinite(speed + towards) and speed >= 0):
        raise BadValue(f"--current {text}: give SPEED:TOWARDS in m/s and deg, such as 0.4:90 for 0.4 m/s to the east")
    angle = math.radians(towards)
    return WaterVelocity(speed * math.cos(angle), speed * math.sin(angle), 0.0, "as given")


def _trials(files: Sequence[str], unchecked: bool) -> list[Trial]:
    """The trials in ``files`` without broken stretches, or as they are if ``unchecked``."""
    from cases.checks import ready
    from cases.io.read import read_trials

    return ready(read_trials(files), unchecked=unchecked)[0]


def _check_targets(plot: Path | None, out: Path | None, force: bool) -> None:
    """Everything about the output that can be refused before simulating."""
    if plot is not None:
        if plot.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise BadValue(f"--plot {plot}: figures end in .png, .svg or .pdf")
        refuse_target("--plot", plot, force)
    if out is not None and out.exists() and not (out.is_dir() and (force or not any(out.iterdir()))):
        raise TargetExists(f"--out {out}: exists already; name a new folder or add --force")


def _write(plot: Path | None, out: Path | None, found: Assessment, clouds: Mapping[str, Sequence[Since]]) -> None:
    """The figure, and the folder with table, figure and simulated runs."""
    from functools import partial

    from cases.simulation.simulate import write_trial
    from fitting.report.plot_maneuvers import maneuver_figure, save_figure
    from fitting.report.plot_style import FigureFolder
    from fitting.report.run_folder import write_json

    try:
        if plot is not None:
            save_figure(found.runs, found.heading, plot, clouds)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            write_json(out / "imo.json", found.to_dict())
            for run in found.runs:
                if not run.measured:
                    write_trial(run.trial, out / f"{run.trial.name}.csv")
            draw = partial(maneuver_figure, found.runs, found.heading, clouds)
            FigureFolder(out).write("imo", draw, found.heading, "")
    except OSError as error:
        raise NotWritable(f"{error.filename or out or plot}: cannot be written ({error.strerror})") from None


def _print(found: Assessment) -> None:
    print(found.heading)
    known, corrected, drawn = (
        any(getattr(row, name) is not None for row in found.rows) for name in ("reference", "measured", "interval_90")
    )
    heads = ["run", "figure", *(("measured|n", "corrected|n") if corrected else ("value|n",))]
    heads += ["90 % interval|n", "of one trial|n"] * drawn + ["limit|n"] + ["reference|n"] * known + ["meets|n"] * drawn
    remarks: dict[str, int] = {}
    rows: list[list[str]] = []
    last = ""
    for row in found.rows:
        if row.run != last:
            rows.append([""] * (len(heads) + 1))
        mark = f" [{remarks.setdefault(row.why, len(remarks) + 1)}]" if row.why else ""
        figure = WORDS.get(row.figure, row.figure.replace("_", " "))
        values = [_number(row.measured, row.unit)] * corrected + [_number(row.value, row.unit)]
        intervals = [_interval(row.interval_90, row.unit), _interval(row.interval_90_trial, row.unit)] * drawn
        cells = ["" if row.run == last else row.run, figure, *values, *intervals, _number(row.limit, row.unit)]
        cells += [_number(row.reference, row.unit)] if known else []
        cells += ["" if row.probability is None else f"{100 * row.probability:.0f} %"] * drawn
        rows.append([*cells, row.verdict + mark])
        last = row.run
    print_table([*heads, "verdict"], rows)
    print()
    for words, k in remarks.items():
        print(f"[{k}] {words}")
    for note in found.notices:
        print(f"note: {note}")
    print(found.conclusion)


WORDS = {"initial_turning_track": "initial turning"}


def _interval(ends: Sequence[float] | None, unit: str) -> str:
    if ends is None:
        return ""
    digits = 1 if unit == "deg" else 2
    return " .. ".join(f"{end:.{digits}f}" if end < float("inf") else "never" for end in ends)


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    return f"{value:.1f} deg" if unit == "deg" else f"{value:.2f} L" if unit == "L" else f"{value:+.3f}"
