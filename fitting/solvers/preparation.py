"""What a calibration begins with: a problem from a ship and trials, where to start, and what is to be said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.checks import inputs_are_constant
from cases.inputs import assumed
from cases.trial import Trial
from fitting.identifiability.data_checks import against_captive, contradictions, refuse_outliers, unexcited_astern
from fitting.nlp.captive import Captive
from fitting.nlp.grid import default_step
from fitting.nlp.loss import Loss
from fitting.nlp.problem import Problem
from fitting.nlp.run_constants import Own, neutral_values, prior_with, symbols_of
from fitting.nlp.windows import Segments, cut
from fitting.settings import Settings
from mmg.errors import BadValue, Missing, OutOfRange, TooFewData
from mmg.messages import Message, as_messages
from mmg.ship import Ship


def _check_inputs(ship: Ship, trials: Sequence[Trial]) -> None:
    if not trials:
        raise Missing("no trials to fit: name at least one trial file")
    if not ship.free:
        raise Missing(f"{ship.name}: every coefficient is fixed; free some of them in the ship file or with --only")
    if all(inputs_are_constant(t) for t in trials):
        raise TooFewData(
            f"{', '.join(t.name for t in trials)}: the inputs n and delta never change, so there is nothing to "
            "identify; give trials with manoeuvres"
        )


def prepared(
    ship: Ship,
    trials: Sequence[Trial],
    settings: Settings,
    warm: dict[str, np.ndarray] | None,
    captive: Captive | None,
    per_run: Own,
) -> tuple[Problem, np.ndarray, Settings, list[Message], list[Message]]:
    """A problem, where to start, the settings used, and the warnings and notices on the way.

    ship, trials, settings, captive, per_run: as of ``calibration.estimate_coefficients``; warm: as there, with "p"
    (P,), "nodes" (B, S) and "sigma" (6,). Raises UserError for input from which nothing can be identified.
    """
    _check_inputs(ship, trials)
    step = settings.step or default_step(trials, ship.particulars["L"])
    window = settings.window or 100.0 * step
    if window < 10 * step:
        raise OutOfRange(f"a window of {window:g} s holds fewer than ten steps of {step:g} s; use a longer --window")
    refuse_outliers(trials, step)
    segments = cut(trials, step, window, settings.interval, inputs=ship.inputs)
    own = symbols_of(per_run)
    prior = prior_with(ship, per_run, segments.trials)
    warnings = [*contradictions(prior), *unexcited_astern(ship, trials, segments)]
    speed, length = np.sqrt((segments.nodes[:, 3:5] ** 2).sum(axis=1).mean()) + 1e-6, ship.particulars["L"]
    rough = (length / 3, length / 3, 0.1, 0.1 * speed, 0.1 * speed, 0.1 * speed / length)
    sigma = np.asarray(settings.sigma or rough, dtype=float)
    if sigma.shape != (6,) or not (sigma > 0).all():
        raise BadValue("sigma must be six positive numbers: x, y [m], psi [rad], u, v [m/s], r [rad/s]")
    problem = Problem.of(ship, prior, segments, sigma, Loss(settings.loss), captive, settings.compiled)
    if problem.captive:
        shared = prior.positions(ship)[: prior.shared]
        warnings += against_captive(problem.captive, neutral_values(ship, own), shared, prior.common)
    problem, x = _started(problem, warm, settings)
    notices = _notices(ship, trials, segments, problem.kernels.interpreted_because)
    used = replace(settings, step=step, window=window)
    return problem, x, used, warnings, notices


def _started(problem: Problem, warm: dict[str, np.ndarray] | None, settings: Settings) -> tuple[Problem, np.ndarray]:
    """The problem and its starting point, from an interrupted run where it fits."""
    if not warm or len(warm.get("p", ())) != problem.P:
        return problem, problem.start()
    if len(warm.get("nodes", ())) == problem.B:
        x = problem.join(warm["nodes"], np.clip(warm["p"], *problem.p_bounds()))
    else:
        x = problem.start(warm["p"])
    return problem.with_sigma(warm["sigma"]) if "sigma" in warm and not settings.sigma else problem, x


def holding(problem: Problem, x: np.ndarray, held: np.ndarray) -> Problem:
    """The ``problem`` with the coefficients that are ``held`` (P,) bound to where they are at x (n,)."""
    prior = problem.prior
    here = prior.mean + prior.std * problem.split(x)[1]
    return problem.with_bounds(np.where(held, here, prior.lower), np.where(held, here, prior.upper))


def _notices(ship: Ship, trials: Sequence[Trial], segments: Segments, interpreted_because: str) -> list[Message]:
    """What was left out, assumed or done more slowly."""
    found = [*as_messages(segments.dropped, "piece_too_short"), *as_messages(ship.notices, "ship")]
    if names := ", ".join(t.name for t in trials if not t.has_position):
        found.append(Message(f"positions cannot be fitted in {names} (no complete x, y columns)", "no_position"))
    found += assumed(trials, ship.inputs)
    slow = f"running without compiled code, several times slower: {interpreted_because}"
    return found + ([Message(slow, "interpreted")] if interpreted_because else [])
