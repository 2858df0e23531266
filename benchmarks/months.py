"""Months of operational data: time and memory of check and cut, dates of what changes, months without a change.

python -m benchmarks.months size [--record]                     30 days at 1 Hz: time and peak memory of each part
python -m benchmarks.months dates [--months 3] [--record]       changes that grow or happen, withheld, by two generators
python -m benchmarks.months quiet [--months 20] [--record]      months without a change, by both

A ship is calibrated on one month (the first, without a change) and judges the others as she is then, as an operator
would; ``size`` calibrates as well. Seeds: that of a month is its number, that of the ship is 1.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from pathlib import Path

from benchmarks.operation.coaster import coaster, coaster_month
from benchmarks.operation.months import Change, Month
from benchmarks.operation.tanker import tanker, tanker_month
from benchmarks.process import measured
from benchmarks.record import record, table
from cases.shipfiles.ship_file import dump_ship

GENERATORS = {"coaster": (coaster, coaster_month), "tanker": (tanker, tanker_month)}
CHANGES = {
    "fouling to 20 % over 30 days": {"fouling.share": Change(0.0, 30.0, 0.2)},
    "fouling from day 10 to 20 %": {"fouling.share": Change(10.0, 30.0, 0.2)},
    "gyro late by 3 s on day 12": {"gyro.T": Change(12.4, 12.4, 3.0)},
    "draught + 10 % on day 17": {"draft.share": Change(17.3, 17.3, 0.1)},
}
CHECK = """
import sys, time
from cases.operation.cutting import cut_log
from cases.operation.parts import read_log
from mmg_ident.months import checked
began = time.perf_counter()
cut = cut_log(checked(read_log(sys.argv[1])), float(sys.argv[2]))
print(cut.rows, len(cut.windows), time.perf_counter() - began)
"""


def made(generator: str, folder: Path, month: Month) -> Path:
    """The ``month`` by this ``generator`` in ``folder``, which is emptied before."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    GENERATORS[generator][1](folder, month)
    return folder


def calibrated(generator: str, work: Path) -> Path:
    """Ship file of the ship as it was calibrated on month 0."""
    run = work / f"{generator}_run"
    if not run.exists():
        start = work / f"{generator}.toml"
        start.write_text(dump_ship(GENERATORS[generator][0]()))
        data = made(generator, work / f"{generator}_0", Month(seed=0))
        words = ["-m", "mmg_ident", "months", str(data), "--ship", str(start), "--out", str(run), "--json"]
        seconds, memory, _ = measured(words)
        print(f"{generator}: calibrated in {seconds:.0f} s, {memory:.0f} MB", flush=True)
        shutil.rmtree(data)
    return run / "ship.toml"


def judged(generator: str, work: Path, month: Month) -> tuple[dict, float, float]:
    """months.json of a ``month``, seconds and peak memory [MB]."""
    data, out = made(generator, work / f"{generator}_month", month), work / f"{generator}_out"
    shutil.rmtree(out, ignore_errors=True)
    words = ["months", str(data), "--ship", str(calibrated(generator, work)), "--out", str(out), "--no-fit", "--json"]
    seconds, memory, text = measured(["-m", "mmg_ident", *words])
    return json.loads(text), seconds, memory


def size(work: Path) -> list[str]:
    """Time and memory of the parts of the work on 30 days."""
    rows = []
    for generator, (ship, _) in GENERATORS.items():
        data = made(generator, work / "size", Month(seed=0))
        seconds, memory, text = measured(["-c", CHECK, str(data), str(ship().particulars["L"])])
        count, windows, _ = text.split()
        rows.append([generator, "check and cut", count, windows, f"{seconds:.1f}", f"{memory:.0f}"])
        words = [
            "months",
            str(data),
            "--ship",
            str(calibrated(generator, work)),
            "--out",
            str(work / "kept"),
            "--no-fit",
        ]
        shutil.rmtree(work / "kept", ignore_errors=True)
        seconds, memory, _ = measured(["-m", "mmg_ident", *words, "--json"])
        rows.append([generator, "`mmg months --no-fit`", count, windows, f"{seconds:.1f}", f"{memory:.0f}"])
        (start := work / "start.toml").write_text(dump_ship(ship()))
        shutil.rmtree(out := work / "size_run", ignore_errors=True)
        words = ["months", str(data), "--ship", str(start), "--out", str(out), "--json"]
        seconds, memory, text = measured(["-m", "mmg_ident", *words])
        parts = ", ".join(f"{name} {value:.0f} s" for name, value in json.loads(text)["timings_s"].items())
        rows.append([generator, f"`mmg months` ({parts})", count, windows, f"{seconds:.1f}", f"{memory:.0f}"])
    return table(["generator", "what", "rows", "windows", "s", "peak MB"], rows)


def dates(work: Path, months: int) -> list[str]:
    """Dates of the changes, withheld."""
    rows = []
    for generator in GENERATORS:
        for name, changes in CHANGES.items():
            for seed in range(1, months + 1):
                found, *_ = judged(generator, work, Month(seed=100 + seed, changes=changes))
                ((parameter, true),) = changes.items()
                named = [r for r in found["changes"] if r["name"] == parameter]
                others = [f"{r['name']} day {r['begin_day']:.1f}" for r in found["changes"] if r["name"] != parameter]
                row = named[0] if named else None
                words = ["-", "-", "-", "-"] if row is None else [
                    f"{row['begin_day']:.1f}", f"{row['begin_90'][0]:.1f} to {row['begin_90'][1]:.1f}",
                    f"{abs(row['begin_day'] - true.begin):.1f}", f"{row['size']:.3g} of {true.size:g}"]  # fmt: skip
                rows.append([generator, name, str(100 + seed), *words, "; ".join(others) or "-"])
                print(rows[-1], flush=True)
    head = ["generator", "change", "seed", "begins, day", "90 %", "error, days", "size", "also named"]
    return table(head, rows)


def quiet(work: Path, months: int) -> list[str]:
    """Changes that are invented."""
    rows = []
    for generator in GENERATORS:
        invented, least, seconds = [], 1.0, []
        for seed in range(1, months + 1):
            found, took, _ = judged(generator, work, Month(seed=seed))
            seconds.append(took)
            invented += [f"{r['name']} (seed {seed})" for r in found["changes"]]
            least = min([least, *(r["p_value"] * len(found["candidates"]) for r in found["candidates"])])
            print(generator, seed, [r["name"] for r in found["changes"]], f"{least:.2g}", f"{took:.0f} s", flush=True)
        words = f"{len(invented)}" + (f": {', '.join(invented)}" if invented else "")
        rows.append([generator, str(months), words, f"{least:.2g}", f"{sum(seconds) / months:.0f}"])
    return table(["generator", "months", "changes invented", "least chance, all candidates", "s per month"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("size", "dates", "quiet"))
    parser.add_argument("--months", type=int)
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "mmg_months")
    parser.add_argument("--only", choices=tuple(GENERATORS))
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    for name in [name for name in GENERATORS if given.only and name != given.only]:
        del GENERATORS[name]
    months = given.months or {"size": 1, "dates": 3, "quiet": 20}[given.what]
    lines = {"size": lambda: size(given.work), "dates": lambda: dates(given.work, months),
             "quiet": lambda: quiet(given.work, months)}[given.what]()  # fmt: skip
    title = {"size": "Months of operational data: time and memory", "dates": "Months: dates of what changes",
             "quiet": "Months without a change"}[given.what]  # fmt: skip
    if given.record:
        record(title, f"python -m benchmarks.months {given.what}", lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
