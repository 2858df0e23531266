"""Parts of a planned trial: placing in an area, orders within limits, information by another way, the search."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cases.maneuvers.definitions import Limits, parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate_batch import simulate_batch
from cases.trial import Trial
from fitting.design.next_trial import library, repetitions
from fitting.design.plan import RUN_UP, Area, Evolution, PlanTask, Sequences, SequenceSearch, Wish, corners, table_of
from fitting.design.trial_information import Present, TrialInformation, choose_windows, window_information
from fitting.nlp.fisher_information import information
from fitting.nlp.prior import Prior
from fitting.nlp.problem import Problem
from fitting.nlp.windows import cut
from fitting.prediction.innovations import Innovations
from mmg.errors import UserError
from mmg.rollout import Simulator
from mmg.ship import Ship

FREE = ("X_0F", "Y_v", "N_r", "t_P")


@pytest.fixture(scope="module")
def ship() -> Ship:
    model = load_ship("esso_osaka_3m")
    return model.fixing([s for s in model.symbols if s not in FREE])


def test_a_track_is_placed_so_that_the_hull_stays_inside(ship: Ship) -> None:
    area = Area.parse("60x25", ship, 0.5)
    t = np.linspace(0, 1, 50)
    track = np.stack([10 * t, 40 * t, np.full(50, 1.3)], axis=1)[:, :, None, None]  # too wide unless turned
    place = area.placing(track, ship)
    assert place.excess[0] == 0
    c, s = np.cos(place.psi[0]), np.sin(place.psi[0])
    x, y = track[:, 0, 0, 0], track[:, 1, 0, 0]
    put = np.stack([place.x[0] + c * x - s * y, place.y[0] + s * x + c * y, track[:, 2, 0, 0] + place.psi[0]], axis=1)
    cx, cy = corners(put[..., None], ship)
    assert cx.min() >= 0.5 - 1e-9 and cx.max() <= 59.5 + 1e-9 and cy.min() >= 0.5 - 1e-9 and cy.max() <= 24.5 + 1e-9
    assert area.placing(track, ship, (1.0, 1.0, 0.0)).excess[0] > 10


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_run_up_lies_where_the_ship_comes_from(ship: Ship, side: float) -> None:
    area = Area.parse("60x25", ship, 0.5)
    states = np.zeros((3, 6, 1, 1))
    states[:, 0, 0, 0], states[:, 3] = side * np.array([0.0, 22.5, 45.0]), side * 0.5
    place = SequenceSearch.placing(
        SimpleNamespace(ship=ship, task=SimpleNamespace(wish=Wish("60x25", 60.0), area=area)), states
    )
    at = place.x[0] - side * RUN_UP * 3.0 * np.cos(place.psi[0])
    assert place.excess[0] == 0 and 0.5 + 1.5 <= at <= 59.5 - 1.5  # the hull, with the margin, half a length each way


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
    assert all(1 <= len(table_of(orders[:, :, k], 0.5)) <= 6 for k in range(20))


def test_the_information_is_that_of_a_fit(ship: Ship) -> None:
    """The same windows by ``fitting.nlp.fisher_information``, its states eliminated by another recursion."""
    simulator, prior, h = Simulator(ship, compiled=False), Prior.of(ship), 0.5
    run = simulate_batch(simulator, parse_maneuver("zigzag:20/20", ship, duration=30.0), dt=h)
    trial: Trial = run.trial(0)
    sigma = np.array([0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006])
    problem = Problem.of(ship, prior, cut([trial], h, 15.0, 5, inputs=ship.inputs), sigma, compiled=False)
    expected = information(problem, problem.join(problem.measured_nodes, np.zeros(problem.P))).fisher.sum(axis=0)
    info = TrialInformation(simulator, prior, sigma, h, 30)
    held = np.zeros((len(run.inputs) - 1, len(ship.inputs), 1))
    held[:, :2] = run.inputs[:-1]
    states = info.simulator.run(run.states[0], held, h)
    assert states[:, :6] == pytest.approx(run.states, abs=1e-9)
    assert info.of(states, held)[0] == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(expected).max())


def test_what_a_trial_gains_is_the_mean_log_of_the_variances() -> None:
    present = Present(np.diag([1.0, 4.0]), 0.5, np.eye(2), ("a", "b"))
    assert present.variances() == pytest.approx([1.0, 0.25])
    assert present.gain(np.diag([2.0, 0.0])) == pytest.approx(0.5 * np.log(0.5))


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

    def task(model: Ship) -> PlanTask:
        return PlanTask(Wish("9000x9000", 600.0), Area.parse("9000x9000", model), 0.4, np.zeros((1, 1)))

    assert task(ship).reversible(ship)
    full = load_ship("kvlcc2_full")
    assert not task(full).reversible(full)


# The windows that are chosen tell more than as many others
def found(seed: int = 0) -> Innovations:
    """40 windows of two stretches, three coefficients; few windows tell anything of the third."""
    rng = np.random.default_rng(seed)
    gains = rng.standard_normal((80, 24, 3)) * np.array([1.0, 0.5, 0.0])
    gains[[10, 33, 60], :, 2] = rng.standard_normal((3, 24))
    names = ("a", "b", "c")
    return Innovations(np.arange(80.0), np.arange(80) // 2, rng.standard_normal((80, 24)), gains, names, np.ones(3),
                       np.arange(24) % 6)  # fmt: skip


def test_a_rare_manoeuvre_is_chosen_one_moved_by_something_else_is_not_and_all_tell_more_than_random_ones() -> None:
    choice = choose_windows(found(), 3)
    assert set(choice.windows) & {5, 16, 30}
    assert list(choice.gains) == sorted(choice.gains, reverse=True)
    data = found(1)
    choice, (numbers, information) = choose_windows(data, 6), window_information(data)
    rng = np.random.default_rng(0)
    for _ in range(20):
        chance = rng.choice(len(numbers), 6, replace=False)
        assert sum(choice.gains) > np.linalg.slogdet(np.eye(3) + information[chance].sum(axis=0))[1]
    assert sum(choice.gains) < choice.all
    data = found(2)
    data.errors[20] += 100.0
    assert 10 not in window_information(data)[0]
