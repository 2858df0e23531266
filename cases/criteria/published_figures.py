"""Measured values of published free-running tests, beside which a simulation may be shown."""

from __future__ import annotations

SOURCE = (
    "MARIN free-running tests of KVLCC2 (SIMMAN 2008), re-reduced from the records in "
    "martinlarsalbert/System-identification-of-Vessel-Manoeuvring-Models, origin at the first rudder motion"
)

_KVLCC2 = {
    ("turning:35", "advance"): 3.09,
    ("turning:35", "transfer"): 1.35,
    ("turning:35", "tactical_diameter"): 3.33,
    ("turning:-35", "advance"): 3.02,
    ("turning:-35", "transfer"): 1.20,
    ("turning:-35", "tactical_diameter"): 3.07,
    ("zigzag:10/10", "overshoot_1"): 8.2,
    ("zigzag:10/10", "overshoot_2"): 21.9,
    ("zigzag:-10/10", "overshoot_1"): 9.5,
    ("zigzag:-10/10", "overshoot_2"): 15.0,
    ("zigzag:20/20", "overshoot_1"): 13.7,
    ("zigzag:20/20", "overshoot_2"): 14.9,
    ("zigzag:-20/20", "overshoot_1"): 15.1,
    ("zigzag:-20/20", "overshoot_2"): 13.3,
}

REFERENCES: dict[str, dict[tuple[str, str], float]] = {"kvlcc2_l7": _KVLCC2, "kvlcc2_full": _KVLCC2}
"""Ship name -> (manoeuvre, figure) -> value: lengths in L, angles in deg, positive rudder to starboard."""
