"""Choice of a structure: candidates that trials cannot determine are refused, polynomials begin at a regression on
velocities and learn by the objective of the paper, the best is chosen and tested, an interrupted choice goes on."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.harbour_inputs import harbour_inputs
from cases.simulation.simulate import SensorNoise, add_noise, simulate_controls
from cases.trial import Trial
from fitting.calibrate import started_from
from fitting.calibration import Calibration, estimate_coefficients
from fitting.report.run_folder import Store, hashes_of_trials, plain
from fitting.selection import learning
from fitting.selection.candidates import Rules, StructureCandidate, candidate, candidates
from fitting.selection.learning import Learned, SubsequenceObjective, regression
from fitting.selection.polynomial_regression import Regression, increments, regress
from fitting.selection.structure_choice import BEYOND, bounded, choose_structure, fault, stability
from fitting.settings import Settings
from fitting.solvers.control import INTERRUPTED
from mmg.errors import Conflict, OutOfRange, Unsupported, UserError
from mmg.model import assemble
from mmg.runge_kutta import rk4_step
from mmg.ship import Ship
from mmg_ident.commands.main import main
from tests.support.trial_files import write_trials

pytestmark = pytest.mark.usefixtures("blank_figures")
ESSO = load_ship("esso_osaka_3m").without_network()


@lru_cache(maxsize=4)
def harbour(count: int = 3, seconds: float = 220.0) -> tuple[Trial, ...]:
    """Runs of ESSO OSAKA with sensor noise, sampled each second."""
    noise = SensorNoise.for_length(3.0)
    runs = [simulate_controls(ESSO, harbour_inputs(ESSO, seconds, seed, 1.0)) for seed in range(count)]
    return tuple(add_noise(run, noise, seed) for seed, run in enumerate(runs))


def problem(name: str = "sm1-order1", **weights: float) -> SubsequenceObjective:
    """The objective of the candidate ``name``: two runs to train on, one to validate."""
    runs = harbour()
    one = SubsequenceObjective(candidate(ESSO, name).ship, runs[:2], runs[2:])
    vars(one).update(weights)
    return one


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
def test_the_choice_has_less_error_than_the_start_and_thins_out() -> None:
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


def test_candidates_go_from_few_terms_to_many_and_a_generated_ship_has_none() -> None:
    found = candidates(ESSO)
    assert isinstance(found[0], StructureCandidate) and found[0].name == "mmg"
    assert list(map(sum, (one.counts for one in found))) == sorted(sum(one.counts) for one in found)
    with pytest.raises(Unsupported):
        candidates(found[1].ship)


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.parametrize("objective", ["regression", "paper"])
def test_the_command_writes_a_run_folder_that_is_a_ship(
    objective: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1, 1e-2))
    write_trials(tmp_path / "trials", harbour())
    out = tmp_path / "run"
    line = ["select", "esso_osaka_3m", str(tmp_path / "trials"), "--only", "sm1-order1", "--out", str(out), "--json"]
    line += ["--objective", objective, *["--seeds", "2"] * (objective == "paper")]
    assert main(line) in (0, 1)
    told, content = json.loads(capsys.readouterr().out), json.loads((out / "selection.json").read_text())
    assert content["candidates"] == told["candidates"] and told["chosen"].startswith("sm1-order1")
    assert (out / "report.html").exists()
    terms = len(candidate(ESSO, "sm1-order1").ship.monomials)
    if objective == "paper":  # with learning curves
        rows = content["learned"]
        assert {(row["name"], row["seed"]) for row in rows} == {("sm1-order1", 0), ("sm1-order1", 1)}
        lines = (out / "learning.csv").read_text().splitlines()
        assert len(lines) > 5 and lines[0].startswith("candidate,seed,evaluations,seconds,objective")
        best = min(rows, key=lambda row: row["validation"])
        assert len(load_ship(out).monomials) == terms - best["terms_left_out"]
        assert {path.stem for path in (out / "learned").glob("sm1*.json")} == {"sm1-order1_seed0", "sm1-order1_seed1"}
    assert 0 < len(load_ship(out).monomials) <= terms
    assert main(line) == 2
    assert "exists" in capsys.readouterr().err


# An interrupted choice goes on: finished parts are taken from the run folder, those of another one refused
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
    assert repr(learning.kept_run(again, "one")) == repr(part)
    assert learning.kept_run(again, "two") is None
    again.save("two", {})  # a broken part is made again
    assert learning.kept_run(again, "two") is None


@pytest.mark.slow
def test_learned_runs_are_taken_up_to_the_last_digit_and_the_result_is_that_without_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1,))
    names = ("sm1-order1", "sm2-order1")
    runs, ones = harbour(), [candidate(ESSO, name) for name in names]
    trials, settings = (runs[:2], runs[2:]), Settings()
    whole, store = learning.learn_all(ones, trials, settings, 2), stored(tmp_path)
    (one, _), done = learning.learn_all(ones[:1], trials, settings, 2, store)["sm1-order1"], list[str]()
    assert learning.kept_run(store, f"sm1-order1_seed{one.seed}") == one
    assert one.lessons and one.values.keys() == set(ones[0].ship.free)
    original = learning.learn_one

    def counted(run, **given):  # type: ignore[no-untyped-def]
        done.append(f"{run[0].name}_seed{run[1]}")
        return original(run, **given)

    monkeypatch.setattr(learning, "learn_one", counted)
    resumed = learning.learn_all(ones, trials, settings, 2, stored(tmp_path, resume=True))
    assert done == ["sm2-order1_seed0", "sm2-order1_seed1"]
    for name in names:
        assert [run.values for run in resumed[name]] == [run.values for run in whole[name]]
        assert [run.validation for run in whole[name]] == sorted(run.validation for run in whole[name])
        assert {run.seed for run in whole[name]} == {0, 1}


# The objective: against a plain loop, its guard and penalties, and its derivatives against differences
def plain_error(one: SubsequenceObjective, p: np.ndarray) -> float:
    """E by a loop over subsequences and steps, one state at a time."""
    ship = one.ship_at(p)
    model, total, count = assemble(ship), 0.0, 0
    for trial in harbour()[:2]:
        N, h = len(one.train.controls), one.train.h
        rows = np.column_stack([trial[name] for name in ("u", "v", "r")])
        actuators = np.column_stack([trial[name] for name in ship.actuators])
        for first in range(0, len(trial) - 1, N):
            z, out = np.array([0, 0, trial["psi"][first], *rows[first]]), False
            for k in range(first, min(first + N, len(trial) - 1)):
                c = np.array([*actuators[k], 0.0, 0.0])
                with np.errstate(all="ignore"):
                    z = rk4_step(lambda s, at, c=c: np.array(model.rates(s, c, ship.values)).reshape(-1), z, h)
                    e = (z[3:] - rows[k + 1]) / one.sigma
                out = out or not (np.abs(e) < learning.LIMIT).all()
                total += 3 * learning.LIMIT**2 if out else float(e @ e)
                count += 3
                z = np.where(np.isfinite(z), z, 0.0) if out else z
    return total / count


@pytest.mark.slow
def test_the_error_is_that_of_a_plain_loop_for_each_candidate_of_a_population() -> None:
    one = problem()
    p = 0.3 * np.random.default_rng(0).normal(size=(one.P, 3)) + regression(one, harbour()[:2])[:, None]
    p[:, 2] *= -6.0  # this one runs away
    found = one.errors(p, one.train)
    assert found == pytest.approx([plain_error(one, column) for column in p.T], rel=1e-7)
    assert found[2] > 20 * found[0]


def test_a_runaway_has_a_finite_error_that_grows_the_earlier_it_leaves() -> None:
    one = problem()
    astray = np.where([s == "X_n_1" for s in one.prior.symbols], 1.0, 0.0)
    values = one.errors(np.outer(astray, [2.0, 20.0, 200.0, 1e6]), one.train)
    assert np.isfinite(values).all()
    assert (np.diff(values) > 0).all()
    assert values[-1] == pytest.approx(learning.LIMIT**2)


def test_vectwin_has_the_1350_combinations_of_the_paper() -> None:
    vectwin = load_ship("vectwin_3m")
    rng = np.random.default_rng(0)
    t = np.arange(50.0)
    names = ("psi", "u", "v", "r", "n", "delta_port", "delta_starboard")
    trial = Trial("one", {"t": t, **{name: rng.normal(size=50) for name in names}})
    far = learning.extremes_of(vectwin, [trial])
    assert far.state.shape == (6, 1350)
    assert len(np.unique(np.vstack([far.state, far.controls]).T, axis=0)) == 1350
    assert far.state[3].max() == pytest.approx(1.2 * trial["u"].max())
    assert not far.controls[[vectwin.inputs.index(name) for name in ("wind_north", "wind_east")]].any()


def test_acceleration_limits_are_of_differences_over_a_second() -> None:
    t = np.arange(0, 100, 0.1)
    trial = Trial("one", {"t": t, "u": 0.3 * t, "v": 0.1 * (-1.0) ** np.arange(len(t)), "r": 0 * t})
    assert learning.acceleration_limits([trial], 1.0) == pytest.approx([0.3, 0.0, 0.0], abs=1e-12)


def test_the_deviation_counts_accelerations_beyond_their_limits() -> None:
    one = problem(deviation=0.5)
    p = np.random.default_rng(1).normal(size=one.P)
    model, far, values = assemble(one.ship_at(p)), one.extremes, one.ship_at(p).values
    excess = [
        max(abs(a) / limit - 1, 0.0) ** 2
        for z, c in zip(far.state.T, far.controls.T, strict=True)
        for a, limit in zip(np.array(model.rates(z, c, values)).reshape(-1)[3:], far.limit, strict=True)
    ]
    assert np.mean(excess) > 0
    assert one.deviations(p[:, None])[0] == pytest.approx(np.mean(excess), rel=1e-9)
    assert one.values(p[:, None])[0] == pytest.approx(one.errors(p[:, None], one.train)[0] + 0.5 * np.mean(excess))


def test_the_sparsity_penalises_generated_terms_only() -> None:
    one = problem(deviation=0.0, sparsity=0.01)
    p = 0.1 * np.ones(one.P)
    added = one.values(p[:, None])[0] - one.errors(p[:, None], one.train)[0]
    assert added == pytest.approx(0.001 * len(one.ship.monomials))
    assert len(one.ship.monomials) < one.P


def test_derivatives_agree_with_differences() -> None:
    one = problem("sm2-order2", deviation=0.3)
    rng = np.random.default_rng(2)
    p = regression(one, harbour()[:2]) + 0.01 * rng.normal(size=one.P)
    gradient, hessian = one.quadratic(p)
    assert one.deviations(p[:, None])[0] > 0
    for _ in range(4):
        d, h = rng.normal(size=one.P) / np.sqrt(one.P), 1e-5
        high, low = one.values(np.transpose([p + h * d, p - h * d]))
        assert gradient @ d == pytest.approx((high - low) / (2 * h), rel=1e-4, abs=1e-7)
    assert np.linalg.eigvalsh(hessian)[0] > -1e-9 * np.trace(hessian)


def test_the_domain_is_that_of_the_ship_file_and_p_0_the_ship() -> None:
    one = problem()
    assert one.ship_at(np.zeros(one.P)).values == pytest.approx(one.ship.values)
    first = one.ship.free[0]
    assert one.ship_at(one.upper).coefficients[first].value == pytest.approx(one.ship.coefficients[first].upper)


def test_subsequences_follow_each_other_and_the_last_one_is_shorter() -> None:
    run = harbour()[0]
    found = learning.subsequences([run], 1.0, 100.0, ESSO.inputs)
    assert found.count == 3
    assert found.weight.sum(axis=0).tolist() == [100, 100, 20]
    assert found.start[3, 1] == run["u"][100]
    assert found.measured[9, 0, 2] == pytest.approx(run["u"][210])


def test_a_step_longer_than_a_subsequence_and_still_trials_are_refused() -> None:
    with pytest.raises(OutOfRange):
        learning.subsequences(harbour(), 300.0, 100.0, ESSO.inputs)
    still = Trial("still", {"t": np.arange(9.0), "u": np.ones(9), "v": np.zeros(9), "r": np.arange(9.0)})
    with pytest.raises(UserError, match="u, v"):
        learning.spread_of([still])


# The optimiser of the objective: the step, the descent, the path of the sparsity
@pytest.mark.parametrize("seed", (0, 3))
def test_the_step_is_the_minimum_of_quadratic_and_moduli_in_the_box(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 12
    B = rng.normal(size=(n, n)) * 10 ** rng.uniform(-2, 1, n)
    H, g, p = B.T @ B + 1e-6 * np.eye(n), 5 * rng.normal(size=n), rng.uniform(-0.5, 0.5, n)
    weight = 2 * np.abs(rng.normal(size=n)) * (np.arange(n) % 2) * (seed > 0)

    def split(z: np.ndarray) -> float:  # x = positive part - negative part
        d = z[:n] - z[n:] - p
        return float(g @ d + 0.5 * d @ H @ d + weight @ (z[:n] + z[n:]))

    x = learning.minimise_quadratic(H, g, p, (-np.ones(n), np.ones(n)), weight)
    start, found = (np.concatenate([np.maximum(at, 0), np.maximum(-at, 0)]) for at in (p, x))
    options = {"maxiter": 10**5, "maxfun": 10**7, "ftol": 1e-15, "gtol": 1e-10}
    least = minimize(split, start, bounds=[(0, 1)] * 2 * n, method="L-BFGS-B", options=options)
    assert split(found) <= least.fun + 1e-6 * abs(least.fun)
    assert np.abs(x).max() <= 1


def test_the_regression_predicts_ten_seconds_better_than_no_force_at_all() -> None:
    one = problem("sm2-order2")
    tried = np.transpose([np.zeros(one.P), regression(one, harbour()[:2])])
    nothing, found = one.errors(tried, learning.subsequences(harbour()[:2], 1.0, 10.0, one.ship.inputs))
    assert found < 0.85 * nothing


def test_the_descent_converges_where_no_slope_is_left() -> None:
    one = problem(deviation=0.02)
    start = regression(one, harbour()[:2])
    *_, p = learning.descent(one, start, 200)
    first, last = one.values(np.transpose([start, p]))
    assert last < 0.9 * first
    inside = (p > one.lower + 1e-9) & (p < one.upper - 1e-9)
    gradient, hessian = one.quadratic(p)
    gain = gradient[inside] @ np.linalg.lstsq(hessian[np.ix_(inside, inside)], gradient[inside])[0]
    assert gain < 5e-3 * last  # what a further step would bring


@pytest.mark.slow
def test_more_sparsity_leaves_fewer_terms_and_none_of_it_most() -> None:
    terms: list[int] = []
    errors: list[float] = []
    p = regression(problem("sm1-order2"), harbour()[:2])
    for weight in (1e-1, 1e-2, 1e-4):
        one = problem("sm1-order2", deviation=0.0, sparsity=weight)
        *_, p = learning.descent(one, p, 12)
        terms.append(int((p != 0).sum()))
        errors.append(float(one.errors(p[:, None], one.train)[0]))
    assert terms[0] < terms[1] < terms[2] and errors[0] > errors[1] > errors[2]


def test_the_learning_keeps_the_best_on_validation_and_writes_its_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-2,))
    one = problem()
    learned = learning.Learning(one)
    learning.follow(learned, regression(one, harbour()[:2]))
    validation = [lesson.validation for lesson in learned.lessons]
    assert one.validate is not None and len(validation) > 3
    assert one.errors(learned.p[:, None], one.validate)[0] == pytest.approx(min(validation))
    assert [s.evaluations for s in learned.lessons] == sorted(s.evaluations for s in learned.lessons)
    one_run = Learned("sm1-order1", 0, {}, (), 0.0, 0.0, 0.0, 0.0, 0, tuple(learned.lessons))
    learning.write_learning([one_run], tmp_path / "learning.csv")
    lines = (tmp_path / "learning.csv").read_text().splitlines()
    assert len(lines) == 1 + len(validation)
    assert lines[0].split(",")[-1] == "validation" and lines[-1].startswith("sm1-order1,0,")


def test_preparing_counts_against_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock on which preparing alone takes longer than the limit: the start, by regression, is the best so far."""
    now, real = [0.0], learning.SubsequenceObjective
    clock = SimpleNamespace(perf_counter=lambda: now[0])
    monkeypatch.setattr(learning, "time", clock)

    def slow(*arguments: Any, **more: Any) -> SubsequenceObjective:
        now[0] += 100.0
        return real(*arguments, **more)

    monkeypatch.setattr(learning, "SubsequenceObjective", slow)
    runs = harbour()
    found = learning.learn_one((candidate(ESSO, "sm1-order1"), 0), (runs[:2], runs[2:]), Settings(time_limit=40.0))
    assert len(found.lessons) == 1 and found.seconds == 100.0 and any(found.values.values())


# Regression on velocities: finds the polynomial that made the trials, leaves out what it lacks, minds bounds, gaps
EMPTY = candidate(ESSO, "full-order2").ship
TRUE = {"X_u_absu_1": -0.02, "X_n_absn_1": 0.02, "Y_v_1": -0.15, "Y_v_absv_1": -0.4, "N_r_1": -0.02, "N_n_sd_1": -0.008}


def polynomial() -> Ship:
    """A ship whose polynomial has the terms of TRUE alone."""
    return EMPTY.with_values(dict.fromkeys(EMPTY.monomials, 0.0) | TRUE)


@lru_cache(maxsize=2)
def polynomial_runs(count: int = 4) -> tuple[Trial, ...]:
    found = [simulate_controls(polynomial(), harbour_inputs(ESSO, 300.0, seed, 0.5)) for seed in range(count)]
    return tuple(add_noise(run, SensorNoise.for_length(3.0), seed) for seed, run in enumerate(found))


@lru_cache(maxsize=2)
def regressed(sparse: bool) -> Regression:
    return regress(EMPTY, increments(EMPTY, polynomial_runs()), sparse)


@pytest.mark.parametrize("sparse", [False, True])
def test_the_terms_that_made_the_trials_are_found_and_those_that_the_ship_lacks_vanish(sparse: bool) -> None:
    for symbol in ("X_n_absn_1", "N_r_1", "N_n_sd_1"):
        assert regressed(sparse).values[symbol] == pytest.approx(TRUE[symbol], rel=0.25), symbol
    if not sparse:
        assert not regressed(False).vanished
        return
    gone = set(regressed(True).vanished)
    assert not {"X_n_absn_1", "N_r_1", "N_n_sd_1"} & gone
    assert len(gone) > 0.5 * (len(EMPTY.monomials) - len(TRUE))
    thin = regressed(True).ship(EMPTY)
    assert set(thin.monomials) == set(EMPTY.monomials) - gone
    kept = thin.coefficients["N_r_1"]
    assert kept.value == 0.0 and kept.std == regressed(True).sizes["N_r_1"] and "evidence" in kept.source


def test_increments_of_the_true_ship_are_noise_of_the_sensors() -> None:
    system = increments(polynomial(), polynomial_runs())
    sd = np.array([0.004, 0.004, 0.0006])
    np.testing.assert_allclose(system.noise, sd, rtol=0.1)
    rms = np.sqrt(np.mean(system.change[:, 1:] ** 2, axis=(0, 1)))
    np.testing.assert_allclose(rms, np.sqrt(2) * sd, rtol=0.25)  # of the sample and of the first one
    assert system.slope.shape == (*system.change.shape, len(EMPTY.free)) and system.symbols == EMPTY.free


def test_slopes_are_those_of_finite_differences() -> None:
    system, h = increments(EMPTY, polynomial_runs(1)), 1e-4
    for symbol in ("X_n_absn_1", "m_y"):
        there = EMPTY.with_values({symbol: EMPTY.coefficients[symbol].value + h})
        change = system.change - increments(there, polynomial_runs(1)).change
        slope = system.slope[..., system.symbols.index(symbol)]
        np.testing.assert_allclose(change / h, slope, atol=2e-3 * np.abs(slope).max() + 1e-9)


def test_values_stay_within_their_bounds() -> None:
    row = EMPTY.coefficients["X_n_absn_1"]
    bound = EMPTY.with_coefficients({"X_n_absn_1": replace(row, upper=0.01)})
    values = regress(bound, increments(bound, polynomial_runs())).values
    assert values["X_n_absn_1"] == pytest.approx(0.01)
    assert all(c.lower <= values[s] <= c.upper for s in bound.free for c in [bound.coefficients[s]])


def test_velocities_that_were_not_measured_are_left_out_and_none_is_one_line() -> None:
    run = polynomial_runs()[0]
    gap = run["v"].copy()
    gap[100:200] = np.nan
    broken = Trial("gap", {**run.columns, "v": gap})
    assert 0 < len(increments(EMPTY, [broken]).change) < len(increments(EMPTY, [run]).change)
    without = Trial("none", {**run.columns, "v": np.full(len(run), np.nan)})
    with pytest.raises(UserError, match=r"20 s.* u, v, r .*1 trials"):
        increments(EMPTY, [without])


@pytest.mark.slow
def test_held_coefficients_stay_where_the_solver_starts_and_still_have_errors() -> None:
    start, values = regressed(True).ship(EMPTY), regressed(True).values
    warm = started_from(start, values, hold=True)
    fit = estimate_coefficients(start, polynomial_runs()[:1], Settings(window=30.0, passes=1), warm=warm)
    assert fit.converged
    for symbol, value in values.items():
        row = fit.ship.coefficients[symbol]
        assert row.value == pytest.approx(value, rel=1e-6, abs=1e-9), symbol
        assert 0 < row.std <= start.coefficients[symbol].std, symbol


def filtered(**values: float) -> Ship:
    """The polynomial with a velocity filter whose lag is free."""
    late = EMPTY.with_effect("velocity_filter", values)
    return late.with_coefficients({"velocity_filter.tau": late.coefficients["velocity_filter.tau"].with_(fixed=False)})


def late_columns(run: Trial, lag: float, body_axes: bool) -> dict[str, np.ndarray]:
    """Columns u and v that are late: each of them, or their earth-fixed vector."""
    turned = np.exp(1j * (0.0 if body_axes else np.unwrap(run["psi"])))
    body = np.interp(run.t - lag, run.t, (run["u"] + 1j * run["v"]) * turned) / turned  # over ground: north + j east
    return {"u": body.real, "v": body.imag}


@pytest.mark.parametrize("body_axes", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_late_velocities_are_found_by_the_positions_and_put_right(body_axes: bool) -> None:
    late = filtered(body_axes=float(body_axes))
    moved = [run.with_columns(**late_columns(run, 1.5, body_axes)) for run in polynomial_runs()]
    there = increments(late, moved)
    assert there.lag == pytest.approx(1.5, abs=0.3 if body_axes else 0.15)
    if not body_axes:
        assert increments(late, polynomial_runs()).lag <= 0.15
        values = regress(late, there).values
        assert values["velocity_filter.tau"] == there.lag
        assert values["X_n_absn_1"] == pytest.approx(TRUE["X_n_absn_1"], rel=0.25)
