"""A ship followed sample by sample, on synthetic truth: as sure as it is right, equal to its references."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from diagnosis.estimation.random_states import CURRENT, FADES, FORCE, Noise
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, UnknownName, Unsupported, UserError
from mmg.motion.flow import STATES
from mmg.motion.froude import force_scale, length_scale, state_scale, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.api import simulate
from mmg_ident.tracker import State, Tracker
from tests.support.hybrids import lacking

SHIPS = {"esso_osaka_3m": (10.0, 0.4), "kvlcc2_full": (1.6, 7.0)}  # Ship -> revolutions [1/s], approach speed [m/s]
STEPS, RUNS = 240, 8
CHANCE = 4.0  # Standard deviations of a mean of chi-square numbers within which it lies but for 1 time in 16,000


def noise_of(ship: Ship) -> Noise:
    """Sizes for a ship: those of a 3 m model by Froude's law, errors of each sample its own."""
    length = float(ship.particulars["L"])
    k = time_scale(length)
    force = np.array([0.3, 0.5, 0.2 * length_scale(length)]) * force_scale(length)
    sensors = np.array([0.01, 0.01, 0.002, 0.004, 0.004, 0.0006]) * state_scale(length)
    return Noise(force, 6.0 * k, sensors, 0.01 * k, 0.0)


class Truth:
    """Runs of a ``ship`` under random forces and currents of the sizes of ``noise``, with what is logged of them.

    t: (N + 1,); states: (N + 1, S, M); random: (N + 1, 5, M); logged: (N + 1, 6, M); controls: (N + 1, C, M).
    """

    def __init__(self, ship: Ship, speed: float, n: float, noise: Noise, steps: int = STEPS, runs: int = RUNS) -> None:
        rng, k = np.random.default_rng(0), time_scale(ship.particulars["L"])
        full = ship.with_effect("tow", {}).with_effect("current", {})
        simulator, h = Simulator(full), 0.5 * k
        at = [full.symbols.index(s) for s in (*FORCE, *CURRENT)]
        size = np.array([*noise.force, noise.current, noise.current])[:, None]
        left = np.exp(-h / np.array([noise.memory] * 3 + [FADES * k] * 2))[:, None]
        self.t = h * np.arange(steps + 1)
        held = np.repeat(rng.uniform(-0.5, 0.5, (-(-steps // 20) + 1, runs)), 20, axis=0)[: steps + 1]
        air = np.zeros((steps + 1, 2, runs))
        time = np.repeat(self.t[:, None, None], runs, axis=2)
        self.controls = np.concatenate([np.full((steps + 1, 1, runs), n), held[:, None], air, time], axis=1)
        random = size * rng.standard_normal((5, runs))
        six = np.zeros((6, runs))
        six[2], six[3] = rng.uniform(-3, 3, runs), speed
        z = simulator.start(six, self.controls[0])
        states, pushed = [z], [random]
        for row in self.controls[:-1]:
            theta = np.repeat(full.values[:, None], runs, axis=1)
            theta[at] += random
            z = simulator.run(z, row[None], h, theta)[-1]
            random = left * random + size * np.sqrt(1 - left**2) * rng.standard_normal((5, runs))
            states.append(z)
            pushed.append(random)
        self.states, self.random = np.array(states), np.array(pushed)
        error = noise.sensors[:, None] * rng.standard_normal((steps + 1, 6, runs))
        self.logged = simulator.columns(self.states) + error

    def follow(self, tracker: Tracker, run: int) -> list[State]:
        """The states of a ``tracker`` that is fed one ``run``, the heading wrapped."""
        rows = self.logged[:, :, run].copy()
        rows[:, 2] = np.mod(rows[:, 2], 2 * np.pi)
        return [tracker.update(*given) for given in zip(self.t, rows, self.controls[:, :2, run], strict=True)]


def lagging(name: str) -> Ship:
    """The ship of this name; that of 3 m with the lag of its logged velocities."""
    ship = load_ship(name)
    return ship.with_effect("velocity_filter", {"tau": 1.0}) if name == "esso_osaka_3m" else ship


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPS)
def test_it_is_as_sure_as_it_is_right(name: str) -> None:
    """Innovations by the chi-square law with six degrees of freedom, errors of all states by that with eleven; those
    of a run are alike over the memory of the force, so that only one in it counts."""
    ship, (n, speed) = lagging(name), SHIPS[name]
    noise = noise_of(ship)
    truth = Truth(ship, speed, n, noise)
    nis, squares, tracker = [], [], None
    for run in range(RUNS):
        tracker = Tracker(ship, noise=noise)
        found = truth.follow(tracker, run)
        nis += [s.nis for s in found[1:]]
        apart = found[20::20]
        true = np.hstack([truth.logged[20::20, :, run], truth.random[20::20, :, run]])
        true[:, :6] = Simulator(tracker.ship).columns(truth.states[20::20])[..., run]
        for state, row in zip(apart, true, strict=True):
            error = state.mean - row
            error[2] = math.remainder(error[2], 2 * math.pi)
            squares.append(error @ np.linalg.solve(state.covariance, error))
    assert all(s.compared == 6 for s in found[1:])
    assert abs(np.mean(nis) - 6) < CHANCE * math.sqrt(2 * 6 / len(nis))
    assert abs(np.mean(squares) - 11) < CHANCE * math.sqrt(2 * 11 / len(squares))


@pytest.mark.slow
def test_forecasts_hold_what_comes_in_their_band() -> None:
    """Nine of ten, of many runs; and nearer to it than where the ship goes by herself from the last sample."""
    ship, (n, speed) = lagging("esso_osaka_3m"), SHIPS["esso_osaka_3m"]
    noise = noise_of(ship)
    truth, now = Truth(ship, speed, n, noise, 160, 16), 120
    inside, own, plain = [], [], []
    simulator = Simulator(ship)
    for run in range(16):
        tracker = Tracker(ship, noise=noise)
        for k in range(now + 1):
            tracker.update(truth.t[k], truth.logged[k, :, run], truth.controls[k, :2, run])
        found = tracker.forecast(20.0, truth.controls[now:-1, :2, run])
        assert np.allclose(found.t, truth.t[now:])
        error = truth.logged[now + 1 :, :, run] - found.states[1:]
        error[:, 2] = np.pi - np.mod(np.pi - error[:, 2], 2 * np.pi)
        inside.append(np.abs(error) < 1.645 * found.std[1:])
        own.append(error[-1, :2])
        start = simulator.start(truth.logged[now, :, run : run + 1], truth.controls[now, :-1, run : run + 1])
        way = simulator.run(start, truth.controls[now:-1, :-1, run], 0.5)[-1, :2, 0]
        plain.append(truth.logged[-1, :2, run] - way)
    assert 0.85 < np.mean(inside) < 0.95
    assert np.square(own).mean() < 0.8 * np.square(plain).mean()


@pytest.mark.slow
def test_it_is_that_of_numpy() -> None:
    """After the same samples at irregular times, some missing and with a gap."""
    ship = lagging("esso_osaka_3m")
    truth, forecasts = Truth(ship, 0.4, 10.0, noise_of(ship), 60, 1), []
    for is_compiled in (True, False):
        tracker = Tracker(ship, {"X_0F": 0.002, "velocity_filter.tau": 0.2}, compiled=is_compiled)
        for k in (0, 1, 2, 4, 7, 8, 30, 31, 60):
            logged = truth.logged[k, :, 0].copy()
            logged[k % 6] = np.nan
            logged[2] = truth.logged[k, 2, 0]
            tracker.update(truth.t[k] + 0.01 * (k % 3), logged, truth.controls[k, :2, 0])
        forecasts.append(tracker.forecast(5.0))
    compiled, portable = forecasts
    assert not tracker.equations.is_compiled
    assert np.allclose(compiled.states, portable.states, rtol=1e-9, atol=1e-12)
    assert np.allclose(compiled.std, portable.std, rtol=1e-9)


def pushed(ship: Ship, seconds: int, **values: float) -> Trial:
    """A turning and straight run of a ship, with values of her coefficients, sampled at 1 s without errors."""
    true = ship.with_effect("tow", {}).with_values({k.replace("__", "."): v for k, v in values.items()})
    t = np.arange(seconds + 1.0)
    delta = 0.3 * np.sin(2 * np.pi * t / 60)
    inputs = np.column_stack([np.full(len(t), 10.0), delta, np.zeros((len(t), 2))])
    start = np.array([0.0, 0, 0, 0.4, 0, 0])[:, None]
    states = Simulator(true).run(start, inputs[:-1], 1.0)[..., 0]
    columns = dict(zip(("x", "y", "psi", "u", "v", "r"), states.T, strict=True))
    return Trial("pushed", {"t": t, **columns, "n": inputs[:, 0], "delta": delta})


def after(tracker: Tracker, trial: Trial) -> State:
    """The last state of a ``tracker`` fed a ``trial`` by name."""
    names = [n for n in tracker.inputs if n in trial]
    for k in range(len(trial)):
        state = tracker.update(trial.t[k], trial.states[k], {n: trial[n][k] for n in names})
    return state


@pytest.mark.slow
def test_a_constant_disturbance_is_found() -> None:
    ship = load_ship("esso_osaka_3m")
    usual = Noise.of({}, ship)
    run = pushed(ship, 200, tow__X=0.4, tow__N=-0.3)
    noise = replace(usual, memory=1e4, current=1e-6)
    state = after(Tracker(ship, noise=noise), run)
    assert state.disturbance == pytest.approx([0.4, 0.0, -0.3], abs=0.02)
    assert np.all(np.abs(state.disturbance - [0.4, 0.0, -0.3]) < 3 * state.std[6:9])
    assert state["tow.X"] == state.disturbance[0]


@pytest.mark.slow
def test_a_wrong_coefficient_is_found() -> None:
    ship = load_ship("esso_osaka_3m")
    true = 1.3 * ship.coefficients["N_r"].value
    noise = replace(Noise.of({}, ship), force=np.array([1e-3] * 3), current=1e-6, interval=0.0)
    first = Tracker(ship, ["N_r"], noise=noise)
    state = after(first, pushed(ship, 200, N_r=true))
    assert abs(state["N_r"] - true) < 0.1 * abs(true - ship.coefficients["N_r"].value)
    assert abs(state["N_r"] - true) < 3 * state.std[-1] < 0.5 * ship.coefficients["N_r"].std


@pytest.mark.slow
def test_many_samples_of_shared_errors_tell_what_few_tell() -> None:
    """Ten samples a second whose errors are shared over a second leave the deviation of one a second."""
    ship = load_ship("esso_osaka_3m")
    noise = replace(Noise.of({}, ship), interval=1.0)
    stds = []
    for every in (10, 1):
        tracker = Tracker(ship, noise=noise)
        for k in range(0, 601, every):
            state = tracker.update(0.1 * k, [0.04 * k, 0, 0, 0.4, 0, 0], [10.0, 0.0])
        stds.append(state.std)
    assert stds[0] == pytest.approx(stds[1], rel=0.2)


@pytest.mark.slow
def test_what_is_missing_makes_it_less_sure_and_nothing_else() -> None:
    ship = load_ship("esso_osaka_3m")
    run = pushed(ship, 60)
    blind = Tracker(ship)
    full, half = after(Tracker(ship), run), None
    for k in range(61):
        known = {"psi": run["psi"][k], "u": run["u"][k], "v": run["v"][k], "r": math.nan}
        half = blind.update(run.t[k], known if k != 30 else {}, {"n": 10.0, "delta": run["delta"][k]})
    assert half is not None and half.compared == 3
    assert half["r"] == pytest.approx(run["r"][-1], abs=4 * half.std[5])
    assert np.all(half.std[:6] > full.std[:6]) and half.std[0] > 2


@pytest.mark.slow
def test_controls_ahead_may_be_given_in_each_way() -> None:
    tracker = Tracker(load_ship("esso_osaka_3m"))
    tracker.update(0.0, [0, 0, 0, 0.4, 0, 0], {"n": 10.0, "delta": 0.2, "wind_speed": 2.0, "wind_direction": 1.0})
    row = np.array([10.0, 0.2, 2.0, 1.0])
    ways: list[Any] = [None, row, dict(zip(tracker.inputs, row, strict=True))]
    ways += [np.tile(row, (20, 1)), {n: np.full(20, v) for n, v in zip(tracker.inputs, row, strict=True)}]
    found = [tracker.forecast(20.0, way) for way in ways]
    for one in found[1:]:
        assert np.array_equal(one.states, found[0].states) and np.array_equal(one.std, found[0].std)
    lower, upper = found[0].band
    assert np.all(lower < found[0].states) and np.all(upper > found[0].states)
    turned = tracker.forecast(20.0, [[10.0, 0.2], [10.0, -0.2]])
    assert turned.states[-1, 2] < found[0].states[-1, 2]
    assert list(found[0].to_pandas().columns[:3]) == ["t", "x", "y"] and len(repr(found[0])) < 300


def test_rows_of_pandas_are_read_by_their_names() -> None:
    ship, controls = load_ship("esso_osaka_3m"), {"delta": 0.1, "n": 9.0}
    measured = {"u": 0.4, "v": 0.0, "r": 0.0, "x": 7.0, "y": 8.0, "psi": 0.1}
    tracker = Tracker(ship, pd.Series({"N_r": 0.01}))
    state = tracker.update(0.0, pd.Series(measured), pd.Series(controls))
    assert np.array_equal(state.mean[:6], [measured[name] for name in STATES])
    ahead = tracker.forecast(5.0, pd.DataFrame([controls, controls]))
    assert np.array_equal(ahead.states[-1], tracker.forecast(5.0, [[9.0, 0.1], [9.0, 0.1]]).states[-1])
    with pytest.raises(UnknownName):
        tracker.update(1.0, pd.Series(measured), pd.Series({"dleta": 0.1, "n": 9.0}))
    numbered = tracker.forecast(5.0, pd.Series([9.0, 0.1]))
    assert np.array_equal(numbered.states, tracker.forecast(5.0, np.array([9.0, 0.1])).states)
    rates = ship.rhs([measured[name] for name in STATES], controls)
    assert np.array_equal(ship.rhs(pd.Series(measured), pd.Series(controls)), rates)
    run = simulate(ship, [0.0, 1.0], n=9.0, delta=0.0, x0=pd.Series(measured))
    assert np.array_equal(run.states[0], state.mean[:6])


@pytest.mark.parametrize("compiled", [True, False])
def test_a_copy_goes_on_by_itself(compiled: bool) -> None:
    tracker = Tracker(load_ship("esso_osaka_3m"), ["N_r"], compiled=compiled)
    tracker.update(**(GOOD | {"t": 0.0}))
    tracker.update(**GOOD)
    ahead = np.array([10.0, 0.5])
    copies = copy.deepcopy(tracker), pickle.loads(pickle.dumps(tracker))
    expected = tracker.forecast(20.0, ahead)
    for one in copies:
        tracker.forecast(5.0, [10.0, -0.5])  # what the first one does in between is no business of its copies
        assert np.array_equal(one.forecast(20.0, ahead).states, expected.states)
        one.update(2.0, GOOD["measured"], ahead)
    assert np.array_equal(tracker.forecast(20.0, ahead).std, expected.std)


@pytest.mark.slow
def test_a_hybrid_is_tracked() -> None:
    true = lacking()
    run = pushed(true, 60)
    state = after(Tracker(true), run)
    assert state["r"] == pytest.approx(run["r"][-1], abs=2e-3)
    assert after(Tracker(true.without_network()), run).nis > 2 * state.nis


@pytest.mark.slow
def test_a_campaign_has_values_of_its_own() -> None:
    ship = replace(load_ship("esso_osaka_3m"), campaigns={"may": {"X_0F": 0.01}})
    assert Tracker(ship, campaign="may").ship.coefficients["X_0F"].value == 0.01
    with pytest.raises(UnknownName):
        Tracker(ship, campaign="mai")


GOOD: dict[str, Any] = {"t": 1.0, "measured": [0, 0, 0, 0.4, 0, 0], "controls": [10.0, 0.0]}


BAD = [
    *(({"t": t}, OutOfRange) for t in (0.0, -1.0)), *(({"t": t}, BadValue) for t in (math.nan, "soon")),
    ({"measured": {"psy": 0.1}}, UnknownName), ({"controls": {"n": 10.0}}, Missing),
    *(({"measured": row}, BadValue) for row in ([1.0, 2.0], "fast", [0, 0, 0, math.inf, 0, 0])),
    *(({"controls": row}, BadValue) for row in ([10.0], [10.0, math.nan], {"n": 10.0, "delta": None})),
    ({"controls": {"n": 10.0, "dleta": 0.1}}, UnknownName),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "kind"), BAD)
def test_a_bad_sample_is_refused_by_its_argument_and_leaves_the_state(wrong: dict[str, Any], kind: type) -> None:
    tracker = Tracker(load_ship("esso_osaka_3m"))
    tracker.update(0.0, GOOD["measured"], GOOD["controls"])
    with pytest.raises(kind) as caught:
        tracker.update(**(GOOD | wrong))
    assert str(caught.value).startswith(next(iter(wrong))) and "\n" not in str(caught.value)
    assert tracker.update(**GOOD).compared == 6


def test_what_cannot_be_tracked_or_forecast_is_refused() -> None:
    ship = load_ship("esso_osaka_3m")
    tracker = Tracker(ship)
    started = Tracker(ship)
    started.update(0.0, GOOD["measured"], GOOD["controls"])
    ragged, wide = {"n": np.ones(3), "delta": np.ones(2)}, np.ones((2, 3))
    refused: list[tuple[Callable[..., Any], tuple[Any, ...], str, type]] = [
        (tracker.forecast, (10.0,), "forecast", Missing),
        (tracker.update, (0.0, {"u": 0.4}, [10.0, 0.0]), "measured", Missing),
        (Tracker, (ship, ["N_rr_"]), "coefficients", UnknownName),
        (Tracker, (ship, ["tow.X"]), "coefficients", Conflict),
        (Tracker, (ship, {"N_r": -1.0}), "coefficients", Missing),
        (Tracker, (ship, {"N_r": "wide"}), "coefficients", BadValue),
        (Tracker, (SimpleNamespace(forecast=None),), "model", Unsupported),
        *((started.forecast, (seconds, None), "seconds", UserError) for seconds in (0.0, math.nan, "long")),
        *(
            (started.forecast, (5.0, row), "controls", UserError)
            for row in (ragged, wide, {"rudder": 0.0}, lambda s: [1.0])
        ),
    ]
    for call, given, begin, kind in refused:
        with pytest.raises(kind, match=f"^{begin}"):
            call(*given)
