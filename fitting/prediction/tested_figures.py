"""What tests of a standard manoeuvre say of its figures, beside the model that was fitted to them.

The model's figure F errs where her forces have another form than the model's; a test's figure T holds for the wind,
speed and rudder of the test, and scatters. R = T F / B carries T to the conditions of the criteria, with B the model's
figure as tested (MSC/Circ.1053, 2002, 3.4.1, option 1). F and R are averaged, weighed by their variances, in
logarithms: that of F is the scatter of the drawn ships, that of R the scatter of repeated tests. Tests to both sides
and repeated ones tell it (pooled variance of the kind), together with what is known beforehand.

Where tests lie farther from the model than both variances say, the model's is too small; it grows by the square of the
Birge ratio (Birge 1932, The calculation of errors by the method of least squares, Physical Review 40), that of figures
nobody tested too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cases.criteria.imo import WaterVelocity, in_still_water, mean_wind
from cases.criteria.standard_runs import STEP, Run, figures_of, measured_runs
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import calm_and_deep
from cases.simulation.gusts import Wind
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.errors import UserError
from mmg.motion.froude import time_scale
from mmg.ship import Ship

# Standard deviation of a repeated test's figure, by it, before tests tell it: R of twelve ships of ``benchmarks.yards``
# (seeds 401 to 404) is 1 to 4 % off the truth.
SCATTER = 0.04
WORTH = 2  # Tests that this counts for. Set by hand: with more, intervals are too narrow where tests scatter by 12 %.
OTHER_SPEED = 0.1  # Share by which speeds differ from which on a figure is another one. Set by hand.
LEAST_TURNING, SLACK = math.radians(33.0), math.radians(2.0)  # Of a turning test; of the angles of a zigzag [rad]
FIGURES = ("advance", "transfer", "tactical_diameter", "overshoot_1", "overshoot_2", "initial_turning_track")


@dataclass(frozen=True)
class MeasuredManeuver:
    """A standard manoeuvre among the trials: what was measured, of midship and through the water.

    maneuver: as ordered ("turning:-35"); trial: name; speed [m/s] of the approach; rudder, heading [rad], as of
    ``Execute``; wind: mean, its direction from ahead at the order [m/s, rad], 0 where none is known; n: revolutions of
    the approach [1/s], None where none are known; figures: SI and rad; reading: by what each changes within a sampling
    interval, in which the rudder may have begun to move at any time.
    """

    maneuver: str
    trial: str
    speed: float
    rudder: float
    heading: float
    wind: tuple[float, float]
    n: float | None
    figures: dict[str, float]
    reading: dict[str, float]

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> MeasuredManeuver:
        """From a ``row`` of result.json."""
        return cls(**{**row, "wind": tuple(row["wind"])})

    @property
    def kind(self) -> str:
        """The manoeuvre without its side."""
        return self.maneuver.replace(":-", ":")

    def modelled(self, ship: Ship) -> dict[str, float]:
        """Figures B of the model of a ``ship``, in calm surroundings, in the wind and with the orders of the test."""
        degrees = math.degrees(self.rudder)
        text = (
            f"turning:{degrees:g}"
            if self.kind == "turning:35"
            else f"zigzag:{degrees:g}/{math.degrees(self.heading):g}"
        )
        plan = parse_maneuver(text, ship, speed=self.speed, n=self.n if "n" in ship.actuators else None)
        air = Wind(*self.wind) if ship.feels_wind and self.wind[0] > 0 else None
        return figures_of(simulate(ship, plan, STEP * time_scale(ship.particulars["L"]), air), plan)


def measured_maneuvers(ship: Ship, trials: Iterable[Trial]) -> tuple[MeasuredManeuver, ...]:
    """The standard turning circles and zigzags among ``trials`` of a calibrated ``ship``, without the lever arm of her
    antenna and the current that were fitted."""
    found = []
    east, north = (ship.coefficients.get(f"current.{axis}") for axis in ("y", "x"))
    for trial in trials:
        try:
            runs = measured_runs(of_midship(ship, trial), ship.particulars["L"])
        except UserError:
            continue
        for run in runs:
            name = standard_run(run)
            if name is None or name.startswith("crash") or not math.isfinite(run.speed):
                continue
            if east and north:
                run = in_still_water(run, WaterVelocity(north.value, east.value, 0.0, "of the ship"))
            air = mean_wind(run) if run.trial.has_wind else None
            wind = (air.speed, air.direction) if air else (0.0, 0.0)
            n = revolutions(run)
            figures = {key: run.figures[key] for key in FIGURES if run.figures.get(key, 0.0) > 0}
            reading = {key: reading_error(run, key) for key in figures}
            found.append(
                MeasuredManeuver(name, trial.name, run.speed, run.rudder, run.heading, wind, n, figures, reading)
            )
    return tuple(found)


def of_midship(ship: Ship, trial: Trial) -> Trial:
    """The ``trial`` with positions and velocities of midship, by the antenna of the ``ship``; as it is where she has
    none or it has no positions."""
    if "antenna_offset" not in ship.effects or not trial.has_position:
        return trial
    x, y, alone_x, alone_y = (
        c.value if (c := ship.coefficients.get(f"antenna_offset.{name}")) else 0.0
        for name in ("x", "y", "alone_x", "alone_y")
    )
    place = trial["x"] + 1j * trial["y"] - complex(x + alone_x, y + alone_y) * np.exp(1j * trial["psi"])
    speed = trial["u"] + 1j * trial["v"] - 1j * trial["r"] * complex(x, y)
    return trial.with_columns(x=place.real, y=place.imag, u=speed.real, v=speed.imag)


def standard_run(run: Run) -> str | None:
    """The manoeuvre of the standards that a measured ``run`` is, None for none."""
    rudder, heading, side = math.degrees(run.rudder), math.degrees(run.heading), "-" if run.rudder < 0 else ""
    if run.kind == "turning" and abs(run.rudder) >= LEAST_TURNING:
        return f"turning:{side}35"
    for angle in (10, 20):
        if run.kind == "zigzag" and max(abs(abs(rudder) - angle), abs(heading - angle)) <= math.degrees(SLACK):
            return f"zigzag:{side}{angle}/{angle}"
    return "crash-stop" if run.kind == "crash-stop" else None


def revolutions(run: Run) -> float | None:
    """Mean revolutions [1/s] of a measured ``run`` before its order, None where none are known."""
    rows = run.trial.t - run.trial.t[0] <= run.order_time
    before = np.asarray(run.trial.columns.get("n", np.full(len(run.trial), math.nan)))[rows]
    return float(np.nanmean(before)) if np.isfinite(before).any() else None


def reading_error(run: Run, figure: str) -> float:
    """By what a ``figure`` of a measured ``run`` changes within a sampling interval of it, SI and rad."""
    if "overshoot" in figure:
        t, psi = run.trial.t, run.trial.psi_unwrapped  # of the heading: not every log has a turn rate
        return run.trial.dt * float(np.nanmax(np.abs(np.gradient(psi, t)), initial=0.0))
    return run.trial.dt * run.speed if math.isfinite(run.speed) else 0.0


@dataclass(frozen=True)
class WeighedFigures:
    """Figures of a ship by model and tests.

    ratios: manoeuvre, figure -> ln(R / F) by its tests, and their standard deviation; birge: ratio by which the
    standard deviations of the model's figures grow, 1 at least; scatter: by kind of manoeuvre, standard deviation of a
    test's figure, by it; tests: their number.
    """

    ratios: Mapping[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    birge: float = 1.0
    scatter: Mapping[str, float] = field(default_factory=dict)
    tests: int = 0

    @property
    def words(self) -> str:
        """What was done, in a sentence."""
        words = f"{self.tests} tests of standard manoeuvres have a say beside the model, by variance "
        each = ", ".join(f"{kind} {share:.1%}" for kind, share in sorted(self.scatter.items()))
        words += f"(R = T F / B, MSC/Circ.1053, 3.4.1; scatter of a test: {each})"
        if self.birge > 1:
            words += f"; they lie {self.birge:.2g} times as far from the model as its intervals say, which grow by that"
        return words

    def of(self, maneuver: str, draws: Mapping[str, np.ndarray], seed: int) -> dict[str, np.ndarray]:
        """Figures (count,) of a ``maneuver`` from those of ``draws`` of the model; seed: of the draws of R.

        A draw of R beside each of F gives draws of their mean (Matheron's rule). A figure that some draws do not
        reach stays as it is.
        """
        found = dict(draws)
        for number, figure in enumerate(FIGURES):
            if (log := logarithms(draws.get(figure))) is None:
                continue
            middle = float(np.median(log))
            own = self.birge * (log - middle)
            if (test := self.ratios.get((maneuver, figure))) is not None:
                shift, std = test
                weight = float(own.var() / (own.var() + std**2))
                normal = np.random.default_rng([33, seed, number]).standard_normal(len(own))
                own = own + weight * (shift + std * normal - own)
            found[figure] = np.exp(middle + own)
        return found


def logarithms(draws: np.ndarray | None) -> np.ndarray | None:
    """Logarithms of ``draws`` (count,) of a figure, None where some do not reach it or it has both signs."""
    if draws is None or not np.isfinite(draws).all() or not (draws > 0).all():
        return None
    return np.log(draws)


def weighed_figures(
    ship: Ship,
    tests: Sequence[MeasuredManeuver],
    draws: Mapping[str, Mapping[str, np.ndarray]],
    speeds: Mapping[str, float],
) -> WeighedFigures:
    """What ``tests`` say beside the model of a ``ship``.

    draws: manoeuvre -> figure -> (count,) of the model, SI and rad; speeds: manoeuvre -> approach speed of these [m/s].
    Tests at another speed, and those that the model does not follow to the end, say nothing.
    """
    calm = calm_and_deep(ship)[0]
    ratios: dict[tuple[str, str], list[tuple[float, float]]] = {}
    used = 0
    for test in tests:
        if test.maneuver not in draws or abs(test.speed / speeds[test.maneuver] - 1) > OTHER_SPEED:
            continue
        try:
            modelled = test.modelled(calm)
        except UserError:
            continue
        used += 1
        for figure, value in test.figures.items():
            if (B := modelled.get(figure, math.nan)) > 0:
                # R / F is T / B; its reading is uniform over an interval
                one = (math.log(value / B), test.reading[figure] / value / math.sqrt(12.0))
                ratios.setdefault((test.maneuver, figure), []).append(one)
    return replace(weighed(ratios, draws), tests=used)


def weighed(
    ratios: Mapping[tuple[str, str], Sequence[tuple[float, float]]], draws: Mapping[str, Mapping[str, np.ndarray]]
) -> WeighedFigures:
    """The weights of tests: ``ratios``, manoeuvre, figure -> ln(R / F) of each test and the standard deviation of its
    reading, by the figure, beside ``draws`` of the model, manoeuvre -> figure -> (count,)."""
    logs = {key: log for key in ratios if (log := logarithms(draws[key[0]].get(key[1]))) is not None}
    if not logs:
        return WeighedFigures()
    sides: dict[tuple[str, str], list[float]] = {}  # tests to both sides count as repeated
    for maneuver, figure in logs:
        same = sides.setdefault((maneuver.replace(":-", ":"), figure), [])
        same += [ratio for ratio, _ in ratios[maneuver, figure]]
    variances = {}
    for kind in {kind_of(maneuver) for maneuver, _ in logs}:
        alike = [np.array(same) for (maneuver, _), same in sides.items() if kind_of(maneuver) == kind]
        squares, freedom = sum(len(x) * float(x.var()) for x in alike), sum(len(x) - 1 for x in alike)
        variances[kind] = (WORTH * SCATTER**2 + squares) / (WORTH + freedom)
    found = {}
    for key in logs:
        shift, reading = np.mean(ratios[key], axis=0)
        std = math.sqrt((variances[kind_of(key[0])] + reading**2) / len(ratios[key]))
        found[key] = (float(shift), std)
    # the variance of R less F is the sum of both
    excess = np.mean([found[key][0] ** 2 / (log.var() + found[key][1] ** 2) for key, log in logs.items()])
    scatter = {kind: math.sqrt(variance) for kind, variance in variances.items()}
    return WeighedFigures(found, max(1.0, math.sqrt(float(excess))), scatter)


def kind_of(maneuver: str) -> str:
    """The kind of a ``maneuver`` by its name, which tests scatter alike in: "turning" or "zigzag"."""
    return maneuver.partition(":")[0]
