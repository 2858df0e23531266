"""What a diagnosis says: the data type that the report and ``diagnosis.json`` (contract) are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from diagnosis.estimation.gridded_trials import Data
from diagnosis.estimation.map_estimate import Estimate
from mmg.ship import Ship


@dataclass(frozen=True)
class Parameter:
    """Estimate of an effect's parameter: value, standard error, unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Named:
    """An effect that the data name.

    p_value: of its test among all candidates; delta_bic: what it gains over the model without it (positive is better);
    absorbed_share: of its information that the coefficients could have imitated; by_run: run -> parameter -> value, if
    it differs from run to run (parameters: the mean).
    """

    name: str
    parameters: Mapping[str, Parameter]
    p_value: float
    delta_bic: float
    absorbed_share: float
    by_run: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Screened:
    """A row of the ranking: score (chi-squared of the test at the calibrated model), p_value (of the largest of all),
    delta_bic (None: not refitted), excited (the trials move it at all), parameters if refitted; visible_from: parameter
    -> size (off neutral) of three standard errors, from which these trials would show it."""

    name: str
    score: float
    p_value: float
    delta_bic: float | None
    excited: bool
    absorbed_share: float
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    visible_from: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class HeldOut:
    """Prediction error of trials that took no part, before and after the effects are added and all is refitted.

    mse_before, mse_after: mean squared error of 30 s windows, each state in units of its scale; reduction: share;
    interval_90: of the reduction, by drawing runs again; windows: their number; by_run: name -> (before, after).
    likelihood_gain: of the trials' log likelihood by one-step predictions, and its 90 % interval (None: not known).
    horizons: name ("1 step", "30 s", "whole run") -> (before, after).
    """

    mse_before: float
    mse_after: float
    reduction: float
    interval_90: tuple[float, float]
    windows: int
    by_run: Mapping[str, tuple[float, float]]
    likelihood_gain: float | None = None
    likelihood_interval_90: tuple[float, float] | None = None
    horizons: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Learned:
    """How much of the prediction error of the test trials a learned residual closes, beyond what was named.

    The measure and the windows are those of ``HeldOut``; before is the ship as the diagnosis left it. mse_after,
    reduction: means over the trainings, of which each has its seed in ``seeds`` and its own reduction in
    ``reductions``; spread: their standard deviation; together: reduction with the mean of the networks, which is what
    ``mmg train`` would keep; interval_90: of the reduction, by drawing test runs again (None: a single run).
    kept: what ``mmg train`` would decide from parts of the training trials alone; decision: that in words.
    """

    mse_before: float
    mse_after: float
    reduction: float
    interval_90: tuple[float, float] | None
    seeds: tuple[int, ...]
    reductions: tuple[float, ...]
    spread: float
    together: float
    windows: int
    kept: bool
    decision: str
    sentence: str


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    verdict: "none", "named" or "unknown"; sentence: it in words. ship: the diagnosed ship as given; before, after:
    ships refitted by the diagnosis without and with the named effects (the same for "none"). null, final: the fits
    behind them; data: the training trials as arranged. unnamed_before, unnamed_after: log Bayes factors of the
    dictionary of effects without a name, by kind ("all" is the whole). where: as in diagnosis.json, plus what figures
    need. kinematics: sentences of measurement faults that need no dynamics. learned: how much a residual closes of what
    has no name (None: not measured).
    """

    verdict: str
    sentence: str
    effects: tuple[Named, ...]
    equivalence_class: tuple[str, ...]
    remainder: bool
    candidates: tuple[Screened, ...]
    where: Mapping[str, Any]
    held_out: HeldOut | None
    next_test: str
    warnings: tuple[str, ...]
    left_out: Mapping[str, str]
    ship: Ship
    before: Ship
    after: Ship
    null: Estimate
    final: Estimate
    data: Data
    states: tuple[str, ...]
    unnamed_before: Mapping[str, float]
    unnamed_after: Mapping[str, float]
    kinematics: tuple[str, ...] = ()
    timings: Mapping[str, float] = field(default_factory=dict)
    learned: Learned | None = None


def contract(d: Diagnosis) -> dict[str, Any]:
    """``diagnosis.json``, key by key as the contract has it, with more keys behind them."""

    def values(parameters: Mapping[str, Parameter]) -> dict[str, Any]:
        return {k: {"value": p.value, "std": p.std, "unit": p.unit} for k, p in parameters.items()}

    held: dict[str, Any] | None = None
    if d.held_out is not None:
        h = d.held_out
        held = {
            "mse_before": h.mse_before,
            "mse_after": h.mse_after,
            "reduction": h.reduction,
            "interval_90": list(h.interval_90),
            "windows": h.windows,
            "by_run": {k: {"before": a, "after": b} for k, (a, b) in h.by_run.items()},
            "horizons": {k: {"before": a, "after": b} for k, (a, b) in h.horizons.items()},
            "likelihood_gain": h.likelihood_gain,
            "likelihood_interval_90": list(h.likelihood_interval_90) if h.likelihood_interval_90 else None,
        }
    return {
        "verdict": d.verdict,
        "effects": [
            {
                "name": e.name,
                "parameters": values(e.parameters),
                "p_value": e.p_value,
                "delta_bic": e.delta_bic,
                "absorbed_share": e.absorbed_share,
            }
            | ({"by_run": {k: dict(v) for k, v in e.by_run.items()}} if e.by_run else {})
            for e in d.effects
        ],
        "equivalence_class": list(d.equivalence_class),
        "remainder": d.remainder,
        "candidates": [
            {
                "name": c.name,
                "score": c.score,
                "p_value": c.p_value,
                "delta_bic": c.delta_bic,
                "excited": c.excited,
                "absorbed_share": c.absorbed_share,
                "parameters": values(c.parameters),
                "visible_from": dict(c.visible_from),
            }
            for c in d.candidates
        ],
        "where": {k: d.where[k] for k in ("channels", "phases", "regions", "bands") if k in d.where}
        | {k: d.where[k] for k in ("runs", "earth", "variables") if k in d.where},
        "held_out": held,
        "next_test": d.next_test,
        "warnings": list(d.warnings),
        "sentence": d.sentence,
        "kinematics": list(d.kinematics),
        "not_screened": dict(d.left_out),
        "unnamed": {"before": dict(d.unnamed_before), "after": dict(d.unnamed_after)},
        "noise": {
            "force_N_N_Nm": np.asarray(d.null.noise.force).tolist(),
            "force_memory_s": d.null.noise.tau,
            "white": np.asarray(d.null.noise.white).tolist(),
            "coloured": np.asarray(d.null.noise.coloured).tolist(),
        },
        "learned": asdict(d.learned) if d.learned is not None else None,
        "timings": dict(d.timings),
    }
