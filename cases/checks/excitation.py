"""What the inputs and the motion of a trial can teach: quadrants, and groups of MMG coefficients.

The symbols are those of the low-speed four-quadrant model (Yoshimura 2009 hull, Hachii 2004 propeller, Yasukawa &
Yoshimura 2015 rudder). Which of them a ship has is said for the ship that is named; without one only the conditions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from cases.checks.report import DOUBTFUL, INFO, CheckReport, Found
from cases.trial import Trial
from mmg.motion.flow import INPUTS
from mmg.ship import Ship

ENOUGH = 20.0
"""s; a group excited for less than this is weakly excited (or 2 % of the trial, if that is longer)."""


GROUPS = {
    "hull_ahead": ("headway (u > 0)", r"X_0F?|R_0"),
    "hull_astern": ("sternway (u < 0)", r"X_0A"),
    "cross_flow": ("drift beyond 30 deg or turning nearly on the spot", r"C_D|C_rY|C_rN"),
    "sway_yaw_linear": ("sway and yaw at headway", r"Y_v|Y_r|N_v|N_r|X_vr"),
    "propeller_ahead": ("n > 0 with u > 0", r"k_[0-2]|t_P|w_P0|tau|C_P"),
    "propeller_ahead_astern_motion": ("n > 0 with u < 0", r"[AB]_[678]"),
    "propeller_reversed": ("n < 0", r"C_(3|6|7|10)|[AB]_[1-5]"),
    "rudder_ahead": ("rudder angles with n > 0 and u > 0", r"t_R|a_H|x_H|ell_R|gamma_[PN]|k_x|epsilon"),
    "rudder_reversed_flow": ("rudder angles with n < 0 and u > 0, or u < 0", r"k_xR|C_PR"),
    "wind": ("true wind above the ship's speed from changing sides", r"[XYN]_A\d+"),
}
"""Group of coefficients -> what must happen for it to matter, and the pattern of the symbols."""

QUADRANTS = {
    "u+ n+": "ahead with n > 0",
    "u+ n-": "ahead with n < 0",
    "u- n+": "astern with n > 0",
    "u- n-": "astern with n < 0",
    "n 0": "propeller stopped",
    "u 0": "no way on",
}
"""Keys of the quadrants in the numbers -> the words for them."""


def excitation(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: share of time per quadrant, seconds per coefficient group, findings about what is not excited."""
    u, v, r, n, delta = trial["u"], trial["v"], trial["r"], trial["n"], trial.rudder
    good = np.isfinite(u) & np.isfinite(v) & np.isfinite(r) & np.isfinite(n) & np.isfinite(delta)
    seconds = np.minimum(np.gradient(trial.t), 3 * trial.dt)
    total = float(seconds[good].sum())
    if total <= 0:
        text = "No row holds u, v, r, n and delta together: nothing to identify."
        return {}, [(DOUBTFUL, "nothing_to_identify", text)]
    still = 0.02 * max(float(np.percentile(np.hypot(u[good], v[good]), 95)), 1e-9)
    ahead, astern = good & (u > still), good & (u < -still)
    forward, reverse, stopped = good & (n > 1e-6), good & (n < -1e-6), good & (np.abs(n) <= 1e-6)
    quadrants = {
        "u+ n+": ahead & forward, "u+ n-": ahead & reverse,
        "u- n+": astern & forward, "u- n-": astern & reverse,
        "n 0": stopped, "u 0": good & ~ahead & ~astern & ~stopped,
    }  # fmt: skip
    beta = np.abs(np.arctan2(v, np.abs(u)))
    steered = np.abs(delta) > math.radians(2.0)
    moving = np.hypot(u, v) > still
    moved = good & moving
    turning = np.abs(r) > 0.25 * max(float(np.percentile(np.abs(r[good]), 95)), 1e-9)
    excited = {
        "hull_ahead": ahead,
        "hull_astern": astern,
        "cross_flow": (moved & (beta > math.radians(30))) | (good & ~moving & turning),
        "sway_yaw_linear": ahead & turning & (np.abs(r) > 1e-4),
        "propeller_ahead": ahead & forward,
        "propeller_ahead_astern_motion": astern & forward,
        "propeller_reversed": reverse,
        "rudder_ahead": ahead & forward & steered,
        "rudder_reversed_flow": steered & ((ahead & reverse) | astern),
        "wind": _windy(trial, good),
    }
    numbers: dict[str, Any] = {
        "inputs_constant": inputs_are_constant(trial),
        "quadrants": {name: float(seconds[mask].sum()) / total for name, mask in quadrants.items()},
        "group_seconds": {name: float(seconds[mask].sum()) for name, mask in excited.items()},
        "seconds": total,
        "delta_max_deg": math.degrees(float(np.abs(delta[good]).max())),
        "n_range_rps": [float(n[good].min()), float(n[good].max())],
        "drift_max_deg": math.degrees(float(np.percentile(beta[moved], 99))) if moved.any() else None,
    }
    return numbers, _sentences(numbers)


def inputs_are_constant(trial: Trial) -> bool:
    """True when in ``trial`` no actuator ever changes: nothing to identify."""
    names = [c for c in INPUTS if c in trial and np.isfinite(trial[c]).any()]
    spans = [float(np.nanmax(trial[c]) - np.nanmin(trial[c])) for c in names]
    return all(span < 1e-9 for span in spans)


def pooled(reports: Iterable[CheckReport], ship: Ship | None = None) -> tuple[dict[str, float], list[str]]:
    """Seconds per coefficient group over all ``reports``, and sentences about groups that are not excited.

    ship: whose coefficients are named in these sentences; groups of which it has none are left out.
    """
    found = [numbers for report in reports if (numbers := report.numbers.get("excitation"))]
    seconds = {name: sum((numbers["group_seconds"][name] for numbers in found), 0.0) for name in GROUPS}
    return seconds, _missing(seconds, sum(numbers["seconds"] for numbers in found), ship)


def _sentences(numbers: dict[str, Any]) -> list[Found]:
    findings: list[Found] = []
    if numbers["inputs_constant"]:
        findings.append((DOUBTFUL, "nothing_to_identify", "No actuator ever changes: nothing to identify."))
    share = ", ".join(f"{QUADRANTS[k]} {v:.0%}" for k, v in numbers["quadrants"].items() if v >= 0.005)
    findings.append((INFO, "quadrants", f"Share of time: {share}."))
    return findings + [(INFO, "not_excited", text) for text in _missing(numbers["group_seconds"], numbers["seconds"])]


def _missing(seconds: dict[str, float], total: float, ship: Ship | None = None) -> list[str]:
    """Never excited: one sentence per group; hardly excited: one sentence for all of them."""
    symbols = {name: _symbols(pattern, ship) for name, (_, pattern) in GROUPS.items()}
    asked = [name for name in seconds if ship is None or symbols[name]]
    never = [name for name in asked if seconds[name] <= 0]
    few = [name for name in asked if 0 < seconds[name] < max(ENOUGH, 0.02 * min(total, 2000.0))]
    behind = {name: f": {', '.join(found)} cannot be determined" if found else "" for name, found in symbols.items()}
    sentences = [f"Never {GROUPS[name][0]}{behind[name]}." for name in never]
    if few:
        own = {name: f" ({', '.join(found)})" if found else "" for name, found in symbols.items()}
        listed = "; ".join(f"{GROUPS[k][0]} {seconds[k]:.1f} s{own[k]}" for k in few)
        sentences.append(f"Hardly excited: {listed}.")
    return sentences


def _symbols(pattern: str, ship: Ship | None) -> list[str]:
    """Coefficients of the ``ship`` that are free and fit the ``pattern``."""
    return [s for s in ship.free if re.fullmatch(pattern, s)] if ship else []


def _windy(trial: Trial, good: np.ndarray) -> np.ndarray:
    """Rows with a true wind stronger than the ship's speed, if it comes from more than a 60 deg sector."""
    if not trial.has_wind:
        return np.zeros(len(trial), bool)
    angle = trial["wind_direction"] - trial["psi"]
    strong = good & np.isfinite(angle) & (trial["wind_speed"] > np.hypot(trial["u"], trial["v"]))
    sectors = np.unique(np.floor((angle[strong] % (2 * math.pi)) / math.radians(30)))
    return strong & (len(sectors) > 2)
