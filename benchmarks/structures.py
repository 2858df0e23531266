"""Generated models on synthetic campaigns of four kinds of actuators, from a start ship whose coefficients are off.

``python -m benchmarks.structures [KIND...]``: vectwin, pods, thrusters, twin; ``units``: polynomials of units by
regression alone; ``other_hull``: a start with another hull model than the true one, twin screw; ``groups``: the VecTwin
ship by groups of test runs, crash astern among them. Each campaign is random harbour use of all actuators in gusty wind
with sensor noise: five runs of 600 s to fit on, two to choose by, two to test. The start ship has the true force models
with coefficients drawn at one prior standard deviation from the true ones; calibrated, it is the reference: the true
structure refitted. Then polynomials alone are candidates. Prints errors of 30 s windows on the test runs by the
variance of the states, the same for noise alone (the true ship), and times.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from cases.shipfiles.model_changes import with_instruments
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship, parse_ship
from cases.simulation.gusts import Wind
from cases.simulation.harbour_inputs import harbour_inputs, ranges_of
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate_controls
from cases.trial import Trial
from fitting.prediction.score import pooled_sigma, score
from fitting.selection.candidates import Rules, candidate
from fitting.selection.choice import StructureChoice
from fitting.selection.coverage import bounded
from fitting.selection.increments import increments
from fitting.selection.regression import regress
from fitting.selection.structure_choice import INSTRUMENTS, choose_structure
from fitting.settings import Settings
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg.states import STATES

FERRY = """
[ship]
name = "ferry"
L = 3.0
B = 0.7
d = 0.15
m = 150.0
x_G = 0.0
rho = 998.0
D_az = 0.06
x_az = -1.2
y_az = 0.2
x_az_2 = -1.2
y_az_2 = -0.2
x_az_3 = 1.2
y_az_3 = 0.2
x_az_4 = 1.2
y_az_4 = -0.2

[model]
hull = "unified"
azimuth = "azimuth"
"""
MAIN = {"L": 3.0, "B": 0.5, "d": 0.17, "C_b": 0.6, "D_P": 0.07, "U_0": 0.8}
NAMES = {
    "vectwin": ("sm2-order2", "sm2-order3", "sm3-order3", "full-order2", "full-order3", "full-order4"),
    "pods": ("sm1-order2", "sm1-order3", "full-order2", "full-order3"),
    "thrusters": ("sm1-order2", "sm1-order3", "full-order2", "full-order3"),
    "twin": ("sm1-order2", "sm1-order3", "full-order2", "full-order3", "full-order4"),
}
"""Polynomials that are tried."""


def true_ship(kind: str) -> Ship:
    """The ship of a campaign."""
    if kind == "vectwin":
        return load_ship("vectwin_3m")
    if kind == "pods":
        return parse_ship(FERRY)
    ship = new_ship(kind, MAIN | {"y_P": 0.12})
    if kind == "twin":
        return ship
    components = {role: model for role, model in ship.components.items() if role != "rudder"}
    from mmg.components.catalogue import coefficient_table

    rows = coefficient_table(components, ship.particulars)
    return replace(ship, components=components, coefficients={s: ship.coefficients.get(s, c) for s, c in rows.items()})


def started_from(ship: Ship, seed: int = 4) -> Ship:
    """The ship with every free coefficient drawn at one standard deviation of its prior, within its bounds."""
    rng = np.random.default_rng(seed)
    rows = {s: ship.coefficients[s] for s in ship.free}
    drawn = {s: float(np.clip(c.value + rng.choice([-1.0, 1.0]) * c.std, c.lower, c.upper)) for s, c in rows.items()}
    return ship.with_values(drawn)


def campaign(ship: Ship, count: int = 9, seconds: float = 600.0) -> list[Trial]:
    """Runs of random harbour use."""
    trials = []
    for seed in range(count):
        wind = Wind(0.2 * (seed % 6), 2.4 * seed, gusty=True) if "wind" in ship.components else None
        ranges = {"n_bow": (0.0, 0.0)} if "n_bow" in ship.actuators else None
        run = simulate_controls(ship, harbour_inputs(ship, seconds, seed, 0.5, ranges), wind, seed)
        trials.append(add_noise(run, SensorNoise.for_length(ship.particulars["L"]), seed))
    return trials


def measure(kind: str) -> None:
    """Prints the rows of one kind."""
    ship, began = true_ship(kind), time.perf_counter()
    runs = campaign(ship)
    start = started_from(ship)
    sets = (runs[:5], runs[5:7], runs[7:])
    settings = Settings(time_limit=100.0, passes=2)
    sigma = pooled_sigma(runs[:5])
    noise = score(Simulator(ship), runs[7:], sigma).window
    true = choose_structure(start, [candidate(start, "mmg", Rules(order=1))], sets, settings)
    print(f"{kind}: {len(ship.actuators)} actuators, {noise:.4f} by the true ship (noise)", flush=True)
    print(f"  true structure refitted: test {true.test['chosen']:.4f}", flush=True)
    found: StructureChoice = choose_structure(start, [candidate(start, n) for n in NAMES[kind]], sets, settings)
    for row in found.table:
        print(
            f"  {row.name:<28} unknowns {row.unknowns:>4}  validation {row.validation:.4f}  {row.seconds:6.1f} s  "
            f"diverged {row.sequences - row.stable}/{row.sequences}",
            flush=True,
        )
    ratio = found.test["chosen"] / true.test["chosen"]
    least = {one.chosen: min(row.validation for row in one.table if row.name == one.chosen) for one in (true, found)}
    print(f"  by validation, with the calibrated ship among the candidates: {min(least, key=lambda name: least[name])}")
    print(
        f"  chosen {found.chosen}: test {found.test['chosen']:.4f}, {ratio:.2f} x the true structure refitted, start "
        f"{found.test['as given']:.4f}; diverged {found.stability.diverged} of {found.stability.sequences}; "
        f"{time.perf_counter() - began:.0f} s in all",
        flush=True,
    )


def measure_units(kind: str, name: str = "units-order3") -> None:
    """Prints errors of the candidate ``name`` by regression, whole and thinned out."""
    ship = true_ship(kind)
    runs = campaign(ship)
    one = bounded(with_instruments(candidate(started_from(ship), name).ship, INSTRUMENTS), runs[:5])
    system, sigma = increments(one, runs[:5]), pooled_sigma(runs[:5])
    for sparse in (False, True):
        found = regress(one, system, sparse)
        model = found.ship(one).with_values(found.values)
        errors = [score(Simulator(model), some, sigma).window for some in (runs[:5], runs[5:7], runs[7:])]
        words = "training {:.4f}  validation {:.4f}  test {:.4f}".format(*errors)
        print(f"{kind}: {name}{'-thinned' if sparse else ''}  unknowns {len(model.free)}  {words}", flush=True)


def crash_astern(ship: Ship, share: float, wait: float, seed: int) -> Trial:
    """A VecTwin ship with ``share`` of her harbour revolutions that goes ahead for ``wait`` s and then turns both
    rudders to full astern, at 20 deg/s."""
    t = np.arange(0.0, wait + 160.0, 0.5)
    most = ranges_of(ship)
    gone = np.maximum(t - wait, 0.0) * np.radians(20.0)
    inputs = {"n": np.full(len(t), share * most["n"][1]), "n_bow": np.zeros(len(t))}
    inputs |= {"delta_port": np.maximum(-gone, most["delta_port"][0])}
    inputs |= {"delta_starboard": np.minimum(gone, most["delta_starboard"][1])}
    rest = {name: np.zeros(len(t)) for name in STATES}
    run = simulate_controls(ship, Trial("crash_astern", {"t": t, **rest, **inputs}), Wind(0.5, 2.0 * seed, True), seed)
    return add_noise(run, SensorNoise.for_length(ship.particulars["L"]), seed)


def measure_groups() -> None:
    """Prints errors of 30 s windows by group of test runs, of the VecTwin ship as given, calibrated and chosen."""
    ship = true_ship("vectwin")
    runs = campaign(ship)
    groups = {"random": runs[7:], "crash astern": [crash_astern(ship, 0.5 + 0.2 * i, 70.0, 20 + i) for i in range(3)]}
    start, sigma = started_from(ship), pooled_sigma(runs[:5])
    sets, settings = (runs[:5], runs[5:7], runs[7:]), Settings(time_limit=100.0, passes=2)
    names = ("mmg", "mmg+sm1-order2", "units-order3", "full-order3", "full-order4")
    every = choose_structure(start, [candidate(start, name) for name in names], sets, settings)
    alone = choose_structure(start, [candidate(start, name) for name in names[2:]], sets, settings)
    models = {"true ship (noise)": ship, "as given": start}
    models |= {f"chosen, {one.chosen}": one.result.ship for one in (every, alone)}
    for name, model in models.items():
        words = ", ".join(f"{k} {score(Simulator(model), some, sigma).window:.4f}" for k, some in groups.items())
        print(f"  {name}: {words}", flush=True)


def measure_other_hull() -> None:
    """Prints what is chosen for a twin-screw ship whose particulars give another hull model than the true one."""
    ship = true_ship("twin")
    start = new_ship("twin", MAIN | {"y_P": 0.12}, hull="polynomial")
    runs = campaign(ship)
    names = ("mmg", "mmg+sm1-order1", "mmg+sm1-order2", "mmg+full-order2", "sm1-order2")
    sets = (runs[:5], runs[5:7], runs[7:])
    found = choose_structure(start, [candidate(start, n) for n in names], sets, Settings(time_limit=60.0, passes=2))
    for row in found.table:
        print(f"  {row.name:<28} unknowns {row.unknowns:>4}  validation {row.validation:.4f}", flush=True)
    print(f"  chosen {found.chosen}: test {found.test}; diverged {found.stability.diverged}", flush=True)


if __name__ == "__main__":
    for word in sys.argv[1:] or list(NAMES):
        if word == "other_hull":
            measure_other_hull()
        elif word == "groups":
            measure_groups()
        elif word == "units":
            for each in ("twin", "vectwin", "thrusters"):
                measure_units(each)
        else:
            measure(word)
