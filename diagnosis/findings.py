"""What a diagnosis found, as data: the figures, the report and ``diagnosis.json`` are made from this alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from cases.io.campaigns import Groups
from cases.trial import Trial
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from fitting.report.run_folder import SCHEMA_VERSION, Real, plain
from fitting.uncertainty.group_test import GroupTest
from mmg.messages import message_rows
from mmg.ship import Ship


@dataclass(frozen=True)
class GroupValue:
    """A parameter in one group of trials, with its standard error; difference: from the mean of the other groups, which
    is known better than the value where all groups share an error."""

    value: Real
    std: Real
    difference: Real
    difference_std: Real


@dataclass(frozen=True)
class GroupParameter:
    """A parameter that may differ between groups: its unit, what it is in words, and its value in each group."""

    unit: str
    words: str
    groups: Mapping[str, GroupValue]


@dataclass(frozen=True)
class GroupDifference:
    """An effect, an instrument or a coefficient, tested for different values in groups of trials.

    nature: "instrument", "surroundings" or "ship"; source: "kinematics" (without a model) or "dynamics"; group: the one
    that differs most from the others; statistic: chi-squared with ``degrees``; p_value: corrected for the number of
    tests; log_bayes: log Bayes factor for different values; equivalence_class: what imitates it in these trials.
    """

    name: str
    nature: str
    source: str
    group: str
    parameters: Mapping[str, GroupParameter]
    statistic: Real
    degrees: int
    p_value: Real
    log_bayes: Real
    equivalence_class: tuple[str, ...] = ()


@dataclass(frozen=True)
class Between:
    """Differences between groups of trials.

    by: what the trials of a group have in common; groups: name -> its trials; verdict: "none", "named" or "unknown", in
    words ``sentence``; differences: those named; candidates: all tested, strongest first; remainder: the groups differ
    in something else as well; warnings: what cannot be concluded.
    """

    by: str
    groups: Mapping[str, tuple[str, ...]]
    verdict: str
    sentence: str
    differences: tuple[GroupDifference, ...]
    candidates: tuple[GroupDifference, ...]
    remainder: bool
    warnings: tuple[str, ...] = ()


def parameters_by_group(
    groups: Groups, words: Mapping[str, tuple[str, str]], values: np.ndarray, covariance: np.ndarray
) -> dict[str, GroupParameter]:
    """Parameters in each of G ``groups``.

    words: name -> unit and meaning of p parameters; values: (G p,) and covariance: (G p, G p) of their values, those of
    a group together. Returns them by name.
    """
    p, G = len(words), len(groups.names)
    out = {}
    for j, (name, (unit, meaning)) in enumerate(words.items()):
        own, C = values[j::p], covariance[j::p, j::p]
        weights = (np.eye(G) * G - 1.0) / (G - 1)
        rows = zip(own, np.diag(C), weights @ own, np.einsum("ga,ab,gb->g", weights, C, weights), strict=True)
        each = (GroupValue(float(v), float(c**0.5), float(d), float(max(e, 0.0) ** 0.5)) for v, c, d, e in rows)
        out[name] = GroupParameter(unit, meaning, dict(zip(groups.names, each, strict=True)))
    return out


def group_row(
    name: str, nature: str, source: str, parts: Mapping[str, GroupParameter], test: GroupTest, p: float
) -> GroupDifference:
    """A row of the result: the group that differs most, the last of several, and what the ``test`` says.

    name, nature, source: as of the row; parts: its parameters; p: probability corrected for the number of tests.
    """
    groups = [p.groups for p in parts.values()]
    sigmas = {k: max(abs(g[k].difference) / max(g[k].difference_std, 1e-300) for g in groups) for k in groups[0]}
    most = max(list(sigmas)[::-1], key=lambda k: round(sigmas[k], 6))
    return GroupDifference(name, nature, source, most, parts, test.statistic, test.degrees, p, test.log_bayes)


TESTS, LEFT_OUT = "test trials", "left-out runs"  # What a budget is made of
# Share of the avoidable error below which a further effect is not named, and nothing is called a remainder. Set by
# hand; without it no answer to 400 open cases changes (row ``matters`` of benchmarks/ablation.md).
MATTERS = 0.05


@dataclass(frozen=True)
class MissingForce:
    """The force that the model of a diagnosis lacks along one trial.

    t: (M,) since the start of the trial [s]; force: (M, 3) in body axes, X, Y [N], N [N m].
    """

    t: np.ndarray
    force: np.ndarray


@dataclass(frozen=True)
class BudgetShare:
    """A part of the error that could be avoided: its share with the 90 % interval."""

    name: str
    share: Real
    interval_90: tuple[Real, Real]

    @property
    def matters(self) -> bool:
        """Whether it may be more than MATTERS."""
        return self.interval_90[1] > MATTERS


@dataclass(frozen=True)
class Budget:
    """Where the prediction error of trials that took no part comes from.

    metric: what is predicted; by: those trials, TESTS or LEFT_OUT; before, after, floor: mean squared
    scaled errors as fitted without any effect, with the named ones, and of a complete model; parts: shares of
    before - floor by named effect; unexplained: the rest, None where before is not surely above the floor; units:
    "position_m", "heading_deg" -> root mean square errors at the ends of the windows before, after, at the floor;
    as_given: the same units and "error" of a ship that was not calibrated on these trials, before she is fitted;
    floor_by_after: 90 % interval of floor / after.
    """

    metric: str
    by: str
    before: Real
    after: Real
    floor: Real
    parts: tuple[BudgetShare, ...]
    unexplained: BudgetShare | None
    units: Mapping[str, tuple[Real, Real, Real]]
    as_given: Mapping[str, Real] | None = None
    floor_by_after: tuple[Real, Real] = (1.0, 1.0)

    @property
    def matters(self) -> bool:
        """Whether what is unexplained may be more than MATTERS, as far as is known."""
        return self.unexplained is None or self.unexplained.matters


@dataclass(frozen=True)
class UnexplainedChannel:
    """A channel of the unexplained force: rms with its 90 % interval, mean, and share of the energy of all channels."""

    force_rms: Real
    interval_90: tuple[Real, Real]
    mean: Real
    unit: str
    share: Real


@dataclass(frozen=True)
class UnexplainedTime:
    """A stretch of a trial in which the unexplained force is largest, in the channel that stands out most there.

    start, end: since the begin of the trial [s]; force_rms, mean: in the ``unit`` of the channel.
    """

    trial: str
    start: Real
    end: Real
    channel: str
    force_rms: Real
    mean: Real
    unit: str


@dataclass(frozen=True)
class UnexplainedForce:
    """What is left unexplained, as one force that depends on motion, inputs, wind and place in an unnamed way.

    evidence: for it, in log units; follows: rows variable, channel, explained (share of the channel's
    mean square), at, mean, the best first, of the force less its mean; times: where it is largest; advice: the
    manoeuvre that would tell more. force, std: (K, R, 3) [N, N, N m] and standard deviation, None after reading.
    """

    channels: Mapping[str, UnexplainedChannel]
    follows: tuple[Mapping[str, Any], ...]
    times: tuple[UnexplainedTime, ...]
    advice: str
    evidence: Real = 0.0
    force: Any = None
    std: Any = None

    def to_dict(self) -> dict[str, Any]:
        """The part "unexplained_force" of ``diagnosis.json``."""
        return {name: value for name, value in vars(self).items() if name not in ("force", "std")}


# A number before and after the named effects were added; JSON names them.
Pair = Annotated[
    tuple[Real, Real], BeforeValidator(lambda v: (v.get("before"), v.get("after")) if isinstance(v, dict) else v)
]


@dataclass(frozen=True)
class EstimatedParameter:
    """Estimate of an effect's parameter: value, standard error, unit.

    std: of a candidate or a named effect with the uncertainty of its formula (``Effect.form_error``)."""

    value: Real
    std: Real
    unit: str


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the data name.

    p_value: of its test among all candidates; delta_bic: gain over the model without it (positive is better);
    absorbed_share: of its information that coefficients could have imitated; evidence: by all trials [log units].
    """

    name: str
    parameters: Mapping[str, EstimatedParameter]
    p_value: Real
    delta_bic: Real
    absorbed_share: Real
    evidence: Real = 0.0


@dataclass(frozen=True)
class InstrumentFault:
    """A fault of an instrument that was fitted with the model of the sensors; it is no effect of the ship.

    p_value: by the standard errors of its parameters.
    """

    name: str
    parameters: Mapping[str, EstimatedParameter]
    p_value: Real

    @property
    def sentence(self) -> str:
        """Name and estimates in words."""
        sizes = (f"{k} = {p.value:.3g} ± {p.std:.2g} {p.unit}".rstrip() for k, p in self.parameters.items() if p.std)
        return f"fitted with the model of the sensors: {self.name}, {', '.join(sizes)}"


@dataclass(frozen=True)
class RankedCandidate:
    """A row of the ranking.

    score: chi-squared of the test at the fit without effects; p_value: of the largest of all; delta_bic, evidence: None
    if not refitted; excited: whether the trials move it at all; parameters: if refitted; visible_from: parameter ->
    size (off neutral) of three standard errors, from which these trials would show it.
    """

    name: str
    score: Real
    p_value: Real
    delta_bic: float | None
    excited: bool
    absorbed_share: Real
    parameters: Mapping[str, EstimatedParameter] = field(default_factory=dict)
    visible_from: Mapping[str, Real] = field(default_factory=dict)
    evidence: float | None = None


@dataclass(frozen=True)
class HeldOut:
    """Prediction error of trials that took no part, before and after the effects are added and all is refitted.

    mse_before, mse_after: mean squared error of windows, each state in units of its scale; reduction: share;
    interval_90: of the reduction, by drawing runs again; windows: their number; by_run: name -> (before, after).
    metric: length of the windows, "30 s" of a 3 m model; horizons: name ("1 step", that, "whole run") -> (before,
    after).
    """

    mse_before: Real
    mse_after: Real
    reduction: Real
    interval_90: tuple[Real, Real]
    windows: int
    by_run: Mapping[str, Pair]
    metric: str = "30 s"
    horizons: Mapping[str, Pair] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The part "held_out" of ``diagnosis.json``."""
        pairs = {"by_run": self.by_run, "horizons": self.horizons}
        named = {key: {k: {"before": a, "after": b} for k, (a, b) in rows.items()} for key, rows in pairs.items()}
        return vars(self) | named


@dataclass(frozen=True)
class RandomSizes:
    """What is random in the fit without effects: rms of the latent force (3,) [N, N, N m] and its correlation time [s];
    standard deviations (6,) of the white errors of x, y [m], psi [rad], u, v [m/s], r [rad/s]; gust: rms
    of unlogged gusts along and across the wind [share of its speed], its memory [s], None without wind."""

    force_N_N_Nm: tuple[Real, Real, Real]
    force_memory_s: Real
    white: tuple[Real, ...]
    gust: tuple[Real, Real] | None = None
    gust_memory_s: Real | None = None

    @staticmethod
    def of(fit: Estimate) -> RandomSizes:
        """The sizes of the noise of ``fit``."""
        force, white = (tuple(a.tolist()) for a in (fit.noise.force, fit.noise.white))
        sizes = RandomSizes(force, float(fit.noise.tau), white)
        if fit.path.gusts is None:
            return sizes
        along, across = fit.noise.gust.tolist()
        return replace(sizes, gust=(along, across), gust_memory_s=float(fit.noise.gust_tau))


@dataclass(frozen=True)
class DiagnosisInputs:
    """What a diagnosis was made from: rows on the training and the test trials (name, path, sha256, ...), the command,
    the seed, and the versions of the program and its libraries. of_predictions: what the calibration behind the ship
    tells of predictions by her (``fitting.report.run_folder.OF_PREDICTIONS``)."""

    data: tuple[Mapping[str, Any], ...] = ()
    test: tuple[Mapping[str, Any], ...] = ()
    command: str = ""
    seed: int = 0
    versions: Mapping[str, str] = field(default_factory=dict)
    of_predictions: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class DiagnosisRecord:
    """What ``diagnosis.json`` holds under the names of the attributes.

    verdict: "none", "named" or "unknown"; sentence: it in words. instruments: faults of instruments, which
    are no effects. not_screened: effects that could not be tested, and why. noise: sizes of what is random. kinematics:
    sentences on faults of instruments. unexplained_force: what is left unexplained (None: nothing is). between:
    differences between groups of trials (None: not asked).
    """

    verdict: str
    sentence: str
    effects: tuple[NamedEffect, ...]
    instruments: tuple[InstrumentFault, ...]
    equivalence_class: tuple[str, ...]
    remainder: bool
    candidates: tuple[RankedCandidate, ...]
    where: Mapping[str, Any]
    held_out: HeldOut | None
    next_test: str
    warnings: tuple[str, ...]
    not_screened: Mapping[str, str]
    noise: RandomSizes
    unnamed: Mapping[str, Real]
    kinematics: tuple[str, ...]
    timings: Mapping[str, float]
    unexplained_force: UnexplainedForce | None = None
    between: Between | None = None
    budget: Budget | None = None


@dataclass(frozen=True, kw_only=True)
class Findings(DiagnosisRecord):
    """The whole answer.

    ship: refitted, with the named effects. None after reading a folder: before (the ship refitted without effects),
    null, final (the fits behind both), data (the training trials as arranged), trials, tests (to check on).
    """

    inputs: DiagnosisInputs
    ship: Ship
    before: Ship | None = None
    null: Estimate | None = None
    final: Estimate | None = None
    data: GriddedTrials | None = None
    trials: Sequence[Trial] = ()
    tests: Sequence[Trial] = ()

    def role(self, effect: str) -> str:
        """Of an ``effect``: "named" (an instrument, too), "class" where the data cannot tell it from the first of
        these, or ""."""
        if effect in {e.name for e in self.effects} | {f.name for f in self.instruments}:
            return "named"
        return "class" if effect in self.equivalence_class else ""

    def to_dict(self) -> dict[str, Any]:
        """The content of ``diagnosis.json``."""
        record = {f.name: getattr(self, f.name) for f in fields(DiagnosisRecord)}
        messages = [{"level": "warning", **row} for row in message_rows(self.warnings)]
        return plain({"schema_version": SCHEMA_VERSION, **record, "messages": messages})
