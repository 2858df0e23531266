"""Differences between two groups of trials by ``mmg diagnose --between``: false alarms and power.

Run from the repository root: python -m benchmarks.between [--draws 10] [--nulls 30] [--world basin] [--seed 1]
[--workers 1] [--record]. Each draw is a ship of the blind generator (coefficients off by 5 %, random forces, its own
numerics) with six runs of 150 s in either group, of all manoeuvres. In the second group something differs, or nothing
does. What the trials say of each other and of the ship is compared as by the command; the forward selection for all
trials together, which does not take part in that, is left out. Begun again it goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.generator.cases import Case, run
from benchmarks.blind.generator.deal import LIBRARY, Hand
from benchmarks.blind.generator.effect import Drawn, Effect
from benchmarks.blind.generator.foreign import FOREIGN, MISFIT
from benchmarks.blind.generator.world import AIR, COLUMNS, WORLDS, World
from benchmarks.blind.solve import blind_ship
from benchmarks.record import record, table
from cases.evidence.kinematics import consistency
from cases.io.groups import Groups
from cases.trial import Trial
from diagnosis.hypotheses.between import compare_groups
from diagnosis.hypotheses.group_findings import Between
from diagnosis.prepare import prepare, with_sensor_faults
from fitting.parallel import run_all

NAMES = ("t", "x", "y", "psi", "u", "v", "r", "n", "delta", "wind_speed", "wind_direction")
SECOND = np.array([0, 1, 0, 1, 0, 1, 0, 0, 1, 0, 1, 1], dtype=bool)
"""Runs of the generator's mixed set that are of the second group: either has all manoeuvres."""
EFFECTS = {effect.name: effect for effect in (*LIBRARY, *FOREIGN, MISFIT)}
SAME_AS = {"fouling": {"fouling", "X_0F", "R_0", "draft"}}
"""Names that are right as well, where the effect is a coefficient by another name."""


@dataclass(frozen=True)
class Scenario:
    """What differs. words: for the table; effect, strength: of the generator; size: of ``share`` in its place; where:
    share of the effect in each run; logged: what is done to the turn rate of the second group; right: names that are
    right, empty where nothing, or nothing with a name, differs."""

    words: str
    effect: str = ""
    strength: str = "medium"
    size: float | None = None
    where: Callable[[np.random.Generator], np.ndarray] = lambda rng: SECOND.astype(float)
    logged: Callable[[np.ndarray, float], np.ndarray] | None = None
    right: frozenset[str] = frozenset()
    null: bool = False


def _late(r: np.ndarray, sample: float) -> np.ndarray:
    """The turn rate logged 0.6 s late, by whole samples."""
    steps = round(0.6 / sample)
    return np.concatenate([np.repeat(r[:1], steps), r[:-steps]])


def _everywhere(rng: np.random.Generator) -> np.ndarray:
    return np.ones(len(SECOND))


def _by_run(rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal(len(SECOND))


def _library(name: str, strength: str, words: str = "", **more: float) -> Scenario:
    right = frozenset(SAME_AS.get(name, {name}))
    return Scenario(words or f"{name}, {strength}", name, strength, right=right, **more)  # type: ignore[arg-type]


SCENARIOS = (
    Scenario("nothing", null=True),
    Scenario("nothing, but a current of its own in each run", "current", "strong", where=_by_run, null=True),
    Scenario("nothing, but an error of the model in all runs (misfit)", "misfit", where=_everywhere, null=True),
    Scenario("turn rate 0.6 s late", logged=_late, right=frozenset({"gyro"})),
    Scenario("gain of the gyro +3 %", logged=lambda r, _: 1.03 * r, right=frozenset({"gyro"})),
    _library("fouling", "weak", "resistance +20 %", size=0.2),
    _library("fouling", "weak", "resistance +40 %", size=0.4),
    *(_library(name, "medium") for name in ("current", "rudder_offset", "antenna_offset", "gnss_delay", "draft")),
    _library("current", "strong"),
    *(Scenario(f"foreign: {name}", name, "strong") for name in ("quadratic_yaw_damping", "one_sided_drag")),
)


def trials_of(scenario: Scenario, seed: int, world: World) -> list[Trial]:
    """The runs of one draw, in which the second group differs."""
    rng = np.random.default_rng([17, seed])
    effects = ((EFFECTS[scenario.effect], scenario.strength),) if scenario.effect else ()
    case = Case.prepared(Hand("library", effects), "mixed", np.random.SeedSequence([18, seed]), world)
    case.drawn = [(effect, _placed(effect, draw, scenario, rng)) for effect, draw in case.drawn]
    made = run([case])
    trials = []
    for j, kind in enumerate(case.kinds):
        signals = [a[:, j] for a in (made.n, made.delta, made.speed, made.direction)]
        columns = np.column_stack([world.sample * np.arange(len(made.n)), made.columns[:, :, j], *signals])
        if scenario.logged is not None and SECOND[j]:
            columns[:, 6] = scenario.logged(columns[:, 6], world.sample)
        columns *= world.scale ** np.array([*COLUMNS, *AIR])
        trials.append(
            Trial(f"{'B' if SECOND[j] else 'A'} {kind} {j}", dict(zip(NAMES, columns.T, strict=True)), kind=kind)
        )
    return trials


def _placed(effect: Effect, draw: Drawn, scenario: Scenario, rng: np.random.Generator) -> Drawn:
    """A draw that acts in a share of its size in each run."""
    share = scenario.where(rng)
    inside = {}
    for key, value in draw.inside.items():
        neutral = effect.neutral.get(key, 0.0)
        value = scenario.size if key == "share" and scenario.size is not None else value
        inside[key] = neutral + share * (np.asarray(value) - neutral)
    return replace(draw, inside=inside)


def compared(scenario: Scenario, seed: int, world: World) -> Between:
    """The answer to one draw."""
    trials, ship = trials_of(scenario, seed, world), blind_ship(world.ship)
    sensors = consistency(trials, ship)
    ready = prepare(with_sensor_faults(ship, sensors)[0], trials)
    groups = Groups("group", ("A", "B"), tuple(SECOND.astype(int).tolist()))
    return compare_groups(ready.problem, ready.null, sensors, groups, trials)


def answer(task: tuple[int, int, str, Path]) -> dict[str, Any]:
    """The answer to a draw: verdict, sentence, names, whether all are right, seconds; kept in a file of its own."""
    number, seed, world, folder = task
    path = folder / f"{number:02d}_{seed}.json"
    if not path.is_file():
        began = time.perf_counter()
        b = compared(SCENARIOS[number], seed, WORLDS[world])
        right = all({d.name, *d.equivalence_class} & SCENARIOS[number].right for d in b.differences)
        kept = {"scenario": number, "draw": seed, "verdict": b.verdict, "sentence": b.sentence, "right": right}
        kept |= {"names": [d.name for d in b.differences], "seconds": time.perf_counter() - began}
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def rows(answers: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """A row of the table per scenario."""
    out = []
    for i, s in enumerate(SCENARIOS):
        own = [a for a in answers if a["scenario"] == i]
        named = [a for a in own if a["verdict"] == "named"]
        wrong = [" + ".join(a["names"]) for a in named if not a["right"]]
        none, unknown = (sum(a["verdict"] == verdict for a in own) for verdict in ("none", "unknown"))
        listed = f"{len(wrong)} ({', '.join(sorted(set(wrong)))})" if wrong else "0"
        cells = [str(len(own)), str(none), str(unknown), str(len(named) - len(wrong)) if s.right else "", listed]
        out += [[s.words, *cells]] if own else []
    return out


def main() -> None:
    """Answers all draws and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.between", description="mmg diagnose --between.")
    parser.add_argument("--draws", type=int, default=10, help="of each difference")
    parser.add_argument("--nulls", type=int, default=30, help="draws where nothing differs")
    parser.add_argument("--world", default="basin", choices=("pond", "basin", "kvlcc2"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of scenarios")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder of the answers (default: runs/between_WORLD)")
    parser.add_argument("--record", action="store_true", help="put the table into RESULTS.md")
    given = parser.parse_args()
    out = given.out or Path("runs") / f"between_{given.world}"
    tasks = [
        (i, 1000 * given.seed + draw, given.world, out)
        for i, s in enumerate(SCENARIOS)
        if not given.only or i in given.only
        for draw in range(given.nulls if s.null else given.draws)
    ]

    def say(a: Mapping[str, Any]) -> None:
        print(f"{SCENARIOS[a['scenario']].words}, {a['draw']}: {a['sentence']} ({a['seconds']:.0f} s)", flush=True)

    answers = run_all(answer, tasks, given.workers, each=say)
    lines = table(["what differs", "draws", "none", "unknown", "named, and rightly", "wrong names"], rows(answers))
    lines += ["", f"Median {np.median([a['seconds'] for a in answers]):.0f} s of a draw."]
    if given.record:
        words = shlex.join(["python", "-m", "benchmarks.between", *(w for w in sys.argv[1:] if w != "--record")])
        record(f"Differences between groups of trials; world {given.world}", words, lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
