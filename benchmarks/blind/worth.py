"""What a hidden cause is worth to who knows it: python -m benchmarks.blind.worth FOLDER [KIND ...].

For answered cases of ``python -m benchmarks.blind --out FOLDER``: the cause acts once more in the generator's own ship,
along the path that she took, and its response is put beside the fit without effects. Its length in whitened residuals
is the number of standard errors that its size would be off zero if its form were known; beside the free coefficients it
is less. What is worth little there no diagnosis can find; what is worth much and not found is missing in the unnamed
forms. This opens the key, so nothing may be sealed with the same seed afterwards.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.blind.generator import cases as generator
from benchmarks.blind.generator.cases import Case, Runs, measured
from benchmarks.blind.generator.deal import deal
from benchmarks.blind.generator.plant import Signals, step
from benchmarks.blind.generator.world import COLUMNS, WORLDS
from benchmarks.blind.solve import blind_ship
from cases.evidence.kinematics import consistency
from cases.io.read import read_trials
from cases.io.site import read_site
from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.parameters import active_states
from diagnosis.hypotheses.projection import projected
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.prepare import Prepared, prepare, with_sensor_faults

Array = np.ndarray


def acted(case: Case) -> tuple[Array, Array]:
    """What the hidden cause added to the six states over each step of the plant (K, 6, B), and to the logged columns
    (R, 6, B), of the runs of a case."""
    helms = []
    closed_loop = generator.closed_loop

    def steered(plant: object, start: Array, signals: Signals, helm: object) -> Array:
        helms.append(helm)
        return closed_loop(plant, start, signals, helm)  # type: ignore[arg-type]

    with mock.patch.object(generator, "closed_loop", steered):
        runs: Runs = generator.run([case])
    (helm,), world = helms, case.world
    bare = runs.plant.take(np.arange(runs.plant.runs), False)
    twin = {"port": helm.port} if runs.plant.twin else {}
    signals = replace(runs.signals, n=helm.n, delta=helm.delta, bow=helm.bow, **twin)
    states, zero = runs.states, np.zeros(runs.plant.runs)
    pushed = [
        states[k + 1, :6] - step(bare, states[k, :6], signals, k, zero + k * world.step) for k in range(len(states) - 1)
    ]
    rows = np.arange(0, world.rows, world.every)
    return np.array(pushed), measured(runs.plant, states, rows) - measured(bare, states[:, :6], rows)


def on_grid(case: Case, data: GriddedTrials, active: Array) -> tuple[Array, Array]:
    """The same as columns of a linearisation: (K, R, A, 1) of the active states, (K + 1, R, 6, 1) of the logs."""
    pushed, logged = acted(case)
    world, power = case.world, np.array(COLUMNS)
    scale, slower = world.scale ** power[1:7], world.scale ** power[0]
    whole = np.concatenate([np.zeros((1, *pushed.shape[1:])), np.cumsum(pushed, axis=0)])
    t = np.arange(len(whole)) * world.step * slower
    rows = np.arange(len(logged)) * world.sample * slower
    names = [f"{kind}_{j:02d}" for j, kind in enumerate(case.kinds)]
    forcing = np.zeros((*data.inputs.shape[:2], len(active), 1))
    observed = np.zeros((*data.good.shape, 1))
    for r, run in enumerate(data.run):
        j = names.index(data.trials[run])
        for c in range(6):
            place = np.flatnonzero(active == c)
            forcing[:, r, place, 0] = np.diff(np.interp(data.t[:, r], t, whole[:, c, j] * scale[c]))[:, None]
            observed[:, r, c, 0] = np.interp(data.t[:, r], rows, logged[:, c, j] * scale[c])
    return forcing, observed


def worth(case: Case, ready: Prepared) -> tuple[float, float]:
    """Standard errors that the hidden cause of a case is off zero by itself, and beside the free coefficients."""
    steps, data, null = ready.problem.steps, ready.problem.data, ready.null
    active = active_states(steps, null.free.symbols, null.theta)
    columns = on_grid(case, data, active)
    at = linearise_and_filter(steps, data, null, active, lambda _: [DrivenColumns.dense(*columns)])
    flat, P = at.white.reshape(-1, at.white.shape[3]), len(null.p)
    gram = flat.T @ flat
    rest = projected(gram, np.append(at.logdet_gradient.sum(axis=0)[:P], 0.0), null.p)
    return float(np.sqrt(gram[P, P])), float(np.sqrt(rest.S[0, 0]))


def rows_of(folder: Path, kind: str) -> list[str]:
    """A line on each case of a kind (a folder of ``folder / "cases"``)."""
    cases = folder / "cases" / kind
    key = json.loads((cases / "key.json").read_text(encoding="utf-8"))
    world, count = WORLDS[key["world"]], len(key["cases"])
    dealer, *seeds = np.random.SeedSequence(key["seed"]).spawn(count + 1)
    hands, rows = deal(key["kind"], count, np.random.default_rng(dealer), world.without), []
    for i, entry in enumerate(key["cases"]):
        case = Case.prepared(hands[i], key["set"], seeds[i], world)
        place, ship = cases / entry["case"], blind_ship(key["ship"])
        trials = read_trials(place / "train")
        ready = prepare(with_sensor_faults(ship, consistency(trials, ship))[0], trials, read_site([place], ship))
        alone, beside = worth(case, ready)
        left = unnamed_forms(ready.problem.steps, ready.problem.data, ready.null)
        answer = json.loads((folder / "answers" / kind / f"{entry['case']}.json").read_text(encoding="utf-8"))
        said = answer["verdict"] + (" + remainder" if answer.get("remainder") else "")
        said += "".join(f", {e['name']}" for e in answer.get("effects", []))
        what = ", ".join(f"{e['name']} ({e['strength']})" for e in entry["effects"]) or "nothing"
        best = max(left.by_kind, key=left.by_kind.__getitem__)
        rows.append(
            f"| {i} | {what} | {alone:.1f} | {beside:.1f} | {left.p_value_here:.4f} | {best} "
            f"({left.by_kind[best]:.1f}) | {said} |"
        )
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.worth", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("kinds", nargs="*", help="folders of cases (default: all)")
    given = parser.parse_args()
    print("| case | hidden | worth alone | beside the coefficients | chance leaves as much | most like | answer |")
    print("|---|---|---|---|---|---|---|")
    for kind in given.kinds or sorted(p.name for p in (given.folder / "cases").iterdir() if p.is_dir()):
        rows_of(given.folder, kind)


if __name__ == "__main__":
    main()
