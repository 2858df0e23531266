"""``mmg demo``: the whole story on embedded synthetic trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fitting.result import FitResult


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
    from fitting.pipeline import FitOptions, calibrate
    from fitting.report.run_folder import check_target
    from fitting.settings import Settings
    from mmg.errors import UserError
    from mmg_ident.commands.demo_diagnosis import demo_diagnosis
    from mmg_ident.commands.demo_residual import demo_residual
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
    found = calibrate(
        start, train, held_out, Settings(seed=seed), FitOptions(command=f"mmg demo --seed {seed}"), progress()
    )
    end_progress()
    truth = _against_truth(found)
    found = found.save(folder / "run")
    _tell(found, truth, folder)
    learned = demo_residual(folder)
    diagnosis = demo_diagnosis(folder, seed)
    if json:
        scores = found.to_dict()["scores"]
        told = {"folder": str(folder), "converged": found.converged, "scores": scores, "residual": learned}
        print_json({**told, "diagnosis": diagnosis, **truth})
    return 0 if found.converged else 1


def _free(out: Path | None) -> Path:
    if out is not None:
        return out
    names = [Path("mmg-demo"), *(Path(f"mmg-demo-{i}") for i in range(2, 1000))]
    return next(name for name in names if not name.exists())


def _against_truth(found: FitResult) -> dict:
    """How the estimates compare with the hidden ship: share of 95 % intervals that hold the truth."""
    from cases.simulation.demo_trials import hidden_ship

    truth = hidden_ship()
    inside = {
        s: bool(
            abs(found.ship.coefficients[s].value - truth.coefficients[s].value) <= 1.96 * found.ship.coefficients[s].std
        )
        for s in found.coefficients
    }
    moved = [s for s in inside if truth.coefficients[s].value != found.ship.coefficients[s].prior_value]
    return {
        "inside_95": sum(inside.values()) / len(inside),
        "moved": moved,
        "outside": [s for s, ok in inside.items() if not ok],
    }


def _tell(found: FitResult, truth: dict, folder: Path) -> None:
    from mmg_ident.commands.output import say

    words = "converged" if found.converged else f"NOT converged: {found.advice}"
    say(f"   {words}, {found.timings_s['total']:.1f} s")
    before, after = found.scores["validation"].before, found.scores["validation"].after
    say("4. Scoring on held-out runs (mean squared normalised error, lower is better)")
    say(f"   30 s windows {before.window:.4f} -> {after.window:.4f}")
    say(f"   100 s restarts {before.paper:.4f} -> {after.paper:.4f}")
    say(
        f"   the hidden value lies inside the 95 % interval for {truth['inside_95']:.0%} of the coefficients "
        f"({len(truth['moved'])} of them had been moved)"
    )
    say(f"5. Report: {folder / 'run' / 'report.html'}")
