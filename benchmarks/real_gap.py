"""The diagnosis on real records whose effect is known, because it was taken away or put in.

Run from the repository root: python -m benchmarks.real_gap [wind] [starts] [calm] [reversal] [components] [unlogged]
[faults] [nothing] [days] (default: all; about half an hour on two cores).
Trained on Train-TZRB and, for the faults, on five other records of Train-TZRB+; checked on the five development
hold-outs, on which nothing is fitted or chosen. Broken stretches are left out, as by ``mmg diagnose``.

* wind: the ship without its wind model; wind_force must be named, and the test trials predicted better.
* starts: the same from three other starting points of the coefficients, drawn from their priors.
* calm: no wind columns at all: the earth-fixed part of the smoothed force, run by run, beside the measured wind.
* reversal: a propeller model without the side force and moment of reversal, on the records that have any.
* components: coefficients of one part of the model held where that part is gone; the library has an effect for none, so
  the answer must be "unknown", or "none" where the other coefficients take it over.
* unlogged: the wind model stays, the logged wind is taken for calm.
* faults: eight faults put into five records, together and one at a time, with the ship calibrated on Train-TZRB.
* nothing: the whole model on halves of the records: no name may come out.
* days: the whole model on the records of each day of Train-TZRB.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.record import record, table
from benchmarks.sound_records import trials_of
from cases.io.groups import group_trials
from cases.published_splits import DEVELOPMENT_HOLDOUT, TRAIN_TZRB
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.model_changes import reduced_ship
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from diagnosis.diagnose import DiagnosisOptions, diagnose
from diagnosis.result import Diagnosis
from fitting.calibration import Settings, estimate_coefficients
from fitting.parallel import run_all
from mmg.components.catalogue import coefficient_table
from mmg.ship import Ship

OTHERS = (
    "random_31-Jul-2020_14_52_18", "turn_14-Oct-2020_14_17_39", "turn_14-Sep-2020_14_16_04",
    "zigzag_31-Jul-2020_13_57_45", "berthing_12-Nov-2020_11_21_46",
)  # fmt: skip
"""Records of Train-TZRB+ into which faults are put."""


def whole_ship() -> Ship:
    """The tanker with the faults of its instruments free that the kinematics show."""
    return freeing_effects(load_ship("esso_osaka_3m"), ["velocity_filter", "gyro"])


def without_wind() -> Ship:
    """The same without a wind model."""
    return reduced_ship(whole_ship(), ["wind"])


def gap(ship: Ship, train: Sequence[Trial], test: Sequence[Trial] = ()) -> Diagnosis:
    """The diagnosis without a learned residual."""
    return diagnose(ship, train, test, options=DiagnosisOptions(learn=False))


def row(name: str, d: Diagnosis) -> list[str]:
    """One line of the table."""
    first = d.candidates[0]
    held = (
        ""
        if d.held_out is None
        else f"{d.held_out.reduction:+.0%} [{d.held_out.interval_90[0]:+.0%}, {d.held_out.interval_90[1]:+.0%}]"
    )
    named = ", ".join(
        f"{e.name} (" + ", ".join(f"{k} {p.value:.3g} ± {p.std:.2g}" for k, p in e.parameters.items()) + ")"
        for e in d.effects
    )
    best = f"{first.name} ({first.score:.0f}; {first.delta_bic or 0:.0f})"
    return [name, d.verdict + (" + remainder" if d.remainder else ""), named or "-", best, held or "-"]


def wind(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    return [row("wind withheld", gap(without_wind(), train, test))]


def starts(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    rows = []
    for seed in (1, 2, 3):
        ship, rng = without_wind(), np.random.default_rng(seed)
        moved = {}
        for s in ship.free:
            c = ship.coefficients[s]
            value = float(np.clip(c.value + 0.5 * c.std * rng.standard_normal(), c.lower, c.upper))
            moved[s] = c.with_(value=value, prior_value=c.value, prior_std=c.std)
        rows.append(row(f"wind withheld, start {seed}", gap(ship.with_coefficients(moved), train, test)))
    return rows


def calm(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    """Median angle between the mean earth-fixed force of a run and the measured wind."""
    bare = [replace(t, columns={k: v for k, v in t.columns.items() if not k.startswith("wind")}) for t in train]
    d = gap(without_wind(), bare)
    lines, angles = [], []
    for trial, found in zip(train, d.where["earth"], strict=True):
        blown = np.nanmean(trial.wind_vector, axis=0)
        angle = np.degrees(np.angle(complex(found["north"], found["east"]) / complex(*blown)))
        angles.append(abs(angle))
        lines.append(
            f"{trial.name}: {found['force']:.2f} N, {angle:+.0f} deg from the wind of {np.hypot(*blown):.1f} m/s"
        )
    print("\n".join(lines))
    return [[*row("no wind columns", d)[:4], f"median angle to the wind {np.median(angles):.0f} deg"]]


def reversal(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    """A propeller model without side force, on the records with reversal."""
    ship = whole_ship()
    components = {**ship.components, "propeller": "standard"}
    rows = {s: ship.coefficients.get(s, c) for s, c in coefficient_table(components, ship.particulars).items()}
    rows |= {s: c for s, c in ship.coefficients.items() if "." in s}
    bare = replace(ship, components=components, coefficients=rows)
    astern = [*(t for t in train if float((t["n"] < -0.5).mean()) > 0.05), *trials_of(OTHERS[-1:])]
    return [row("reversal side force taken out", gap(bare, astern, test))]


COMPONENTS: dict[str, dict[str, float]] = {
    "interaction of rudder and hull (a_H)": {"a_H": 0.0},
    "place of that interaction (x_H), at midship": {"x_H": 0.0},
    "change of the wake with drift (tau, C_P)": {"tau": 0.0, "C_P": 0.0},
    "straightening of the flow at the rudder (gamma_P, gamma_N), none": {"gamma_P": 1.0, "gamma_N": 1.0},
    "cross-flow drag (C_D)": {"C_D": 0.01},
    "coupling of sway and yaw in surge (X_vr)": {"X_vr": 0.0},
    "added mass in sway (m_y)": {"m_y": 0.01},
}
"""Part of the model -> values at which it is gone."""


def components(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    rows = []
    for words, values in COMPONENTS.items():
        ship = whole_ship()
        held = {}
        for s, value in values.items():
            c = ship.coefficients[s]
            held[s] = c.with_(value=value, lower=min(c.lower, value), upper=max(c.upper, value), fixed=True)
        d = gap(ship.with_coefficients(held), train, test)
        force = d.unexplained_force
        rows.append(row(f"withheld: {words}", d))
        if force is not None:
            rows[-1][2] += "; unexplained: " + ", ".join(
                f"{k} {c.force_rms:.2g} {c.unit}" for k, c in force.channels.items()
            )
        print(rows[-1], flush=True)
    return rows


def unlogged(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    """The same ship in winds that nobody measured."""

    def calmed(trials: Sequence[Trial]) -> list[Trial]:
        return [
            replace(t, columns={k: v for k, v in t.columns.items() if not k.startswith(("wind", "apparent"))})
            for t in trials
        ]

    return [row("wind not logged", gap(whole_ship(), calmed(train), calmed(test)))]


def days(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    """The whole model on the records of each day."""
    rows = []
    for day, trials in group_trials(train, "day").members(train).items():
        rows.append(row(f"day {day}: {len(trials)} records", gap(whole_ship(), trials, test)))
    return rows


def shifted(trial: Trial, names: Sequence[str], delay: float) -> Trial:
    """The trial with columns logged late by ``delay`` [s]."""
    columns = dict(trial.columns)
    for name in names:
        columns[name] = np.interp(trial.t - delay, trial.t, columns[name])
    return replace(trial, columns=columns)


def changed(trial: Trial, **columns: np.ndarray) -> Trial:
    return replace(trial, columns={**trial.columns, **columns})


def turned(trial: Trial, angle: float) -> Trial:
    """Heading logged too large by ``angle`` [rad], u and v turned with it."""
    c, s = np.cos(angle), np.sin(angle)
    u, v = trial["u"], trial["v"]
    return changed(trial, psi=trial["psi"] + angle, u=c * u + s * v, v=-s * u + c * v)


def off(trial: Trial, x: float) -> Trial:
    """Position and velocity of a point x [m] ahead of midship."""
    psi = trial["psi"]
    return changed(trial, x=trial["x"] + x * np.cos(psi), y=trial["y"] + x * np.sin(psi), v=trial["v"] + x * trial["r"])


FAULTS: dict[str, tuple[str, Callable[[Trial], Trial]]] = {
    "rudder logged 5 deg too small": ("rudder_offset", lambda t: changed(t, delta=t["delta"] - np.radians(5.0))),
    "rudder and revolutions logged 1.5 s early": ("control_delay", lambda t: shifted(t, ("n", "delta"), -1.5)),
    "positions and velocities logged 1.5 s late": ("gnss_delay", lambda t: shifted(t, ("x", "y", "u", "v"), 1.5)),
    "heading 3 deg too large": ("heading_bias", lambda t: turned(t, np.radians(3.0))),
    "heading alone 3 deg too large": ("heading_bias", lambda t: changed(t, psi=t["psi"] + np.radians(3.0))),
    "positions alone logged 1.5 s late": ("gnss_delay", lambda t: shifted(t, ("x", "y"), 1.5)),
    "u 5 % too large": ("log_scale", lambda t: changed(t, u=1.05 * t["u"])),
    "antenna 0.6 m ahead": ("antenna_offset", lambda t: off(t, 0.6)),
}  # fmt: skip


def fault_case(task: tuple[Ship, str, str | None, Sequence[Trial]]) -> list[str]:
    """[first candidate, named effects, ...] of records (one of them, or all) with a fault or none, in that order."""
    ship, words, one, train = task
    put = FAULTS[words][1] if words in FAULTS else (lambda t: t)
    trials = [put(t) for t in trials_of(OTHERS) if one in (None, t.name)]
    d = diagnose(ship, trials, options=DiagnosisOptions(learn=False), calibrated_on=train)
    return [d.candidates[0].name, *(e.name for e in d.effects)]


def faults(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    """How often each fault is ranked first and named: in five records together, and in each of them alone."""
    ship = estimate_coefficients(whole_ship(), train, Settings()).ship
    kinds = {"no fault": "-", **{words: name for words, (name, _) in FAULTS.items()}}
    tasks = [(ship, words, one, train) for words in kinds for one in (None, *OTHERS)]
    answers = iter(run_all(fault_case, tasks, 2, lambda answer: print(answer, flush=True)))
    rows = []
    for words, name in kinds.items():
        together, *alone = (next(answers) for _ in range(1 + len(OTHERS)))
        named = ", ".join(together[1:]) or "no name"
        told = f"first {sum(a[0] == name for a in alone)}, named {sum(name in a[1:] for a in alone)} of {len(alone)}"
        others = [", ".join(a[1:]) for a in alone if a[1:] and name not in a[1:]]
        rows.append(
            [words, f"together: {named}", f"alone: {told}", f"other names alone: {'; '.join(others) or 'none'}", "-"]
        )
        print(rows[-1], flush=True)
    return rows


def nothing(train: Sequence[Trial], test: Sequence[Trial]) -> list[list[str]]:
    rows = [row("nothing withheld, all", gap(whole_ship(), train, test))]
    for seed in range(4):
        order = np.random.default_rng(seed).permutation(len(train))
        for half in (order[: len(train) // 2], order[len(train) // 2 :]):
            d = gap(whole_ship(), [train[i] for i in sorted(half)], test)
            rows.append(row(f"half {seed}: {', '.join(train[i].name[:14] for i in sorted(half))}", d))
            print(rows[-1], flush=True)
    return rows


PARTS = {f.__name__: f for f in (wind, starts, calm, reversal, components, unlogged, faults, nothing, days)}


def main() -> None:
    began = time.perf_counter()
    chosen = [a for a in sys.argv[1:] if a in PARTS] or list(PARTS)
    train, test = trials_of(TRAIN_TZRB), trials_of(DEVELOPMENT_HOLDOUT)
    rows = []
    for name in chosen:
        for line in PARTS[name](train, test):
            rows.append(line)
            print(line, flush=True)
    lines = table(
        ["case", "verdict", "effects", "first candidate (score; gain in BIC)", "30 s error of the hold-outs"], rows
    )
    lines += ["", f"{time.perf_counter() - began:.0f} s."]
    if "--record" in sys.argv:
        record("Diagnosis of real records", "python -m benchmarks.real_gap " + " ".join(chosen), lines)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
