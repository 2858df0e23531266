"""``mmg demo``: the whole story on embedded synthetic trials."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder to write; default mmg-demo, or the next free name.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of wind and sensor noise.")] = 1,
    json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
) -> int:
    """Simulate trials of a ship nobody knows, check, calibrate, score on held-out runs, learn a residual, diagnose.

    Example: mmg demo --out demo
    """
    from cases.checks import check
    from cases.io.read import read_trials
    from cases.shipfiles.ship_file import dump_ship, load_ship
    from cases.simulation.demo_trials import demo_trials, hidden_ship
    from cases.simulation.simulate import write_trial
    from fitting.calibration import Settings, estimate_coefficients
    from fitting.report.run_folder import RESULT, check_target, result, write_json, write_run
    from mmg.errors import UserError
    from mmg_ident.commands.demo_diagnosis import demo_diagnosis
    from mmg_ident.commands.demo_residual import demo_residual
    from mmg_ident.commands.fit import _scores
    from mmg_ident.commands.output import end_progress, print_json, progress, say

    folder = _free(out)
    if folder.exists():
        raise UserError(f"{folder}: already exists; choose another --out")
    check_target(folder)
    trials_folder = folder / "trials"
    try:
        trials_folder.mkdir(parents=True)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written ({error.strerror}); choose another --out") from None
    say(f"1. Simulating trials of a ship with hidden coefficients, wind and sensor noise (seed {seed})")
    made_train, made_held_out = demo_trials(seed)
    for role, made in (("train", made_train), ("held_out", made_held_out)):
        (trials_folder / role).mkdir()
        for trial in made:
            write_trial(trial, trials_folder / role / f"{trial.name}.csv")
    (folder / "hidden_ship.toml").write_text(dump_ship(hidden_ship(), "The truth behind the demo trials."))

    say("2. Checking the trial files")
    train = read_trials([trials_folder / "train"])
    held_out = read_trials([trials_folder / "held_out"])
    for item in check([*train, *held_out]):
        say(f"   {item.name}: {item.verdict}")

    start = load_ship("esso_osaka_3m")
    say(f"3. Calibrating {len(start.free)} coefficients from the captive-test ship (IPOPT, multiple shooting)")
    calibration = estimate_coefficients(start, train, Settings(seed=seed), progress())
    end_progress()
    scores = _scores(start, calibration, train, held_out)
    truth = _against_truth(calibration)
    content = result(calibration, train, held_out, scores, f"mmg demo --seed {seed}", {"hidden_truth": truth})

    def decorate(target: Path) -> None:
        from fitting.report.page import write_report
        from fitting.report.plots import write_figures

        content["figures"] = write_figures(target, calibration, start, train, held_out)
        write_json(target / RESULT, content)
        write_report([target], target / "report.html")

    write_run(folder / "run", calibration, start, content, decorate)
    _tell(calibration, scores, truth, folder)
    learned = demo_residual(folder)
    diagnosis = demo_diagnosis(folder, seed)
    if json:
        found = {"folder": str(folder), "converged": calibration.converged, "scores": scores, "residual": learned}
        found["diagnosis"] = diagnosis
        print_json({**found, **truth})
    return 0 if calibration.converged else 1


def _free(out: Path | None) -> Path:
    if out is not None:
        return out
    names = [Path("mmg-demo"), *(Path(f"mmg-demo-{i}") for i in range(2, 1000))]
    return next(name for name in names if not name.exists())


def _against_truth(calibration) -> dict:  # type: ignore[no-untyped-def]
    """How the estimates compare with the hidden ship: share of 95 % intervals that hold the truth."""
    from cases.simulation.demo_trials import hidden_ship

    truth = hidden_ship()
    inside = {
        s: bool(
            abs(calibration.ship.coefficients[s].value - truth.coefficients[s].value)
            <= 1.96 * calibration.ship.coefficients[s].std
        )
        for s in calibration.prior.symbols
    }
    moved = [s for s in inside if truth.coefficients[s].value != calibration.ship.coefficients[s].prior_value]
    return {
        "inside_95": sum(inside.values()) / len(inside),
        "moved": moved,
        "outside": [s for s, ok in inside.items() if not ok],
    }


def _tell(calibration, scores: dict, truth: dict, folder: Path) -> None:  # type: ignore[no-untyped-def]
    from mmg_ident.commands.output import say

    words = "converged" if calibration.converged else f"NOT converged: {calibration.solution.advice}"
    say(f"   {words}, {calibration.timings['total']:.1f} s")
    pair = scores["validation"]
    before, after = pair["before"], pair["after"]
    say("4. Scoring on held-out runs (mean squared normalised error, lower is better)")
    say(f"   30 s windows {before['window']:.4f} -> {after['window']:.4f}")
    say(f"   100 s restarts {before['paper']:.4f} -> {after['paper']:.4f}")
    say(
        f"   the hidden value lies inside the 95 % interval for {truth['inside_95']:.0%} of the coefficients "
        f"({len(truth['moved'])} of them had been moved)"
    )
    say(f"5. Report: {folder / 'run' / 'report.html'}")
