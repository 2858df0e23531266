"""``mmg train``: learn a residual on a calibrated ship."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cases.trial import Trial
    from mmg.ship import Ship
    from residual.learn import Trained
    from residual.train import Training


def train(
    run: Annotated[str, typer.Argument(help="Run folder of mmg fit, or a ship.", metavar="RUN")],
    trials: Annotated[list[Path], typer.Argument(help="Trial files, or folders of them.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write; it must not exist.")],
    validate: Annotated[
        list[Path] | None,
        typer.Option(
            "--validate", help="Trials to judge the result by; several may follow. Default: parts that take turns."
        ),
    ] = None,
    model: Annotated[
        str, typer.Option("--model", help="What is trained: hybrid, or a black box: fnn, rnn, rnn-window.")
    ] = "hybrid",
    seeds: Annotated[int, typer.Option("--seeds", help="How often it is trained, from seeds one apart.")] = 5,
    seed: Annotated[int, typer.Option("--seed", help="The first seed.")] = 0,
    workers: Annotated[int, typer.Option("--workers", help="Processes over which the seeds are spread.")] = 1,
    epochs: Annotated[
        int | None, typer.Option("--epochs", help="Passes over the windows; default 40, of a black box 60.")
    ] = None,
    width: Annotated[
        int | None, typer.Option("--width", help="Neurons of each hidden layer; default 32, of a black box 64.")
    ] = None,
    penalty: Annotated[
        float | None,
        typer.Option(
            "--penalty", help="Weight of mean (residual / its scale)^2, default 0.3; of a black box, of its weights^2."
        ),
    ] = None,
    jitter: Annotated[
        float, typer.Option("--jitter", help="Noise added to the states, in multiples of the instruments' noise.")
    ] = 0.0,
    rate: Annotated[float, typer.Option("--rate", help="First learning rate of Adam.")] = 3e-3,
    batch: Annotated[int, typer.Option("--batch", help="Windows per gradient step.")] = 64,
    step: Annotated[
        float | None, typer.Option("--step", help="Grid and integration step [s]; default a twentieth of L/U.")
    ] = None,
    loss: Annotated[
        str, typer.Option("--loss", help="state (Wakita 2022, Eq. 23) or acceleration (Eq. 16).")
    ] = "state",
    augment: Annotated[
        str, typer.Option("--augment", help="A set of Wakita 2024: ref, sli2, sli10, jit2, jit10, sli10+jit10, d-ref.")
    ] = "",
    layers: Annotated[int | None, typer.Option("--layers", help="fnn: hidden layers; default 2.")] = None,
    memory: Annotated[
        int | None, typer.Option("--memory", help="rnn-window: rows m of Eq. 9; rnn: rows that warm it up; default 2.")
    ] = None,
    symmetric: Annotated[
        bool | None, typer.Option("--symmetric/--no-symmetric", help="hybrid: port and starboard alike; default so.")
    ] = None,
    zero: Annotated[
        bool | None, typer.Option("--zero/--no-zero", help="fnn: whether it is zero at the origin; default it is.")
    ] = None,
    initial: Annotated[
        int | None,
        typer.Option("--initial", help="Black box: rows before a start that estimate its velocities; 0: as measured."),
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option("--time-limit", help="Wall-clock limit of the training [s].")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print result.json on stdout.")] = False,
) -> int:
    """Learn a residual acceleration on a calibrated ship, and keep it only if windows that it never saw say so.

    With --model fnn, rnn or rnn-window a network without physics is trained instead, for comparison; of the ship only
    inputs and length are used, and mmg predict and mmg score take the run folder.

    Ctrl-C keeps the best weights so far (exit code 130).

    Example: mmg train runs/first trials/*.csv --validate held_out.csv --workers 2 --out runs/hybrid
    """
    import shlex
    import sys
    import time

    from cases.read import read_trials
    from cases.ships import load_ship
    from commands.fit_input import _by_role, _leaks
    from commands.output import known_of, print_json, say
    from fitting.run import check_target
    from mmg.errors import UserError

    began = time.perf_counter()
    settings = _settings(
        model, seeds=seeds, seed=seed, workers=workers, epochs=epochs, width=width, penalty=penalty, jitter=jitter,
        rate=rate, batch=batch, step=step, time_limit=time_limit, loss=loss, augment=augment, layers=layers,
        memory=memory, zero=zero, initial=initial, symmetric=symmetric,
    )  # fmt: skip
    from residual.learn import train as trained_on
    from residual.run import result, write_training

    check_target(out)
    ship, base = load_ship(run), known_of(run)
    chosen, held_out, remarks = _by_role(read_trials(trials), read_trials(validate) if validate else [])
    if not chosen:
        raise UserError("no trials to train on: name at least one trial file")
    command = "mmg " + " ".join(shlex.quote(a) for a in sys.argv[1:])
    if model != "hybrid":
        from commands.train_box import train_box

        return train_box(ship, chosen, held_out, settings, remarks, command, out, json)
    trained = trained_on(ship, chosen, settings, held_out, say)
    scores = _scores(ship, trained, chosen, held_out)
    content = result(trained, model, chosen, held_out, scores, command, base)
    content["warnings"] += [*remarks, *_leaks(chosen, held_out), *_known_before(base, held_out)]

    def decorate(folder: Path) -> None:
        from residual.figures import write_figures

        content["figures"] = write_figures(folder, content)
        content["timings_s"]["wall"] = time.perf_counter() - began

    write_training(out, trained, content, decorate)
    _summary(trained, content, out) if not json else print_json(content)
    return 130 if trained.interrupted else 0


def _settings(model: str, **values: Any) -> Training:
    """Settings from the options, None where not given; UserError without torch and for numbers that make no sense."""
    from commands.output import needs_torch
    from mmg.errors import UserError

    if model not in MODELS:
        raise UserError(f"--model {model}: unknown; choose one of {', '.join(MODELS)}")
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
    needs_torch("mmg train")
    from residual.augment import SETS
    from residual.blackbox import BoxTraining
    from residual.train import LOSSES, Training

    for name, known in (("loss", LOSSES), ("augment", ("", *SETS))):
        if values[name] not in known:
            raise UserError(f"--{name} {values[name]}: unknown; choose one of {', '.join(k for k in known if k)}")
    strange = [name for name, kinds in ONLY.items() if name in values and model not in kinds]
    if strange:
        raise UserError(f"--{strange[0]} is not for --model {model}, only for {', '.join(ONLY[strange[0]])}")
    return Training(**values) if model == "hybrid" else BoxTraining(kind=model, **values)


MODELS = ("hybrid", "fnn", "rnn", "rnn-window")
"""What --model may be."""
ONLY = {
    "layers": ("fnn",),
    "zero": ("fnn",),
    "memory": ("rnn", "rnn-window"),
    "initial": MODELS[1:],
    "symmetric": ("hybrid",),
}
"""Options that only some models take."""


def _scores(ship: Ship, trained: Trained, chosen: Sequence[Trial], held_out: Sequence[Trial]) -> dict[str, dict]:
    """Both metrics without and with the residual, kept or not, on training and validation trials with positions."""
    from fitting.run import score_rows
    from fitting.score import pooled_sigma, score
    from mmg.errors import UserError
    from mmg.rollout import Simulator

    models = {"before": Simulator(ship.without_network())}
    if trained.network is not None:
        models["after"] = Simulator(ship.with_network(trained.network))
    result = {}
    for name, trials in (("validation", held_out), ("training", chosen)):
        placed = [t for t in trials if t.has_position]
        try:
            sigma = pooled_sigma(placed) if placed else None
        except UserError:
            sigma = None
        if sigma is not None:
            result[name] = {
                when: score_rows(score(model, placed, sigma, f"the {name} trials")) for when, model in models.items()
            }
    return result


def _known_before(base: dict, held_out: Sequence[Trial]) -> list[str]:
    """A sentence on validation trials that the ship was calibrated on."""
    seen = {row.get("sha256") for row in base.get("data", [])}
    both = [t.name for t in held_out if t.sha256 and t.sha256 in seen]
    return [f"{', '.join(both)}: the ship was calibrated on it, so its score is not held out"] if both else []


def _summary(trained: Trained, content: dict, out: Path) -> None:
    """A few lines for a person."""
    from commands.output import say

    for line in content["warnings"]:
        say(f"warning: {line}")
    say(trained.decision.words)
    for name, pair in content["scores"].items():
        if "after" in pair:
            before, after = pair["before"], pair["after"]
            say(
                f"{name}, with the residual: 30 s windows {before['window']:.4f} -> {after['window']:.4f}, "
                f"100 s restarts {before['paper']:.4f} -> {after['paper']:.4f}"
            )
    if trained.network is not None and trained.decision.kept:
        du, dv, dr = trained.network.bound
        say(f"the residual never exceeds |du| {du:.3g}, |dv| {dv:.3g} m/s2, |dr| {dr:.3g} rad/s2, whatever the inputs")
    say(f"run folder: {out} (ship.toml, {'network.safetensors, ' if trained.decision.kept else ''}result.json)")
