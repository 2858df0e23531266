"""``mmg diagnose``: where the gap between model and trials lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from diagnosis.inputs import DiagnosisOptions
from mmg.errors import Missing
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli
from mmg_ident.settings import names_of

if TYPE_CHECKING:
    from diagnosis.result import Diagnosis


@o.options(DiagnosisOptions, Model="without site campaign between", Solver="step seed time_limit workers scheduler")
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
    --test trials. Writes diagnosis.json, report.html, figures and ship.toml (the ship with the named effects).

    Trials whose role in trials.toml is test or validate take no part and are checked on, as those of --test.

    With --between day the trials of each day are a group, and every effect, instrument and coefficient is tested for
    another value in one of them: what has changed since last year?

    --time-limit ends in one line where there is no verdict yet, and else leaves out what comes after it; the same
    command with --resume makes that.

    Example: mmg diagnose runs/first trials/*.csv --test held_out/*.csv --out runs/gap
    """
    from cases.shipfiles.effects import reduced_ship
    from cases.shipfiles.ship_file import load_ship
    from cases.trial_set import ready
    from diagnosis import diagnose as pipeline
    from diagnosis.result import is_complete
    from fitting.report.run_folder import RESULT, check_target, reserved

    if not (resume and out.exists()):
        check_target(out)
    elif is_complete(out):
        cli.say(f"{out} has finished already; nothing to resume")
        return 0
    elif not (out / RESULT).exists() and any(out.iterdir()):
        raise Missing(f"{out}: holds no interrupted run to resume; choose another --out")
    ship = reduced_ship(load_ship(run), names_of(without))
    options = DiagnosisOptions(**settings, command=cli.command_line())
    train, tests = ready(trials, test or (), unchecked=unchecked)
    train, tests = (some.said_campaign(campaign, ship) for some in (train, tests))
    try:
        with reserved(out):
            diagnosis = pipeline.diagnose(ship, train, tests, site, options, run, cli.progress())
            cli.end_progress()
            diagnosis.save(out, replace=resume, report=not no_report)
    except KeyboardInterrupt:
        if not (out / RESULT).exists():
            raise
        cli.say(f"mmg: interrupted; what was finished is in {out}: {cli.RESUMED}")
        return 130
    if json:
        cli.print_json(diagnosis.to_dict())
    else:
        _summary(diagnosis, out)
    return 0


SHOWN = 8  # Candidates in the table, best first. Set by hand: with what stands around it one screen of a terminal.


def _summary(diagnosis: Diagnosis, out: Path) -> None:
    """A few lines for a person."""
    for line in diagnosis.warnings:
        cli.say(f"warning: {line}")
    rows, named = [], {effect.name: effect for effect in diagnosis.effects}
    for c in sorted(diagnosis.candidates, key=lambda c: c.name not in named)[:SHOWN]:
        found = named.get(c.name, c)  # of a named one the gain is that beside those named before it
        gain = "" if found.delta_bic is None else f"{found.delta_bic:.1f}"
        numbers = (f"{c.score:.1f}", f"{c.p_value:.1g}", gain, f"{c.absorbed_share:.0%}")
        # trials that do not excite an effect say nothing of it: a small score would read as evidence against it
        rows.append((c.name, *(numbers if c.excited else ("not excited", "", "", ""))))
    cli.print_table(("effect", "score|n", "p|n", "gain in BIC|n", "absorbed|n"), rows, f"verdict: {diagnosis.verdict}")
    lines = [diagnosis.sentence]
    lines += [f"sensors: {line}" for line in diagnosis.kinematics]
    lines += [f"next: {diagnosis.next_test}"] if diagnosis.next_test else []
    lines += [diagnosis.between.sentence, *diagnosis.between.warnings] if diagnosis.between else []
    for line in filter(None, lines):
        print(line)
    cli.say(f"diagnosis: {out} ({cli.those_in(out, 'diagnosis.json report.html ship.toml')})")
