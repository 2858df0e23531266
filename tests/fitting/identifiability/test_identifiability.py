"""Verdicts on coefficients against cases whose answer is known, what does not belong into a calibration, and which
trials would tell more: those of the library against new fits, and one of one's own design."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cases.maneuvers.definitions import Limits, parse_maneuver
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, Wind, add_noise, simulate
from cases.simulation.simulate_batch import simulate_batch
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.design.next_trial import (
    MEASURED_OTHERWISE,
    NextTrial,
    Option,
    identifiability_dict,
    library,
    next_trial,
    repetitions,
)
from fitting.design.plan import (
    RUN_UP,
    Area,
    Evolution,
    Sequences,
    SequenceSearch,
    TrialWorth,
    corners,
    is_reversible,
)
from fitting.design.planned_trial import PlannedTrial
from fitting.identifiability.analysis import (
    DETERMINED,
    KINDS,
    CoefficientFinding,
    Identifiability,
    analyse,
    cause,
    estimate_warnings,
    implausible,
    verdict,
)
from fitting.identifiability.data_checks import contradictions, refuse_outliers, unexcited_astern
from fitting.nlp.fisher_information import information
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import cut
from fitting.prediction.innovations import Innovations, choose_windows, window_information
from fitting.record import FitRecord
from fitting.report.plots import profile_plot
from fitting.report.sections import identifiability_section
from fitting.settings import Settings, Start
from fitting.solvers.solve import disagreement
from mmg.errors import TooFewData, UserError
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship
from tests.support.calibrated import small_result
from tests.support.synthetic_runs import runs

ESSO = load_ship("esso_osaka_3m")
SIGMA = (0.05, 0.05, 0.01, 0.01, 0.01, 0.003)
FREE = ("X_0F", "Y_v", "N_r", "k_0", "t_P", "a_H", "ell_R", "gamma_P", "gamma_N", "X_0A", "Y_A1")
RUDDER = ("a_H", "ell_R", "gamma_P", "gamma_N")


def prior_of(*symbols: str, mean: float = 1.0, std: float = 0.2) -> Prior:
    P = len(symbols)
    return Prior(symbols, np.full(P, mean), np.full(P, std), np.full(P, -9.0), np.full(P, 9.0))


def trial(text: str, duration: float, seed: int = 0, wind: Wind | None = None) -> Trial:
    clean = simulate(ESSO, parse_maneuver(text, ESSO, duration=duration), 0.5, wind, seed)
    return add_noise(clean, SensorNoise.for_length(3.0), seed)


def fitted(trials: list[Trial]) -> Calibration:
    start = ESSO.fixing([s for s in ESSO.symbols if s not in FREE])
    return estimate_coefficients(start, trials, Settings(sigma=SIGMA, step=1.0))


@cache
def nearly_straight() -> tuple[Calibration, Identifiability, NextTrial]:
    """A fit to accelerations and stops ahead: no rudder, no wind, never astern."""
    calibration = fitted([trial("acceleration", 120.0), trial("acceleration", 80.0, 1)])
    return calibration, calibration.identifiability, next_trial(calibration)


def kinds(found: Identifiability) -> dict[str, str]:
    return {f.symbol: f.kind for f in found.findings}


@pytest.mark.slow
def test_straight_runs_excite_no_rudder_and_tell_thrust_and_its_deduction_as_a_product() -> None:
    _, found, scored = nearly_straight()
    assert all(kinds(found)[s] == "silent" for s in (*RUDDER, "Y_v", "Y_A1", "X_0A"))
    assert kinds(found)["X_0F"] in ("determined", "partly", "shared")
    pair = {f.symbol: f for f in found.findings if f.symbol in ("k_0", "t_P")}
    assert pair["t_P"].kind == "shared" and pair["t_P"].partners[0] == "k_0"
    assert "k_0" in verdict(pair["t_P"])
    cluster = next(c for c in found.clusters if "k_0" in c.symbols)
    assert "t_P" in cluster.symbols and cluster.strongest > 0.9
    assert all("best_trial" in row for row in identifiability_dict(found, scored)["clusters"])


def test_two_coefficients_that_enter_as_one_combination_are_shared() -> None:
    """Information only on a combination of a and b, both 1 with equal priors; c is seen by itself, d not at all."""
    seen = np.array([1.0, 1.0, 0.0, 0.0])
    data = 1e4 * np.outer(seen, seen) + np.diag([0, 0, 1e3, 0])
    found = analyse(prior_of("a", "b", "c", "d"), np.zeros(4), np.linalg.inv(data + np.eye(4)), data)
    assert kinds(found) == {"a": "shared", "b": "shared", "c": "determined", "d": "silent"}
    first = found.findings[0]
    assert first.partners == ("b",) and first.together < 0.01 < DETERMINED
    assert found.clusters[0].symbols == ("a", "b")
    assert found.condition_number == np.inf
    data = 1e4 * np.ones((3, 3))  # a product of three names both partners
    found = analyse(prior_of("a", "b", "c"), np.zeros(3), np.linalg.inv(data + np.eye(3)), data)
    assert all(f.kind == "shared" and len(f.partners) == 2 for f in found.findings)


def test_an_estimate_worse_than_its_prior_far_from_it_at_a_bound_or_unknown_is_said_to_be() -> None:
    data = np.diag([1e3, 5.0])
    inverse = np.linalg.inv(data + np.eye(2))
    found = analyse(prior_of("a", "b"), np.zeros(2), inverse @ (20 * data + np.eye(2)) @ inverse, data)
    assert kinds(found) == {"a": "determined", "b": "prior"}
    assert "prior's" in verdict(found.findings[1])
    away = np.array([3.0, 0.3])  # one far from its prior is not decided by it
    found = analyse(prior_of("a", "b", mean=0.0, std=1.0), away, np.diag([0.9, 0.9]), np.diag([0.5, 0.5]))
    assert kinds(found) == {"a": "strained", "b": "prior"}
    assert "3.0" in verdict(found.findings[0])
    assert found.to_dict()["counts"] == {"prior": 1, "strained": 1}
    found = analyse(prior_of("a", "b"), np.array([(9.0 - 1.0) / 0.2, 0.0]), np.full((2, 2), np.nan))
    assert kinds(found) == {"a": "bound", "b": "unknown"}


def test_shares_and_what_is_left_if_all_others_were_known_are_those_of_the_matrix() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 8))
    covariance = np.linalg.inv(root @ root.T + np.eye(6))
    found = analyse(prior_of(*"abcdef"), np.zeros(6), covariance)
    np.testing.assert_allclose([f.share for f in found.findings], np.diag(covariance))
    np.testing.assert_allclose([f.alone for f in found.findings], 1 / np.diag(np.linalg.inv(covariance)), rtol=1e-9)


@pytest.mark.slow
def test_the_recommended_trial_does_what_was_predicted() -> None:
    """Fit, add the recommended run with noise, fit again: the standard errors fall as predicted.

    To 10 % where the noise model is believed, within a factor of two for robust standard errors from few windows.
    """
    calibration, found, scored = nearly_straight()
    i = [f.symbol for f in found.findings].index("a_H")
    best = scored.best(i)
    assert best is not None and best[1] < 0.7
    option = best[0]
    believed = next_trial(replace(calibration, covariance=calibration.spread.model), [option])
    assert believed.worth == pytest.approx(1.0)
    k = scored.options.index(option)
    run = trial(option.maneuver, 300.0, 7, option.wind)
    again = fitted([trial("acceleration", 120.0), trial("acceleration", 80.0, 1), run])
    fell = np.sqrt(np.diag(again.spread.model) / np.diag(calibration.spread.model))
    np.testing.assert_allclose(fell, np.sqrt(believed.left[0]), rtol=0.1)
    careful = np.sqrt(np.diag(again.covariance) / np.diag(calibration.covariance) / scored.left[k])
    assert (careful > 0.5).all() and (careful < 2.0).all()


@pytest.mark.slow
def test_more_time_tells_more_and_the_trial_named_for_all_is_nearly_the_best() -> None:
    calibration, _, scored = nearly_straight()
    assert (scored.left <= 1 + 1e-9).all() and scored.overall
    chosen = scored.total[scored.options.index(scored.overall)]
    assert scored.mean - chosen >= 0.9 * (scored.mean - scored.total.min())
    shorter, longer = (next_trial(calibration, [Option("zigzag", "zigzag:20/20")], duration=s) for s in (200.0, 600.0))
    assert (longer.left <= shorter.left + 1e-9).all()


@pytest.mark.longest
@pytest.mark.slow
def test_runs_count_for_less_where_the_residuals_prove_to_be_correlated() -> None:
    """Scores that vary four times as much as the noise model says: a run is taken to be worth a quarter."""
    calibration, _, _ = nearly_straight()
    H, one = calibration.information.hessian, np.eye(len(FREE))
    inverse, i = np.linalg.inv(H), FREE.index("a_H")
    scored = {}
    for dispersion in (1.0, 4.0):
        covariance = inverse @ (dispersion * (H - one) + one) @ inverse
        trial = next_trial(replace(calibration, covariance=covariance))
        assert trial.worth == pytest.approx(1 / dispersion, rel=1e-6)
        scored[dispersion] = trial.left[:, i].min()
    assert scored[4.0] > 1.4 * scored[1.0]


@pytest.mark.slow
def test_nothing_helps_a_coefficient_that_no_trial_excites() -> None:
    calibration, found, _ = nearly_straight()
    only = next_trial(calibration, [Option("straight", "straight"), Option("fails", "turning:35", speed=99.0)])
    assert [o.name for o in only.options] == ["straight"] and only.left_out[0].startswith("fails: ")
    none = next_trial(calibration, [Option("fails", "turning:35", speed=99.0)])
    assert none.options == () and identifiability_dict(found, none)["next_trial"]["best"]["gamma_N"] is None
    otherwise = only.to_dict(["antenna_offset.x"])["best"]["antenna_offset.x"]
    assert otherwise == {"name": MEASURED_OTHERWISE["antenna_offset"], "variance_left": None}


def test_every_ship_of_the_library_has_trials_it_can_run() -> None:
    for name in ("esso_osaka_3m", "kvlcc2_full", "vectwin_3m"):
        options = library(load_ship(name))
        # a full-scale ship is ordered standard manoeuvres, of which a crash stop goes astern
        assert any("crash-stop" in o.name if name == "kvlcc2_full" else "astern" in o.name for o in options)
        assert any(o.wind for o in options) == ("wind" in load_ship(name).components)
    assert library(load_ship("esso_osaka_3m"))[-1].arguments == "berthing --wind 1.5:60"


def test_values_outside_their_physical_range_are_named() -> None:
    prior = prior_of("a_H", "m_y", "Y_v", mean=0.3, std=0.05)
    words = implausible(prior, {"a_H": -0.07, "m_y": 0.42, "Y_v": -0.3})
    assert len(words) == 2 and "a_H = -0.07" in words[0]
    assert "2.4" in words[1]
    assert implausible(prior, {"a_H": 0.3, "m_y": 0.35, "Y_v": -0.3}) == []
    both = implausible(prior, {"a_H": -0.07, "m_y": 0.3, "Y_v": 0.3})  # what to do is said once
    assert [m.code for m in both] == ["implausible"] and "Y_v = 0.3" in both[0]


@pytest.mark.slow
def test_a_coefficient_far_from_its_prior_leads_to_what_the_trials_hide_and_never_to_a_narrower_prior() -> None:
    calibration = small_result().calibration
    assert calibration is not None
    p = np.array([12.0, -5.0])  # a hull that pushes, and an added mass far off
    prior = replace(prior_of("Y_v", "m_y"), mean=np.array([-0.3, 0.25]), std=np.array([0.1, 0.02]))
    warnings = estimate_warnings(SimpleNamespace(prior=prior), calibration.solution, p, [])  # type: ignore[arg-type]
    said = {m.code: str(m) for m in warnings}
    for code in ("far_from_prior", "implausible", "added_mass_far_from_prior"):
        assert "mmg diagnose" in said[code] and "narrow" not in said[code], code
    for kind, words in itertools.product(KINDS, (verdict, cause)):
        told = words(CoefficientFinding("a", kind, 0.9, 0.9, shift=4.0))
        assert "narrow" not in told and ("mmg diagnose" in told) == (kind == "strained")


def test_the_section_names_what_each_trial_would_help_and_bears_missing_keys() -> None:
    _, found, scored = nearly_straight()
    shown = identifiability_section({"identifiability": identifiability_dict(found, scored)})
    assert shown is not None and shown["trial"]["overall"]
    helped = {name.partition(" ")[0] for names in shown["helped"].values() for name in names}
    assert helped == {f.symbol for i, f in enumerate(found.findings) if scored.best(i)}
    assert set(shown["helped"]) <= {row["name"] for row in shown["options"]}
    assert identifiability_section({}) is None
    assert identifiability_section({"identifiability": {"coefficients": {"a": {}}}}) is not None


def test_a_profile_row_is_drawn_about_its_minimum_in_dispersions() -> None:
    row = {"symbol": "Y_v", "values": [1.0, 2.0, 3.0, 4.0], "increase": [8.0, 0.0, 8.0, None], "dispersion": 4.0}
    drawn = profile_plot(row, 0.5).axes[0]
    x, y = drawn.get_lines()[0].get_data()
    np.testing.assert_allclose(x, [1, 2, 3])
    np.testing.assert_allclose(y, [2, 0, 2])
    parabola = dict(zip(*drawn.get_lines()[1].get_data(), strict=True))
    assert parabola[1.0] == pytest.approx(2.0)
    assert drawn.get_xlabel() == "Y_v [-]"


# Trials and priors that do not belong into a calibration are named
FAST = Settings(passes=2)
NOISE = vars(SensorNoise.for_length(3.0))


def scrambled(trial: Trial) -> Trial:
    """Every sample an outlier."""
    rng = np.random.default_rng(0)
    sizes = {"x": 3.0, "y": 3.0, "psi": 0.3, "u": 0.2, "v": 0.1, "r": 0.05}
    return trial.with_columns(**{s: trial[s] + size * rng.normal(size=len(trial)) for s, size in sizes.items()})


def foreign(trial: Trial) -> Trial:
    """A run of another ship under the same name: one that turns the other way and much faster."""
    other = ESSO.with_values({s: k * ESSO.coefficients[s].value for s, k in (("N_r", 0.2), ("Y_v", 0.3), ("k_0", 1.5))})
    plan = parse_maneuver("zigzag:20/20", ESSO, n=10.0, duration=120.0)
    run = add_noise(simulate(other, plan, 0.1, None, 1), SensorNoise.for_length(3.0), 1)
    return Trial(trial.name, {**run.columns, "delta": -run["delta"]})


def named(trials: list[Trial]) -> list[str]:
    return [w for w in estimate_coefficients(ESSO, trials, FAST).warnings if "leave it out" in w]


@pytest.mark.slow
def test_runs_that_belong_are_not_named() -> None:
    assert named(list(runs()[0])) == []


def test_a_run_that_is_all_outliers_is_refused_by_name_before_the_fit() -> None:
    trials = list(runs()[0])
    bad = replace(scrambled(trials[4]), name="spoilt")
    with pytest.raises(UserError, match=r"^spoilt \(\d+"):
        estimate_coefficients(ESSO, [*trials[:4], bad, *trials[5:]], FAST)
    refuse_outliers(trials, 1.0)
    refuse_outliers([bad, trials[0]], 1.0)  # two runs: nobody knows which


@pytest.mark.slow
def test_a_run_whose_residuals_are_white_is_called_outliers() -> None:
    trials = list(runs()[0])
    rng = np.random.default_rng(1)
    noisy = {name: trials[4][name] + 7 * sd * rng.normal(size=len(trials[4])) for name, sd in NOISE.items()}
    mild = replace(trials[4].with_columns(**noisy), name="noisy")
    words = [w for w in estimate_coefficients(ESSO, [*trials[:4], mild, *trials[5:]], FAST).warnings if "noisy" in w]
    assert len(words) == 1


@pytest.mark.longest
@pytest.mark.slow
def test_a_run_of_another_ship_is_named_as_such() -> None:
    trials = list(runs()[0])[:4]
    words = named([*trials, replace(foreign(trials[0]), name="stranger")])
    assert len(words) == 1


def test_astern_coefficients_without_astern_motion_are_named_or_alone_refused_also_with_an_instrument() -> None:
    ahead = [t for t in runs()[0] if t["u"].min() > 0.05 and t["n"].min() >= 0]
    assert ahead
    astern = ("A_5", "B_5", "C_6", "C_7", "A_6")
    segments = cut(ahead, 1.0, 50.0, 5)
    only = ESSO.fixing([s for s in ESSO.symbols if s not in astern])
    for alone in (only, freeing_effects(only, ["velocity_filter"])):
        with pytest.raises(TooFewData, match="A_5, A_6, B_5"):
            unexcited_astern(alone, cut(ahead, 1.0, 50.0, 5, inputs=alone.inputs))
    words = unexcited_astern(ESSO, segments)
    assert len(words) == 1 and all(s in words[0] for s in astern)
    assert not any(s in words[0].split(":")[0].split(", ") for s in ("Y_v", "N_r", "k_0", "X_0F", "ell_R"))


@pytest.mark.parametrize("symbol", ["A_6", "C_6"])
def test_a_coefficient_that_acts_in_one_state_of_motion_alone_is_named(symbol: str) -> None:
    """A_6 is of the side force with sternway and a propeller ahead, C_6 of the thrust of a reversed one (Hachii)."""
    ahead = [t for t in runs()[0] if t["u"].min() > 0.05 and t["n"].min() >= 0]
    ship = ESSO.fixing([s for s in ESSO.symbols if s not in (symbol, "Y_v")])
    (message,) = unexcited_astern(ship, cut(ahead, 1.0, 50.0, 5))
    assert message.code == "not_excited_astern" and message.startswith(f"{symbol}:")


def test_a_planned_trial_of_two_rudders_is_written_with_the_unit_of_each_column(tmp_path: Path) -> None:
    orders, states = np.ones((3, 2)), np.zeros((3, 6))
    search: Any = SimpleNamespace(ship=true_ship("twin"), dt=1.0)
    PlannedTrial(search, orders, orders, states, states, np.eye(1), (), 0).write(str(tmp_path / "next.csv"))
    header = (tmp_path / "next.csv").read_text().splitlines()[0].split(",")
    assert {"n_2 [rps]", "delta_port [rad]", "delta_order [rad]", "n_order [rps]", "r_std [rad/s]"} <= set(header)


def test_priors_that_contradict_themselves_are_said() -> None:
    prior = Prior.of(ESSO)
    assert contradictions(prior) == []
    is_Y_v = np.array(prior.symbols) == "Y_v"
    lower = np.where(is_Y_v, prior.mean + 4 * prior.std, prior.lower)
    words = contradictions(replace(prior, lower=lower, upper=np.maximum(prior.upper, lower + prior.std)))
    assert len(words) == 1 and words[0].startswith("Y_v") and "4.0" in words[0]
    with pytest.raises(UserError, match="Y_v"):
        contradictions(replace(prior, std=np.where(is_Y_v, 0.0, prior.std)))


def test_a_start_at_which_the_model_explodes_is_read_back() -> None:
    start = {"number": 0, "objective": None, "converged": False, "distance": None}
    record = FitRecord.of({f.name: getattr(small_result(), f.name) for f in fields(FitRecord)} | {"starts": [start]})
    assert np.isnan([record.starts[0].objective, record.starts[0].distance]).all()


def test_starts_that_disagree_say_how_far() -> None:
    starts = [Start(0, 100.0, True, 0.0), Start(1, 130.0, True, 2.5, True, {"Y_v": -2.5, "N_r": 0.4}),
              Start(2, 1e9, False, 9.0)]  # fmt: skip
    words = disagreement(starts, 100.0)
    assert len(words) == 2 and "100" in words[0] and "Y_v by 2.5, N_r by 0.4" in words[0]
    assert disagreement(starts[:1], 100.0) == []


# Parts of a planned trial: placing in an area, orders within limits, information by another way, the search
PLANNED = ("X_0F", "Y_v", "N_r", "t_P")
# What is known before a trial: precision, worth of information, what is wanted, its names
NOW = np.diag([1.0, 4.0]), 0.5, np.eye(2), ("a", "b")


@pytest.fixture(scope="module")
def ship() -> Ship:
    model = load_ship("esso_osaka_3m")
    return model.fixing([s for s in model.symbols if s not in PLANNED])


def test_a_track_is_placed_so_that_the_hull_stays_inside(ship: Ship) -> None:
    area = Area.parse("60x25", ship, 0.5)
    t = np.linspace(0, 1, 50)
    track = np.stack([10 * t, 40 * t, np.full(50, 1.3)], axis=1)[:, :, None, None]  # too wide unless turned
    ((x0,), (y0,), (psi,)), excess = area.placing(track, ship)
    assert excess[0] == 0
    c, s = np.cos(psi), np.sin(psi)
    x, y = track[:, 0, 0, 0], track[:, 1, 0, 0]
    put = np.stack([x0 + c * x - s * y, y0 + s * x + c * y, track[:, 2, 0, 0] + psi], axis=1)
    cx, cy = corners(put[..., None], ship)
    assert cx.min() >= 0.5 - 1e-9 and cx.max() <= 59.5 + 1e-9 and cy.min() >= 0.5 - 1e-9 and cy.max() <= 24.5 + 1e-9
    assert area.placing(track, ship, turned=False)[1][0] > 10


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_run_up_lies_where_the_ship_comes_from(ship: Ship, side: float) -> None:
    area = Area.parse("60x25", ship, 0.5)
    states = np.zeros((3, 6, 1, 1))
    states[:, 0, 0, 0], states[:, 3] = side * np.array([0.0, 22.5, 45.0]), side * 0.5
    search: Any = SimpleNamespace(ship=ship, area=area)
    (x, _, psi), excess = SequenceSearch.placing(search, states)
    at = x[0] - side * RUN_UP * 3.0 * np.cos(psi[0])
    assert excess[0] == 0 and 0.5 + 1.5 <= at <= 59.5 - 1.5  # the hull, with the margin, half a length each way


@pytest.mark.parametrize("text", ["60", "60x", "ax25", "-60x25", "60xnan", "2.5x2.5", "60x0.2"])
def test_an_area_that_is_none_or_too_small_is_refused(ship: Ship, text: str) -> None:
    with pytest.raises(UserError, match="--area"):
        Area.parse(text, ship)


def test_orders_stay_within_limits_and_rates() -> None:
    limits = Limits(0.1, 2.0)
    s = Sequences(100, 0.5, 5, 2, 0.6, (-5.0, 10.0), np.array([0.2, 0.4]), np.array([4.0, 9.0]), limits)
    orders, speed, revolutions = s.orders(np.random.default_rng(0).uniform(-0.5, 1.5, (20, s.size)))
    assert np.abs(orders[:, 1]).max() <= 0.6 + np.radians(0.5) and orders[:, 0].min() >= -5 and orders[:, 0].max() <= 10
    assert speed.min() >= 0.2 and speed.max() <= 0.4
    moved = s.positions(orders, revolutions)
    assert np.abs(np.diff(moved[:, 1], axis=0)).max() <= 0.1 * 0.5 + 1e-12
    assert np.abs(np.diff(moved[:, 0], axis=0)).max() <= 2.0 * 0.5 + 1e-12
    switches = (np.abs(np.diff(orders, axis=0)).max(axis=1) > 1e-9).sum(axis=0)
    assert switches.max() <= 5  # of five stretches of rudder and two of revolutions


def test_the_information_is_that_of_a_fit(ship: Ship) -> None:
    """The same windows by ``fitting.nlp.fisher_information``, its states eliminated by another recursion."""
    simulator, prior, h = Simulator(ship, compiled=False), Prior.of(ship), 0.5
    run = simulate_batch(simulator, parse_maneuver("zigzag:20/20", ship, duration=30.0), dt=h)
    trial: Trial = run.trial(0)
    sigma = np.array([0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006])
    problem = Problem.of(ship, prior, cut([trial], h, 15.0, 5, inputs=ship.inputs), sigma, compiled=False)
    expected = information(problem, problem.join(problem.measured_nodes, np.zeros(problem.P))).fisher.sum(axis=0)
    info = TrialWorth(simulator, prior, sigma, h, 30, *NOW)
    held = np.zeros((len(run.inputs) - 1, len(ship.inputs), 1))
    held[:, :2] = run.inputs[:-1]
    states = info.simulator.run(run.states[0], held, h)
    assert states[:, :6] == pytest.approx(run.states, abs=1e-9)
    found = info.fisher(states, held)
    assert found[0] == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(expected).max())
    sent = pickle.loads(pickle.dumps(info))  # to another process of a plan
    assert np.array_equal(sent.fisher(states, held), found)


def test_what_a_trial_gains_is_the_mean_log_of_the_variances() -> None:
    trials = TrialWorth(Simulator(ESSO, compiled=False), prior_of("a", "b"), np.ones(6), 0.5, 30, *NOW)
    assert trials.variances() == pytest.approx([1.0, 0.25])
    assert trials.gain(np.diag([2.0, 0.0])) == pytest.approx(0.5 * np.log(0.5))


def test_the_search_finds_the_least_of_a_tilted_valley() -> None:
    aim = np.array([0.2, 0.7, 0.4, 0.9])

    def cost(x: np.ndarray) -> np.ndarray:
        d = x - aim
        return (d**2).sum(axis=1) + 100 * (d[:, 0] + d[:, 1]) ** 2

    found = Evolution(np.full(4, 0.5), 0.3, 12, np.random.default_rng(1))
    for _ in range(120):
        found.advance(cost)
    assert found.best == pytest.approx(aim, abs=0.01)


def test_a_short_manoeuvre_is_repeated_with_way_between(ship: Ship) -> None:
    def lasting(seconds: float, u: float) -> Trial:
        t = np.arange(0.0, seconds + 0.5)
        return Trial("a", {"t": t, **{name: np.full(len(t), u if name == "u" else 0.0) for name in "xyuvr"}})

    length, u = ship.particulars["L"], 0.5
    between = 5 * length / u  # 30 s
    assert repetitions(lasting(20.0, u), 20.0 + 2 * (20.0 + between) + 1.0, ship) == 3
    assert repetitions(lasting(100.0, u), 100.0, ship) == 1 and repetitions(lasting(10.0, 0.0), 200.0, ship) == 1


def test_a_ship_with_a_diesel_engine_does_not_reverse_and_a_towing_tank_has_no_wind(ship: Ship) -> None:
    assert not any(option.wind for option in library(load_ship("esso_osaka_3m"), wind=False))
    assert is_reversible(ship) and not is_reversible(load_ship("kvlcc2_full"))


# The windows that are chosen tell more than as many others
def logged_windows(seed: int = 0) -> Innovations:
    """40 windows of two stretches, three coefficients; few windows tell anything of the third."""
    rng = np.random.default_rng(seed)
    gains = rng.standard_normal((80, 24, 3)) * np.array([1.0, 0.5, 0.0])
    gains[[10, 33, 60], :, 2] = rng.standard_normal((3, 24))
    names = ("a", "b", "c")
    return Innovations(np.arange(80.0), np.arange(80) // 2, rng.standard_normal((80, 24)), gains, names, np.ones(3),
                       np.arange(24) % 6)  # fmt: skip


def test_a_rare_manoeuvre_is_chosen_one_moved_by_something_else_is_not_and_all_tell_more_than_random_ones() -> None:
    choice = choose_windows(logged_windows(), 3)
    assert set(choice.windows) & {5, 16, 30}
    assert list(choice.gains) == sorted(choice.gains, reverse=True)
    data = logged_windows(1)
    choice, (numbers, information) = choose_windows(data, 6), window_information(data)
    rng = np.random.default_rng(0)
    for _ in range(20):
        chance = rng.choice(len(numbers), 6, replace=False)
        assert sum(choice.gains) > np.linalg.slogdet(np.eye(3) + information[chance].sum(axis=0))[1]
    assert sum(choice.gains) < choice.all
    data = logged_windows(2)
    data.errors[20] += 100.0
    assert 10 not in window_information(data)[0]
