"""Pilot card, wheelhouse poster and manoeuvring booklet of a ship (IMO resolution A.601(15), appendices 1 to 3).

Tables of what a model tells, with 90 % intervals: engine orders, steering, turning circles, course keeping, stopping.
What no model knows (anchors, draughts of the day, equipment) stays an empty line to be filled in aboard.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cases.criteria.figures import Since
from cases.criteria.imo import helm_words
from cases.criteria.standard_runs import Run
from cases.maneuvers.definitions import Limits
from cases.maneuvers.self_propulsion import actuator_positions, revolutions_for
from cases.quantities import KNOT
from cases.shipfiles.effects import calm_and_deep
from cases.simulation.simulate_batch import draw_coefficients
from fitting.prediction.bands import correlation_in
from fitting.prediction.figure_intervals import JudgedFigures
from fitting.report.page import rendered
from fitting.report.plot_maneuvers import maneuver_figure
from fitting.report.plot_style import figure_entry, png_of
from mmg.components.coefficients import PARTICULARS
from mmg.messages import Message
from mmg.rollout import Simulator
from mmg.ship import Ship

SHARES = (1.0, 0.75, 0.5, 0.25)  # Revolutions of the table, by those of the test speed. Set by hand.
SEA_GOING = 20.0  # Length from which squat and knots mean something [m]. Set by hand.
Columns = tuple[tuple[str, str], ...]
Rows = tuple[tuple[str, str, str], ...]
# Table -> title; manoeuvre and words of each column; figure, words and kind of unit of each row.
TABLES: dict[str, tuple[str, Columns, Rows]] = {
    "turning": (
        "Turning circles at 35° of rudder, from the test speed",
        (("turning:35", "starboard"), ("turning:-35", "port")),
        (("advance", "Advance at 90°", "way"), ("transfer", "Transfer at 90°", "way"),
         ("time_90", "Time to 90°", "s"), ("tactical_diameter", "Tactical diameter at 180°", "way"),
         ("time_180", "Time to 180°", "s")),
    ),
    "stopping": (
        "Stopping, from the test speed",
        (("crash-stop", "full astern"), ("coasting", "engine stopped, to 30 % of it")),
        (("track_reach", "Track reach", "way"), ("head_reach", "Head reach", "way"),
         ("lateral_deviation", "To starboard", "way"), ("stopping_time", "Time", "s")),
    ),
    "course": (
        "Course changing and yaw checking, from the test speed",
        (("zigzag:10/10", "10°/10° starboard"), ("zigzag:-10/10", "10°/10° port"),
         ("zigzag:20/20", "20°/20° starboard"), ("zigzag:-20/20", "20°/20° port")),
        (("initial_turning_track", "Track to turn 10°", "way"), ("overshoot_1", "First overshoot", "deg"),
         ("overshoot_2", "Second overshoot", "deg")),
    ),
}  # fmt: skip
# What A.601(15) asks for and no manoeuvring model knows.
ABOARD = {
    "Pilot card": ("Call sign", "Date", "Draught forward and aft [m]", "Displacement [t]", "Deadweight [t]",
                   "Air draught [m]", "Anchor chain, port and starboard [shackles]", "Bulbous bow",
                   "Engine orders of the telegraph", "Equipment checked"),
    "Wheelhouse poster": ("Time hard-over to hard-over with two power units [s]",
                          "Minimum speed to keep course, propeller stopped [kn]",
                          "Engine: type, power, starts in a row", "Thruster effect at trial conditions",
                          "Man overboard: rescue manoeuvre tried aboard"),
    "Manoeuvring booklet": ("Turning circles in shallow water", "Behaviour in wind", "Track of the trials"),
}  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """A figure of a manoeuvre, SI and rad, and its 90 % interval, whose upper end is infinite where more than 5 % of
    the draws never come to it; None: no draws."""

    value: float
    interval: tuple[float, float] | None = None

    def words(self, kind: str, length: float) -> str:
        """It in the unit of a ``kind``: "way" in metres and in the ship's ``length`` [m]; "s"; "deg"; "speed"."""
        speed = (" kn", 1.0 / KNOT, 1) if length >= SEA_GOING else (" m/s", 1.0, 1)
        known = {"way": (" m", 1.0, 0), "s": (" s", 1.0, 0), "deg": ("°", math.degrees(1.0), 1), "speed": speed}
        unit, factor, digits = known[kind]
        digits += 2 * (length < SEA_GOING and kind != "deg")

        def shown(x: float, digits: int = digits) -> str:
            return f"{round(x, digits) + 0.0:,.{digits}f}" if math.isfinite(x) else "never"  # + 0.0: no "-0.00"

        ends = f" [{', '.join(shown(factor * x) for x in self.interval)}]" if self.interval else ""
        in_lengths = f"; {shown(self.value / length, 2)} L" if kind == "way" else ""
        return f"{shown(factor * self.value)}{unit}{ends}{in_lengths}"

    def to_dict(self) -> dict[str, Any]:
        """Value and ``interval_90``, an end that is never reached as None."""
        ends = self.interval and [x if math.isfinite(x) else None for x in self.interval]
        return {"value": self.value, "interval_90": ends}


@dataclass(frozen=True, repr=False)
class ShipCard:
    """What a card shows.

    ship: in calm and deep water; speed: of the test [m/s]; helm: of the steering gear, words and values; engine: share
    of the revolutions, revolutions [1/s] and speed [m/s] of each; tables: table of TABLES -> manoeuvre -> figure ->
    value; circles: the turning circles, and clouds: some of the draws of each by its name; notices: what the figures
    rest on.
    """

    ship: Ship
    speed: float
    helm: tuple[tuple[str, str], ...]
    engine: tuple[tuple[float, float, Figure], ...]
    tables: Mapping[str, Mapping[str, Mapping[str, Figure]]]
    circles: tuple[Run, ...]
    clouds: Mapping[str, Sequence[Since]]
    notices: tuple[Message, ...]

    def __repr__(self) -> str:
        return f"<ShipCard of {self.ship.title}: {len(self.tables)} tables, {self.speed:.4g} m/s>"

    def to_dict(self) -> dict[str, Any]:
        """Plain values: SI and rad; by table, manoeuvre and figure."""
        tables = {
            key: {text: {name: f.to_dict() for name, f in figures.items()} for text, figures in columns.items()}
            for key, columns in self.tables.items()
        }
        engine = [{"share": share, "n": n, "speed": speed.to_dict()} for share, n, speed in self.engine]
        said = {"test_speed": self.speed, "notices": [str(n) for n in self.notices]}
        return {"ship": self.ship.name, **said, "engine_orders": engine, "tables": tables}

    def page(self) -> str:
        """One self-contained HTML page of the three documents."""
        ship, L = self.ship, self.ship.particulars["L"]
        tables = {}
        for key, made in self.tables.items():
            title, columns, rows = TABLES[key]
            shown = [
                [words, *(one[name].words(kind, L) if name in one else "–" for one in made.values())]
                for name, words, kind in rows
                if any(name in one for one in made.values())
            ]
            tables[key] = title, [words for text, words in columns if text in made], shown
        engine = [(f"{100 * share:.0f} %", f"{60 * n:.4g}", one.words("speed", L)) for share, n, one in self.engine]
        figure = None
        if self.circles:
            caption = "In ship lengths." + " Thin and grey: single trials of drawn ships." * bool(self.clouds)
            draw = partial(maneuver_figure, self.circles, "", self.clouds)
            figure = figure_entry(png_of(draw), "turning", "Turning circles", caption)
        particulars = [
            (PARTICULARS[name][0], f"{value:.5g} {PARTICULARS[name][1]}")
            for name, value in ship.particulars.items()
            if name in ("L", "B", "d", "m", "C_b", "D_P", "A_R")
        ]
        return rendered(
            "card", ship=ship, speed=Figure(self.speed).words("speed", L), engine=engine,
            tables=tables, figure=figure, particulars=particulars, helm=self.helm, squat=_squat(ship, self.speed),
            notices=[str(n) for n in self.notices], aboard=ABOARD, intervals=bool(self.clouds),
        )  # fmt: skip


def ship_card(
    judged: JudgedFigures, ship: Ship, content: Mapping[str, Any], rudder_rate: float | None = None, seed: int = 0
) -> ShipCard:
    """The card of a ``ship`` by her standard manoeuvres.

    judged: as of ``fitting.prediction.figure_intervals.with_intervals``, "coasting" among them, with the same ``seed``
    and rudder_rate [rad/s]; content: of the result.json of her calibration, {}: none.
    """
    calm, runs = calm_and_deep(ship)[0], {run.name: run for run in judged.runs}
    tables: dict[str, dict[str, dict[str, Figure]]] = {}
    for key, (_, columns, rows) in TABLES.items():
        for run in (runs[text] for text, _ in columns if text in runs):
            figures, scatter = tables.setdefault(key, {}).setdefault(run.name, {}), judged.scatter.get(run.name)
            for name in (name for name, *_ in rows if name in run.figures):
                drawn = scatter and scatter.of(name)
                figures[name] = Figure(drawn["median"], drawn["interval_90"]) if drawn else Figure(run.figures[name])
    notices = [*judged.notices, *(Message(words, "caveat") for run in runs.values() for words in run.caveats)]
    notices += [Message(f"{row.run}: {row.why}", "event_not_reached") for row in judged.rows if row.run not in runs]
    if not judged.scatter:
        notices.append(Message("no 90 % intervals: no covariance of the coefficients is known", "no_covariance"))
    count = len(next(iter(judged.scatter[next(iter(judged.scatter))].ship.values()))) if judged.scatter else 0
    drawn = draw_coefficients(calm, count, seed, correlation_in(content)) if count else {}
    V = judged.runs[0].speed
    engine = _engine_orders(Simulator(calm), V, drawn)
    rate = math.degrees(rudder_rate or Limits.for_ship(calm).rudder_rate)
    helm = [("Largest rudder angle of the manoeuvres", "35°")]
    if math.isfinite(rate):
        helm.append(("Time hard-over to hard-over (70°)", f"{70.0 / rate:.3g} s: {helm_words(calm, rudder_rate)}"))
    if (neutral := calm.particulars.get("neutral_rudder")) is not None:
        helm.append(("Rudder angle of a straight course", f"{math.degrees(neutral):.2g}°"))
    circles = tuple(run for run in judged.runs if run.kind == "turning")
    clouds = {run.name: judged.scatter[run.name].shown for run in circles if run.name in judged.scatter}
    return ShipCard(calm, V, tuple(helm), engine, tables, circles, clouds, tuple(dict.fromkeys(notices)))


def _engine_orders(
    simulator: Simulator, speed: float, drawn: Mapping[str, np.ndarray]
) -> tuple[tuple[float, float, Figure], ...]:
    """Share of the revolutions that hold ``speed`` [m/s], revolutions [1/s] and speed of a straight course of each of
    SHARES; none for a ship without a shaft that turns."""
    ship = simulator.ship
    if not {"n", "n_azimuth"} & set(ship.actuators):
        return ()
    full, count = revolutions_for(ship, speed), len(next(iter(drawn.values()), [0.0]))
    theta = np.repeat(ship.values[:, None], count, axis=1)
    for symbol, values in drawn.items():
        theta[ship.symbols.index(symbol)] = values
    rows = []
    for share in SHARES:
        reached = _straight_speeds(simulator, share * full, theta, 4 * share * speed)
        low, middle, high = (float(q) for q in np.quantile(reached, (0.05, 0.5, 0.95)))
        rows.append((share, share * full, Figure(middle, (low, high) if drawn else None)))
    return tuple(rows)


def _straight_speeds(simulator: Simulator, n: float, theta: np.ndarray, most: float) -> np.ndarray:
    """Speeds (M,) [m/s], up to ``most``, at which ships of coefficients ``theta`` (P, M) go straight at ``n`` [1/s]."""
    positions = actuator_positions(simulator.ship, n, 0.0)
    controls = np.repeat([[positions.get(name, 0.0)] for name in simulator.inputs], theta.shape[1], axis=1)
    low, high = np.zeros(theta.shape[1]), np.full(theta.shape[1], most)
    for _ in range(40):  # halved to 1e-12 of ``most``
        logged = np.zeros((6, theta.shape[1]))
        logged[3] = middle = 0.5 * (low + high)
        faster = simulator.rates(simulator.start(logged, controls, theta), controls, theta)[3] > 0
        low, high = np.where(faster, middle, low), np.where(faster, high, middle)
    return 0.5 * (low + high)


def _squat(ship: Ship, speed: float) -> list[tuple[str, str, str]]:
    """Speed, and the increase of the draught in open and in confined water by rule, at shares of the test ``speed``
    [m/s]: C_b V^2 / 100 and C_b V^2 / 50, V in knots (Barrass 2004, Ship Stability, chapter 42); none for a model."""
    p = ship.particulars
    if p["L"] < SEA_GOING or "C_b" not in p:
        return []
    return [
        (f"{V:.3g} kn", f"{p['C_b'] * V**2 / 100:.2f} m", f"{p['C_b'] * V**2 / 50:.2f} m")
        for V in (share * speed / KNOT for share in SHARES)
    ]
