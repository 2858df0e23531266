"""Constants of single runs in a fit: exact derivatives, recovery, equivalence with shared ones, files and bad input."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import freeing_effects, varies, varying_effects, with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, add_noise, simulate, write_trial
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.captive import CaptiveForces
from fitting.nlp.fisher_information import information
from fitting.nlp.prior import RunConstants
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import cut
from fitting.settings import Settings
from fitting.solvers.solve import solve
from fitting.uncertainty.sandwich import changes_without_each
from mmg.effects import EFFECTS
from mmg.errors import BadValue
from mmg.model import assemble
from mmg.ship import Ship
from mmg_ident.commands.main import main
from tests.fitting.nlp.test_captive import points
from tests.fitting.nlp.test_shooting import somewhere
from tests.support.synthetic_runs import SIGMA, assert_exact_derivatives

pytestmark = pytest.mark.usefixtures("blank_figures")
ESSO = load_ship("esso_osaka_3m")
FREE = ("Y_v", "N_v", "Y_r", "N_r", "k_0")
CURRENTS = {"zigzag:20/20": (0.03, -0.02), "turning:35": (-0.025, 0.03), "random:3": (0.0, -0.035)}


def hidden() -> Ship:
    """A ship that differs from ESSO OSAKA in what the fits free, by 8 %."""
    return ESSO.with_values({s: 1.08 * ESSO.coefficients[s].value for s in FREE})


@lru_cache(maxsize=2)
def trials(duration: float = 120.0) -> tuple[Trial, ...]:
    """Runs of the hidden ship, each in a current of its own."""
    made = []
    for seed, (text, (x, y)) in enumerate(CURRENTS.items()):
        ship = with_effects(hidden(), [f"current:x={x},y={y}"])
        run = simulate(ship, parse_maneuver(text, ESSO, n=10.0, duration=duration), 0.1)
        made.append(replace(add_noise(run, SensorNoise(), seed), name=text.split(":")[0]))
    return tuple(made)


def start() -> Ship:
    return ESSO.fixing([s for s in ESSO.symbols if s not in FREE])


@lru_cache(maxsize=2)
def fitted(per_run: bool) -> Calibration:
    ship, constants = varying_effects(start(), ["current"] if per_run else [])
    return estimate_coefficients(ship, trials(), Settings(compiled=False), per_run=constants)


@lru_cache(maxsize=4)
def small(K: int, captive: bool = False) -> Problem:
    """Two short runs with a shared lag, each with a current (prior off zero) and a compass error of its own."""
    ship, constants = varying_effects(freeing_effects(start(), ["velocity_filter"]), ["current:x=0.01", "heading_bias"])
    segments = cut([trials()[0], trials()[1]], 1.0, 30.0, K, inputs=ship.inputs)
    few = segments.subset(np.flatnonzero(np.isin(np.arange(len(segments.run)), (0, 1, 5))))
    prior = Prior.of(ship, constants, few.trials)
    positions = prior.positions(ship)
    kernel = Kernels(assemble(ship), positions, False)
    forces = CaptiveForces(kernel.model, positions[: prior.shared], points(hidden()), False) if captive else None
    return Problem(ship, prior, kernel, few, SIGMA, captive=forces)


@pytest.mark.slow
@pytest.mark.parametrize(("K", "captive"), [(1, False), (7, True)])
def test_derivatives_are_exact(K: int, captive: bool) -> None:
    p = small(K, captive)
    assert (p.P - p.prior.shared, p.L - p.prior.shared) == (2 * 3, 3)
    everything = np.random.default_rng(1).normal(size=p.n)
    assert_exact_derivatives(p, somewhere(p), everything, *np.eye(p.n)[-7:])  # then a shared one and each constant


def test_a_constant_of_one_run_moves_that_run_only() -> None:
    p = small(7)
    x = somewhere(p)
    moved = x.copy()
    moved[-1] += 1.0  # the compass of the last run
    changed = np.abs(p.errors(moved)[0] - p.errors(x)[0]).max(axis=1) > 0
    run = p.segments.run[p.segments.node_window]
    assert (changed == (run == 1)).all()


def test_captive_tests_know_no_constants_of_runs() -> None:
    p = small(7, True)
    still = ESSO.with_values({s: hidden().coefficients[s].value for s in FREE})
    common = p.prior.common
    values = np.array([still.coefficients[s].value if s in FREE else 0.0 for s in common.symbols])
    scaled = (values - common.mean) / common.std
    assert p.captive is not None
    assert p.captive.cost(p.captive_coefficients(np.r_[scaled, np.full(6, 2.0)])) == pytest.approx(0, abs=1e-12)


def test_information_and_its_shared_part_are_those_of_the_whole_program() -> None:
    """Inverse by inverse; the scores are the gradient of the profiled cost: zero with the prior's at the optimum."""
    p = small(7)
    s = solve(p, p.start())
    assert s.converged
    found = information(p, s.x)
    np.testing.assert_allclose(found.score.sum(axis=0) + found.prior_score, 0, atol=1e-3)
    for w, run in enumerate(found.run):
        others = (found.owner >= 0) & (found.owner != run)
        assert not found.fisher[w][others].any() and found.fisher[w][found.owner == run].any()
    shared, n = found.shared(), p.prior.shared
    np.testing.assert_allclose(np.linalg.inv(shared.hessian), np.linalg.inv(found.hessian)[:n, :n], rtol=1e-8)
    moved = found.p[:n] + changes_without_each(found.by_run())[:, :n]
    np.testing.assert_allclose(shared.p + changes_without_each(shared), moved, rtol=1e-2, atol=1e-4)


@pytest.mark.slow
def test_constants_of_a_single_run_are_those_of_an_effect_freed_for_all() -> None:
    ship, constants = varying_effects(start(), ["current"])
    settings = Settings(sigma=tuple(SIGMA), compiled=False)
    own = estimate_coefficients(ship, trials()[:1], settings, per_run=constants)
    free = ship.with_coefficients({s: ship.coefficients[s].with_(fixed=False) for s in constants})
    shared = estimate_coefficients(free, trials()[:1], settings)
    assert own.solution.objective == pytest.approx(shared.solution.objective, rel=1e-8)
    assert own.constants is not None
    both = [shared.ship.coefficients[s] for s in constants]
    np.testing.assert_allclose(own.constants.value[0], [c.value for c in both], atol=1e-6)
    np.testing.assert_allclose(own.constants.std[0], [c.std for c in both], rtol=1e-3)
    for s in FREE:
        assert own.ship.coefficients[s].value == pytest.approx(shared.ship.coefficients[s].value, rel=1e-4)


@pytest.mark.slow
def test_each_run_gets_its_current_and_the_shared_coefficients_do_not_bend() -> None:
    own, without, truth = fitted(True), fitted(False), hidden()
    assert own.converged and own.constants is not None
    rows = own.constants.rows()
    for name, true in zip(("zigzag", "turning", "random"), CURRENTS.values(), strict=True):
        for symbol, value in zip(("current.x", "current.y"), true, strict=True):
            row = rows[name][symbol]
            assert abs(row["value"] - value) < max(3 * row["std"], 2e-4), (name, symbol, row)
            assert row["std"] < 0.004 and row["unit"] == "m/s" and row["prior_std"] == 0.02

    def off(c: Calibration) -> np.ndarray:
        shift = [c.ship.coefficients[s].value - truth.coefficients[s].value for s in FREE]
        return np.abs(shift) / [abs(truth.coefficients[s].value) for s in FREE]

    assert off(own).max() < 0.05 and off(own).mean() < 0.3 * off(without).mean()
    assert own.ship.effects == () and set(own.ship.coefficients) == set(ESSO.coefficients)
    n = len(FREE)
    assert own.prior.symbols == own.ship.free and own.covariance.shape == own.covariance_model.shape == (n, n)
    assert len(own.iterate["p"]) == n + 6 and len(own.p) == n
    moves, owner = own.spread.moves, own.information.owner
    assert owner is not None and moves[:, owner < 0].any()
    assert (moves[np.arange(3)[:, None] == owner] == 0).all()  # a run left out says nothing of its own constants


@pytest.mark.slow
def test_runs_without_data_keep_the_prior() -> None:
    ship, constants = varying_effects(start(), ["rudder_offset:delta=0.01"])
    whole = trials()[2]
    short = replace(whole, name="short", columns={k: v[:50] for k, v in whole.columns.items()})
    found = estimate_coefficients(ship, [*trials()[:2], short], Settings(passes=1, compiled=False), per_run=constants)
    row = found.constants.rows()["short"]["rudder_offset.delta"]  # type: ignore[union-attr]
    assert row["value"] == pytest.approx(0.01, abs=1e-6) and row["std"] == pytest.approx(0.05, rel=1e-3)


def test_equal_names_of_runs_are_told_apart() -> None:
    one = np.ones((2, 1))
    found = RunConstants(("current.x",), ("a", "a (2)"), ("m/s",), one, one, one[0], one[0], one[:, 0])
    assert set(found.rows()) == {"a", "a (2)"}
    ship, constants = varying_effects(start(), ["current:x"])
    prior = Prior.of(ship, constants, ("a", "a"))
    made = RunConstants.of(ship, prior, np.zeros(len(prior.mean)), np.eye(len(prior.mean)), ("a", "a"))
    assert made is not None and made.runs == ("a", "a (2)") and made.symbols == ("current.x",)


def test_which_parameters_become_constants() -> None:
    def of(text: str) -> tuple[Ship, tuple[str, ...]]:
        return varying_effects(start(), [text])

    assert of("current")[1] == ("current.x", "current.y")
    assert of("current:x_rate")[1] == ("current.x_rate",)
    ship, constants = of("current:x=0.05,y_rate=0.001")
    assert constants == ("current.x", "current.y") and ship.free == start().free
    at = {s: ship.coefficients[s] for s in ("current.x", "current.y_rate")}
    assert at["current.x"].value == 0.05 and at["current.x"].std == 0.02 and at["current.y_rate"].value == 0.001
    assert {"current", "rudder_offset", "wind_sensor_bias", "heading_bias", "draft"} <= {
        e for e in EFFECTS if varies(e)
    }
    assert not any(varies(e) for e in ("rudder_lag", "velocity_filter", "rudder_stall"))
    with pytest.raises(BadValue):  # she has no wind
        varying_effects(load_ship("kvlcc2_l7"), ["wind_sensor_bias"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("per_run")
    for trial in trials():
        write_trial(trial, folder / f"{trial.name}.csv")
    return folder


def command(folder: Path, out: str, *more: str) -> list[str]:
    return ["fit", "esso_osaka_3m", *(str(f) for f in sorted(folder.glob("*.csv"))), "--only", ",".join(FREE),
            "--measurement", "none", "--no-next-trial", "--out", str(folder / out), *more]  # fmt: skip


@pytest.mark.longest
@pytest.mark.slow
def test_a_fit_from_files_stops_and_resumes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = command(folder, "run", "--per-run", "current", "--max-iterations", "2")
    assert main(first) == 1
    assert main(command(folder, "run", "--resume")) == 2
    assert "--per-run" in capsys.readouterr().err
    more = ["--starts", "3", "--workers", "2", "--bootstrap", "4", "--profile", "N_r"]
    assert main(command(folder, "run", "--per-run", "current", "--resume", *more)) == 0
    said = capsys.readouterr().err
    assert "current.x [m/s]" in said
    result = json.loads((folder / "run" / "result.json").read_text())
    assert set(result["per_run"]) == {"zigzag", "turning", "random"}
    row = result["per_run"]["zigzag"]["current.x"]
    assert abs(row["value"] - 0.03) < 3 * row["std"] + 2e-4 and row["unit"] == "m/s"
    assert set(result["coefficients"]) == set(FREE) == set(result["bootstrap"]["coefficients"])
    assert len(result["starts"]) == 3 and result["bootstrap"]["failed"] == [] == result["profiles"][0]["failures"]
    assert set(result["identifiability"]["coefficients"]) == set(FREE)
    for name in ("ship.toml", "start.toml"):
        assert "current" not in (folder / "run" / name).read_text()
    page = (folder / "run" / "report.html").read_text()
    assert "current.x [m/s]" in page and "<td>zigzag</td>" in page
    files = [str(f) for f in folder.glob("*.csv")]
    assert main(["score", str(folder / "run"), *files]) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--per-run", "tide"], "tide"),
        (["--per-run", "current:z"], "'z'"),
        (["--per-run", "current:x=9"], "x=9"),
        (["--per-run", "current", "--per-run", "current:x"], "current"),
        (["--per-run", "current", "--with", "current"], "current"),
        (["--with", "disturbance"], "disturbance"),
        (["--per-run", "rudder_lag"], "rudder_lag"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    folder: Path, more: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command(folder, "bad", *more)) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and "\n" not in error and not (folder / "bad").exists()
