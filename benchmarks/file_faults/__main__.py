"""Does ``mmg check`` say of files what is wrong with them, and is what it advises right?

``python -m benchmarks.file_faults [--plant own] [--seeds 1 2 3]``: each fault in each of 8 sets of ship and manoeuvres
(3 m to 320 m, zigzags of 5 to 20 deg and turns, 1 to 20 Hz, wind, current, rounded columns) of a plant that is not the
package's, in CSV files; or, with ``--plant own``, in trials that the package simulated (``simulated.py``). Named: among
what is contradictory or doubtful is a code of the fault and no other, in files that have it.
Harmful: the lines that are printed for trials.toml, written there, cannot be read, or leave more than NEARER of the
distance from the truth. False alarm: anything contradictory or doubtful in files that are as they should be, but for a
gain: the logs of these ships read up to 1.5 % wrong. ``--plant filtered``: sets of seven sound files whose velocities
are filtered, of which none may be called contradictory, nor a line be advised for them.
"""

from __future__ import annotations

import re
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.file_faults import simulated
from benchmarks.file_faults.faults import FAULTS, Fault
from benchmarks.file_faults.plant import SETS, drawn
from benchmarks.record import Figure, parser_of, report
from cases.checks import CheckReport, check
from cases.io.read import read_trials
from cases.quantities import UNITS
from cases.trial import Trial
from mmg.errors import UserError

ADVICE = re.compile(r'trials\.toml, (\[default\]|\[files\."[^"]+"\]): (.+?)(?:\.$|\. |$)', re.MULTILINE)
COLUMNS = ("x", "y", "psi", "u", "v", "r", "delta", "n", "t")
SEALED = (1701, 1702, 1703)
"""Seeds of the measure that counts, written down before they were run for the first time; the checks were made with the
seeds 1 to 4."""

SOUND = 200
"""Sets of seven sound files with filtered velocities."""

NEARER = 0.7
"""Advice that leaves more than this share of the distance from the truth is harmful."""

Files = list[dict[str, np.ndarray]]
Answer = tuple[str, str]
"""What an answer is worth, and what was said."""
T = TypeVar("T")


def written(folder: Path, files: Files, labels: Mapping[str, str]) -> None:
    """A CSV file for each of ``files``, run_0.csv and so on, in ``folder``, with these ``labels`` for units."""
    for number, columns in enumerate(files):
        header = ",".join(f"{name} [{labels.get(name, UNITS[name])}]" for name in columns)
        rows = np.column_stack(list(columns.values()))
        np.savetxt(folder / f"run_{number}.csv", rows, "%.7g", ",", header=header, comments="")


def said(folder: Path) -> list[CheckReport]:
    """What ``mmg check`` says of the files of ``folder``."""
    try:
        return check(read_trials(folder))
    except UserError as error:
        print("   unread:", error)
        return []


def far(trials: list[Trial], truth: Files) -> float:
    """Greatest difference of a column of ``trials`` from the ``truth``, over the size of that column."""
    worst = 0.0
    for trial, columns in zip(trials, truth, strict=True):
        for name in COLUMNS:
            want, got = columns[name], trial.psi_unwrapped if name == "psi" else trial[name]
            if name == "t":
                worst = max(worst, abs(float(np.ptp(got) / np.ptp(want)) - 1))
                continue
            if len(got) != len(want):
                got = np.interp(columns["t"], trial.t, got, np.nan, np.nan)
            off = np.angle(np.exp(1j * (got - want))) if name == "psi" else got - want
            size = 0.3 if name == "psi" else float(np.std(want)) if name in "xy" else float(np.sqrt(np.mean(want**2)))
            known = np.isfinite(off)
            worst = max(worst, float(np.sqrt(np.mean(off[known] ** 2))) / size)
    return worst


def judged(files: Files, truth: Files, fault: Fault | None) -> tuple[str, str]:
    """("named", "other", "missed", "alarm" or "quiet", " harmful" or ""), and what was said, of ``files``."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(folder, files, fault.labels if fault else {})
        reports = said(folder)
        loud = [[f for f in report.findings if f.level in ("contradictory", "doubtful")] for report in reports]
        loud = [[f for f in some if f.code not in ("duplicate", "gain")] for some in loud]
        soft = [[f for f in report.findings if f.code == "broken_stretch"] for report in reports]
        advice = dict.fromkeys(pair for some in loud for f in some for pair in ADVICE.findall(f.text))
        harm = harmful(folder, truth, list(advice)) if advice else ""
    codes = [{f.code for f in some} for some in loud]
    words = "; ".join(f"{i}: {', '.join(sorted(c))}" for i, c in enumerate(codes) if c) + harm
    if fault is None:
        return ("alarm" if any(codes) else "quiet"), words
    has = [k for k in range(len(files)) if not fault.one or k == 0]
    allowed = set(fault.codes)
    if "sentinel" in allowed:  # what is then missing is a gap
        codes = [c - {"gaps", "missing_samples"} for c in codes]
    if "broken_stretch" in allowed:
        codes = [c | {f.code for f in s} for c, s in zip(codes, soft, strict=True)]
    if not any(codes):
        return "missed" + (" harmful" if harm else ""), words
    found = [k for k, c in enumerate(codes) if c & allowed]
    stray = any(c - allowed for c in codes) or (fault.one and found != has)
    kind = "other" if stray or not found else "named"
    return kind + (" harmful" if harm else ""), words


def harmful(folder: Path, truth: Files, advice: list[tuple[str, str]]) -> str:
    """What is wrong with an ``advice`` (table and line) that was followed, in words; "" where it was right."""
    before = far(read_trials(folder), truth)
    tables: dict[str, list[str]] = {}
    for table, line in advice:
        tables.setdefault(table, []).extend(part.strip() for part in line.split(" and "))
    text = "\n".join("\n".join([table, *dict.fromkeys(lines)]) for table, lines in tables.items())
    (folder / "trials.toml").write_text(text + "\n", encoding="utf-8")
    try:
        after = far(read_trials(folder), truth)
    except UserError as error:
        return f" HARM {text!r}: {error}"
    return "" if after < NEARER * before else f" HARM {text!r}: {before:.3g} -> {after:.3g}"


def broken(truth: Files, fault: Fault, name: str, seed: int, title: str) -> Files:
    """The files of the set ``name`` with the ``fault``."""
    hull, out = SETS[name].hull, list(truth)
    for number, columns in enumerate(truth[:1] if fault.one else truth):
        rng = np.random.default_rng([seed, zlib.crc32(title.encode()), 0])
        out[number] = {**columns, **fault.change(columns, hull.length, hull.speed, rng)}
    return out


def of_files(truth: Files, title: str, name: str, seed: int) -> tuple[str, str]:
    """What is said of the files of the set ``name`` with the fault ``title``, "" for none."""
    fault = FAULTS[title] if title else None
    return judged(broken(truth, fault, name, seed, title) if fault else truth, truth, fault)


def tally(titles: Iterable[str], sets: Mapping[str, T], judge: Callable[[T, str, str], Answer | None]) -> Counter[str]:
    """How often each of ``titles`` of faults is named, missed and so on; prints a row of each, and what is not as it
    should be. judge: of a set, a title and the name of the set."""
    total: Counter[str] = Counter()
    for title in titles:
        found = {name: said for name, some in sets.items() if (said := judge(some, title, name))}
        good = "named" if title else "quiet"
        bad = {name: answer for name, answer in found.items() if answer[0] != good}
        notes = [f"     {kind}: {name}: {words or 'nothing said'}" for name, (kind, words) in bad.items()]
        row = Counter(kind for kind, _ in found.values())
        print(f"{title or 'as they should be':38s} {good} {row[good]} of {len(found)}", *notes, sep="\n", flush=True)
        total += row
    return total


def filtered(sets: Iterable[int]) -> Counter[str]:
    """What is said of each of the ``sets`` with filtered velocities, by number; prints what should not be."""
    found: Counter[str] = Counter()
    for seed in sets:
        kind, words = simulated.judged_sound(simulated.filtered(seed))
        found[kind] += 1
        print("" if kind == "quiet" else f"     {kind}: {seed}: {words}\n", end="", flush=True)
    return found


def main() -> None:
    """Prints a row per fault: in how many sets it is named, missed, taken for something else; and what harms."""
    parser = parser_of("file_faults", __doc__)
    parser.add_argument("--plant", choices=("foreign", "own", "filtered"), default="foreign", help="of the trials")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEALED))
    parser.add_argument("--faults", default="", help="only those whose name holds these words")
    parser.add_argument("--sets", default="", help="only those whose name holds these words")
    args = parser.parse_args()
    if args.plant == "filtered":
        wrong = SOUND - filtered(range(SOUND))["quiet"]
        made = Figure("sound sets with filtered velocities that are refuted or given a line", wrong, of=SOUND)
        return report({"files_filtered": made}, "file_faults --plant filtered", args.record)
    total: Counter[str] = Counter()
    for seed in args.seeds:
        if args.plant == "own":
            titles = [title for title in simulated.FAULTS if args.faults in title]
            own = {name: some for name, some in simulated.sets(seed).items() if args.sets in name}
            total += tally(["", *titles], own, lambda some, title, _: simulated.judged(some, title))
        else:
            titles = [title for title in FAULTS if args.faults in title]
            files = {name: drawn(name, seed) for name in SETS if args.sets in name}
            total += tally(["", *titles], files, partial(of_files, seed=seed))
    alarms, sound = total["alarm"], total.pop("alarm", 0) + total.pop("quiet", 0)
    count, harms = sum(total.values()), sum(v for k, v in total.items() if "harmful" in k)
    named = sum(v for k, v in total.items() if k.startswith("named"))
    print(dict(total))
    of = {"foreign": "files of another plant", "own": "simulated trials"}[args.plant]
    made = {f"files_{args.plant}": Figure(f"faults of {of} named", named, of=count)}
    made[f"files_{args.plant}_alarms"] = Figure(f"false alarms in sound {of}", alarms, of=sound)
    if args.plant == "foreign":
        made["files_foreign_harmful"] = Figure(f"advice on {of} that would harm", harms, of=count)
    report(made, f"file_faults --plant {args.plant} --seeds {' '.join(map(str, args.seeds))}", args.record)


if __name__ == "__main__":
    main()
