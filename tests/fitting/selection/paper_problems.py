"""A small problem: a polynomial of first order for ESSO OSAKA in random harbour use."""

from __future__ import annotations

from functools import lru_cache

from cases.shipfiles.ship_file import load_ship
from cases.simulation.harbour_inputs import harbour_inputs
from cases.simulation.simulate import SensorNoise, add_noise, simulate_controls
from cases.trial import Trial
from fitting.selection.candidates import candidate
from fitting.selection.learning import Penalties, SubsequenceObjective

ESSO = load_ship("esso_osaka_3m").without_network()


@lru_cache(maxsize=4)
def harbour(count: int = 3, seconds: float = 220.0) -> tuple[Trial, ...]:
    """Runs of ESSO OSAKA with sensor noise, sampled each second."""
    noise = SensorNoise.for_length(3.0)
    runs = [simulate_controls(ESSO, harbour_inputs(ESSO, seconds, seed, 1.0)) for seed in range(count)]
    return tuple(add_noise(run, noise, seed) for seed, run in enumerate(runs))


def problem(name: str = "sm1-order1", penalties: Penalties | None = None) -> SubsequenceObjective:
    """The objective of the candidate ``name``: two runs to train on, one to validate."""
    runs = harbour()
    one = SubsequenceObjective(candidate(ESSO, name).ship, runs[:2], runs[2:])
    one.penalties = penalties or one.penalties
    return one
