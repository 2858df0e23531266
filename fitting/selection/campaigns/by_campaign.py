"""A calibration whose instruments have a value of their own in each campaign, where that makes left-out runs better."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from cases.evidence.kinematics import kinematics_of
from cases.io.campaigns import Campaigns, campaigns_of
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.run_constants import ByCampaign, prior_with
from fitting.prediction.score import pooled_sigma
from fitting.selection.campaigns.candidates import Beside, candidates, constants_of, with_constants
from fitting.selection.campaigns.chance import chances, seen_by_kinematics
from fitting.selection.campaigns.choice import InstrumentTried, KeptInstruments, better, choose, gains
from fitting.selection.campaigns.readings import RunReadings, readings_as_rows
from fitting.selection.campaigns.sentences import differences, why_not
from fitting.selection.campaigns.spread import Reduced, Widths, with_prior
from fitting.selection.left_out_runs import RunScores, apart, estimates_without, leave_out
from mmg.messages import Message
from mmg.progress import OnProgress
from mmg.ship import Ship

AGAIN = 1.5
"""Factor by which a width must have changed at the new estimate for one more solve."""
SOLVES = 2
"""Most solves with constants of campaigns."""


@dataclass(frozen=True)
class CampaignFit:
    """A calibration and what became of campaigns.

    calibration: with constants of campaigns, or as it was; own: ``per_run`` of ``estimate_coefficients`` that made it;
    content: of "campaigns" in result.json, None where there is nothing to say; messages: for a person; seconds: what it
    took; left_out: scores of runs left out before and after, None where nothing was kept.
    """

    calibration: Calibration
    own: ByCampaign | tuple[str, ...] = ()
    content: dict[str, Any] | None = None
    messages: tuple[Message, ...] = ()
    seconds: float = 0.0
    left_out: tuple[RunScores, RunScores] | None = None


def may_keep(ship: Ship, trials: Sequence[Trial], wanted: tuple[str, ...] = ()) -> bool:
    """Whether ``by_campaign`` may keep anything for a ``ship`` on ``trials``; wanted, and errors: as there."""
    if wanted == ("none",) or len(campaigns_of(trials).comparable) < 2:
        return False
    return bool(candidates(ship, wanted))


def by_campaign(
    found: Calibration, trials: Sequence[Trial], wanted: tuple[str, ...] = (), progress: OnProgress | None = None
) -> CampaignFit:
    """The calibration ``found`` with a value per campaign of each instrument for which that pays, else as it is.

    found: where it is a draft, one Newton step leads to what is judged (a one-step estimate, Bickel 1975); trials: that
    it was made of; wanted: names of instruments, () for the usual ones, ("none",) for none; progress: of further
    solves.
    Needs two campaigns with two runs each at least. Raises UserError where the campaigns of trials contradict each
    other, or an instrument wanted for is unknown.
    """
    began = time.perf_counter()
    same = CampaignFit(found)
    if wanted == ("none",):
        return same
    campaigns = campaigns_of(trials)
    chosen = candidates(found.problem.ship, wanted)
    reason = why_not(campaigns, bool(wanted))
    alone = len(campaigns.comparable) < 2
    judged = found.draft or found.converged
    if alone or not chosen or not judged or found.constants is not None:
        told = (*campaigns.messages, *([reason] if reason else []))
        return replace(same, messages=told)
    beside = Beside.of(found, campaigns, chosen)
    started = [i for i, c in enumerate(chosen) if c.symbols[0] in found.prior.symbols]
    logs = kinematics_of(trials, found.problem.ship) if seen_by_kinematics(chosen) else None
    differing = chances(beside, logs, campaigns.number, started, found.spread.dispersion)
    kept = choose(found, beside, trials, started, differing)
    content = _content(campaigns, kept.table)
    same = replace(same, content=content, messages=campaigns.messages)
    if kept.numbers:
        readings = {
            beside.candidates[i].symbols[0]: r for i in kept.numbers if (r := differing[i].readings) is not None
        }
        own = constants_of(beside, kept.numbers, campaigns)
        better_fit, scores = _refitted(found, beside, kept, own, readings, trials, progress)
        if better_fit is None:
            return replace(same, seconds=time.perf_counter() - began)
        same = _with_values(better_fit, scores, campaigns, content, list(campaigns.messages))
    return replace(same, seconds=time.perf_counter() - began)


def _refitted(
    found: Calibration,
    beside: Beside,
    kept: KeptInstruments,
    own: ByCampaign,
    readings: Mapping[str, RunReadings],
    trials: Sequence[Trial],
    progress: OnProgress | None,
) -> tuple[CampaignFit | None, tuple[RunScores, RunScores] | None]:
    """The calibration with the constants ``own`` of what was ``kept``, if it converges and left-out runs confirm it;
    and their scores. readings: of those constants that the kinematics measured; trials, progress: as of
    ``by_campaign``."""
    ship, forces = found.problem.ship, found.problem.captive
    captive = forces.points if forces else None
    told = {symbol: r.of_campaigns(len(own.names)) for symbol, r in readings.items()}
    own = replace(own, told=told)
    at = [beside.symbols.index(s) for s in own.symbols]
    widths, start = kept.widths, _start(beside, kept)
    block = [next(i for i in kept.numbers if s in beside.candidates[i].symbols) for s in own.symbols]
    size = beside.unit[at] * np.array(widths.width)[block]
    means = widths.means(start[beside.constants])
    mean = beside.centre[at] + beside.unit[at] * np.array([means[beside.symbol == k][0] for k in at])
    values = beside.centre[at] + beside.unit[at] * np.array([start[beside.constants][beside.symbol == k] for k in at]).T
    shared = dict(zip(beside.problem.prior.symbols[: beside.problem.prior.shared], start, strict=False))
    for k, s in enumerate(beside.symbols):  # one value for all, as before
        if s in ship.free and s not in own.symbols:
            c = ship.coefficients[s]
            value = beside.centre[k] + beside.unit[k] * means[beside.symbol == k][0]
            shared[s] = (np.clip(value, c.lower, c.upper) - c.value) / c.std
    sigma, nodes = found.sigma, beside.nodes_of(own.symbols)
    new: Calibration | None = None
    passes = min(found.settings.passes, 1 if found.settings.loss == "gaussian" else 2)
    settings = replace(found.settings, starts=1, passes=passes)
    for _ in range(1 if told else SOLVES):
        own_ship = with_constants(ship, own.symbols, mean, size)
        prior = prior_with(own_ship, own, ())
        place = slice(prior.shared, None)
        p = np.concatenate(
            [[shared[s] for s in own_ship.free], (values.reshape(-1) - prior.mean[place]) / prior.std[place]]
        )
        warm = {"p": p, "sigma": sigma, "nodes": nodes}
        new = estimate_coefficients(own_ship, trials, settings, progress, warm, captive, own)
        if not new.converged or new.constants is None:
            return None, None
        wider, moved = _widths_again(new, block)
        factor = wider / size
        if max(factor.max(), 1 / factor.min()) < AGAIN:
            break
        size, mean, values = wider, mean + size * moved, new.constants.value
        sigma, nodes = new.sigma, new.iterate["nodes"]
        shared = dict(zip(new.prior.symbols, new.p, strict=True))
    assert new is not None
    scores = _confirmed(found, new, own, readings, trials)
    return (CampaignFit(new, own), scores) if scores else (None, None)


def _confirmed(
    found: Calibration,
    new: Calibration,
    own: ByCampaign,
    readings: Mapping[str, RunReadings],
    trials: Sequence[Trial],
) -> tuple[RunScores, RunScores] | None:
    """Scores of the ``trials`` left out of the calibration ``found`` and of the ``new`` one with the constants ``own``;
    None unless they become better. readings: that the new one was told of."""
    unit = pooled_sigma([t for t in trials if t.has_position])
    info = readings_as_rows(new.information, new.problem.prior, own, readings)
    folds = apart(trials)
    before = leave_out(found, list(trials), folds, unit)
    after = leave_out(new, list(trials), folds, unit, info=info)
    good = (gains if readings else better)(before.window, after.window)
    return (before, after) if good else None


def _start(beside: Beside, kept: KeptInstruments) -> np.ndarray:
    """Scaled coefficients (P,) of all that is beside a calibration, one Newton step from it with what was ``kept``."""
    info, columns = with_prior(kept.info, beside.constants, kept.widths)
    lower, upper = beside.problem.p_bounds()
    whole = np.zeros(len(lower))
    whole[columns] = estimates_without(info, [()], (lower[columns], upper[columns]))[0]
    return np.clip(whole, lower, upper)


def _widths_again(new: Calibration, block: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Widths (Q,), in their units, that are most likely at the calibration ``new``, and its means (Q,) in widths.

    block: (Q,) candidate of each symbol.
    """
    assert new.constants is not None
    prior, Q, shared = new.problem.prior, len(block), len(new.p)
    constants = np.arange(shared, new.problem.P)
    order = {b: k for k, b in enumerate(dict.fromkeys(block))}
    number = np.tile(np.arange(Q), prior.runs)
    blocks = np.array([order[b] for b in block])
    start = Widths((1.0,) * len(order), blocks[number], number)
    reduced = Reduced.of(new.information, constants, new.spread.dispersion)
    found = start.fitted(reduced, list(range(len(order))))
    means = found.means(reduced.mean(found.covariance()))
    unit = prior.std[constants][:Q]
    return unit * np.array(found.width)[blocks], np.array([means[number == k][0] for k in range(Q)])


def _content(campaigns: Campaigns, table: Sequence[InstrumentTried]) -> dict[str, Any]:
    """What result.json says of campaigns of which nothing was kept."""
    return {
        "runs": {name: campaigns.runs(name) for name in campaigns.names},
        "tried": [asdict(row) for row in table],
        "values": None,
        "left_out": None,
        "sentences": [],
    }


def _with_values(
    fit: CampaignFit,
    scores: tuple[RunScores, RunScores] | None,
    campaigns: Campaigns,
    content: dict[str, Any],
    messages: list[Message],
) -> CampaignFit:
    """The ``fit`` with its values in words and numbers."""
    constants = fit.calibration.constants
    assert constants is not None and scores is not None
    own, prior = slice(len(fit.calibration.p), None), fit.calibration.problem.prior
    std = prior.std[own] * np.sqrt(np.diag(fit.calibration.spread.model)[own])
    sentences = differences(constants, campaigns, std.reshape(constants.value.shape) / constants.prior_std)
    change = scores[0].change(scores[1])
    content = content | {
        "values": constants.rows(),
        "left_out": {"without": scores[0].mean().value, "with": scores[1].mean().value, "error": change.error},
        "sentences": [str(message) for message in sentences],
    }
    return replace(fit, content=content, messages=(*messages, *sentences), left_out=scores)
