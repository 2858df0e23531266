from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.io.units import FACTORS, accepted, to_si
from cases.quantities import UNITS, is_canonical, quantity
from mmg.errors import UserError


@pytest.mark.parametrize(
    ("column", "unit", "factor"),
    [
        ("psi", "deg", math.pi / 180), ("u", "kn", 1852 / 3600), ("r", "deg/s", math.pi / 180),
        ("n", "rpm", 1 / 60), ("n_3", "rpm", 1 / 60),
        ("t", "s", 1.0), ("x", "m", 1.0), ("delta", "Degrees", math.pi / 180),
    ],
)  # fmt: skip
def test_contract_units_convert_to_si(column, unit, factor):
    assert to_si(column, unit, "here") == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("column", sorted(UNITS))
def test_every_canonical_column_accepts_its_si_unit(column):
    assert to_si(column, quantity(column).unit, "here") == 1.0
    assert accepted(column)[0] == quantity(column).unit


def test_an_unknown_unit_is_named_with_the_place_and_the_accepted_ones():
    with pytest.raises(UserError, match=r"run.csv.*'psi \[grad\]'.*'grad'.*rad, deg"):
        to_si("psi", "grad", "run.csv: column 'psi [grad]'")


@settings(max_examples=30)
@given(st.sampled_from(sorted(UNITS)), st.text(max_size=8))
def test_a_unit_is_either_known_or_a_user_error(column, unit):
    try:
        assert to_si(column, unit, "here") in FACTORS[quantity(column).unit].values()
    except UserError as error:
        assert "\n" not in str(error).replace(unit, "")


def test_several_propellers_are_canonical():
    assert is_canonical("n_2") and is_canonical("n_4") and not is_canonical("n_22")
