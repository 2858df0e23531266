"""An interrupted choice goes on: finished parts are taken from beside the run folder, those of another one refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.selection import learning
from fitting.selection.candidates import candidate
from fitting.selection.learning import Learned, fingerprint, kept_beside, learn_all
from fitting.settings import Settings
from mmg.errors import Conflict, UserError
from tests.fitting.selection.paper_problems import ESSO, harbour

NAMES = ("sm1-order1", "sm2-order1")


def test_parts_of_another_choice_are_refused_and_named(tmp_path: Path) -> None:
    out = tmp_path / "run"
    wanted = fingerprint(ESSO, [harbour()]) | {"--seed": 1}
    assert kept_beside(out, wanted, resume=False).done_if_empty()
    kept = kept_beside(out, wanted, resume=False)
    part = Learned("one", 1, {"X_u": 0.1 + 0.2}, (), 1e-17, float("nan"), 1.0, 2.0, 3, ())
    kept.put("one", part)
    with pytest.raises(UserError, match=r"run.unfinished.*--resume"):
        kept_beside(out, wanted, resume=False)
    with pytest.raises(UserError, match="--seed"):
        kept_beside(out, wanted | {"--seed": 2}, resume=True)
    with pytest.raises(Conflict):
        kept_beside(out, wanted | fingerprint(ESSO, [harbour()[:2]]), resume=True)
    again = kept_beside(out, wanted, resume=True)
    assert repr(again.get("one")) == repr(part)
    assert again.get("two") is None
    assert not again.done_if_empty()
    again.done()
    assert not (tmp_path / "run.unfinished").exists()


@pytest.mark.slow
def test_learned_runs_are_taken_up_and_the_result_is_that_without_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1, 1e-3))
    runs, ones = harbour(), [candidate(ESSO, name) for name in NAMES]
    trials, settings = (runs[:2], runs[2:]), Settings()
    whole = learn_all(ones, trials, settings, 2)
    kept = kept_beside(tmp_path / "run", {}, resume=False)
    learn_all(ones[:1], trials, settings, 2, kept)
    done: list[str] = []
    original = learning.learn_one

    def counted(run, **given):  # type: ignore[no-untyped-def]
        done.append(f"{run[0].name}_seed{run[1]}")
        return original(run, **given)

    monkeypatch.setattr(learning, "learn_one", counted)
    resumed = learn_all(ones, trials, settings, 2, kept)
    assert done == ["sm2-order1_seed0", "sm2-order1_seed1"]
    for name in NAMES:
        assert [run.values for run in resumed[name]] == [run.values for run in whole[name]]
        assert [run.validation for run in whole[name]] == sorted(run.validation for run in whole[name])
        assert {run.seed for run in whole[name]} == {0, 1}


def test_a_learned_run_survives_its_file_to_the_last_digit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1,))
    runs, kept = harbour(), kept_beside(tmp_path / "run", {}, resume=False)
    one = learn_all([candidate(ESSO, "sm1-order1")], (runs[:2], runs[2:]), Settings(), kept=kept)["sm1-order1"][0]
    assert kept.get("sm1-order1_seed0") == one
    assert one.lessons and one.values.keys() == set(candidate(ESSO, "sm1-order1").ship.free)


def test_a_broken_part_is_one_line(tmp_path: Path) -> None:
    kept = kept_beside(tmp_path / "run", {}, resume=False)
    (tmp_path / "run.unfinished" / "one.json").write_text("{}")
    with pytest.raises(UserError, match="--resume"):
        kept.get("one")
