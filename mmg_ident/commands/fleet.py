"""``mmg fleet``: many ships and campaigns in one run: fit, judge, diagnose, compare."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from mmg.errors import Missing
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from mmg_ident.fleets.rows import Fleet


def fleet(
    plan: Annotated[Path, Argument(help="Plan of the fleet (TOML): ships, trials, campaigns, sisters.")],
    out: Annotated[Path | None, Option(help="Folder to write; default plan/ beside plan.toml.")] = None,
    workers: o.Workers = 1,
    scheduler: o.Scheduler = None,
    resume: o.Resume = False,
    json: o.Json = False,
) -> int:
    """Fit, judge, diagnose and compare many ships; sister ships share a prior whose width is estimated.

    The plan is checked whole first. Each ship becomes a run folder, as of mmg fit, with her diagnosis in it. A ship
    that fails is said in the table, and the others are done. After Ctrl-C the same command with --resume goes on.

    Example: mmg fleet plan.toml --workers 2 --out runs/fleet
    """
    from fitting.report.run_folder import check_target, reserved
    from mmg_ident.fleets.plan import read_plan
    from mmg_ident.fleets.rows import write_page, write_tables
    from mmg_ident.fleets.run import PARTS, run_fleet

    out = plan.with_suffix("") if out is None else out
    if not (resume and out.exists()):
        check_target(out)
    # an empty folder is what a run leaves that was killed at once
    elif not (out / PARTS).is_dir() and (not out.is_dir() or any(out.iterdir())):
        raise Missing(f"{out}: holds no run of mmg fleet to resume; choose another --out")
    checked = read_plan(plan)
    try:
        with reserved(out):
            result = run_fleet(checked, out, workers, cli.command_line(), cli.progress())
            cli.end_progress()
            write_tables(result, out)
            write_page(result, out)
    except KeyboardInterrupt:
        cli.say(f"mmg: interrupted; what was finished is in {out}: {cli.RESUMED}")
        return 130
    if json:
        cli.print_json(result)
    else:
        _summary(result, out)
    return 1 if result.failed else 0


def _summary(fleet: Fleet, out: Path) -> None:
    """A few lines for a person."""
    rows, worse = [], []
    for row in fleet.rows:
        score = row["scores"].get("held_out") or row["scores"].get("training") or {}
        pair = list(score.get("window", {}).values())  # mean squared errors of 30 s windows, before and after
        errors = " -> ".join(f"{error:.3g}" for error in pair if None not in pair)
        errors += "*" if errors and "held_out" not in row["scores"] else ""
        if None not in (alone := score.get("alone"), *pair) and pair and pair[-1] > alone:
            worse.append(
                f"{row['name']}: an error of {alone:.3g} by her own trials alone, with her sisters {pair[-1]:.3g}"
            )
        verdict = ", ".join(e["name"] for e in row["effects"]) or row["verdict"]
        drifted = ", ".join(f"{d['name']} ({d['campaign']})" for d in row["drifted"])
        counts = (str(len(row["instruments"])), str(len(row["moved"])))
        rows.append((row["name"], row["status"], errors, verdict, drifted, *counts))
    heads = ("ship", "status", "held out|n", "diagnosis", "drifted", "instruments|n", "moved|n")
    cli.print_table(heads, rows, f"{fleet.name}: {len(fleet.rows)} ships")
    if any(row[2].endswith("*") for row in rows):
        cli.say("*: of the training trials, as none are held out")
    for line in worse:
        cli.say(line)
    for row in (row for row in fleet.rows if row["status"] != "done"):
        cli.say(f"{row['name']}: {row['status']}: {row['reason']}")
    for group in fleet.groups:
        width, (low, high) = group.widths.common, group.widths.common_90
        words = f"{width:.2g} of the prior's standard deviation (90 %: {low:.2g} to {high:.2g})"
        cli.say(f"sisters {group.name}: coefficients differ by {words}")
    cli.say(f"fleet: {out} (fleet.html, fleet.parquet, ships/)")
