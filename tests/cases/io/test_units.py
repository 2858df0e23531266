from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.checks import check
from cases.io.conventions import through_north
from cases.io.read import read_trial
from cases.quantities import FACTORS, UNITS, accepted, is_canonical, quantity, to_si
from mmg.errors import UserError
from mmg_ident import simulate
from tests.support.trial_files import write_csv


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


RUN = simulate("kvlcc2_l7", "turning:35", dt=0.1, duration=300, noise=True)


def false_samples(every: int, shift: float) -> np.ndarray:
    """The heading of RUN, logged in numbers from 0 to 360 at each ``every``-th row and joined by straight lines."""
    angle = np.mod(RUN["psi"] + shift, 2 * np.pi)
    return np.interp(RUN.t, RUN.t[::every], angle[::every])


@pytest.mark.parametrize("every", [2, 5, 15])
@pytest.mark.parametrize("with_rate", [True, False])
def test_false_samples_are_mended(every: int, with_rate: bool) -> None:
    for shift in (0.0, 2.0):
        psi = false_samples(every, shift)
        mended, count = through_north(RUN.t, psi, RUN["r"] if with_rate else None)
        off = np.abs(np.angle(np.exp(1j * (mended - RUN["psi"] - shift))))
        assert count >= 1 and np.degrees(off.max()) < 1.5
        assert np.degrees(np.abs(np.angle(np.exp(1j * (psi - RUN["psi"] - shift)))).max()) > 20


def test_a_sound_heading_stays_as_it_is() -> None:
    for psi in (RUN["psi"], np.mod(RUN["psi"], 2 * np.pi), np.where(RUN.t > 100, RUN["psi"] + 0.3, RUN["psi"])):
        mended, count = through_north(RUN.t, psi, RUN["r"])
        assert count == 0 and (mended == psi).all()


def test_a_file_is_mended_on_reading_and_loses_no_row(tmp_path: Path) -> None:
    columns = {**RUN.columns, "psi": np.degrees(false_samples(5, 0.0))}
    path = write_csv(tmp_path / "turn.csv", columns, {"psi": "psi [deg]"}, rows=None)
    trial = read_trial(path)
    assert "heading_mended" in [note.code for note in trial.notices]
    (report,) = check([trial])
    assert report.numbers["stretches"]["broken"] == []
