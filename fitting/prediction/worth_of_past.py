"""Whether using the past of a window pays with a calibrated ship: measured on trials that she was not calibrated on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cases.trial import Trial
from fitting.prediction.predict import ShipsByTrial
from mmg.errors import UserError
from mmg.messages import Message
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

PAST = 30.0
"""Seconds of past of a 3 m model that are used by default."""
GAIN, HARM = 0.99, 1.01
"""Most of the error of 30 s windows, and of 100 s restarts, that may remain for the past to be used."""
HYBRID = "hybrid"
"""What a training that is no black box calls its model."""
SETS = {"validation": "validation trials", "left out": "trials left out of the calibration in turn"}


def default_past(ship: Ship) -> float:
    """Seconds of past that are used by default for a ``ship``, by Froude's law, whole ones."""
    return float(max(1.0, round(PAST * time_scale(ship.particulars["L"]))))


def adaptation_worth(
    simulator: Simulator, held_out: Sequence[Trial], without: np.ndarray | None = None
) -> dict[str, Any] | None:
    """Both metrics on ``held_out`` trials without and with the past of each window, as plain values.

    simulator: of the calibrated ship; without: (R, P) coefficients by which each trial is predicted where they are
    those of the calibration, each without its trial. Adapting is worthwhile when 30 s windows become better and 100 s
    restarts no worse. None where none of the trials can be scored.
    """
    from fitting.prediction.score import pooled_sigma, score  # late: not needed to predict

    kept = [i for i, t in enumerate(held_out) if t.has_position]
    located = [held_out[i] for i in kept]
    if without is not None:
        own = np.where(np.isfinite(without).all(axis=1)[:, None], without, simulator.ship.values)
        simulator = ShipsByTrial(simulator.ship, own[kept], simulator.compiled)
    past = default_past(simulator.ship)
    try:
        sigma = pooled_sigma(located)
        bare, adapted = (score(simulator, located, sigma, adapt=seconds) for seconds in (None, past))
    except UserError:
        return None
    good = adapted.window < GAIN * bare.window and not adapted.paper > HARM * bare.paper
    return {
        "past_s": past,
        "trials": "validation" if without is None else "left out",
        "files": len(located),
        "without": {"window": bare.window, "paper": bare.paper},
        "with": {"window": adapted.window, "paper": adapted.paper},
        "worthwhile": bool(good),
    }


def past_to_use(result: Mapping[str, Any], wanted: float | None) -> tuple[float, list[Message]]:
    """Seconds of past that a prediction uses, 0: none, and what is said of it.

    result: content of the run's result.json, empty for a bare ship, or of a black box, which knows no past; wanted:
    seconds that the caller names, None: what the result says pays.
    """
    known = result.get("adaptation")
    if wanted is not None:
        return wanted, warnings_on_adaptation(result) if wanted else []
    if not result or result.get("model", HYBRID) != HYBRID:
        return 0.0, []
    if not _is_known(known):
        words = (
            "the past of a window is not used: this run does not know whether that pays (one of today's mmg fit does); "
            "--adapt 30 uses it"
        )
        return 0.0, [Message(words, "adaptation_untested")]
    assert known is not None
    if not known["worthwhile"]:
        return 0.0, [Message(f"the past of a window is not used: {_found(known)}", "adaptation_off")]
    words = (
        f"up to {known['past_s']:g} s before each window are used, as that pays: {_found(known)}; --adapt 0 does not"
    )
    return float(known["past_s"]), [Message(words, "adaptation_on")]


def warnings_on_adaptation(result: Mapping[str, Any]) -> list[Message]:
    """What adaptation brought on trials held out, by the ``result`` of a run (result.json); empty if it paid."""
    known = result.get("adaptation")
    if not _is_known(known):
        words = "whether adapting pays with this model is not known: calibrate it with mmg fit to find out"
        return [Message(words, "adaptation_untested")]
    assert known is not None
    if known["worthwhile"]:
        return []
    return [Message(f"adapting did not pay: {_found(known)}; better leave it off", "adaptation_does_not_pay")]


def _is_known(known: Any) -> bool:
    """Whether ``known`` is what ``adaptation_worth`` gave."""
    try:
        numbers = [known[a][b] for a in ("without", "with") for b in ("window", "paper")]
        return all(isinstance(v, (int, float)) for v in (*numbers, known["past_s"])) and "worthwhile" in known
    except (KeyError, TypeError):
        return False


def _found(known: Mapping[str, Any]) -> str:
    """Both metrics without and with a past, in words."""
    before, after = known["without"], known["with"]
    where = SETS.get(known["trials"], known["trials"])
    return (
        f"on the {where} 30 s windows {before['window']:.4f} -> {after['window']:.4f}, "
        f"100 s restarts {before['paper']:.4f} -> {after['paper']:.4f}"
    )
