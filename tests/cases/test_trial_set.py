"""A set of trials works out what is known of it once, and is made of files, folders and trials alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.checks import check
from cases.shipfiles.ship_file import load_ship
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


def test_a_trial_is_a_table_with_the_headers_of_a_trial_file():
    trial = Trial("a<b", {"t": np.arange(3.0), "u": np.array([1.0, np.nan, 3.0]), "n_3": np.zeros(3)})
    assert list(trial.to_pandas()) == ["t [s]", "u [m/s]", "n_3 [rps]"]
    page = trial._repr_html_()
    assert "a&lt;b" in page and "u [m/s]" in page and "<td>2</td>" in page


def test_a_ship_is_a_table_of_its_coefficients():
    ship = load_ship("esso_osaka_3m")
    table = ship.to_pandas()
    assert table.loc["Y_v", "value"] == ship.coefficients["Y_v"].value and tuple(table.index) == ship.symbols
    assert "esso_osaka_3m" in ship._repr_html_() and "Y_v" in ship._repr_html_()


def test_the_rudder_of_a_trial_is_its_own_the_mean_of_two_or_none():
    t = np.arange(3.0)
    columns = {"t": t, "delta_port": 0.2 * t, "delta_starboard": 0.4 * t}
    np.testing.assert_allclose(Trial("twin", columns).rudder, 0.3 * t)
    np.testing.assert_array_equal(Trial("single", {**columns, "delta": t}).rudder, t)
    np.testing.assert_array_equal(Trial("azimuth", {"t": t}).rudder, np.zeros(3))
