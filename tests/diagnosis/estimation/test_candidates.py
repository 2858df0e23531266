"""The effects that a diagnosis adds to a ship are those that its force models can carry."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.generated_ship import generated_ship, structure_of
from cases.shipfiles.ship_file import load_ship
from diagnosis.estimation.candidates import ship_with_all_effects
from mmg.model import assemble
from mmg.ship import Ship

ESSO = load_ship("esso_osaka_3m")
GENERATED = generated_ship(ESSO, structure_of(ESSO, 2, "SM-2"))


@pytest.mark.parametrize("ship", [GENERATED, load_ship("mariner")], ids=lambda ship: ship.name)
def test_a_ship_without_propeller_and_rudder_models_gets_the_other_effects(ship: Ship) -> None:
    full = ship_with_all_effects(ship)
    named = {candidate.effect for candidate in full.candidates}
    assert {"current", "tow"} <= named and "rudder_stall" not in named
    model, bare = assemble(full.ship), assemble(ship)
    state = np.array(model.initial([0, 0, 0, 0.3, 0.02, 0.01], np.zeros(len(model.controls)), full.ship.values))
    rates = np.array(model.rates(state, np.zeros(len(model.controls)), full.ship.values))[3:6]
    own = np.array(bare.rates([0, 0, 0, 0.3, 0.02, 0.01], np.zeros(len(bare.controls)), ship.values))[3:6]
    np.testing.assert_allclose(rates, own, atol=1e-6)
