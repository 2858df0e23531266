"""Whether a named effect acts as the trials show: with one size in every run, phase and range of motion and inputs.

A stranger that looks like a known effect in the mean differs from it somewhere: a slow rudder is the later the more it
moves. At the fit with the effect its slopes are summed over parts of the trials; with one size for all they vanish in
each part but for chance (score test of heterogeneity).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.left_findings import Pattern
from diagnosis.location.situations import phases
from mmg.motion.flow import INPUTS

PARTS = 3
"""Parts, of about equal time, by the size of a variable."""
LEAST = 20
"""Grid times of a part that counts."""
LEVEL_OF_PATTERN = 0.002
"""Probability by chance below which something is left beside the name."""


def pattern(steps: TransitionModel, data: GriddedTrials, found: Estimate, effects: Sequence[Candidate]) -> Pattern:
    """Test the ``effects`` of the fit ``found`` of ``steps`` to ``data`` for one size in all parts.

    Returns the probability over all ways of parting the trials, and the way in which the parts differ most.
    """
    here = linearise_and_filter(steps, data, found)
    own = np.array([found.free.columns.index(c) for e in effects for c in e.columns])
    there = data.good.any(axis=2)
    white = here.white
    score = -np.einsum("krca,krc->kra", white[..., own], white[..., -1])
    score -= here.logdet_gradient[:, own] * np.where(there, 1.0 / np.maximum(there.sum(axis=0), 1), 0.0)[..., None]
    flat = white[..., :-1].reshape(-1, white.shape[-1] - 1)
    A = flat.T @ flat + np.eye(flat.shape[1])
    chances: dict[str, float] = {}
    for name, part in _parts(steps, data, found).items():
        groups = [g for g in range(int(part.max()) + 1) if (there & (part == g)).sum() >= LEAST]
        if len(groups) < 2:
            continue
        sums, cross, blocks = [], [], []
        for g in groups:
            inside = there & (part == g)
            columns = white[inside][..., :-1].reshape(-1, flat.shape[1])
            sums.append(score[inside].sum(axis=0))
            cross.append(columns[:, own].T @ columns)
            blocks.append(cross[-1][:, own])
        s, C = np.concatenate(sums), np.concatenate(cross)
        V = -C @ np.linalg.solve(A, C.T)
        q = len(own)
        for i, block in enumerate(blocks):
            V[i * q : (i + 1) * q, i * q : (i + 1) * q] += block
        values, vectors = np.linalg.eigh(0.5 * (V + V.T))
        kept = values > 0.02 * max(values.max(), 1e-300)
        T = float((((s @ vectors)[kept]) ** 2 / values[kept]).sum())
        chances[name] = float(chi2.sf(T, max(int(kept.sum()), 1)))
    if not chances:
        return Pattern(1.0, "")
    worst = min(chances, key=chances.__getitem__)
    return Pattern(min(1.0, len(chances) * chances[worst]), worst)


def _parts(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> dict[str, np.ndarray]:
    """Ways to part the grid times: (K + 1, R) number of the part of each, -1: none."""
    z, names = found.path.z, list(steps.model.controls)
    inside = data.inside
    inputs = np.concatenate([data.inputs, data.inputs[-1:]])
    runs = np.broadcast_to(data.run, data.good.shape[:2])
    phase = np.full(data.good.shape[:2], -1)
    phase[:-1][inside] = phases(names, data, z, float(steps.ship.particulars["L"]))
    variables = {"u": z[..., 3], "|v|": np.abs(z[..., 4]), "|r|": np.abs(z[..., 5]), "r": z[..., 5], "v": z[..., 4]}
    for name in (n for n in names if n in INPUTS):
        x = inputs[..., names.index(name)]
        variables |= {name: x, f"|{name}|": np.abs(x)}
        if data.changes is not None:
            change = np.concatenate([data.changes, data.changes[-1:]])[..., names.index(name)]
            variables[f"rate of {name}"] = np.abs(change)
    variables["time since the start"] = data.t
    quadrant = np.floor(z[..., 2] / (np.pi / 2)).astype(int) % 4
    found_parts = {"run": runs, "phase": phase, "heading": quadrant}
    for name, x in variables.items():
        edges = np.unique(np.quantile(x[:-1][inside], np.linspace(0, 1, PARTS + 1)[1:-1]))
        found_parts[name] = np.digitize(x, edges)
    return found_parts
