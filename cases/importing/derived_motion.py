"""Surge, sway and turn rate from positions and heading where they were not logged, with their standard errors.

A smoother: the path on even times has third differences that are normal with an unknown size; so has the noise of the
positions and, where speed and course over ground were logged, of the velocities. The three sizes are those of largest
marginal likelihood (Rasmussen & Williams 2006, eq. 2.30, with banded matrices); the standard error is the posterior's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize

from cases.trial import unwrapped
from mmg.errors import TooFewData
from mmg.messages import Message

BAND = 3
"""Diagonals beside the main one: those of squared third differences."""
SIZES = [(np.log(1e-13), 2.0), (np.log(1e-17), 2.0), (np.log(1e-13), 4.0)]
"""Limits of the logarithms of three variances: noise, third differences, noise of the rates; in the range of the values
and steps of one."""
PLACES = 9
"""Places along the record at which the standard error is taken; their median is said."""
LONGEST_GAP = 5.0
"""Gap in the positions [s] over which no velocity is derived."""


@dataclass(frozen=True)
class Smoothed:
    """value (N,), rate (N,) per second, and the standard error of the rate."""

    value: np.ndarray
    rate: np.ndarray
    rate_std: float


FEWEST = 4
"""Values from which a path can be smoothed: three differences."""
TOO_FEW = (
    "positions or headings are too few, or too far apart in size, to derive velocities from; give u, v and r, or check "
    "the file"
)


def smoothed(h: float, value: np.ndarray, rate: np.ndarray | None = None) -> Smoothed:
    """A smooth path through ``value`` (N,) every h [s], NaN where nothing was measured, and its measured ``rate``.

    h: step [s]; rate: (N,) per second, or None. Of the sizes of noise and motion the most likely are taken. Raises
    UserError where no sizes smooth the values.
    """
    n = len(value)
    known = np.isfinite(value)
    if known.sum() < FEWEST:
        raise TooFewData(TOO_FEW)
    centre, unit = float(np.nanmean(value)), max(float(np.nanmax(value) - np.nanmin(value)), 1e-9)
    y = np.where(known, (value - centre) / unit, 0.0)  # steps and ranges of one
    slope = np.zeros(n) if rate is None else np.where(np.isfinite(rate), rate * h / unit, 0.0)
    with_rate = np.zeros(n, dtype=bool) if rate is None else np.isfinite(rate)
    with_rate[[0, -1]] = False
    third = sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(n - 3, n), format="csr")
    central = sparse.diags([-0.5, 0.5], [-1, 1], shape=(n, n), format="csr")[with_rate]
    D, R, turned = _band(third.T @ third), _band(central.T @ central), central.T @ slope[with_rate]

    counts = np.array([known.sum(), n - BAND, with_rate.sum()])[: 3 if with_rate.any() else 2]

    def parts(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        noise, jerk, rates = np.append(np.exp(-logs), 0.0)[:3]
        A = D * jerk + R * rates
        A[-1] += known * noise
        b = known * y * noise + turned * rates
        total = noise * float(y @ y) + rates * float((with_rate * slope) @ slope)
        return A, b, total

    def cost(logs: np.ndarray) -> float:
        A, b, total = parts(logs)
        try:
            root = cholesky_banded(A)
        except np.linalg.LinAlgError:
            return 1e300
        x = cho_solve_banded((root, False), b)
        return float(2 * np.log(root[-1]).sum() + counts @ logs + total - b @ x)

    rough = float(np.nanvar(np.diff(y[known], 2))) / 6
    spread = float(np.nanvar(np.diff(slope[with_rate]))) / 2 if with_rate.any() else 1.0
    start = np.clip(np.log([max(rough, 1e-300), max(rough * 1e-4, 1e-300), max(spread, 1e-300)]), *np.transpose(SIZES))
    k = len(counts)
    best = minimize(
        cost, start[:k], method="Nelder-Mead", bounds=SIZES[:k], options={"xatol": 0.02, "fatol": 0.05, "maxfev": 160}
    )
    A, b, _ = parts(best.x)
    try:
        root = cholesky_banded(A)
    except np.linalg.LinAlgError:
        raise TooFewData(TOO_FEW) from None
    x = cho_solve_banded((root, False), b)
    error = _rate_std(root, known)
    return Smoothed(x * unit + centre, np.gradient(x) * unit / h, error * unit / h)


class Derived(NamedTuple):
    """columns: that were derived, (N,) each; std: their standard errors; ancestors: what each was derived from; said:
    what was done."""

    columns: dict[str, np.ndarray]
    std: dict[str, float]
    ancestors: dict[str, tuple[str, ...]]
    said: list[Message]


def derived_velocities(
    t: np.ndarray, columns: dict[str, np.ndarray], steps: Mapping[str, float] | None = None
) -> Derived:
    """What is missing of u, v and r, from x and y or ``sog`` and ``cog``, and psi.

    t: (N,) even times [s]; columns: quantities (N,) in SI and radians; steps: time between the measurements of those
    that lie on lines between rarer ones [s].
    """
    h, steps = float(np.median(np.diff(t))), steps or {}
    new: dict[str, np.ndarray] = {}
    std: dict[str, float] = {}
    ancestors: dict[str, tuple[str, ...]] = {}
    said: list[Message] = []
    heading = unwrapped(columns["psi"])
    good = np.isfinite(heading)
    if "r" not in columns:
        found = _smoothed_every(steps.get("psi", h), h, heading)
        new["r"], std["r"] = _where_near(good, found.rate, h), found.rate_std
        ancestors["r"] = ("psi",)
        said.append(Message(f"r derived from the heading, standard error {found.rate_std:.2g} rad/s", "derived"))
    if "u" in columns and "v" in columns:
        return Derived(new, std, ancestors, said)
    ground, step = None, steps.get("x" if "x" in columns else "sog", h)
    if "sog" in columns and "cog" in columns:
        ground = columns["sog"] * np.cos(columns["cog"]), columns["sog"] * np.sin(columns["cog"])
    if "x" in columns and "y" in columns:
        rates = ground or (None, None)
        both = [_smoothed_every(step, h, columns[name], rates[i]) for i, name in enumerate(("x", "y"))]
        known = np.isfinite(columns["x"]) & np.isfinite(columns["y"])
        north, east = (_where_near(known, part.rate, h) for part in both)
        error, how = float(np.mean([part.rate_std for part in both])), "positions"
        how += "" if ground is None else ", speed and course over ground"
    elif ground is not None:
        both = [_smoothed_every(step, h, np.cumsum(np.nan_to_num(part)) * h, part) for part in ground]
        north, east, how = *ground, "speed and course over ground"
        error = float(np.mean([np.nanstd(part - s.rate) for part, s in zip(ground, both, strict=True)]))
    else:
        return Derived(new, std, ancestors, said)
    u = north * np.cos(heading) + east * np.sin(heading)
    v = -north * np.sin(heading) + east * np.cos(heading)
    for name, values in (("u", u), ("v", v)):
        if name not in columns:
            new[name], std[name] = values, error
            ancestors[name] = ("psi", *(q for q in ("x", "y", "sog", "cog") if q in columns and (ground or q in "xy")))
    said.append(
        Message(
            f"{' and '.join(n for n in 'uv' if n in new)} derived from {how}, standard error {error:.2g} m/s", "derived"
        )
    )
    return Derived(new, std, ancestors, said)


def _smoothed_every(step: float, h: float, value: np.ndarray, rate: np.ndarray | None = None) -> Smoothed:
    """As ``smoothed`` of values (N,) every h [s] that were measured every ``step`` [s] and lie on lines in between:
    such lines must not count as measurements."""
    k = max(1, round(step / h))
    found = smoothed(k * h, value[::k], None if rate is None else rate[::k])
    rows = np.arange(len(value))
    value, rate = (np.interp(rows, rows[::k], part) for part in (found.value, found.rate))
    return Smoothed(value, rate, found.rate_std)


def _where_near(known: np.ndarray, values: np.ndarray, h: float) -> np.ndarray:
    """``values`` (N,), NaN in gaps of what is ``known`` longer than LONGEST_GAP and at both ends."""
    at = np.flatnonzero(known)
    rows = np.arange(len(known))
    before = at[np.clip(np.searchsorted(at, rows, "right") - 1, 0, len(at) - 1)]
    after = at[np.clip(np.searchsorted(at, rows), 0, len(at) - 1)]
    inside = (before <= rows) & (after >= rows) & ((after - before) * h <= LONGEST_GAP + h)
    return np.where(inside, values, np.nan)


def _band(squares: sparse.csr_matrix) -> np.ndarray:
    """A symmetric matrix of BAND diagonals beside the main one as an upper band (4, n)."""
    return np.array([np.append(np.zeros(k), squares.diagonal(k)) for k in range(BAND, -1, -1)])


def _rate_std(root: np.ndarray, known: np.ndarray) -> float:
    """Posterior standard deviation of the rate, the median over places where something was measured."""
    n = root.shape[1]
    inside = np.flatnonzero(known[1:-1]) + 1
    found = []
    for i in inside[np.linspace(0, len(inside) - 1, PLACES).astype(int)] if len(inside) else []:
        d = np.zeros(n)
        d[i + 1], d[i - 1] = 0.5, -0.5
        found.append(float(d @ cho_solve_banded((root, False), d)))
    return float(np.sqrt(np.median(found))) if found else float("nan")
