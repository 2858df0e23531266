"""Broken stretches put into records: how many are found, and how much sound time is lost for them.

``python -m benchmarks.stretches [--seed N] [--breaks 30] [--world NAME ...] [--record]``: into each real record each
kind of break, one by one; and into runs of the generator of the blind benchmark, of whose clean runs none may be called
broken. A break lies where the ship makes way and turns, as one that changes nothing is none. Found: at least half of
its time lies in what is found. Lost: seconds outside of it that were not found before, over the duration of the record.
Lengths and sizes are those of a 3 m model; times grow with the root of the length of the ship, as Froude has it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid

from benchmarks.blind.generator.world import NARROW, WORLDS, World
from benchmarks.blind.generator.write import generate
from benchmarks.record import Figure, parser_of, report
from cases.checks.stretches import broken_stretches
from cases.io.published_splits import data_folder
from cases.io.read import read_trials
from cases.trial import Trial, inside

Columns = dict[str, np.ndarray]
Break = Callable[[Columns, slice, float, np.random.Generator], None]
"""Changes the columns in the rows; the third is the length of the ship over that of the 3 m model."""
STATES = ("x", "y", "psi", "u", "v", "r")
INPUTS = ("n", "delta", "delta_port", "delta_starboard", "n_bow", "n_stern")


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _heading(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """The heading is off by 4 to 15 deg."""
    c["psi"][rows] += np.radians(rng.uniform(4, 15)) * _sign(rng)


def _velocities(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """u and v are off by 0.3 to 0.8 of the rms speed."""
    size = np.sqrt(np.nanmean(c["u"] ** 2 + c["v"] ** 2))
    for name in ("u", "v"):
        c[name][rows] += rng.uniform(0.3, 0.8) * size * _sign(rng)


def _both(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """The heading is off, and the velocities are noisy."""
    _heading(c, rows, scale, rng)
    for name in ("u", "v"):
        c[name][rows] += 0.3 * np.nanstd(c["u"]) * rng.standard_normal(rows.stop - rows.start)


def _touched(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """A hand turns the ship to and fro: turn rate and heading agree, the inputs rest."""
    t = c["t"][rows]
    swing = rng.uniform(0.08, 0.12) / scale**0.5 * np.sin(2 * np.pi * (t - t[0]) / (t[-1] - t[0]))
    c["r"][rows] += swing
    c["psi"][rows] += cumulative_trapezoid(swing, t, initial=0)
    _rest(c, rows)


def _frozen(c: Columns, rows: slice, scale: float, rng: np.random.Generator) -> None:
    """One channel keeps its value, or all do."""
    for name in str(rng.choice(["psi", "x y", "u v", "r", "psi x y u v"])).split():
        c[name][rows] = c[name][rows.start]


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
    turned[rows] = cumulative_trapezoid(swing, t, initial=0)
    turned[rows.stop :] = turned[rows.stop - 1]
    w, t = c["u"] + 1j * c["v"], c["t"]
    other = w * np.exp(1j * c["psi"]) * (np.exp(1j * turned) - 1.0)
    moved = cumulative_trapezoid(other, t, initial=0)
    c["psi"] += turned
    c["x"] += moved.real
    c["y"] += moved.imag
    _rest(c, rows)


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


def _rest(c: Columns, rows: slice) -> None:
    for name in INPUTS:
        if name in c:
            c[name][rows] = 0.0


KINDS: dict[str, tuple[Break, float, float]] = {
    "heading": (_heading, 4.0, 10.0),
    "velocities": (_velocities, 4.0, 10.0),
    "heading and velocities": (_both, 4.0, 10.0),
    "touched": (_touched, 4.0, 10.0),
    "frozen": (_frozen, 4.0, 10.0),
    "heading drifts for a minute": (_drift, 50.0, 70.0),
    "last sample repeated": (_held, 3.0, 8.0),
    "seconds replayed": (_replayed, 3.0, 8.0),
    "sign of r, v or u swapped": (_swapped, 5.0, 5.0),
    "turned slowly by hand": (_caught, 20.0, 40.0),
    "position jumps and returns": (_thrown, 3.0, 10.0),
    "train of spikes in u or v": (_spikes, 5.0, 15.0),
}
"""Kind -> what it does, shortest and longest time [s] of a 3 m model. The finder was made on the first five."""


def broken(trial: Trial, kind: str, scale: float, rng: np.random.Generator) -> tuple[Trial, tuple[float, float]] | None:
    """``trial`` with a break of this ``kind``, and its begin and end [s]; None where there is no place for it.

    scale: length of the ship over 3 m; rng: of place and size.
    """
    change, shortest, longest = KINDS[kind]
    count = round(rng.uniform(shortest, longest) * scale**0.5 / trial.dt)
    speed, turn = np.hypot(trial["u"], trial["v"]), np.abs(trial["r"])
    awake = (speed > 0.3 * np.nanmedian(speed)) & (turn > 0.5 * np.nanmedian(turn))
    awake &= ~inside(trial, [(s.begin_s - 3, s.end_s + 3) for s in broken_stretches(trial)])
    room = round(5 * scale**0.5 / trial.dt)
    first = room if shortest >= 50 else max(count, room)  # a drift has no need of room before it
    share = 0.8 if longest < 20 else 0.5
    starts = [i for i in range(first, len(trial) - count - room) if awake[i : i + count].mean() > share]
    if not starts:
        return None
    begin = int(rng.choice(starts))
    rows = slice(begin, begin + count)
    columns = {name: values.copy() for name, values in trial.columns.items()}
    columns["psi"] = trial.psi_unwrapped.copy()
    change(columns, rows, scale, rng)
    return trial.with_columns(**columns), (float(trial.t[begin]), float(trial.t[begin + count - 1]))


def judged(before: Trial, after: Trial, span: tuple[float, float]) -> tuple[bool, float]:
    """Whether a break in ``span`` of the trial ``after`` was found, and the share of sound time lost for it."""
    found = [(s.begin_s, s.end_s) for s in broken_stretches(after)]
    within = inside(after, [span])
    flagged = inside(after, found)
    old = inside(before, [(s.begin_s, s.end_s) for s in broken_stretches(before)])
    return bool(flagged[within].mean() >= 0.5), float((flagged & ~within & ~old).mean())


def clean_runs(world: World, least: int, seed: int) -> list[Trial]:
    """At least so many runs of a ``world`` without any hidden effect, from a seed."""
    with tempfile.TemporaryDirectory() as scratch:
        generate(Path(scratch) / "out", -(-least // 12), seed, "null", world)
        trials = read_trials([Path(scratch) / "out"])
    return trials[:least]


def shares(kind: str, rows: Iterable[tuple[bool, float]]) -> tuple[int, int, float]:
    """Breaks found, breaks, and the mean share of sound time lost in ``rows``; prints them for the ``kind``."""
    found, lost = zip(*rows, strict=True)
    print(f"{kind:28s} found {sum(found)} of {len(found)}, lost {np.mean(lost):.2%}", flush=True)
    return sum(found), len(found), float(np.mean(lost))


def main() -> None:
    """Prints false stretches of each world, and lines per kind of break."""
    parser = parser_of("stretches", __doc__)
    parser.add_argument("--seed", type=int, default=29)
    parser.add_argument("--runs", type=int, default=100, help="clean runs of each world")
    parser.add_argument("--breaks", type=int, default=30, help="of each kind")
    parser.add_argument("--world", nargs="+", choices=tuple(WORLDS), default=list(NARROW))
    given = parser.parse_args()
    records = read_trials([data_folder() / "frt-ds-esso"])
    pool, false, clean = [], 0, 0
    for name in given.world:
        trials = clean_runs(WORLDS[name], given.runs, given.seed)
        wrong = sum(len(broken_stretches(trial)) for trial in trials)
        print(f"{name}: {len(trials)} clean runs, {wrong} false stretches", flush=True)
        false, clean = false + wrong, clean + len(trials)
        pool.append([(trial, WORLDS[name].scale) for trial in trials])
    real: list[tuple[bool, float]] = []
    made: list[tuple[bool, float]] = []
    for number, kind in enumerate(KINDS):
        rng = np.random.default_rng([given.seed, number])
        tried = [(trial, broken(trial, kind, 1.0, rng)) for trial in records]
        real += (rows := [judged(trial, *one) for trial, one in tried if one])
        shares(f"records, {kind}", rows)
        rows = []
        while len(rows) < given.breaks:
            some = pool[len(rows) % len(pool)]
            trial, scale = some[int(rng.integers(len(some)))]
            if one := broken(trial, kind, scale, rng):
                rows.append(judged(trial, *one))
        made += rows
        shares(f"worlds, {kind}", rows)
    figures = {"stretches_false": Figure("false stretches in clean runs", false, of=clean)}
    for name, words, rows in (("records", "real records", real), ("worlds", "runs of the generator", made)):
        hits, count, lost = shares(f"all {words}", rows)
        figures[f"stretches_{name}"] = Figure(f"broken stretches found in {words}", hits, of=count)
        figures[f"stretches_{name}_lost"] = Figure(f"sound time lost for a break in {words}", lost, "%")
    report(figures, f"stretches --seed {given.seed} --world {' '.join(given.world)}", given.record)


if __name__ == "__main__":
    main()
