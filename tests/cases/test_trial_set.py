"""A set of trials works out what is known of it once, and is made of files, folders and trials alike."""

from pathlib import Path

import numpy as np
import pytest

from cases.checks import check
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from cases.trial_set import TrialSet
from mmg.errors import UserError
from tests.support.trial_files import make_trial


def test_files_folders_and_trials_make_the_same_set(tmp_path: Path) -> None:
    trials = [make_trial(name) for name in ("a", "b")]
    for trial in trials:
        write_trial(trial, tmp_path / f"{trial.name}.csv")
    of_folder, of_files = TrialSet.of(tmp_path), TrialSet.of([tmp_path / "a.csv", trials[1]])
    assert [t.name for t in of_folder] == [t.name for t in of_files] == ["a", "b"]
    np.testing.assert_allclose(of_folder[0]["u"], trials[0]["u"], atol=1e-6)
    assert TrialSet.of(of_files) is of_files and of_files[:1] == (of_files.trials[0],) and len(of_files) == 2
    with pytest.raises(UserError):
        TrialSet.of(tmp_path / "absent.csv")


def test_what_is_known_is_worked_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    counted = lambda trials, copies: calls.append(len(trials)) or check(trials, copies)  # noqa: E731
    monkeypatch.setattr("cases.trial_set.check", counted)
    some = TrialSet.of([make_trial("a")])
    assert some.reports is some.reports and some.sound is some.sound and some.copies is some.copies
    assert calls == [1]


def test_a_measured_column_is_its_own_root_and_a_derived_one_rests_on_others() -> None:
    columns = make_trial().columns
    trial = Trial("a", columns, ancestors={"u": ("x", "y", "psi"), "r": ("psi",), "n": ()})
    assert trial.roots("u", "v") == {"x", "y", "psi", "v"} and trial.roots("n") == frozenset()
    assert trial.measured("psi") and not trial.measured("u") and not trial.measured("n_2")
