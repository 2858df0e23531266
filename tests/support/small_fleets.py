"""Small fleets: plans and trial files of ships with a few free coefficients, which are fitted within a second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cases.criteria.standard_runs import simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import reduced_ship, with_effects
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import SensorNoise, add_noise, simulate, write_trial
from cases.trial import Trial
from mmg.ship import Ship

FREE = ("Y_v", "Y_r", "N_v", "N_r")


def small_ship() -> Ship:
    """The 3 m tanker with the coefficients FREE alone, and without a wind model."""
    return reduced_ship(load_ship("esso_osaka_3m"), ["wind"], only=FREE)


def sister_of(ship: Ship, changes: Mapping[str, float]) -> Ship:
    """``ship`` with ``changes`` of coefficients, in standard deviations of their priors."""
    rows = dict(ship.coefficients)
    for symbol, size in changes.items():
        rows[symbol] = rows[symbol].with_(value=rows[symbol].value + size * rows[symbol].std)
    return replace(ship, coefficients=rows)


def write_runs(truth: Ship, folder: Path, seed: int) -> None:
    """Noisy runs of the ship ``truth``, as files in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, words in enumerate(("zigzag:20/20", "turning:35", "zigzag:-10/10")):
        plan = parse_maneuver(words, truth, duration=60.0)
        trial = simulated_trial(truth, plan, None, None, True, 100 * seed + k, 0.5)
        write_trial(trial, folder / f"{k}_{words.replace(':', '_').replace('/', '_')}.csv")


def write_start(folder: Path) -> Path:
    """The ship file of ``small_ship`` in ``folder``."""
    path = folder / "start.toml"
    path.write_text(dump_ship(small_ship()), encoding="utf-8")
    return path


def write_plan(folder: Path, ships: Mapping[str, str], tail: str = "") -> Path:
    """A plan in ``folder`` without diagnoses: ``ships`` by name with the lines of their tables, ``tail`` at its end."""
    tables = "\n".join(f"[ships.{name}]\n{lines}\n" for name, lines in ships.items())
    path = folder / "plan.toml"
    path.write_text(f"[fleet]\ndiagnose = false\n\n{tables}\n{tail}\n", encoding="utf-8")
    return path


# Synthetic trials of several days, whose instruments differ from day to day or do not
DAYS = ("2026-03-02", "2026-03-09", "2026-04-20")


def fleet(
    ship: Ship, instruments: Mapping[str, Sequence[str]], maneuvers: Sequence[str], seed: int, n: float, duration: float
) -> list[Trial]:
    """Runs of ``ship`` with noise, one of each of ``maneuvers`` on each day; instruments: effects by day."""
    found = []
    for d, (day, effects) in enumerate(instruments.items()):
        logged = with_effects(ship, effects)
        for k, text in enumerate(maneuvers):
            run = simulate(logged, parse_maneuver(text, ship, n=n, duration=duration), 0.2)
            noisy = add_noise(run, SensorNoise.for_length(ship.particulars["L"]), seed + 100 * d + k)
            found.append(replace(noisy, name=f"{text.split(':')[0]}_{k}_{day}", meta={**noisy.meta, "day": day}))
    return found
