"""The 3 m ESSO OSAKA calibrated on her pond records, scaled to 325 m, beside what is known of the ship's own trials.

Run from the repository root: python -m benchmarks.esso_osaka_full_scale

The model is calibrated on the published split Train-TZRB (Wakita et al. 2022; eight records, none of the test set, none
held out). No figure of the ship takes part. KVLCC2 follows: the 7 m model of the library scaled to 320 m, beside the
library's full-scale ship and MARIN's free-running tests of the model (SIMMAN 2008).

What is quoted of the trials of 1977 (Crane 1979, SNAME Transactions 87:251-283) is what secondary literature says, as
remembered: the text itself could not be read here, and no page can be named. Nothing is taken from figures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.record import record, table
from benchmarks.shallow_factors import ankudinov, kijima_nakiri_1990
from cases.criteria.imo import REFERENCES
from cases.criteria.scatter import ManeuverScatter, draw_coefficients, scatter
from cases.criteria.standard_runs import approach_speed
from cases.io.read import read_trials
from cases.maneuvers import orders
from cases.maneuvers.definitions import parse_maneuver
from cases.published_splits import TRAIN_TZRB, find
from cases.simulation.simulate_batch import simulate_batch
from delivery.full_scale.result import result_of
from delivery.full_scale.scale import scale
from fitting.result import FitResult
from mmg.errors import UserError
from mmg.motion.froude import time_scale
from mmg.ship import Ship
from mmg_ident import calibrate

LENGTH, SPEED, DRAWS, SEED = 325.0, 4.0, 1000, 0
"""Length [m] and approach speed [m/s] (7.8 kn, about that of the trials) of the ESSO OSAKA; draws, their seed."""
CIRCLES = ("turning:35", "turning:-35")
ZIGZAGS = ("zigzag:10/10", "zigzag:-10/10", "zigzag:20/20", "zigzag:-20/20")
DEPTHS = (4.2, 1.5, 1.2)
"""Depths of water by the draught in which the ship was tried."""
FIGURES = ("advance", "transfer", "tactical_diameter", "overshoot_1", "overshoot_2", "track_reach", "head_reach")
QUOTED = {("turning:35", "advance"): 3.1, ("turning:35", "tactical_diameter"): 2.85, "shallow by deep": 1.75}
"""Of the trials, by L; the last: greatest ratio of tactical diameters at h/d = 1.2 and in deep water. UNVERIFIED."""


@dataclass(frozen=True)
class Model:
    """A ship with its covariance: what the draws are taken from."""

    ship: Ship
    symbols: Sequence[str]
    matrix: np.ndarray

    @classmethod
    def of(cls, result: FitResult) -> Model:
        """The ship of a result."""
        return cls(result.ship, result.correlation.symbols, np.array(result.correlation.matrix, dtype=float))

    def drawn(self, text: str, speed: float) -> ManeuverScatter | None:
        """Draws of a manoeuvre; None where the ship cannot do it."""
        try:
            plan = parse_maneuver(text, self.ship, speed=speed)
            return scatter(self.ship, plan, DRAWS, SEED, (self.symbols, self.matrix))
        except UserError as error:
            print(f"{self.ship.name}, {text}: {error}")
            return None

    def at_depth(self, ratio: float) -> Model:
        """The ship in water of ``ratio`` draughts, by the effect shallow_water."""
        ship = self.ship.with_effect("shallow_water", {"d_h": 1 / ratio})
        return replace(self, ship=ship.fixing([s for s in ship.symbols if s.startswith("shallow_water.")]))

    def at_depth_by_factors(self, ratio: float) -> Model:
        """The same by published factors on single coefficients (benchmarks/shallow_factors.py, UNVERIFIED): linear
        derivatives of Kijima & Nakiri (1990), added mass in sway of Ankudinov; the cross-flow drag grows as Y_v."""
        p = self.ship.particulars
        given = (p["L"], p["B"], p["d"], p["C_b"], ratio * p["d"])
        linear, mass = kijima_nakiri_1990(*given), ankudinov(*given)
        factors = {"Y_v": linear["Y_beta"], "C_D": linear["Y_beta"], "N_v": linear["N_beta"], "N_r": linear["N_r"],
                   "m_y": mass["g_v"]}  # fmt: skip
        rows = {}
        for symbol, factor in factors.items():
            c = self.ship.coefficients[symbol]
            low, high = sorted((c.lower * factor, c.upper * factor))
            rows[symbol] = c.with_(value=c.value * factor, std=c.std * factor, lower=low, upper=high)
        return replace(self, ship=self.ship.with_coefficients(rows))


def interval(row: float | None, low: float, high: float, digits: int) -> str:
    """A figure with its 90 % interval."""
    return f"{'-' if row is None else format(row, f'.{digits}f')} [{low:.{digits}f}, {high:.{digits}f}]"


def cells(model: Model, texts: Sequence[str], speed: float) -> dict[tuple[str, str], tuple[float | None, float, float]]:
    """(manoeuvre, figure) -> value and 90 % interval, lengths by L, angles in deg."""
    found = {}
    for text in texts:
        result = model.drawn(text, speed)
        for row in result.rows if result else ():
            unit = math.degrees(1) if row.unit == "rad" else 1 / model.ship.particulars["L"]
            if row.figure in FIGURES:
                low, high = (unit * value for value in row.interval_90)
                found[text, row.figure] = (None if row.value is None else unit * row.value, low, high)
    return found


def compared(named: dict[str, Model], texts: Sequence[str], speeds: Sequence[float], known: dict) -> list[str]:
    """A table with a column per ship and one of what is known, and whether the interval of the first ship holds it."""
    columns = [cells(model, texts, speed) for model, speed in zip(named.values(), speeds, strict=True)]
    rows, held, judged = [], 0, 0
    for key in dict.fromkeys(key for column in columns for key in column):
        digits = 1 if "overshoot" in key[1] else 2
        shown = [interval(*column[key], digits) if key in column else "-" for column in columns]
        word, value = "", known.get(key)
        if value is not None and key in columns[0]:
            _, low, high = columns[0][key]
            word, judged, held = ("yes" if low <= value <= high else "NO"), judged + 1, held + (low <= value <= high)
        rows.append([key[0], key[1].replace("_", " "), *shown, "-" if value is None else f"{value:g}", word])
    head = ["manoeuvre", "figure", *named, "known", "held by the first"]
    return [*table(head, rows), "", f"90 % intervals of the first column hold {held} of {judged} known figures."]


def shallow(model: Model) -> list[str]:
    """Turning circles by depth, and the ratio of tactical diameters draw by draw."""
    rows, deep = [], None
    ways = {"effect shallow_water": model.at_depth, "published factors": model.at_depth_by_factors}
    cases = [(math.inf, "deep", model)]
    cases += [(ratio, name, at(ratio)) for name, at in ways.items() for ratio in DEPTHS]
    for ratio, name, one in cases:
        found = one.drawn("turning:35", SPEED)
        assert found is not None
        sizes = found.values["tactical_diameter"] / LENGTH
        deep = sizes if deep is None else deep
        by_name = {row.figure: row for row in found.rows}
        shown = []
        for figure in ("advance", "tactical_diameter"):
            row = by_name[figure]
            shown.append(interval(row.value and row.value / LENGTH, *(v / LENGTH for v in row.interval_90), 2))
        quotient = sizes / deep
        low, middle, high = np.nanquantile(quotient[np.isfinite(quotient)], (0.05, 0.5, 0.95))
        share = f"{np.mean(np.isfinite(sizes)):.0%}"
        rows.append([name, f"{ratio:g}", *shown, f"{middle:.2f} [{low:.2f}, {high:.2f}]", share])
    head = ["water", "h/d", "advance / L", "tactical diameter / L", "ratio to deep water", "draws that turn by 180 deg"]
    return table(head, rows)


def coasting(model: Model) -> str:
    """Time and way from the approach speed to half of it with the propeller stopped."""
    ship, L = model.ship, LENGTH
    plan = parse_maneuver("straight", ship, speed=SPEED, duration=400 * time_scale(L))
    plan = replace(plan, orders=partial(orders.constant, 0.0))
    drawn = draw_coefficients(ship, DRAWS, SEED, (model.symbols, model.matrix))
    given = {s: np.concatenate([[ship.coefficients[s].value], values]) for s, values in drawn.items()}
    runs = simulate_batch(ship, plan, given, 0.5 * time_scale(L))
    u, x = runs.states[:, 3], runs.states[:, 0]
    rows = np.argmax(u < 0.5 * SPEED, axis=0)
    reached = rows > 0
    t = 0.5 * time_scale(L) * rows[reached] / 60
    way = x[rows[reached], np.flatnonzero(reached)] / L
    parts = [interval(float(v[0]), *np.quantile(v[1:], (0.05, 0.95)), 1) for v in (t, way)]
    return f"Coasting, propeller stopped, from {SPEED:g} to {SPEED / 2:g} m/s: {parts[0]} min, {parts[1]} L."


def scaled_rows(result: FitResult) -> list[str]:
    """What scaling changed."""
    account = result.scaling or {}
    rows = [
        [row["symbol"], f"{row['model']:.4g} ± {row['model_std']:.2g}", f"{row['ship']:.4g} ± {row['ship_std']:.2g}"]
        for row in account["coefficients"]
        if row["changed"]
    ]
    for key, words in (("n", "revolutions [1/s]"), ("J", "J"), ("K_T", "K_T"), ("C_Th", "loading C_Th")):
        points = account["self_propulsion"]
        rows.append([words, f"{points['model'][key]:.3g}", f"{points['ship'][key]:.3g}"])
    speed = account["self_propulsion"]["ship"]["speed_m_s"]
    return [*table(["coefficient", "model", "ship"], rows), "", f"Self-propulsion at {speed:.3g} m/s of the ship."]


def kvlcc2() -> list[str]:
    """The library's model scaled, beside the library's ship and MARIN's tests."""
    ship = scale("kvlcc2_l7", 320.0)
    named = {
        "scaled to 320 m": Model.of(ship),
        "scaled by Froude alone": Model.of(scale("kvlcc2_l7", 320.0, froude_only=True)),
        "library, 320 m": Model.of(result_of("kvlcc2_full")),
    }
    speeds = [approach_speed(model.ship)[0] for model in named.values()]
    return compared(named, (*CIRCLES, *ZIGZAGS), speeds, REFERENCES["kvlcc2_full"])


def main() -> None:
    """Calibrates, scales, draws, and records the tables."""
    trials = read_trials(find(TRAIN_TZRB))
    fit = calibrate("esso_osaka_3m", trials)
    ship = scale(fit, LENGTH)
    named = {
        "scaled to 325 m": Model.of(ship),
        "scaled by Froude alone": Model.of(scale(fit, LENGTH, froude_only=True)),
        "library's priors, scaled": Model.of(scale("esso_osaka_3m", LENGTH)),
    }
    known = {key: value for key, value in QUOTED.items() if isinstance(key, tuple)}
    lines = [
        f"Calibrated on {len(trials)} records (Train-TZRB), {DRAWS} draws, seed {SEED}, approach {SPEED:g} m/s; value "
        "and 90 % interval, lengths in L, angles in deg. Known: UNVERIFIED, as quoted in secondary literature.",
        "",
        *compared(named, (*CIRCLES, *ZIGZAGS, "crash-stop"), [SPEED] * 3, known),
        "",
        coasting(named["scaled to 325 m"]),
        "",
        "What scaling changed:",
        "",
        *scaled_rows(ship),
        "",
        f"Depth of water, 35 degrees to starboard (quoted of the trials: up to {QUOTED['shallow by deep']:g} at 1.2):",
        "",
        *shallow(named["scaled to 325 m"]),
    ]
    command = "python -m benchmarks.esso_osaka_full_scale"
    record("ESSO OSAKA from model to ship", command, lines)
    record("KVLCC2 from model to ship", command, kvlcc2())


if __name__ == "__main__":
    main()
