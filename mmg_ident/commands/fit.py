"""``mmg fit``: calibrate a ship on trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from fitting.settings import Settings
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, name_fault
from mmg.messages import has_code
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli
from mmg_ident.settings import names_of

if TYPE_CHECKING:
    from fitting.result import FitResult

OPEN = ("starts_left_out", "parts_left_out")  # Codes of warnings of a converged calibration that --resume goes on with


@o.options(
    Settings,
    Model="with_ without only fix measurement per_run per_campaign captive",
    Estimate="loss weight sigma captive_sigma estimator",
    Uncertainty="bootstrap profile posterior next_trial",
    Solver="window step starts seed max_iterations time_limit workers scheduler",
)
def fit(
    ship: o.Ship,
    trials: o.Trials,
    out: o.RunFolder,
    settings: o.Given,
    validate: o.Validate = None,
    name: Annotated[str, Option(help="Name of the calibration; default the folder's.")] = "",
    with_: Annotated[list[str] | None, Option("--with", help="Free an effect: NAME, or NAME:held=value,freed.")] = None,
    without: o.Without = None,
    only: Annotated[list[str] | None, Option(help="Free only these coefficients: Y_v,N_v.")] = None,
    fix: Annotated[list[str] | None, Option(help="Coefficients to leave alone: Y_v,N_v.")] = None,
    measurement: Annotated[
        str, Option(help="Instruments to fit along, or none; default those the trials show.")
    ] = "shown",
    per_run: Annotated[list[str] | None, Option(help="Effect whose constants differ by run: current.")] = None,
    per_campaign: Annotated[list[str] | None, Option(help="Instruments to fit by campaign, or none.")] = None,
    captive: Annotated[Path | None, Option(help="Table of captive tests u,v,r,n,delta,X,Y,N.")] = None,
    captive_sigma: Annotated[str | None, Option(help="Of captive X,Y [N],N [N m]; default 3 % rms.")] = None,
    estimator: Annotated[str, Option(help="windows: multiple shooting alone; default both.")] = "both",
    bootstrap: Annotated[int, Option(min=0, help="Refits to runs drawn with replacement.")] = 0,
    profile: Annotated[list[str] | None, Option(help="Profile the likelihood of coefficients.")] = None,
    posterior: Annotated[int, Option(min=0, help="Draws from the posterior, by NUTS.")] = 0,
    next_trial: Annotated[bool, Option(help="Do not look for the trial that tells most.")] = True,
    scheduler: o.Scheduler = None,
    resume: o.Resume = False,
    unchecked: o.Unchecked = False,
    no_report: o.NoReport = False,
    json: o.Json = False,
) -> int:
    """Calibrate a ship on trials by multiple shooting and IPOPT.

    Example: mmg fit esso_osaka_3m trials/ --validate held_out/ --out runs/first
    """
    from cases.shipfiles.effects import reduced_ship
    from cases.shipfiles.ship_file import load_ship
    from cases.trial_set import ready
    from fitting.calibrate import FitOptions
    from fitting.report.run_folder import check_target, reserved
    from fitting.result import read_fit
    from fitting.settings import check_estimator
    from fitting.solvers.control import LEFT_OUT, interrupts_noted
    from mmg_ident.api import calibrate

    # options and the folder are judged first: to read the trials takes longer than all of it
    check_estimator(estimator)
    if "weight" in settings and "sigma" in settings:
        raise Conflict("--run-weight: with --sigma the weight of the runs is given; leave one of them out")
    if captive_sigma and not captive:
        raise Conflict("--captive-sigma: there is no --captive to which it belongs")
    captive_std = cli.numbers_of(captive_sigma, 3, "--captive-sigma") if captive_sigma else None
    if captive_std and min(captive_std) <= 0:
        raise OutOfRange(f"--captive-sigma {captive_sigma}: X, Y [N] and N [N m] must be positive")
    if fault := name_fault(name):
        raise BadValue(f"--name {name!r}: {fault}")
    earlier = read_fit(out) if resume and out.exists() else None
    if earlier and earlier.iterate is None and not earlier.converged:
        raise Missing(f"{out}: no iterate to resume from; start again without --resume")
    if earlier and earlier.converged and not any(has_code(earlier.warnings, code) for code in OPEN):
        cli.say(f"{out} has converged already; nothing to resume")
        return 0
    if not earlier:
        check_target(out)
    # a resumed run begins at the ship that the interrupted one began at: its priors are hers, not of the iterate
    start = earlier.start if earlier else load_ship(ship)
    # --with is split by nobody: the parameters of an effect have commas of their own
    start = reduced_ship(start, names_of(without), with_ or (), names_of(fix), names_of(only))
    train, held_out = ready(trials, validate or (), unchecked=unchecked)
    options = FitOptions(
        resume=earlier,
        command=cli.command_line(),
        # without --name a resumed run keeps the name it was given; one that is still her start's was given none
        name=name or (earlier.ship.name if earlier and earlier.ship.name != earlier.start.name else ""),
    )
    given: dict[str, Any] = {
        "bootstrap": bootstrap, "profile": profile, "posterior": posterior, "next_trial": next_trial,
        "per_run": per_run, "per_campaign": per_campaign, "measurement": measurement, "estimator": estimator,
        "captive": captive, "captive_sigma": captive_std,
    }  # fmt: skip
    for line in start.notices:
        cli.say(line)
    with (
        interrupts_noted(lambda: cli.say("interrupted: stopping at the next iterate and writing the run folder")),
        reserved(out),
    ):
        result = calibrate(start, train, held_out, Settings(**settings), options, cli.progress(), **given)
        earlier_warnings = result.warnings
        result = result.save(out, replace=resume, numbers=None if json else _summary, report=not no_report)
        if json:
            cli.print_json(result.to_dict())
        else:
            for line in result.warnings:  # those of figures and page, which come last
                if line not in earlier_warnings:
                    cli.say(f"warning: {line}")
            cli.say(f"run folder: {out} ({cli.those_in(out, 'ship.toml result.json report.html')})")
    # a failure though the folder is whole: a script that goes on with a ship that diverges would not notice
    cli.refuse_no_score(result.warnings, out)
    if has_code(result.warnings, LEFT_OUT):  # Ctrl-C after the solve: coefficients are whole, parts of the rest lack
        return 130
    return 0 if result.converged else 130 if result.status == "User_Requested_Stop" else 1


def _summary(result: FitResult) -> None:
    """A few lines for a person, before figures and page are made."""
    from fitting.identifiability.analysis import KINDS

    words = "converged" if result.converged else "NOT CONVERGED"
    constants = result.calibration.constants if result.calibration else None
    whose = "campaigns" if result.campaigns and result.campaigns["values"] else "runs"
    of_runs = f" and {len(constants.p)} constants of {whose}" if constants else ""
    cli.say(
        f"{words} ({result.status}) after {sum(p.iterations for p in result.passes)} iterations "
        f"in {result.timings_s['total']:.1f} s; objective {result.objective or float('nan'):.6g}; "
        f"{len(result.estimates)} free coefficients{of_runs}, {result.seconds_used:.0f} s of data, "
        f"seed {result.settings.seed}"
    )
    cli.say_remarks(result)
    if constants:
        columns = (f"{s} [{unit}]" if unit else s for s, unit in zip(constants.symbols, constants.units, strict=True))
        rows = [
            (run, *(f"{cell['value']:.4g} +- {cell['std']:.2g}" for cell in cells.values()))
            for run, cells in constants.rows().items()
        ]
        for line in cli.table_lines(("", *columns), rows):
            cli.say(line)
    for test in result.effects or ():
        if not test.in_doubt:  # else it was said as a warning
            cli.say(test.sentence)
    cli.say_scores(result.scores)
    kinds = result.identifiability["counts"]
    cli.say("coefficients: " + ", ".join(f"{count} {KINDS[kind]}" for kind, count in kinds.items()))
    if name := result.identifiability.get("next_trial", {}).get("overall"):
        cli.say(f"next trial that would determine most: {name}")
    if result.ship.mark:
        cli.say(f"name: {result.ship.title}")
