"""``mmg train``: learn a residual on a calibrated ship."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg.errors import Conflict, UnknownName, needs_torch
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli
from residual.settings import KEEP, KINDS, BlackBoxSettings, TrainSettings, defaults_of

if TYPE_CHECKING:
    from residual.result import TrainResult

# Settings that only some models take.
_ONLY = {"layers": ("fnn",), "zero": ("fnn",), "memory": ("rnn", "rnn-window"), "initial": KINDS,
         "symmetric": ("hybrid",)}  # fmt: skip


@o.options(
    BlackBoxSettings,
    Network="model width symmetric layers memory zero initial keep",
    Training="epochs penalty rate batch loss augment step",
    Solver="seeds seed time_limit workers scheduler",
)
def train(
    run: o.Run,
    trials: o.Trials,
    out: o.RunFolder,
    settings: o.Given,
    validate: Annotated[list[Path] | None, Option(help="Judged by; default parts in turn.", metavar="TRIAL...")] = None,
    model: Annotated[str, Option(help="Or a black box: fnn, rnn, rnn-window.")] = "hybrid",
    keep: Annotated[str, Option(help="Recommended ship: better, or always the hybrid.")] = "better",
    scheduler: o.Scheduler = None,
    resume: o.Resume = False,
    unchecked: o.Unchecked = False,
    no_report: o.NoReport = False,
    json: o.Json = False,
) -> int:
    """Learn a residual acceleration on a calibrated ship, and recommend it only if windows it never saw say so.

    The run folder is the recommended ship. The other one lies in RUN/hybrid or RUN/calibrated; every command takes it.
    With --model fnn, rnn or rnn-window a network without physics is trained instead, for comparison; of the ship only
    inputs and length are used, and mmg predict and mmg score take the run folder.

    Ctrl-C keeps the best weights so far (exit code 130); the same command with --resume trains the seeds that are not
    finished.

    Example: mmg train runs/first trials/*.csv --validate held_out.csv --workers 2 --out runs/hybrid
    """
    from cases.shipfiles.ship_file import load_ship
    from cases.trial_set import ready
    from fitting.report.run_folder import RESULT, check_target, reserved
    from residual.result import CALIBRATED, read_training

    chosen_settings = _settings(model, settings)
    if keep not in KEEP:
        raise UnknownName(f"--keep {keep}: unknown; choose one of {', '.join(KEEP)}")
    if not (resume and out.exists()):
        check_target(out)
    chosen, held_out = ready(trials, validate or (), unchecked=unchecked)
    start, trained_on = load_ship(run), chosen.training()[0]  # without those whose role keeps them out
    needs_torch("mmg train")  # after all that can be refused without it, which takes seconds to import
    if resume and (out / RESULT).exists() and read_training(out).complete:
        cli.say(f"{out} has finished already; nothing to resume")
        return 0
    from residual.pipeline import train as trained
    from residual.train import training_store

    store = training_store(out, start, trained_on, held_out, chosen_settings, resume)
    try:
        with reserved(out):
            result = trained(run, chosen, held_out, chosen_settings, keep, cli.progress(), store)
            result = replace(result, command=cli.command_line())
            # the folder is there already: the store keeps each seed in it as it finishes
            result.save(out, replace=True, report=not no_report)
    except KeyboardInterrupt:
        if not store.folder.is_dir():  # nothing was begun that could be resumed
            raise
        cli.say(f"mmg: interrupted; what was finished is in {store.folder}: {cli.RESUMED}")
        return 130
    _summary(result, out) if not json else cli.print_json(result.to_dict())
    if result.recommended != CALIBRATED:  # a residual that is declined may diverge
        cli.refuse_no_score(result.warnings, out)
    return 130 if result.interrupted else 0


def _settings(model: str, values: dict[str, Any]) -> TrainSettings:
    """Settings of a --model from ``values`` by name."""
    usual = defaults_of(model)
    strange = [name for name, kinds in _ONLY.items() if name in values and model not in kinds]
    if strange:
        raise Conflict(f"--{strange[0]} is not for --model {model}, only for {', '.join(_ONLY[strange[0]])}")
    return replace(usual, **values)


def _summary(result: TrainResult, out: Path) -> None:
    """A few lines for a person."""
    cli.say_remarks(result)
    if result.decision:
        cli.say(f"{result.decision.words} (judged and scored, with and without it, without the past of a window)")
    what = "of the black box, after that of the ship model" if result.black_box else "with the residual"
    cli.say_scores(result.scores, f", {what}")
    if result.network:
        du, dv, dr = result.network.bound
        cli.say(f"for any inputs the residual stays below |du| {du:.3g}, |dv| {dv:.3g} m/s2, |dr| {dr:.3g} rad/s2")
    if not result.complete:
        cli.say(f"not all seeds came to their end: {cli.RESUMED}")
    files = cli.those_in(out, "ship.toml network.safetensors report.html")
    if result.black_box:
        cli.say(f"run folder: {out} ({files}): mmg predict and mmg score take it")
    else:
        other = f"; the {result.other} ship: {out / result.other}" if result.other else ""
        cli.say(f"run folder: {out} (the {result.recommended} ship: {files}){other}")
