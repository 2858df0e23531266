"""Prediction bands: they hold nine tenths of the errors where the truth is known, and are stored and written."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import draw_coefficients, simulate_batch
from cases.trial import Trial
from fitting.nlp.windows import Record, Stretch
from fitting.prediction.bands import (
    NORMAL,
    Bands,
    Process,
    bands_of,
    correlation_in,
    draws_of,
    fit_bands,
    process_dict,
    sample_noise,
    velocity_variance,
)
from fitting.prediction.envelope import (
    MOST_NEW,
    HeldMotion,
    envelope_of,
    held_dict,
    held_motion,
    held_of,
    met_so_far,
    trial_envelope,
)
from fitting.prediction.figure_intervals import (
    RESISTANCE,
    UNTRIED,
    accelerations,
    drawn_figures,
    drawn_resistance,
    greatest_accelerations,
)
from fitting.prediction.predict import predict, predict_all
from fitting.prediction.stretches import WindowBatch, record_of
from mmg.motion.flow import STATES
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.disturbed_trials import Disturbed, disturbed_trials
from tests.support.synthetic_runs import coarse_runs

RUNS = (("zigzag:20/20", 100.0), ("turning:35", 120.0), ("random:11", 120.0), ("random:12", 120.0), ("berthing", 120.0))


@cache
def simulator() -> Simulator:
    return Simulator(hidden_ship())


@cache
def trials(seed: int) -> tuple[Trial, ...]:
    """Runs of the true ship, pushed by random forces."""
    return tuple(disturbed_trials(hidden_ship(), RUNS, seed, Disturbed(defects=()), dt=0.2))


@cache
def fitted() -> Any:
    return fit_bands(simulator(), trials(1))


def bands(**more: object) -> Any:
    return bands_of({"bands": fitted(), **more}, simulator().ship)


@pytest.mark.slow
@pytest.mark.parametrize(("length", "least", "most"), [(30.0, 0.84, 0.97), (60.0, 0.78, 0.99)])
def test_bands_hold_nine_tenths_of_the_errors_of_other_runs(length: float, least: float, most: float) -> None:
    """They grow with time from nothing."""
    inside = []
    predicted = predict_all(simulator(), trials(2), length, length / 2, bands=bands())
    for trial, (windows, _) in zip(trials(2), predicted, strict=True):
        for w in windows:
            inside.append(np.abs(w.error(trial.states)[1:]) < NORMAL * w.std[1:])
            assert (w.std[0] == 0).all() and (w.std[1:] > 0).all()
        whole = [w.std for w in windows if len(w.std) > 100]  # the last one may be short
        early, middle, late = (np.mean([std[row] for std in whole], axis=0) for row in (5, 25, 100))
        assert (late > early).all() and (late[:3] > middle[:3]).all()
    share = np.vstack(inside).mean(axis=0)
    assert (share > least).all() and (share < most).all(), share


def test_uncertain_coefficients_widen_the_bands_alike_without_compiled_code() -> None:
    """There the draws are simulated side by side."""
    symbols = ["Y_v", "N_r"]
    rows = {s: {"std": 0.5 * abs(simulator().ship.coefficients[s].value)} for s in symbols}
    sure = bands()
    unsure = bands(coefficients=rows, correlation={"symbols": symbols, "matrix": [[1.0, 0.5], [0.5, 1.0]]})
    plain = Simulator(hidden_ship(), compiled=False)
    assert sure.root.shape[1] == 0 and unsure.root.shape[1] > 1 and plain.is_stepwise
    cases = ((simulator(), sure), (simulator(), unsure), (plain, unsure))
    narrow, wide, same = (predict(s, trials(2)[1], 30.0, 30.0, bands=b)[0][0] for s, b in cases)
    assert (wide.std[-1] > narrow.std[-1]).all()
    np.testing.assert_allclose(same.std, wide.std, rtol=1e-7, atol=1e-9)
    bare = predict(simulator(), trials(2)[1], 30.0, 30.0)[0][0]
    assert bare.std is None and np.array_equal(bare.states, wide.states)


def test_the_variance_by_coefficients_is_that_of_steps_from_row_to_row() -> None:
    """It is taken in steps between the rows at which it is wanted, which is 5 samples here: to a few per cent."""
    ship, record = hidden_ship(), record_of(trials(1)[0], hidden_ship().inputs)
    batch = WindowBatch.of([Stretch(record, first, first + last) for first, last in ((0, 300), (40, 297), (100, 250))])
    rows = np.arange(0, 301, 5)
    rng, at = np.random.default_rng(3), [ship.symbols.index(s) for s in ("Y_v", "N_r", "t_R", "w_P0")]
    root = np.zeros((len(ship.symbols), 8))
    root[at] = 0.05 * ship.values[at][:, None] * rng.normal(size=(4, 8))
    known = Bands(bands().process, root)
    found = known.coefficient_variance(simulator(), batch, rows)
    exact = known.coefficient_variance(simulator(), batch, np.arange(301))[rows]
    assert found.shape == (61, 6, 3) and exact[-1].min() > 0
    np.testing.assert_allclose(np.sqrt(found.mean(axis=(0, 2))), np.sqrt(exact.mean(axis=(0, 2))), rtol=0.03)


def test_draws_have_the_covariance_that_was_stored() -> None:
    ship = simulator().ship
    rows = {"Y_v": {"std": 0.02}, "N_r": {"std": 0.01}}
    correlation = {"symbols": ["Y_v", "N_r"], "matrix": [[1, 1], [1, 1]]}
    root = draws_of({"coefficients": rows, "correlation": correlation}, ship)
    a, b = root[ship.symbols.index("Y_v")], root[ship.symbols.index("N_r")]
    np.testing.assert_allclose(a, 2 * b)
    assert 0.01 < a.std() < 0.03
    assert np.count_nonzero(root.any(axis=1)) == 2
    for unknown in (None, {"symbols": ["a", "b"], "matrix": [[1.0, None], [0.5, 1.0]]}):
        assert correlation_in({"correlation": unknown}) is None


def test_variance_of_the_process_agrees_with_a_simulation_of_it() -> None:
    memory, decay, dt, steps, count = 3.0, 8.0, 0.05, 400, 4000
    rng = np.random.default_rng(0)
    left = np.exp(-dt / memory)
    a, e = rng.standard_normal(count), np.zeros(count)
    for _ in range(steps):
        e += dt * (a - e / decay)
        a = left * a + np.sqrt(1 - left**2) * rng.standard_normal(count)
    expected = velocity_variance(np.ones((41, 1)), np.full((40, 1), 0.5), memory, decay)[-1, 0]
    assert e.var() == pytest.approx(expected, rel=0.08)


def test_noise_of_samples_is_found_under_smooth_motion() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0, 200, 0.1)
    columns = {"t": t, "psi": 0.5 * np.sin(0.1 * t) + 0.01 * rng.standard_normal(len(t))}
    columns |= {name: np.cos(0.1 * t) + 0.02 * rng.standard_normal(len(t)) for name in ("x", "y", "u", "v", "r")}
    columns |= {"n": np.ones_like(t), "delta": np.zeros_like(t)}
    found = sample_noise([Trial("noisy", columns)])
    np.testing.assert_allclose(found, [0.02, 0.02, 0.01, 0.02, 0.02, 0.02], rtol=0.15)


def test_what_is_stored_is_plain_and_too_few_windows_give_no_bands() -> None:
    text = json.loads(json.dumps(fitted()))
    assert set(text["factor"]) == set(STATES) == set(text["noise"])
    assert bands_of({"bands": {}}, simulator().ship) is None and bands_of({}, simulator().ship) is None
    short = Trial("short", {name: values[:100] for name, values in trials(1)[0].columns.items()})
    assert fit_bands(simulator(), [short]) is None


# Bands widen for motions that the trials did not hold, and only for those
@cache
def run(maneuver: str, ship: str = "", n: float = 10.0, duration: float = 100.0) -> Trial:
    return simulate(model(ship), parse_maneuver(maneuver, model(ship), n=n, duration=duration), dt=0.5)


def model(ship: str) -> Ship:
    return load_ship(ship) if ship else hidden_ship()


def records(*maneuvers: str, ship: str = "", n: float = 10.0) -> list[Record]:
    return [record_of(run(m, ship, n), model(ship).inputs) for m in maneuvers]


def held(*maneuvers: str, ship: str = "", n: float = 10.0) -> Any:
    return held_motion(records(*maneuvers, ship=ship, n=n), model(ship).inputs, model(ship).particulars["L"])


def novelty(known: HeldMotion, maneuver: str, ship: str = "", n: float = 10.0) -> np.ndarray:
    (record,) = records(maneuver, ship=ship, n=n)
    return known.novelty(record.states[:, :, None], record.controls[:, :, None], model(ship).particulars["L"])[:, 0]


def test_other_revolutions_are_new_and_novelty_has_an_end_and_counts_from_the_start() -> None:
    known = held("zigzag:10/10", "zigzag:20/20")
    (record,) = records("zigzag:20/20")
    controls = record.controls.copy()
    controls[:, 0] *= 2
    assert known.novelty(record.states[:, :, None], controls[:, :, None], 3.0).min() > 1
    assert (known.novelty(np.full((5, 6, 2), 1e3), np.zeros((5, 4, 2)), 3.0) == MOST_NEW).all()
    met = met_so_far(np.arange(5.0)[:, None], np.array([0.0, 0, 2, 2, 2])[:, None])
    np.testing.assert_allclose(met[:, 0], [0, 0, 2, 8 / 3, 3])


@pytest.mark.parametrize(("ship", "n"), [("", 10.0), ("kvlcc2_l7", 3.0)])
def test_a_circle_is_new_to_zigzags_and_another_zigzag_is_not(ship: str, n: float) -> None:
    known = held("zigzag:10/10", "zigzag:20/20", "zigzag:15/15", ship=ship, n=n)
    circle, zigzag = novelty(known, "turning:35", ship, n), novelty(known, "zigzag:18/18", ship, n)
    assert np.median(circle[len(circle) // 2 :]) > 0.5
    assert np.quantile(zigzag, 0.9) < 0.2


def test_the_band_of_a_circle_widens_and_that_of_a_zigzag_stays() -> None:
    wide, ratio = held_bands(0.002, ""), {}
    bare = replace(wide, held=None)
    for maneuver in ("turning:35", "zigzag:18/18"):
        pair = [predict(Simulator(hidden_ship()), run(maneuver), 60.0, 60.0, bands=b)[0][0].std for b in (bare, wide)]
        ratio[maneuver] = (pair[1][-1] / pair[0][-1]).mean()
    assert ratio["turning:35"] > 1.08 and ratio["zigzag:18/18"] < 1.02


def test_it_is_stored_as_plain_values_and_only_for_the_same_inputs() -> None:
    known, names = held("zigzag:10/10", "zigzag:20/20"), hidden_ship().inputs
    again = held_of(json.loads(json.dumps(held_dict(known))), names)
    assert again is not None and again.reach == known.reach
    assert held_of(held_dict(known), ("n", "delta_port", "delta_starboard")) is None
    assert held_of(None, names) is None and held_of({"points": [1]}, names) is None
    assert held_motion([], names, 3.0) is None


def test_a_single_trial_says_what_it_held_by_its_halves() -> None:
    """A turning circle is new to a ship that was tried in one zigzag, and that zigzag is not."""
    one = held("zigzag:20/20")
    assert np.mean(novelty(one, "zigzag:20/20") > 0) < 0.2 < 0.5 < np.mean(novelty(one, "turning:35") > 0)


# The envelope is the range of what the force models saw in the trials
def test_it_holds_the_extremes_of_the_trials_of_velocities_through_the_water() -> None:
    ship, trials = load_ship("esso_osaka_3m"), coarse_runs()[0][:2]
    columns = {name: np.concatenate([t[name] for t in trials]) for name in ("psi", "u", "v", "r", "n", "delta")}
    for current in (0.0, 5.0):
        found = trial_envelope(ship.with_effect("current", {"x": current, "y": 0.0}) if current else ship, trials)
        assert set(found) >= {*ship.features, "beta"}
        through = {"u": columns["u"] - current * np.cos(columns["psi"]),
                   "v": columns["v"] + current * np.sin(columns["psi"])}  # fmt: skip
        for name, values in (columns | through).items():
            assert name == "psi" or found[name] == pytest.approx([values.min(), values.max()])


def test_rows_with_gaps_count_nothing() -> None:
    ship, trial = load_ship("esso_osaka_3m"), coarse_runs()[0][0]
    u = trial["u"].copy()
    u[5], u[6] = 99.0, np.nan
    v = trial["v"].copy()
    v[5] = np.nan
    assert trial_envelope(ship, [trial.with_columns(u=u, v=v)])["u"][1] < 10.0
    assert trial_envelope(ship, [trial.with_columns(u=np.full_like(u, np.nan))]) == {}


def test_a_drift_angle_near_rest_counts_nothing() -> None:
    features = np.array([[1.0, 1.0, 0.001], [0.0, -0.1, -0.01], [0.0, 0.0, 0.0]])
    assert envelope_of(("u", "v", "r"), features)["beta"] == pytest.approx([0.0, np.arctan(0.1)])


# What no model explains lasts for a ship, passes in a trial, fades at rest, and never keeps a ship from stopping
SPEED, STEP, COUNT = 0.4, 0.5, 400


def held_bands(size: float, ship: str = "esso_osaka_3m") -> Any:
    """Of a ship tried in zigzags at about 0.4 m/s, with a process of that ``size`` [m/s^2]."""
    sizes, one = np.zeros((3, 3)), np.ones((1, 6))
    sizes[:, 0] = size, size, size / 3
    process = Process(np.full(3, 2.0), np.full(3, 20.0), sizes, np.zeros(6), one, one, np.array([30.0]))
    return Bands(process, np.zeros((len(model(ship).symbols), 0)), held("zigzag:10/10", "zigzag:20/20", ship=ship))


def nominal_run(kind: str = "crash-stop", speed: float = SPEED) -> tuple[Any, Any, Any]:
    ship = load_ship("esso_osaka_3m")
    plan = parse_maneuver(kind, ship, speed=speed)
    return ship, plan, simulate_batch(Simulator(ship), plan, dt=STEP)


def test_a_stop_never_tried_has_a_share_of_its_deceleration_as_error() -> None:
    """Each ship's own: what she loses in a step without it, also while it is added to that."""
    ship, plan, nominal = nominal_run()
    k = int(np.argmax(nominal.states[:, 3, 0] < 0.7 * SPEED))
    here = np.tile(nominal.states[k, :, 0][:, None], (1, 2 * COUNT))
    for known, copies in ((held_bands(1e-6), 2), (None, 1)):  # of a ship without trials too
        push = accelerations(known, ship, plan, nominal, COUNT, STEP, 1)
        states, loss = here[:, : copies * COUNT].copy(), 0.004
        for step in range(3):
            value = push(k + step, states)
            expected = UNTRIED * loss if step else 0.0
            assert value[0, :COUNT].std() == pytest.approx(expected, rel=0.1, abs=1e-6)
            states[3] += STEP * (value[0] - loss)


def test_no_lasting_part_exceeds_a_share_of_what_turns_the_ship() -> None:
    """However large the errors of the trials grow outside them."""
    ship, plan, nominal = nominal_run("turning:35", 1.2)
    most = greatest_accelerations(nominal)
    t, u, r = nominal.t, nominal.states[:, 3, 0], nominal.states[:, 5, 0]
    k = int(np.argmax(np.abs(u * r)))
    assert most[0] == most[1] >= 0.9 * abs(u[k] * r[k]) and 0 < most[2] < 1.0
    assert most[2] == pytest.approx(np.abs(np.diff(r) / np.diff(t)).max(), rel=0.2)
    states = np.tile(nominal.states[k, :, 0][:, None], (1, 2 * COUNT))
    stds = [accelerations(held_bands(size), ship, plan, nominal, COUNT, STEP, 1)(k, states)[:, :COUNT].std(axis=1)
            for size in (1e-5, 0.1, 10.0)]  # fmt: skip
    assert stds[1] == pytest.approx(UNTRIED * most, rel=0.1) and stds[2] == pytest.approx(stds[1])
    assert (stds[0] < 0.05 * stds[1]).all()


def test_the_lasting_part_fades_with_the_square_of_the_speed() -> None:
    ship, plan, nominal = nominal_run()
    k, pushed = int(np.argmax(nominal.states[:, 3, 0] < 0.7 * SPEED)), []
    for speed in (0.0, 0.1, -0.1, 5.0):
        states = np.zeros((6, 2 * COUNT))
        states[3] = speed
        pushed.append(accelerations(held_bands(0.01), ship, plan, nominal, COUNT, STEP, 1)(k, states))
    rest, slow, back, fast = (np.abs(value[1, :COUNT]).mean() for value in pushed)
    # 0.1 m/s and 5 m/s are below and above the speeds of nearly all of the trials
    assert rest == 0 and slow == back and 0.02 * fast < slow < 0.25 * fast
    assert (pushed[0][:, COUNT:].std(axis=1) > 0).all()  # gusts do not ask for speed


@pytest.mark.slow
def test_a_stop_never_tried_ends_however_little_the_model_explains() -> None:
    """The interval of a stop that no trial held is wide, and has an upper end."""
    ship, plan, _ = nominal_run()
    few = ship.fixing([s for s in ship.free if s != "t_P"])
    reach = {}
    for size in (1e-4, 0.02):
        b = held_bands(size)
        content = {"bands": process_dict(b.process) | {"held": held_dict(b.held)}}
        found, _ = drawn_figures(Simulator(few), plan, draw_coefficients(few, 120, 3), content, 3)
        reach[size] = found.ship["track_reach"]
        assert np.isfinite(reach[size]).mean() > 0.97
    for values in reach.values():
        low, middle, high = np.nanquantile(values, (0.05, 0.5, 0.95))
        assert low < 0.8 * middle < 1.4 * middle < high < 4 * middle


def test_the_resistance_of_a_stop_is_drawn_where_it_is_an_estimate() -> None:
    full = load_ship("kvlcc2_full")
    plan = parse_maneuver("crash-stop", full)
    drawn = drawn_resistance(full, plan, {}, 2000, 0)
    (symbol,) = plan.factors
    assert set(drawn) == {symbol}
    shares = np.log(drawn[symbol] / full.coefficients[symbol].value)
    assert shares.std() == pytest.approx(RESISTANCE, rel=0.1) and abs(shares.mean()) < 0.01
    assert drawn_resistance(full, parse_maneuver("turning:35", full), {}, 10, 0) == {}
