"""Surge, sway and turn rate from positions and heading where they were not logged, with their standard errors.

A smoother: the path on even times has third differences that are normal with an unknown size; so has the noise of the
positions and, where speed and course over ground were logged, of the velocities. The three sizes are those of largest
marginal likelihood (Rasmussen & Williams 2006, eq. 2.30, with banded matrices); the standard error is the posterior's,
with what rounding, the step and a lever arm that nobody gave add to it.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import Bounds, minimize

from cases.trial import unwrapped
from mmg.errors import TooFewData
from mmg.messages import Message
from mmg.motion.flow import RUDDERS

BAND = 4  # Diagonals beside the main one: those of the squared STENCIL
# Weights of a value, and of its central difference of fourth order, at the rows -2 to 2.
ITSELF, STENCIL = np.array([0.0, 0.0, 1.0, 0.0, 0.0]), np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
# Least blocks of rows that are averaged before they are smoothed, and rows over which they then must be smoothed:
# blocks are halved until the motion does not need shorter ones.
BLOCKS, WIDTH = 50, 3.0  # set by hand
# By how much the logarithms of the variances of noise and third differences may lie below those of the differences of
# the values: the likelihood has narrow valleys, and the search begins in the deepest.
STARTS = np.arange(0.0, 28.0, 4.0)
# Fall of twice the logarithm of the likelihood (two standard errors) for which less smoothing is taken as likely: the
# most likely size is often none at all, and no standard error then says what is hidden. Set by hand.
AS_LIKELY = 4.0
# Error at half the step is so many times less than its difference from that of the whole step: orders of a rudder bend
# the path at a point, and leave half an order of Richardson's three. Set by hand between.
RICHARDSON = 2.0
SLENDER = 6.0  # Length over breadth of a usual ship. Set by hand.
COARSE = 0.01  # Share of the extent of a track to which its positions may be rounded before it is said. Set by hand.
FINEST = 1e-4  # m, rad, m/s; resolution of a column that never changes: that of the finest instruments. Set by hand.
PLACES = 9  # Along the record, at which the standard error is taken; their median is said. Set by hand.
LONGEST_GAP = 5.0  # Gap in the positions [s] over which no velocity is derived. Set by hand.


@dataclass(frozen=True)
class Smoothed:
    """value and rate per second, of the shape of what was smoothed, and the standard errors of both."""

    value: np.ndarray
    rate: np.ndarray
    value_std: float
    rate_std: float


FEWEST = 6  # Values from which a path can be smoothed: those of the STENCIL and one more
TOO_FEW = "positions or headings are too few, or too far apart in size, to derive velocities from"
TOO_FEW += "; give u, v and r, or check the file"


def smoothed(
    h: float, value: np.ndarray, rate: np.ndarray | None = None, resolution: float = 0.0, rate_resolution: float = 0.0
) -> Smoothed:
    """A smooth path through ``value``, (N,) or (N, C) every h [s], NaN where nothing was measured, and its ``rate``.

    Columns are of one instrument, as north and east of a receiver: whichever way the axes lie, the path is the same.
    h: step [s]; rate: as ``value`` per second, or None; resolution, rate_resolution: to which both were rounded, or 0
    where nothing shows it (FINEST). The noise is not taken below that of rounding. Raises UserError where no sizes of
    noise and motion smooth the values.
    """
    n, shape = len(value), np.shape(value)
    value = np.reshape(value, (n, -1))
    rate = np.full(value.shape, np.nan) if rate is None else np.reshape(rate, value.shape)
    good = np.isfinite(value).all(axis=1)
    if good.sum() < FEWEST:
        raise TooFewData(TOO_FEW)
    resolution, rate_resolution = resolution or FINEST, rate_resolution or FINEST
    centre = value[good].mean(axis=0)
    unit = max(4 * float(np.sqrt(np.mean(np.sum((value[good] - centre) ** 2, axis=1)))), resolution)
    k = 2 ** max(0, int(np.log2(n / BLOCKS)))  # fine rows of a slow ship leave the matrices no digits
    while True:
        y, slope = _means((value - centre) / unit, k), _means(rate * k * h / unit, k)
        # A number that is rounded to steps of q has the variance q^2 / 12; the mean of k of them, a k-th of it.
        rounding = np.array([resolution, 0.0, rate_resolution * k * h]) ** 2 / (12 * k * unit**2)
        likeliest = _likeliest(y, slope, rounding)
        if k == 1 or likeliest.width > WIDTH:
            break
        k //= 2
    sharp = likeliest.path.copy()
    sharp[1:-1] -= np.diff(likeliest.path, 2, axis=0) * (1 - k**-2) / 24  # means over blocks bend less than the path
    at = (n % k) // 2 + (np.arange(len(y)) + 0.5) * k - 0.5  # rows in the middle of the blocks
    path, rows = CubicSpline(at, sharp), np.arange(n)
    rough = CubicSpline(at[::2], sharp[::2])
    between = float(np.sqrt(np.mean((path(at, 1) - rough(at, 1)) ** 2))) * k / RICHARDSON
    error = float(np.hypot(likeliest.rate_std, between)) * unit / (k * h)
    smooth, slopes = (path(rows) * unit + centre).reshape(shape), (path(rows, 1) * unit / h).reshape(shape)
    return Smoothed(smooth, slopes, likeliest.value_std * unit, error)


def _means(values: np.ndarray, k: int) -> np.ndarray:
    """Means of ``values`` (N, C) over blocks of k rows, (N // k, C), NaN where less than half of a block is known."""
    known, rows, count = np.isfinite(values).all(axis=1), np.arange(len(values)), len(values) // k
    if k == 1 or not known.any():
        return values[:count]
    inside = slice((len(values) % k) // 2, (len(values) % k) // 2 + count * k)
    filled = np.transpose([np.interp(rows, rows[known], column[known]) for column in values.T])
    share = known[inside].reshape(count, k).mean(axis=1)
    return np.where(share[:, None] >= 0.5, filled[inside].reshape(count, k, -1).mean(axis=1), np.nan)


class _Likeliest(NamedTuple):
    """path: (N, C) the most likely; standard errors of it and of its rate; width: rows over which it smooths."""

    path: np.ndarray
    value_std: float
    rate_std: float
    width: float


def _likeliest(value: np.ndarray, rate: np.ndarray, rounding: np.ndarray) -> _Likeliest:
    """The path through ``value`` and its ``rate`` per row, (N, C) in a range of one, at the most likely sizes.
    rounding: the least variances of noise, third differences and noise of the rates."""
    n, C = value.shape
    known, with_rate = np.isfinite(value).all(axis=1), np.isfinite(rate).all(axis=1)
    with_rate[:2] = with_rate[-2:] = False  # the stencil needs two rows on either side
    y, slope = np.where(known[:, None], value, 0.0), np.where(with_rate[:, None], rate, 0.0)
    third = sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(n - 3, n), format="csr")
    central = sparse.diags(STENCIL, [-2, -1, 0, 1, 2], shape=(n, n), format="csr")[with_rate]
    D, R, turned = _band(third.T @ third), _band(central.T @ central), central.T @ slope[with_rate]
    counts = np.array([known.sum(), n - 3, with_rate.sum()])[: 3 if with_rate.any() else 2]
    limits = np.array([(np.log(1e-13), 2.0), (np.log(1e-3), np.log(n / 4)), (np.log(1e-13), 4.0)]).T
    limits[0] = np.log(np.maximum(np.exp(limits[0]), rounding))
    limits = limits[:, : len(counts)]

    # Logarithms of the variances. Searched are those of both noises and of the width over which the path is smoothed
    # [rows], with whose sixth power the variance of third differences falls.
    def sizes(logs: np.ndarray) -> np.ndarray:
        return np.array([logs[0], logs[0] - 6 * logs[1], *logs[2:]])

    def solved(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        noise, jerk, rates = np.append(np.exp(-sizes(logs)), 0.0)[:3]  # one over the variances
        A = D * jerk + R * rates
        A[-1] += known * noise  # the last row of an upper band is the main diagonal
        root = cholesky_banded(A)
        return root, cho_solve_banded((root, False), y * noise + turned * rates)

    def cost(logs: np.ndarray) -> float:
        try:
            root, x = solved(logs)
        except np.linalg.LinAlgError:
            return 1e300  # the simplex goes elsewhere
        residuals = (y - x)[known], third @ x, slope[with_rate] - central @ x
        squares = np.array([float(np.sum(part**2)) for part in residuals])[: len(counts)]
        determinants = 2 * np.log(root[-1]).sum() + counts @ sizes(logs)
        return float(C * determinants + np.exp(-sizes(logs)) @ squares)  # minus twice the log likelihood, eq. 2.30

    noise, jerk = (np.log(_variance(np.diff(y[known], order, axis=0))) for order in (2, 3))
    rates = [np.log(_variance(np.diff(slope[with_rate], axis=0)))] * (len(counts) - 2)
    starts = [
        np.clip([noise - less, (noise - less - jerk + slower) / 6, *rates], *limits)
        for less, slower in itertools.product(STARTS, STARTS)
    ]
    # To 1 % of a standard deviation and far below AS_LIKELY. Set by hand.
    best = minimize(
        cost, min(starts, key=cost), method="Nelder-Mead", bounds=Bounds(*limits),
        options={"xatol": 0.02, "fatol": 0.05, "maxfev": 160},
    )  # fmt: skip
    logs, less = best.x, np.array([0.0, 0.08, 0.0])[: len(counts)]  # steps of 8 % of the width
    while logs[1] > limits[0, 1] + 0.08 and cost(logs - less) < best.fun + AS_LIKELY:
        logs = logs - less
    try:
        root, path = solved(logs)
    except np.linalg.LinAlgError:
        raise TooFewData(TOO_FEW) from None
    noise, jerk, *rates = sizes(logs)
    width = min([logs[1], *((size - jerk) / 4 for size in rates)])
    value_std, rate_std = (_std(root, known, weights) for weights in (ITSELF, STENCIL))
    return _Likeliest(path, value_std, rate_std, float(np.exp(width)))


def _variance(values: np.ndarray) -> float:
    return max(float(np.sum(values**2)), 1e-300) / max(values.size, 1)


def resolution_of(values: np.ndarray) -> float:
    """The step to whose multiples ``values`` (N,) were rounded, in any unit: what divides all differences; else 0."""
    levels = np.unique(values[np.isfinite(values)])
    tolerance = 1e-11 * float(np.abs(levels).max(initial=0.0))  # of floats, after a change of unit
    steps = np.diff(levels)
    steps = steps[steps > tolerance]
    while len(steps):  # Euclid's algorithm on all of them at once
        least = float(steps.min())
        rest = np.remainder(steps, least)
        rest = rest[(rest > tolerance) & (rest < least - tolerance)]
        if not len(rest):
            return least
        steps = np.append(rest, least)
    return 0.0


class Derived(NamedTuple):
    """columns: that were derived, (N,) each; std: their standard errors; ancestors: what each was derived from; said:
    what was done."""

    columns: dict[str, np.ndarray]
    std: dict[str, float]
    ancestors: dict[str, tuple[str, ...]]
    said: list[Message]


def derived_velocities(
    t: np.ndarray,
    columns: Mapping[str, np.ndarray],
    steps: Mapping[str, float] | None = None,
    resolutions: Mapping[str, float] | None = None,
    point: tuple[float, float] | None = None,
) -> Derived:
    """What is missing of u, v and r at midship, from x and y or ``sog`` and ``cog``, and psi.

    t: (N,) even times [s]; columns: quantities (N,) in SI and radians; steps: time between the measurements of those
    that lie on lines between rarer ones [s]; resolutions: to which they were rounded; point: where positions, speed and
    course were measured, from midship [m], forward and to starboard.
    """
    h, steps, grain = float(np.median(np.diff(t))), steps or {}, resolutions or {}
    new: dict[str, np.ndarray] = {}
    std: dict[str, float] = {}
    ancestors: dict[str, tuple[str, ...]] = {}
    said: list[Message] = []
    good = np.isfinite(columns["psi"])
    turn = _smoothed_every(steps.get("psi", h), h, unwrapped(columns["psi"]), resolution=grain.get("psi", 0.0))
    if "r" not in columns:
        new["r"], std["r"], ancestors["r"] = _where_near(good, turn.rate, h), turn.rate_std, ("psi",)
        said.append(Message(f"r derived from the heading, standard error {turn.rate_std:.2g} rad/s", "derived"))
    used = [pair for pair in (("x", "y"), ("sog", "cog")) if set(pair) <= set(columns)]
    rounded = max(grain.get("x", 0.0), grain.get("y", 0.0)) if ("x", "y") in used else 0.0
    extent = max(float(np.nanmax(columns[q]) - np.nanmin(columns[q])) for q in ("x", "y")) if rounded else 0.0
    if rounded > COARSE * extent:
        words = f"positions are rounded to {rounded:.2g} m, on a track of {extent:.3g} m"
        said.append(Message(words, "coarse_positions"))
    if {"u", "v"} <= set(columns) or not used:
        return Derived(new, std, ancestors, said)
    ground, rounding = np.full((len(t), 2), np.nan), 0.0
    if used[-1] == ("sog", "cog"):
        sog, cog = columns["sog"], columns["cog"]
        ground = np.column_stack([sog * np.cos(cog), sog * np.sin(cog)])
        rounding = float(np.sqrt(np.nanmean(grain.get("sog", 0.0) ** 2 + (sog * grain.get("cog", 0.0)) ** 2) / 2))
    if used[0] == ("x", "y"):
        place = np.column_stack([columns["x"], columns["y"]])
        track = _joined(steps.get("x", h), h, place, ground, max(grain.get("x", 0.0), grain.get("y", 0.0)), rounding)
        known, velocity, error, how = np.isfinite(place).all(axis=1), track.rate, track.rate_std, "positions"
        how += ", speed and course over ground" if len(used) > 1 else ""
    else:
        track = _smoothed_every(steps.get("sog", h), h, ground, resolution=rounding)
        known, velocity, error = np.isfinite(ground).all(axis=1), track.value, track.value_std
        how = "speed and course over ground"
    north, east = (_where_near(known, part, h) for part in velocity.T)
    psi, (l_x, l_y) = np.where(good, turn.value, np.nan), point or (0.0, 0.0)
    # From the earth frame into body axes, and from the point P to midship: u = u_P + l_y r, v = v_P - l_x r.
    ahead, aside = north * np.cos(psi) + east * np.sin(psi), east * np.cos(psi) - north * np.sin(psi)
    for name, values, other, arm in (("u", ahead, aside, -l_y), ("v", aside, ahead, l_x)):
        if name not in columns:
            across = float(np.sqrt(np.nanmean(other**2))) * turn.value_std  # of the heading by which they are turned
            new[name] = values - arm * turn.rate
            std[name] = float(np.linalg.norm([error, across, arm * turn.rate_std]))
            ancestors[name] = ("psi", *itertools.chain(*used))
    names = [name for name in "uv" if name in new]
    errors = ", ".join(f"{name} {std[name]:.2g} m/s" for name in names)
    said.append(Message(f"{' and '.join(names)} derived from {how}; standard error {errors}", "derived"))
    return Derived(new, std, ancestors, said)


def widened(
    std: Mapping[str, float], columns: Mapping[str, np.ndarray], derived: Collection[str], length: float | None
) -> tuple[dict[str, float], str]:
    """The standard errors ``std`` with those of a receiver that may stand anywhere on the ship, and what was assumed.

    columns: of the run (N,), with psi and r; derived: those of u and v that are; length: of the ship [m], or None: that
    in which she turns by about her rudder angle, r L / U = delta, which holds within a factor of two. Positions are
    off by what turns with the ship (a constant belongs to the origin), velocities by r L/2 aside and r B/2 ahead.
    """
    r, psi = np.nan_to_num(columns["r"]), columns["psi"]
    turn, how = float(np.sqrt(np.mean(r**2))), "the length given"
    if length is None:
        angles = [columns[name] for name in RUDDERS if name in columns] or [np.array([np.radians(20.0)])]
        delta, how = float(np.sqrt(np.nanmean(np.square(np.concatenate(angles))))), "taken from speed, turns and rudder"
        speed = float(np.sqrt(np.nanmean(columns["u"] ** 2 + columns["v"] ** 2)))
        length = float(np.clip(speed * delta / max(turn, 1e-9), 1.0, 400.0))  # m: from models to the largest ships
    more = {"v": turn * length / 2, "u": turn * length / (2 * SLENDER)}
    more = {name: value for name, value in more.items() if name in derived}
    for name, of_heading in (("x", np.cos(psi)), ("y", np.sin(psi))):
        if name in columns:
            more[name] = length / 2 * float(np.nanstd(of_heading))
    words = f"half a ship of {length:.3g} m ({how}) is added to their standard errors"
    return dict(std) | {name: float(np.hypot(std.get(name, 0.0), value)) for name, value in more.items()}, words


def _joined(
    step: float, h: float, value: np.ndarray, rate: np.ndarray, resolution: float, rate_resolution: float
) -> Smoothed:
    """As ``_smoothed_every``, with a standard error that holds what the ``rate`` and the ``value`` disagree by beyond
    their own errors (Hausman 1978: an efficient estimate differs from a consistent one by the difference of their
    variances)."""
    alone = _smoothed_every(step, h, value, resolution=resolution)
    if np.isfinite(rate).all(axis=1).sum() < FEWEST:
        return alone
    both = _smoothed_every(step, h, value, rate, resolution, rate_resolution)
    excess = float(np.mean((both.rate - alone.rate) ** 2)) - max(alone.rate_std**2 - both.rate_std**2, 0.0)
    return replace(both, rate_std=float(np.sqrt(both.rate_std**2 + max(excess, 0.0))))


def _smoothed_every(
    step: float, h: float, value: np.ndarray, rate: np.ndarray | None = None, resolution: float = 0.0,
    rate_resolution: float = 0.0,
) -> Smoothed:  # fmt: skip
    """As ``smoothed``, of values on lines between those measured every ``step`` [s], which alone are measurements."""
    k = max(1, round(step / h))
    smooth = smoothed(k * h, value[::k], None if rate is None else rate[::k], resolution, rate_resolution)
    if k == 1:
        return smooth
    rows = np.arange(len(value))
    path, slope = (CubicSpline(rows[::k], part)(rows) for part in (smooth.value, smooth.rate))
    return replace(smooth, value=path, rate=slope)


def _where_near(known: np.ndarray, values: np.ndarray, h: float) -> np.ndarray:
    """``values`` (N,), NaN in gaps of what is ``known`` longer than LONGEST_GAP and at both ends."""
    at, rows = np.flatnonzero(known), np.arange(len(known))
    before = at[np.clip(np.searchsorted(at, rows, "right") - 1, 0, len(at) - 1)]
    after = at[np.clip(np.searchsorted(at, rows), 0, len(at) - 1)]
    inside = (before <= rows) & (after >= rows) & ((after - before) * h <= LONGEST_GAP + h)
    return np.where(inside, values, np.nan)


def _band(squares: sparse.csr_matrix) -> np.ndarray:
    """A symmetric matrix (n, n) of BAND diagonals beside the main one as an upper band (BAND + 1, n)."""
    return np.array([np.append(np.zeros(k), squares.diagonal(k)) for k in range(BAND, -1, -1)])


def _std(root: np.ndarray, known: np.ndarray, weights: np.ndarray) -> float:
    """Posterior standard deviation of a sum of five neighbours with ``weights`` (5,): the median over PLACES."""
    inside, variances = np.flatnonzero(known[2:-2]) + 2, []
    for i in inside[np.linspace(0, len(inside) - 1, PLACES).astype(int)] if len(inside) else []:
        d = np.zeros(root.shape[1])
        d[i - 2 : i + 3] = weights
        variances.append(float(d @ cho_solve_banded((root, False), d)))  # d' A^-1 d
    return float(np.sqrt(np.median(variances))) if variances else float("nan")
