"""``mmg fit``: calibrate a ship on trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cases.trial import Trial
    from fitting.calibration import Calibration
    from mmg.ship import Ship


def fit(
    ship: Annotated[str, typer.Argument(help="Ship to start from: library name, ship file or run folder.")],
    trials: Annotated[list[Path], typer.Argument(help="Trial files, or folders of them.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write; it must not exist.")],
    validate: Annotated[
        list[Path] | None,
        typer.Option("--validate", help="Held-out trials to score before and after; several may follow."),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="Leave a component or effect out of the model, such as wind.")
    ] = None,
    with_: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            help="Free an effect (see mmg effects): NAME, or NAME:held=value,freed. May be repeated.",
        ),
    ] = None,
    measurement: Annotated[
        str,
        typer.Option(
            "--measurement",
            help="Effects of the instruments that are fitted along: velocity_lag, or several, or none.",
        ),
    ] = "velocity_lag",
    per_run: Annotated[
        list[str] | None,
        typer.Option(
            "--per-run",
            help="Give each run its own constants of an effect: current, or NAME:parameter=prior. May be repeated.",
        ),
    ] = None,
    fix: Annotated[
        list[str] | None, typer.Option("--fix", help="Coefficients to leave alone (comma-separated).")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Free only these coefficients (comma-separated).")
    ] = None,
    window: Annotated[float | None, typer.Option("--window", help="Window length [s]; default 100 steps.")] = None,
    step: Annotated[
        float | None,
        typer.Option("--step", help="Integration and sampling step [s]; default a twentieth of L/U."),
    ] = None,
    interval: Annotated[int, typer.Option("--interval", help="Steps per shooting interval.")] = 5,
    starts: Annotated[int, typer.Option("--starts", help="Starts of the final solve (1: the prior).")] = 1,
    workers: Annotated[int, typer.Option("--workers", help="Processes over which further starts are spread.")] = 1,
    sigma: Annotated[
        str | None,
        typer.Option("--sigma", help="Fixed residual sigma x,y,psi,u,v,r instead of estimated ones."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the random starts.")] = 0,
    tolerance: Annotated[float, typer.Option("--tolerance", help="IPOPT's tolerance.")] = 1e-6,
    max_iterations: Annotated[int, typer.Option("--max-iterations", help="IPOPT's limit per solve.")] = 300,
    time_limit: Annotated[
        float | None, typer.Option("--time-limit", help="Wall-clock limit of the calibration [s].")
    ] = None,
    bootstrap: Annotated[
        int, typer.Option("--bootstrap", help="Refits to runs drawn with replacement, over --workers processes.")
    ] = 0,
    profile: Annotated[
        list[str] | None, typer.Option("--profile", help="Profile the likelihood of these coefficients.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue an interrupted run in --out from its best iterate.")
    ] = False,
    compiled: Annotated[
        bool, typer.Option("--compiled/--no-compiled", help="Use a C compiler if there is one.")
    ] = True,
    next_trial: Annotated[
        bool,
        typer.Option("--next-trial/--no-next-trial", help="Name the trials that would determine what is left open."),
    ] = True,
    loss: Annotated[
        str, typer.Option("--loss", help="What a residual costs: gaussian, or robust to outliers huber or student.")
    ] = "gaussian",
    captive: Annotated[
        Path | None,
        typer.Option("--captive", help="Table of captive-test points u,v,r,n,delta,X,Y,N whose forces are fitted too."),
    ] = None,
    captive_sigma: Annotated[
        str | None,
        typer.Option("--captive-sigma", help="Standard deviations X,Y [N],N [N m] of captive forces; default 3 % rms."),
    ] = None,
    auto: Annotated[
        bool, typer.Option("--auto", help="Choose the model by cross-validation over runs (window, priors, loss, ...).")
    ] = False,
    auto_limit: Annotated[float, typer.Option("--auto-limit", help="Time for the choice [s].")] = 480.0,
    json: Annotated[bool, typer.Option("--json", help="Print result.json on stdout.")] = False,
) -> int:
    """Calibrate a ship on trials by multiple shooting and IPOPT.

    Example: mmg fit esso_osaka_3m trials/*.csv --validate held_out.csv --out runs/first
    """
    import shlex
    import sys
    import time
    from dataclasses import replace

    from cases.checks.held_out import shared_rows, training_trials
    from cases.io.read import read_trials
    from fitting.calibration import estimate_coefficients
    from fitting.design.advice import identifiability_dict
    from fitting.design.next_trial import identify
    from fitting.interrupts import Interrupts
    from fitting.prediction.band_calibration import enrich
    from fitting.report.run_folder import read_iterate, read_result, result, write_run
    from fitting.report.uncertainty import check_asked, uncertainty_rows
    from mmg.errors import UserError
    from mmg.rollout import Simulator
    from mmg_ident.commands.fit_input import (
        _captive,
        _chosen,
        _compare_hashes,
        _own_constants,
        _reduced,
        _settings,
        measuring,
    )
    from mmg_ident.commands.fit_input import _start as _starting
    from mmg_ident.commands.output import end_progress, names_of, print_json, progress, say

    began = time.perf_counter()
    settings = _settings(
        window=window,
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
    )
    points = _captive(captive, captive_sigma)
    if auto and resume:
        raise UserError("--auto cannot be resumed: repeat the choice as options, or start again without --resume")
    start = _starting(out, resume, ship)
    warm = None
    if resume and out.exists():
        if read_result(out)["converged"]:
            say(f"{out} has converged already; nothing to resume")
            return 0
        warm = read_iterate(out)
    start = _reduced(start, without, with_, fix, only)
    start = measuring(start, measurement)
    train, remarks = training_trials(read_trials(trials))
    held_out = read_trials(validate) if validate else []
    model, constants = _own_constants(start, per_run, train, auto)
    _compare_hashes(out, start, train, resume, constants)
    reading = time.perf_counter() - began
    check_asked(bootstrap, names_of(profile), start.free)
    for line in start.notices:
        say(line)
    with Interrupts(lambda: say("interrupted: stopping at the next iterate and writing the run folder")):
        choice = _chosen(start, train, settings, points, auto_limit) if auto else None
        if choice:
            start, settings = choice.ship, replace(choice.settings, workers=workers)
            model = start
        calibration = estimate_coefficients(model, train, settings, progress(), warm, points, constants)
        end_progress()
        calibration.timings["read"] = reading
        scores = _scores(start, calibration, train, held_out)
        command = "mmg " + " ".join(shlex.quote(a) for a in sys.argv[1:])
        content = result(calibration, train, held_out, scores, command)
        content |= uncertainty_rows(calibration, bootstrap, names_of(profile))
        content["warnings"] += [*remarks, *shared_rows(train, held_out), *_worse(scores)]
        found, trial = identify(calibration, next_trial and calibration.converged)
        content["identifiability"] = identifiability_dict(found, trial)
        if choice:
            content["auto"] = choice.to_rows()
            content["notices"] += list(choice.notices)
        enrich(Simulator(calibration.ship, settings.compiled), content, train, held_out)

        def decorate(folder: Path) -> None:
            from fitting.report.page import write_report
            from fitting.report.plot_identifiability import write_identifiability_figures
            from fitting.report.plots import write_figures
            from fitting.report.run_folder import RESULT, write_json

            content["figures"] = write_figures(folder, calibration, start, train, held_out)
            content["figures"] += write_identifiability_figures(
                folder, found, trial, content.get("profiles", ()), content["coefficients"]
            )
            content["timings_s"]["wall"] = time.perf_counter() - began
            write_json(folder / RESULT, content)
            write_report([folder], folder / "report.html")

        write_run(out, calibration, start, content, decorate, replace=resume)
        _summary(calibration, content, out) if not json else print_json(content)
    if calibration.converged:
        return 0
    return 130 if calibration.solution.status == "User_Requested_Stop" else 1


def _worse(scores: dict[str, dict]) -> list[str]:
    """Sentences on sets of trials that the calibrated ship predicts worse than the one it started from."""
    words = []
    for name, pair in scores.items():
        for metric, label in (("window", "30 s windows"), ("paper", "100 s restarts")):
            before, after = pair["before"][metric], pair["after"][metric]
            if after > 1.005 * before + 1e-6:
                words.append(f"{label} of the {name} trials became worse: {before:.4f} -> {after:.4f}")
    return words


def _scores(
    start: Ship, calibration: Calibration, train: Sequence[Trial], held_out: Sequence[Trial]
) -> dict[str, dict]:
    """Both metrics before and after, on the training and on the held-out trials that have positions."""
    from fitting.prediction.score import pooled_sigma, score
    from fitting.report.run_folder import score_rows
    from mmg.errors import UserError
    from mmg.rollout import Simulator

    result: dict[str, dict] = {}
    compiled = calibration.settings.compiled
    models = {"before": Simulator(start, compiled), "after": Simulator(calibration.ship, compiled)}
    for name, trials in (("validation", held_out), ("training", train)):
        usable = [t for t in trials if t.has_position]
        if not usable:
            continue
        try:
            sigma = pooled_sigma(usable)
        except UserError:
            continue
        result[name] = {
            when: score_rows(score(model, usable, sigma, f"the {name} trials")) for when, model in models.items()
        }
    return result


def _summary(calibration: Calibration, content: dict, out: Path) -> None:
    """A few lines for a person."""
    from fitting.identifiability.analysis import KINDS
    from mmg_ident.commands.output import say

    words = "converged" if calibration.converged else "NOT CONVERGED"
    own = f" and {len(calibration.constants.p)} constants of runs" if calibration.constants else ""
    say(
        f"{words} ({calibration.solution.status}) after {sum(p['iterations'] for p in calibration.passes)} iterations "
        f"in {calibration.timings['total']:.1f} s; objective {calibration.solution.objective:.6g}; "
        f"{len(calibration.prior.symbols)} free coefficients{own}, {calibration.segments.duration:.0f} s of data, "
        f"seed {calibration.settings.seed}"
    )
    for line in content["warnings"]:
        say(f"warning: {line}")
    for line in calibration.notices:
        say(f"note: {line}")
    for line in calibration.constants.table() if calibration.constants else []:
        say(line)
    for name, pair in content["scores"].items():
        before, after = pair["before"], pair["after"]
        say(
            f"{name}: 30 s windows {before['window']:.4f} -> {after['window']:.4f}, "
            f"100 s restarts {before['paper']:.4f} -> {after['paper']:.4f}"
        )
    kinds = content["identifiability"]["counts"]
    say("coefficients: " + ", ".join(f"{count} {KINDS[kind]}" for kind, count in kinds.items()))
    plan = content["identifiability"].get("next_trial", {}).get("plan", [])
    if plan:
        say(f"next trial that would tell most: {plan[0]['name']}")
    say(f"run folder: {out} (ship.toml, result.json, report.html)")
