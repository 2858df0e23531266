"""What stretches that were left out of the trials were worth: scores and estimates with and without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cases.io.leave_out import inside, spans_left_out
from cases.trial import Trial
from fitting.calibration import Calibration
from fitting.nlp.fisher_information import information
from fitting.nlp.run_constants import Own
from fitting.prediction.score import ScorePair, in_words, score
from fitting.solvers.preparation import prepared
from mmg.errors import Conflict, UserError
from mmg.messages import Message
from mmg.rollout import Simulator

SETS = {"validation": "held-out trials", "training": "training trials"}
LISTED = 3
"""Coefficients named in the message."""


def moved_by(found: Calibration, per_run: Own, trials: Sequence[Trial]) -> np.ndarray:
    """How far the estimates of ``found`` would move were it made from other ``trials``: p (P,) in standard errors.

    One Gauss-Newton step on these trials, less that on the windows of the calibration, both from the estimates and the
    measured states. per_run: as of ``estimate_coefficients`` that made it. Raises UserError for trials that cannot be
    fitted.
    """
    p, settings = found.iterate["p"], replace(found.settings, sigma=tuple(found.sigma.tolist()))
    forces = found.problem.captive
    points = forces.points if forces else None
    other = prepared(found.problem.ship, trials, settings, {"p": p}, points, per_run)[0]
    if len(p) != other.P:
        raise Conflict("the runs that have constants of their own are others")
    steps = []
    for problem in (other, found.problem):
        about = information(problem, problem.start(p))
        steps.append(-np.linalg.solve(about.hessian, about.score.sum(axis=0) + about.prior_score))
    shared = slice(len(found.p))
    return np.asarray((steps[0] - steps[1])[shared] / np.sqrt(np.diag(found.covariance)))


def worth_of_left_out(
    after: Simulator,
    sets: Mapping[str, Sequence[Trial]],
    scores: Mapping[str, ScorePair],
    found: Calibration,
    per_run: Own,
) -> dict[str, Any] | None:
    """Content of "left_out" in result.json; None where nothing was left out.

    after: the calibrated ship; sets: trials by name, "training" and "validation"; scores: of them, without what was
    left out; found, per_run: as of ``moved_by``.
    Returns seconds and trials that are concerned, both metrics with and without, and the step by symbol.
    """
    concerned = {t.name: _row(t) for some in sets.values() for t in some if t.whole is not None}
    if not concerned:
        return None
    worth: dict[str, Any] = {
        "seconds": sum(row["seconds"] for row in concerned.values()),
        "trials": concerned,
        "scores": {},
        "estimates": None,
    }
    for name, pair in scores.items():
        whole = [t.whole or t for t in sets[name] if t.has_position]
        if any(t.whole is not None for t in sets[name]):
            kept = score(after, whole, pair.after.sigma)
            worth["scores"][name] = {
                metric: {"without": getattr(pair.after, metric), "with": getattr(kept, metric)}
                for metric in ("window", "paper")
            }
    if any(t.whole is not None for t in sets["training"]):
        try:
            steps = moved_by(found, per_run, [t.whole or t for t in sets["training"]])
        except (UserError, np.linalg.LinAlgError) as error:
            return worth | {"estimates": {"method": "none", "why": str(error)}}
        moves = dict(zip(found.prior.symbols, steps.tolist(), strict=True))
        worth["estimates"] = {
            "method": "step",
            "change_in_standard_errors": moves,
            "rms": float(np.sqrt(np.mean(steps**2))),
        }
    return worth


def worth_message(found: Mapping[str, Any] | None) -> list[Message]:
    """A message on ``found``, what ``worth_of_left_out`` gave."""
    if not found:
        return []
    count = len(found["trials"])
    parts = [f"{found['seconds']:.1f} s of {count} trial{'s' * (count > 1)} were left out"]
    for name, row in found["scores"].items():
        words = [
            f"{label} {in_words(row[key]['with'])} instead of {in_words(row[key]['without'])}"
            for key, label in (("window", "30 s windows"), ("paper", "100 s restarts"))
        ]
        parts.append(f"with them the {SETS.get(name, name)} have {', '.join(words)}")
    if (estimates := found["estimates"]) and "rms" in estimates:
        moves = estimates["change_in_standard_errors"]
        most = sorted(moves, key=lambda s: -abs(moves[s]))[:LISTED]
        named = ", ".join(f"{s} {moves[s]:+.1f}" for s in most)
        parts.append(
            f"fitted with them, the estimates would move by {estimates['rms']:.2g} standard errors (rms), most {named}"
        )
    elif estimates:
        parts.append(f"with them nothing could be fitted ({estimates['why']})")
    return [Message("; ".join(parts), "left_out_worth")]


def _row(trial: Trial) -> dict[str, Any]:
    spans = spans_left_out(trial)
    why = [str(note) for note in trial.notices if getattr(note, "code", "") == "left_out"]
    seconds = float(inside(trial, spans).sum()) * trial.dt
    return {"seconds": seconds, "spans": [list(span) for span in spans], "why": "; ".join(why)}
