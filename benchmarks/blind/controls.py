"""What a score is worth: names by chance, answers against other cases' keys, a screening without the latent force.

Also the error of the true model, measured as the diagnosis measures.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.blind.rows import MISFIT, Row, opened, top1
from benchmarks.blind.score import rate
from benchmarks.blind.solve import blind_ship, cases_of, ship_of
from cases.io.read import read_trials
from cases.io.site import read_site
from diagnosis.estimation.candidates import FullModel, ship_with_all_effects
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials, possible_readings
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.residual_checks import residuals
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.score_test import score_tests, slopes
from diagnosis.prepare import priors_before
from diagnosis.validation.held_out import WINDOW, errors
from fitting.parallel import run_all

DEALS = 2000
"""Permutations of the truths."""
WHITE_CASES = 20
"""Cases that the control without the latent force looks at."""
TINY = 1e-3
"""Size of the latent force there, in the sizes the diagnosis starts from."""
ROUNDS = 3
"""Fits there, between which the white errors are fitted to what is left."""


def by_chance(rows: Sequence[Row]) -> float:
    """Expected rate of a right first name if the candidates of each library case were drawn by lot."""
    chances = [
        sum(c["name"] in r.truth for c in r.ranking) / max(len(r.ranking), 1) for r in rows if r.kind == "library"
    ]
    return float(np.mean(chances)) if chances else float("nan")


def shuffled(rows: Sequence[Row], seed: int = 0) -> tuple[float, float]:
    """Rate of right first candidates, mean and 95th percentile, if truths are dealt to the library cases anew."""
    library = [r for r in rows if r.kind == "library"]
    if not library:
        return float("nan"), float("nan")
    hits = np.array([[top1(replace(r, truth=other.truth)) for other in library] for r in library])
    rng, n = np.random.default_rng(seed), len(library)
    rates = [hits[np.arange(n), rng.permutation(n)].mean() for _ in range(DEALS)]
    return float(np.mean(rates)), float(np.quantile(rates, 0.95))


def report(rows: Sequence[Row], white: Mapping[str, Sequence[str]] | None = None) -> list[str]:
    """The controls in words; white: rankings without the latent force, by case."""
    if not any(r.kind == "library" for r in rows):
        return []
    mean, most = shuffled(rows)
    lines = [
        f"Controls (top-1 of library cases): names by lot {100 * by_chance(rows):.1f} %; the same answers against keys "
        f"dealt anew {100 * mean:.1f} % (95 % of the deals below {100 * most:.1f} %)."
    ]
    if white:
        some = [r for r in rows if r.kind == "library" and r.case in white]
        other = [replace(r, answer={**r.answer, "candidates": [{"name": n} for n in white[r.case]]}) for r in some]
        lines.append(
            f"Score test without the latent force (errors white, {len(some)} library cases): "
            f"{rate('', other, lambda r: r.ranking[0]['name'] in r.truth)[-1]}; the diagnosis on the same cases: "
            f"{rate('', some, top1)[-1]}."
        )
    return lines


# The true model, measured as the diagnosis measures


def own_floors(folder: Path, digest: str, workers: int = 1) -> dict[str, float]:
    """Held-out error, as the diagnosis measures it, of the package's own model with the true coefficients and effects.

    Only where the library holds the truth. To be called when all cases are solved; Refused if the key was changed.
    """
    tasks = []
    for entry in opened(folder, digest)["cases"]:
        if entry["kind"] in ("foreign", MISFIT):
            continue
        sealed = json.loads((folder / "sealed" / f"{entry['case']}.json").read_text(encoding="utf-8"))
        values = dict(sealed["nominal_true_coefficients"])
        values |= {f"{e['name']}.{s}": v for e in entry["effects"] for s, v in e["parameters"].items()}
        tasks.append((folder / entry["case"], values))
    floors = run_all(own_floor, tasks, workers)
    return {case.name: floor for (case, _), floor in zip(tasks, floors, strict=True)}


def own_floor(task: tuple[Path, dict[str, float]]) -> float:
    """The same of one case: its folder and the true values by symbol."""
    case, true = task
    full, _, steps, data = _prepared(case)
    length = float(full.ship.particulars["L"])
    tests = grid_trials(read_trials(case / "test"), full.ship.inputs, length, data.h, data.straight)
    theta = full.ship.values.copy()
    unknown = [s for s in true if s not in full.ship.symbols]
    if unknown:
        raise KeyError(f"{case.name}: the package's model has no {', '.join(unknown)}")
    for symbol, value in true.items():
        theta[full.ship.symbols.index(symbol)] = value
    return float(errors(steps, tests, theta, WINDOW)[0].mean())


def _prepared(case: Path) -> tuple[FullModel, Priors, TransitionModel, GriddedTrials]:
    """The ship with all effects, the priors, the steps and the training data of a case, as the diagnosis makes them."""
    ship, trials = blind_ship(ship_of(case)), read_trials(case / "train")
    full = ship_with_all_effects(ship, trials, {k: dict(v) for k, v in read_site([case], ship).held.items()})
    base = priors_before(ship)
    data = grid_trials(trials, full.ship.inputs, float(ship.particulars["L"]), None, possible_readings(trials)[-1])
    return full, base, TransitionModel(full.ship, [*base.symbols, *full.symbols], data.h), data


# The score test without the latent force


def white_rankings(folder: Path, workers: int = 1) -> dict[str, list[str]]:
    """Names ranked by the score test, by case, of the first cases; reads no key."""
    cases = cases_of(folder)[:WHITE_CASES]
    return dict(zip((c.name for c in cases), run_all(white_ranking, cases, workers), strict=True))


def white_ranking(case: Path) -> list[str]:
    """All candidates, the most telling first, where every residual is taken for white errors of the sensors."""
    full, base, steps, data = _prepared(case)
    noise = initial_noise(full.ship)
    noise = noise.with_(force=TINY * noise.force)
    start = initial_point(steps, data, full.ship.values, base, noise)
    found = estimate(steps, data, start, fixed_noise=True)
    for _ in range(ROUNDS - 1):
        noise = noise.with_(white=noise.white * _spread(steps, data, found))
        found = estimate(steps, data, replace(found, noise=noise), fixed_noise=True)
    return [row.candidate.label for row in score_tests(slopes(steps, data, found, full.candidates), full.candidates)]


def _spread(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> np.ndarray:
    """Root mean square of the whitened residuals by channel (6,)."""
    white = residuals(steps, data, found)
    count = np.maximum(data.good.sum(axis=(0, 1)), 1)
    return np.sqrt((white**2).sum(axis=(0, 1)) / count)
