"""``mmg demo``: the whole story on embedded synthetic trials, by the same functions as the other commands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg.errors import UserError
from mmg_ident.commands import options as o
from mmg_ident.commands.output import print_json, progress, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cases.trial import Trial
    from fitting.result import FitResult
    from residual.result import TrainResult


def demo(
    out: Annotated[Path | None, Option(help="Folder to write; default mmg-demo, or the next free name.")] = None,
    seed: Annotated[int, Option(help="Seed of wind and sensor noise.")] = 1,
    json: o.Json = False,
) -> int:
    """Simulate trials of a ship nobody knows, check, calibrate, score, learn residuals, diagnose a hidden effect.

    Example: mmg demo --out demo
    """
    from cases.checks import check
    from cases.shipfiles.ship_file import dump_ship
    from cases.simulation.demo_trials import CURRENT, FOULING, hidden_ship

    names = ["mmg-demo", *(f"mmg-demo-{i}" for i in range(2, 1000))]
    folder = out or next(Path(name) for name in names if not Path(name).exists())
    if folder.exists():
        raise UserError(f"{folder}: already exists; choose another --out")
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written ({error.strerror}); choose another --out") from None
    say(f"1. Simulating trials of a ship with hidden coefficients, wind and sensor noise (seed {seed})")
    train, held_out = campaign(folder / "trials", seed)
    (folder / "hidden_ship.toml").write_text(dump_ship(hidden_ship(), "The truth behind the demo trials."))
    say("2. Checking the trial files")
    for item in check([*train, *held_out]):
        say(f"   {item.name}: {item.verdict}")
    fit, truth = _calibrate(folder, train, held_out, seed)
    declined = _residual(folder, "6. Learning a residual on the calibrated ship", "residual", train, held_out)
    diagnosis = _diagnosis(folder, seed, CURRENT)
    fouled = campaign(folder / "third", seed + 2000, FOULING)
    step = f"8. A third campaign, with a hull that nobody knows is fouled ({FOULING}): learning a residual"
    kept = _residual(folder, step, "third_residual", *fouled)
    say(f"In a sentence: {moral(declined, kept)}")
    if json:
        content = fit.to_dict()
        print_json(
            {
                "folder": str(folder), "converged": fit.converged, "scores": content["scores"], **truth,
                "diagnosis": diagnosis, "residual": _decided(declined), "third_residual": _decided(kept),
            }
        )  # fmt: skip
    return 0 if fit.converged else 1


def campaign(folder: Path, seed: int, *effects: str, every: int = 1) -> tuple[list[Trial], list[Trial]]:
    """Training and held-out trials of the hidden ship, written to ``folder`` and read again as a user's would be.

    seed, effects, every: as of ``demo_trials``. Returns (train, held out).
    """
    from cases.io.read import read_trials
    from cases.simulation.demo_trials import demo_trials
    from cases.simulation.simulate import write_trial

    for role, made in zip(("train", "held_out"), demo_trials(seed, effects=effects, every=every), strict=True):
        (folder / role).mkdir(parents=True)
        (folder / role / "trials.toml").write_text('[default]\ninputs = "held"  # as simulations log them\n')
        for trial in made:
            write_trial(trial, folder / role / f"{trial.name}.csv")
    return read_trials([folder / "train"]), read_trials([folder / "held_out"])


def _calibrate(
    folder: Path, train: Sequence[Trial], held_out: Sequence[Trial], seed: int
) -> tuple[FitResult, dict[str, Any]]:
    """The calibration, in ``folder``/run, and how it compares with the hidden ship."""
    from cases.shipfiles.ship_file import load_ship
    from cases.simulation.demo_trials import SHIP, compare_with_truth
    from fitting.calibrate import FitOptions
    from fitting.settings import Settings
    from mmg_ident.api import calibrate

    start = load_ship(SHIP)
    say(f"3. Calibrating {len(start.free)} coefficients from the captive-test ship (IPOPT, multiple shooting)")
    command = f"mmg fit {SHIP} {folder / 'trials' / 'train'} --validate {folder / 'trials' / 'held_out'} --seed {seed}"
    found = calibrate(start, train, held_out, Settings(seed=seed), FitOptions(command=command), progress())
    found = found.save(folder / "run")
    truth = compare_with_truth(found.ship)
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
    return found, truth


def _residual(
    folder: Path, step: str, name: str, train: Sequence[Trial], held_out: Sequence[Trial]
) -> TrainResult | None:
    """A residual on the ship of ``folder``/run, in ``folder``/name; None, with a line, where nothing was learned.

    A small training of a few seconds; the weak penalty lets the residual grow to what the trials ask for.
    """
    from residual.pipeline import train as train_residual
    from residual.settings import TrainSettings

    say(step)
    trials = folder / ("trials" if name == "residual" else "third")
    s = TrainSettings(seeds=2, epochs=40, width=16, penalty=0.01, rate=0.01)
    command = (
        f"mmg train {folder / 'run'} {trials / 'train'} --validate {trials / 'held_out'} --seeds {s.seeds} "
        f"--epochs {s.epochs} --width {s.width} --penalty {s.penalty:g} --rate {s.rate:g} --out {folder / name}"
    )
    try:
        result = train_residual(folder / "run", train, held_out, s, command=command, progress=progress())
        result.save(folder / name)
    except UserError as error:
        say(f"   nothing was learned: {error}")
        return None
    say(f"   {result.sentence}")
    say(f"   {result.timings_s['wall']:.1f} s; report: {folder / name / 'report.html'}")
    return result


def _diagnosis(folder: Path, seed: int, effect: str) -> dict[str, Any]:
    """A second campaign with a hidden effect and its diagnosis, in ``folder``/second and ``folder``/diagnosis."""
    from cases.shipfiles.ship_file import load_ship
    from diagnosis.diagnose import DiagnosisOptions, diagnose

    say("7. A second campaign, a year later: what is different?")
    train, test = campaign(folder / "second", seed + 1000, effect, every=2)
    second = folder / "second"
    command = f"mmg diagnose {folder / 'run'} {second / 'train'} --test {second / 'held_out'} --workers 2 --seed {seed}"
    options, ship = DiagnosisOptions(seed=seed, workers=2, command=command), load_ship(folder / "run")
    found = diagnose(ship, train, test, options=options, calibrated_on=folder / "run", progress=progress())
    found.save(folder / "diagnosis")
    say(f"   {found.sentence}")
    say(f"   (the truth behind it: {effect})")
    say(f"   Report: {folder / 'diagnosis' / 'report.html'}")
    content = found.to_dict()
    return {k: content[k] for k in ("verdict", "effects", "equivalence_class", "sentence", "held_out")}


def moral(declined: TrainResult | None, kept: TrainResult | None) -> str:
    """What the two residuals of the demo show, in a sentence; declined, kept: those on the calibrated and on the fouled
    ship, None where nothing was learned. Returns it."""
    if not declined or not kept or (declined.recommended, kept.recommended) != ("calibrated", "hybrid"):
        return "a residual is recommended only where trials that took no part in its training become better predicted."
    return (
        "on the trials of the calibration the network found nothing beyond noise, so the calibrated ship stays the "
        "recommended one; on the fouled ship it found the missing resistance, so the hybrid is recommended."
    )


def _decided(result: TrainResult | None) -> dict[str, Any] | None:
    """The decision as plain values."""
    if result is None:
        return None
    content = result.to_dict()
    return {"kept": content["kept"], "scores": content["scores"], **content["decision"]}
