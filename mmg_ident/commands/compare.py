"""``mmg compare``: captive, calibrated, hybrid and black boxes on the same trials, over seeds and amounts of data."""

from __future__ import annotations

import shutil
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

from typer import Option

from mmg.errors import Conflict, NoSolution, UserError, needs_torch
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli
from residual.settings import TrainSettings


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
    out: Annotated[Path | None, Option(help="Folder for tables and result.json.")] = None,
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
    from fitting.report.run_folder import (
        RESULT,
        Store,
        check_target,
        hash_of_ship,
        hashes_of_trials,
        reserved,
        write_json,
        write_whole,
    )

    if paper:
        words = f"does not belong to --paper {paper}, which has training trials and a grid of its own; leave it out"
        others = {"--train": train, "--no-random": no_random or None, "--step": settings.get("step")}
        cli.refuse_given({**others, "--fractions": None if fractions == "1" else fractions}, words)
    needs_torch("mmg compare")  # before the imports below, whose error would name no remedy
    from mmg_ident.studies import comparison_study
    from residual.papers.comparison import compare as compared
    from residual.papers.comparison import comparison_dict, tables_text

    if resume and not out:  # without a folder nothing was kept
        raise Conflict("--resume needs the --out of the interrupted comparison")
    if out and not (resume and out.exists()):
        check_target(out)
    study = comparison_study(
        train or (), test or (), ship, models, fractions, unchecked,
        measurement=measurement, no_random=no_random, paper=paper, **settings,
    )  # fmt: skip
    about = {  # by the option that a person would have to give as before, where one differs on --resume
        "--seeds": [study.seeds, study.seed],
        "--models": list(study.models),
        "settings": {"epochs": study.epochs, "step": study.step, "instruments": list(study.instruments)},
        "--paper": paper,
        "--fractions": [subset.words for subset in study.subsets],
        "ship": hash_of_ship(study.ship),
        "--train": hashes_of_trials(study.train),
        "--test": hashes_of_trials(study.test),
    }
    store = Store(out / "entries", about, resume and out.exists()) if out else None  # entries as they finish
    try:
        with reserved(out) if out else nullcontext():
            comparison = compared(study, store, cli.progress())
        if not any(e.score for e in comparison.entries):
            reasons = dict.fromkeys(e.status for e in comparison.entries)
            within = f" within {study.time_limit:g} s (--time-limit)" if study.time_limit else ""
            raise NoSolution(f"nothing could be compared{within}: {'; '.join(reasons)}")
    except UserError:
        if store:
            store.discard()
        raise
    content = comparison_dict(comparison, cli.command_line())
    if out and store:

        def fill(folder: Path) -> None:
            shutil.copytree(store.folder, folder / store.folder.name)  # entries, for another --resume
            (folder / "tables.md").write_text(tables_text(comparison), encoding="utf-8")
            write_json(folder / RESULT, content)

        write_whole(out, fill, replace=True)
    if json:
        cli.print_json(content)
    else:
        print(tables_text(comparison), end="")
    if out:
        cli.say(f"comparison: {out} (tables.md, result.json)")
        if comparison.interrupted:
            cli.say(f"not everything was done: {cli.RESUMED}")
    return 130 if comparison.interrupted else 0
