"""What a calibration's mechanisms are worth: predictions of runs that it did not see, with each switched off.

Three grounds. Records: the 35 of Train-TZRB+ in five folds by day and kind. Gunnerus: seven runs of a full-scale ship,
by a fit to eleven others. Two generators of ``benchmarks/blind``: the test trials of cases that have a cause which
the model lacks. Errors are those of ``mmg score``, mean of files, of windows of 30 s and restarts every 100 s,
without and with 30 s of past.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.ablation.switches import Switch, replaced
from benchmarks.accuracy import PAST, Fold, records
from benchmarks.blind.cases import blind_ship, dealt, folders
from benchmarks.blind.generator.world import WORLDS
from cases.io import published_splits as splits
from cases.shipfiles.new_ship import new_ship
from cases.trial_set import TrialSet
from fitting.calibrate import FitOptions
from fitting.prediction.score import pooled_sigma, score
from fitting.result import FitResult
from fitting.settings import Settings
from mmg_ident.api import calibrate

SWITCHES = (
    Switch("as it is", "nothing"),
    Switch("no campaigns", "no values by campaign", options={"per_campaign": ("none",)}),
    Switch("windows of 100 s", "windows of 100 s, which is usual for a ship of 3 m", settings={"window": 100.0}),
    Switch("windows of 50 s", "windows of 50 s", settings={"window": 50.0}),
    Switch("windows alone", "no second estimate (multiple shooting alone)", options={"estimator": "windows"}),
    Switch("filter alone", "the second estimate alone", replaced={"fitting.calibration:SHARE": 1.0}),
    Switch("no velocity filter", "no lag of the velocity filter", options={"instruments": ()}),
    Switch("weight 0.1", "each run counts with 10 % of its information", settings={"weight": 0.1}),
    Switch("student", "Student's loss", settings={"loss": "student"}),
)  # fmt: skip
"""Each is measured against the first."""
METRICS = ("30 s", "100 s", "30 s, past", "100 s, past")
GENERATED = {"pond": 12, "kvlcc2": 12}
"""Worlds whose cases are fitted, and how many of each."""
SEED = 4901
"""Of those cases."""
GUNNERUS = {"L": 33.9, "B": 9.6, "d": 2.7, "C_b": 0.604, "U_0": 5.4, "D_P": 1.9}
"""Particulars of R/V Gunnerus as a ship with one screw and a rudder [m, m/s] (shiplab/gunnerus)."""


def gunnerus(work: Path) -> Iterator[Fold]:
    """Eleven runs to fit and seven left out, cut by the data set's own script, with the azimuth as a rudder."""
    data, cut = splits.data_folder() / "gunnerus", work / "gunnerus"
    if not (cut / "rudder").is_dir():
        (cut / "raw").mkdir(parents=True, exist_ok=True)
        record = data / "RVG_ManeuveringTests.csv"
        (cut / "raw" / record.name).write_bytes(record.read_bytes())
        subprocess.run([sys.executable, str(data / "prepare.py"), "rudder"], cwd=cut, check=True)
    train, out = (TrialSet.of(cut / "rudder" / part).sound for part in ("train", "held"))
    yield Fold("gunnerus", "all", new_ship("gunnerus", GUNNERUS), train, out, pooled_sigma(out))


def generated(work: Path, world: str) -> Iterator[Fold]:
    """Cases of a ``world`` of ``benchmarks/blind``, each with an effect of the library."""
    folder = work / f"fits_{world}"
    dealt(folder, world, "library", GENERATED[world], SEED)
    for case in folders(folder):
        train, out = (TrialSet.of(case / part).sound for part in ("train", "test"))
        yield Fold(world, case.name, blind_ship(WORLDS[world].ship), train, out, pooled_sigma(out))


def grounds(work: Path) -> list[Fold]:
    """All folds; work: folder of what is generated."""
    return [*records(), *gunnerus(work), *(fold for world in GENERATED for fold in generated(work, world))]


def fitted(switch: Switch, fold: Fold) -> FitResult:
    """The calibration on a ``fold`` with a ``switch``."""
    settings = replace(Settings(), **switch.settings)
    options = replace(FitOptions(next_trial=False), **switch.options)
    with replaced(switch.replaced):
        return calibrate(fold.ship, fold.train, (), settings, options)


def measured(switch: Switch, fold: Fold) -> dict[str, Any]:
    """What is kept of a ``switch`` on a ``fold``: errors by trial and metric."""
    began, used = time.perf_counter(), time.process_time()
    found = fitted(switch, fold)
    seconds = {"seconds": time.perf_counter() - began, "processor": time.process_time() - used}
    assert found.objects is not None
    files: dict[str, list[float | None]] = {t.name: [] for t in fold.out}
    for past in (None, PAST):
        for row in score(found.objects.after, fold.out, fold.sigma, adapt=past).trials:
            files[row.name] += [row.window if row.windows else None, row.paper if row.restarts else None]
    return {"converged": found.converged, **seconds, "files": files}


def change(before: dict[str, Any], after: dict[str, Any], metric: int) -> tuple[float, float, float]:
    """Mean of files before, and the share by which it changes, with the jackknife error over clusters: the files of
    records and of Gunnerus, the cases of a generator.

    before, after: errors by cluster -> file -> metric.
    """
    pairs = []
    for cluster, files in before.items():
        rows = [(v[metric], after[cluster][name][metric]) for name, v in files.items()]
        rows = [(a, b) for a, b in rows if a is not None and b is not None]
        if rows:
            pairs.append(np.array([*np.sum(rows, axis=0), len(rows)]))
    if len(pairs) < 2:
        return np.nan, np.nan, np.nan
    total = np.sum(pairs, axis=0)
    each = np.array([(total - p)[1] / (total - p)[0] for p in pairs])
    n = len(each)
    return total[0] / total[2], total[1] / total[0] - 1, float(np.sqrt((n - 1) / n * ((each - each.mean()) ** 2).sum()))
