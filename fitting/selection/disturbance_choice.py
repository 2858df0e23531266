"""Random forces along the runs, or none: by runs left out.

With latent forces (mmg/effects/disturbance.py) coefficients need not bend to gusts, and what is left as residual is
the error of a second, no longer of a window. That helps where forces of such a process pushed the ship, and harms where
what the model lacks goes with the manoeuvre: then the forces take what the coefficients should say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.captive import Captive
from fitting.prediction.score import pooled_sigma
from fitting.selection.left_out_runs import apart, leave_out
from fitting.selection.robust_choice import CLEARLY, FEWEST, LEAST_GAIN, kinds_worse, log_change
from mmg.errors import UserError
from mmg.messages import Message
from mmg.progress import OnProgress
from mmg.ship import Ship

EFFECT = "disturbance"


def choose_disturbance(
    found: Calibration,
    ship: Ship,
    trials: Sequence[Trial],
    captive: Captive | None = None,
    progress: OnProgress | None = None,
) -> tuple[Calibration, Ship]:
    """The calibration ``found`` and its ``ship``, or those with latent forces of estimated sizes where runs left out
    are clearly better predicted so (the forces themselves are not known ahead, and predict nothing).

    trials, captive: of ``found``; progress: of the other fit. The calibration has a notice on what was found, also
    where nothing could be tried.
    """
    if EFFECT in ship.effects:
        return found, ship

    def noted(calibration: Calibration, words: str) -> Calibration:
        return replace(calibration, notices=(*calibration.notices, Message(words, "disturbance_chosen")))

    if not found.converged or found.constants is not None or len(trials) < FEWEST:
        return noted(found, f"random forces were not tried: that takes a fit that converged and {FEWEST} runs"), ship
    sigma, folds = None, apart(trials)
    try:
        sigma = pooled_sigma(trials)
        before = leave_out(found, trials, folds, sigma)
    except UserError as error:
        return noted(found, f"random forces were not tried: {error}"), ship
    pushed = ship.with_effect(EFFECT)
    settings = replace(found.settings, loss="gaussian", weight=1.0, starts=1)
    other = estimate_coefficients(pushed, trials, settings, progress, {"p": found.p}, captive)
    if not other.converged:
        return noted(found, f"random forces left out: the fit with them ended with {other.solution.status}"), ship
    after = leave_out(other, trials, folds, sigma)
    change, worse = log_change(before, after), kinds_worse(before, after)
    figures = (
        f"runs left out, 30 s windows {before.mean('window').value:.4f} -> {after.mean('window').value:.4f}, 100 s "
        f"restarts {before.mean('paper').value:.4f} -> {after.mean('paper').value:.4f}, mean change by run "
        f"{change.value:+.1%} +- {change.error:.1%}"
    )
    if change.value < -max(LEAST_GAIN, CLEARLY * change.error) and not worse:
        return noted(other, f"random forces along the runs kept: {figures}"), pushed
    return noted(found, f"random forces along the runs left out: {figures}"), ship
