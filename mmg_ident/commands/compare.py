"""``mmg compare``: captive, calibrated, hybrid and black boxes on the same trials, over seeds and amounts of data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from mmg.errors import Conflict, Missing, NoSolution, OutOfRange, UnknownName, UserError, needs_torch
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli
from residual.settings import TrainSettings

if TYPE_CHECKING:
    from cases.trial import Trial


@o.options(
    TrainSettings,
    file=False,
    Study="paper ship measurement models fractions no_random",
    Solver="seeds seed epochs step time_limit workers scheduler",
)
def compare(
    settings: o.Given,
    train: Annotated[
        list[str] | None, Option(help="Trials, or a split; default train-tzrb.", metavar="TRIAL...")
    ] = None,
    test: Annotated[
        list[str] | None, Option(help="Trials, or a split; default development-holdout.", metavar="TRIAL...")
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for tables, result.json and figures.")] = None,
    ship: Annotated[str, Option(help="The captive ship.")] = "esso_osaka_3m",
    measurement: Annotated[str, Option(help="Instruments to fit, or none.")] = "shown",
    models: Annotated[str | None, Option(help="Which, by commas; default all.")] = None,
    paper: Annotated[str | None, Option(help="Instead the networks of a paper: wakita2022.")] = None,
    fractions: Annotated[str, Option(help="Shares of training data, such as 0.1,0.3,1.")] = "1",
    no_random: Annotated[bool, Option("--no-random", help="Again without runs of random manoeuvres.")] = False,
    scheduler: o.Scheduler = None,
    resume: o.Resume = False,
    unchecked: o.Unchecked = False,
    json: o.Json = False,
) -> int:
    """Calibrate and train every model on the same trials and score all of them on others, side by side.

    Both metrics of mmg score, growth of the error over the horizon, error over the amount of training data, and Table 9
    of Wakita et al. (2022) as published. Nothing is chosen by the test trials. Ctrl-C and --time-limit keep what is
    done (exit code 130 after Ctrl-C or when something was left out); with --out, --resume goes on from there.

    --paper wakita2022 trains Types 1 to 5 of that paper (type1 ... type5 of --models) on its own sets of records, and
    scores them by the protocol of its Table 9: by a schedule that is shorter than the published one, and says so, or
    with --epochs N by the published one.

    Example: mmg compare --train train-tzrb --seeds 5 --fractions 0.1,0.3,1 --no-random --workers 2 --out comparison
    """
    import shutil
    from contextlib import nullcontext
    from dataclasses import replace

    from cases.shipfiles.model_changes import with_instruments
    from cases.shipfiles.ship_file import load_ship
    from cases.trial_set import ready
    from fitting.report.parts import Store, hash_of_ship, hashes_of_trials
    from fitting.report.run_folder import PENDING, RESULT, check_target, reserved, write_json, write_whole
    from mmg.messages import message_rows

    if paper:
        words = f"does not belong to --paper {paper}, which has training trials and a grid of its own; leave it out"
        others = {"--train": train, "--no-random": no_random or None, "--step": settings.get("step")}
        cli.refuse_given({**others, "--fractions": None if fractions == "1" else fractions}, words)
    needs_torch("mmg compare")  # before the imports below, whose error would name no remedy
    from fitting.report.plot_style import FigureFolder
    from residual.papers.comparison import (
        MODELS,
        PAPERS,
        TYPES,
        Study,
        Subset,
        comparison_dict,
        paper_models,
        tables_text,
    )
    from residual.papers.comparison import compare as compared
    from residual.papers.comparison_figures import write_figures

    if paper and paper not in PAPERS:
        raise UnknownName(f"--paper {paper}: unknown; choose one of {', '.join(PAPERS)}")
    known = ("captive", *TYPES) if paper else MODELS
    names = known if models is None else tuple(dict.fromkeys(cli.names_of([models])))
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise UnknownName(f"--models {models}: unknown {', '.join(unknown)}; choose from {', '.join(known)}")
    try:
        shares = sorted({float(part) for part in fractions.split(",")}, reverse=True)
    except ValueError:
        shares = []
    if not shares or not all(0 < share <= 1 for share in shares):
        raise OutOfRange(f"--fractions {fractions}: give shares above 0 and up to 1, separated by commas")
    subsets = tuple(Subset(share, random) for random in (True, False)[: 1 + no_random] for share in shares)
    if resume and not out:
        raise Conflict("--resume needs the --out of the interrupted comparison")
    if out and not (resume and out.exists()):
        check_target(out)
    tests = _trials(test or ["development-holdout"], "--test")
    # by name and by content: splits of the same records share names, copies share bytes
    tested = {t.name for t in tests} | {t.sha256 for t in tests if t.sha256}
    given = _trials(train or ["train-tzrb+" if paper else "train-tzrb"], "--train")
    trained_on = [t for t in given if t.name not in tested and t.sha256 not in tested]
    if not trained_on:
        raise Missing("--train: nothing is left to train on besides the test trials")
    train_set, test_set = ready(trained_on, tests, unchecked=unchecked)
    captive = load_ship(ship).without_network()
    instruments = tuple(cli.names_of([measurement]))
    with_instruments(captive, instruments)  # freed later; what is wrong with them is said now
    study = Study(captive, train_set.trials, test_set.trials, names, subsets, instruments=instruments, **settings)
    if paper:
        own = [name for name in names if name in TYPES]
        study = replace(study, paper=paper_models(study.train, own, study.epochs, seeds=study.seeds, seed=study.seed))
    about = {
        "--seeds": [study.seeds, study.seed],
        "--models": list(study.models),
        "settings": {"epochs": study.epochs, "step": study.step, "instruments": list(study.instruments)},
        "--paper": paper,
        "--fractions": [subset.words for subset in study.subsets],
        "ship": hash_of_ship(study.ship),
        "--train": hashes_of_trials(study.train),
        "--test": hashes_of_trials(study.test),
    }
    store = Store(out / "entries", about, resume and out.exists()) if out else None
    try:
        with reserved(out) if out else nullcontext():
            found = compared(study, store, cli.progress())
    except UserError:
        if store:
            store.discard()
        raise
    content = comparison_dict(found, cli.command_line())
    if not any(e.score for e in found.entries):
        reasons = dict.fromkeys(e.status for e in found.entries)
        if store:
            store.discard()
        raise NoSolution(f"nothing could be compared: {'; '.join(reasons)}")
    if out and store:

        def fill(folder: Path) -> None:
            shutil.copytree(store.folder, folder / store.folder.name)
            (folder / "tables.md").write_text(tables_text(found), encoding="utf-8")
            missing = {"level": "warning", **message_rows([PENDING])[0]}  # if it ends here
            write_json(folder / RESULT, content | {"figures": [], "messages": [*content["messages"], missing]})

        write_whole(out, fill, replace=True)
        written = FigureFolder(out)
        write_figures(written, found)
        content["figures"] = [row["file"] for row in written.rows]
        with written.making(RESULT):
            write_json(out / RESULT, content)
    if json:
        cli.print_json(content)
    else:
        print(tables_text(found), end="")
    if out:
        cli.say(f"comparison: {out} (tables.md, result.json, figures)")
    if found.interrupted and out:
        cli.say(f"not everything was done: {cli.RESUMED}")
    return 130 if found.interrupted else 0


def _trials(given: list[str], option: str) -> list[Trial]:
    """Trials of files, folders and names of splits, with positions."""
    from cases.io.published_splits import SPLITS, find
    from cases.io.read import read_trials

    files: list[Path] = []
    for name in given:
        files += find(SPLITS[name.lower()]) if name.lower() in SPLITS else [Path(name)]
    found = read_trials(files)
    without = [t.name for t in found if not t.has_position]
    if without:
        raise Missing(f"{option}: {', '.join(without)}: no position columns x [m], y [m], which the metrics need")
    return found
