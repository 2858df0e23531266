"""An interrupted choice goes on: finished parts are taken from the run folder, those of another one refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.report.parts import Store, hashes_of_trials
from fitting.report.run_folder import plain
from fitting.selection import learning
from fitting.selection.candidates import candidate
from fitting.selection.learning import Learned, kept_run, learn_all
from fitting.settings import Settings
from mmg.errors import Conflict, UserError
from tests.fitting.selection.paper_problems import ESSO, harbour

NAMES = ("sm1-order1", "sm2-order1")


def stored(folder: Path, resume: bool = False, **about: object) -> Store:
    return Store(folder / "learned", about, resume)


def test_parts_of_another_choice_are_refused_and_named(tmp_path: Path) -> None:
    wanted = {"--seed": 1, "trials": hashes_of_trials(harbour())}
    store = stored(tmp_path, **wanted)
    store.open()
    part = Learned("one", 1, {"X_u": 0.1 + 0.2}, (), 1e-17, float("nan"), 1.0, 2.0, 3, ())
    store.save("one", plain(part))
    with pytest.raises(UserError, match="--seed"):
        stored(tmp_path, True, **wanted | {"--seed": 2}).open()
    with pytest.raises(Conflict):
        stored(tmp_path, True, **wanted | {"trials": hashes_of_trials(harbour()[:2])}).open()
    again = stored(tmp_path, True, **wanted)
    again.open()
    assert repr(kept_run(again, "one")) == repr(part)
    assert kept_run(again, "two") is None


@pytest.mark.slow
def test_learned_runs_are_taken_up_and_the_result_is_that_without_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1, 1e-3))
    runs, ones = harbour(), [candidate(ESSO, name) for name in NAMES]
    trials, settings = (runs[:2], runs[2:]), Settings()
    whole = learn_all(ones, trials, settings, 2)
    store = stored(tmp_path)
    learn_all(ones[:1], trials, settings, 2, store)
    done: list[str] = []
    original = learning.learn_one

    def counted(run, **given):  # type: ignore[no-untyped-def]
        done.append(f"{run[0].name}_seed{run[1]}")
        return original(run, **given)

    monkeypatch.setattr(learning, "learn_one", counted)
    resumed = learn_all(ones, trials, settings, 2, stored(tmp_path, resume=True))
    assert done == ["sm2-order1_seed0", "sm2-order1_seed1"]
    for name in NAMES:
        assert [run.values for run in resumed[name]] == [run.values for run in whole[name]]
        assert [run.validation for run in whole[name]] == sorted(run.validation for run in whole[name])
        assert {run.seed for run in whole[name]} == {0, 1}


def test_a_learned_run_survives_its_file_to_the_last_digit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1,))
    runs, store = harbour(), stored(tmp_path)
    one = learn_all([candidate(ESSO, "sm1-order1")], (runs[:2], runs[2:]), Settings(), store=store)["sm1-order1"][0]
    assert kept_run(store, "sm1-order1_seed0") == one
    assert one.lessons and one.values.keys() == set(candidate(ESSO, "sm1-order1").ship.free)


def test_a_broken_part_is_made_again(tmp_path: Path) -> None:
    store = stored(tmp_path)
    store.open()
    store.save("one", {})
    assert kept_run(store, "one") is None
