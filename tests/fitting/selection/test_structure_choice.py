"""Choice of a structure: what trials cannot determine is refused, evidence thins out, the best is chosen and tested."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.harbour_inputs import harbour_inputs
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate_controls, write_trial
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.selection.candidates import Rules, StructureCandidate, candidate, candidates
from fitting.selection.structure_choice import BEYOND, bounded, choose_structure, fault, stability
from fitting.settings import Settings
from fitting.solvers.control import INTERRUPTED
from mmg.errors import Unsupported, UserError
from mmg_ident.commands.main import main

ESSO = load_ship("esso_osaka_3m").without_network()


@lru_cache(maxsize=4)
def harbour(count: int = 4, seconds: float = 200.0) -> tuple[Trial, ...]:
    """Runs of ESSO OSAKA in random harbour use, with sensor noise."""
    noise = SensorNoise.for_length(3.0)
    runs = [simulate_controls(ESSO, harbour_inputs(ESSO, seconds, seed, 1.0)) for seed in range(count)]
    return tuple(add_noise(run, noise, seed) for seed, run in enumerate(runs))


def ahead_only() -> Trial:
    run = harbour(1)[0]
    return Trial("ahead", {**run.columns, "u": np.abs(run["u"]) + 0.01})


def test_trials_without_astern_motion_do_not_determine_sm4() -> None:
    one = candidate(ESSO, "sm4-order1")
    assert not fault(candidate(ESSO, "sm1-order1"), [ahead_only()])
    told = fault(one, [ahead_only()])
    assert "sm4-order1 (SM-4)" in told and "of 201" in told


def test_more_unknowns_than_samples_are_refused_with_both_counts() -> None:
    told = fault(candidate(ESSO, "sm2-order3"), harbour(1))
    assert "223 unknowns" in told and "only 201 samples" in told


def test_a_named_candidate_that_cannot_be_determined_is_an_error() -> None:
    runs = harbour(2)
    with pytest.raises(UserError, match=r"'astern' \(0 .*201"):
        choose_structure(ESSO, [candidate(ESSO, "sm2-order1")], ([ahead_only()], runs[1:], ()), named=True)
    with pytest.raises(UserError, match=r"\b1 .*\b0 "):
        choose_structure(ESSO, [candidate(ESSO, "sm2-order1")], (runs[:1], (), ()))


def test_a_polynomial_that_runs_away_does_not_within_the_range_of_the_trials(tmp_path: Path) -> None:
    made = candidate(ESSO, "sm1-order3").ship.with_values({"X_n_1": 0.02, "X_u_1": -0.02})
    row = made.coefficients["X_u_u_u_1"]
    pushed = made.with_coefficients({"X_u_u_u_1": row.with_(value=0.5, upper=1.0)})
    held = bounded(pushed, harbour(2))
    most = max(run["u"].max() for run in harbour(2))
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


@pytest.mark.slow
def test_the_choice_has_less_error_than_the_start_thins_out_and_is_a_whole_run(tmp_path: Path) -> None:
    """From a ship whose coefficients are off, the polynomial learns from trials; the table has all that was tried."""
    runs = harbour(4)
    wrong = ESSO.with_values({"Y_v": -0.2, "N_v": -0.08, "t_P": 0.4, "C_D": 0.6}).with_effect("velocity_filter")
    wrong = wrong.without_effect("velocity_filter")
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


def test_ctrl_c_within_one_fit_ends_the_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver returns its best iterate then, which is no estimate to choose by."""

    def interrupted(*arguments: Any, **options: Any) -> Calibration:
        found = estimate_coefficients(*arguments, **options)
        monkeypatch.setattr(INTERRUPTED, "requested", True)
        return found

    monkeypatch.setattr("fitting.selection.structure_choice.estimate_coefficients", interrupted)
    runs, given = harbour(3), [candidate(ESSO, "mmg")]
    with pytest.raises(KeyboardInterrupt):
        choose_structure(ESSO, given, (runs[:2], runs[2:], ()), Settings(passes=1, max_iterations=2, compiled=False))


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
