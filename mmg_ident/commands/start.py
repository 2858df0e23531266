"""``mmg start``: from raw logs to a calibrated ship, her figures, a report and an FMU."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg.errors import Missing, UserError
from mmg.messages import has_code
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from cases.importing.import_map import ImportMap
    from fitting.report.use import Delivered
    from fitting.result import FitResult
    from mmg_ident.start import Answers, StartedRun


def start(
    logs: Annotated[list[Path], Argument(help="Raw logs or trial files, or folders of them.", metavar="LOGS...")],
    out: Annotated[Path, Option(help="Folder for trials, run, answers.toml and ship.fmu.")],
    ship: Annotated[str | None, Option(help="Library ship, ship file or run folder.")] = None,
    particulars: Annotated[str | None, Option(help="L,B,d,C_b[,NAME=VALUE], SI, instead of --ship.")] = None,
    map: Annotated[Path | None, Option("--map", help="What the headers leave unsaid, as of mmg import.")] = None,
    yes: Annotated[bool, Option("--yes", help="Ask nothing: what nobody says is unknown.")] = False,
    answers: Annotated[Path | None, Option(help="File with answers, as answers.toml of another call.")] = None,
    resume: Annotated[bool, Option("--resume", help="Go on in --out; the same call without it does so too.")] = False,
    json: o.Json = False,
) -> int:
    """Import logs, check them, calibrate a ship, judge her by IMO, write report and FMU: one call, nothing edited.

    Example: mmg start logs/ --particulars 120,19,7,0.72,D_P=4.8 --out ship_120

    On a terminal it asks at most five questions, on what the data do not tell: antenna, draught, depth, current, rudder
    rate. The same call again goes on where one ended.
    """
    from cases.trial_set import ready
    from delivery.export import export_ship
    from fitting.report.use import delivered
    from fitting.result import write_report
    from fitting.solvers.control import LEFT_OUT, interrupts_noted
    from mmg_ident import start as steps
    from mmg_ident.studies import import_map

    known = steps.read_answers(answers) if answers else steps.Answers()
    chosen = import_map(map) if map else None
    steps.with_answers(steps.starting_ship(ship, particulars, known.draught), known)  # refused before anything is made
    missing = next((path for path in logs if not path.exists()), None)
    if missing is not None:
        raise Missing(f"{missing}: no such file or folder")
    # by the ship without the draught that a person answers: the same call again has asked for none yet
    mark = steps.digest([*logs, *([map] if map else [])], steps.starting_ship(ship, particulars))
    before = steps.check_folder(out, mark, known if answers else None)
    if resume and before is None:
        raise Missing(f"--out {out}: nothing to resume there")
    ask = not (yes or json) and sys.stdin.isatty() and sys.stderr.isatty()  # with --json nobody reads a question
    if before is None:
        steps.write_mark(out, mark)
    if not (out / steps.TRIALS).is_dir():
        try:
            _import(logs, chosen, out / steps.TRIALS, ask)
        except UserError:
            steps.take_back(out)
            raise
    if before is not None and before.is_asked:  # else the folder has only its mark: the import was stopped
        known, asked = before, tuple(before.record["asked"])
    else:
        known, asked = _begin(out, ship, particulars, known, answers is not None, ask)
    start_ship = steps.with_answers(steps.starting_ship(ship, particulars, known.draught), known)
    (trials,) = ready([out / steps.TRIALS])
    started = steps.StartedRun(out, start_ship, tuple(trials.sound), known, asked)
    if before is None or not before.is_asked:
        steps.write_answers(started, mark, cli.command_line())
    with interrupts_noted(lambda: cli.say("interrupted: stopping at the next iterate; the same call goes on")):
        result = steps.fitted(started, cli.command_line(), cli.progress())
    if has_code(result.warnings, LEFT_OUT) or result.status == "User_Requested_Stop":
        return 130
    cli.refuse_no_score(result.warnings, out / steps.RUN)
    steps.write_answers(started, mark, cli.command_line(), result.ship)  # again, with what her trials showed
    with cli.working("simulating the standard manoeuvres"):
        known_of = delivered(result.to_dict(), result.ship)  # once: for the page and for what is printed
        write_report([out / steps.RUN], out / steps.RUN / "report.html", known=[known_of])
    if result.converged and not (out / steps.FMU).exists():
        with cli.working("exporting the FMU"):
            export_ship(out / steps.RUN, "fmu", out / steps.FMU)
    if json:
        cli.print_json(_content(result, known_of, out))
    else:
        _print(result, known_of, started, out)
    return 0 if result.converged else 1


def _import(logs: list[Path], chosen: ImportMap | None, folder: Path, ask: bool) -> None:
    """The trials of the ``logs`` in a new ``folder``, by the map ``chosen`` where there is one."""
    from cases.importing.import_logs import write_import
    from cases.importing.import_map import ImportMap
    from mmg_ident import start as steps
    from mmg_ident.commands.import_ import imported

    if chosen is None and steps.are_trials(logs):
        folder.parent.mkdir(parents=True, exist_ok=True)
        steps.copy_trials(logs, folder)
        return
    logged, chosen = imported(logs, chosen or ImportMap(), ask)
    with cli.working("writing trials"):
        files = write_import(logged, chosen, folder)
    cli.say(f"imported: {len(files)} runs, {folder}")


def _begin(
    folder: Path, ship: str | None, particulars: str | None, known: Answers, given: bool, ask: bool
) -> tuple[Answers, tuple[str, ...]]:
    """The answers, with those of a person where there is one to ``ask``, and which were given; what they say of the
    trials goes into the sidecars of these."""
    import typer

    from cases.io.read import read_trials
    from mmg_ident import start as steps

    place = folder / steps.TRIALS
    # of a file of answers those count as given that differ from what is assumed
    asked = [name for name, value in known.given.items() if given and value != getattr(steps.Answers(), name)]
    if ask:
        first = steps.starting_ship(ship, particulars, known.draught)
        is_known = steps.antenna_is_known(place)
        for name, words, default in steps.questions(first, read_trials([place]), particulars is not None, is_known):
            while name not in asked:  # until an answer can be read
                text = str(typer.prompt(words, default=default, err=True))
                try:
                    known = steps.answered(known, name, text)
                    asked.append(name)
                except UserError as error:
                    cli.say(f"  {error}")
    if not isinstance(known.antenna, str):
        x, y = known.antenna
        steps.write_sidecars(place, {"reference_point": {"x": x, "y": y, "applies_to": "both"}})
    if not isinstance(known.depth, str):
        steps.write_depth(place, known.depth)
    return known, tuple(asked)


def _print(result: FitResult, known: Delivered, started: StartedRun, out: Path) -> None:
    """The first screen of the report, what was measured, and where everything lies."""
    from fitting.report.use import first_screen, use_rows
    from mmg_ident import start as steps

    print(f"{result.ship.title}: {len(started.trials) or len(result.data)} trials, {result.seconds_used:.0f} s")
    use = use_rows(result.envelope or {}, result.ship, any(trial.has_wind for trial in known.trials))
    screen = first_screen(result.to_dict(), result.ship, known, *use)
    cli.print_wrapped("! " if screen.doubtful else "", f"{screen.verdict} {screen.errors}")
    for cause in screen.causes:
        cli.print_wrapped("  look first at: ", cause)
    if screen.rows:
        cli.print_table(*screen.by_side)
    cli.print_wrapped("", screen.note)
    for message in result.messages:
        # notices of the ship are the rules of thumb below
        if message.code != "ship" and message.text not in screen.verdict:
            cli.print_wrapped("! ", message.text)
    sections = {"use her for": screen.good, "not for": screen.bad, "by rule of thumb": screen.rules}
    for title, sentences in sections.items():
        if sentences:
            cli.print_wrapped(f"{title}: ", "; ".join(sentences))
    for name, words in steps.measured_particulars(result.ship).items():
        cli.print_wrapped("measured: ", f"{name} {words}")
    place: dict[str, Path | str] = {"report": out / steps.RUN / "report.html", "ship": out / steps.RUN / "ship.toml"}
    fmu = out / steps.FMU
    place |= {"FMU": fmu if fmu.exists() else "none, as the calibration did not converge"}
    for name, path in {**place, "answers": out / steps.ANSWERS}.items():
        print(f"{name}: {path}")


def _content(result: FitResult, known: Delivered, out: Path) -> dict[str, Any]:
    """What --json prints."""
    from mmg_ident import start as steps

    rows = known.form.rows if known.form else ()
    figures = [
        # a row has two sides or one, which is then of neither
        {"manoeuvre": row.group, "figure": row.name, "unit": row.unit, "side": name, "verdict": side.verdict,
         "tested": side.tested and side.tested.value, "model": side.model and side.model.value,
         "interval_90": side.model and side.model.interval}
        for row in rows
        for name, side in zip(("port", "starboard") if len(row.sides) == 2 else ("",), row.sides, strict=True)
    ]  # fmt: skip
    fmu = str(out / steps.FMU) if (out / steps.FMU).exists() else None
    messages = [vars(m) for m in result.messages]
    return {"out": str(out), "converged": result.converged, "figures": figures, "fmu": fmu, "messages": messages}
