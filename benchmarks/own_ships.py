"""How far ``mmg ships --new`` can be trusted: ships of the literature from their particulars alone.

Run from the repository root: python -m benchmarks.own_ships [--quick]

Each ship of benchmarks/literature is made from her particulars and turns and zigzags as she did. One set of factors on
a few coefficients, the same for all ships, is then determined from all ships but one (a ridge: each factor is held to 1
within RIDGE), and that one is predicted: the errors and the widths of the priors come from those left out.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.literature.ships import FIGURES, SHIPS, LiteratureShip, in_ship_units, known_figures
from benchmarks.record import record, table
from cases.criteria.batch_figures import figures_of_each
from cases.criteria.scatter import draw_coefficients
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.estimates import CORRECTIONS, LINEAR
from cases.shipfiles.new_ship import HULLS, new_ship
from cases.simulation.simulate_batch import simulate_batch
from mmg.components import empirical
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

Key = tuple[str, str]
RIDGE = 0.2
"""Standard deviation of the logarithm of a factor before the ships are looked at."""
LENGTHS, ANGLES = 0.12, 0.30
"""What an error of a length and of an overshoot is measured by (logarithms)."""
ROUNDS, NUDGE, DRAWS, SEED = 3, 0.05, 200, 0
WIDENINGS = (0.8, 1.0, 1.2)
CLASSES = {"full": "full ships, C_b of 0.7 and more", "fine": "fine ships"}


class Start:
    """The starting ship of a ship of the literature, and her figures with other coefficients."""

    def __init__(self, real: LiteratureShip, hull: str) -> None:
        self.real, self.hull = real, hull
        self.ship = new_ship("start", {**real.particulars, "U_0": real.speed}, hull)
        self.simulator, self.known = Simulator(self.ship), known_figures(real.name)

    def figures(self, given: Mapping[str, np.ndarray], count: int) -> dict[Key, np.ndarray]:
        """(Manoeuvre, figure) -> (count,) of ships with the coefficients ``given``, symbol -> (count,)."""
        L, found = self.real.particulars["L"], {key: np.full(count, np.nan) for key in self.known}
        for text in dict.fromkeys(text for text, _ in self.known):
            longest = {"duration": 60 * L / self.real.speed} if text == "turning:15" else {}
            plan = parse_maneuver(text, self.ship, speed=self.real.speed, rudder_rate=self.real.rudder_rate, **longest)
            runs = simulate_batch(self.simulator, plan, given, 0.25 * time_scale(L))
            for m, figures in enumerate(figures_of_each(runs, plan)):
                for figure, value in in_ship_units(figures, L).items():
                    if (text, figure) in found:
                        found[text, figure][m] = value
        return found

    def scaled(self, factors: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
        """Coefficients (count,) of the ship with each of the ``factors`` in place of those of CORRECTIONS."""
        return {
            symbol: np.array([self.ship.coefficients[symbol].value * each[name] / own for each in factors])
            for name, own in CORRECTIONS[self.hull].items()
            for symbol in symbols_of(name)
        }

    def errors(self, factors: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Logarithms of figure by known figure (figures, count)."""
        found = self.figures(self.scaled(factors), len(factors))
        return np.array([np.log(found[key] / known) for key, known in self.known.items()])

    def drawn(self, factors: Mapping[str, float], widening: float) -> Ship:
        """The ship with ``factors`` in place of those of CORRECTIONS and standard deviations times ``widening``."""
        rows = {}
        for symbol, c in self.ship.coefficients.items():
            name = next((key for key in factors if symbol in symbols_of(key)), "")
            value = c.value * (factors[name] / CORRECTIONS[self.hull][name] if name else 1.0)
            std = c.std * widening * (abs(value / c.value) if c.value else 1.0)
            low, high = (min(c.lower, value - 3 * std), max(c.upper, value + 3 * std))
            low, high = (max(low, 0.0) if c.lower >= 0 else low), (min(high, 0.0) if c.upper <= 0 else high)
            rows[symbol] = c.with_(value=value, std=std, lower=low, upper=high)
        return self.ship.with_coefficients(rows)

    def intervals(self, ship: Ship, symbols: Sequence[str] = ()) -> dict[Key, tuple[float, float]]:
        """90 % intervals of the figures of ``ship`` over draws of her priors; infinite where they are not reached."""
        drawn = draw_coefficients(ship, DRAWS, SEED)
        found = self.figures(drawn, DRAWS)
        whole = {key: np.where(np.isfinite(values), values, np.inf) for key, values in found.items()}
        return {key: tuple(np.quantile(v, (0.05, 0.95), method="nearest")) for key, v in whole.items()}


def symbols_of(name: str) -> tuple[str, ...]:
    """Coefficients that a name of CORRECTIONS stands for."""
    return ("gamma_R_plus", "gamma_R_minus") if name == "gamma_R" else (name,)


def sizes(start: Start) -> np.ndarray:
    """What the errors of each known figure are measured by (figures,)."""
    return np.array([ANGLES if "overshoot" in figure else LENGTHS for _, figure in start.known])


def determined(starts: Sequence[Start], hull: str) -> dict[str, float]:
    """The factors that bring all ``starts`` closest to what is known of them, each group of one hull counted once."""
    names = list(CORRECTIONS[hull])
    phi = np.zeros(len(names))
    for _ in range(ROUNDS):
        normal, slope = np.eye(len(names)) / RIDGE**2, -phi / RIDGE**2
        for start in starts:
            points = [phi, *(phi + NUDGE * row for row in np.eye(len(names)))]
            errors = start.errors([dict(zip(names, np.exp(point), strict=True)) for point in points])
            size = sizes(start)[:, None]
            rest, rates = errors[:, 0] / size[:, 0], (errors[:, 1:] - errors[:, :1]) / NUDGE / size
            good = np.isfinite(rest) & np.isfinite(rates).all(axis=1)
            same = sum(other.real.group == start.real.group for other in starts)
            weight = np.minimum(1.0, 2 / np.maximum(np.abs(rest[good]), 1e-9)) / same
            normal += rates[good].T @ (weight[:, None] * rates[good])
            slope -= rates[good].T @ (weight * rest[good])
        phi = phi + np.clip(np.linalg.solve(normal, slope), -0.3, 0.3)
    return dict(zip(names, np.exp(phi), strict=True))


def percent(error: float) -> str:
    """An error in logarithms as a percentage."""
    return "never" if not math.isfinite(error) else f"{100 * (math.exp(error) - 1):+.0f} %"


def error_rows(starts: Sequence[Start], factors: Sequence[Mapping[str, float]]) -> list[list[str]]:
    """A row per ship: errors of the figures, in the order of FIGURES."""
    rows = []
    for start, one in zip(starts, factors, strict=True):
        errors = dict(zip(start.known, start.errors([one])[:, 0], strict=True))
        rows.append([start.real.name, *(percent(errors[key]) if key in errors else "-" for key in FIGURES)])
    return rows


def sizes_of_errors(starts: Sequence[Start], factors: Sequence[Mapping[str, float]]) -> dict[tuple[str, str], float]:
    """(Class, "length" or "overshoot") -> root mean square of the errors (logarithms)."""
    found: dict[tuple[str, str], list[float]] = {}
    for start, one in zip(starts, factors, strict=True):
        for (_, figure), error in zip(start.known, start.errors([one])[:, 0], strict=True):
            what = "overshoot" if "overshoot" in figure else "length"
            found.setdefault((start.real.kind, what), []).append(float(error))
    return {key: math.sqrt(float(np.nanmean(np.square(values)))) for key, values in found.items()}


def coverage(
    starts: Sequence[Start], factors: Sequence[Mapping[str, float]], widening: float
) -> tuple[int, int, float]:
    """Figures inside their 90 % intervals, figures, and the median width of the intervals by the figure."""
    inside, count, widths = 0, 0, []
    for start, one in zip(starts, factors, strict=True):
        intervals = start.intervals(start.drawn(one, widening))
        for key, known in start.known.items():
            low, high = intervals[key]
            inside, count = inside + (low <= known <= high), count + 1
            widths.append((high - low) / known)
    return inside, count, float(np.median(widths))


def by_regression(starts: Sequence[Start]) -> list[list[str]]:
    """Tactical diameter by L at 35 and 15 degrees with the linear derivatives of one regression each, uncorrected."""
    rows = []
    for start in starts:
        p, shown = start.real.particulars, []
        given = (p["L"], p["B"], p["d"], p["C_b"])
        m_x = empirical.motora_added_mass(*given)["m_x"]
        table_ = empirical.linear_derivatives(*given, m_x)
        neutral = dict.fromkeys(CORRECTIONS[start.hull], 1.0)
        values = start.scaled([neutral] * len(table_))
        values |= {s: np.array([each[s] for each in table_.values()]) for s in LINEAR}
        found = start.figures(values, len(table_))
        for angle in ("35", "15"):
            key = (f"turning:{angle}", "tactical_diameter")
            shown += [f"{start.known[key]:.1f}: " + ", ".join(f"{v:.1f}" for v in found[key])] if key in found else []
        rows.append([start.real.name, *shown, *["-"] * (2 - len(shown))])
    return rows


def lines_of(hull: str, quick: bool) -> list[str]:
    """The tables of one hull."""
    starts = [Start(real, hull) for real in SHIPS]
    groups = dict.fromkeys(start.real.group for start in starts)
    out = {g: determined([s for s in starts if s.real.group != g], hull) for g in groups}
    left_out = [out[start.real.group] for start in starts]
    neutral = dict.fromkeys(CORRECTIONS[hull], 1.0)
    everything = determined(starts, hull)
    head = ["ship", *(f"{text} {figure.replace('_', ' ')}" for text, figure in FIGURES)]
    lines = [f"Hull {hull}. Mean of six regressions, no factors (no ship takes part):", ""]
    lines += [*table(head, error_rows(starts, [neutral] * len(starts))), "", "Factors from the other ships:", ""]
    lines += [*table(head, error_rows(starts, left_out)), "", "As `mmg ships --new` gives it:", ""]
    lines += [*table(head, error_rows(starts, [CORRECTIONS[hull]] * len(starts))), ""]
    words = ["all ships", *(f"without {group}" for group in groups), "in the product"]
    sets = [everything, *out.values(), CORRECTIONS[hull]]
    lines += table(
        ["factors", *neutral], [[w, *(f"{s[n]:.2f}" for n in neutral)] for w, s in zip(words, sets, strict=True)]
    )
    before, after = sizes_of_errors(starts, [neutral] * len(starts)), sizes_of_errors(starts, left_out)
    rows = [[CLASSES[k], what, f"{100 * before[k, what]:.0f} %", f"{100 * e:.0f} %"] for (k, what), e in after.items()]
    lines += ["", *table(["class", "figure", "root mean square error, no factors", "left out"], rows), ""]
    rows = []
    for widening in (1.0,) if quick else WIDENINGS:
        inside, count, width = coverage(starts, left_out, widening)
        rows.append([f"{widening:g}", f"{inside} of {count} ({100 * inside / count:.0f} %)", f"{100 * width:.0f} %"])
    lines += [
        *table(["standard deviations times", "ships left out: in 90 % intervals", "median width by figure"], rows),
        "",
    ]
    held = next(row[1] for row in rows if row[0] == "1")
    lines += [f"At the widths of the product, 90 % intervals hold {held} of the figures of ships left out.", ""]
    names = ", ".join(empirical.linear_derivatives(7.0, 1.27, 0.455, 0.81))
    lines += [f"Tactical diameter by L, known: by single regressions ({names}), no factors:", ""]
    return [*lines, *table(["ship", "35 deg", "15 deg"], by_regression(starts)), ""]


def known_lines() -> list[str]:
    """The figures of the literature and their sources."""
    head = ["ship", *(f"{text} {figure.replace('_', ' ')}" for text, figure in FIGURES)]
    rows = []
    for ship in SHIPS:
        known = known_figures(ship.name)
        rows.append([ship.name, *(f"{known[key]:.2f}" if key in known else "-" for key in FIGURES)])
    sources = [f"* {s.name}: {s.source}{'; ' + s.doubts if s.doubts else ''}." for s in SHIPS]
    return ["Known, mean of port and starboard, lengths in L, angles in deg:", "", *table(head, rows), "", *sources, ""]


def main() -> None:
    """Prints and records the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="coverage at the product's widths only; not recorded")
    parser.add_argument("--hull", choices=HULLS)
    options = parser.parse_args()
    lines = known_lines()
    for hull in (options.hull,) if options.hull else HULLS:
        lines += lines_of(hull, options.quick)
    if options.quick or options.hull:
        print("\n".join(lines))
        return
    record("Starting ships against the literature", "python -m benchmarks.own_ships", lines)


if __name__ == "__main__":
    main()
