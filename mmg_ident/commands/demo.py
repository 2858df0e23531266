"""``mmg demo``: the whole story on embedded synthetic trials, by the same functions as the other commands."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg.errors import TargetExists, UserError, writing
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from cases.trial import Trial
    from residual.result import TrainResult

    Sets = tuple[list[Trial], list[Trial]]

ANSWER = ("verdict", "effects", "equivalence_class", "sentence", "held_out")  # Keys of a diagnosis that --json prints
# Step of the diagnosis [s], twice that of ``mmg diagnose``: half the time, and the same verdict for seeds 1 to 4. So it
# was measured.
STEP = 1.0
# Of the residuals of the demo: a training of two seconds, whose weak penalty lets the residual grow to what the trials
# ask for. Set by hand.
TRAINING: dict[str, Any] = {"seeds": 2, "epochs": 20, "width": 8, "penalty": 0.01, "rate": 0.02}


def demo(
    out: Annotated[Path | None, Option(help="Folder to write; default mmg-demo, or the next free name.")] = None,
    seed: Annotated[int, Option(help="Seed of wind, sensor noise and networks.")] = 1,
    json: o.Json = False,
) -> int:
    """Simulate trials of a ship nobody knows, check, calibrate, score, learn residuals, diagnose a hidden effect.

    Example: mmg demo --out demo
    """
    from cases.checks import check
    from cases.shipfiles.ship_file import dump_ship, load_ship
    from cases.simulation.demo_trials import CURRENT, FOULING, SHIP, hidden_ship, share_of_truth
    from diagnosis.diagnose import DiagnosisOptions, diagnose
    from fitting.calibrate import FitOptions
    from mmg.messages import LOGGER
    from mmg_ident.api import calibrate

    names = ["mmg-demo", *(f"mmg-demo-{i}" for i in range(2, 1000))]
    folder = out or next(Path(name) for name in names if not Path(name).exists())
    if folder.exists():
        raise TargetExists(f"{folder}: already exists; choose another --out")
    with writing(folder):
        folder.mkdir(parents=True)
    LOGGER.setLevel(logging.WARNING)  # the story is told in its own lines
    first = campaign(folder / "trials", seed, every=2)  # other seeds below: no two campaigns share wind and noise
    (folder / "hidden_ship.toml").write_text(dump_ship(hidden_ship(), "The truth behind the demo trials."))
    runs = len(first[0]) + len(first[1])
    cli.say(f" 1 simulate  {runs} trials of a ship with hidden coefficients: gusty wind, sensor noise (seed {seed})")
    verdicts = [report.verdict for report in check([*first[0], *first[1]])]
    cli.say(f" 2 check     {verdicts.count('ok')} of {runs} files are ok: units, signs, frames, gaps, lags")
    options = FitOptions(command=cli.command_line())
    with cli.working("calibrating; the first time the equations are compiled"):
        fit = calibrate(SHIP, *first, None, options, cli.progress(), seed=seed).save(folder / "run")
    state = "converged" if fit.converged else f"NOT converged, {fit.advice}"
    trials = f"{len(first[0])} trials by multiple shooting"
    cli.say(f" 3 fit       {len(fit.estimates)} coefficients to {trials}: {state}, {fit.timings_s['total']:.1f} s")
    pair, truth = fit.scores["validation"], share_of_truth(fit.ship)
    before, after = (score.units.pooled for score in (pair.before, pair.after) if score.units)
    words = f"position {before.position_m:.3g} -> {after.position_m:.3g} m, "
    words += f"heading {before.heading_deg:.3g} -> {after.heading_deg:.3g} deg"
    cli.say(f" 4 score     rms errors of predictions of {len(first[1])} held-out trials: {words}")
    cli.say(f" 5 truth     {truth:.0%} of the hidden coefficients lie in their 95 % intervals")
    cli.say(f" 6 report    {folder / 'run' / 'report.html'}: tracks, intervals, what the trials leave open")
    declined = _trained(folder, "residual", first, seed)
    cli.say(f" 7 train     a network on these trials is {_decision(declined)}")
    second = campaign(folder / "second", seed + 1000, CURRENT, every=4)
    cli.say(f" 8 simulate  a year later {len(second[0])} trials with an effect that no model has: {CURRENT}")
    run, how = folder / "run", DiagnosisOptions(step=STEP, seed=seed, command=cli.command_line())
    with cli.working("diagnosing"):
        diagnosis = diagnose(load_ship(run), *second, options=how, calibrated_on=run, progress=cli.progress())
        diagnosis.save(folder / "diagnosis", report=False)
    causes = [f"{e.name} {', '.join(f'{k}={p.value:.3g}' for k, p in e.parameters.items())}" for e in diagnosis.effects]
    cli.say(f" 9 diagnose  {diagnosis.verdict}: {', '.join(causes) or 'no effect'} (numbers: {folder / 'diagnosis'})")
    gain = f"{diagnosis.held_out.reduction:.0%} smaller" if diagnosis.held_out else "not known"
    cli.say(f"10 score     with what is named the error on {len(second[1])} held-out trials is {gain}")
    third = campaign(folder / "third", seed + 2000, FOULING, every=2)
    fouled = _trained(folder, "third_residual", third, seed)
    cli.say(f"11 train     on trials with a fouled hull ({FOULING}) a network is {_decision(fouled)}")
    moral = "a residual is recommended only where trials that it never saw become better predicted"
    if declined and fouled and (declined.recommended, fouled.recommended) == ("calibrated", "hybrid"):
        moral = "a network is recommended where the model lacks something, and declined where only noise is left"
    cli.say(f"12 so        {moral}")
    if json:
        scores, answer = fit.to_dict()["scores"], diagnosis.to_dict()
        content = {"folder": str(folder), "converged": fit.converged, "scores": scores, "inside_95": truth}
        content |= {"diagnosis": {key: answer[key] for key in ANSWER}}
        cli.print_json(content | {"residual": _decided(declined), "third_residual": _decided(fouled)})
    return 0 if fit.converged else 1


def campaign(folder: Path, seed: int, *effects: str, every: int = 1) -> Sets:
    """Training and held-out trials of the hidden ship, written to ``folder`` and read again as a user's would be.

    seed, effects, every: as of ``demo_trials``. Returns (train, held out).
    """
    from cases.io.read import read_trials
    from cases.simulation.demo_trials import demo_trials
    from cases.simulation.simulate import write_trial

    for role, trials in zip(("train", "held_out"), demo_trials(seed, effects=effects, every=every), strict=True):
        (folder / role).mkdir(parents=True)
        (folder / role / "trials.toml").write_text('[default]\ninputs = "held"  # as simulations log them\n')
        for trial in trials:
            write_trial(trial, folder / role / f"{trial.name}.csv")
    return read_trials([folder / "train"]), read_trials([folder / "held_out"])


def _trained(folder: Path, name: str, trials: Sets, seed: int) -> TrainResult | None:
    """A residual on the ship of ``folder``/run, in ``folder``/name; None where nothing was learned."""
    from residual.pipeline import train
    from residual.settings import TrainSettings

    settings = TrainSettings(seed=seed, **TRAINING)
    try:
        with cli.working("learning a residual"):
            result = train(folder / "run", *trials, settings, progress=cli.progress())
            result = replace(result, command=cli.command_line())
            result.save(folder / name, report=False)
    except UserError as error:
        cli.say(f"   nothing was learned: {error}")
        return None
    return result


def _decision(result: TrainResult | None) -> str:
    """What was decided on a network, in words."""
    if result is None or "validation" not in result.scores:
        return "not learned"
    pair = result.scores["validation"]
    words = f"30 s windows {pair.before.window:.3f} -> {pair.after.window:.3f} on held-out trials"
    return f"{'kept' if result.recommended == 'hybrid' else 'declined'}: {words}"


def _decided(result: TrainResult | None) -> dict[str, Any] | None:
    """The decision as plain values."""
    if result is None:
        return None
    content = result.to_dict()
    return {"kept": content["kept"], "scores": content["scores"], **content["decision"]}
