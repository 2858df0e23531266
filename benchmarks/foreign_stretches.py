"""Broken stretches of kinds that the finder was not made on, in records of the generator of the blind benchmark.

``python -m benchmarks.foreign_stretches [--seed N] [--runs 100] [--breaks 30] [--world NAME ...]``: clean runs of each
world, in which nothing may be found, and in runs of all worlds each kind of break, one by one, where the ship is under
way. Lengths and sizes are those of a 3 m model; times grow with the root of the length of the ship, as Froude has it.
Found and lost are those of ``benchmarks.broken_stretches``.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.blind.generator.world import NARROW, WORLDS, World
from benchmarks.blind.generator.write import generate
from benchmarks.broken_stretches import Columns, judged
from cases.checks.stretches import broken_stretches
from cases.io.read import read_trials
from cases.trial import Trial

STATES = ("x", "y", "psi", "u", "v", "r")
Break = Callable[[Columns, slice, float, np.random.Generator], None]
"""Changes the columns in the rows; the third is the length of the ship over that of the 3 m model."""


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _drift(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """The heading drifts away by 8 to 20 deg, and comes back."""
    ramp = 1.0 - np.abs(np.linspace(-1.0, 1.0, rows.stop - rows.start))
    c["psi"][rows] += np.radians(rng.uniform(8, 20)) * _sign(rng) * ramp


def _held(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """The logger repeats the last sample of all states, while the inputs go on."""
    for name in STATES:
        c[name][rows] = c[name][rows.start]


def _replayed(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """The logger writes the seconds before once more."""
    count = rows.stop - rows.start
    for name in STATES:
        c[name][rows] = c[name][rows.start - count : rows.start]


def _swapped(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """One channel with the other sign: that of r, v or u."""
    c[str(rng.choice(["r", "v", "u"]))][rows] *= -1.0


def _caught(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """A hand turns the ship slowly to and fro, 1.5 to 2.5 times, with her inputs at rest; her path turns with her."""
    t = c["t"][rows]
    phase = 2 * np.pi * rng.uniform(1.5, 2.5) * (t - t[0]) / (t[-1] - t[0])
    swing = rng.uniform(0.03, 0.06) / scale**0.5 * np.sin(phase) * _sign(rng)
    c["r"][rows] += swing
    turned = np.zeros(len(c["t"]))
    turned[rows] = np.concatenate([[0.0], np.cumsum(0.5 * (swing[1:] + swing[:-1]) * np.diff(t))])
    turned[rows.stop :] = turned[rows.stop - 1]
    w, t = c["u"] + 1j * c["v"], c["t"]
    other = w * np.exp(1j * c["psi"]) * (np.exp(1j * turned) - 1.0)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (other[1:] + other[:-1]) * np.diff(t))])
    c["psi"] += turned
    c["x"] += moved.real
    c["y"] += moved.imag
    for name in ("n", "delta", "delta_port", "delta_starboard", "n_bow", "n_stern"):
        if name in c:
            c[name][rows] = 0.0


def _thrown(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """The position jumps by a fifth to one length of the ship, and comes back."""
    angle, size = rng.uniform(0, 2 * np.pi), 3.0 * scale * rng.uniform(0.2, 1.0)
    c["x"][rows] += size * np.cos(angle)
    c["y"][rows] += size * np.sin(angle)


def _spikes(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """Single samples of u or v, one every one to two seconds, are off by 0.3 to 0.8 of the rms speed."""
    name, size = str(rng.choice(["u", "v"])), np.sqrt(np.nanmean(c["u"] ** 2 + c["v"] ** 2))
    dt, row = float(np.median(np.diff(c["t"]))), rows.start
    while row < rows.stop:
        c[name][row] += rng.uniform(0.3, 0.8) * size * _sign(rng)
        row += max(2, round(rng.uniform(1, 2) * scale**0.5 / dt))


KINDS: dict[str, tuple[Break, float, float]] = {
    "heading drifts for a minute": (_drift, 50.0, 70.0),
    "last sample repeated": (_held, 3.0, 8.0),
    "seconds replayed": (_replayed, 3.0, 8.0),
    "sign of r, v or u swapped": (_swapped, 5.0, 5.0),
    "turned slowly by hand": (_caught, 20.0, 40.0),
    "position jumps and returns": (_thrown, 3.0, 10.0),
    "train of spikes in u or v": (_spikes, 5.0, 15.0),
}
"""Kind -> what it does, shortest and longest time [s] of a 3 m model."""


def clean_runs(world: World, least: int, seed: int) -> list[Trial]:
    """At least so many runs of a ``world`` without any hidden effect, from a seed."""
    with tempfile.TemporaryDirectory() as scratch:
        generate(Path(scratch) / "out", -(-least // 12), seed, "null", "mixed", world)
        trials = read_trials([Path(scratch) / "out"])
    return trials[:least] if len(trials) >= least else trials


def broken(trial: Trial, kind: str, scale: float, rng: np.random.Generator) -> tuple[Trial, tuple[float, float]] | None:
    """``trial`` with a break of this ``kind``, and its begin and end [s]; None where she is nowhere under way.

    scale: length of the ship over 3 m; rng: of place and size. It is put where the ship makes way and turns, as a break
    that changes nothing is none.
    """
    change, shortest, longest = KINDS[kind]
    count = round(rng.uniform(shortest, longest) * scale**0.5 / trial.dt)
    speed, turn = np.hypot(trial["u"], trial["v"]), np.abs(trial["r"])
    awake = (speed > 0.3 * np.median(speed)) & (turn > 0.5 * np.median(turn))
    first, last = max(count, 5 * round(scale**0.5 / trial.dt)), len(trial) - count - round(5 * scale**0.5 / trial.dt)
    starts = [i for i in range(first, last) if awake[i : i + count].mean() > (0.8 if count * trial.dt < 20 else 0.5)]
    if count * trial.dt > 40 * scale**0.5:  # a drift has no need of room before it
        starts = [i for i in range(round(5 / trial.dt), last) if awake[i : i + count].mean() > 0.5]
    if not starts:
        return None
    begin = int(rng.choice(starts))
    rows = slice(begin, begin + count)
    columns = {name: values.copy() for name, values in trial.columns.items()}
    columns["psi"] = trial.psi_unwrapped.copy()
    change(columns, rows, scale, rng)
    return trial.with_columns(**columns), (float(trial.t[begin]), float(trial.t[begin + count - 1]))


def main() -> None:
    """Prints false stretches of each world, and a line per kind of break."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=29)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--breaks", type=int, default=30)
    parser.add_argument("--world", nargs="+", choices=tuple(WORLDS), default=list(NARROW))
    given = parser.parse_args()
    pool = []
    for name in given.world:
        world = WORLDS[name]
        trials = clean_runs(world, given.runs, given.seed)
        false = [(t.name, s) for t in trials for s in broken_stretches(t)]
        print(f"{name}: {len(trials)} clean runs, {len(false)} false stretches")
        for run, s in false:
            print(f"    {run}: {s.begin_s:.1f} to {s.end_s:.1f} s: {s.what}")
        pool.append([(trial, world.scale) for trial in trials])
    every: list[tuple[bool, float]] = []
    for kind in KINDS:
        rows: list[tuple[bool, float]] = []
        missed: list[str] = []
        rng = np.random.default_rng([given.seed, list(KINDS).index(kind)])
        while len(rows) < given.breaks:
            own = pool[len(rows) % len(pool)]
            trial, scale = own[int(rng.integers(len(own)))]
            made = broken(trial, kind, scale, rng)
            if made:
                rows.append(judged(trial, *made))
                missed += [] if rows[-1][0] else [f"{trial.path.parent.parent.name if trial.path else ''} {trial.name}"]
        every += rows
        print(f"{line(kind, rows)} {missed}")
    print(line("all", every))


def line(what: str, rows: list[tuple[bool, float]]) -> str:
    """``what``, and the shares of breaks found and of sound time lost in ``rows`` of them."""
    return f"{what:28s} found {np.mean([f for f, _ in rows]):6.1%}, lost {np.mean([x for _, x in rows]):.2%}"


if __name__ == "__main__":
    main()
