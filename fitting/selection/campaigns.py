"""A calibration whose instruments have a value of their own in each campaign, where that makes left-out runs better.

Heading and turn rate, position and velocities follow from one another. So the logs alone show in each run how late the
turn rate is, and by what share turn rate and log are off (cases/evidence/kinematics), whatever the model of the ship
lacks. These readings are compared between campaigns as random effects: a difference must exceed what the runs of one
campaign scatter (fitting/uncertainty/group_test). Instruments that differ get a distribution of their values (empirical
Bayes), from which each campaign draws its own; the readings are data on these values in a second calibration. That is
taken only if runs are predicted better that are left out of it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cases.evidence.kinematics import TRACK, TURN, Kinematics, kinematics_of
from cases.io.campaigns import Groups
from cases.shipfiles.effects import parameters
from cases.trial_set import TrialSet
from fitting.calibration import Calibration, StartingPoint, estimated
from fitting.nlp.fisher_information import Information, information
from fitting.nlp.loss import Loss
from fitting.nlp.prior import ByCampaign, Prior, RunConstants, prior_with
from fitting.nlp.problem import Problem
from fitting.prediction.predict import change_over
from fitting.prediction.score import STRIDE, WINDOW
from fitting.selection.left_out_runs import estimates_without, leave_out, relative_change
from fitting.solvers.control import Control
from fitting.uncertainty.group_test import group_test, holm
from mmg.effects import EFFECTS
from mmg.errors import UnknownName
from mmg.messages import Message, OnProgress
from mmg.model import assemble, states_behind
from mmg.motion.froude import time_scale
from mmg.ship import Ship

# Probability by chance, corrected for the number of instruments, below which an instrument differs. Set by hand:
# left-out runs decide after it.
LEVEL = 0.05
# Standard deviations of the values of campaigns that are tried, in the typical size of the constant.
WIDTHS = np.geomspace(0.02, 12.0, 33)  # a grid set by hand, 22 % apart
# Standard deviation of the mean of all campaigns, in the same size: that of an effect that is freed. Set by hand.
SHARED = 3.0
# Standard error, by the width, from which the runs of a campaign tell nothing of a constant. Set by hand.
UNINFORMATIVE = 0.9


@dataclass(frozen=True)
class Instrument:
    """An error of an instrument: name, symbol of its constant, what the kinematics call it, and words for it."""

    name: str
    symbol: str
    reading: str
    words: str

    @property
    def effect(self) -> str:
        """The effect that the constant belongs to."""
        return self.symbol.partition(".")[0]


# What may differ by campaign. Of others (lag of u and v, antenna, heading, wind sensor, fouling, draught, rudder
# offset) none was kept on any data set.
INSTRUMENTS = (
    Instrument("gyro lag", "gyro.T", "lag_r", "the lag of the turn rate"),
    Instrument("gyro scale", "gyro.share", "gain_r", "the scale error of the turn rate"),
    Instrument("log_scale", "log_scale.share", "gain_u", "the scale error of the log"),
)


@dataclass(frozen=True)
class CampaignFit:
    """A calibration and what became of campaigns.

    calibration: with constants of campaigns, or as it was; content: of "campaigns" in result.json, None where there is
    nothing to say; messages: for a person; seconds: what it took.
    """

    calibration: Calibration
    content: dict[str, Any] | None = None
    messages: tuple[Message, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True)
class RunReadings:
    """Readings of one constant by run: value, std (R,) in its unit, NaN where a run has none; std holds the scatter
    between runs; number: (R,) of the campaign of each run."""

    value: np.ndarray
    std: np.ndarray
    number: np.ndarray

    def precision(self) -> np.ndarray:
        """1 / std^2 (R,), 0 where there is no reading."""
        return np.where(np.isfinite(self.std), 1.0 / np.square(np.nan_to_num(self.std, nan=1.0)), 0.0)

    def of_campaigns(self, count: int) -> tuple[tuple[float, float], ...]:
        """Value and std of each of ``count`` campaigns, by precision; std is infinite for one without a reading."""
        weight = self.precision()
        total = np.bincount(self.number, weight, count)
        sums = np.bincount(self.number, weight * np.nan_to_num(self.value), count)
        some = np.where(total > 0, total, 1.0)  # no division by zero
        value, std = np.where(total > 0, sums / some, 0.0), np.where(total > 0, 1.0 / np.sqrt(some), np.inf)
        return tuple(zip(value.tolist(), std.tolist(), strict=True))


def instruments(ship: Ship, wanted: Sequence[str] = ()) -> list[Instrument]:
    """What may differ between campaigns of trials of ``ship``: INSTRUMENTS, or those ``wanted``, by name or effect.

    Left out is what the ship holds at a value of its own. Raises UserError for an unknown name.
    """
    for name in wanted:
        if not any(name in (each.name, each.effect) for each in INSTRUMENTS):
            known = ", ".join(dict.fromkeys(each.effect for each in INSTRUMENTS))
            why = "is gone: it no longer differs by campaign" if name in EFFECTS else "unknown"
            raise UnknownName(f"--per-campaign {name}: {why}; choose among {known}, or none")
    rows = [each for each in INSTRUMENTS if not wanted or {each.name, each.effect} & {*wanted}]
    return [each for each in rows if each.effect not in ship.effects or not ship.coefficients[each.symbol].fixed]


def may_keep(ship: Ship, trials: TrialSet, wanted: tuple[str, ...]) -> bool:
    """Whether ``by_campaign`` may keep anything for a ``ship`` on ``trials``; wanted, and errors: as there."""
    return wanted != ("none",) and len(trials.campaigns.comparable) >= 2 and bool(instruments(ship, wanted))


def by_campaign(fit: Calibration, wanted: tuple[str, ...] = (), progress: OnProgress | None = None) -> CampaignFit:
    """The calibration ``fit`` with a value per campaign of each instrument for which that pays, else as it is.

    fit: where it is a draft, one Newton step leads to what is judged (a one-step estimate, Bickel 1975); wanted: names
    of instruments, () for all, ("none",) for none; progress: of the second calibration.
    Needs two campaigns with two runs each at least. Raises UserError where the campaigns of trials contradict each
    other, or an instrument wanted is unknown.
    """
    began = time.perf_counter()
    same, ship = CampaignFit(fit), fit.problem.ship
    if wanted == ("none",):
        return same
    campaigns, tried = fit.trials.campaigns, instruments(ship, wanted)
    judged = (fit.draft or fit.converged) and fit.constants is None
    if len(campaigns.comparable) < 2 or not tried or not judged:
        return replace(same, messages=why_not(campaigns, bool(wanted)))
    logs = kinematics_of(fit.trials, ship)
    length = float(ship.particulars["L"])
    readings = {each.symbol: r for each in tried if logs and (r := run_readings(logs, each, length, campaigns))}
    # what the logs do not tell counts as equal, and is corrected for
    chance = holm([readings[each.symbol][1] if each.symbol in readings else 1.0 for each in tried])
    differing = {each.symbol: readings[each.symbol][0] for each, p in zip(tried, chance, strict=True) if p < LEVEL}
    made = _with_constants(fit, campaigns, differing, progress) if differing else same
    taken = made.calibration is not fit
    # of each instrument: probability that it differs by chance, whether the logs tell, whether campaigns have their own
    rows = [
        {"name": each.name, "chance": float(p), "measured": each.symbol in readings}
        | {"taken": taken and each.symbol in differing}
        for each, p in zip(tried, chance, strict=True)
    ]
    runs = {name: campaigns.runs(name) for name in campaigns.names}
    content = {"runs": runs, "tried": rows, "values": None, "left_out": None, "sentences": []} | (made.content or {})
    seconds = time.perf_counter() - began
    return replace(made, content=content, seconds=seconds)


def run_readings(
    logs: Kinematics, instrument: Instrument, length: float, campaigns: Groups
) -> tuple[RunReadings, float] | None:
    """Readings of an ``instrument`` by run from the kinematics of the ``logs`` of ``campaigns``, and the probability
    that it is the same in all and differs by chance; None where too few runs have one. length: of the ship [m]."""
    q = next(q for q in (*TRACK, *TURN) if q.symbol == instrument.reading)
    group = np.array(campaigns.number)
    size = q.threshold * time_scale(length) ** (2 * q.power)  # unit of the test: what matters
    value, std = (np.array([getattr(run[q.symbol], name) for run in logs.runs]) / size for name in ("value", "std"))
    good = np.isfinite(value) & np.isfinite(std) & (std > 0) & np.array([not run.faults for run in logs.runs])
    if len(np.unique(group[good])) < 2 or good.sum() <= len(np.unique(group[good])):
        return None
    test = group_test(value[good] / std[good] ** 2, np.diag(std[good] ** -2.0), group[good], 1)
    if test is None:
        return None
    # a reading's own error, and the scatter between runs of a campaign
    both = np.where(good, size * np.sqrt(std**2 + test.scatter[0] ** 2), np.nan)
    return RunReadings(np.where(good, size * value, np.nan), both, group), test.p_single


def distribution_of(value: np.ndarray, std: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation of the values of campaigns, of which readings ``value`` with errors ``std`` (C,) are
    known, all in typical sizes; std is infinite for a campaign without one.

    The values are N(m, w^2), m N(0, SHARED^2). Of WIDTHS that w is taken which makes the readings most likely (Efron
    and Morris 1973), under the gamma density w exp(-w / SHARED) that keeps off zero (Chung et al. 2013).
    """
    told = np.isfinite(std)
    y, noise = value[told], np.diag(std[told] ** 2)
    best = (-np.inf, 0.0, 0.0)
    for width in WIDTHS:
        C = noise + width**2 * np.eye(len(y)) + SHARED**2  # the mean, integrated out, is in all of them
        pull = np.linalg.solve(C, y)
        fit = float(-0.5 * np.linalg.slogdet(C)[1] - 0.5 * y @ pull + np.log(width) - width / SHARED)
        best = max(best, (fit, float(SHARED**2 * pull.sum()), float(width)))  # its mean given the readings
    return best[1:]


def _with_constants(
    fit: Calibration,
    campaigns: Groups,
    readings: Mapping[str, RunReadings],
    progress: OnProgress | None,
) -> CampaignFit:
    """The calibration with constants by campaign of the ``readings`` (by symbol) where it converges and runs left out
    are better predicted, else ``fit`` as it is."""
    symbols, count = tuple(readings), len(campaigns.names)
    told = {symbol: r.of_campaigns(count) for symbol, r in readings.items()}
    own = ByCampaign(symbols, campaigns.names, campaigns.number, told)
    ship, forces = fit.problem.ship, fit.problem.captive
    for symbol in symbols:
        effect = symbol.partition(".")[0]
        row = next(p for p in parameters(ship, effect) if f"{effect}.{p.symbol}" == symbol)
        value, std = np.array(told[symbol]).T
        value = np.clip(value, row.lower, row.upper)  # a lag below zero is noise, and no constant may have it
        mean, width = distribution_of((value - row.neutral) / row.typical, std / row.typical)
        ship = with_constant(ship, symbol, row.neutral + mean * row.typical, width * row.typical)
    prior = prior_with(ship, own, ())
    place = dict(zip(fit.prior.symbols, fit.p, strict=True))
    # constants begin at their prior mean
    p = np.concatenate([[place[s] for s in ship.free], np.zeros(len(prior.mean) - prior.shared)])

    passes = min(fit.settings.passes, 1 if fit.settings.loss == "gaussian" else 2)
    settings = replace(fit.settings, starts=1, passes=passes)
    # one Newton step first: from the estimates without constants the solver may end in another, worse optimum
    loss, nodes, captive = Loss(settings.loss), _nodes(fit, ship), forces.points if forces else None
    problem = Problem.of(ship, prior, fit.segments, fit.sigma, loss, captive, settings.compiled)
    x = problem.join(nodes, np.clip(p, *problem.p_bounds()))
    x = problem.join(nodes, estimates_without(information(problem, x), [()], problem.p_bounds())[0])
    control = Control.within(settings.time_limit, progress, settings.max_iterations)
    new = estimated(problem, StartingPoint(x, near=True), settings, control, own)
    new = new.of_trials(fit.trials, fit.data_warnings, fit.notices)
    if not new.converged or new.constants is None:
        return CampaignFit(fit)
    info = readings_as_rows(new.information, new.problem.prior, own, readings)
    folds, unit = fit.trials.apart, change_over(fit.trials, WINDOW, STRIDE)
    scores = leave_out(fit, folds, unit), leave_out(new, folds, unit, info=info)
    if not gains(*scores):
        return CampaignFit(fit)
    without, own_error = (float(np.nanmean(some)) for some in scores)
    content = {"left_out": {"without": without, "with": own_error, "error": relative_change(*scores)[1]}}
    return with_values(CampaignFit(new, content), campaigns)


def with_constant(ship: Ship, symbol: str, value: float, width: float) -> Ship:
    """The ``ship`` with the effect of the constant ``symbol``, which is fixed at ``value`` with the standard deviation
    ``width``; other parameters of an effect that it did not have are held at their neutral values."""
    effect = symbol.partition(".")[0]
    if effect not in ship.effects:
        ship = ship.with_effect(effect)
        ship = ship.fixing([s for s in ship.symbols if s.startswith(f"{effect}.")])
    row = ship.coefficients[symbol].with_(value=float(value), std=float(width), fixed=True)
    return ship.with_coefficients({symbol: row})


def _nodes(fit: Calibration, ship: Ship) -> np.ndarray:
    """States (B, S) of ``ship`` where the calibration ``fit`` ended: what its own model lacks has settled there."""
    problem, model = fit.problem, assemble(ship)
    before = problem.split(fit.solution.x)[0]
    nodes = states_behind(model, before[:, :6].T, problem.segments.node_controls, ship.values).T
    at = {name: i for i, name in enumerate(model.states)}
    nodes[:, [at[name] for name in problem.kernels.model.states]] = before
    return nodes


def readings_as_rows(
    info: Information, prior: Prior, own: ByCampaign, readings: Mapping[str, RunReadings]
) -> Information:
    """``info`` of a fit whose ``prior`` holds what ``own`` was told of its constants, with the ``readings`` (by symbol)
    as rows of their runs instead, so that a run that is left out takes its reading along: one more observation
    N(reading; constant of its campaign, std^2)."""
    runs, P = np.arange(len(own.number)), len(info.p)
    fisher, score = np.zeros((len(runs), P, P)), np.zeros((len(runs), P))
    for symbol, r in readings.items():
        at = prior.shared + len(own.symbols) * r.number + own.symbols.index(symbol)
        weight = prior.std[at] ** 2 * r.precision()
        fisher[runs, at, at] += weight
        score[runs, at] += weight * (info.p[at] - (np.nan_to_num(r.value) - prior.mean[at]) / prior.std[at])
    return replace(
        info,
        fisher=np.concatenate([info.fisher, fisher]),
        score=np.concatenate([info.score, score]),
        run=np.concatenate([info.run, runs]),
        prior_information=info.prior_information - fisher.sum(axis=0),
        prior_score=info.prior_score - score.sum(axis=0),
    )


def gains(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether scores of runs ``after`` (R,) are lower in the mean than those ``before``."""
    good = np.isfinite(before) & np.isfinite(after)
    return bool(good.any() and after[good].mean() < before[good].mean())


def with_values(fit: CampaignFit, campaigns: Groups) -> CampaignFit:
    """The ``fit`` with its values by campaign, of these ``campaigns``, in words and numbers; as it is without any."""
    constants, problem, p = fit.calibration.constants, fit.calibration.problem, fit.calibration.p
    if constants is None or not problem.prior.campaign:
        return fit
    own = slice(len(p), None)
    std = problem.prior.std[own] * np.sqrt(np.diag(fit.calibration.spread.model)[own])
    sentences = differences(constants, campaigns, std.reshape(constants.value.shape) / constants.prior_std)
    content = {"values": constants.rows(), "sentences": [str(message) for message in sentences]}
    return replace(fit, content=(fit.content or {}) | content, messages=tuple(sentences))


def why_not(campaigns: Groups, wanted: bool) -> tuple[Message, ...]:
    """Why these ``campaigns`` cannot be compared, nothing if they can; said of a single one only if ``wanted``."""
    if len(campaigns.comparable) >= 2 or (len(campaigns.names) < 2 and not wanted):
        return ()
    if len(campaigns.names) < 2:
        return (Message("all trials are of one campaign, so instruments have one value", "one_campaign"),)
    few = ", ".join(name for name in campaigns.names if name not in campaigns.comparable)
    words = (
        f"instruments keep one value for all campaigns: {few} with one run each, of which none could be left out and "
        "still be told by the others; two campaigns with two runs each are needed"
    )
    return (Message(words, "one_run_a_campaign"),)


def not_asked(trials: TrialSet, wanted: Sequence[str]) -> tuple[Message, ...]:
    """What to say of campaigns of ``trials`` where each run has constants of its own; nothing for a single campaign, or
    where "none" is ``wanted``. Raises UserError for campaigns that contradict each other."""
    if tuple(wanted) == ("none",) or len(trials.campaigns.comparable) < 2:
        return ()
    words = (
        "trials of several campaigns, but instruments keep one value for all of them: with --per-run nothing else is "
        "asked"
    )
    return (Message(words, "campaigns_not_asked"),)


def differences(constants: RunConstants, campaigns: Groups, left: np.ndarray) -> list[Message]:
    """A sentence on each of the ``constants``, which differ, and on ``campaigns`` that do not tell it.

    left: (campaigns, Q) share of the width that the trials of each leave, as standard errors of the model.
    """
    found, names = [], {each.symbol: each.words for each in INSTRUMENTS}
    for k, symbol in enumerate(constants.symbols):
        value, std = constants.value[:, k], constants.std[:, k]
        unit = f" {constants.units[k]}" if constants.units[k] else ""
        low, high = int(np.argmin(value)), int(np.argmax(value))
        each = ", ".join(f"{n} {_short(v, s)} +- {s:.1g}" for n, v, s in zip(constants.runs, value, std, strict=True))
        least, most = _short(value[low], std[low]), _short(value[high], std[high])
        mean, width = _short(constants.prior_value[k], constants.prior_std[k]), constants.prior_std[k]
        words = (
            f"{names.get(symbol, symbol)} ({symbol}) differs between campaigns, from {least}{unit} "
            f"({constants.runs[low]}) to {most}{unit} ({constants.runs[high]}), "
            f"mean {mean} +- {width:.1g}{unit}: {each}"
        )
        found.append(Message(words, "campaigns_differ"))
        vague = [n for n, share in zip(constants.runs, left[:, k], strict=True) if share > UNINFORMATIVE]
        if vague:
            words = (
                f"{', '.join(vague)}: {'its' if len(vague) == 1 else 'their'} runs tell nothing of {symbol} (too "
                "little excitation, or too few runs); the value is the mean of all campaigns"
            )
            found.append(Message(words, "campaign_tells_nothing"))
    alone = [name for name in constants.runs if campaigns.runs(name) == 1]
    if alone:
        words = (
            f"{', '.join(alone)}: one run each; what is said of {'it' if len(alone) == 1 else 'them'} no other confirms"
        )
        found.append(Message(words, "one_run_a_campaign"))
    return found


def _short(value: float, std: float) -> str:
    """A value to the first digit of its standard error."""
    if not 0 < std < 10:
        return f"{value:.3g}"
    digits = max(0, -math.floor(math.log10(std)))
    return f"{round(value, digits) + 0.0:.{digits}f}"
