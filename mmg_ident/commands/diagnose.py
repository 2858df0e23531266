"""``mmg diagnose``: where the gap between model and trials lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from diagnosis.inputs import DiagnosisOptions
from mmg.errors import Missing, UnknownName, UserError
from mmg_ident.commands import options as o
from mmg_ident.commands.output import (
    command_line,
    end_progress,
    is_model,
    names_of,
    print_json,
    print_table,
    progress,
    say,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from diagnosis.result import Diagnosis
    from mmg.ship import Ship


@o.options(
    DiagnosisOptions,
    Model="without site campaign between",
    Solver="step learn bootstrap seed time_limit workers scheduler",
)
def diagnose(
    run: o.Run,
    trials: o.Trials,
    out: o.RunFolder,
    settings: o.Given,
    test: o.Test = None,
    without: o.Without = None,
    site: Annotated[Path | None, Option(help="Site file; default site.toml beside the trials.")] = None,
    campaign: o.Campaign = None,
    scheduler: o.Scheduler = None,
    resume: o.Resume = False,
    unchecked: o.Unchecked = False,
    no_report: o.NoReport = False,
    json: o.Json = False,
) -> int:
    """Say which effect a ship's model lacks, judged by trials: an effect by name, none, or unknown.

    The coefficients, a slowly varying force and the noise of the sensors are fitted together; every effect of the
    library (mmg effects) is tested on what is left, the best ones are refitted, and what stands out is checked on the
    --test trials. Where something is left unexplained, residuals are trained on the trials, as by mmg train, to see
    how much of the error of the --test trials they close. Writes diagnosis.json, report.html, figures and ship.toml
    (the ship with the named effects).

    Trials whose role in trials.toml is test or validate take no part and are checked on, as those of --test.

    With --between day the trials of each day are a group, and every effect, instrument and coefficient is tested for
    another value in one of them: what has changed since last year?

    Simulated campaigns (--bootstrap) and trainings are kept as they finish: after Ctrl-C the same command with --resume
    goes on from there. So it does after --time-limit, which ends in one line where there is no verdict yet, and else
    leaves out what comes after it.

    Example: mmg diagnose runs/first trials/*.csv --test held_out/*.csv --out runs/gap
    """
    from dataclasses import replace

    from cases.checks import ready
    from cases.io.campaigns import said_campaign
    from cases.io.read import read_trials
    from diagnosis import diagnose as pipeline
    from diagnosis.inputs import diagnosis_store
    from diagnosis.result import is_complete
    from fitting.report.run_folder import RESULT, check_target, reserved

    if not (resume and out.exists()):
        check_target(out)
    elif is_complete(out):
        say(f"{out} has finished already; nothing to resume")
        return 0
    ship, options = _ship(run, without or []), DiagnosisOptions(**settings, command=command_line())
    train, tests = ready(read_trials(trials), read_trials(test) if test else [], unchecked=unchecked)
    train, tests = (said_campaign(some, campaign, ship) for some in (train, tests))
    begun = not (out / RESULT).exists()  # one that lacks only figures and page has no parts any more
    store = diagnosis_store(out, ship, train, tests, options, run, resume and begun)
    if store.resume and not store.folder.is_dir() and any(out.iterdir()):
        raise Missing(f"{out}: holds no interrupted run to resume; choose another --out")
    try:
        with reserved(out):
            found = pipeline.diagnose(ship, train, tests, site, replace(options, store=store), run, progress())
            end_progress()
            found.save(out, replace=resume or store.folder.is_dir(), report=not no_report)
    except (KeyboardInterrupt, UserError) as stop:
        if isinstance(stop, UserError) or not ((out / RESULT).exists() or store.has_parts):
            if not store.has_parts:
                store.discard()
            raise
        say(f"mmg: interrupted; what was finished is in {out}: the same command with --resume continues")
        return 130
    if json:
        print_json(found.to_dict())
    else:
        _summary(found, out)
    return 0


def _ship(where: str, without: Sequence[str]) -> Ship:
    """The ship of a run folder, file or library, without some components."""
    from cases.shipfiles.model_changes import reduced_ship
    from cases.shipfiles.ship_file import load_ship

    path = Path(where)
    if path.is_dir() and not (path / "ship.toml").exists():
        raise Missing(f"{where}: no ship.toml in it; give a run folder of mmg fit, a ship file or a ship of mmg ships")
    if not path.is_dir() and not is_model(where):
        raise UnknownName(f"{where}: neither a run folder nor a ship file nor a ship of mmg ships")
    return reduced_ship(load_ship(path / "ship.toml" if path.is_dir() else where), names_of(without))


def _summary(found: Diagnosis, out: Path) -> None:
    """A few lines for a person."""
    for line in found.warnings:
        say(f"warning: {line}")
    rows = []
    for c in found.candidates[:8]:
        gain = "" if c.delta_bic is None else f"{c.delta_bic:.1f}"
        numbers = (f"{c.score:.1f}", f"{c.p_value:.1g}", gain, f"{c.absorbed_share:.0%}")
        rows.append((c.name, *(numbers if c.excited else ("not excited", "", "", ""))))
    print_table(("effect", "score|n", "p|n", "gain in BIC|n", "absorbed|n"), rows, f"verdict: {found.verdict}")
    lines = [found.sentence, found.learned.sentence if found.learned else ""]
    lines += [*(f"sensors: {line}" for line in found.kinematics), f"next: {found.next_test}" if found.next_test else ""]
    lines += [found.between.sentence, *found.between.warnings] if found.between else []
    for line in filter(None, lines):
        print(line)
    say(f"diagnosis: {out} (diagnosis.json, report.html, ship.toml)")
