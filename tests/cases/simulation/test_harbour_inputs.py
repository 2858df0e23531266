"""Random use of every actuator: ranges, rates, independence, reproducibility; a craft without propeller and rudder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.criteria.standard_runs import simulated_trial
from cases.io.read import read_trials
from cases.maneuvers.definitions import Limits
from cases.shipfiles.ship_file import load_ship, parse_ship
from cases.simulation.harbour_inputs import harbour_inputs, harbour_seed, ranges_of
from cases.simulation.simulate import write_trial
from mmg.errors import OutOfRange, UserError
from mmg.messages import has_code
from mmg.motion.flow import INPUTS
from mmg.ship import Ship
from tests.support.actuator_ships import FERRY as FOUR_PODS

VECTWIN, FERRY = load_ship("vectwin_3m"), parse_ship(FOUR_PODS)


@pytest.mark.parametrize("ship", [VECTWIN, FERRY, load_ship("kvlcc2_full")], ids=lambda ship: ship.name)
def test_every_actuator_moves_within_its_range_and_rate_and_by_itself(ship: Ship) -> None:
    trial = harbour_inputs(ship, 20000.0, 3)
    positions = np.column_stack([trial[name] for name in ranges_of(ship)])
    for name, (low, high) in ranges_of(ship).items():
        values = trial[name]
        assert low <= values.min() < values.max() <= high
        assert values.max() - values.min() > 0.8 * (high - low)
        rate = Limits.for_length(ship.particulars["L"])
        most = rate.rudder_rate if INPUTS[name][1] == "rad" else rate.propeller_rate
        assert np.abs(np.diff(values)).max() <= most * (trial["t"][1] - trial["t"][0]) + 1e-9
    others = [i for i, name in enumerate(ranges_of(ship)) if not (ship is VECTWIN and name.startswith("delta"))]
    correlation = np.corrcoef(positions[:, others].T) - np.eye(len(others))
    assert np.abs(correlation).max() < 0.15
    assert set(ranges_of(ship)) == set(ship.actuators)


def test_the_vectwin_ship_goes_astern_for_a_part_of_the_time() -> None:
    run = simulated_trial(VECTWIN, "harbour:4", noise=True)
    more = [simulated_trial(VECTWIN, f"harbour:{seed}")["u"] for seed in range(6)]
    share = float((np.concatenate(more) < 0).mean())
    assert 0.03 < share < 0.6
    assert run.duration == 400.0 and run["u"][0] == pytest.approx(0.0, abs=0.05)


def test_the_same_seed_gives_the_same_inputs_and_another_one_others() -> None:
    one, same, other = (harbour_inputs(FERRY, 100.0, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one["azimuth_4"], same["azimuth_4"])
    assert np.abs(one["azimuth_4"] - other["azimuth_4"]).max() > 0.1


def test_wrong_seeds_and_durations_are_one_line() -> None:
    assert (
        harbour_seed("harbour:12", 3) == 12
        and harbour_seed("harbour", 3) == 3
        and harbour_seed("turning:35", 3) is None
    )
    with pytest.raises(UserError, match="seed"):
        harbour_seed("harbour:x", 0)
    with pytest.raises(OutOfRange):
        harbour_inputs(FERRY, 0.1, 0)


def test_a_trial_of_pods_alone_is_read_without_columns_of_propeller_and_rudder(tmp_path: Path) -> None:
    run = simulated_trial(FERRY, "harbour:1")
    path = tmp_path / "run.csv"
    write_trial(run, path)
    frame = run.to_pandas().drop(columns=[name for name in run.to_pandas() if name.split()[0] in ("n", "delta")])
    frame.to_csv(path, index=False)
    (read,) = read_trials([path])
    assert not read["n"].any() and not read["delta"].any() and has_code(read.notices, "no_propeller")
    np.testing.assert_allclose(read["azimuth_3"], run["azimuth_3"], rtol=1e-12)
