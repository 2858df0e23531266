"""The trial that would determine most: every manoeuvre of a library is run with the calibrated ship and scored.

One such run adds its Fisher information F to the posterior precision C^-1; with it the covariance would be
(C^-1 + F)^-1 (Bayesian D- and A-optimal design, Chaloner & Verdinelli 1995). All runs count for the same time at sea: a
manoeuvre that is over sooner is repeated, with way to gain speed again between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.self_propulsion import own_speed
from cases.simulation.simulate import Wind, simulate
from cases.trial import Trial
from fitting.identifiability.analysis import Identifiability, information_discount
from fitting.nlp.fisher_information import information
from fitting.nlp.prior import group_sums
from fitting.nlp.problem import Problem
from fitting.nlp.windows import cut
from mmg.components.friction import MODEL
from mmg.errors import NoSolution, UserError
from mmg.motion.froude import reference_speed, time_scale
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.calibration import Calibration

# True wind [m/s of a 3 m model, Froude scaled] and the direction it comes from [deg]. Set by hand.
WIND_SPEED, WIND_FROM = 1.5, 60.0
MANEUVERS = (
    "turning:35", "turning:-35", "turning:15", "zigzag:10/10", "zigzag:20/20", "zigzag:35/20", "spiral:15/5",
    "pull-out:20", "crash-stop", "acceleration", "berthing",
)  # fmt: skip
IN_WIND = ("straight", "turning:35", "zigzag:20/20", "berthing")
# Trials that a full-scale ship can be ordered to do: those of ITTC 7.5-04-02-01 and IMO MSC.137(76).
OF_SHIPS = ("turning:35", "turning:-35", "zigzag:10/10", "zigzag:20/20", "spiral:15/5", "pull-out:20", "crash-stop")
# Effect of an instrument -> how to know it better than by a manoeuvre.
MEASURED_OTHERWISE = {
    "antenna_offset": "measure it on the drawing",
    "heading_bias": "compare the compass with the course over ground of a straight run, or with a bearing",
    "log_scale": "run the measured mile both ways",
}


@dataclass(frozen=True)
class Option:
    """One possible trial: its name in words, the manoeuvre as ``mmg simulate`` takes it, its approach and wind. speed
    [m/s], n [1/s]: None for the defaults."""

    name: str
    maneuver: str
    speed: float | None = None
    n: float | None = None
    wind: Wind | None = None

    @property
    def arguments(self) -> str:
        """What follows ``mmg simulate SHIP`` to see it."""
        words = [self.maneuver]
        words += [f"--speed {self.speed:.3g}"] if self.speed is not None else []
        words += [f"--n {self.n:.3g}"] if self.n is not None else []
        words += [f"--wind {self.wind.speed:.3g}:{math.degrees(self.wind.direction):.0f}"] if self.wind else []
        return " ".join(words)


def library(ship: Ship, wind: bool = True) -> tuple[Option, ...]:
    """The trials to choose from, simple ones first: manoeuvres at full and half speed, some astern, some in wind.

    wind: whether there may be wind where trials are run: not in a towing tank, whose records have no wind. In wind only
    where the ship has wind forces, astern only where her propeller can be reversed. A full-scale ship is given standard
    trials alone.
    """
    full = own_speed(ship)
    if ship.particulars["L"] >= MODEL:
        slow = ("zigzag:10/10", "zigzag:20/20", "turning:35", "turning:-35")
        ordered = [Option(name, name) for name in OF_SHIPS]
        return (*ordered, *(Option(f"{name} at half speed", name, speed=full / 2) for name in slow))
    options = [Option(name, name) for name in MANEUVERS]
    options += [Option(f"{name} at half speed", name, speed=full / 2) for name in MANEUVERS if name != "acceleration"]
    if "n" in ship.actuators and "pitch" not in ship.actuators:
        going_astern = ("straight", "turning:35", "turning:-35")
        with suppress(NoSolution):  # a fitted polynomial may hold no steady speed
            n = parse_maneuver("straight", ship).n  # ahead at full speed; 80 % of them astern at half speed, by hand
            options += [Option(f"{name} astern", name, -full / 2, -0.8 * n) for name in going_astern]
    if wind and ship.feels_wind:
        speed = WIND_SPEED * time_scale(ship.particulars["L"])
        air = Wind(speed, math.radians(WIND_FROM))
        options += [Option(f"{name} in wind", name, wind=air) for name in IN_WIND]
    return tuple(options)


# Time at sea of a trial [s of a 3 m model, Froude scaled], the same for all, so that gains compare. Set by hand.
DURATION = 300.0
# Way between two repetitions, in which she gains the approach speed again [ship lengths at that]. Set by hand.
REGAIN = 5.0
# Least part of a variance that a trial must remove to be recommended for it. Set by hand: it decides what is advised.
HELPS = 0.1
# Of trials that gain at least this part of the best one's the library's first, a simple one, is named. Set by hand.
NEARLY = 0.9


@dataclass(frozen=True)
class NextTrial:
    """What each possible trial would add.

    options: (K,) trials that can be simulated; duration: time at sea of each [s]; left_out: sentences. left: (K, P)
    posterior variance with the trial by that without. total: (K,) mean prior's share with the trial; mean: without,
    both by the information alone, discounted by worth. worth: factor on the information of a run that makes up for
    residuals correlated beyond the noise model.
    """

    options: tuple[Option, ...]
    duration: float
    left_out: tuple[str, ...]
    left: np.ndarray
    total: np.ndarray
    mean: float
    worth: float

    @property
    def overall(self) -> Option | None:
        """The best trial for all coefficients together; None without options."""
        return self.options[simplest(self.mean - self.total)] if self.options else None

    def best(self, i: int | Sequence[int]) -> tuple[Option, float] | None:
        """The best trial for coefficient i, or several of them, and the mean part of their variance left. None when no
        trial helps by ``HELPS``."""
        left = self.left[:, np.atleast_1d(i)].mean(axis=1)
        if not len(left) or left.min() > 1 - HELPS:
            return None
        k = simplest(-np.log(left))
        return self.options[k], float(left[k])

    def best_row(self, i: int | Sequence[int]) -> dict[str, Any] | None:
        """``best`` of coefficient i, or several of them, as plain values; None for none."""
        best = self.best(i)
        return {"name": best[0].name, "variance_left": best[1]} if best else None

    def to_dict(self, symbols: Sequence[str]) -> dict[str, Any]:
        """Plain values for result.json, by coefficient of ``symbols`` (P,)."""
        rows = [{"name": o.name, "simulate": o.arguments} for o in self.options]
        return {
            "duration_s": self.duration,
            "worth": self.worth,
            "mean_prior_share": self.mean,
            "options": [r | {"mean_prior_share": share} for r, share in zip(rows, self.total.tolist(), strict=True)],
            "best": {
                s: {"name": MEASURED_OTHERWISE[effect], "variance_left": None}
                if (effect := s.partition(".")[0]) in MEASURED_OTHERWISE
                else self.best_row(i)
                for i, s in enumerate(symbols)
            },
            "overall": self.overall.name if self.overall else None,
            "left_out": list(self.left_out),
        }


def next_trial(
    calibration: Calibration, options: Sequence[Option] | None = None, duration: float | None = None
) -> NextTrial:
    """Score possible trials by what they would add to a calibration.

    options: default ``library`` of its ship, in wind only where her trials had wind; duration: time at sea of each
    [s], default 300 s of a 3 m model, Froude scaled. Noise levels, windows and step are those of the calibration.
    Returns what each would add, without options where the covariance is not finite. Takes seconds.
    """
    ship, C = calibration.ship, calibration.covariance
    P = len(C)
    seconds = duration or DURATION * time_scale(ship.particulars["L"])
    logged = zip(ship.inputs, calibration.segments.node_controls, strict=False)
    windy = any(name.startswith("wind_") and values.any() for name, values in logged)
    chosen, trials, left_out = runs(ship, options or library(ship, windy), seconds, calibration.segments.h)
    if not np.isfinite(C).all():
        chosen, trials = [], []
    F = fisher(calibration, trials, seconds) if trials else np.empty((0, P, P))
    data = calibration.information.of_data()
    worth = information_discount(data, C) if trials else 1.0
    A, F = worth * data + np.eye(P), worth * F  # in prior standard deviations: the prior adds the identity
    variances = np.diag(np.linalg.inv(A))
    left = np.diagonal(np.linalg.inv(A + F), axis1=1, axis2=2) / variances
    return NextTrial(
        options=tuple(chosen),
        duration=seconds,
        left_out=tuple(left_out),
        left=left,
        total=(left * variances).mean(axis=1),
        mean=float(variances.mean()),
        worth=worth,
    )


def runs(
    ship: Ship, options: Sequence[Option], seconds: float, dt: float
) -> tuple[list[Option], list[Trial], list[str]]:
    """Those of ``options`` that ``ship`` can run for ``seconds`` at steps of ``dt`` [s], their trials, and why the
    others are left out."""
    chosen, trials, left_out = [], [], []
    for option in options:
        try:
            maneuver = parse_maneuver(option.maneuver, ship, n=option.n, speed=option.speed, duration=seconds)
            trial = simulate(ship, maneuver, dt, option.wind)
        except UserError as error:
            left_out.append(f"{option.name}: {error}")
            continue
        if len(trial) < 12:  # a window has ten steps at least (``fisher``)
            left_out.append(f"{option.name}: over before it begins")
        else:
            chosen.append(option)
            trials.append(trial)
    return chosen, trials, left_out


def fisher(calibration: Calibration, trials: Sequence[Trial], seconds: float) -> np.ndarray:
    """Information (K, P, P) of runs of the calibrated ship, each repeated to fill ``seconds``.

    calibration: whose ship, noise and windows are used; trials: the K runs. In prior standard deviations, prior
    excluded, the initial state of every window being unknown.
    """
    ship, settings, P = calibration.ship, calibration.settings, len(calibration.prior.symbols)
    h = calibration.segments.h
    window = settings.window or 100 * h
    parts = cut(trials, h, window, settings.interval, shortest=10 * h, inputs=ship.inputs)
    prior, fitted = calibration.prior, calibration.problem
    if ship.symbols == fitted.ship.symbols and ship.effects == fitted.ship.effects:  # the kernels that are there
        joined = prior.joined(ship, fitted.prior.constants)  # constants of campaigns last
        problem = Problem(ship, joined, fitted.kernels, parts, calibration.sigma)
    else:
        problem = Problem.of(ship, prior, parts, calibration.sigma, compiled=settings.compiled)
    p = np.concatenate([calibration.p, np.zeros(problem.P - P)])  # constants of campaigns at their mean
    per_window = information(problem, problem.join(problem.measured_nodes, p)).fisher[:, :P, :P]
    F = group_sums(parts.run, np.nan_to_num(per_window), len(trials))
    repeats = np.array([repetitions(t, seconds, ship) for t in trials])
    return F * repeats[:, None, None]


def repetitions(trial: Trial, seconds: float, ship: Ship) -> float:
    """How often a ``trial`` of a ``ship`` is run in so many ``seconds``, with way for another approach between: 1 or
    more."""
    speed = max(abs(float(trial["u"][0])), 0.01 * reference_speed(ship.particulars["L"]))  # a trial may begin at rest
    between = REGAIN * ship.particulars["L"] / speed
    return max(1.0, (seconds + between) // max(trial.duration + between, 1e-9))


def simplest(gain: np.ndarray) -> int:
    """First of the trials whose gain (K,) is nearly the best."""
    return int(np.argmax(gain >= NEARLY * gain.max()))


def identifiability_dict(found: Identifiability, trial: NextTrial | None = None) -> dict[str, Any]:
    """Plain values for result.json: what was ``found``, and the trials scored (``trial``), if any."""
    content = found.to_dict()
    if trial:
        symbols = [f.symbol for f in found.findings]
        content["next_trial"] = trial.to_dict(symbols)
        for cluster in content["clusters"]:
            cluster["best_trial"] = trial.best_row([symbols.index(s) for s in cluster["symbols"]])
    return content
