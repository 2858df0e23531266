"""``mmg fit``: calibrate a ship on trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg.errors import UserError, name_fault
from mmg.messages import has_code
from mmg_ident.commands.output import (
    command_line,
    names_of,
    numbers_of,
    print_json,
    progress,
    refuse_no_score,
    say,
    say_remarks,
    scores_in_words,
    ship_names,
    units_in_words,
)

if TYPE_CHECKING:
    from fitting.nlp.captive import Captive
    from fitting.result import FitResult
    from fitting.settings import Settings
    from mmg.messages import Message


OPEN = ("starts_left_out", "parts_left_out")
"""Codes of warnings of a converged calibration that --resume goes on with."""


def fit(
    ship: Annotated[
        str, Argument(help="Ship to start from: library name, ship file or run folder.", autocompletion=ship_names)
    ],
    trials: Annotated[list[Path], Argument(help="Trial files, or folders of them.")],
    out: Annotated[Path, Option(help="Run folder to write; it must not exist.")],
    validate: Annotated[
        list[Path] | None, Option(help="Held-out trials to score before and after; several may follow.")
    ] = None,
    name: Annotated[
        str, Option(help="Of the ship and this calibration, in every output; default that of the run folder.")
    ] = "",
    without: Annotated[
        list[str] | None, Option(help="Leave a component or effect out of the model, such as wind.")
    ] = None,
    with_: Annotated[
        list[str] | None,
        Option("--with", help="Free an effect (see mmg effects): NAME, or NAME:held=value,freed. May be repeated."),
    ] = None,
    measurement: Annotated[
        str, Option(help="Effects of the instruments that are fitted along: velocity_filter, or several, or none.")
    ] = "velocity_filter",
    per_run: Annotated[
        list[str] | None,
        Option(help="Give each run its own constants of an effect: current, or NAME:parameter=prior. May be repeated."),
    ] = None,
    per_campaign: Annotated[
        list[str] | None,
        Option(help="Instruments that may differ by campaign: gyro, log_scale, or none; default: both."),
    ] = None,
    fix: Annotated[list[str] | None, Option(help="Coefficients to leave alone (comma-separated).")] = None,
    only: Annotated[list[str] | None, Option(help="Free only these coefficients (comma-separated).")] = None,
    window: Annotated[float | None, Option(help="Window length [s]; default the horizon, else 100 steps.")] = None,
    horizon: Annotated[
        float | None,
        Option(help="Time over which the ship is to predict [s]: windows as long, or as runs left out say."),
    ] = None,
    step: Annotated[float | None, Option(help="Integration and sampling step [s]; default a twentieth of L/U.")] = None,
    interval: Annotated[int, Option(help="Steps per shooting interval.")] = 5,
    starts: Annotated[int, Option(help="Starts of the final solve (1: the prior).")] = 1,
    workers: Annotated[int, Option(help="Processes over which further starts are spread.")] = 1,
    scheduler: Annotated[
        str | None, Option(help="Dask scheduler, as tcp://host:8786: its workers do the tasks.", metavar="ADDRESS")
    ] = None,
    sigma: Annotated[str | None, Option(help="Fixed residual sigma x,y,psi,u,v,r instead of estimated ones.")] = None,
    seed: Annotated[int, Option(help="Seed of the random starts.")] = 0,
    tolerance: Annotated[float, Option(help="IPOPT's tolerance.")] = 1e-6,
    max_iterations: Annotated[int, Option(help="IPOPT's limit per solve.")] = 300,
    time_limit: Annotated[float | None, Option(help="Wall-clock limit of the calibration [s].")] = None,
    bootstrap: Annotated[int, Option(help="Refits to runs drawn with replacement, over --workers processes.")] = 0,
    profile: Annotated[list[str] | None, Option(help="Profile the likelihood of these coefficients.")] = None,
    resume: Annotated[
        bool, Option("--resume", help="Continue an interrupted run in --out from its best iterate.")
    ] = False,
    compiled: Annotated[bool, Option(help="Use a C compiler if there is one.")] = True,
    next_trial: Annotated[bool, Option(help="Name the trials that would determine what is left open.")] = True,
    loss: Annotated[
        str, Option(help="What a residual costs: gaussian, or huber or student, which outliers pull less.")
    ] = "gaussian",
    run_weight: Annotated[float, Option(help="Share of its information with which a run counts, above 0 to 1.")] = 1.0,
    estimator: Annotated[
        str,
        Option(
            help="windows: multiple shooting alone; both: the mean with what a Kalman filter says, as a rule better."
        ),
    ] = "both",
    captive: Annotated[
        Path | None, Option(help="Table of captive-test points u,v,r,n,delta,X,Y,N whose forces are fitted too.")
    ] = None,
    captive_sigma: Annotated[
        str | None, Option(help="Standard deviations X,Y [N],N [N m] of captive forces; default 3 % rms.")
    ] = None,
    unchecked: Annotated[
        bool,
        Option(
            "--unchecked",
            "--accept-contradictory",
            help="Fit also files that mmg check calls contradictory, and broken stretches.",
        ),
    ] = False,
    report: Annotated[bool, Option(help="With figures and page, after the numbers.")] = True,
    json: Annotated[bool, Option("--json", help="Print result.json on stdout.")] = False,
) -> int:
    """Calibrate a ship on trials by multiple shooting and IPOPT.

    Example: mmg fit esso_osaka_3m trials/*.csv --validate held_out.csv --out runs/first
    """
    import time
    from dataclasses import replace

    from cases.checks import ready
    from cases.io.read import read_trials
    from cases.shipfiles.model_changes import reduced_ship
    from cases.shipfiles.ship_file import load_ship
    from fitting.calibrate import FitOptions
    from fitting.report.run_folder import check_target, reserved
    from fitting.settings import check_estimator
    from fitting.solvers.interrupts import LEFT_OUT, interrupts_noted
    from mmg_ident.api import calibrate

    began = time.perf_counter()
    settings = _settings(
        window=window,
        horizon=horizon,
        step=step,
        interval=interval,
        starts=starts,
        workers=workers,
        sigma=sigma,
        seed=seed,
        tolerance=tolerance,
        max_iterations=max_iterations,
        time_limit=time_limit,
        compiled=compiled,
        loss=loss,
        weight=run_weight,
    )
    check_estimator(estimator)
    points = _captive_points(captive, captive_sigma)
    if name_fault(name):
        raise UserError(f"--name {name!r}: {name_fault(name)}")
    earlier = _resumed(out) if resume and out.exists() else None
    if earlier and earlier.converged and not any(has_code(earlier.warnings, code) for code in OPEN):
        say(f"{out} has converged already; nothing to resume")
        return 0
    if not earlier:
        check_target(out)
    start = earlier.start if earlier else load_ship(ship)
    start = reduced_ship(start, names_of(without), with_ or (), names_of(fix), names_of(only))
    train, held_out = read_trials(trials), read_trials(validate) if validate else []
    train, held_out = ready(train, held_out, unchecked=unchecked)
    options = FitOptions(
        bootstrap=bootstrap,
        profile=tuple(names_of(profile)),
        next_trial=next_trial,
        per_run=tuple(per_run or ()),
        per_campaign=tuple(names_of(per_campaign)),
        instruments=tuple(names_of([measurement])),
        captive=points,
        resume=earlier,
        command=command_line(),
        name=name or _own_name(earlier),
        estimator=estimator,
    )
    reading = time.perf_counter() - began
    for line in start.notices:
        say(line)
    with (
        interrupts_noted(lambda: say("interrupted: stopping at the next iterate and writing the run folder")),
        reserved(out),
    ):
        result = calibrate(start, train, held_out, settings, options, progress())
        timings = {**result.timings_s, "read": reading, "wall": result.timings_s["wall"] + reading}
        result = replace(result, timings_s=timings)
        earlier_warnings = result.warnings
        result = result.save(out, replace=resume, numbers=None if json else _summary, report=report)
        _ended(result, out, earlier_warnings) if not json else print_json(result.to_dict())
    refuse_no_score(result.warnings, out)
    if has_code(result.warnings, LEFT_OUT):
        return 130
    if result.converged:
        return 0
    return 130 if result.status == "User_Requested_Stop" else 1


def _settings(sigma: str | None, **values: Any) -> Settings:
    """Settings from the options ``values`` by name, and ``sigma``: six numbers."""
    from fitting.nlp.loss import LOSSES
    from fitting.settings import Settings

    for name in ("window", "horizon", "step", "tolerance", "time_limit"):
        if values[name] is not None and not values[name] > 0:
            raise UserError(f"--{name.replace('_', '-')} {values[name]:g} must be positive")
    for name, least in (("interval", 1), ("starts", 1), ("workers", 1), ("max_iterations", 0)):
        if values[name] < least:
            raise UserError(f"--{name.replace('_', '-')} {values[name]} must be at least {least}")
    if values["loss"] not in LOSSES:
        raise UserError(f"--loss {values['loss']}: unknown; choose one of {', '.join(LOSSES)}")
    if not 0 < (weight := values["weight"]) <= 1:
        raise UserError(f"--run-weight {weight:g} must be above 0 and at most 1")
    if weight != 1 and sigma:
        raise UserError("--run-weight: with --sigma the weight of the runs is given; leave one of them out")
    return Settings(sigma=numbers_of(sigma, 6, "--sigma") if sigma else None, **values)


def _own_name(earlier: FitResult | None) -> str:
    """The name that an interrupted run was given, "" for none."""
    return earlier.ship.name if earlier and earlier.ship.name != earlier.start.name else ""


def _resumed(out: Path) -> FitResult:
    """The interrupted run in the folder ``out``."""
    from fitting.result import read_fit

    found = read_fit(out)
    if found.iterate is None and not found.converged:
        raise UserError(f"{out}: no iterate to resume from; start again without --resume")
    return found


def _captive_points(path: Path | None, sigma: str | None) -> Captive | None:
    """Captive points of the file ``path``, with standard deviations ``sigma``: "X,Y [N],N [N m]"; None without one."""
    from fitting.nlp.captive import read_captive

    if path is None:
        if sigma:
            raise UserError("--captive-sigma: there is no --captive to which it belongs")
        return None
    given = numbers_of(sigma, 3, "--captive-sigma") if sigma else None
    if given and min(given) <= 0:
        raise UserError(f"--captive-sigma {sigma}: X, Y [N] and N [N m] must be positive")
    return read_captive(path, given)


def _ended(result: FitResult, out: Path, said: Sequence[Message]) -> None:
    """The last lines for a person, when figures and page are made: warnings that were not ``said`` before."""
    from fitting.report.run_folder import PAGE

    for line in result.warnings:
        if line not in said:
            say(f"warning: {line}")
    say(f"run folder: {out} (ship.toml, result.json{', report.html' if (out / PAGE).exists() else ''})")


def _summary(result: FitResult) -> None:
    """A few lines for a person, while the figures are still made."""
    from fitting.identifiability.analysis import KINDS

    words = "converged" if result.converged else "NOT CONVERGED"
    constants = result.calibration.constants if result.calibration else None
    whose = "campaigns" if result.campaigns and result.campaigns["values"] else "runs"
    own = f" and {len(constants.p)} constants of {whose}" if constants else ""
    say(
        f"{words} ({result.status}) after {sum(p.iterations for p in result.passes)} iterations "
        f"in {result.timings_s['total']:.1f} s; objective {result.objective or float('nan'):.6g}; "
        f"{len(result.coefficients)} free coefficients{own}, {result.seconds_used:.0f} s of data, "
        f"seed {result.settings.seed}"
    )
    say_remarks(result)
    for row in constants.table() if constants else []:
        say(row)
    for test in result.effects or ():
        if not test.in_doubt:  # else it was said as a warning
            say(test.sentence)
    if result.effects:
        wall = result.timings_s["wall"]
        say(f"effects tested in {result.timings_s['effects']:.1f} s ({result.timings_s['effects'] / wall:.0%} of all)")
    for name, pair in result.scores.items():
        say(f"{name}: {scores_in_words(pair.before, pair.after)}")
        if words := units_in_words(pair.before, pair.after):
            say(f"{name}: {words}")
    kinds = result.identifiability["counts"]
    say("coefficients: " + ", ".join(f"{count} {KINDS[kind]}" for kind, count in kinds.items()))
    plan = result.identifiability.get("next_trial", {}).get("plan", [])
    if plan:
        say(f"next trial that would determine most: {plan[0]['name']}")
    if result.ship.mark:
        say(f"name: {result.ship.title}")
