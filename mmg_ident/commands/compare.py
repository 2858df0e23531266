"""``mmg compare``: captive, calibrated, hybrid and black boxes on the same trials, over seeds and amounts of data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from mmg.errors import UserError, needs_torch
from mmg_ident.commands.output import command_line, names_of, print_json, progress, say

if TYPE_CHECKING:
    from cases.trial import Trial
    from fitting.report.parts import Store
    from residual.comparison.study import Study, Subset


def compare(
    train: Annotated[
        list[str] | None, Option(help="Trials, or a published split: train-tzrb (default), train-tzb, train-tzrb+ ...")
    ] = None,
    test: Annotated[
        list[str] | None, Option(help="Trials, or a split; default development-holdout. They are taken out of --train.")
    ] = None,
    ship: Annotated[str, Option(help="The captive ship.")] = "esso_osaka_3m",
    measurement: Annotated[
        str, Option(help="Instruments that a calibration fits along, as in mmg fit; or none.")
    ] = "velocity_filter",
    models: Annotated[str, Option(help="Which, separated by commas.")] = "captive,calibrated,hybrid,fnn,rnn,rnn-window",
    seeds: Annotated[int, Option(help="Trainings of each network, from seeds one apart.")] = 5,
    seed: Annotated[int, Option(help="The first seed.")] = 0,
    fractions: Annotated[str, Option(help="Shares of the training data to repeat all with: 0.1,0.3,1.")] = "1",
    no_random: Annotated[
        bool, Option("--no-random", help="Repeat all shares without the runs of random manoeuvres as well.")
    ] = False,
    epochs: Annotated[int | None, Option(help="Of every training; default as in mmg train.")] = None,
    step: Annotated[float | None, Option(help="Grid of the trainings [s].")] = None,
    workers: Annotated[int, Option(help="Processes over which everything is spread.")] = 1,
    scheduler: Annotated[
        str | None, Option(help="Dask scheduler, as tcp://host:8786: its workers do the tasks.", metavar="ADDRESS")
    ] = None,
    time_limit: Annotated[float | None, Option(help="Of the whole [s].")] = None,
    unchecked: Annotated[
        bool, Option("--unchecked", help="Take also files that mmg check calls contradictory, and broken stretches.")
    ] = False,
    out: Annotated[Path | None, Option(help="Folder for tables, result.json and figures.")] = None,
    resume: Annotated[
        bool, Option("--resume", help="Continue an interrupted comparison in --out; finished entries are kept.")
    ] = False,
    json: Annotated[bool, Option("--json", help="Print one JSON document instead of the tables.")] = False,
) -> int:
    """Calibrate and train every model on the same trials and score all of them on others, side by side.

    Both metrics of mmg score, growth of the error over the horizon, error over the amount of training data, and Table 9
    of Wakita et al. (2022) as published. Nothing is chosen by the test trials. Ctrl-C and --time-limit keep what is
    done (exit code 130 after Ctrl-C or when something was left out); with --out, --resume goes on from there.

    Example: mmg compare --train train-tzrb --seeds 5 --fractions 0.1,0.3,1 --no-random --workers 2 --out comparison
    """
    import shutil
    from contextlib import nullcontext

    from cases.checks import ready
    from cases.shipfiles.model_changes import with_instruments
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import RESULT, check_target, reserved, write_json, write_whole

    names = tuple(dict.fromkeys(names_of([models])))
    if seeds < 1 or workers < 1 or (epochs is not None and epochs < 1):
        raise UserError("--seeds, --workers and --epochs must be at least 1")
    if any(value is not None and not 0 < value < float("inf") for value in (step, time_limit)):
        raise UserError("--step and --time-limit must be positive numbers of seconds")
    needs_torch("mmg compare")
    from fitting.report.plot_style import FigureFolder
    from residual.comparison.figures import write_figures
    from residual.comparison.study import MODELS, Study
    from residual.comparison.study import compare as compared
    from residual.comparison.tables import comparison_dict, tables_text

    unknown = [name for name in names if name not in MODELS]
    if unknown or not names:
        raise UserError(f"--models {models}: unknown {', '.join(unknown)}; choose from {', '.join(MODELS)}")
    subsets = _subsets(fractions, no_random)
    if resume and not out:
        raise UserError("--resume needs the --out of the interrupted comparison")
    if out and not (resume and out.exists()):
        check_target(out)
    tests = _trials(test or ["development-holdout"], "--test")
    tested = {t.name for t in tests} | {t.sha256 for t in tests if t.sha256}
    given = _trials(train or ["train-tzrb"], "--train")
    trained_on = [t for t in given if t.name not in tested and t.sha256 not in tested]
    if not trained_on:
        raise UserError("--train: nothing is left to train on besides the test trials")
    trained_on, tests = ready(trained_on, tests, unchecked=unchecked)
    captive = load_ship(ship).without_network()
    instruments = tuple(
        e for e in with_instruments(captive, names_of([measurement])).effects if e not in captive.effects
    )
    study = Study(
        captive, tuple(trained_on), tuple(tests), names, subsets, seeds, seed, workers,
        epochs, step, time_limit, instruments,
    )  # fmt: skip
    store = _store(out, resume, study) if out else None
    try:
        with reserved(out) if out else nullcontext():
            found = compared(study, store, progress())
    except UserError:
        if store:
            store.discard()
        raise
    content = comparison_dict(found, command_line())
    if not any(e.score for e in found.entries):
        reasons = dict.fromkeys(e.status for e in found.entries)
        if store:
            store.discard()
        raise UserError(f"nothing could be compared: {'; '.join(reasons)}")
    if out and store:

        def fill(folder: Path) -> None:
            shutil.copytree(store.folder, folder / store.folder.name)
            (folder / "tables.md").write_text(tables_text(found), encoding="utf-8")
            write_json(folder / RESULT, content | {"figures": []})

        write_whole(out, fill, replace=True)
        written = FigureFolder(out)
        write_figures(written, found)
        content["figures"] = [row["file"] for row in written.rows]
        with written.making(RESULT):
            write_json(out / RESULT, content)
    if json:
        print_json(content)
    else:
        print(tables_text(found), end="")
    if out:
        say(f"comparison: {out} (tables.md, result.json, figures)")
    if found.interrupted and out:
        say("not everything was done: the same command with --resume continues")
    return 130 if found.interrupted else 0


def _store(out: Path, resume: bool, study: Study) -> Store:
    """Where finished entries are kept, with what must be the same to continue."""
    from fitting.report import parts as c

    about = {
        "--seeds": [study.seeds, study.seed],
        "--models": list(study.models),
        "settings": {"epochs": study.epochs, "step": study.step, "instruments": list(study.instruments)},
        "--fractions": [subset.words for subset in study.subsets],
        "ship": c.hash_of_ship(study.ship),
        "--train": c.hashes_of_trials(study.train),
        "--test": c.hashes_of_trials(study.test),
    }
    return c.Store(out / "entries", about, resume and out.exists())


def _trials(given: list[str], option: str) -> list[Trial]:
    """Trials of files, folders and names of splits, with positions."""
    from cases.io.read import read_trials
    from cases.published_splits import SPLITS, find

    files: list[Path] = []
    for name in given:
        files += find(SPLITS[name.lower()]) if name.lower() in SPLITS else [Path(name)]
    found = read_trials(files)
    without = [t.name for t in found if not t.has_position]
    if without:
        raise UserError(f"{option}: {', '.join(without)}: no position columns x [m], y [m], which the metrics need")
    return found


def _subsets(fractions: str, no_random: bool) -> tuple[Subset, ...]:
    """Subsets from the options, all data first."""
    from residual.comparison.study import Subset

    try:
        shares = sorted({float(part) for part in fractions.split(",")}, reverse=True)
    except ValueError:
        shares = []
    if not shares or not all(0 < share <= 1 for share in shares):
        raise UserError(f"--fractions {fractions}: give shares above 0 and up to 1, separated by commas")
    return tuple(Subset(share, random) for random in ((True, False) if no_random else (True,)) for share in shares)
