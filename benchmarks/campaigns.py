"""Instruments that differ between campaigns: are their values and the ship's coefficients found, and is nothing found
where days are alike?

Three campaigns of eight runs each, from two worlds. "own": ships drawn from the prior, pushed by random forces in
gusty wind, logged with coloured noise (benchmarks/disturbed_trials.py). "foreign": a plant with another hull structure,
solved by RK45 (benchmarks/file_faults/plant.py), logged with coloured and white noise and a turn rate that is late,
calibrated as an Esso Osaka of that length; no coefficient has a true value there. Lag and scale of the turn rate and
scale of the log are drawn for each campaign, or once for all of them ("alike").

Run from the repository root: python -m benchmarks.campaigns [--seeds 8] [--alike 20] [--worlds own foreign]. Seeds 4100
on. An alike fleet is calibrated and the instruments are chosen; it counts as "same" if the calibration stays as it is.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.disturbed_trials import Disturbed, disturbed_trials, drawn_ship, process
from benchmarks.file_faults.plant import Hull, Plant, Weather, circle, run, zigzag
from benchmarks.record import record, table
from cases.shipfiles.model_changes import with_instruments
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.selection.campaigns.by_campaign import CampaignQuestion, by_campaign
from fitting.settings import Settings
from mmg.errors import UserError

FIRST = 4100
"""First seed."""
DAYS = ("2026-03-02", "2026-03-09", "2026-04-20")
RUNS = ("zigzag:20/20", "zigzag:-20/20", "zigzag:10/10", "zigzag:-10/10", "turning:35", "turning:-35", "turning:20")
SYMBOLS = ("gyro.T", "gyro.share", "log_scale.share")
SPREAD = ((0.0, 0.9), (-0.03, 0.03), (-0.03, 0.03))
"""Range of the constants of a campaign: s, shares."""
SECONDS = 80.0
HULL = Hull(3.0, 0.49, 0.2, 0.83, 0.6, 10.0, 0.3)
TURNS = (("zigzag", 20), ("zigzag", -20), ("zigzag", 10), ("zigzag", -10), ("turn", 35), ("turn", -35), ("turn", 20))
WORLDS = ("own", "foreign")


@dataclass(frozen=True)
class Fleet:
    """Trials; true values (3 campaigns, 3 of SYMBOLS); the coefficients of the ship by symbol, none in a foreign
    world."""

    trials: list[Trial]
    constants: np.ndarray
    coefficients: dict[str, float]


@dataclass(frozen=True)
class Outcome:
    """seed; kept: symbols with a value by campaign; converged; seconds of the choice and of all; inside: (P,) whether
    the 95 % interval of each coefficient holds the truth, without and with campaigns; off: by symbol kept, (3,) errors
    in standard errors, error and true value."""

    seed: int
    kept: tuple[str, ...]
    converged: bool
    seconds: tuple[float, float]
    inside: tuple[np.ndarray, np.ndarray]
    off: dict[str, np.ndarray]


def fleet(world: str, seed: int, alike: bool) -> Fleet:
    """The fleet of a ``world`` by ``seed``; alike: with the same instruments on all days."""
    rng = np.random.default_rng([21, seed])
    low, high = np.array(SPREAD).T
    constants = rng.uniform(low, high, (len(DAYS), len(SYMBOLS)))
    if alike:
        constants[:] = constants[0]
    make = {"own": _own, "foreign": _foreign}[world]
    return make(seed, constants, rng)


def _own(seed: int, constants: np.ndarray, rng: np.random.Generator) -> Fleet:
    base = load_ship("esso_osaka_3m")
    for attempt in range(10):
        ship = drawn_ship(base, seed + 1000 * attempt)
        try:
            found = []
            for day, row in zip(DAYS, constants, strict=True):
                defects = (f"gyro:T={row[0]},share={row[1]}", f"log_scale:share={row[2]}", "velocity_filter:tau=0.7")
                runs = [(text, SECONDS) for text in (*RUNS, f"random:{rng.integers(1000)}")]
                made = disturbed_trials(ship, runs, int(rng.integers(2**31)), Disturbed(defects=defects), dt=0.2)
                found += [_of_day(t, day) for t in made]
            return Fleet(found, constants, {s: ship.coefficients[s].value for s in base.free})
        except UserError:
            continue
    raise SystemExit(f"seed {seed}: ten ships in turn cannot be steered under these forces")


def _foreign(seed: int, constants: np.ndarray, rng: np.random.Generator) -> Fleet:
    found = []
    for day, row in zip(DAYS, constants, strict=True):
        for k, (kind, angle) in enumerate((*TURNS, ("zigzag", 15))):
            heading = float(rng.uniform(-math.pi, math.pi))
            plant = Plant(HULL, Weather(), rng)
            order = (zigzag if kind == "zigzag" else circle)(float(angle), heading, 15.0)
            true = run(plant, order, SECONDS, 0.2, heading)
            found.append(_of_day(Trial(f"{k}_{kind}", _foreign_log(true, row, rng), kind=kind), day))
    return Fleet(found, constants, {})


def _foreign_log(true: dict[str, np.ndarray], row: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The ``true`` columns as the instruments of a campaign with these constants (``row``, 3) log them."""
    t, count = true["t"], len(true["t"])

    def noise(size: float, seconds: float) -> np.ndarray:
        return size * (process(count, 0.2, seconds, rng) + 0.5 * rng.standard_normal(count))

    out = {**true, "n": HULL.revolutions * (1 + 0.01 * np.sin(t / 5.0))}
    for name, size, seconds in (("x", 0.01, 5.0), ("y", 0.01, 5.0), ("u", 0.003, 3.0), ("v", 0.003, 3.0)):
        out[name] = true[name] + noise(size, seconds)
    out["u"] = out["u"] * (1 + row[2])
    out["psi"] = true["psi"] + noise(0.0015, 2.0)
    late = np.interp(t - row[0], t, true["r"])
    out["r"] = late * (1 + row[1]) + noise(0.0008, 0.5)
    return out


def _of_day(trial: Trial, day: str) -> Trial:
    return replace(trial, name=f"{trial.name}_{day}", meta={**trial.meta, "day": day})


def outcome(world: str, seed: int, alike: bool) -> Outcome:
    """What becomes of one fleet, calibrated as ``mmg fit`` does by default."""
    made = fleet(world, seed, alike)
    ship = with_instruments(load_ship("esso_osaka_3m"), ("velocity_filter",))
    settings = Settings(step=1.0, window=40.0)
    began = time.perf_counter()
    found = estimate_coefficients(ship, made.trials, settings)
    middle = time.perf_counter()
    fit = by_campaign(found, CampaignQuestion(ship, made.trials, settings))
    seconds = (time.perf_counter() - middle, time.perf_counter() - began)
    constants, inside = fit.calibration.constants, []
    for calibration in (found, fit.calibration):
        rows = [(calibration.ship.coefficients[s], v) for s, v in made.coefficients.items()]
        inside.append(np.array([abs(c.value - v) <= 1.96 * (c.std or np.nan) for c, v in rows], dtype=bool))
    off = {}
    for k, symbol in enumerate(constants.symbols if constants else ()):
        if constants and symbol in SYMBOLS:
            truth = made.constants[:, SYMBOLS.index(symbol)]
            error = constants.value[:, k] - truth
            off[symbol] = np.array([error / constants.std[:, k], error, truth])
    kept = constants.symbols if constants else ()
    return Outcome(seed, kept, fit.calibration.converged, seconds, (inside[0], inside[1]), off)


def differing_lines(world: str, found: Sequence[Outcome]) -> list[str]:
    """Lines on fleets whose instruments differ."""
    body = []
    for symbol in SYMBOLS:
        rows = [o.off[symbol] for o in found if symbol in o.off]
        if not rows:
            body.append([symbol, f"0 of {len(found)}", "", "", ""])
            continue
        z, _, truth = np.concatenate(rows, axis=1)
        apart = [np.ptp(r[1] + r[2]) / np.ptp(r[2]) for r in rows]
        each = np.concatenate([r[1] - r[1].mean() for r in rows])
        body.append([
            symbol, f"{len(rows)} of {len(found)}", f"{np.mean(np.abs(z) < 1.96):.0%}",
            f"{np.sqrt(np.mean(each**2)):.3g} of {np.std(truth):.3g}", f"{np.median(apart):.2f}",
        ])  # fmt: skip
    lines = table(
        ["constant", "kept", "truth within 1.96 standard errors", "RMS of the differences' error, of the spread",
         "differences found over true ones (median)"], body,
    )  # fmt: skip
    if world == "own":
        shares = [np.concatenate([o.inside[i] for o in found]) for i in (0, 1)]
        lines += [
            "",
            f"Coefficients within their 95 % intervals: {shares[1].mean():.1%} of {len(shares[1])} with campaigns, "
            f"{shares[0].mean():.1%} without.",
        ]
    return [f"World {world}, {len(found)} fleets whose instruments differ:", "", *lines, ""]


def alike_line(world: str, found: Sequence[Outcome]) -> str:
    """A line on fleets whose instruments are alike."""
    kept = [o for o in found if o.kept]
    words = "; ".join(f"seed {o.seed}: {', '.join(o.kept)}" for o in kept)
    seconds = np.mean([o.seconds for o in found], axis=0)
    return (
        f"World {world}, {len(found)} fleets with the same instruments on all days: {len(found) - len(kept)} stay as "
        f"they are{f' ({words})' if words else ''}; {seconds[0]:.1f} s of {seconds[1]:.0f} s for the question."
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.campaigns", description=__doc__)
    parser.add_argument("--seeds", type=int, default=8, help="fleets whose instruments differ, of each world")
    parser.add_argument("--alike", type=int, default=20, help="fleets with the same instruments, of each world")
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS), choices=WORLDS)
    parser.add_argument("--record", action="store_true", help="keep the tables in RESULTS.md")
    given = parser.parse_args()
    lines: list[str] = []
    for world in given.worlds:
        for alike, count in ((False, given.seeds), (True, given.alike)):
            found = []
            for seed in range(FIRST, FIRST + count):
                found.append(outcome(world, seed, alike))
                o = found[-1]
                share = f", inside {o.inside[0].mean():.2f} -> {o.inside[1].mean():.2f}" if len(o.inside[0]) else ""
                what = "alike" if alike else "differ"
                print(f"{world} {what} {seed}: {o.kept}{share}, {o.seconds[1]:.0f} s", flush=True)
            if found:
                part = [alike_line(world, found), ""] if alike else differing_lines(world, found)
                print("\n".join(part), flush=True)
                lines += part
    command = f"python -m benchmarks.campaigns --seeds {given.seeds} --alike {given.alike}"
    if given.record:
        record("Campaigns: instruments that differ by day, and days that are alike", command, lines)


if __name__ == "__main__":
    main()
