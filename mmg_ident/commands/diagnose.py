"""``mmg diagnose``: where the gap between model and trials lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cases.trial import Trial
    from diagnosis.result import Diagnosis
    from mmg.ship import Ship


def diagnose(
    run: Annotated[str, typer.Argument(help="Run folder of mmg fit, ship file or library ship.", metavar="RUN")],
    trials: Annotated[list[Path], typer.Argument(help="Trial files, or folders of them.", metavar="TRIAL...")],
    out: Annotated[Path, typer.Option("--out", help="Folder to write the diagnosis to.")],
    test: Annotated[
        list[Path] | None, typer.Option("--test", help="Trials that take no part, to check on; several may follow.")
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="Leave a component out of the model, such as wind.")
    ] = None,
    site: Annotated[
        Path | None, typer.Option("--site", help="Site file (default: site.toml beside the trials).")
    ] = None,
    step: Annotated[float | None, typer.Option("--step", help="Time step of the analysis [s].")] = None,
    workers: Annotated[int, typer.Option("--workers", help="Processes that refit candidates side by side.")] = 1,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the drawn probabilities and intervals.")] = 0,
    no_learn: Annotated[
        bool, typer.Option("--no-learn", help="Do not measure how much a learned residual closes of what has no name.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print diagnosis.json.")] = False,
) -> None:
    """Say which effect a ship's model lacks, judged by trials: an effect by name, none, or unknown.

    The coefficients, a slowly varying force and the noise of the sensors are fitted together; every effect of the
    library (mmg effects) is tested on what is left, the best ones are refitted, and what stands out is checked on the
    --test trials. Where something is left without a name, residuals are trained on the trials, as by mmg train, to see
    how much of the error of the --test trials they close. Writes diagnosis.json, report.html, figures and ship.toml
    (the ship with what was named).

    Example: mmg diagnose runs/first trials/*.csv --test held_out/*.csv --out runs/gap
    """
    import sys
    import time

    from cases.io.read import read_trials
    from cases.io.site import read_site
    from diagnosis.diagnose import diagnose as diagnosed
    from diagnosis.result import contract
    from fitting.report.run_folder import check_target
    from mmg.errors import UserError
    from mmg_ident.commands.output import print_json, say

    began = time.perf_counter()
    check_target(out)
    if step is not None and not 0 < step < 60:
        raise UserError(f"--step {step:g}: must be a positive number of seconds below 60")
    if workers < 1:
        raise UserError(f"--workers {workers}: must be at least 1")
    ship, remarks = _ship(run, without or [])
    train = read_trials(trials)
    tests, shared = _apart(train, read_trials(test) if test else [])
    remarks += shared
    place = read_site(train, ship, site)

    def tell(words: str) -> None:
        if not json:
            say(words)

    unseen, reference, told = _calibrated_on(run, train, without or [])
    remarks += told
    found = diagnosed(ship, train, tests, place, step, seed, workers, unseen, reference, tell)
    if not no_learn:
        found = with_learned(found, train, tests, seed, workers, tell)
    content = contract(found)
    content["warnings"] = [*remarks, *place.notices, *content["warnings"]]
    command = "mmg " + " ".join(sys.argv[1:])
    write_diagnosis(out, found, content, train, tests, command, seed, time.perf_counter() - began)
    if json:
        print_json(content)
    else:
        _summary(content, out)


def _ship(where: str, without: Sequence[str]) -> tuple[Ship, list[str]]:
    """The ship of a run folder, file or library, without a network and without some components; remarks on it."""
    from cases.shipfiles.ship_file import load_ship
    from mmg.errors import UserError
    from mmg_ident.commands.fit_input import _reduced
    from mmg_ident.commands.output import is_model

    path = Path(where)
    if path.is_dir() and not (path / "ship.toml").exists():
        raise UserError(
            f"{where}: no ship.toml in it; give a run folder of mmg fit, a ship file or a ship of mmg ships"
        )
    if not path.is_dir() and not is_model(where):
        raise UserError(f"{where}: neither a run folder nor a ship file nor a ship of mmg ships")
    ship = load_ship(path / "ship.toml" if path.is_dir() else where)
    remarks = []
    if ship.network is not None:
        ship = ship.without_network()
        remarks.append("the learned residual is left out: what it learnt is what is to be explained")
    if not any(c.prior_std is not None for c in ship.coefficients.values()):
        remarks.append(
            f"{ship.name} was not calibrated: its coefficients are fitted here, from the priors that it states, and "
            "what these allow is not called a gap"
        )
    return _reduced(ship, list(without), None, None, None), remarks


def with_learned(
    found: Diagnosis,
    train: Sequence[Trial],
    tests: Sequence[Trial],
    seed: int = 0,
    workers: int = 1,
    tell: Callable[[str], None] = lambda words: None,
) -> Diagnosis:
    """The diagnosis with how much a learned residual closes of what has no name, or a warning why that is not known.

    As given where nothing is left without a name, and without test trials.
    """
    import time
    from dataclasses import replace

    from mmg.errors import UserError
    from mmg_ident.commands.output import needs_torch

    if not tests or not (found.verdict == "unknown" or found.remainder):
        return found
    began = time.perf_counter()
    try:
        needs_torch("a learned residual")
        from diagnosis.validation.learned import learned

        tell("learning what has no name, from the training trials")
        rest = learned(found.after, train, tests, found.data.h, seed, workers, say=tell)
    except UserError as reason:
        why = f"how much of the rest a learned residual closes was not measured: {reason}"
        return replace(found, warnings=(*found.warnings, why))
    seconds = time.perf_counter() - began
    spent = {**found.timings, "learned residual": seconds}
    if "total" in spent:
        spent["total"] = spent.pop("total") + seconds
    return replace(found, learned=rest, timings=spent)


def _calibrated_on(where: str, trials: Sequence[Trial], without: Sequence[str]) -> tuple[bool, list[Trial], list[str]]:
    """Whether a run was calibrated on none of these trials; the trials it was calibrated on, if so; remarks.

    They serve as a reference only where they can be read as they were, and for the model that was calibrated on them.
    """
    from cases.io.read import read_trials
    from fitting.report.run_folder import RESULT, read_result
    from mmg.errors import UserError

    if not (Path(where) / RESULT).exists():
        return False, [], []
    rows = [row for row in read_result(Path(where)).get("data", []) if row.get("sha256")]
    if not rows or {t.sha256 for t in trials} & {row["sha256"] for row in rows}:
        return False, [], []
    known = "the ship was calibrated on other trials: its estimates and standard errors are taken as known before"
    if without:
        return True, [], [known]
    paths = [Path(row["path"]) for row in rows if row.get("path")]
    try:
        old = read_trials([p for p in paths if p.is_file()])
    except UserError:
        old = []
    same = [t for t in old if t.sha256 in {row["sha256"] for row in rows}]
    if len(same) < len(rows):
        return True, [], [f"{known}; they cannot be read as they were, so they are no reference for their usual misfit"]
    return True, same, []


def _apart(train: Sequence[Trial], tests: Sequence[Trial]) -> tuple[list[Trial], list[str]]:
    """The test trials that share no rows with the others, and sentences on those left out."""
    from cases.checks.duplicates import duplicates

    if not tests:
        return [], []
    every = [*train, *tests]
    shared: dict[str, str] = {}
    hashes = {t.sha256: t.name for t in train if t.sha256}
    kept = []
    copies = duplicates(every)
    for i, t in enumerate(tests):
        others = {str(c.get("other")) for c in copies[len(train) + i][0]}
        others |= {every[j].name for j in range(len(train)) for c in copies[j][0] if c.get("other") == t.name}
        here = [o.name for o in train if o.name in others]
        if t.sha256 in hashes:
            here.append(hashes[t.sha256])
        if here:
            shared[t.name] = here[0]
        else:
            kept.append(t)
    words = [
        f"{name} shares rows with {other}, so it is no test and was left out of the check"
        for name, other in shared.items()
    ]
    if tests and not kept:
        words.append("no test trial is left: how far the gap closes was not checked")
    return kept, words


def write_diagnosis(
    out: Path,
    found: Diagnosis,
    content: dict[str, Any],
    train: Sequence[Trial],
    tests: Sequence[Trial],
    command: str,
    seed: int,
    seconds: float,
) -> None:
    """The folder: diagnosis.json, result.json, ship.toml, figures, report.html; whole or not at all."""
    from dataclasses import replace

    from cases.shipfiles.ship_file import dump_ship
    from diagnosis.report.page import write_report
    from fitting.report.run_folder import data_rows, versions, write_json, write_whole

    whole = replace(found, warnings=tuple(content["warnings"]))

    def fill(folder: Path) -> None:
        (folder / "ship.toml").write_text(dump_ship(whole.after, "refitted by mmg diagnose"), encoding="utf-8")
        write_json(folder / "diagnosis.json", content)
        figures = write_report(whole, folder)
        write_json(
            folder / "result.json",
            {
                "kind": "diagnosis",
                "command": command,
                "seed": seed,
                "versions": versions(),
                "data": data_rows(train),
                "test": data_rows(tests),
                "figures": figures,
                "warnings": content["warnings"],
                "timings_s": {**content["timings"], "wall": seconds},
            },
        )

    write_whole(out, fill)


def _summary(content: dict[str, Any], out: Path) -> None:
    """A few lines for a person."""
    from rich.console import Console
    from rich.table import Table

    from mmg_ident.commands.output import say

    for line in content["warnings"]:
        say(f"warning: {line}")
    console = Console(width=None)
    table = Table(title=f"verdict: {content['verdict']}", title_justify="left")
    for name in ("effect", "score", "p", "gain in BIC", "absorbed"):
        table.add_column(name, justify="left" if name == "effect" else "right")
    for row in content["candidates"][:8]:
        gain = "" if row["delta_bic"] is None else f"{row['delta_bic']:.1f}"
        if not row["excited"]:
            table.add_row(row["name"], "not excited", "", "", "")
        else:
            table.add_row(
                row["name"], f"{row['score']:.1f}", f"{row['p_value']:.1g}", gain, f"{row['absorbed_share']:.0%}"
            )
    console.print(table)
    console.print(content["sentence"], highlight=False, soft_wrap=True)
    if content["learned"]:
        console.print(content["learned"]["sentence"], highlight=False, soft_wrap=True)
    for line in content["kinematics"]:
        console.print(f"sensors: {line}", highlight=False, soft_wrap=True)
    if content["next_test"]:
        console.print(f"next: {content['next_test']}", highlight=False, soft_wrap=True)
    say(f"diagnosis: {out} (diagnosis.json, report.html, ship.toml)")
