"""The planned trial of a run: how it is asked for, what it is expected to bring, its file, its words and its map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.criteria.figures import figure_unit
from cases.criteria.standard_runs import figures_of
from cases.io.files import replaced
from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.self_propulsion import actuator_positions, own_speed
from cases.quantities import UNITS
from cases.simulation.simulate import SensorNoise, longest_step, wrap
from cases.simulation.simulate_batch import simulate_batch
from fitting.design.plan import (
    RUN_UP,
    Area,
    LibraryRow,
    SequenceSearch,
    TrialWorth,
    best_pairs,
    best_sequence,
    corners,
    is_reversible,
)
from fitting.nlp.prior import Prior
from fitting.prediction.bands import correlation_in, draws_of
from fitting.report.plot_style import AFTER, BEFORE, GREY, dress, new_figure
from fitting.settings import Wish
from mmg.components.catalogue import ROLES, coefficient_table
from mmg.errors import Conflict, Missing, NoSolution, NotCalibrated, OutOfRange, UnknownName, Unsupported
from mmg.messages import OnProgress
from mmg.model import columns
from mmg.motion.flow import INPUTS, STATES
from mmg.motion.froude import reference_speed, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Draws of the coefficients whose tracks must stay inside the area.
DRAWS = 8  # set by hand: of eight all inside says about 75 % with 90 % confidence
STEEPEST = 60.0  # Largest rudder angle that may be requested [deg]. Set by hand.
# Figures that may be requested: the manoeuvre, and its figure there.
FIGURES = {
    "advance": ("turning:35", "advance"),
    "transfer": ("turning:35", "transfer"),
    "tactical_diameter": ("turning:35", "tactical_diameter"),
    "first_overshoot_10": ("zigzag:10/10", "overshoot_1"),
    "second_overshoot_10": ("zigzag:10/10", "overshoot_2"),
    "first_overshoot_20": ("zigzag:20/20", "overshoot_1"),
    "track_reach": ("crash-stop", "track_reach"),
}

# Change of a coefficient [prior standard deviations] for a slope, and sampling of a manoeuvre [s of a 3 m model].
STEP, SAMPLE = 0.1, 0.25  # set by hand: the slope bounds no estimate, only what a plan is expected to gain


def coefficients_wanted(ship: Ship, free: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Those of ``free`` coefficients that ``names`` say: symbols, roles of the ``ship`` such as "hull", or "all".
    Raises UserError for a name that is neither, and for coefficients that the run did not fit."""
    chosen: list[str] = []
    inertia = coefficient_table({}, ship.particulars)  # masses, which every table of coefficients holds
    for name in names:
        if name == "all":
            symbols = list(free)
        elif name in ship.components and name in ROLES:
            table = coefficient_table({name: ship.components[name]}, ship.particulars)
            symbols = [s for s in table if s in ship.coefficients and s in free and s not in inertia]
        elif name in ship.coefficients:
            symbols = [name] if name in free else []
        else:
            roles = ", ".join(ship.components)
            raise UnknownName(
                f"--coefficients {name}: {ship.called} has no such coefficient; give symbols (mmg ships RUN "
                f"lists them), all, or a part of her: {roles}"
            )
        if not symbols:
            raise Conflict(f"--coefficients {name}: not fitted in this run, so no trial can make it better known")
        chosen += symbols
    return tuple(dict.fromkeys(chosen))


def figure_slopes(simulator: Simulator, prior: Prior, names: Sequence[str]) -> np.ndarray:
    """Slopes (m, P) of the figures ``names`` on the free coefficients of ``prior``, by central differences. simulator:
    of the calibrated ship. Raises UserError for an unknown figure, and for one that she does not reach."""
    ship = simulator.ship
    for name in names:
        if name not in FIGURES:
            raise UnknownName(f"--figures {name}: unknown; known: {', '.join(FIGURES)}")
    at, P = prior.positions(ship), len(prior.symbols)
    theta = np.repeat(ship.values[:, None], 2 * P, axis=1)  # each coefficient up, then each down
    for i in range(P):
        theta[at[i], [i, P + i]] += np.array([STEP, -STEP]) * prior.std[i]
    slopes: dict[str, np.ndarray] = {}
    for text in dict.fromkeys(FIGURES[name][0] for name in names):
        maneuver = parse_maneuver(text, ship)
        runs = simulate_batch(simulator, maneuver, theta, SAMPLE * time_scale(ship.particulars["L"]))
        rows = [figures_of(runs.trial(m), maneuver) for m in range(2 * P)]
        for name in names:
            if FIGURES[name][0] == text:
                values = np.array([row.get(FIGURES[name][1], np.nan) for row in rows], dtype=float)
                slopes[name] = (values[:P] - values[P:]) / (2 * STEP)  # by prior standard deviation
    for name, slope in slopes.items():
        if not np.isfinite(slope).all() or not slope.any():
            raise NoSolution(f"--figures {name}: {ship.called} does not reach it in {FIGURES[name][0]}; take another")
    return np.array([slopes[name] for name in names])


@dataclass(frozen=True, repr=False)
class PlannedTrial:
    """The best sequence of orders that a ``search`` found.

    orders, inputs: n [1/s] and delta [rad] (N + 1, 2), ordered and as means over the step that follows; states: (N + 1,
    6) logged columns, placed in the area; std: (N + 1, 6) of them by the draws; fisher: (P, P); rows: of the library;
    tried: sequences; notes: what was assumed.
    """

    search: SequenceSearch
    orders: np.ndarray
    inputs: np.ndarray
    states: np.ndarray
    std: np.ndarray
    fisher: np.ndarray
    rows: tuple[LibraryRow, ...]
    tried: int
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, search: SequenceSearch, x: np.ndarray, rows: tuple[LibraryRow, ...], tried: int, notes: Sequence[str]
    ) -> PlannedTrial:
        """The sequence of the numbers ``x`` (size,) with its motion, placed; the others as the fields."""
        orders, speed, revolutions = search.sequences.orders(x[None])
        positions, inputs = search.inputs(orders, revolutions)
        states = search.motions(inputs, speed)
        fisher = search.trials.fisher(np.ascontiguousarray(states[:, :, 0]), inputs)[0]
        (x0, y0, psi), D = search.placing(states)[0][:, 0], states.shape[2]
        model, values = search.trials.simulator.model, search.ship.values
        logged = np.stack([columns(model, states[:, :, d, 0].T, values).T for d in range(D)], axis=2)  # (N + 1, 6, D)
        c, s, (x_, y_) = np.cos(psi), np.sin(psi), logged[:, :2].copy().swapaxes(0, 1)
        logged[:, 0], logged[:, 1] = x0 + c * x_ - s * y_, y0 + s * x_ + c * y_
        logged[:, 2] += psi
        with np.errstate(all="ignore"):
            off = logged[:, :, 1:] - logged[:, :, :1]
            std = np.sqrt(np.nanmean(off**2, axis=2)) if D > 1 else 0 * logged[:, :, 0]
        return cls(search, orders[:, :, 0], positions[:, :, 0], logged[:, :, 0], std, fisher, rows, tried, tuple(notes))

    def __repr__(self) -> str:
        wish = self.search.wish
        return f"<PlannedTrial for {self.ship.title}: {wish.seconds:g} s within {wish.area} m, {len(self.notes)} notes>"

    @property
    def ship(self) -> Ship:
        """Whose trial it is."""
        return self.search.ship

    @property
    def dt(self) -> float:
        """Step [s]."""
        return self.search.dt

    def to_dict(self) -> dict[str, Any]:
        """Plain values: gains as standard deviations before and after, orders, the library beside it."""
        wish, area, trials = self.search.wish, self.search.area, self.search.trials
        before, after = np.sqrt(trials.variances()), np.sqrt(trials.variances(self.fisher))
        both = {name: {"std_before": float(a), "std_after": float(b), "left": float(b / a), "unit": self._unit(name)}
                for name, a, b in zip(trials.names, before, after, strict=True)}  # fmt: skip
        x, y, psi = self.states[0, :3].tolist()
        return {
            "kind": "planned_trial",
            "ship": self.ship.called,
            "title": self.ship.title,
            "calibration": asdict(self.ship.mark) if self.ship.mark else None,
            "time_s": wish.seconds,
            "area_m": {"length": area.length, "width": area.width, "margin": area.margin},
            "speed_limit_m_s": self.search.speed,
            "seed": wish.seed,
            "start": {"x_m": x, "y_m": y, "heading_deg": math.degrees(psi) % 360, "speed_m_s": float(self.states[0, 3]),
                      "n_rps": float(self.inputs[0, 0])},
            "orders": self.table(),
            "wanted": both,
            "mean_log_variance": float(trials.gain(self.fisher)),
            "library": [{"name": r.option.name, "simulate": r.option.arguments, "mean_log_variance": r.gain,
                         "stays_inside": r.fits} for r in self.rows],
            "best_two_of_the_library": {key: {"names": list(names), "mean_log_variance": gain}
                                        for key, (names, gain) in best_pairs(self.rows, trials).items()},
            "worth": trials.worth,
            "sequences_tried": self.tried,
            "notes": list(self.notes),
            "assumed": list(self.assumed),
        }  # fmt: skip

    def table(self) -> list[dict[str, float]]:
        """The switches of the orders: when [s], and revolutions [1/s] and rudder [deg] from then."""
        at = [0, *(np.flatnonzero(np.abs(np.diff(self.orders, axis=0)).max(axis=1) > 1e-9) + 1).tolist()]
        rows = [(k * self.dt, self.orders[k, 0], np.degrees(self.orders[k, 1])) for k in at]
        return [dict(zip(("t_s", "n_rps", "delta_deg"), map(float, row), strict=True)) for row in rows]

    def _unit(self, name: str) -> str:
        """Unit of a coefficient or figure, "" where it has none."""
        if name in FIGURES:
            return figure_unit(FIGURES[name][1])
        return self.ship.coefficients[name].unit

    @property
    def assumed(self) -> tuple[str, ...]:
        """What the plan rests on, in sentences."""
        search, wish, ship = self.search, self.search.wish, self.ship
        water = "with the current of the calibration" if "current" in ship.effects else "in still water"
        engine = "the propeller may be reversed at any time"
        if not is_reversible(ship):
            diesel = "n" in ship.actuators and "pitch" not in ship.actuators
            engine = "the propeller is not reversed" + (": a diesel engine takes its time for it" if diesel else "")
        side = "before" if self.states[0, 3] < 0 else "behind"
        run_up = f"{RUN_UP:g} ship lengths of a straight run-up {side} the start lie inside the area too"
        share, highest = search.trials.worth, np.abs(self.orders[:, 0]).max()
        correlated = share < 0.95  # set by hand: what is less is no news
        worth = f", {share:.0%} of that information, as her residuals are correlated" if correlated else ""
        return (
            f"calm air, {water}; a straight approach, rudder midships",
            f"orders: rudder up to {math.degrees(wish.rudder_limit):.3g} deg, {highest:.3g} 1/s at most, "
            f"no faster than {search.speed:.3g} m/s; {engine}; the actuators follow at the rates of the ship",
            f"the hull keeps {search.area.margin:.3g} m from the edges, also that of {search.draws.shape[1]} ships "
            f"drawn from the covariance, as orders are open loop; {run_up}",
            f"the gain is a prediction: the ship as calibrated, small changes of her coefficients, the noise and the "
            f"windows of her fit{worth}",
        )

    def write(self, path: str | Path) -> None:
        """The file for the autopilot: t, n, delta (all actuators), predicted motion and its std. path: a CSV file.
        ``n`` and ``delta`` are means over the step that follows, ``n_order`` and ``delta_order`` what is ordered."""
        import pandas as pd

        t, states = self.dt * np.arange(len(self.states)), self.states.copy()
        states[:, 2] = wrap(states[:, 2])
        columns = {"t": np.round(t, 9), **dict(zip(STATES, states.T, strict=True))}
        positions = actuator_positions(self.ship, self.inputs[:, 0], self.inputs[:, 1])
        columns |= {name: np.broadcast_to(values, len(t)) for name, values in positions.items()}
        columns |= {"n": self.inputs[:, 0]} if "n" not in columns else {}
        columns |= {"delta": self.inputs[:, 1]} if not any(name.startswith("delta") for name in columns) else {}
        columns |= {"n_order": self.orders[:, 0], "delta_order": self.orders[:, 1]}
        columns |= {f"{name}_std": self.std[:, i] for i, name in enumerate(STATES)}
        units = {name: UNITS.get(name) or INPUTS.get(name, ("", ""))[1] for name in columns}
        units |= {name: units[name.removesuffix("_std")] for name in columns if name.endswith("_std")}
        columns = {f"{name} [{units[name]}]": values for name, values in columns.items()}
        with replaced(Path(path)) as scratch:
            pd.DataFrame(columns).to_csv(scratch, index=False, lineterminator="\n")


def known_now(content: Mapping[str, Any], ship: Ship) -> tuple[Prior, np.ndarray]:
    """The prior of what was fitted on ``ship``, and the covariance (P, P) in its standard deviations. content: of
    result.json of the calibration. Raises UserError for one without a covariance."""
    symbols, matrix = correlation_in(content) or ([], np.empty((0, 0)))
    rows = content.get("coefficients", {})
    std, prior_std = (np.array([rows[s][key] for s in symbols], dtype=float) for key in ("std", "prior_std"))
    if not symbols or not ((std > 0) & (prior_std > 0)).all():
        raise NotCalibrated(
            f"{ship.called}: the run has no covariance of its coefficients, from which a trial could be planned; fit "
            "until it converges, and train on that run folder"
        )
    prior = Prior.of(ship.fixing([s for s in ship.free if s not in symbols]))  # its std are those after the fit
    order = [symbols.index(s) for s in prior.symbols]
    share = std / prior_std
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    matrix = (vectors * np.maximum(values, 1e-6)) @ vectors.T  # rounded numbers may be indefinite
    covariance = (share[:, None] * matrix * share)[np.ix_(order, order)]
    return replace(prior, std=prior_std[order]), covariance


def plan_trial(ship: Ship, content: Mapping[str, Any], wish: Wish, progress: OnProgress | None = None) -> PlannedTrial:
    """The trial of ``wish`` that would tell most beside the trials that ``ship`` was calibrated on.

    content: of result.json of her calibration, or of the training of a hybrid on it; progress: called at each
    generation of the search. Raises UserError for a run without covariance, an area that the ship does not fit into,
    unknown names, and a time or speed that makes no sense.
    """
    calibrated, notes = _calibration_in(content), []
    if not {"n", "n_azimuth"} & set(ship.actuators):
        raise Missing(f"{ship.called} has no propeller in its model that could be ordered; no trial can be planned")
    if wish.coefficients and wish.figures:
        raise Conflict("give either --coefficients or --figures, one of them")
    area = Area.parse(wish.area, ship, wish.margin)
    prior, covariance = known_now(calibrated, ship)
    angle = math.degrees(wish.rudder_limit)
    if not 1 <= angle <= STEEPEST:
        raise OutOfRange(f"--rudder-limit {angle:g} deg: give 1 to {STEEPEST:g} deg")
    speed, settings = _speed(ship, calibrated, wish), calibrated["settings"]
    step = settings.get("step") or longest_step(ship)
    dt = min(step, longest_step(ship))
    window = max(20, round((settings.get("window") or 100 * step) / dt))  # steps; 100 are the default of a fit
    if not (math.isfinite(wish.seconds) and 40 * dt <= wish.seconds <= 20000 * dt):  # set by hand: bounds time
        raise OutOfRange(f"--time {wish.seconds:g} s: give {40 * dt:g} to {20000 * dt:g} s for {ship.called}")
    simulator = Simulator(ship, bool(settings.get("compiled", True)))
    if wish.figures:
        wanted, names = figure_slopes(simulator, prior, wish.figures), tuple(wish.figures)
    else:
        default = ("hull",) if "hull" in ship.components else ("all",)
        names = coefficients_wanted(ship, prior.symbols, wish.coefficients or default)
        wanted = np.diag(prior.std)[[prior.symbols.index(s) for s in names]]  # in the unit of each
    worth = (calibrated.get("identifiability", {}).get("next_trial") or {}).get("worth")
    if worth is None:
        worth = 1.0
        notes.append("how much the noise of these trials is correlated was not stored (fit without --no-next-trial)")
    sigma, precision = _sigma(calibrated, ship), np.linalg.inv(covariance)
    trials = TrialWorth(simulator, prior, sigma, dt, window, precision, float(worth), wanted, names)
    search = SequenceSearch(trials, wish, area, speed, draws_of(calibrated, ship)[:, :DRAWS])
    x, rows, tried, is_whole = best_sequence(search, progress)
    if not is_whole:
        notes.append(f"the search was ended after {wish.time_limit:g} s (--time-limit); a longer one may find more")
    return PlannedTrial.of(search, x, rows, tried, notes)


def _calibration_in(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """What ``content`` of a result.json knows of the calibration: of a hybrid, that on which it was trained."""
    if content["kind"] != "training":
        return content
    if content["model"] != "hybrid":
        raise Unsupported(
            f"a black box ({content['model']}) has no coefficients that a trial could tell; plan with the "
            "run folder of mmg fit"
        )
    return {**content, "sigma": {}, **(content.get("calibration") or {})}  # no sigma: that of usual sensors


def _speed(ship: Ship, calibrated: Mapping[str, Any], wish: Wish) -> float:
    """Highest speed [m/s]: as given, else the higher one of the ship's own and that which the trials held."""
    if wish.speed_limit is not None:
        limit = reference_speed(ship.particulars["L"])
        if not (math.isfinite(wish.speed_limit) and 0.005 * limit <= wish.speed_limit <= limit):
            raise OutOfRange(f"--speed-limit {wish.speed_limit:g} m/s: give {0.005 * limit:.2g} to {limit:.3g} m/s")
        return wish.speed_limit
    return max(own_speed(ship), *((calibrated.get("envelope") or {}).get("u") or [0.0]))


def _sigma(calibrated: Mapping[str, Any], ship: Ship) -> np.ndarray:
    """Noise (6,) of the states in the fit, of usual sensors where it is not known; infinite for positions that no trial
    has."""
    usual = astuple(SensorNoise.for_length(ship.particulars["L"]))
    scaled = calibrated.get("scaling") is not None
    sigma = [usual[i] if scaled or not (value := calibrated["sigma"].get(s)) else value for i, s in enumerate(STATES)]
    if not scaled and not any(row["has_position"] for row in calibrated["data"]):
        sigma[:2] = [math.inf, math.inf]
    return np.array(sigma, dtype=float)


def in_words(content: Mapping[str, Any], file: str) -> list[str]:
    """Lines for a person on a planned trial. content: its ``to_dict``; file: name of that for the autopilot."""
    start, area, gain = content["start"], content["area_m"], content["mean_log_variance"]
    lines = [
        f"{content['title']}: {content['time_s']:g} s in {area['length']:g} x {area['width']:g} m. Start at x "
        f"{start['x_m']:.2f} m, y {start['y_m']:.2f} m, heading {start['heading_deg']:.0f} deg, with "
        f"{start['speed_m_s']:.3g} m/s and {start['n_rps']:.3g} 1/s. File for the autopilot: {file}.",
        "    t [s]   n [1/s]   rudder [deg]",
    ]
    lines += [f"  {o['t_s']:7.1f} {o['n_rps']:9.2f} {o['delta_deg']:14.0f}" for o in content["orders"]]
    lines.append("standard deviation before -> after")
    for name, row in sorted(content["wanted"].items(), key=lambda item: item[1]["left"]):
        unit, factor = ("deg", math.degrees(1.0)) if row["unit"] == "rad" else (row["unit"], 1.0)
        before, after = (f"{factor * row[key]:.3g}" for key in ("std_before", "std_after"))
        words = name + (f" [{unit}]" if unit and unit != "-" else "")
        lines.append(f"  {words:22s} {before:>10s} -> {after:>10s}  ({row['left']:.0%})")
    lines += ["mean log variance", f"  {gain:+.2f} by the designed trial"]
    lines += [
        f"  {row['mean_log_variance']:+.2f} by {row['name']}" + "  (leaves the area)" * (not row["stays_inside"])
        for row in content["library"][:5]
    ]
    pairs = content["best_two_of_the_library"]
    for key, where in (("inside", "that stay inside"), ("library", "wherever there is room")):
        if key in pairs and not (key == "library" and pairs.get("inside") == pairs[key]):
            names = " and ".join(pairs[key]["names"])
            lines.append(f"  {pairs[key]['mean_log_variance']:+.2f} by the best two, {where}: {names}")
    return [*lines, *(f"assumed: {line}" for line in content["assumed"])]


def plan_map(planned: PlannedTrial) -> Figure:
    """A figure of the ``planned`` trial: map with the hull at equal times, and the orders over time below."""
    from matplotlib.patches import Ellipse, Polygon, Rectangle  # late: slow to import

    area, ship, m = planned.search.area, planned.ship, planned.search.area.margin
    figure = new_figure(8.0)
    title = f"Planned trial of {planned.search.wish.seconds:g} s: {ship.title}"[:110]  # the letters of a line
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    ax, *others = figure.subplots(3, 1, height_ratios=(3.6, 1, 1))
    dress(ax, "y, east [m]", "x, north [m]", "Track, hull, 2 standard deviations")
    ax.add_patch(Rectangle((0, 0), area.width, area.length, fill=False, ec="black", lw=1.5))
    ax.add_patch(Rectangle((m, m), area.width - 2 * m, area.length - 2 * m, fill=False, ec=GREY, lw=0.8, ls="--"))
    x, y = planned.states[:, 0], planned.states[:, 1]
    for k in range(0, len(x), max(1, len(x) // 12)):
        # (east, north) of the four corners round the hull
        outline = np.array(corners(planned.states[k : k + 1, :3, None], ship))[::-1, (0, 1, 3, 2), 0, 0].T
        ax.add_patch(Polygon(outline, closed=True, fill=k == 0, fc=BEFORE, ec=BEFORE, lw=0.8, alpha=0.8))
        size = 4 * np.minimum(planned.std[k, 1::-1], 1e3)  # diameters of two standard deviations, east and north
        ax.add_patch(Ellipse((y[k], x[k]), *size, fc=AFTER, ec="none", alpha=0.15))
    ax.plot(y, x, color=AFTER, lw=1.6)
    ax.set_aspect("equal")
    orders = {"rudder [deg]": np.degrees(planned.orders[:, 1]), "revolutions [1/s]": planned.orders[:, 0]}
    for ax, (words, values) in zip(others, orders.items(), strict=True):
        dress(ax, "t [s]" if ax is others[-1] else "", words)
        ax.step(planned.dt * np.arange(len(x)), values, where="post", color=AFTER, lw=1.4)
        ax.axhline(0, color=GREY, lw=0.6)
    return figure
