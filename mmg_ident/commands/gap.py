"""``mmg gap``: what the network closes of the gap, what a named effect, and what both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from mmg.errors import UserError, needs_torch
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from diagnosis.validation.gap import Gap


@o.options(Solver="seeds seed time_limit workers scheduler")
def gap(
    run: o.Run,
    trials: o.Trials,
    out: Annotated[Path, Option(help="Folder to write; it must not exist.")],
    test: o.Test = None,
    seeds: Annotated[int, Option(min=1, help="Trainings of each residual.")] = 5,
    seed: o.Seed = 0,
    workers: o.Workers = 1,
    scheduler: o.Scheduler = None,
    time_limit: Annotated[float | None, Option(help="Limit [s]; --resume goes on from there.")] = None,
    resume: o.Resume = False,
    unchecked: o.Unchecked = False,
    no_report: o.NoReport = False,
    json: o.Json = False,
) -> int:
    """Compare a ship as given, refitted, with a learned residual, with named effects, and with both, on --test trials.

    Runs what is missing: a calibration on the trials (none where RUN is one), a training and a diagnosis of it, a
    training with the named effects. The floor is what a complete model fitted to these trials would leave. Intervals
    are 90 %, by drawing the runs again. No model is fitted to the --test trials; the diagnosis checks on them what it
    names. Writes gap.json, gap.png and the parts: refitted, hybrid, diagnosis, both.

    Ctrl-C and --time-limit keep what is finished (exit code 130): the same command with --resume goes on from there.

    Example: mmg gap runs/first trials/*.csv --test held_out/*.csv --out runs/gap
    """
    from cases.shipfiles.ship_file import load_ship
    from cases.trial_set import ready
    from diagnosis.report.page import gap_figure
    from fitting.report.plot_style import png_of
    from fitting.report.run_folder import Store, check_target, write_json
    from fitting.solvers.control import Control, OutOfTimeError
    from mmg_ident.model_gap import GapOptions, about
    from mmg_ident.model_gap import gap as gap_of

    if not (resume and out.exists()):
        check_target(out)
    elif (out / "gap.json").exists():
        cli.say(f"{out} has finished already; nothing to resume")
        return 0
    train, tests = ready(trials, test or (), unchecked=unchecked)
    ship = load_ship(run)
    needs_torch("mmg gap")  # after all that can be refused without it, which takes seconds to import
    from residual.settings import TrainSettings

    settings = TrainSettings(seeds=seeds, seed=seed)
    options = GapOptions(settings, seed, workers, out, not no_report, cli.command_line())
    store = Store(out / "parts", about(ship, train, tests, options), resume and out.exists())
    store.open()  # refuses to go on with parts of other trials or settings
    try:
        with Control.within(time_limit, cli.progress()).in_force():
            comparison = gap_of(run, train, tests, options, cli.progress())
    except (KeyboardInterrupt, UserError) as stop:
        # a part that is finished stays for --resume; a run that has none leaves nothing behind
        has_parts = any(path.is_dir() and path != store.folder for path in out.iterdir())
        is_late = isinstance(stop, (KeyboardInterrupt, OutOfTimeError))
        if not (is_late and has_parts):
            if not has_parts:
                store.discard()
            raise
        cli.say(f"mmg: {str(stop) or 'interrupted'}; what was finished is in {out}: {cli.RESUMED}")
        return 130
    cli.end_progress()
    if not no_report:
        (out / "gap.png").write_bytes(png_of(lambda: gap_figure(comparison)))
    write_json(out / "gap.json", comparison.to_dict())  # last: that it is there says that the run has finished
    if json:
        cli.print_json(comparison.to_dict())
    else:
        _print(comparison, out)
    return 0


def _print(comparison: Gap, out: Path) -> None:
    """The table and the sentence."""
    for line in comparison.warnings:
        cli.say(str(line))
    cli.print_table(*comparison.table)
    print(comparison.sentence)
    for one in [one for one in comparison.witness if any(one.share.values())]:
        shares = ", ".join(f"{100 * share:.0f} % of {name}" for name, share in one.share.items())
        print(f"{one.effect} explains of what the network has learned: {shares}")
    cli.say(f"comparison: {out} ({cli.those_in(out, 'gap.json gap.png refitted hybrid diagnosis both')})")
