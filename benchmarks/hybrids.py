"""How much of the error of a ship that has changed since her calibration ``mmg train`` closes, by default settings.

python -m benchmarks.hybrids [--seeds 5] [--workers N] [--out FILE] [--record]

Ships of 3 m and 7 m, their coefficients drawn from the prior, are calibrated on synthetic runs. Then the hull fouls,
the water becomes shallow, the hull is damaged, the rudder stalls, the propeller is another one, or nothing happens. A
residual is trained on new runs, and what it recommends predicts runs of other kinds of manoeuvre, which took no part.
The floor is the error of the true ship, from the same measured states: what sensors leave. Begun again with the same
FILE it goes on where it stopped.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record import Figure, Record, parser_of, report
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, Wind, add_noise, simulate
from cases.trial import Trial
from fitting.prediction.score import pooled_sigma
from fitting.report.run_folder import plain
from fitting.result import FitResult
from mmg.motion.froude import time_scale
from mmg.ship import Ship
from mmg_ident.api import calibrate, score, train
from tests.support.disturbed_trials import drawn_ship

SHIPS = ("esso_osaka_3m", "kvlcc2_l7")
NOTHING = "nothing"
EFFECTS = {"fouled": "fouling:share=0.6", "shallow": "shallow_water:d_h=0.6", "damaged": {"N_v": 0.7},
           "stalled": "rudder_stall:loss=0.4", "propeller": {"k_0": 0.8}, NOTHING: {}}  # fmt: skip
"""What becomes of the ship: an effect of the library, or coefficients times a factor."""
BEFORE = ("random:5", "random:6", "random:7", "zigzag:10/10", "turning:-35", "zigzag:-20/20")
TRAIN = ("random:11", "random:12", "random:13", "random:14", "zigzag:20/20", "zigzag:-10/10")
HELD = ("turning:35", "turning:-25", "pull-out:-20", "berthing")
DURATION, STEP = 120.0, 0.2
"""Of a run of the 3 m ship, and between its rows [s]."""
METRICS = {"window": "30 s", "paper": "100 s"}
AVOIDABLE = 0.1
"""Share of the error above the floor from which on there is something to close."""


def changed(ship: Ship, effect: str) -> Ship:
    """The ``ship`` after an ``effect``."""
    what = EFFECTS[effect]
    if isinstance(what, str):
        return with_effects(ship, [what])
    return ship.with_values({symbol: factor * ship.coefficients[symbol].value for symbol, factor in what.items()})


def logged(ship: Ship, maneuvers: Sequence[str], seed: Sequence[int]) -> list[Trial]:
    """Runs of a ``ship`` in gusty wind, with the noise of sensors, by ``seed``."""
    made, scale = [], time_scale(ship.particulars["L"])
    noise = SensorNoise.for_length(ship.particulars["L"])
    for number, text in enumerate(maneuvers):
        rng = np.random.default_rng([*seed, number])
        wind = Wind(scale * rng.uniform(0.5, 2.0), rng.uniform(0, 2 * np.pi), gusty=True)
        maneuver = parse_maneuver(text, ship, duration=scale * DURATION)
        start = maneuver.start
        start[2] = rng.uniform(-np.pi, np.pi)
        gusts, errors = (int(value) for value in rng.integers(0, 2**31, 2))
        run = add_noise(simulate(ship, maneuver, scale * STEP, wind, gusts, start), noise, errors)
        made.append(replace(run, name=f"{'_'.join(map(str, seed))}_{number}_{run.name}"))
    return made


@cache
def calibrated(name: str, seed: int) -> tuple[Ship, FitResult]:
    """A drawn ship, and her calibration before anything happens."""
    ship = drawn_ship(load_ship(name), seed)
    return ship, calibrate(name, logged(ship, BEFORE, (6, seed)), next_trial=False)


def measured(name: str, effect: str, seed: int) -> dict[str, Any]:
    """Errors on the runs held out, before and after training, and of the true ship; how the residual was judged."""
    used = time.process_time()
    ship, fit = calibrated(name, seed)
    true, place = changed(ship, effect), list(EFFECTS).index(effect)
    held = logged(true, HELD, (7, seed, place))
    found, sigma = train(fit, logged(true, TRAIN, (8, seed, place))), pooled_sigma(held)
    models = {"before": found.start, "recommended": found.ship, "hybrid": found.hybrid, "floor": true}
    scores = {words: score(model, held, sigma) for words, model in models.items() if model is not None}
    errors = {words: [getattr(one, key) for key in METRICS] for words, one in scores.items()}
    row = {"errors": errors, "decision": plain(found.decision)}
    row["answer"] = [f"{metric}: {words}" for metric, words in zip(METRICS.values(), said(row), strict=True)]
    return row | {"processor": round(time.process_time() - used, 1)}


def said(row: dict[str, Any]) -> list[str]:
    """By horizon the change of the error by what is recommended, and the share of the avoidable that is closed."""
    return [f"{change(row, k):+.1%} ({closed(row, k):.0%} of the avoidable)" for k in range(len(METRICS))]


def change(row: dict[str, Any], k: int, by: str = "recommended") -> float:
    """The error of the model ``by`` over that of the calibrated ship less 1; k: number of the metric."""
    return float(row["errors"][by][k] / row["errors"]["before"][k] - 1)


def closed(row: dict[str, Any], k: int, by: str = "recommended") -> float:
    """Share of the error above the floor that is closed, NaN where there is none to speak of; k, by: as of
    ``change``."""
    avoidable = -change(row, k, "floor")
    return -change(row, k, by) / avoidable if avoidable > AVOIDABLE else float("nan")


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, Figure]:
    """Figures for the record."""
    made, where = {}, "runs of other manoeuvres, of 3 m and 7 m"
    for effect in EFFECTS:
        some = [row for row in rows if row["effect"] == effect]
        for k, metric in enumerate(METRICS.values()):
            shares = np.array([x for row in some if np.isfinite(x := closed(row, k))])
            if len(shares):
                error = float(shares.std(ddof=1) / np.sqrt(len(shares))) if len(shares) > 1 else None
                what = f"avoidable error that `mmg train` closes over {metric}, {where}: {effect}"
                kept = np.nanmean([closed(row, k, "hybrid") for row in some if "hybrid" in row["errors"]])
                note = f"{sum(shares >= 0.4)} of {len(shares)} at least 40 %; {kept:.0%} were all residuals kept"
                made[f"hybrid_{effect}_{metric[:-2]}"] = Figure(what, float(shares.mean()), "%", error, note=note)
    worst = max(change(row, k) for row in rows for k in range(len(METRICS)))
    what = f"largest change of an error by what `mmg train` recommends, {where}"
    return made | {"hybrid_worst": Figure(what, worst, "%", note=f"{len(rows)} trainings")}


def main() -> None:
    """Measure, print and, if asked, record."""
    parser = parser_of("hybrids", __doc__)
    parser.add_argument("--seeds", type=int, default=5, help="ships drawn of each length")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs") / "hybrids.jsonl", help="file")
    given = parser.parse_args()
    cells = [(ship, effect, seed) for seed in range(given.seeds) for effect in EFFECTS for ship in SHIPS]
    record, names = Record(given.out), ("ship", "effect", "seed")
    record.measure(measured, [(dict(zip(names, cell, strict=True)), cell) for cell in cells], given.workers)
    report(figures(record.rows), f"hybrids --seeds {given.seeds}", given.record)


if __name__ == "__main__":
    main()
