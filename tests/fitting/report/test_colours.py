"""Figures can be read in grey and with deuteranopia: where two colours look alike there, hatches or dashes differ."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from fitting.identifiability.analysis import KINDS
from fitting.report.plot_identifiability import COLOURS, HATCHES
from fitting.report.plot_maneuvers import COLOURS as LINES
from fitting.report.plot_maneuvers import DASHES
from fitting.report.plots import MARKS

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
DEUTERANOPIA = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])
"""On linear RGB (Vienot, Brettel & Mollon 1999)."""


def linear(colour: str) -> np.ndarray:
    """Linear RGB of a colour (IEC 61966-2-1)."""
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lightness(colour: str) -> float:
    """CIE L* of a colour, 0 to 100."""
    y = float(LUMINANCE @ linear(colour))
    return 116 * np.cbrt(y) - 16 if y > 0.008856 else 903.3 * y


def apart(one: str, other: str) -> bool:
    """Whether two colours differ in grey, and to an eye without the middle cones."""
    seen = [DEUTERANOPIA @ linear(c) for c in (one, other)]
    return abs(lightness(one) - lightness(other)) > 8 and float(np.abs(seen[0] - seen[1]).max()) > 0.05


def test_every_verdict_has_a_colour_and_a_marker() -> None:
    assert set(KINDS) <= set(COLOURS) and set(KINDS) <= set(MARKS)


@pytest.mark.parametrize("pair", list(combinations(KINDS, 2)), ids="-".join)
def test_bars_of_two_verdicts_differ_in_hatch_or_in_grey(pair: tuple[str, str]) -> None:
    one, other = pair
    assert HATCHES.get(one) != HATCHES.get(other) or apart(COLOURS[one], COLOURS[other])


def test_lines_of_manoeuvres_differ_in_their_dashes() -> None:
    assert len(DASHES) == len(LINES) and len({str(d) for d in DASHES}) == len(DASHES)


def test_two_blues_are_told_apart_and_equal_greys_are_not() -> None:
    assert apart("#0072B2", "#7FB8D9") and not apart("#C00000", "#006000") and not apart("#808080", "#818181")
