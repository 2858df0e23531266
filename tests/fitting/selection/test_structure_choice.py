"""Choice of a structure: what trials cannot determine is refused, evidence thins out, the best is chosen and tested."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.report.parts import Store, hashes_of_trials
from fitting.report.run_folder import plain
from fitting.selection import learning
from fitting.selection.candidates import Rules, StructureCandidate, candidate, candidates
from fitting.selection.learning import Learned, kept_run, learn_all
from fitting.selection.structure_choice import BEYOND, bounded, choose_structure, fault, stability
from fitting.settings import Settings
from fitting.solvers.control import INTERRUPTED
from mmg.errors import Conflict, Unsupported, UserError
from mmg_ident.commands.main import main
from tests.fitting.selection.paper_problems import ESSO, harbour

pytestmark = pytest.mark.usefixtures("blank_figures")


def ahead_only() -> Trial:
    run = harbour(1, 200.0)[0]
    return Trial("ahead", {**run.columns, "u": np.abs(run["u"]) + 0.01})


def test_a_candidate_that_needs_astern_motion_or_more_samples_is_refused_with_counts() -> None:
    assert not fault(candidate(ESSO, "sm1-order1"), [ahead_only()])
    told = fault(candidate(ESSO, "sm4-order1"), [ahead_only()])
    assert "sm4-order1 (SM-4)" in told and "of 201" in told
    told = fault(candidate(ESSO, "sm2-order3"), harbour(1, 200.0))
    assert "223 unknowns" in told and "only 201 samples" in told
    runs = harbour(2, 200.0)  # and one that was named is an error
    with pytest.raises(UserError, match=r"'astern' \(0 .*201"):
        choose_structure(ESSO, [candidate(ESSO, "sm2-order1")], ([ahead_only()], runs[1:], ()), named=True)
    with pytest.raises(UserError, match=r"\b1 .*\b0 "):
        choose_structure(ESSO, [candidate(ESSO, "sm2-order1")], (runs[:1], (), ()))


@pytest.mark.slow
def test_a_polynomial_that_runs_away_does_not_within_the_range_of_the_trials(tmp_path: Path) -> None:
    made = candidate(ESSO, "sm1-order3").ship.with_values({"X_n_1": 0.02, "X_u_1": -0.02})
    row = made.coefficients["X_u_u_u_1"]
    pushed = made.with_coefficients({"X_u_u_u_1": row.with_(value=0.5, upper=1.0)})
    held = bounded(pushed, harbour(2, 200.0))
    most = max(run["u"].max() for run in harbour(2, 200.0))
    assert held.particulars["u_ahead"] == pytest.approx(BEYOND * most, rel=1e-3)
    assert stability(pushed, 20).diverged > 0 and stability(held, 20).diverged == 0
    (tmp_path / "held.toml").write_text(dump_ship(held))
    assert load_ship(tmp_path / "held.toml").particulars == held.particulars


def test_a_physical_ship_is_stable_and_one_that_pushes_itself_is_not() -> None:
    good = stability(ESSO, 20)
    assert (good.sequences, good.diverged) == (20, 0) and 0.1 < good.speed < 1.0
    made = candidate(ESSO, "sm1-order1").ship.with_values({"X_u_1": 0.0, "Y_v_1": 0.0, "N_r_1": 0.0, "X_n_1": 0.02})
    broken = made.with_coefficients({"X_u_1": made.coefficients["X_u_1"].with_(value=2.0, upper=3.0)})
    assert stability(broken, 20).diverged == 20


@pytest.mark.longest
@pytest.mark.slow
def test_the_choice_has_less_error_than_the_start_thins_out_and_is_a_whole_run(tmp_path: Path) -> None:
    """From a ship whose coefficients are off, the polynomial learns from trials; the table has all that was tried."""
    runs = harbour(4, 200.0)
    wrong = ESSO.with_values({"Y_v": -0.2, "N_v": -0.08, "t_P": 0.4, "C_D": 0.6})
    given = [candidate(wrong, name, Rules(order=2)) for name in ("sm1-order1", "sm1-order2")]
    choice = choose_structure(wrong, given, (runs[:2], runs[2:3], runs[3:]), Settings(passes=1, compiled=False))
    rows = {row.name: row for row in choice.table}
    assert {"as given", "sm1-order1", "sm1-order2"} <= set(rows)
    assert sum(name.endswith("-thinned") for name in rows) >= 1
    assert choice.chosen in rows and np.isfinite(rows[choice.chosen].validation)
    thin = next(row for name, row in rows.items() if name.endswith("-thinned"))
    assert thin.unknowns < rows[thin.name.removesuffix("-thinned")].unknowns
    assert choice.test["chosen"] < choice.test["as given"]
    assert choice.stability.sequences == 1000
    best = min(row.validation for row in rows.values())
    assert rows[choice.chosen].validation <= 1.02 * best or rows[choice.chosen].stable == 1000

    def beside(folder: Path) -> None:
        (folder / "selection.json").write_text(json.dumps(choice.to_dict()))

    saved = choice.result.save(tmp_path / "run", attach=beside)
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert all(f"<td>{name}</td>" in page or f"<b>{name}</b>" in page for name in rows)
    assert f"{choice.test['chosen']:.3g}" in page
    assert saved.folder is not None and load_ship(tmp_path / "run").monomials == choice.result.ship.monomials


@pytest.mark.slow
def test_ctrl_c_within_one_fit_ends_the_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver returns its best iterate then, which is no estimate to choose by."""

    def interrupted(*arguments: Any, **options: Any) -> Calibration:
        found = estimate_coefficients(*arguments, **options)
        monkeypatch.setattr(INTERRUPTED, "requested", True)
        return found

    monkeypatch.setattr("fitting.selection.structure_choice.estimate_coefficients", interrupted)
    runs, given = harbour(3, 200.0), [candidate(ESSO, "mmg")]
    with pytest.raises(KeyboardInterrupt):
        choose_structure(ESSO, given, (runs[:2], runs[2:], ()), Settings(passes=1, max_iterations=2, compiled=False))


@pytest.mark.longest
@pytest.mark.slow
def test_the_command_writes_a_run_folder_that_is_a_ship(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for run in harbour(3, 120.0):
        write_trial(run, tmp_path / f"{run.name}.csv")
    out = tmp_path / "chosen"
    line = ["select", "esso_osaka_3m", str(tmp_path), "--only", "sm1-order1", "--out", str(out), "--json"]
    assert main(line) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["chosen"].startswith("sm1-order1")
    assert json.loads((out / "selection.json").read_text())["candidates"] == told["candidates"]
    assert (out / "selection.json").exists() and (out / "report.html").exists()
    assert load_ship(out).monomials
    assert main(line) == 2
    assert "exists" in capsys.readouterr().err


def test_candidates_go_from_few_terms_to_many_and_a_generated_ship_has_none() -> None:
    found = candidates(ESSO)
    assert isinstance(found[0], StructureCandidate) and found[0].name == "mmg"
    assert list(map(sum, (one.counts for one in found))) == sorted(sum(one.counts) for one in found)
    with pytest.raises(Unsupported):
        candidates(found[1].ship)


# mmg select --objective paper: a run folder like any other, with learning curves; wrong options in one line
@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    paths = [tmp_path / f"h{number}.csv" for number in range(3)]
    for path, run in zip(paths, harbour(), strict=True):
        write_trial(run, path)
    return [str(path) for path in paths]


@pytest.mark.longest
@pytest.mark.slow
def test_a_chosen_polynomial_has_a_run_folder_with_its_learning_curves(
    tmp_path: Path, files: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1, 1e-2))
    out = tmp_path / "run"
    wanted = ["--objective", "paper", "--only", "sm1-order1", "--out", str(out), "--seeds", "2"]
    assert main(["select", "esso_osaka_3m", *files[:2], "--validate", files[2], *wanted]) in (0, 1)
    assert "objective" in capsys.readouterr().out
    content = json.loads((out / "selection.json").read_text())
    rows = content["learned"]
    assert {(row["name"], row["seed"]) for row in rows} == {("sm1-order1", 0), ("sm1-order1", 1)}
    lines = (out / "learning.csv").read_text().splitlines()
    assert len(lines) > 5 and lines[0].startswith("candidate,seed,evaluations,seconds,objective")
    chosen = load_ship(out)
    assert content["chosen"] == "sm1-order1"
    best = min(rows, key=lambda row: row["validation"])
    assert len(chosen.monomials) == len(candidate(ESSO, "sm1-order1").ship.monomials) - best["terms_left_out"]
    assert sorted(path.stem for path in (out / "learned").glob("sm1*.json")) == ["sm1-order1_seed0", "sm1-order1_seed1"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--objective", "luck"], "--objective"),
        (["--optimizer", "cmaes"], "--optimizer is gone"),
        (["--seeds", "2"], "--seeds"),
        (["--objective", "paper", "--seeds", "0"], "--seeds"),
        (["--workers", "0"], "--workers 0"),
        (["--objective", "paper", "--only", "sm4-order3"], "unknowns, but the trials hold only 221 samples"),
    ],
)
def test_wrong_options_are_one_line(
    options: list[str], told: str, tmp_path: Path, files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["select", "esso_osaka_3m", files[0], "--validate", files[2], "--out", str(tmp_path / "run"), *options]
    assert main(line) == 2
    assert told in capsys.readouterr().err
    assert not list(tmp_path.glob("run*"))


# An interrupted choice goes on: finished parts are taken from the run folder, those of another one refused
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
    again.save("two", {})  # a broken part is made again
    assert kept_run(again, "two") is None


@pytest.mark.longest
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


@pytest.mark.slow
def test_a_learned_run_survives_its_file_to_the_last_digit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1,))
    runs, store = harbour(), stored(tmp_path)
    one = learn_all([candidate(ESSO, "sm1-order1")], (runs[:2], runs[2:]), Settings(), store=store)["sm1-order1"][0]
    assert kept_run(store, "sm1-order1_seed0") == one
    assert one.lessons and one.values.keys() == set(candidate(ESSO, "sm1-order1").ship.free)
