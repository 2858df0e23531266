"""Spikes and a rate that is too low are said; smooth motions, steps and gaps are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.checks import check
from cases.checks.single import spikes
from cases.trial_set import MOST_LISTED, TrialSet, shared_rows
from tests.support.trial_files import make_trial, motion_columns


def codes(trial: object) -> set[str]:
    (report,) = check([trial])  # type: ignore[list-item]
    return {finding.code for finding in report.findings}


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_spike_is_a_single_sample_off_both_neighbours(noise: float) -> None:
    t = np.linspace(0.0, 60.0, 601)
    values = np.sin(0.2 * t) + noise * np.random.default_rng(1).normal(size=len(t))
    assert spikes(values) == 0 and spikes(np.sign(values)) == 0
    values[[100, 300, 500]] += (3.0, -4.0, 5.0)
    assert spikes(values) == 3
    values[200:260] = np.nan
    assert spikes(values) == 3 and spikes(np.full(50, np.nan)) == 0 and spikes(values[:2]) == 0


def test_spikes_are_doubtful_and_named() -> None:
    good = make_trial()
    r = good["r"].copy()
    r[[500, 900]] += 40 * r.std()
    assert "spikes" not in codes(good)
    (report,) = check([make_trial(r=r)])
    (found,) = [finding for finding in report.findings if finding.code == "spikes"]
    assert report.verdict == "doubtful" and "2 in r" in found.text


def test_a_heading_that_turns_far_between_samples_is_sampled_too_coarsely() -> None:
    columns = motion_columns()
    columns["r"] = 0.05 * np.sign(np.sin(0.05 * columns["t"]))
    assert "coarse_sampling" not in codes(make_trial(**columns))
    thin = {name: values[::100] for name, values in columns.items()}
    assert "coarse_sampling" in codes(make_trial(**thin))


def test_copies_of_a_trial_are_left_out_and_named() -> None:
    late = make_trial("late", t=make_trial()["t"] + 1000.0)
    other = make_trial("other", u=make_trial()["u"] + 0.01)
    copies = [make_trial(f"run {k}") for k in range(50)]
    kept, (message,) = TrialSet.of([*copies, late, other]).training()
    assert [trial.name for trial in kept] == ["run 0", "other"] and message.code == "copies_left_out"


def test_many_pairs_that_share_rows_are_few_lines() -> None:
    trials = [make_trial(f"run {k}", x=make_trial()["x"] + k) for k in range(8)]
    messages = shared_rows(trials, ())
    assert len(messages) == MOST_LISTED + 1 and "23" in messages[-1]


def test_a_file_that_lies_in_two_campaigns_counts_for_the_first_which_is_said() -> None:
    first, again = (replace(make_trial(f"run_{day}"), path=None) for day in ("2026-03-01", "2026-03-02"))
    kept, (_, message) = TrialSet.of([first, again, make_trial("other", u=make_trial()["u"] + 0.01)]).training()
    assert [trial.name for trial in kept] == ["run_2026-03-01", "other"]
    assert message.code == "same_file_in_two_campaigns" and "2026-03-01" in message
