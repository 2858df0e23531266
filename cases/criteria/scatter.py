"""Scatter of a manoeuvre: one ship many times, with coefficients drawn from their standard errors, in one batch."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from cases.criteria.figures import figure_unit
from cases.criteria.standard_runs import figures_of
from cases.maneuvers.definitions import Maneuver, parse_maneuver
from cases.simulation.simulate_batch import SimulatedRuns, simulate_batch
from mmg.errors import Missing, NoSolution, OutOfRange
from mmg.messages import Message, html_table
from mmg.motion.froude import reference_speed, time_scale
from mmg.ship import Ship

STEP = 0.25  # Default sampling interval [s] of a 3 m model; scales with sqrt(L). Set by hand.
ROUNDS = 5  # In which draws beyond bounds are put on them; what is beyond then is clipped alone. Set by hand.
MOST = 5000  # Most draws of one call: all motions are held in memory. Set by hand: it bounds memory.


@dataclass(frozen=True)
class ScatterRow:
    """A figure of the manoeuvre over all draws, SI and rad.

    value: of the ship as it is, None where it has no such figure; median and interval_90 (5 and 95 % quantiles) over
    the draws that reach the figure; share: of the draws that do. Of a calibration: interval_90_trial of a single trial;
    limit of the criterion and probability of meeting it, None where there is none.
    """

    figure: str
    unit: str
    value: float | None
    median: float
    interval_90: tuple[float, float]
    share: float
    interval_90_trial: tuple[float, float] | None = None
    limit: float | None = None
    probability: float | None = None


@dataclass(frozen=True)
class ManeuverScatter:
    """A manoeuvre of ``count`` ships drawn about one.

    coefficients: symbol -> draws (count,); rows: a row per figure; runs: motions, the ship as it is first, then the
    draws; notices: what to know of them. values: figure -> (count,) its value in each draw, NaN where it has none;
    trials: motions of single trials of the drawn ships, of a calibration.
    """

    ship: str
    maneuver: Maneuver
    count: int
    seed: int
    coefficients: Mapping[str, np.ndarray]
    rows: tuple[ScatterRow, ...]
    runs: SimulatedRuns
    notices: tuple[Message, ...] = ()
    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    trials: SimulatedRuns | None = None

    def to_dict(self) -> dict[str, Any]:
        """What ``mmg simulate --scatter --json`` prints."""
        return {
            "ship": self.ship,
            "run": self.maneuver.name,
            "scatter": self.count,
            "seed": self.seed,
            "coefficients": list(self.coefficients),
            "figures": [asdict(row) for row in self.rows],
            "notices": list(self.notices),
        }

    def to_pandas(self) -> Any:
        """A DataFrame with a row per figure: unit, value, median, lower and upper end of the 90 % interval, share."""
        import pandas as pd

        rows = [(r.figure, r.unit, r.value, r.median, *r.interval_90, r.share) for r in self.rows]
        names = ["figure", "unit", "value", "median", "lower", "upper", "share"]
        return pd.DataFrame(rows, columns=names).set_index("figure")

    def tracks(self) -> Any:
        """A DataFrame of all motions: run (0: the ship as it is), t [s], x, y [m], psi [rad], u, v, r, n, delta."""
        import pandas as pd

        parts = {0: self.runs.trial(0).to_pandas()}
        if self.trials is None:
            parts |= {m: self.runs.trial(m).to_pandas() for m in range(1, len(self.runs.last))}
        else:
            parts |= {m + 1: self.trials.trial(m).to_pandas() for m in range(len(self.trials.last))}
        return pd.concat(parts, names=["run"]).reset_index("run").reset_index(drop=True)

    def _repr_html_(self) -> str:
        rows = [(r.figure, r.unit, r.value, r.median, *r.interval_90) for r in self.rows]
        caption = f"{self.ship}: {self.maneuver.name}, {self.count} draws"
        return html_table(caption, ("figure", "unit", "value", "median", "5 %", "95 %"), rows)


def draw_coefficients(
    ship: Ship, count: int, seed: int = 0, correlation: tuple[Sequence[str], np.ndarray] | None = None
) -> dict[str, np.ndarray]:
    """Coefficients drawn from normal distributions about the ``ship``'s values, symbol -> (count,).

    Their standard deviations are those of the ship (fixed ones stay). count: draws; seed: of the draws; correlation:
    symbols (Q,) and matrix (Q, Q) of the estimates, None for independent ones. Draws beyond a bound are put on it, and
    those correlated with them follow by their regression on them.
    Raises UserError when no coefficient of the ship has a standard deviation.
    """
    free = [s for s in ship.free if 0 < ship.coefficients[s].std < math.inf]
    if not free:
        raise Missing(f"{ship.name}: no coefficient has a standard deviation; give std in the ship file, or a fit")
    matrix = np.eye(len(free))
    if correlation is not None:
        index = {symbol: i for i, symbol in enumerate(correlation[0])}
        rows = [(i, index[s]) for i, s in enumerate(free) if s in index]
        here, there = (list(part) for part in zip(*rows, strict=True)) if rows else ([], [])
        matrix[np.ix_(here, here)] = np.nan_to_num(np.asarray(correlation[1], dtype=float)[np.ix_(there, there)])
        np.fill_diagonal(matrix, 1.0)
    # a root by eigenvalues: with correlations that are not known set to zero the matrix may have negative ones
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = root @ np.random.default_rng([21, seed]).standard_normal((len(free), count))
    drawn = [ship.coefficients[s] for s in free]
    value, std = (np.array([getattr(c, name) for c in drawn], dtype=float)[:, None] for name in ("value", "std"))
    lower, upper = (np.array([getattr(c, name) for c in drawn], dtype=float)[:, None] for name in ("lower", "upper"))
    inside = _within(draws, (lower - value) / std, (upper - value) / std, root @ root.T)
    return dict(zip(free, np.clip(value + std * inside, lower, upper), strict=True))


def _within(draws: np.ndarray, lower: np.ndarray, upper: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Draws (Q, count) of unit variance and correlation ``matrix`` with those beyond bounds (Q, 1) put on them. The
    others move to their expectation given that: by the regression on those that are held."""
    bounded = np.zeros(draws.shape, dtype=bool)
    target = draws
    for _ in range(ROUNDS):
        beyond = (target < lower - 1e-9) | (target > upper + 1e-9)
        if not beyond.any():
            break
        bounded |= beyond
        target = target.copy()
        for m in np.flatnonzero(beyond.any(axis=0)):
            k = np.flatnonzero(bounded[:, m])
            ends = np.clip(draws[k, m], lower[k, 0], upper[k, 0])
            # conditional mean of a normal law, given those on their bounds
            gain = np.linalg.solve(matrix[np.ix_(k, k)] + 1e-9 * np.eye(len(k)), ends - draws[k, m])
            target[:, m] = draws[:, m] + matrix[:, k] @ gain
            target[k, m] = ends
    return np.clip(target, lower, upper)


def scatter(
    ship: Ship,
    maneuver: str | Maneuver,
    count: int,
    seed: int = 0,
    correlation: tuple[Sequence[str], np.ndarray] | None = None,
    dt: float | None = None,
) -> ManeuverScatter:
    """Medians and 90 % intervals of the figures of a manoeuvre, from ``count`` draws of the ship's coefficients.

    ship: calibrated, or with the standard deviations of its priors; maneuver: as for ``parse_maneuver``, in calm air;
    seed, correlation: as for ``draw_coefficients``; dt: sampling interval [s], default 0.25 s of a 3 m model. Draws
    whose motion diverges are left out, and a notice says so. Raises UserError for a count that makes no sense, for
    spiral and pull-out, and when no motion is that of a ship. correlation: symbols (Q,) and matrix (Q, Q).
    """
    if not 2 <= count <= MOST:
        raise OutOfRange(f"scatter {count}: give 2 to {MOST} draws")
    L = ship.particulars["L"]
    plan = parse_maneuver(maneuver, ship, seed=seed) if isinstance(maneuver, str) else maneuver
    drawn = draw_coefficients(ship, count, seed, correlation)
    given = {s: np.concatenate([[ship.coefficients[s].value], values]) for s, values in drawn.items()}
    each = replace(plan, engine=plan.engine.drawn(count, seed, itself=True)) if plan.engine else plan
    runs = simulate_batch(ship, each, given, STEP * time_scale(L) if dt is None else dt)
    with np.errstate(invalid="ignore", over="ignore"):
        # beyond Froude number 3, as ``simulate`` refuses it
        fast = np.abs(runs.states[:, 3:5]).max(axis=(0, 1)) > 3 * reference_speed(L)
    good = np.flatnonzero(np.isfinite(runs.states).all(axis=(0, 1)) & ~fast)
    if len(good) == 0:
        raise NoSolution(f"{ship.name}: every motion diverges; check its coefficients")
    figures = {int(m): figures_of(runs.trial(int(m)), plan) for m in good}
    nominal = figures.pop(0, {})
    notices = []
    if len(figures) < count:
        words = f"{count - len(figures)} of {count} draws are left out: their motion diverges"
        notices.append(Message(words, "diverging_draws"))
    if correlation is None:
        notices.append(Message("coefficients are drawn independently of each other: no correlation is known",
                               "independent_draws"))  # fmt: skip
    rows, by_draw = [], {}
    for name in dict.fromkeys(name for found in (nominal, *figures.values()) for name in found):
        by_draw[name] = np.array([figures.get(k + 1, {}).get(name, np.nan) for k in range(count)])
        values = by_draw[name][np.isfinite(by_draw[name])]
        if len(values):
            low, middle, high = (float(q) for q in np.quantile(values, (0.05, 0.5, 0.95)))
            share = len(values) / len(figures)
            rows.append(ScatterRow(name, figure_unit(name), nominal.get(name), middle, (low, high), share))
    kept = np.concatenate([[0], good[good > 0]])
    runs = replace(runs, states=runs.states[:, :, kept], inputs=runs.inputs[:, :, kept], last=runs.last[kept])
    return ManeuverScatter(ship.name, plan, count, seed, drawn, tuple(rows), runs, tuple(notices), by_draw)
