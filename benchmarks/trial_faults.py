"""Faults of files put into simulated trials of other ships: does mmg check say what it is, and is its advice right?

``python -m benchmarks.trial_faults [--seed N]``: 8 sets of ship and manoeuvres (3 m to 320 m, mild to hard, 1 to 20 Hz,
rounded positions, with and without wind), each fault in each set. Named: the first contradiction that the report of any
file of the set gives has one of the fault's codes, and no other. Harmful: it has another one, whose advice would leave
the data wrong. False alarm: a contradiction in a set as it is.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cases.checks import check
from cases.criteria.simulated_trial import simulated_trial
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial

KNOT, RPM = 1.943844, 60.0

SETS = {
    "3 m, hard, 10 Hz": ("esso_osaka_3m", ("zigzag:20/20", "turning:35"), None, 0.1, 0.0),
    "3 m, mild, wind, 20 Hz": ("esso_osaka_3m", ("zigzag:10/10", "zigzag:-5/5"), "1.0:60:gusty", 0.05, 0.0),
    "7 m, hard, 10 Hz": ("kvlcc2_l7", ("zigzag:-20/20", "turning:-35"), None, 0.1, 0.0),
    "7 m, mild, 2 Hz": ("kvlcc2_l7", ("zigzag:5/5", "zigzag:10/10"), None, 0.5, 0.01),
    "161 m, hard, 1 Hz": ("mariner", ("zigzag:20/20", "turning:35"), None, 1.0, 0.1),
    "161 m, mild, wind, 2 Hz": ("mariner", ("zigzag:10/10",), "8:60:gusty", 0.5, 0.1),
    "320 m, mild, rounded, 1 Hz": ("kvlcc2_full", ("zigzag:10/10", "zigzag:-10/10"), None, 1.0, 1.0),
    "320 m, hard, wind, 1 Hz": ("kvlcc2_full", ("zigzag:20/20", "turning:-35"), "10:120:gusty", 1.0, 1.0),
}
"""Ship, manoeuvres, wind, interval [s], step to which positions are rounded [m]."""

Fault = Callable[[Trial], Trial]


def _scaled(**by: float) -> Fault:
    return lambda t: t.with_columns(**{name: t[name] * factor for name, factor in by.items()})


def _rounded(trial: Trial, grain: float) -> Trial:
    return trial.with_columns(**{name: np.round(trial[name] / grain) * grain for name in ("x", "y")})


def _also(first: Fault, then: Fault) -> Fault:
    return lambda trial: then(first(trial))


def _earth(swap: bool) -> Fault:
    def made(t: Trial) -> Trial:
        w = (t["u"] + 1j * t["v"]) * np.exp(1j * t["psi"])
        return t.with_columns(u=w.imag, v=w.real) if swap else t.with_columns(u=w.real, v=w.imag)

    return made


DEG = 180 / math.pi
FAULTS: dict[str, tuple[Fault, tuple[str, ...]]] = {
    "earth-fixed velocities": (_earth(False), ("velocity_frame",)),
    "earth-fixed, east first": (_earth(True), ("velocity_frame",)),
    "v to port": (_scaled(v=-1), ("sway_sign", "v_sign")),
    "r to port": (_scaled(r=-1), ("r_sign",)),
    "psi counter-clockwise": (_scaled(psi=-1), ("heading_sign",)),
    "psi, r counter-clockwise": (_scaled(psi=-1, r=-1), ("heading_sign", "mirrored_frame")),
    "y to west": (_scaled(y=-1), ("mirrored_frame",)),
    "psi, v, r mirrored": (_scaled(psi=-1, v=-1, r=-1), ("mirrored_frame",)),
    "rudder to port": (_scaled(delta=-1), ("rudder_sign",)),
    "u astern": (_scaled(u=-1), ("u_sign",)),
    "x and y swapped": (lambda t: t.with_columns(x=t["y"], y=t["x"]), ("swapped_positions",)),
    "heading from east": (lambda t: t.with_columns(psi=math.pi / 2 - t["psi"], r=-t["r"]), ("heading_from_east",)),
    "heading from east, clockwise": (lambda t: t.with_columns(psi=t["psi"] - math.pi / 2), ("heading_from_east",)),
    "milliseconds as seconds": (_scaled(t=1000.0), ("unit",)),
    "knots as m/s": (_scaled(u=KNOT, v=KNOT), ("unit",)),
    "m/s as knots": (_scaled(u=1 / KNOT, v=1 / KNOT), ("unit",)),
    "degrees of psi as rad": (lambda t: t.with_columns(psi=np.mod(t["psi"] * DEG, 360.0)), ("unit",)),
    "degrees of r as rad": (_scaled(r=DEG), ("unit",)),
    "degrees of delta as rad": (_scaled(delta=DEG), ("unit",)),
    "km/h as m/s": (_scaled(u=3.6, v=3.6), ("unit",)),
    "m/s as km/h": (_scaled(u=1 / 3.6, v=1 / 3.6), ("unit",)),
    "rpm as rps": (_scaled(n=RPM), ("unit",)),
    "frozen turn rate": (lambda t: t.with_columns(r=np.full(len(t), 0.001)), ("frozen_channel",)),
    "y and rudder mirrored": (_scaled(y=-1, delta=-1), ("mirrored_frame", "rudder_sign")),
    "earth-fixed, rudder to port": (_also(_earth(False), _scaled(delta=-1)), ("velocity_frame", "rudder_sign")),
    "earth-fixed, knots": (_also(_earth(False), _scaled(u=KNOT, v=KNOT)), ("velocity_frame", "unit")),
    "swapped, rudder to port": (
        lambda t: t.with_columns(x=t["y"], y=t["x"], delta=-t["delta"]),
        ("swapped_positions", "rudder_sign"),
    ),
    "earth-fixed, 5 deg off": (
        lambda t: _earth(False)(t.with_columns(psi=t["psi"] + math.radians(5))),
        ("velocity_frame",),
    ),
    "v, rudder to port": (_scaled(v=-1, delta=-1), ("sway_sign", "v_sign", "rudder_sign")),
    "r in deg/min as deg/s": (_scaled(r=60.0), ("unit", "gain")),
}
"""Fault -> what makes it, and the codes that name it."""


def sets(seed: int) -> dict[str, list[Trial]]:
    """The trials of each set, with noise and rounded positions, by ``seed``."""
    out = {}
    for number, (name, (ship, maneuvers, wind, dt, grain)) in enumerate(SETS.items()):
        model = load_ship(ship)
        trials = [
            simulated_trial(model, maneuver, None, wind, True, seed + 10 * number + k, dt)
            for k, maneuver in enumerate(maneuvers)
        ]
        if grain:
            trials = [_rounded(t, grain) for t in trials]
        out[name] = [replace(t, name=f"run_{k}") for k, t in enumerate(trials)]
    return out


def contradictions(trials: Sequence[Trial]) -> list[str]:
    """Codes of what refutes the ``trials``, as reading and checking them say."""
    found: list[str] = []
    for report in check(trials):
        found += [f.code for f in report.findings if f.level == "contradictory"]
    return found


def main() -> None:
    """Prints a row per fault: in how many sets it is named, missed, or taken for something else."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=17)
    cases = sets(parser.parse_args().seed)
    alarms = {name: contradictions(trials) for name, trials in cases.items()}
    print("false alarms:", {name: codes for name, codes in alarms.items() if codes} or "none")
    total: Counter[str] = Counter()
    for fault, (make, codes) in FAULTS.items():
        row: Counter[str] = Counter()
        for name, trials in cases.items():
            broken = [make(trial) for trial in trials]
            if all(np.array_equal(a[c], b[c]) for a, b in zip(trials, broken, strict=True) for c in a.columns):
                continue  # a ship without a propeller has no revolutions in a wrong unit
            said = contradictions(broken)
            kind = "missed" if not said else "named" if set(said) <= set(codes) else "other"
            row[kind] += 1
            if kind != "named":
                row[f"[{name}: {', '.join(sorted(set(said))) or 'nothing'}]"] += 1
        total += Counter({k: row[k] for k in ("named", "missed", "other")})
        count = sum(row[k] for k in ("named", "missed", "other"))
        print(f"{fault:30s} {row['named']} of {count}", *(k for k in row if k.startswith("[")))
    print(f"named {total['named']} of {sum(total.values())}, taken for something else {total['other']}")


if __name__ == "__main__":
    main()
