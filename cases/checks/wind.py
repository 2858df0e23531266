"""Wind against the ship's own speed, and the true against the apparent wind columns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, Found
from cases.trial import Trial
from mmg.messages import has_code
from mmg.motion.frames import apparent_wind


def wind(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: mean true wind, its ratio to the ship's speed, and how well true and apparent columns agree.

    consistency_m_s is the RMS vector difference between the logged apparent wind and the one that follows
    from the true wind, u, v and psi; derived true wind agrees by construction and is not compared.
    """
    names = ("mean_m_s", "std_m_s", "ratio_to_ship_speed", "steadiness", "consistency_m_s")
    numbers: dict[str, Any] = dict.fromkeys(names)
    if not trial.has_wind:
        return numbers, []
    speed, through, air = trial["wind_speed"], np.hypot(trial["u"], trial["v"]), trial.wind_vector
    if not all(np.isfinite(values).any() for values in (speed, through, air[:, 0])):
        return numbers, []  # never known together
    ship, mean, vector = float(np.nanmean(through)), float(np.nanmean(speed)), np.nanmean(air, axis=0)
    numbers.update(
        mean_m_s=mean,
        std_m_s=float(np.nanstd(speed)),
        ratio_to_ship_speed=mean / ship if ship > 1e-6 else None,
        steadiness=float(np.hypot(*vector)) / mean if mean > 1e-9 else None,
    )
    findings = []
    if ship > 1e-6 and mean > 3 * ship:
        text = f"The wind ({mean:.2f} m/s) is {mean / ship:.1f} times the ship's speed ({ship:.2f} m/s): "
        findings.append((INFO, "strong_wind", text + "a first-order force here, do not leave it out."))
    if float(np.nanmin(speed)) < 0:
        findings.append((DOUBTFUL, "negative_wind_speed", "The wind speed is negative at times; check the column."))
    measured = "apparent_wind_speed" in trial and "apparent_wind_direction" in trial
    if measured and not has_code(trial.notices, "true_wind_derived"):
        findings += _consistency(trial, mean, numbers)
    return numbers, findings


def _consistency(trial: Trial, mean: float, numbers: dict[str, Any]) -> list[Found]:
    """Adds consistency_m_s to the numbers and says when the two descriptions of the wind disagree."""
    logged = trial["apparent_wind_speed"] * np.exp(1j * trial["apparent_wind_direction"])
    misfit = {}
    for turned, angle in (("as logged", 0.0), ("reversed", math.pi)):
        speed, direction = apparent_wind(
            trial["wind_speed"], trial["wind_direction"] + angle, trial["psi"], trial["u"], trial["v"]
        )
        misfit[turned] = math.sqrt(float(np.nanmean(np.abs(logged - speed * np.exp(1j * direction)) ** 2)))
    earth = trial["wind_speed"] * np.exp(1j * trial["wind_direction"])
    misfit["the same column twice"] = math.sqrt(float(np.nanmean(np.abs(logged - earth) ** 2)))
    numbers["consistency_m_s"] = misfit["as logged"]
    if misfit["as logged"] <= max(0.15 * mean, 0.02):
        return []
    if misfit["reversed"] < 0.4 * misfit["as logged"]:
        level, why = CONTRADICTORY, "the directions differ by 180 deg: one of them says where the wind goes to"
    elif misfit["the same column twice"] < 0.4 * misfit["as logged"]:
        level, why = DOUBTFUL, "the apparent direction is not counted from the bow but equals the true one"
    else:
        level, why = DOUBTFUL, "check directions, heading and units"
    text = f"True wind, u, v and psi give an apparent wind {misfit['as logged']:.2f} m/s off the logged one; {why}."
    return [(level, "wind_direction", text)]
