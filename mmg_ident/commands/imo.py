"""``mmg imo``: the standards for ship manoeuvrability, from a simulated ship or from measured runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from cases.criteria.imo import Row
    from cases.criteria.standard_runs import Run


def imo(
    ships_and_trials: Annotated[
        list[str],
        typer.Argument(help="A ship to simulate, or measured trial files and folders.", metavar="SHIP|TRIAL..."),
    ],
    speed: Annotated[
        float | None,
        typer.Option("--speed", help="Test speed [m/s]; default U_0 of the ship file, else Froude number 0.142."),
    ] = None,
    rudder_rate: Annotated[
        float | None,
        typer.Option("--rudder-rate", help="[deg/s]; default the ship's own, else 20 for a 3 m model, Froude scaled."),
    ] = None,
    maneuver: Annotated[
        list[str] | None,
        typer.Option("--maneuver", help="Simulate also this, such as spiral:15/5 or pull-out:20; may be repeated."),
    ] = None,
    ship: Annotated[str | None, typer.Option("--ship", help="Ship of the trial files: gives L and its name.")] = None,
    length: Annotated[float | None, typer.Option("--length", help="L of the trial files' ship [m].")] = None,
    kind: Annotated[
        str, typer.Option("--kind", help="Read the trials as turning, zigzag or crash-stop; default from the data.")
    ] = "",
    scale: Annotated[
        float | None,
        typer.Option(
            "--scale",
            help="Of a model, ship length over model length (default: the ship file's): judged at ship scale.",
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Figure to write (.png, .svg or .pdf).")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="New folder for imo.json, imo.png and the simulated runs as CSV.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Judge a ship by IMO MSC.137(76): turning, initial turning, yaw checking, stopping; pass or fail per figure.

    A ship is simulated in calm air and deep water (turning +-35, zigzags +-10/10 and +-20/20, crash stop). Of measured
    runs the approach is cut off, and what cannot be judged says why.

    Example: mmg imo kvlcc2_full --plot imo.png
    """
    from cases.criteria.imo import ASSUMED, OPEN, Row, assess, worst
    from cases.criteria.published_figures import SOURCE
    from mmg.errors import UserError
    from mmg_ident.commands.output import is_model, print_json, say

    models = [a for a in ships_and_trials if is_model(a)]
    files = [a for a in ships_and_trials if not is_model(a)]
    if models and (files or len(models) > 1):
        raise UserError("give one ship to simulate, or trial files (with --ship or --length), not both")
    _check(speed, rudder_rate, length, scale, kind)
    _check_targets(plot, out, force)
    if models:
        own: dict[str, object] = {"--ship": ship, "--length": length, "--kind": kind or None}
        for option in [name for name, value in own.items() if value is not None]:
            raise UserError(f"{option} belongs to trial files; {models[0]} is simulated")
        who, runs, heading, notices, missed = _simulated(models[0], speed, rudder_rate, maneuver or [])
    else:
        own = {"--speed": speed, "--rudder-rate": rudder_rate, "--maneuver": maneuver or None}
        for option in [name for name, value in own.items() if value is not None]:
            raise UserError(f"{option} belongs to a ship that is simulated; trial files have their own")
        who, runs, heading, notices = _measured(files, ship, length, kind)
        missed = {}
    scale = scale or _own_scale(models[0] if models else ship)
    rows = [row for run in runs for row in assess(run, scale, who)]
    rows += [Row("", text, "no figure", None, None, "", OPEN, why) for text, why in missed.items()]
    verdict = worst(rows)
    notices += [f"reference: {SOURCE}"] if any(row.reference is not None for row in rows) else []
    notices.append(ASSUMED)
    data = _document(who, heading, verdict, rows, runs, notices)
    _write(plot, out, data, runs, heading)
    if json:
        print_json(data)
        return
    _print(heading, rows, runs, notices, verdict)
    for path in filter(None, (plot, out)):
        say(f"written: {path}")


def _own_scale(ship: str | None) -> float | None:
    """The scale that a ship file gives for a model, None without one."""
    from cases.shipfiles.ship_file import load_ship

    return load_ship(ship).particulars.get("scale") if ship else None


def _check(
    speed: float | None, rudder_rate: float | None, length: float | None, scale: float | None, kind: str
) -> None:
    import math

    from cases.criteria.measured_maneuvers import KINDS
    from mmg.errors import UserError

    given = (("--speed", speed), ("--rudder-rate", rudder_rate), ("--length", length), ("--scale", scale))
    for name, value in given:
        if value is not None and not (math.isfinite(value) and value > 0):
            raise UserError(f"{name} {value:g} must be positive")
    if kind and kind not in KINDS:
        raise UserError(f"--kind {kind!r} is unknown; use {', '.join(KINDS)}")


def _check_targets(plot: Path | None, out: Path | None, force: bool) -> None:
    """Everything about the output that can be refused before simulating."""
    from mmg.errors import UserError

    if plot is not None:
        if plot.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise UserError(f"--plot {plot}: figures end in .png, .svg or .pdf")
        if plot.exists() and (plot.is_dir() or not force):
            raise UserError(f"--plot {plot}: exists already; choose another name or add --force")
        if not plot.parent.is_dir():
            raise UserError(f"--plot {plot}: there is no folder {plot.parent}")
    if out is not None and out.exists() and not (out.is_dir() and (force or not any(out.iterdir()))):
        raise UserError(f"--out {out}: exists already; name a new folder or add --force")


def _simulated(
    model: str, speed: float | None, rudder_rate: float | None, more: list[str]
) -> tuple[str, list[Run], str, list[str], dict[str, str]]:
    """Ship name, runs, the line that heads the table, notices; manoeuvres that miss their event, and why.

    Raises UserError for a text that names no manoeuvre, and when no manoeuvre reaches its event.
    """
    import math

    from cases.criteria.standard_runs import STANDARD, approach_speed, simulated_run
    from cases.maneuvers.controller import Limits
    from cases.maneuvers.definitions import parse_maneuver
    from cases.shipfiles.effects import calm_and_deep
    from cases.shipfiles.ship_file import load_ship
    from mmg.errors import UserError

    ship, left_out = calm_and_deep(load_ship(model))
    V, origin = approach_speed(ship, speed)
    rate = None if rudder_rate is None else math.radians(rudder_rate)
    texts = [*STANDARD, *[text for text in more if text not in STANDARD]]
    for text in more:
        if "order_time" not in parse_maneuver(text, ship, speed=V, rudder_rate=rate).parameters:
            raise UserError(
                f"--maneuver {text} has no order to judge; use turning, zigzag, spiral, pull-out, crash-stop"
            )
    runs, missed = [], {}
    for text in texts:
        try:
            runs.append(simulated_run(ship, text, V, rudder_rate=rate))
        except UserError as error:
            missed[text] = str(error)
    if not runs:
        raise UserError(next(iter(missed.values())))
    L = ship.particulars["L"]
    heading = f"{ship.name}, simulated: L {L:g} m, V {V:.4g} m/s, L/V {L / V:.3g} s"
    if "n" in ship.actuators:
        heading += f", n {runs[0].trial['n'][0]:.4g} rps"
    degrees = math.degrees(rate if rate is not None else Limits.for_ship(ship).rudder_rate)
    helm = (
        f"rudder rate {degrees:.3g} deg/s" if math.isfinite(degrees) else "the rudder moves as the ship's actuators do"
    )
    notices = [f"test speed V: {origin}; {helm}"]
    if left_out:
        notices.append(
            f"left out, as the tests are in calm, deep water and free of sensor errors: {', '.join(left_out)}"
        )
    return ship.name, runs, heading, notices, missed


def _measured(
    files: list[str], ship: str | None, length: float | None, kind: str
) -> tuple[str, list[Run], str, list[str]]:
    """Ship name, runs, heading, notices; a run of several in which no manoeuvre is found becomes a notice."""
    from cases.criteria.standard_runs import measured_run
    from cases.io.read import read_trials
    from cases.shipfiles.ship_file import load_ship
    from mmg.errors import UserError

    if ship is None and length is None:
        raise UserError("trial files need the length of their ship: --ship SHIP or --length METRES")
    model = load_ship(ship) if ship is not None else None
    L = length if length is not None else model.particulars["L"] if model else 0.0
    trials, runs, notices = read_trials(files), [], []
    for trial in trials:
        try:
            runs.append(measured_run(trial, L, kind))
        except UserError as error:
            if len(trials) == 1:
                raise
            notices.append(f"left out: {error}")
    if not runs:
        raise UserError(f"no standard manoeuvre in any of {len(trials)} trials; first: {notices[0]}")
    name = model.name if model else ""
    return name, runs, f"{name or 'ship'}, measured: L {L:g} m, {len(runs)} of {len(trials)} runs", notices


def _document(
    ship: str, heading: str, verdict: str, rows: list[Row], runs: list[Run], notices: list[str]
) -> dict[str, Any]:
    """What --json prints: SI and rad for figures, L and deg in the table."""
    from dataclasses import asdict

    return {
        "ship": ship,
        "heading": heading,
        "standard": "IMO MSC.137(76)",
        "verdict": verdict,
        "rows": [asdict(row) for row in rows],
        "runs": [
            {
                "name": run.name,
                "kind": run.kind,
                "measured": run.measured,
                "order_time_s": run.order_time,
                "rudder_rad": run.rudder,
                "switch_heading_rad": run.heading,
                "speed_m_s": run.speed,
                "length_m": run.length,
                "figures": dict(run.figures),
                "notes": list(run.notes),
            }
            for run in runs
        ],
        "notices": notices,
    }


def _write(plot: Path | None, out: Path | None, data: dict[str, Any], runs: list[Run], title: str) -> None:
    """The figure, and the folder with table, figure and simulated runs."""
    import json

    from cases.simulation.simulate import write_trial
    from fitting.report.plot_maneuvers import save_figure
    from fitting.report.run_folder import plain
    from mmg.errors import UserError

    try:
        if plot is not None:
            save_figure(runs, title, plot)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            save_figure(runs, title, out / "imo.png")
            (out / "imo.json").write_text(json.dumps(plain(data), indent=2) + "\n", encoding="utf-8")
            for run in runs:
                if not run.measured:
                    write_trial(run.trial, out / f"{run.trial.name}.csv")
    except OSError as error:
        raise UserError(f"{error.filename or out or plot}: cannot be written ({error.strerror})") from None


def _print(heading: str, rows: list[Row], runs: list[Run], notices: list[str], verdict: str) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console() if sys.stdout.isatty() else Console(width=120)
    console.print(heading, markup=False, highlight=False, soft_wrap=True)
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    known = any(row.reference is not None for row in rows)
    table.add_column("run", overflow="fold")
    table.add_column("figure", no_wrap=True)
    for name in ("value", "limit", *(("reference",) if known else ())):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    remarks: dict[str, int] = {}
    last = ""
    for row in rows:
        if row.run != last:
            table.add_row()
        mark = f" [{remarks.setdefault(row.why, len(remarks) + 1)}]" if row.why else ""
        figure = WORDS.get(row.figure, row.figure.replace("_", " "))
        cells = ["" if row.run == last else row.run, figure, _number(row.value, row.unit), _number(row.limit, row.unit)]
        cells += [_number(row.reference, row.unit)] if known else []
        table.add_row(*cells, (row.verdict + mark).replace("[", "\\["), style=STYLE.get(row.verdict))
        last = row.run
    console.print(table)
    console.print()
    for words, k in remarks.items():
        console.print(f"[{k}] {words}", markup=False, highlight=False, soft_wrap=True)
    for note in notices:
        console.print(f"note: {note}", markup=False, highlight=False, soft_wrap=True)
    console.print(f"IMO MSC.137(76): {verdict}", markup=False, highlight=False)


WORDS = {"initial_turning_track": "initial turning"}
STYLE = {"fail": "bold red", "not judged": "yellow"}


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    return f"{value:.1f} deg" if unit == "deg" else f"{value:.2f} L" if unit == "L" else f"{value:+.3f}"
