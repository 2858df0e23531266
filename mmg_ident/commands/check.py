"""`mmg check`: what trial files say about themselves before anything is fitted to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg.errors import UserError
from mmg_ident.commands import options as o
from mmg_ident.commands.output import each, print_json, print_table, print_wrapped, working

if TYPE_CHECKING:
    from cases.checks import CheckReport
    from cases.trial import Trial
    from mmg.ship import Ship


def check(
    trials: o.Trials,
    ship: Annotated[str | None, Option(help="Ship whose coefficients the trials are to excite.")] = None,
    every: Annotated[bool, Option("--all", help="Every sentence on every file, not only what is wrong.")] = False,
    json: o.Json = False,
) -> None:
    """Check trial files: units, signs, frames, gaps, duplicates, lags, excitation; a verdict per file and per folder.

    Example: mmg check data/turning data/zigzag/run_07.csv --ship esso_osaka_3m

    Exit code 0 when every file could be read, whatever its verdict; 2, after the report on the others, when one could
    not.
    """
    from cases.checks import check as check_trials
    from cases.checks import pooled
    from cases.checks.propulsion import doubtful_revolutions
    from cases.io.read import read_trial, trial_files
    from cases.shipfiles.ship_file import load_ship

    model = load_ship(ship) if ship else None
    found, unreadable, files = [], [], []
    for path in trials:
        try:
            files += trial_files([path])
        except UserError as error:
            unreadable.append((path, error))
    for path in each(list(dict.fromkeys(files)), "reading"):
        try:
            found.append(read_trial(path, refuse=False))
        except UserError as error:
            unreadable.append((path, error))
    if not found:
        raise _of_all(unreadable)
    with working(f"checking {len(found)} trials"):
        reports = check_trials(found)
        seconds, sentences = pooled(reports, model)
        doubts = [*doubtful_revolutions(model, found), *_taken(model, found)] if model else []
        sentences = [*(f"{doubt[0].upper()}{doubt[1:]}." for doubt in doubts), *sentences]
    if json:
        print_json(_document(reports, unreadable, seconds, sentences))
    else:
        together = sentences if len(reports) > 1 or model else None
        _print(reports, together, every or len(reports) == 1, unreadable)
    if len(unreadable) > 1 and not json:
        raise type(unreadable[0][1])(f"{len(unreadable)} files cannot be read, as said above")
    if unreadable:
        raise _of_all(unreadable)


def _taken(ship: Ship, trials: list[Trial]) -> list[str]:
    """What the ``ship`` assumes of the ``trials`` or ignores, and of which trials she cannot be."""
    from cases.inputs import model_inputs

    said: list[str] = []
    for trial in trials:
        try:
            said += model_inputs(trial, ship.inputs).notices
        except UserError as error:
            said.append(str(error))
    return said


def _of_all(unreadable: list[tuple[Path, UserError]]) -> UserError:
    """What is wrong with all files that could not be read, each sentence once; of the kind of the first."""
    many = f"{len(unreadable)} files cannot be read: " if len(unreadable) > 1 else ""
    return type(unreadable[0][1])(many + "; ".join(dict.fromkeys(str(error) for _, error in unreadable)))


def _document(
    reports: list[CheckReport],
    unreadable: list[tuple[Path, UserError]],
    seconds: Mapping[str, float],
    sentences: Sequence[str],
) -> dict[str, Any]:
    """{"files": [report, ...], "folders": [{"path", "verdict", "files"}, ...], "pooled": {"group_seconds": {...},
    "sentences": [...]}}.

    A file that could not be read is a report with the verdict "contradictory" and no numbers. The verdict of a folder
    is the worst of its files.
    """
    files: list[dict[str, Any]] = [report.as_dict() for report in reports]
    for path, error in unreadable:
        finding = {"topic": "reading", "level": "contradictory", "code": "unreadable", "text": str(error)}
        head = {"name": path.stem, "path": str(path), "verdict": "contradictory"}
        files.append({**head, "findings": [finding], "numbers": {}})
    folders: dict[str, list[str]] = {}
    for row in files:
        folders.setdefault(str(Path(row["path"]).parent), []).append(row["verdict"])
    rows = [{"path": path, "verdict": worst(verdicts), "files": len(verdicts)} for path, verdicts in folders.items()]
    return {"files": files, "folders": rows, "pooled": {"group_seconds": dict(seconds), "sentences": list(sentences)}}


def worst(verdicts: Sequence[str]) -> str:
    """The verdict of a folder whose files have these ``verdicts``."""
    return next((v for v in ("contradictory", "doubtful") if v in verdicts), "ok")


def _print(
    reports: list[CheckReport],
    together: Sequence[str] | None,
    every: bool,
    unreadable: list[tuple[Path, UserError]],
) -> None:
    """A table with one line per file, what is wrong (``every``: and all else), and sentences on all files together."""
    rows = [(report.name, report.verdict, *_cells(report)) for report in reports]
    rows += [(path.stem, "unreadable", *[""] * 6) for path, _ in unreadable]
    print_table(("trial", "verdict", "rows|n", "s|n", "dt|n", "lag uv r, s|n", "wind/U|n", "n, rps|n"), rows)
    marks = {"info": "     ", "doubtful": "  !  ", "contradictory": "  !! "}
    for _, error in unreadable if len(unreadable) > 1 else ():
        print_wrapped("  !! ", str(error))
    if every:
        for report in reports:
            print(f"\n{report.name}: {report.verdict}")
            for finding in sorted(report.findings, key=lambda f: f.level == "info"):
                print_wrapped(marks[finding.level], finding.text)
    else:
        for (level, text), names in _together(reports).items():
            print_wrapped(marks[level], f"{_listed(names, len(reports))}: {text}")
    if together is not None:
        print("\nAll files together")
        for text in together or ["Every coefficient group is excited."]:
            print_wrapped("     ", text)
    if not every:
        print("\nEvery sentence on every file: --all")


def _together(reports: list[CheckReport]) -> dict[tuple[str, str], list[str]]:
    """What is wrong, and stretches that are left out: (level, sentence) -> names of the files, the worst first."""
    found: dict[tuple[str, str], list[str]] = {}
    for report in reports:
        for finding in report.findings:
            if finding.level != "info" or finding.code == "broken_stretch":
                found.setdefault((finding.level, finding.text), []).append(report.name)
    order = ("contradictory", "doubtful", "info")
    return dict(sorted(found.items(), key=lambda item: order.index(item[0][0])))


def _listed(names: list[str], of: int) -> str:
    """The files with a sentence in common."""
    if len(names) == of:
        return "all files"
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _cells(report: CheckReport) -> list[str]:
    """Rows, duration, step, lags, wind ratio and range of revolutions of one file as short text."""
    sampling, excitation = report.numbers["sampling"], report.numbers["excitation"]
    late = report.numbers["kinematics"]["lag_s"]
    velocities = late["u, v"] if late["x, y"] is None else -late["x, y"]  # over ground, turned by the present heading
    lags = [_short(lag, "5.2f") for lag in (velocities, late["r"])]
    low, high = excitation.get("n_range_rps", (None, None))
    return [
        str(sampling["rows"]),
        f"{sampling['duration_s']:.0f}",
        f"{sampling['dt_s']:.3g}",
        " ".join(lags),
        _short(report.numbers["wind"]["ratio_to_ship_speed"], ".1f"),
        f"{_short(low, '.3g')}..{_short(high, '.3g')}",
    ]


def _short(value: float | None, form: str) -> str:
    return "-".rjust(int(form[0]) if form[0].isdigit() else 0) if value is None else format(value, form)
