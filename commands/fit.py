"""``mmg fit``: calibrate a ship on trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cases.trial import Trial
    from fitting.calibration import Calibration
    from fitting.settings import Settings
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
    json: Annotated[bool, typer.Option("--json", help="Print result.json on stdout.")] = False,
) -> int:
    """Calibrate a ship on trials by multiple shooting and IPOPT.

    Example: mmg fit esso_osaka_3m trials/*.csv --validate held_out.csv --out runs/first
    """
    import shlex
    import sys
    import time

    from cases.read import read_trials
    from commands.output import end_progress, print_json, progress, say
    from fitting.calibration import calibrate
    from fitting.forecast import enrich
    from fitting.ipopt import Interrupts
    from fitting.next_trial import identify
    from fitting.run import read_iterate, read_result, result, write_run
    from fitting.verdicts import identifiability_dict
    from mmg.rollout import Simulator

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
    )
    start = _start(out, resume, ship)
    warm = None
    if resume and out.exists():
        if read_result(out)["converged"]:
            say(f"{out} has converged already; nothing to resume")
            return 0
        warm = read_iterate(out)
    start = _reduced(start, without, with_, fix, only)
    start = _measuring(start, measurement)
    train, held_out, remarks = _by_role(read_trials(trials), read_trials(validate) if validate else [])
    _compare_hashes(out, start, train, resume)
    reading = time.perf_counter() - began
    for line in start.notices:
        say(line)
    with Interrupts(lambda: say("interrupted: stopping at the next iterate and writing the run folder")):
        calibration = calibrate(start, train, settings, progress(), warm)
        end_progress()
        calibration.timings["read"] = reading
        scores = _scores(start, calibration, train, held_out)
        command = "mmg " + " ".join(shlex.quote(a) for a in sys.argv[1:])
        content = result(calibration, train, held_out, scores, command)
        content["warnings"] += [*remarks, *_leaks(train, held_out), *_worse(scores)]
        found, trial = identify(calibration, next_trial and calibration.converged)
        content["identifiability"] = identifiability_dict(found, trial)
        enrich(Simulator(calibration.ship, settings.compiled), content, train, held_out)

        def decorate(folder: Path) -> None:
            from fitting.plot_identifiability import write_identifiability_figures
            from fitting.plots import write_figures
            from fitting.report import write_report
            from fitting.run import RESULT, write_json

            content["figures"] = write_figures(folder, calibration, start, train, held_out)
            content["figures"] += write_identifiability_figures(folder, found, trial)
            content["timings_s"]["wall"] = time.perf_counter() - began
            write_json(folder / RESULT, content)
            write_report([folder], folder / "report.html")

        write_run(out, calibration, start, content, decorate, replace=resume)
        _summary(calibration, content, out) if not json else print_json(content)
    if calibration.converged:
        return 0
    return 130 if calibration.solution.status == "User_Requested_Stop" else 1


def _settings(sigma: str | None, **values: Any) -> Settings:
    """Settings from the options; UserError when a number makes no sense."""
    from commands.output import numbers_of
    from fitting.settings import Settings
    from mmg.errors import UserError

    for name in ("window", "step", "tolerance", "time_limit"):
        if values[name] is not None and not values[name] > 0:
            raise UserError(f"--{name.replace('_', '-')} {values[name]:g} must be positive")
    for name, least in (("interval", 1), ("starts", 1), ("workers", 1), ("max_iterations", 0)):
        if values[name] < least:
            raise UserError(f"--{name.replace('_', '-')} {values[name]} must be at least {least}")
    return Settings(sigma=numbers_of(sigma, 6, "--sigma") if sigma else None, **values)


def _start(out: Path, resume: bool, ship: str) -> Ship:
    """The ship to start from (the run's own start when resuming), after checking the run folder."""
    from cases.ships import load_ship
    from fitting.run import START, check_target

    if resume and out.exists():
        return load_ship(out / START)
    check_target(out)
    return load_ship(ship)


def _reduced(
    ship: Ship,
    without: list[str] | None,
    with_: list[str] | None,
    fix: list[str] | None,
    only: list[str] | None,
) -> Ship:
    """The ship with components left out, effects freed and coefficients fixed as asked."""
    from cases.effects import freeing_effects
    from cases.ships import dump_ship, parse_ship
    from commands.output import names_of
    from mmg.errors import UserError

    for role in names_of(without):
        if role in ship.effects:
            ship = ship.without_effect(role)
            continue
        if role not in ship.components:
            raise UserError(f"--without {role}: {ship.name} has no such component; it has {', '.join(ship.components)}")
        if role == "hull" or (role == "propeller" and "rudder" in ship.components):
            raise UserError(f"--without {role}: the rest of the model needs it")
        from dataclasses import replace

        from mmg.components import coefficient_table

        components = {r: n for r, n in ship.components.items() if r != role}
        kept = coefficient_table(components, ship.particulars)
        ship = replace(
            ship, components=components, coefficients={s: ship.coefficients[s] for s in kept if s in ship.coefficients}
        )
        ship = parse_ship(dump_ship(ship), ship.name)
    ship = freeing_effects(ship, with_ or [])
    for option, names in (("--fix", names_of(fix)), ("--only", names_of(only))):
        unknown = [name for name in names if name not in ship.coefficients]
        if unknown:
            raise UserError(f"{option}: unknown coefficient {', '.join(unknown)}; known: {', '.join(ship.symbols)}")
    if only:
        ship = ship.fixing([s for s in ship.symbols if s not in names_of(only)])
    return ship.fixing(names_of(fix))


def _measuring(ship: Ship, measurement: str) -> Ship:
    """The ship with effects of its instruments freed; those that it has already stay as they are.

    A satellite delay stands for the velocity lag, which is then not added.
    """
    from cases.effects import freeing_effects
    from commands.output import names_of
    from mmg.effects import EFFECTS
    from mmg.errors import UserError

    names = [] if measurement == "none" else names_of([measurement])
    for name in names:
        if name not in EFFECTS or EFFECTS[name].enters != "measurement":
            known = [e for e, effect in EFFECTS.items() if effect.enters == "measurement"]
            raise UserError(f"--measurement {name}: no effect of an instrument; known: {', '.join(known)}, or none")
    present = {"velocity_lag"} if "gnss_delay" in ship.effects else set()
    return freeing_effects(ship, [name for name in names if name not in {*ship.effects, *present}])


def _by_role(train: list[Trial], held_out: list[Trial]) -> tuple[list[Trial], list[Trial], list[str]]:
    """Trials to train on and to hold out, and what was said: a sidecar's role keeps a trial out of the training."""
    from mmg.errors import UserError

    kept = [t for t in train if t.role not in ("test", "validate")]
    out = [t.name for t in train if t.role in ("test", "validate")]
    if out and not kept:
        raise UserError(f"{', '.join(out)}: trials.toml gives them the role test or validate; none is left to train on")
    return kept, held_out, [f"not trained on, by their role in trials.toml: {', '.join(out)}"] if out else []


def _leaks(train: Sequence[Trial], held_out: Sequence[Trial]) -> list[str]:
    """Sentences on rows that are counted twice, or that are in the training and held out."""
    from cases.checks.duplicates import duplicates

    trials = [*train, *held_out]
    words = []
    for i, (copies, _) in enumerate(duplicates(trials)):
        for copy in copies:
            other = next((j for j, t in enumerate(trials) if j > i and t.name == copy.get("other")), None)
            if other is None:
                continue
            if (i < len(train)) != (other < len(train)):
                words.append(f"{trials[other].name} shares rows with {trials[i].name}: its score is not held out")
            elif i < len(train):
                words.append(f"{trials[i].name} and {trials[other].name} share rows, which count twice in the fit")
    return list(dict.fromkeys(words))


def _worse(scores: dict[str, dict]) -> list[str]:
    """Sentences on sets of trials that the calibrated ship predicts worse than the one it started from."""
    words = []
    for name, pair in scores.items():
        for metric, label in (("window", "30 s windows"), ("paper", "100 s restarts")):
            before, after = pair["before"][metric], pair["after"][metric]
            if after > 1.005 * before + 1e-6:
                words.append(f"{label} of the {name} trials became worse: {before:.4f} -> {after:.4f}")
    return words


def _compare_hashes(out: Path, start: Ship, trials: Sequence[Trial], resume: bool) -> None:
    """When resuming, data and free coefficients must be those of the interrupted run."""
    from fitting.run import read_result
    from mmg.errors import UserError

    if not (resume and out.exists()):
        return
    earlier = read_result(out)
    if set(earlier["coefficients"]) != set(start.free):
        raise UserError(f"{out}: --resume needs the same --without, --fix and --only as the interrupted run")
    before = sorted(row["sha256"] for row in earlier["data"])
    if before != sorted(t.sha256 for t in trials):
        raise UserError(f"{out}: --resume needs the same trial files as the interrupted run")


def _scores(
    start: Ship, calibration: Calibration, train: Sequence[Trial], held_out: Sequence[Trial]
) -> dict[str, dict]:
    """Both metrics before and after, on the training and on the held-out trials that have positions."""
    from fitting.run import score_rows
    from fitting.score import pooled_sigma, score
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
    from commands.output import say
    from fitting.identifiability import KINDS

    words = "converged" if calibration.converged else "NOT CONVERGED"
    say(
        f"{words} ({calibration.solution.status}) after {sum(p['iterations'] for p in calibration.passes)} iterations "
        f"in {calibration.timings['total']:.1f} s; objective {calibration.solution.objective:.6g}; "
        f"{len(calibration.prior.symbols)} free coefficients, {calibration.segments.duration:.0f} s of data, "
        f"seed {calibration.settings.seed}"
    )
    for line in content["warnings"]:
        say(f"warning: {line}")
    for line in calibration.notices:
        say(f"note: {line}")
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
