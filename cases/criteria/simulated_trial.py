"""From a ship and a manoeuvre, or recorded inputs, to a trial, with wind and noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cases.criteria.standard_runs import check_completeness
from cases.io.campaigns import ship_in
from cases.io.read import read_controls
from cases.maneuvers.definitions import Maneuver, parse_maneuver
from cases.simulation.gusts import Wind, parse_wind
from cases.simulation.harbour_inputs import harbour_inputs, harbour_seed
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate, simulate_controls
from cases.trial import Trial
from mmg.errors import Conflict
from mmg.messages import Message
from mmg.ship import Ship


def simulated_trial(
    ship: Ship,
    maneuver: str | Maneuver | None = None,
    controls: str | Path | Trial | None = None,
    wind: str | Wind | None = None,
    noise: bool = False,
    seed: int = 0,
    dt: float | None = None,
) -> Trial:
    """The motion of a ship in a manoeuvre or under recorded inputs, as a trial.

    maneuver: text as for ``parse_maneuver``, "harbour:SEED" for random use of all actuators from rest, or a
    ``Maneuver``, for another speed, duration or rudder rate; controls: a trial or its file, whose inputs and wind are
    followed from its first state; give one of the two. wind:
    "speed:direction[:gusty]" in m/s and degrees it comes from, default calm air, or the wind of the controls; noise:
    white sensor noise on the states; seed: of gusts, noise and random manoeuvres; dt: sampling interval [s] of a
    manoeuvre, default 0.1. Raises UserError for what cannot be read or simulated, and when a manoeuvre misses its first
    event.
    """
    if (maneuver is None) == (controls is None):
        raise Conflict("give either a manoeuvre or controls, one of them")
    air = parse_wind(wind) if isinstance(wind, str) else wind
    if isinstance(maneuver, str) and (own := harbour_seed(maneuver, seed)) is not None:
        maneuver, controls = None, harbour_inputs(ship, None, own, dt)
    if maneuver is not None:
        plan = parse_maneuver(maneuver, ship, seed=seed) if isinstance(maneuver, str) else maneuver
        trial = simulate(ship, plan, 0.1 if dt is None else dt, air, seed)
        trial = replace(trial, notices=trial.notices + check_completeness(trial, plan))
    else:
        source = controls if isinstance(controls, Trial) else read_controls(Path(str(controls)), ship.actuators)
        trial = simulate_controls(ship_in(ship, [source])[0], source, air, seed)
        replaced = air is not None and source.has_wind
        more = (Message("the wind of the file is replaced by --wind", "wind_replaced"),) if replaced else ()
        trial = replace(trial, notices=(*source.notices, *more, *trial.notices))
    return add_noise(trial, SensorNoise.for_length(ship.particulars["L"]), seed) if noise else trial
