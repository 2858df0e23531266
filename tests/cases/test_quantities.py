"""The registry of quantities agrees with itself, with the actuators of the model and with the units."""

import pytest

from cases.importing.vocabulary import meaning
from cases.io.units import FACTORS
from cases.quantities import QUANTITIES, UNITS, is_canonical, quantity
from mmg.motion.flow import INPUTS
from mmg.states import STATES


def test_every_state_and_actuator_of_the_model_is_a_quantity_in_its_unit():
    assert {"t", *STATES, *INPUTS} <= set(UNITS)
    assert all(UNITS[name] == unit for name, (_, unit) in INPUTS.items())


@pytest.mark.parametrize("row", QUANTITIES.values(), ids=lambda row: row.name)
def test_a_row_agrees_with_itself(row):
    assert not row.unit or row.unit in FACTORS
    assert row.limits[0] < row.limits[1] and row.mirror in (1, -1)
    assert not row.partner or QUANTITIES[row.partner].partner == row.name
    if row.partner:
        other = QUANTITIES[row.partner]
        assert (other.unit, other.period, other.mirror, other.between) == (
            row.unit,
            row.period,
            row.mirror,
            row.between,
        )
    assert not row.compass or row.wraps
    if row.canonical or row.unit:
        assert meaning(row.name).quantity == row.name


def test_a_third_propeller_is_as_the_second():
    assert quantity("n_3").unit == "rps" and is_canonical("n_3")
    with pytest.raises(KeyError):
        quantity("n_22")
