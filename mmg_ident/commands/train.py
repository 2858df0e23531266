"""``mmg train``: learn a residual on a calibrated ship."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


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
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue an interrupted training in --out; finished seeds are kept.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print result.json on stdout.")] = False,
) -> int:
    """Learn a residual acceleration on a calibrated ship, and keep it only if windows that it never saw say so.

    With --model fnn, rnn or rnn-window a network without physics is trained instead, for comparison; of the ship only
    inputs and length are used, and mmg predict and mmg score take the run folder.

    Ctrl-C keeps the best weights so far (exit code 130); the same command with --resume trains the seeds that are not
    finished.

    Example: mmg train runs/first trials/*.csv --validate held_out.csv --workers 2 --out runs/hybrid
    """
    import shlex
    import sys
    import time

    from cases.io.read import read_trials
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import check_target
    from mmg.errors import UserError
    from mmg_ident.commands.fit_input import _by_role
    from mmg_ident.commands.output import known_of, say
    from mmg_ident.commands.train_box import train_box
    from mmg_ident.commands.train_hybrid import train_hybrid
    from mmg_ident.commands.train_input import AGAIN, Order, guarded, is_complete, settings_of, store_of

    began = time.perf_counter()
    settings = settings_of(
        model, seeds=seeds, seed=seed, workers=workers, epochs=epochs, width=width, penalty=penalty, jitter=jitter,
        rate=rate, batch=batch, step=step, time_limit=time_limit, loss=loss, augment=augment, layers=layers,
        memory=memory, zero=zero, initial=initial, symmetric=symmetric,
    )  # fmt: skip
    if not (resume and out.exists()):
        check_target(out)
    elif is_complete(out):
        say(f"{out} has finished already; nothing to resume")
        return 0
    ship, base = load_ship(run), known_of(run)
    chosen, held_out, remarks = _by_role(read_trials(trials), read_trials(validate) if validate else [])
    if not chosen:
        raise UserError("no trials to train on: name at least one trial file")
    command = "mmg " + " ".join(shlex.quote(a) for a in sys.argv[1:])
    store = store_of(out, resume, model, settings, ship, chosen, held_out)
    if store.resume:
        store.open()  # compares before anything is made
    order = Order(ship, chosen, held_out, settings, base, remarks, command, out, json, store, began)
    return guarded(lambda: train_hybrid(order) if model == "hybrid" else train_box(order, run), store, AGAIN)
