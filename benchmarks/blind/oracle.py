"""What could be seen of hidden effects by somebody who knows them: the bound of every diagnosis.

Run from the repository root on a benchmark that is answered:
python -m benchmarks.blind.oracle runs/blind_1 [--strength weak].

The missing force of each case is known to the last digit here: what the plant does with its effects less what it does
without them, at the true states and from the logged actuators. The score of the likelihood along this one column, at
the fit without effects and with all free coefficients projected out, is z standard deviations from nothing. Where z is
small, chance explains the trials as well, and no test could tell, unless much was expected: a large force is taken for
a random one by the fit without effects, and a refit shows more. Effects of instruments push nothing and have no z.
Only cases of ships in the length of the generator (basin, pond, vectwin) are looked at.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.generator.cases import Case, Runs, as_logged, run
from benchmarks.blind.generator.deal import deal
from benchmarks.blind.generator.plant import rates
from benchmarks.blind.generator.world import WORLDS, World
from benchmarks.blind.solve import blind_ship, ship_of
from cases.io.read import read_trials
from cases.io.site import read_site
from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.input_timing import timing_columns
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.parameters import active_states
from diagnosis.hypotheses.projection import projected
from diagnosis.prepare import prepare

VELOCITIES = slice(3, 6)
LEAST = 0.5
"""Expected z below which an effect pushes next to nothing: that of an instrument."""


@dataclass(frozen=True)
class Visible:
    """A case and its hidden effect: z of the score along the force that is missing, what z would be if the fit without
    effects were right but for it (expected), and before the free coefficients took up what they can (before)."""

    case: str
    effect: str
    strength: str
    z: float
    expected: float
    before: float
    verdict: str
    named: tuple[str, ...]

    @property
    def row(self) -> str:
        """A row of the table."""
        z = f"{self.z:.1f}" if self.expected > LEAST else "-"
        cells = [self.case, self.effect, self.strength, z, f"{self.expected:.1f}", f"{self.before:.1f}", self.verdict]
        return f"| {' | '.join([*cells, ', '.join(self.named)])} |"


def missing_rates(runs: Runs, world: World) -> np.ndarray:
    """What the effects add to the accelerations u', v', r' (K, 3, B) of ``runs`` in a ``world``, at the true states."""
    plant, nothing = runs.plant, np.zeros((3, runs.plant.runs))
    bare, logged = plant.take(np.arange(plant.runs), with_effects=False), as_logged(runs, world)
    found = np.empty((len(runs.states), 3, plant.runs))
    for k, state in enumerate(runs.states):
        t = np.full(plant.runs, k * plant.dt)
        whole = rates(plant, state, runs.signals.inputs(k), nothing, t)
        found[k] = whole[VELOCITIES] - rates(bare, state[:6], logged.inputs(k), nothing, t)[VELOCITIES]
    return found


def score_along(case: Path, missing: np.ndarray, step: float) -> tuple[float, float, float]:
    """z, expected and before, as of ``Visible``, of the trials of a ``case``.

    missing: accelerations u', v', r' (K, 3, runs) that its effects add, in steps of ``step`` [s].
    """
    ship = blind_ship(ship_of(case))
    trials = read_trials(case / "train")
    prepared = prepare(ship, trials, read_site([case], ship))
    steps, data, null = prepared.problem.steps, prepared.problem.data, prepared.null
    column = np.array([int(trial.name.rpartition("_")[2]) for trial in trials])[data.run]
    summed = np.concatenate([np.zeros((1, *missing.shape[1:])), np.cumsum(missing[1:] + missing[:-1], axis=0)])
    clock, push = step * np.arange(len(missing)), np.zeros((*data.inputs.shape[:2], 6, 1))
    for r, run_ in enumerate(column):
        for j in range(3):
            push[:, r, 3 + j, 0] = np.diff(np.interp(data.t[:, r], clock, 0.5 * step * summed[:, j, run_]))
    push *= data.inside[:, :, None, None]
    active = active_states(steps, null.free.symbols, null.theta)
    timing = timing_columns(steps, data, null, active)
    extra = [DrivenColumns.pushing(timing), DrivenColumns.pushing(push)]
    linearised = linearise_and_filter(steps, data, null, active, lambda linear: list(extra), is_brief=True)
    p = np.concatenate([null.p, np.zeros(timing.shape[3])])
    white = linearised.white.reshape(-1, linearised.white.shape[3])
    gram = white.T @ white
    rest = projected(gram, np.append(linearised.logdet_gradient.sum(axis=0)[: len(p)], 0.0), p)
    expected = float(np.sqrt(rest.S[0, 0]))
    return float(rest.g[0]) / max(expected, 1e-12), expected, float(np.sqrt(gram[len(p), len(p)]))


def visible(out: Path, name: str, strength: str = "") -> Iterator[Visible]:
    """The cases of the part ``name`` of the answered benchmark ``out`` and how visible they are.

    strength: of the effects that are looked at, "" for all.
    """
    made = json.loads((out / "made.json").read_text(encoding="utf-8"))[name]
    key = json.loads((out / "cases" / name / "key.json").read_text(encoding="utf-8"))
    world, count = WORLDS[made["world"]], int(made["cases"])
    dealer, *seeds = np.random.SeedSequence(made["seed"]).spawn(count + 1)
    hands = deal(key["kind"], count, np.random.default_rng(dealer), world.without)
    cases = [Case.prepared(hand, key["set"], seed, world) for hand, seed in zip(hands, seeds, strict=True)]
    missing, each = missing_rates(run(cases), world), len(cases[0].kinds)
    for i, entry in enumerate(key["cases"]):
        answer: dict[str, Any] = json.loads(
            (out / "answers" / name / f"{entry['case']}.json").read_text(encoding="utf-8")
        )
        for effect in entry["effects"][:1]:
            if strength in ("", effect["strength"]):
                own = missing[:, :, i * each : (i + 1) * each]
                numbers = score_along(out / "cases" / name / entry["case"], own, world.step)
                named = tuple(e["name"] for e in answer.get("effects", []))
                verdict = str(answer.get("verdict", "failed"))
                yield Visible(entry["case"], effect["name"], effect["strength"], *numbers, verdict, named)


def main(arguments: list[str] | None = None) -> int:
    """Prints the tables of all parts; 2 for worlds whose ships are scaled."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.oracle", description=__doc__)
    parser.add_argument("out", type=Path, help="folder of the benchmark, with its answers")
    parser.add_argument("--strength", default="", help="weak, medium or strong; default all")
    given = parser.parse_args(arguments)
    for name, made in json.loads((given.out / "made.json").read_text(encoding="utf-8")).items():
        if WORLDS[made["world"]].scale != 1 or WORLDS[made["world"]].wide:
            print(f"{name}: the ships of the world {made['world']} are not in the generator's length", file=sys.stderr)
            return 2
        print(f"{name}, seed {made['seed']}, world {made['world']}\n")
        print(
            "| case | effect | strength | z | expected | before | verdict | named |\n|---|---|---|---|---|---|---|---|"
        )
        for found in visible(given.out, name, given.strength):
            print(found.row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
