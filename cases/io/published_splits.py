"""The published train/test splits of the FRT-DS-ESSO records, from the table of file names beside this file.

Source: correspondence tables of the data set's README (Wakita et al. 2022, J Mar Sci Technol 27(1)
772-785; Miyauchi et al. 2022, J Mar Sci Technol 27(2) 1065-1083). The data are CC BY-NC-SA 4.0 by
their licence file (their README says CC BY-NC 4.0) and are not part of this package; only the names are.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable
from pathlib import Path

from mmg.errors import Missing

with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as _table:
    _rows = list(csv.DictReader(_table))

# Every split by its name on the command line. "test" is never read while developing; "development-holdout" are five
# records of Train-TZRB+, which is every record but the test set, kept out of every fit and choice, for figures of
# accuracy.
SPLITS = {name: [row["record"] for row in _rows if row[name]] for name in list(_rows[0])[1:]}
# Wakita 2022, by kind: turning, zigzag, random, berthing.
TRAIN_TZB, TRAIN_TZRB, TRAIN_TZRB_PLUS, TEST, DEVELOPMENT_HOLDOUT = list(SPLITS.values())[:5]
MIYAUCHI_TRAIN_R, MIYAUCHI_TRAIN_TR, MIYAUCHI_TRAIN_TRZ, MIYAUCHI_TEST = list(SPLITS.values())[5:]  # Miyauchi 2022


def data_folder() -> Path:
    """The folder that holds ``frt-ds-esso``: $MMG_DATA, else ../shared/data from here or from the repository. Raises
    UserError when none of them exists."""
    if named := os.environ.get("MMG_DATA"):
        if not Path(named).is_dir():
            raise Missing(f"MMG_DATA={named}: no such folder; set it to the folder that holds frt-ds-esso")
        return Path(named)
    for base in (Path.cwd(), Path(__file__).resolve().parents[2]):
        if (base / "../shared/data").is_dir():
            return (base / "../shared/data").resolve()
    raise Missing("no ../shared/data here: set MMG_DATA to the folder that holds frt-ds-esso")


def find(names: Iterable[str]) -> list[Path]:
    """Paths of the records with these ``names``, in their order. Raises UserError naming the records that are not on
    this machine."""
    folder = data_folder() / "frt-ds-esso"
    if not folder.is_dir():
        raise Missing(f"{folder}: no such folder; clone FRT-DS-ESSO there or set MMG_DATA to its parent")
    at = {path.stem: path for path in sorted(folder.glob("*/*.csv"))}
    wanted = list(names)
    missing = [name for name in wanted if name not in at]
    if missing:
        of_test = len(set(missing) & set(TEST))  # a checkout may leave these out on purpose
        reason = f" ({of_test} of them in the published test set)" if of_test else ""
        words = f"{len(missing)} of {len(wanted)} records are not there{reason}: {', '.join(missing)}"
        raise Missing(f"{folder}: {words}")
    return [at[name] for name in wanted]
