"""Trials and ships of which no calibration can make sense are met with a statement, never with a confident answer."""

from __future__ import annotations

import pytest

from benchmarks.hostility import CASES, said

EXPECTED = {
    "all coefficients times 3": {"far_from_prior", "implausible", "not_described"},
    "trials of a 7 m ship": {"at_bound", "far_from_prior", "not_described"},
    "trials of a ship of 320 m": {"at_bound", "far_from_prior", "not_described"},
    "constant inputs": {"nothing_to_identify", "refused"},
    "all astern": {"not_excited_ahead"},
    "0.1 Hz": {"coarse_sampling", "refused"},
    "10,000 rows of gaps": {"gaps", "missing_samples"},
    "spikes": {"spikes", "worse_after"},
    "one run fifty times": {"duplicate", "copies_left_out"},
}
"""Case -> what must be said of it, at least."""


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CASES))
def test_what_is_said(name: str) -> None:
    found = said(name)
    assert EXPECTED.get(name, set()) <= found.codes, found.codes
    if name not in EXPECTED:
        assert found.converged and not found.warnings
