"""The synthetic trials of ``mmg demo``: a ship of hidden coefficients, its runs, noise, gusty wind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, Wind, add_noise, simulate
from cases.trial import Trial
from mmg.ship import Ship

SHIP = "esso_osaka_3m"  # The ship whose coefficients a demo starts from

# Coefficient -> how far the hidden ship lies from the starting one, in prior standard deviations. Set by hand.
OFFSETS = {
    "X_0F": -0.8, "X_vr": 0.4, "Y_v": -0.9, "Y_r": -0.6, "N_v": 0.7, "N_r": -0.9, "C_D": -0.8, "C_rN": 0.7,
    "C_rY": -0.5, "k_0": 0.7, "t_P": 0.6, "w_P0": -0.8, "tau": -0.7, "C_6": -0.9, "C_7": 0.6, "A_5": 0.8,
    "t_R": 0.7, "a_H": -0.8, "ell_R": 0.8, "k_x": 1.0, "epsilon": -0.7, "gamma_P": 0.8, "gamma_N": -0.6,
}  # fmt: skip

TRAIN = (
    ("zigzag:20/20", 120.0),
    ("zigzag:-10/10", 110.0),
    ("turning:35", 140.0),
    ("turning:-20", 140.0),
    ("random:11", 140.0),
    ("random:12", 140.0),
    ("berthing", 150.0),
)
VALIDATE = (("random:21", 140.0), ("zigzag:-15/15", 110.0))  # Manoeuvre and duration [s] of each run


def hidden_ship() -> Ship:
    """The true ship behind the demo trials: ``SHIP`` with its coefficients moved by ``OFFSETS``."""
    ship = load_ship(SHIP)
    table = ship.coefficients
    values = {name: table[name].value + share * table[name].std for name, share in OFFSETS.items()}
    return replace(ship.with_values(values), name="hidden")


# The effect behind the demo's second campaign, as ``mmg simulate --effect`` takes it.
CURRENT = "current:x=0.08,y=-0.05"
FOULING = "fouling:share=0.6"  # The effect behind its third campaign


def share_of_truth(ship: Ship) -> float:
    """Share of the estimates of ``ship`` whose 95 % interval holds the hidden ship's value."""
    true = hidden_ship().coefficients
    estimates = [c for c in ship.coefficients.values() if c.prior_std is not None and c.symbol in true]
    return sum(abs(c.value - true[c.symbol].value) <= 1.96 * (c.std or 0.0) for c in estimates) / len(estimates)


def demo_trials(
    seed: int = 0, dt: float = 0.1, effects: Sequence[str] = (), every: int = 1
) -> tuple[list[Trial], list[Trial]]:
    """(train, validate): about 940 s and 250 s of the hidden ship, white noise, gusty wind of 0.5 to 2 m/s.

    Every run has its own mean wind and initial heading; all follow from ``seed``. dt: sampling interval [s]; effects:
    switched on (``cases.shipfiles.effects.with_effects``); every: only each so many-th of the training runs is made.
    Returns two lists of trials.
    """
    ship = with_effects(hidden_ship(), effects)
    noise = SensorNoise.for_length(ship.particulars["L"])
    runs = [(run, "train") for run in TRAIN[::every]] + [(run, "validate") for run in VALIDATE]
    trials: dict[str, list[Trial]] = {"train": [], "validate": []}
    for number, ((text, duration), role) in enumerate(runs):
        rng = np.random.default_rng([4, seed, number])
        wind = Wind(rng.uniform(0.5, 2.0), rng.uniform(0, 2 * np.pi), gusty=True)
        maneuver = parse_maneuver(text, ship, n=10.0, duration=duration)
        start = maneuver.start
        start[2] = rng.uniform(-np.pi, np.pi)
        gusts, errors = (int(value) for value in rng.integers(0, 2**31, 2))
        trial = add_noise(simulate(ship, maneuver, dt, wind, gusts, start), noise, errors)
        trials[role].append(replace(trial, role=role, meta={**trial.meta, "seed": str(seed)}))
    return trials["train"], trials["validate"]
