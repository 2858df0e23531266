"""What mechanisms do to the IMO figures of new ships (``benchmarks/yards.py``), with each switched off."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.ablation.switches import Switch, constantly, replaced
from benchmarks.measured import Record
from benchmarks.record import table
from benchmarks.yards import FIRST, YARDS, judged
from fitting.report import result_rows

SEEDS = range(FIRST, FIRST + 3)
"""Of the ships of each generator."""


def discounted(found: Any) -> dict[str, Any]:
    """Correlations of the information discounted for its dispersion, beside robust errors."""
    return {"symbols": found.prior.symbols, "matrix": found.identifiability.correlation}


SWITCHES = (
    Switch("as it is", "nothing"),
    Switch("wake by sides", "the wake of a starting ship changes alike with flow from both sides (no tau_a)",
           replaced={"cases.shipfiles.new_ship:ASYMMETRY": ()}),
    Switch("one covariance", "robust errors beside correlations of the discounted information",
           replaced={f"{result_rows.__name__}:correlation_of": discounted}),
    Switch("few runs", "figures and bands by the normal distribution, however few the runs",
           replaced={"fitting.prediction.band_calibration:student_factor": constantly(1.0)}),
)  # fmt: skip
TASKS = [
    ({"row": switch.name, "ground": kind, "fold": str(seed)}, (switch.name, kind, seed))
    for seed in SEEDS
    for kind in YARDS
    for switch in SWITCHES
]


def yard_task(name: str, kind: str, seed: int) -> dict[str, Any]:
    """What becomes of a ship with the switch ``name`` off."""
    used = time.process_time()
    with replaced(next(s for s in SWITCHES if s.name == name).replaced):
        one = judged(kind, seed)
    kept = {key: np.asarray(values).tolist() for key, values in vars(one).items()}
    return kept | {"processor": time.process_time() - used}


def yard_rows(record: Record) -> dict[str, Any]:
    """Counts and sizes by switch and generator, of the code that was measured last, on ships that all switches had."""
    rows = record.of(code=record.rows[-1]["code"]) if record.rows else []
    by_ship = {(kind, str(seed)): [r for r in rows if (r["ground"], r["fold"]) == (kind, str(seed))]
               for kind in YARDS for seed in SEEDS}  # fmt: skip
    whole = [row for ship in by_ship.values() if len(ship) == len(SWITCHES) for row in ship]
    found: dict[str, Any] = {}
    for switch in SWITCHES:
        grounds = {}
        for kind in YARDS:
            some = [r for r in whole if (r["row"], r["ground"]) == (switch.name, kind)]
            if some:
                joined = {
                    k: np.concatenate([r[k] for r in some]) for k in ("inside", "width", "error", "named", "false")
                }
                counts = {k: [int(joined[k].sum()), len(joined[k])] for k in ("inside", "named", "false")}
                error = float(np.sqrt(np.mean(joined["error"] ** 2)))
                grounds[kind] = counts | {
                    "ships": len(some),
                    "width": float(np.median(joined["width"])),
                    "error": error,
                }
        if grounds:
            found[switch.name] = {"off": switch.off, "commit": rows[-1]["commit"], "grounds": grounds}
    return found


def yard_lines(kept: dict[str, Any]) -> list[str]:
    """The table of the ``kept`` rows."""
    head = ["switched off", "generator", "ships", "inside", "width", "rms error", "hidden named", "false", "commit"]
    cells = [
        [f"{name}: {row['off']}", kind, str(g["ships"]), "{} of {}".format(*g["inside"]), f"{g['width']:.1%}",
         f"{g['error']:.1%}", "{} of {}".format(*g["named"]), "{} of {}".format(*g["false"]), row["commit"]]
        for name, row in kept.items() for kind, g in row["grounds"].items()
    ]  # fmt: skip
    return table(head, cells)
