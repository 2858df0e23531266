"""Faults of trials that the package simulated: 8 sets of ship and manoeuvres (3 m to 320 m, mild to hard, 1 to 20 Hz,
rounded positions, with and without wind).

Named: the contradictions in the reports of the set have codes of the fault, and no other. Alarm: a contradiction in a
set as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.file_faults.faults import FAULTS as OF_FILES
from benchmarks.file_faults.faults import KNOT, Change, both, earth, scaled, swapped
from benchmarks.toml import tables
from cases.checks import check
from cases.criteria.standard_runs import simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial

SETS = tables(Path(__file__).with_suffix(".toml"))
"""Ship, manoeuvres, wind, interval [s], step to which positions are rounded [m]."""

Fault = Callable[[Trial], Trial]


def _made(change: Change) -> Fault:
    """A ``change`` of the columns of a file as one of a trial."""
    draws = np.random.default_rng(0)
    return lambda t: t.with_columns(**change(t.columns, 0.0, 0.0, draws))


SAME = (
    "velocities earth-fixed", "velocities earth-fixed, east first", "v positive to port", "r positive to port",
    "psi counter-clockwise", "y positive to west", "psi, v, r mirrored", "rudder positive to port",
    "u positive astern", "x and y swapped", "heading from east, counter-clockwise", "heading from east, clockwise",
    "milliseconds as s", "knots as m/s", "psi in deg as rad", "r in deg/s as rad/s", "delta in deg as rad",
    "rpm as rps",
)  # fmt: skip
"""Faults of files that are made here, too."""
FAULTS: dict[str, tuple[Fault, tuple[str, ...]]] = {
    **{name: (_made(OF_FILES[name].change), OF_FILES[name].codes) for name in SAME},
    "psi and r counter-clockwise": (_made(scaled(psi=-1, r=-1)), ("heading_sign", "mirrored_frame")),
    "m/s as knots": (_made(scaled(u=1 / KNOT, v=1 / KNOT)), ("unit",)),
    "km/h as m/s": (_made(scaled(u=3.6, v=3.6)), ("unit",)),
    "m/s as km/h": (_made(scaled(u=1 / 3.6, v=1 / 3.6)), ("unit",)),
    "frozen turn rate": (lambda t: t.with_columns(r=np.full(len(t), 0.001)), ("frozen_channel",)),
    "y and rudder mirrored": (_made(scaled(y=-1, delta=-1)), ("mirrored_frame", "rudder_sign")),
    "earth-fixed, rudder to port": (_made(both(earth(False), scaled(delta=-1))), ("velocity_frame", "rudder_sign")),
    "earth-fixed, knots": (_made(both(earth(False), scaled(u=KNOT, v=KNOT))), ("velocity_frame", "unit")),
    "swapped, rudder to port": (_made(both(swapped, scaled(delta=-1))), ("swapped_positions", "rudder_sign")),
    "earth-fixed, 5 deg off": (
        _made(both(lambda c, *_: {"psi": c["psi"] + math.radians(5)}, earth(False))), ("velocity_frame",),
    ),
    "v, rudder to port": (_made(scaled(v=-1, delta=-1)), ("sway_sign", "v_sign", "rudder_sign")),
    "r in deg/min as deg/s": (_made(scaled(r=60.0)), ("unit", "gain")),
}  # fmt: skip
"""Fault -> what makes it, and the codes that name it."""


def sets(seed: int) -> dict[str, list[Trial]]:
    """The trials of each set, with noise and rounded positions, by ``seed``."""
    out = {}
    for number, (name, (ship, maneuvers, wind, dt, grain)) in enumerate(SETS.items()):
        model = load_ship(ship)
        trials = [
            simulated_trial(model, maneuver, None, wind or None, True, seed + 10 * number + k, dt)
            for k, maneuver in enumerate(maneuvers)
        ]
        if grain:
            trials = [t.with_columns(**{n: np.round(t[n] / grain) * grain for n in "xy"}) for t in trials]
        out[name] = [replace(t, name=f"run_{k}") for k, t in enumerate(trials)]
    return out


SHIPS = {"esso_osaka_3m": 0.1, "vectwin_3m": 0.1, "kvlcc2_l7": 0.2, "mariner": 0.5, "kvlcc2_full": 1.0}
"""Ships of the filtered sets, and their sampling interval [s]."""
RUNS = ("zigzag:10/10", "zigzag:-5/5", "zigzag:2/2", "zigzag:20/20", "turning:15", "turning:-35")
HARD = ("random", "crash-stop", "berthing")


def filtered(seed: int) -> list[Trial]:
    """Seven sound files of one ship whose u and v pass a filter of 0.1 to 0.5 s, in body axes or over ground: mild and
    hard runs, calm or in wind up to twice her speed, with noise, some rounded and some without positions."""
    rng = np.random.default_rng([7, seed])
    name, dt = list(SHIPS.items())[seed % len(SHIPS)]
    ship = load_ship(name)
    runs = [str(run) for run in rng.choice(RUNS if seed % 3 else (*RUNS, "turning:5", "straight"), 7)]
    if name != "mariner" and seed % 4 == 1:
        runs[:2] = [str(run) for run in rng.choice(HARD, 2)]
    speed = 0.07 * math.sqrt(9.81 * ship.particulars["L"])
    wind = f"{rng.uniform(0.3, 2.0) * speed:.3g}:{rng.uniform(0, 360):.0f}:gusty" if seed % 2 else None
    tau, ground, bare = rng.uniform(0.1, 0.5), rng.random() < 0.5, seed % 7 == 3
    grain = float(rng.choice([0.0, 0.01, 0.1])) * ship.particulars["L"] / 100
    out = []
    for number, run in enumerate(runs):
        order = parse_maneuver(run, ship, duration=60 * math.sqrt(ship.particulars["L"]), seed=seed + number)
        trial = simulated_trial(ship, order, None, wind, True, 100 * seed + number, dt)
        turn = np.exp(1j * trial["psi"]) if ground else np.ones(len(trial))
        w = (trial["u"] + 1j * trial["v"]) * turn
        keep, late = math.exp(-dt / tau), w.copy()
        for k in range(1, len(w)):
            late[k] = keep * late[k - 1] + (1 - keep) * w[k]
        columns = {**trial.columns, "u": (late / turn).real, "v": (late / turn).imag}
        if grain:
            columns |= {axis: np.round(columns[axis] / grain) * grain for axis in "xy"}
        out.append(Trial(f"run_{number}", {c: v for c, v in columns.items() if not (bare and c in "xy")}, kind=run))
    return out


def judged_sound(trials: Sequence[Trial]) -> tuple[str, str]:
    """("quiet", "contradictory" or "harmful"), and what was said, of sound ``trials``: any line that is advised for
    them changes what is right."""
    said = [(report, f) for report in check(trials) for f in report.findings]
    found = [(report, f) for report, f in said if f.level == "contradictory"]
    lines = [f for _, f in said if "trials.toml, [" in f.text and f.level != "info"]
    words = "; ".join(f"{report.name}: {f.code}" for report, f in found) + "".join(f" ADVICE {f.text}" for f in lines)
    return "harmful" if lines else "contradictory" if found else "quiet", words


def contradictions(trials: Sequence[Trial]) -> list[str]:
    """Codes of what refutes the ``trials``, as reading and checking them say."""
    found: list[str] = []
    for report in check(trials):
        found += [f.code for f in report.findings if f.level == "contradictory"]
    return found


def judged(trials: list[Trial], title: str) -> tuple[str, str] | None:
    """("named", "other" or "missed"), and what was said, of ``trials`` with the fault ``title``, "" for none: "alarm"
    or "quiet". None where the fault changes nothing, as a ship without a propeller has no revolutions."""
    if not title:
        said = contradictions(trials)
        return "alarm" if said else "quiet", ", ".join(said)
    make, codes = FAULTS[title]
    wrong = [make(trial) for trial in trials]
    if all(np.array_equal(a[c], b[c]) for a, b in zip(trials, wrong, strict=True) for c in a.columns):
        return None
    said = contradictions(wrong)
    kind = "missed" if not said else "named" if set(said) <= set(codes) else "other"
    return kind, ", ".join(sorted(set(said)))
