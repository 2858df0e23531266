"""``mmg train``: learn a residual on a calibrated ship."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg.errors import UserError, needs_torch
from mmg_ident.commands.output import (
    command_line,
    print_json,
    progress,
    refuse_no_score,
    say,
    say_remarks,
    scores_in_words,
)

if TYPE_CHECKING:
    from residual.result import TrainResult
    from residual.settings import TrainSettings

_MODELS = ("hybrid", "fnn", "rnn", "rnn-window")
_ONLY = {
    "layers": ("fnn",),
    "zero": ("fnn",),
    "memory": ("rnn", "rnn-window"),
    "initial": _MODELS[1:],
    "symmetric": ("hybrid",),
}
"""Options that only some models take."""
_AGAIN = "the same command with --resume continues"
"""How to go on with a training that was stopped."""


def train(
    run: Annotated[str, Argument(help="Run folder of mmg fit, or a ship.", metavar="RUN")],
    trials: Annotated[list[Path], Argument(help="Trial files, or folders of them.")],
    out: Annotated[Path, Option(help="Run folder to write; it must not exist.")],
    validate: Annotated[
        list[Path] | None,
        Option(help="Trials to judge the result by; several may follow. Default: parts that take turns."),
    ] = None,
    model: Annotated[str, Option(help="What is trained: hybrid, or a black box: fnn, rnn, rnn-window.")] = "hybrid",
    seeds: Annotated[int, Option(help="How often it is trained, from seeds one apart.")] = 5,
    seed: Annotated[int, Option(help="The first seed.")] = 0,
    workers: Annotated[int, Option(help="Processes over which the seeds are spread.")] = 1,
    scheduler: Annotated[
        str | None, Option(help="Dask scheduler, as tcp://host:8786: its workers do the tasks.", metavar="ADDRESS")
    ] = None,
    epochs: Annotated[int | None, Option(help="Passes over the windows; default 40, of a black box 60.")] = None,
    width: Annotated[int | None, Option(help="Neurons of each hidden layer; default 32, of a black box 64.")] = None,
    penalty: Annotated[
        float | None,
        Option(
            help="Weight of mean (residual / its scale)^2; default 0.3, then 0.03, 0.01, 0.001, of which windows that "
            "are not trained on choose; of a black box, of its weights^2."
        ),
    ] = None,
    jitter: Annotated[float, Option(help="Noise added to the states, in multiples of the instruments' noise.")] = 0.0,
    rate: Annotated[float, Option(help="First learning rate of Adam.")] = 3e-3,
    batch: Annotated[int, Option(help="Windows per gradient step.")] = 64,
    step: Annotated[float | None, Option(help="Grid and integration step [s]; default a twentieth of L/U.")] = None,
    loss: Annotated[str, Option(help="state (Wakita 2022, Eq. 23) or acceleration (Eq. 16).")] = "state",
    augment: Annotated[
        str, Option(help="A set of Wakita 2024: ref, sli2, sli10, jit2, jit10, sli10+jit10, d-ref.")
    ] = "",
    layers: Annotated[int | None, Option(help="fnn: hidden layers; default 2.")] = None,
    memory: Annotated[
        int | None, Option(help="rnn-window: rows m of Eq. 9; rnn: rows that warm it up; default 2.")
    ] = None,
    symmetric: Annotated[bool | None, Option(help="hybrid: port and starboard alike; default so.")] = None,
    zero: Annotated[bool | None, Option(help="fnn: whether it is zero at the origin; default it is.")] = None,
    initial: Annotated[
        int | None, Option(help="Black box: rows before a start that estimate its velocities; 0: as measured.")
    ] = None,
    time_limit: Annotated[float | None, Option(help="Wall-clock limit of the training [s].")] = None,
    keep: Annotated[
        str, Option(help="Recommended ship: better, as the decision says, or always the hybrid.")
    ] = "better",
    resume: Annotated[
        bool, Option("--resume", help="Continue an interrupted training in --out; finished seeds are kept.")
    ] = False,
    unchecked: Annotated[
        bool, Option("--unchecked", help="Take also files that mmg check calls contradictory, and broken stretches.")
    ] = False,
    json: Annotated[bool, Option("--json", help="Print result.json on stdout.")] = False,
) -> int:
    """Learn a residual acceleration on a calibrated ship, and recommend it only if windows it never saw say so.

    The run folder is the recommended ship. The other one lies in RUN/hybrid or RUN/calibrated; every command takes it.
    With --model fnn, rnn or rnn-window a network without physics is trained instead, for comparison; of the ship only
    inputs and length are used, and mmg predict and mmg score take the run folder.

    Ctrl-C keeps the best weights so far (exit code 130); the same command with --resume trains the seeds that are not
    finished.

    Example: mmg train runs/first trials/*.csv --validate held_out.csv --workers 2 --out runs/hybrid
    """
    from cases.checks import ready
    from cases.checks.held_out import training_trials
    from cases.io.read import read_trials
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import check_target, reserved
    from residual.result import CALIBRATED
    from residual.settings import KEEP
    from residual.training.folds import check_enough

    settings = _settings(
        model, seeds=seeds, seed=seed, workers=workers, epochs=epochs, width=width, penalty=penalty, jitter=jitter,
        rate=rate, batch=batch, step=step, time_limit=time_limit, loss=loss, augment=augment, layers=layers,
        memory=memory, zero=zero, initial=initial, symmetric=symmetric,
    )  # fmt: skip
    if keep not in KEEP:
        raise UserError(f"--keep {keep}: unknown; choose one of {', '.join(KEEP)}")
    if not (resume and out.exists()):
        check_target(out)
    chosen, held_out = read_trials(trials), read_trials(validate) if validate else []
    chosen, held_out = ready(chosen, held_out, unchecked=unchecked)
    start, trained_on = load_ship(run), training_trials(chosen)[0]
    if trained_on:
        check_enough(start, trained_on, settings, held_out)
    _check_augmentation(settings)
    if resume and out.exists() and _is_complete(out):
        say(f"{out} has finished already; nothing to resume")
        return 0
    from residual.pipeline import train as trained
    from residual.training.checkpoint import training_store

    store = training_store(out, start, trained_on, held_out, settings, resume)
    try:
        with reserved(out):
            result = trained(run, chosen, held_out, settings, keep, command_line(), progress(), store)
            result.save(out, replace=True)
    except KeyboardInterrupt:
        if not store.folder.is_dir():
            raise
        say(f"mmg: interrupted; what was finished is in {store.folder}: {_AGAIN}")
        return 130
    _summary(result, out) if not json else print_json(result.to_dict())
    if result.recommended != CALIBRATED:  # a residual that is declined may diverge
        refuse_no_score(result.warnings, out)
    return 130 if result.interrupted else 0


def _settings(model: str, **values: Any) -> TrainSettings:
    """Settings from --model and the other options by name, None where not given."""
    from residual.settings import LOSSES, BlackBoxSettings, TrainSettings

    if model not in _MODELS:
        raise UserError(f"--model {model}: unknown; choose one of {', '.join(_MODELS)}")
    values = {name: value for name, value in values.items() if value is not None}
    for name in ("seeds", "workers", "epochs", "width", "batch", "layers", "memory"):
        if not values.get(name, 1) >= 1:
            raise UserError(f"--{name} {values[name]} must be at least 1")
    for name in ("rate", "step", "time_limit"):
        if not 0 < values.get(name, 1.0) < float("inf"):
            raise UserError(f"--{name.replace('_', '-')} {values[name]:g} must be positive")
    for name in ("penalty", "jitter", "initial"):
        if not 0 <= values.get(name, 0) < float("inf"):
            raise UserError(f"--{name} {values[name]:g} must not be negative")
    if values.get("loss", LOSSES[0]) not in LOSSES:
        raise UserError(f"--loss {values['loss']}: unknown; choose one of {', '.join(LOSSES)}")
    strange = [name for name, kinds in _ONLY.items() if name in values and model not in kinds]
    if strange:
        raise UserError(f"--{strange[0]} is not for --model {model}, only for {', '.join(_ONLY[strange[0]])}")
    return TrainSettings(**values) if model == "hybrid" else BlackBoxSettings(kind=model, **values)


def _check_augmentation(settings: TrainSettings) -> None:
    """Raises UserError where torch is missing, or the set of augmentation is unknown."""
    needs_torch("mmg train")
    from residual.training.augmentation import SETS

    if settings.augment not in ("", *SETS):
        raise UserError(f"--augment {settings.augment}: unknown; choose one of {', '.join(SETS)}")


def _is_complete(out: Path) -> bool:
    """Whether the run folder ``out`` holds a training of which no seed was stopped or left out."""
    from fitting.report.run_folder import RESULT, read_result
    from residual.result import read_training

    if not (out / RESULT).exists():
        return False
    if read_result(out)["kind"] != "training":
        raise UserError(f"{out}: is no run of mmg train, so there is nothing to resume; choose another --out")
    return read_training(out).complete


def _summary(result: TrainResult, out: Path) -> None:
    """A few lines for a person."""
    say_remarks(result)
    if result.decision:
        say(f"{result.decision.words} (judged and scored, with and without it, without the past of a window)")
    what = "of the black box, after that of the ship model" if result.black_box else "with the residual"
    for name, pair in result.scores.items():
        say(f"{name}, {what}: {scores_in_words(pair.before, pair.after)}")
    if result.network:
        du, dv, dr = result.network.bound
        say(f"the residual never exceeds |du| {du:.3g}, |dv| {dv:.3g} m/s2, |dr| {dr:.3g} rad/s2, whatever the inputs")
    if not result.complete:
        say(f"not all seeds came to their end: {_AGAIN}")
    if result.black_box:
        say(f"run folder: {out} (network.safetensors, report.html): mmg predict and mmg score take it")
    else:
        other = f"; the {result.other} ship: {out / result.other}" if result.other else ""
        say(f"run folder: {out} (the {result.recommended} ship, report.html){other}")
