"""Are the IMO figures of a new ship inside her error bars, after one unattended call? Three generators of sea trials.

python -m benchmarks.yards [--seeds N] [--tide] [--models] [--diagnosed] [--workers N] [--record]

Each yard tests a ship of 70 to 320 m: two 10/10 zigzags, one 20/20, two circles of 35 deg, logged once a second with
noise, the ship's rudder rate between 2.3 and 3.6 deg/s, in half of the cases with the antenna 0.3 L aft of midship, in
half of them in a current of 5 % of her speed (--tide: all, which turns along one axis from run to run), none of which
is said. ``mmg start --yes`` gets the logs and L, B, d, C_b
and the speed. Judged are advance, transfer, tactical diameter and overshoots against the true ship in calm, still
water.

* plant: benchmarks/file_faults/plant.py, whose equations and numerics are not the package's, with gusty wind;
* mariner: the polynomial of a cargo ship, of another form than the hull that is fitted;
* kvlcc2_full: drawn around this tanker, with asymmetric wake and rudder, whose force models are not those fitted.

--models: ship models of 2.5 to 8 m, logged ten times a second, rudders of 8 to 60 deg/s: the plant, whose rudder slows
down over 0.3 s before it arrives, and ships drawn around the library's models.

--diagnosed asks ``mmg diagnose`` instead, with a tanker's particulars for all that is known of her, what is different:
nothing, a current, fouling, a lag of the rudder. A cause that is there, in her surroundings, is to be named; no other.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.file_faults.plant import Hull, Plant, Weather, circle, run, zigzag
from benchmarks.record import Figure, done, parser_of, report
from cases.criteria.imo import imo_figures
from cases.criteria.standard_runs import measured_runs, simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from fitting.prediction.figure_intervals import DRAWS, with_intervals
from fitting.result import read_fit
from mmg_ident import diagnose, new_ship
from mmg_ident.commands.main import main as command
from tests.support.disturbed_trials import drawn_ship

ORDERS = ("zigzag:10/10", "zigzag:-10/10", "zigzag:20/20", "turning:35", "turning:-35")
STANDARD = (*ORDERS, "zigzag:-20/20")
JUDGED = {"turning": ("advance", "transfer", "tactical_diameter"), "zigzag": ("overshoot_1", "overshoot_2")}
DEG = math.pi / 180
FIRST = 301
"""Seed of the first ship of each generator: the propeller by rule was made on those from 1, the asymmetry of the wake
and the draws of figures on those from 101."""
FINER = 10
"""Steps of a simulation between two samples of a log."""
SUSPECTS = {"antenna_offset": "antenna", "current": "current"}


@dataclass(frozen=True)
class Fleet:
    """Ships by ``kinds``, the plant or names of the library: least and largest length of the plant [m], rate of the
    rudder [deg/s] and wind [m/s]; revolutions of the plant [1/s]; seconds between samples of a log."""

    kinds: tuple[str, ...]
    length: tuple[float, float]
    rate: tuple[float, float]
    wind: tuple[float, float]
    revolutions: float
    interval: float


SHIPS = Fleet(("plant", "mariner", "kvlcc2_full"), (70.0, 180.0), (2.3, 3.6), (0.0, 6.0), 2.0, 1.0)
MODELS = Fleet(("plant", "kvlcc2_l7", "esso_osaka_3m"), (2.5, 8.0), (8.0, 60.0), (0.0, 0.0), 10.0, 0.1)


@dataclass(frozen=True)
class Yard:
    """Trials of a ship: her particulars [SI], what was hidden, and her true figures by run, SI and rad."""

    trials: tuple[Trial, ...]
    particulars: Mapping[str, float]
    hidden: Mapping[str, bool]
    truth: Mapping[str, Mapping[str, float]]


def logged(columns: dict[str, np.ndarray], length: float, rng: np.random.Generator, name: str) -> Trial:
    """The true ``columns`` with the noise of instruments on a ship of this ``length`` [m]."""
    size = length / 7
    noise = {"x": 0.02 * size, "y": 0.02 * size, "psi": 1.7e-3, "u": 0.005 * size**0.5, "v": 0.005 * size**0.5,
             "r": 9e-4 / size**0.5}  # fmt: skip
    noisy = {key: columns[key] + std * rng.standard_normal(len(columns["t"])) for key, std in noise.items()}
    return Trial(name.replace(":", "_").replace("/", "_"), {**columns, **noisy}, kind=name.split(":")[0])


def currents(speed: float, seed: int, tide: bool) -> list[complex]:
    """The current of each run to the north and, imaginary, to the east [m/s], of a ship of this ``speed`` [m/s]."""
    turns = [math.cos(0.3 + k * math.pi / len(ORDERS)) if tide else 1.0 for k in range(len(ORDERS))]
    return [complex(0.05 * speed * turn * np.exp(1j * seed)) for turn in turns]


def of_plant(seed: int, tide: bool = False, fleet: Fleet = SHIPS) -> Yard:
    """Sea trials of a plant with equations of her own."""
    rng = np.random.default_rng([5, seed])
    L, block = float(rng.uniform(*fleet.length)), float(rng.uniform(0.6, 0.8))
    B = L / float(rng.uniform(5.5, 7))
    d, speed = B / float(rng.uniform(2.5, 3.2)), float(rng.uniform(0.18, 0.24) * math.sqrt(9.81 * L))
    hull = Hull(L, B, d, block, speed, fleet.revolutions, float(rng.uniform(*fleet.rate)) * DEG)
    wind, flows, aft = float(rng.uniform(*fleet.wind)), bool(rng.integers(0, 2)), bool(rng.integers(0, 2))
    arm, unit, flows = -0.3 * L * aft, L / speed, flows or tide

    def made(order: str, weather: Weather, heading: float, dt: float) -> tuple[Plant, dict[str, np.ndarray]]:
        kind, angle = order.split(":")
        act = (zigzag if kind == "zigzag" else circle)(float(angle.split("/")[0]), heading, 4 * unit)
        plant = Plant(hull, weather, rng)
        columns = run(plant, act, 30 * unit, dt, heading, 0.05 if dt == fleet.interval else 0.02)
        return plant, {**columns, "n": np.full(len(columns["t"]), hull.revolutions)}

    trials, truth = [], {}
    for order, current in zip(ORDERS, currents(speed, seed, tide), strict=True):
        heading = float(rng.uniform(-math.pi, math.pi))
        weather = Weather(
            wind, float(rng.uniform(-math.pi, math.pi)), 0.2, (current.real * flows, current.imag * flows)
        )
        plant, t = made(order, weather, heading, fleet.interval)
        t |= {"wind_speed": np.array([plant.wind_at(s) for s in t["t"]]),
              "wind_direction": np.full(len(t["t"]), weather.direction % (2 * math.pi))}  # fmt: skip
        t |= {"x": t["x"] + arm * np.cos(t["psi"]), "y": t["y"] + arm * np.sin(t["psi"]), "v": t["v"] + arm * t["r"]}
        trials.append(logged(t, L, rng, order))
    for order in STANDARD:  # finely logged: half a second at a reversal is 5 % of an overshoot
        _, t = made(order, Weather(), 0.0, fleet.interval / FINER)
        truth[order] = measured_runs(Trial("true", t, kind=order.split(":")[0]), L)[0].figures
    sizes = {"L": L, "B": B, "d": d, "C_b": block, "U_0": speed}
    return Yard(tuple(trials), sizes, {"antenna": aft, "current": flows}, truth)


def of_library(name: str, seed: int, tide: bool = False, fleet: Fleet = SHIPS) -> Yard:
    """Sea trials of a ship of the library, or drawn around one, simulated by the package."""
    rng, true = np.random.default_rng([6, seed]), load_ship(name)
    L = true.particulars["L"]
    speed = float(rng.uniform(7.0, 7.9)) if name == "mariner" else float(rng.uniform(0.14, 0.2)) * math.sqrt(9.81 * L)
    true = true if name == "mariner" else drawn_ship(true, seed)
    rate, flows, aft = float(rng.uniform(*fleet.rate)) * DEG, bool(rng.integers(0, 2)), bool(rng.integers(0, 2))
    flows, trials = flows or tide, []
    for number, (order, current) in enumerate(zip(ORDERS, currents(speed, seed, tide), strict=True)):
        effects = [f"current:x={current.real:.4f},y={current.imag:.4f}"] * flows
        hidden = with_effects(true, effects + [f"antenna_offset:x={-0.3 * L:.2f}"] * aft)
        plan = parse_maneuver(order, hidden, speed=speed, rudder_rate=rate, duration=30 * L / speed)
        # a logger samples; simulated inputs are means over their intervals, half of one late
        fine = simulated_trial(hidden, plan, seed=100 * seed + number, dt=fleet.interval / FINER).columns
        columns = {name: values[::FINER] for name, values in fine.items()}
        if "n" not in true.actuators:
            columns["n"] = np.full(len(columns["t"]), 1.5)  # a polynomial knows no revolutions
        trials.append(logged(columns, L, rng, order))
    p = true.particulars
    sizes = {key: p[key] for key in ("L", "B", "d")}
    sizes |= {"C_b": p.get("C_b") or p["m"] / (p.get("rho", 1025.0) * L * p["B"] * p["d"]), "U_0": speed}
    truth = {one.name: one.figures for one in imo_figures(true, speed, rudder_rate=rate).runs}
    return Yard(tuple(trials), sizes, {"antenna": aft, "current": flows}, truth)


def diagnosed(what: str, seed: int) -> tuple[bool, int]:
    """Whether the effect ``what`` of a tanker of whom particulars are known is named, and how many others are."""
    rng, true = np.random.default_rng([8, seed]), drawn_ship(load_ship("kvlcc2_full"), seed)
    p = true.particulars
    speed, rate = float(rng.uniform(0.14, 0.2)) * math.sqrt(9.81 * p["L"]), float(rng.uniform(2.3, 3.6)) * DEG
    x, y = 0.03 * speed, 0.04 * speed
    size = {"current": f"x={x:.4f},y={y:.4f}", "fouling": "share=0.3", "rudder_lag": f"T={0.3 * p['L'] / speed:.3f}"}
    hidden = with_effects(true, [f"{what}:{size[what]}"] if what in size else [])
    trials = []
    for number, order in enumerate((*STANDARD, "zigzag:5/5", "turning:-20", "zigzag:15/15")):
        plan = parse_maneuver(order, hidden, speed=speed, rudder_rate=rate, duration=30 * p["L"] / speed)
        columns = dict(simulated_trial(hidden, plan, seed=100 * seed + number, dt=1.0).columns)
        trials.append(logged(columns, p["L"], rng, order))
    block = p["m"] / (p.get("rho", 1025.0) * p["L"] * p["B"] * p["d"])
    ship = new_ship("tanker", {**{key: p[key] for key in ("L", "B", "d")}, "C_b": block, "U_0": speed})
    found = diagnose(ship, trials[:-3], test=trials[-3:])
    names = [effect.name for effect in found.effects]
    print(f"{what} {seed}: {found.verdict}, {names}, instruments {[i.name for i in found.instruments]}", flush=True)
    return what in names, len([name for name in names if name != what])


@dataclass(frozen=True)
class Judgement:
    """Of a yard: whether each figure lies in its interval, the widths of these by the value, errors of the values; what
    of the hidden was named and what that was not there."""

    inside: tuple[bool, ...]
    width: tuple[float, ...]
    error: tuple[float, ...]
    named: tuple[bool, ...]
    false: tuple[bool, ...]


def judged(kind: str, seed: int, tide: bool = False, fleet: Fleet = SHIPS) -> Judgement:
    """What one call of ``mmg start`` makes of the trials of a yard."""
    yard = of_plant(seed, tide, fleet) if kind == "plant" else of_library(kind, seed, tide, fleet)
    with TemporaryDirectory() as scratch:
        logs, out = Path(scratch) / "logs", Path(scratch) / "out"
        logs.mkdir()
        for trial in yard.trials:
            write_trial(trial, logs / f"{trial.name}.csv")
        sizes = ",".join(f"{name}={value:.6g}" for name, value in yard.particulars.items())
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            command(["start", str(logs), "--particulars", sizes, "--out", str(out), "--yes", "--json"])
        suspects = [m["text"] for m in json.loads(printed.getvalue())["messages"] if m["code"] == "suspect"]
        fit = read_fit(out / "run")
        found = with_intervals(imo_figures(fit.ship), fit.ship, fit.to_dict(), DRAWS, seed)
    rows = []
    for row in found.rows:
        wanted = JUDGED.get(row.run.split(":")[0], ())
        value = yard.truth.get(row.run, {}).get(row.figure) if row.figure in wanted else None
        if value is not None and row.interval_90 is not None and row.value:
            size = value / (DEG if row.unit == "deg" else yard.particulars["L"])
            low, high = row.interval_90
            rows.append((low <= size <= high, (high - low) / row.value, row.value / size - 1))
    said = {word: any(f"for {name} (" in text for text in suspects) for name, word in SUSPECTS.items()}
    others = any(f"for {name} (" in text for text in suspects for name in ("heading_bias", "log_scale"))
    named = tuple(said[word] for word, there in yard.hidden.items() if there)
    false = (*(said[word] for word, there in yard.hidden.items() if not there), others)
    inside, width, error = zip(*rows, strict=True)
    print(f"{kind} {seed}: {sum(inside)} of {len(inside)} inside, median width {np.median(width):.0%}, "
          f"rms error {np.sqrt(np.mean(np.square(error))):.1%}, named {named}, false {false}", flush=True)  # fmt: skip
    return Judgement(inside, width, error, named, false)


def of_diagnoses(seeds: range, workers: int) -> dict[str, Figure]:
    """How often a current is named, and what is not there."""
    asked = [((what, seed), (what, seed)) for what in ("nothing", "current", "fouling", "rudder_lag") for seed in seeds]
    found = list(done(diagnosed, asked, workers))
    seen, false = [right for (what, _), (right, _) in found if what == "current"], [n > 0 for _, (_, n) in found]
    words = "diagnoses of tankers of whom particulars are known"
    return {
        "particulars_named": Figure(f"currents named, {words}", sum(seen), of=len(seen)),
        "particulars_false": Figure(f"with a name that is not there, {words}", sum(false), of=len(false)),
    }


def main() -> None:
    """Measures coverage and width of figures, and of what was hidden how much is named."""
    parser = parser_of("yards", __doc__)
    parser.add_argument("--seeds", type=int, default=5, help="ships of each generator")
    parser.add_argument("--tide", action="store_true", help="in a current that turns from run to run")
    parser.add_argument("--models", action="store_true", help="ship models instead of ships")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--diagnosed", action="store_true", help="by mmg diagnose, from particulars")
    given = parser.parse_args()
    seeds = range(FIRST, FIRST + given.seeds)
    if given.diagnosed:
        report(of_diagnoses(seeds, given.workers), f"yards --seeds {given.seeds} --diagnosed", given.record)
        return
    fleet = MODELS if given.models else SHIPS
    tasks = [((kind, seed), (kind, seed, given.tide, fleet)) for kind in fleet.kinds for seed in seeds]
    found = [one for _, one in done(judged, tasks, given.workers)]
    joined = {k: [x for one in found for x in getattr(one, k)] for k in ("inside", "width", "named", "false")}
    inside, named, false = joined["inside"], joined["named"], joined["false"]
    width = float(np.median(joined["width"]))
    words = f"of new ship{' models' if given.models else 's'} of three generators after mmg start --yes"
    words += " in a tide" * given.tide
    figures = {
        "yard_inside": Figure(f"true IMO figures inside their 90 % interval, {words}", sum(inside), of=len(inside)),
        "yard_width": Figure(f"median width of those intervals by the figure, {words}", width, "%"),
        "yard_named": Figure(f"hidden antennas and currents said, {words}", sum(named), of=len(named)),
        "yard_false": Figure(f"suspects said that were not there, {words}", sum(false), of=len(false)),
    }
    where, asked = "tide_" * given.tide + "model_" * given.models, " --tide" * given.tide + " --models" * given.models
    report({f"{where}{key}": one for key, one in figures.items()}, f"yards --seeds {given.seeds}{asked}", given.record)


if __name__ == "__main__":
    main()
