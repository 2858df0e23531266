"""Conditions of trials beside those that IMO asks for (MSC/Circ.1053, 2.2.1.2): what is known, and what is not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.io.site import NAME, read_site
from cases.trial import Trial
from mmg.errors import UserError
from mmg.ship import Ship

FULFILLED, FAILED, UNKNOWN = "fulfilled", "not fulfilled", "unknown"
DEEP, STRONGEST_WIND, DRAUGHT = 4.0, 5, 0.05
"""Depth over draught, Beaufort number, and deviation from the full-load draught that the circular allows."""
CURRENTS = ("current",)


@dataclass(frozen=True)
class Condition:
    """One condition: what it is, what was found, what IMO asks for, and "fulfilled", "not fulfilled" or "unknown"."""

    name: str
    found: str
    asked: str
    verdict: str


def beaufort(speed: float) -> int:
    """Beaufort number of a wind ``speed`` [m/s] at 10 m height: v = 0.836 B^1.5 (World Meteorological Organization)."""
    return min(12, round((max(speed, 0.0) / 0.836) ** (2 / 3)))


def condition_rows(ship: Ship, trials: Sequence[Trial], full_load: float | None = None) -> list[Condition]:
    """The conditions of ``trials`` of a ``ship`` beside those that the circular asks for.

    trials: those whose files are there, for wind, speed and the site file beside them; full_load: draught of the fully
    loaded ship [m], at the length of the ship file, None where it is not known.
    """
    return [
        _depth(ship, trials), _wind(ship, trials), _sea(), _current(ship), _loading(ship, full_load),
        Condition("trim", "the ship file holds one draught", "even keel", UNKNOWN), _speed(ship, trials),
    ]  # fmt: skip


def _depth(ship: Ship, trials: Sequence[Trial]) -> Condition:
    asked, draught = f"more than {DEEP:g} draughts", ship.particulars["d"]
    paths = [trial.path for trial in trials if trial.path]
    try:
        share = read_site(paths, ship).start.get("shallow_water", {}).get("d_h")
    except UserError as error:
        return Condition("water depth", f"{NAME} cannot be used: {error}", asked, UNKNOWN)
    if share is None:
        return Condition("water depth", f"not stated: no [water] depth in {NAME} beside the trials", asked, UNKNOWN)
    verdict = FULFILLED if 1 / share > DEEP else FAILED
    return Condition("water depth", f"{draught / share:.3g} m, {1 / share:.2g} draughts", asked, verdict)


def _wind(ship: Ship, trials: Sequence[Trial]) -> Condition:
    asked, scale = f"not above Beaufort {STRONGEST_WIND}", ship.particulars.get("scale", 1.0)
    means = {t.name: float(np.nanmean(t["wind_speed"])) for t in trials if t.has_wind}
    if not means:
        why = "not logged" if trials else "the trial files are not there as they were"
        return Condition("wind", why, asked, UNKNOWN)
    strongest = max(means, key=lambda name: means[name])
    number = beaufort(means[strongest] * math.sqrt(scale))
    words = f"strongest mean {means[strongest]:.3g} m/s ({strongest}): Beaufort {number}"
    words += f" at the scale of the ship (1:{scale:g})" if scale != 1.0 else ""
    missing = len(trials) - len(means)
    words += f"; {missing} of {len(trials)} trials log no wind" if missing else ""
    verdict = FAILED if number > STRONGEST_WIND else UNKNOWN if missing else FULFILLED
    return Condition("wind", words, asked, verdict)


def _sea() -> Condition:
    return Condition("waves", "not stated: trial files hold no sea state", "not above sea state 4", UNKNOWN)


def _current(ship: Ship) -> Condition:
    values = [f"{c.symbol} = {c.value:.2g} {c.unit}" for c in ship.coefficients.values()
              if c.symbol.split(".")[0] in CURRENTS]  # fmt: skip
    found = f"fitted with the coefficients: {', '.join(values)}" if values else "not measured and not fitted"
    return Condition("current", found, "uniform only", UNKNOWN)


def _loading(ship: Ship, full_load: float | None) -> Condition:
    draught, asked = ship.particulars["d"], f"full-load draught within {DRAUGHT:.0%}"
    if full_load is None:
        words = f"draught {draught:g} m; the full-load draught is not stated (--full-load-draught)"
        return Condition("loading", words, asked, UNKNOWN)
    verdict = FULFILLED if abs(draught / full_load - 1) <= DRAUGHT else FAILED
    return Condition("loading", f"draught {draught:g} m, {draught / full_load:.0%} of {full_load:g} m", asked, verdict)


def _speed(ship: Ship, trials: Sequence[Trial]) -> Condition:
    asked = "at least 90 % of the speed at 85 % of the engine's output"
    speeds = [float(np.nanmedian(t["u"][t.t <= t.t[0] + 5.0])) for t in trials if np.isfinite(t["u"][:3]).any()]
    words = f"runs begin at u = {min(speeds):.3g} to {max(speeds):.3g} m/s; " if speeds else ""
    own = ship.particulars.get("U_0")
    words += f"U_0 of the ship file {own:g} m/s; " if own else ""
    return Condition("speed", f"{words}the speed at 85 % output is not stated", asked, UNKNOWN)
