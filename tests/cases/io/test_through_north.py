"""A heading that was interpolated through 360 the long way is mended, and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.checks import check
from cases.io.read import read_trial
from cases.io.through_north import through_north
from mmg_ident import simulate
from tests.support.trial_files import write_csv

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
