"""Faults of instruments that differ between groups of trials, by what the columns of each run say of each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.evidence.kinematic_words import ALIKE, TRACK, TURN, Quantity
from cases.evidence.kinematics import Kinematics
from cases.io.groups import Groups
from diagnosis.hypotheses.forward_selection import LEVEL
from diagnosis.hypotheses.group_findings import GroupDifference
from diagnosis.hypotheses.group_rows import group_row, parameters_by_group
from fitting.uncertainty.group_test import GroupTest, group_test, holm
from mmg.motion.froude import time_scale
from mmg.ship import Ship


@dataclass(frozen=True)
class Measured:
    """A test of an instrument by the kinematics: the fault, its test in units of the least size that matters, its row
    of the result."""

    fault: Quantity
    test: GroupTest
    row: GroupDifference

    @property
    def matters(self) -> bool:
        """Whether the groups differ, beyond chance and by what matters."""
        off = np.ptp(self.test.values)
        return self.row.p_value < LEVEL and bool(off > 1.0)


def measured_differences(sensors: Kinematics, ship: Ship, groups: Groups) -> list[Measured]:
    """Tests of all faults of instruments for different sizes in the ``groups``, without any model.

    sensors: what each run shows; ship: whose length says which sizes matter. Returns those that can be tested.
    """
    k, found = time_scale(float(ship.particulars["L"])), []
    for q in (*TRACK, *TURN):
        readings = [run[q.symbol] for run in sensors.runs]
        good = [
            np.isfinite(x.value) and x.std > 0 and not run.faults for x, run in zip(readings, sensors.runs, strict=True)
        ]
        group = np.array(groups.number)[good]
        if set(group) != set(groups.number):
            continue
        size = q.threshold * k ** (2 * q.power)
        values, std = (np.array([getattr(x, a) for x in readings])[good] / size for a in ("value", "std"))
        test = group_test(values / std**2, np.diag(std**-2.0), group, 1)
        if test is not None:
            found.append((q, test, size))
    adjusted = holm([test.p_single for _, test, _ in found])
    rows = []
    for (q, test, size), p in zip(found, adjusted, strict=True):
        nature = "surroundings" if q.symbol.startswith("drift") else "instrument"
        words = {q.parameter or q.symbol: (q.unit, q.form.format(q.ends[0]))}
        parts = parameters_by_group(groups, words, size * test.values, size**2 * test.covariance)
        name = q.effect or q.symbol
        rows.append(Measured(q, test, group_row(name, nature, "kinematics", parts, test, float(p))))
    return rows


def without_doubles(found: Sequence[Measured]) -> list[Measured]:
    """Of those ``found`` that look alike in a run, the one for which most speaks, with the others as its class."""
    rest, kept = sorted(found, key=lambda m: -m.row.log_bayes), []
    while rest:
        first, *rest = rest
        alike = set().union(*(group for group in ALIKE if first.fault.symbol in group))
        same = tuple(dict.fromkeys(m.row.name for m in rest if m.fault.symbol in alike))
        rest = [m for m in rest if m.fault.symbol not in alike]
        kept.append(replace(first, row=replace(first.row, equivalence_class=same)))
    return kept
