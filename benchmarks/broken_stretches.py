"""Broken stretches put into every real record: how many are found, and how much sound time is lost for it.

``python -m benchmarks.broken_stretches [DATA] [--seed N]``: into each record, one by one, each kind of break, 4 to 10 s
long, at a place where nothing was found before. Found: at least half of its time lies in what is found. Lost:
seconds outside of it that were not found before, over the duration of the record.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cases.checks.stretches import broken_stretches
from cases.io.leave_out import inside
from cases.io.read import read_trials
from cases.trial import Trial

Columns = dict[str, np.ndarray]


def _bump(t: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * (t - t[0]) / (t[-1] - t[0]))


def _heading(c: Columns, rows: slice, rng: np.random.Generator) -> None:
    c["psi"][rows] += np.radians(rng.uniform(4, 15)) * rng.choice((-1, 1))


def _velocities(c: Columns, rows: slice, rng: np.random.Generator) -> None:
    size = np.sqrt(np.nanmean(c["u"] ** 2 + c["v"] ** 2))
    for name in ("u", "v"):
        c[name][rows] += rng.uniform(0.3, 0.8) * size * rng.choice((-1, 1))


def _whole(c: Columns, rows: slice, rng: np.random.Generator) -> None:
    _heading(c, rows, rng)
    for name in ("u", "v"):
        c[name][rows] += 0.3 * np.nanstd(c["u"]) * rng.standard_normal(rows.stop - rows.start)


def _position(c: Columns, rows: slice, rng: np.random.Generator) -> None:
    angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 2.0)
    c["x"][rows] += size * np.cos(angle)
    c["y"][rows] += size * np.sin(angle)


def _touched(c: Columns, rows: slice, rng: np.random.Generator) -> None:
    """A hand turns the ship to and fro: turn rate and heading agree, the inputs rest."""
    t = c["t"][rows]
    swing = rng.uniform(0.08, 0.12) * _bump(t)
    c["r"][rows] += swing
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (swing[1:] + swing[:-1]) * np.diff(t))])
    c["psi"][rows] += turned
    for name in ("n", "delta", "delta_port", "delta_starboard", "n_bow", "n_stern"):
        if name in c:
            c[name][rows] = 0.0


def _frozen(c: Columns, rows: slice, rng: np.random.Generator) -> None:
    for name in rng.choice(np.array(["psi", "x y", "u v", "r", "psi x y u v"])).split():
        c[name][rows] = c[name][rows.start]


KINDS: dict[str, Callable[[Columns, slice, np.random.Generator], None]] = {
    "heading": _heading,
    "velocities": _velocities,
    "heading and velocities": _whole,
    "position": _position,
    "touched": _touched,
    "frozen": _frozen,
}


def injected(trial: Trial, kind: str, rng: np.random.Generator) -> tuple[Trial, tuple[float, float]]:
    """``trial`` with a break of this ``kind`` by ``rng``, and its begin and end [s]."""
    keep = ~inside(trial, [(s.begin_s - 3, s.end_s + 3) for s in broken_stretches(trial)])
    speed = np.hypot(trial["u"], trial["v"]) > 0.3 * np.nanmedian(np.hypot(trial["u"], trial["v"]))
    count = round(rng.uniform(4, 10) / trial.dt)
    turning = np.abs(trial["r"]) > 0.5 * np.nanmedian(np.abs(trial["r"]))
    starts = [
        i
        for i in range(5 * count // 2, len(trial) - 2 * count)
        if keep[i - 20 : i + count + 20].all() and (speed & turning)[i : i + count].mean() > 0.8
    ]
    first = int(rng.choice(starts))
    rows = slice(first, first + count)
    columns = {name: values.copy() for name, values in trial.columns.items()}
    columns["psi"] = trial.psi_unwrapped
    KINDS[kind](columns, rows, rng)
    return trial.with_columns(**columns), (float(trial.t[first]), float(trial.t[first + count - 1]))


def judged(before: Trial, after: Trial, span: tuple[float, float]) -> tuple[bool, float]:
    """Whether a break in ``span`` of the trial ``after`` was found, and the share of sound time lost for it."""
    found = [(s.begin_s, s.end_s) for s in broken_stretches(after)]
    within = inside(after, [span])
    flagged = inside(after, found)
    old = inside(before, [(s.begin_s, s.end_s) for s in broken_stretches(before)])
    return bool(flagged[within].mean() >= 0.5), float((flagged & ~within & ~old).mean())


def main() -> None:
    """Prints a line per kind, and what was found in the records as they are."""
    parser = argparse.ArgumentParser()
    parser.add_argument("data", nargs="?", type=Path, default=Path(os.environ.get("MMG_DATA", "data")) / "frt-ds-esso")
    parser.add_argument("--seed", type=int, default=17)
    given = parser.parse_args()
    trials = read_trials([given.data])
    for trial in trials:
        for s in broken_stretches(trial):
            print(f"{trial.name}: {s.begin_s:.1f} to {s.end_s:.1f} s: {s.what}")
    every: list[tuple[bool, float]] = []
    for kind in KINDS:
        rows = []
        for number, trial in enumerate(trials):
            after, span = injected(trial, kind, np.random.default_rng([given.seed, number, list(KINDS).index(kind)]))
            rows.append(judged(trial, after, span))
        every += rows
        missed = [t.name for t, row in zip(trials, rows, strict=True) if not row[0]]
        print(f"{_line(kind, rows)} {missed}")
    print(_line("all", every))


def _line(what: str, rows: list[tuple[bool, float]]) -> str:
    return f"{what:24s} found {np.mean([f for f, _ in rows]):6.1%}, lost {np.mean([x for _, x in rows]):.2%}"


if __name__ == "__main__":
    main()
