"""The published train/test splits of the FRT-DS-ESSO records, as lists of file names without suffix.

Source: correspondence tables of the data set's README (Wakita et al. 2022, J Mar Sci Technol 27(1)
772-785; Miyauchi et al. 2022, J Mar Sci Technol 27(2) 1065-1083). The data are CC BY-NC-SA 4.0 by
their licence file (their README says CC BY-NC 4.0) and are not part of this package; only the names are.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from mmg.errors import UserError

TRAIN_TZB = [
    "turn_14-Sep-2020_13_39_32",
    "turn_14-Sep-2020_14_16_04",
    "turn_14-Sep-2020_15_58_08",
    "turn_cut_14-Sep-2020_16_09_02",
    "zigzag_31-Jul-2020_13_22_52",
    "zigzag_31-Jul-2020_13_29_19",
    "zigzag_31-Jul-2020_13_50_28",
    "zigzag_31-Jul-2020_13_57_45",
    "zigzag_31-Jul-2020_14_03_39",
    "berthing_12-Nov-2020_11_14_47",
    "berthing_12-Nov-2020_13_37_05",
]
"""Wakita 2022, Train-TZB: turning, zigzag, berthing."""

TRAIN_TZRB = [
    "random_06-Aug-2020_16_24_25_4",
    "random_06-Aug-2020_16_24_25_6",
    "turn_cut_14-Sep-2020_15_58_08",
    "turn_cut_14-Sep-2020_16_09_02",
    "zigzag_31-Jul-2020_13_22_52",
    "zigzag_31-Jul-2020_13_50_28",
    "berthing_12-Nov-2020_11_14_47",
    "berthing_12-Nov-2020_13_37_05",
]
"""Wakita 2022, Train-TZRB: turning, zigzag, random, berthing."""

TRAIN_TZRB_PLUS = [
    "random_03-Aug-2020_11_04_37",
    "random_06-Aug-2020_16_24_25_1",
    "random_06-Aug-2020_16_24_25_4",
    "random_06-Aug-2020_16_24_25_5",
    "random_06-Aug-2020_16_24_25_6",
    "random_31-Jul-2020_12_29_58",
    "random_31-Jul-2020_12_48_39",
    "random_31-Jul-2020_14_52_18",
    "turn_14-Oct-2020_14_08_51",
    "turn_14-Oct-2020_14_17_39",
    "turn_14-Oct-2020_14_29_49",
    "turn_14-Oct-2020_14_39_54",
    "turn_14-Oct-2020_14_56_07",
    "turn_14-Oct-2020_15_21_57",
    "turn_14-Sep-2020_13_39_32",
    "turn_14-Sep-2020_13_51_45",
    "turn_14-Sep-2020_14_16_04",
    "turn_14-Sep-2020_14_50_41",
    "turn_14-Sep-2020_15_47_33",
    "turn_14-Sep-2020_15_58_08",
    "turn_cut_14-Sep-2020_15_58_08",
    "turn_cut_14-Sep-2020_16_09_02",
    "zigzag_31-Jul-2020_13_04_24",
    "zigzag_31-Jul-2020_13_14_21",
    "zigzag_31-Jul-2020_13_22_52",
    "zigzag_31-Jul-2020_13_29_19",
    "zigzag_31-Jul-2020_13_50_28",
    "zigzag_31-Jul-2020_13_57_45",
    "zigzag_31-Jul-2020_14_03_39",
    "zigzag_31-Jul-2020_14_10_05",
    "berthing_12-Nov-2020_11_07_23",
    "berthing_12-Nov-2020_11_14_47",
    "berthing_12-Nov-2020_11_21_46",
    "berthing_12-Nov-2020_13_09_11",
    "berthing_12-Nov-2020_13_37_05",
]
"""Wakita 2022, Train-TZRB+: every record but the test set."""

TEST = [
    "random_06-Aug-2020_16_24_25_3",
    "turn_14-Oct-2020_15_06_53",
    "zigzag_31-Jul-2020_13_42_53",
    "berthing_12-Nov-2020_11_38_50",
    "berthing_12-Nov-2020_11_49_21",
    "berthing_12-Nov-2020_13_21_03",
]
"""Wakita 2022, Test (TZRB): never read while developing."""

DEVELOPMENT_HOLDOUT = [
    "random_06-Aug-2020_16_24_25_5",
    "turn_14-Oct-2020_14_56_07",
    "zigzag_31-Jul-2020_14_10_05",
    "berthing_12-Nov-2020_11_07_23",
    "berthing_12-Nov-2020_13_09_11",
]
"""Five records of Train-TZRB+ kept out of every fit and choice, for figures of accuracy."""

MIYAUCHI_TRAIN_R = [
    "random_06-Aug-2020_16_24_25_1",
    "random_06-Aug-2020_16_24_25_4",
    "random_06-Aug-2020_16_24_25_5",
    "random_06-Aug-2020_16_24_25_6",
]
"""Miyauchi 2022, Train-R."""

MIYAUCHI_TRAIN_TR = [
    "random_06-Aug-2020_16_24_25_4",
    "random_06-Aug-2020_16_24_25_5",
    "random_06-Aug-2020_16_24_25_6",
    "turn_cut_14-Sep-2020_15_58_08",
    "turn_cut_14-Sep-2020_16_09_02",
]
"""Miyauchi 2022, Train-TR."""

MIYAUCHI_TRAIN_TRZ = [
    "random_06-Aug-2020_16_24_25_4",
    "random_06-Aug-2020_16_24_25_5",
    "random_06-Aug-2020_16_24_25_6",
    "turn_cut_14-Sep-2020_16_09_02",
    "zigzag_31-Jul-2020_13_22_52",
    "zigzag_31-Jul-2020_13_50_28",
]
"""Miyauchi 2022, Train-TRZ."""

MIYAUCHI_TEST = [
    "random_06-Aug-2020_16_24_25_3",
    "turn_14-Sep-2020_14_50_41",
    "zigzag_31-Jul-2020_14_10_05",
    "berthing_12-Nov-2020_11_49_21",
    "berthing_12-Nov-2020_13_21_03",
]
"""Miyauchi 2022, Test."""

SPLITS = {
    "train-tzb": TRAIN_TZB,
    "train-tzrb": TRAIN_TZRB,
    "train-tzrb+": TRAIN_TZRB_PLUS,
    "test": TEST,
    "development-holdout": DEVELOPMENT_HOLDOUT,
    "miyauchi-train-r": MIYAUCHI_TRAIN_R,
    "miyauchi-train-tr": MIYAUCHI_TRAIN_TR,
    "miyauchi-train-trz": MIYAUCHI_TRAIN_TRZ,
    "miyauchi-test": MIYAUCHI_TEST,
}
"""Every split by its name on the command line."""


def data_folder() -> Path:
    """The folder that holds ``frt-ds-esso``: $MMG_DATA, else ../shared/data from here or from the repository.

    Raises UserError when none of them exists.
    """
    named = os.environ.get("MMG_DATA")
    if named:
        if not Path(named).is_dir():
            raise UserError(f"MMG_DATA={named}: no such folder; set it to the folder that holds frt-ds-esso")
        return Path(named)
    places = [Path.cwd() / "../shared/data", Path(__file__).resolve().parents[1] / "../shared/data"]
    for place in places:
        if place.is_dir():
            return place.resolve()
    raise UserError("no ../shared/data here: set MMG_DATA to the folder that holds frt-ds-esso")


def find(names: Iterable[str]) -> list[Path]:
    """Paths of the records with these ``names``, in their order.

    Raises UserError naming the records that are not on this machine.
    """
    folder = data_folder() / "frt-ds-esso"
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder; clone FRT-DS-ESSO there or set MMG_DATA to its parent")
    at = {path.stem: path for path in sorted(folder.glob("*/*.csv"))}
    wanted = list(names)
    missing = [name for name in wanted if name not in at]
    if missing:
        held = sorted(set(missing) & set(TEST))
        reason = f" ({len(held)} of them in the published test set)" if held else ""
        listed = ", ".join(missing)
        raise UserError(f"{folder}: {len(missing)} of {len(wanted)} records are not there{reason}: {listed}")
    return [at[name] for name in wanted]
