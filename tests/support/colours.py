"""What is seen of colours in grey and with deuteranopia, and which parts of a figure nothing else tells apart."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.typing import ColorType

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
DEUTERANOPIA = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])
"""On linear RGB (Vienot, Brettel & Mollon 1999)."""


def linear(colour: ColorType) -> np.ndarray:
    """Linear RGB of a colour (IEC 61966-2-1)."""
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lightness(colour: ColorType) -> float:
    """CIE L* of a colour, 0 to 100."""
    y = float(LUMINANCE @ linear(colour))
    return 116 * np.cbrt(y) - 16 if y > 0.008856 else 903.3 * y


def apart(one: ColorType, other: ColorType) -> bool:
    """Whether two colours differ in grey, and to an eye without the middle cones."""
    seen = [DEUTERANOPIA @ linear(c) for c in (one, other)]
    return abs(lightness(one) - lightness(other)) > 8 and float(np.abs(seen[0] - seen[1]).max()) > 0.05


def told_by_colour_alone(figure: Figure) -> list[str]:
    """Pairs of labelled lines and of bars in ``figure`` that differ in nothing but colours that look alike."""
    return [words for ax in figure.axes for words in (*_lines(ax), *_bars(ax))]


def _lines(ax: Axes) -> list[str]:
    shown = [line for line in ax.get_lines() if not str(line.get_label()).startswith("_")]
    looks = [(x.get_label(), x.get_color(), (str(x.get_linestyle()), x.__dict__["_unscaled_dash_pattern"],
             x.get_marker(), round(x.get_linewidth(), 1))) for x in shown]  # fmt: skip
    return [
        f"lines {a[0]} and {b[0]}"
        for a, b in combinations(looks, 2)
        if a[2] == b[2] and a[1] != b[1] and not apart(a[1], b[1])
    ]


def _bars(ax: Axes) -> list[str]:
    looks = {(x.get_facecolor()[:3], x.get_hatch() or "") for x in ax.patches if isinstance(x, Rectangle)}
    return [f"bars {a} and {b}" for a, b in combinations(sorted(looks), 2) if a[1] == b[1] and not apart(a[0], b[0])]
