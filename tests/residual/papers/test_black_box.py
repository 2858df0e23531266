"""Black boxes: the papers' equations against plain loops, exact gradients, sets of augmentation, files, prediction."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from cases.trial import Trial
from fitting.nlp.windows import Stretch, pieces_of
from fitting.prediction.predict import predict_all
from fitting.prediction.score import pooled_sigma, score
from fitting.prediction.stretches import record_of
from mmg.errors import BadValue, Conflict, Missing, UnknownName, Unreadable, UserError
from mmg.rollout import Simulator
from residual.hybrid import Hybrid, Residual, to_network
from residual.papers.black_box import (
    BOX_KIND,
    REACH,
    BlackBox,
    Feedforward,
    InitialState,
    Standard,
    Windowed,
    advance_columns,
    box_of,
    build_box,
    gridded,
    kinematics,
    load_box,
    save_box,
)
from residual.papers.ensemble import mahalanobis, members_of, particles, predict_members
from residual.physics import Physics
from residual.pipeline import train
from residual.settings import KINDS, BlackBoxSettings
from residual.system import Past, RolloutBatch, TrainableSystem, acceleration_loss, rollout, state_loss
from residual.train import tasks_of, train_one
from residual.windows import augmented, windows
from tests.residual.test_hybrid import hybrid_and_batch, random_residual
from tests.support import hybrids
from tests.support.quick import first_quick

QUICK = BlackBoxSettings(seeds=1, epochs=20, width=12, rate=1e-2, step=1.0)
SIGMA = torch.tensor([1.0, 1.0, 0.3, 0.1, 0.05, 0.02], dtype=torch.float64)


@lru_cache(maxsize=1)
def runs() -> tuple[Trial, ...]:
    return tuple(hybrids.trials(hybrids.ship(), 5, 200))


def batch_of(past: int, steps: int = 12) -> RolloutBatch:
    batch = windows(pieces_of(runs()[:2], 1.0, hybrids.ship().inputs), 1.0, steps, steps, past)
    assert batch is not None
    return batch


def scales():  # type: ignore[no-untyped-def]
    return BOX_KIND.scales(hybrids.ship(), pieces_of(runs(), 1.0, hybrids.ship().inputs), runs(), 1.0)


def box(kind: str, seed: int = 0, **options: object) -> TrainableSystem:
    """An untrained black box whose last layer is not zero."""
    system = build_box(hybrids.ship(), scales(), replace(QUICK, kind=kind, **options), seed)  # type: ignore[arg-type]
    inner = system.inner if isinstance(system, InitialState) else system
    with torch.no_grad():
        if not isinstance(inner, Feedforward):
            inner.W3.normal_(generator=torch.Generator().manual_seed(seed))
        if isinstance(system, InitialState):
            system.net[-1].weight.normal_(generator=torch.Generator().manual_seed(seed))
    return system


def numpy_features(row: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Features (F,) of one row, written out."""
    psi, u, v, r = row[2:]
    n, delta, north, east = inputs
    wind = (north + 1j * east) * np.exp(-1j * psi)
    return np.array([u, v, r, n, delta, wind.real - u, wind.imag - v])


def numpy_network(system: Standard | Windowed, seen: list[np.ndarray]) -> np.ndarray:
    """Accelerations of Eq. 7 after rows of features, from z1 = 0."""
    p, z = {name: value.detach().numpy() for name, value in system.named_parameters()}, np.zeros(system.width)
    for q in seen:
        z = np.tanh(p["W0"] @ (q / system.feature_scale.numpy()) + p["Wr"] @ z + p["b0"]) - np.tanh(p["b0"])
    z2 = np.tanh(p["W1"] @ z + p["b1"]) - np.tanh(p["b1"])
    z3 = np.tanh(p["W2"] @ z2 + p["b2"]) - np.tanh(p["b2"])
    return np.asarray(system.scale.numpy() * (p["W3"] @ z3))


def numpy_step(row: np.ndarray, a: np.ndarray, h: float) -> np.ndarray:
    """Eq. 20 to 22, Euler."""
    x, y, psi, u, v, r = row
    rates = [u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi), r, *a]
    return np.array([x, y, psi, u, v, r]) + h * np.array(rates)


@pytest.mark.parametrize(
    ("kind", "memory"), [("rnn", 1), ("rnn", 4), ("rnn-window", 1), ("rnn-window", 2), ("rnn-window", 5)]
)
def test_the_networks_are_equations_7_and_9(kind: str, memory: int) -> None:
    """The standard one along all rows from the first of the past, the windowed one anew along the last m."""
    system, batch = box(kind, memory=memory), batch_of(memory - 1)
    found = rollout(system, batch, "euler").detach().numpy()[:, :, 1]
    seen = []
    if batch.past:
        seen = [numpy_features(*pair) for pair in zip(*(p[..., 1].numpy() for p in batch.past), strict=True)]
    row = batch.targets[0, :, 1].numpy()
    for k, inputs in enumerate(batch.controls[:, :, 1].numpy()):
        seen = [*seen, numpy_features(row, inputs)][0 if kind == "rnn" else -memory :]
        row = numpy_step(row, numpy_network(system, seen), 1.0)  # type: ignore[arg-type]
        np.testing.assert_allclose(found[k + 1], row, atol=1e-12)


@pytest.mark.parametrize("kind", ["rnn", "rnn-window"])
def test_accelerations_at_measured_rows_are_those_of_equations_13_and_15(kind: str) -> None:
    memory = 3
    system, batch = box(kind, memory=memory), batch_of(memory - 1)
    found = system.accelerations(batch.targets[:-1], batch.controls, batch.past).detach().numpy()
    assert batch.past is not None
    rows = np.concatenate([batch.past.logged.numpy(), batch.targets[:-1].numpy()])[..., 0]
    inputs = np.concatenate([batch.past.controls.numpy(), batch.controls.numpy()])[..., 0]
    seen = [numpy_features(*pair) for pair in zip(rows, inputs, strict=True)]
    for k in range(len(found)):
        last = k + memory
        window = seen[:last] if kind == "rnn" else seen[last - memory : last]
        np.testing.assert_allclose(found[k, :, 0], numpy_network(system, window), atol=1e-14)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS)
def test_a_ship_at_rest_in_calm_air_stays_there(kind: str) -> None:
    system = box(kind, memory=3)
    rest = torch.zeros(20, 4, 2, dtype=torch.float64)
    past = Past(torch.zeros(2, 6, 2, dtype=torch.float64), rest[:2]) if system.past else None
    targets = torch.zeros(21, 6, 2, dtype=torch.float64)
    out = rollout(system, RolloutBatch(1.0, rest, targets, torch.ones_like(targets), past))
    assert out.abs().max() == 0.0
    free = box("fnn", zero=False).acceleration(torch.zeros(7, 1, dtype=torch.float64))  # type: ignore[operator]
    assert free.abs().max() > 1e-6, "without the constraint it does not"


def test_the_output_of_the_untrained_network_is_standardised_to_the_measured_accelerations() -> None:
    known, system = scales(), box("fnn", zero=False)
    draw = torch.randn(7, 20000, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    at = known.mean[:, None] + known.std[:, None] * draw.numpy()
    a = system.acceleration(torch.as_tensor(at)).detach().numpy()  # type: ignore[operator]
    np.testing.assert_allclose(a.std(axis=1), known.acceleration, rtol=0.05)
    np.testing.assert_allclose((a.mean(axis=1) - known.acceleration_mean) / known.acceleration, 0, atol=0.05)
    velocities = np.vstack([np.diff(t.states[:, 3:], axis=0) for t in runs()])
    np.testing.assert_allclose(known.acceleration, velocities.std(axis=0), rtol=0.02)


STEP = 1e-6


def check_gradients(loss: Callable[[], torch.Tensor], parameters: Iterable[torch.Tensor]) -> None:
    """Fails unless the gradient of ``loss`` by the middle entry of each of ``parameters`` is that by central
    differences."""
    chosen = list(parameters)
    assert chosen
    loss().backward()
    for parameter in chosen:
        at = tuple(s // 2 for s in parameter.shape)
        assert parameter.grad is not None
        gradient = parameter.grad[at].item()
        with torch.no_grad():
            parameter[at] += STEP
            up = loss().item()
            parameter[at] -= 2 * STEP
            down = loss().item()
            parameter[at] += STEP
        assert gradient == pytest.approx((up - down) / (2 * STEP), rel=1e-4, abs=1e-7)


@pytest.mark.parametrize(("kind", "initial"), [*((kind, 0) for kind in KINDS), ("fnn", 2), ("rnn-window", 4)])
def test_gradients_agree_with_finite_differences(kind: str, initial: int) -> None:
    system = box(kind, memory=2 if initial else 3, initial=initial)
    batch = batch_of(system.past)

    def loss() -> torch.Tensor:
        a = acceleration_loss(system, batch, torch.full((3,), 0.1, dtype=torch.float64))
        return state_loss(system, batch, SIGMA, "rk4") + 0.1 * a + 1e-3 * system.penalty()

    system.zero_grad()
    check_gradients(loss, system.parameters())


def test_held_accelerations_move_the_ship_along_its_circle() -> None:
    row = torch.tensor([0.0, 0.0, 0.3, 0.5, 0.0, 0.05], dtype=torch.float64)[:, None]
    out, radius = advance_columns(row, torch.zeros(3, 1, dtype=torch.float64), 1.0, "rk4")[:, 0], 0.5 / 0.05
    exact = [radius * (np.sin(0.35) - np.sin(0.3)), radius * (np.cos(0.3) - np.cos(0.35)), 0.35]
    np.testing.assert_allclose(out[:3].numpy(), exact, atol=1e-4)
    euler = advance_columns(row, torch.zeros(3, 1, dtype=torch.float64), 1.0, "euler")[:, 0]
    np.testing.assert_allclose(euler[:3, None], row[:3] + kinematics(row), atol=0)


@pytest.mark.parametrize(("name", "steps"), [("ref", 100), ("sli2", 50), ("sli10", 10)])
@pytest.mark.parametrize("rows", [501, 1802, 100, 99])
def test_slices_are_as_many_as_in_wakita_2024(name: str, steps: int, rows: int) -> None:
    """Eq. 17 for ref, Eq. 19 for the others, with I = 100."""
    t = np.arange(float(rows))
    motion = {c: np.sin(t / (7 + i)) for i, c in enumerate(("x", "y", "psi", "u", "v", "r", "n", "delta"))}
    pieces = pieces_of([Trial("one", {"t": t, **motion})], 1.0, hybrids.ship().inputs)
    batch = augmented(pieces, 1.0, 100, name, torch.zeros(6), 0)
    expected = rows // 100 if name == "ref" else max(0, (rows - 100) // steps + (rows >= 100))
    assert (0 if batch is None else len(batch)) == expected
    if batch is not None:
        assert len(batch.targets) == 100
        np.testing.assert_allclose(batch.targets[0, 0].numpy(), np.sin(steps * np.arange(len(batch)) / 7))


def test_jittering_replaces_windows_by_noisy_copies_of_the_velocities() -> None:
    pieces = pieces_of(runs(), 1.0, hybrids.ship().inputs)
    noise = torch.tensor([1.0, 1.0, 1.0, 0.01, 0.02, 0.003], dtype=torch.float64)
    plain, noisy = (augmented(pieces, 1.0, 50, name, noise, 3, 2) for name in ("ref", "jit10"))
    assert plain is not None and noisy is not None and len(noisy) == 10 * len(plain)
    added = noisy.targets - plain.targets.repeat(1, 1, 10)
    np.testing.assert_allclose(added[:, 3:].std(dim=(0, 2)).numpy(), noise[3:].numpy(), rtol=0.05)
    assert added[:, :3].abs().max() == 0.0, "no noise on position and heading (Table 5)"
    assert torch.equal(noisy.controls, plain.controls.repeat(1, 1, 10))
    M = len(plain)
    copies = torch.corrcoef(torch.stack([added[:, 3, :M].flatten(), added[:, 3, M : 2 * M].flatten()]))[0, 1]
    assert abs(float(copies)) < 0.2, "every copy has noise of its own"
    assert noisy.past is not None and noisy.past.logged.shape[2] == len(noisy)


def test_the_initial_state_starts_as_measured_and_never_goes_far() -> None:
    batch = batch_of(4)
    fresh = build_box(hybrids.ship(), scales(), replace(QUICK, kind="fnn", initial=4), 0)
    assert fresh.past == 4
    start = fresh.start(batch.targets[0], batch.controls[0], batch.past)
    assert torch.equal(start, batch.targets[0])
    wild = box("fnn", initial=4)
    away = wild.start(batch.targets[0], batch.controls[0], batch.past) - batch.targets[0]
    assert away[:3].abs().max() == 0.0 and away[3:6].abs().max() > 0
    assert (away[3:6].abs() <= wild.reach + 1e-15).all()  # type: ignore[operator]


@pytest.mark.slow
def test_a_system_that_steps_can_be_started_from_an_estimate() -> None:
    known, batch = scales(), batch_of(3)
    residual = Residual.drawn(np.ones(7), np.array([1e-3, 1e-3, 1e-4]))
    hybrid = Hybrid(Physics(hybrids.ship(), compiled=False), residual, np.ones((7, 4)))
    wrapped = InitialState(hybrid, known, replace(QUICK, initial=3), 0)
    assert (rollout(wrapped, batch) - rollout(hybrid, batch)).abs().max() < 1e-12
    with torch.no_grad():
        wrapped.net[-1].bias.fill_(1.0)  # type: ignore[operator, union-attr]
    away = (rollout(wrapped, batch) - rollout(hybrid, batch))[0, 3:6].detach().numpy()
    np.testing.assert_allclose(away, np.tile(REACH * known.std[:3, None] * np.tanh(1.0), (1, len(batch))), atol=1e-12)
    state_loss(wrapped, batch, SIGMA).backward()
    grad = wrapped.net[-1].bias.grad  # type: ignore[union-attr]
    assert isinstance(grad, torch.Tensor) and grad.abs().min() > 0.0, "the estimate is trained through the physics"


@pytest.mark.slow
def test_an_initial_state_network_finds_velocities_under_noise() -> None:
    """Starts are measured with much noise; rows before them tell better where the ship is going."""
    noise, rng = (0.05, 0.03, 0.004), np.random.default_rng(0)
    noisy = []
    for t in hybrids.trials(hybrids.ship(), 5, 300):
        columns = {c: t[c] + s * rng.normal(size=len(t)) for c, s in zip(("u", "v", "r"), noise, strict=True)}
        noisy.append(t.with_columns(**columns))
    errors = {}
    for rows in (0, 6):
        trained = train(hybrids.ship(), noisy, settings=replace(QUICK, kind="rnn-window", initial=rows, epochs=15))
        errors[rows] = trained.per_seed[0]["judged_window"]["after"]
    assert errors[6] < errors[0]


@pytest.mark.slow
@pytest.mark.parametrize("kind", first_quick(KINDS))
def test_a_black_box_learns_and_its_file_keeps_all(kind: str, tmp_path) -> None:  # type: ignore[no-untyped-def]
    settings = replace(QUICK, kind=kind, seeds=2, epochs=6, initial=1 if kind == "rnn" else 0)
    trained = train(hybrids.ship(), runs(), settings=settings)
    assert all(e["after"] < 0.7 * e["before"] for e in (row["judged_window"] for row in trained.per_seed))
    assert trained.black_box is not None
    path = tmp_path / "network.safetensors"
    save_box(path, trained.black_box)
    loaded = load_box(path, hybrids.ship())
    assert loaded.settings == trained.settings and loaded.actuators == ("n", "delta") and len(loaded.systems) == 2
    tests = hybrids.trials(hybrids.ship(), 1, 200, seed=8)
    sigma = pooled_sigma(tests)
    assert score(loaded, tests, sigma).window == score(trained.black_box, tests, sigma).window
    with pytest.raises(Conflict):
        load_box(path, replace(hybrids.ship(), particulars={**hybrids.ship().particulars, "L": 4.0}))


def test_a_damaged_file_is_refused_in_one_sentence(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path, system = tmp_path / "network.safetensors", box("rnn-window")
    known = BlackBox(QUICK, ("n", "delta"), 1.0, (system,), scales=scales())
    with pytest.raises(BadValue):
        save_box(path, known)  # settings of a feedforward network
        load_box(path)
    path.write_bytes(b"nothing")
    with pytest.raises(Unreadable):
        load_box(path)
    good = replace(known, settings=replace(QUICK, kind="rnn-window", memory=2))
    save_box(path, good)
    load_box(path)
    with safe_open(path, framework="pt") as file:
        about, arrays = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    wide = json.dumps(json.loads(about["training"]) | {"width": 10**6})
    lies = [{"training": text} for text in ("[" * 90_000, "[]", wide)]
    for change in (*lies, {"members": "9" * 18}, {"actuators": "3"}):
        save_file(arrays, tmp_path / "lies.safetensors", about | change)
        began = time.perf_counter()
        with pytest.raises(BadValue):
            load_box(tmp_path / "lies.safetensors")
        assert time.perf_counter() - began < 2
    with torch.no_grad():
        system.b0[0] = 1e30  # type: ignore[index]
    save_box(path, good)
    with pytest.raises(UserError, match="1e"):
        load_box(path)
    with torch.no_grad():
        system.b0[0] = float("nan")  # type: ignore[index]
    with pytest.raises(UserError, match=r"0\.b0"):
        save_box(path, known)


def test_an_input_that_a_trial_lacks_is_named() -> None:
    black = BlackBox(QUICK, ("n", "delta", "pitch"), 1.0, (box("fnn"),))
    with pytest.raises(UserError, match="pitch"):
        predict_all(black, runs()[:1], 30.0, 15.0)


def test_predictions_do_not_depend_on_what_comes_after_their_window_or_long_before() -> None:
    system = box("rnn-window", memory=3)
    black = BlackBox(replace(QUICK, kind="rnn-window"), ("n", "delta"), 1.0, (system,))
    trial = runs()[0]
    changed = {c: np.where((trial.t > 130) | (trial.t < 90), 0.3, trial[c]) for c in ("u", "v", "r", "delta")}
    other = trial.with_columns(**changed)
    stretches = [Stretch(record_of(t, black.inputs), 100, 130) for t in (trial, other)]
    a, b = (black.forecast([s]) for s in stretches)
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(a[0, :, 0], trial.states[100])
    before = other.with_columns(u=np.where(trial.t == 99, 0.0, trial["u"]))
    assert np.abs(black.forecast([Stretch(record_of(before, black.inputs), 100, 130)]) - a).max() > 1e-6


def test_a_forecast_at_other_samples_is_the_rollout_between() -> None:
    system = box("fnn")
    black, trial = BlackBox(QUICK, ("n", "delta"), 2.0, (system,)), runs()[1]
    stretch = Stretch(record_of(trial, black.inputs), 20, 61)
    out = black.forecast([stretch])
    batch = gridded([stretch], 2.0, 0)
    assert len(batch.controls) == 21 and out.shape == (42, 6, 1)
    np.testing.assert_allclose(
        batch.controls[3, :2, 0].numpy(), np.mean([trial["n"][26:28], trial["delta"][26:28]], axis=1)
    )
    path = rollout(system, batch).detach().numpy()
    np.testing.assert_allclose(out[2::2, :, 0], path[1:21, :, 0], atol=1e-12)
    np.testing.assert_allclose(out[1, :, 0], path[:2, :, 0].mean(axis=0), atol=1e-12)


def test_a_start_with_too_few_rows_before_it_uses_the_oldest_and_none_before_a_gap() -> None:
    trial, inputs = runs()[0], ("n", "delta", "wind_north", "wind_east")
    record = record_of(trial, inputs)
    past = gridded([Stretch(record, 0, 10), Stretch(record, 2, 10), Stretch(record, 50, 60)], 1.0, 4).past
    assert past is not None
    np.testing.assert_allclose(past.logged[:, :, 0].numpy(), np.tile(trial.states[0], (4, 1)))
    np.testing.assert_allclose(past.logged[:, :, 1].numpy(), trial.states[[0, 0, 0, 1]])
    np.testing.assert_allclose(past.logged[:, :, 2].numpy(), trial.states[46:50])
    np.testing.assert_allclose(past.controls[:, 0, 2].numpy(), trial["n"][46:50])
    broken = trial.with_columns(u=np.where(np.arange(201) == 48, np.nan, trial["u"]))
    past = gridded([Stretch(record_of(broken, inputs), 50, 60)], 1.0, 4).past
    assert past is not None
    np.testing.assert_allclose(past.logged[:, :, 0].numpy(), np.tile(trial.states[49], (4, 1)))


def test_windows_of_a_black_box_are_those_of_a_ship() -> None:
    black = BlackBox(QUICK, ("n", "delta"), 1.0, (box("fnn"),))
    (found, notes), *_ = predict_all(black, runs()[:1], 30.0, 15.0, False)
    assert [w.first for w in found] == list(range(0, 171, 15)) and not notes


# Ensembles: particles are rollouts of members, distances by hand


class Yaw(TrainableSystem):
    """A ship that only yaws: dr/dt = (K delta - r) / T, surging at constant speed; inputs n, delta, air."""

    def __init__(self, K: float, T: float) -> None:
        super().__init__()
        self.K, self.T = K, T

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        zero = torch.zeros_like(z[0])
        turn = (self.K * controls[1] - z[5]) / self.T
        return torch.stack([z[3], zero, z[5], zero, zero, turn])


def yaw_batch(M: int = 3, N: int = 10) -> RolloutBatch:
    draw = torch.Generator().manual_seed(0)
    controls = torch.randn(N, 4, M, generator=draw, dtype=torch.float64)
    targets = torch.randn(N + 1, 6, M, generator=draw, dtype=torch.float64)
    return RolloutBatch(0.5, controls, targets, torch.ones_like(targets))


def random_residuals(count: int) -> list[Residual]:
    return [random_residual(seed, 8) for seed in range(count)]


# Particles


def test_ts_infinity_is_the_rollouts_of_the_members_one_by_one() -> None:
    members, batch = [Yaw(0.1, 2.0), Yaw(0.2, 2.0), Yaw(0.2, 5.0)], yaw_batch()
    paths = particles(members, batch, 6, "ts-infinity")
    assert paths.shape == (11, 6, 6, 3)
    for p in range(6):
        np.testing.assert_array_equal(paths[:, :, p], rollout(members[p % 3], batch).numpy())


def test_ts1_draws_a_member_anew_at_every_step_and_for_every_particle() -> None:
    """Of the members +a and -a, the turn rate after N steps is a times a random walk: variance N, not N^2."""
    N, P, a, h = 25, 4000, 0.1, 0.5
    controls = torch.zeros(N, 4, 1, dtype=torch.float64)
    controls[:, 1] = 1.0
    start = torch.zeros(N + 1, 6, 1, dtype=torch.float64)
    batch = RolloutBatch(h, controls, start, torch.ones_like(start))
    slow = 1e6
    members = [Yaw(a * slow, slow), Yaw(-a * slow, slow)]
    walk = particles(members, batch, P, "ts1")[-1, 5, :, 0] / (a * h)
    assert walk.mean() == pytest.approx(0.0, abs=4 * math.sqrt(N / P))
    assert walk.var() == pytest.approx(N, rel=0.1)
    kept = particles(members, batch, P, "ts-infinity")[-1, 5, :, 0] / (a * h)
    assert kept.var() == pytest.approx(N**2, rel=1e-3)


def test_the_same_seed_gives_the_same_particles_and_another_one_others() -> None:
    members, batch = [Yaw(0.1, 2.0), Yaw(0.2, 2.0)], yaw_batch()
    one, same, other = (particles(members, batch, 4, "ts1", seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1e-6


@pytest.mark.slow
def test_the_members_of_a_saved_network_are_those_it_was_made_of() -> None:
    residuals, (_, batch) = random_residuals(2), hybrid_and_batch(steps=8)
    limit = np.full(len(hybrids.ship().features), np.inf)
    ship = hybrids.ship().with_network(to_network(residuals, hybrids.ship().actuators, -limit, limit))
    paths = particles(members_of(ship), batch, 2)
    physics = Physics(hybrids.ship())
    for p, residual in enumerate(residuals):
        with torch.no_grad():
            expected = rollout(Hybrid(physics, residual, np.zeros((7, 1))), batch).numpy()
        np.testing.assert_allclose(paths[:, :, p], expected, rtol=0, atol=1e-12)
    with pytest.raises(Missing):
        members_of(hybrids.ship())
    alone = [Simulator(member, compiled=False).rates(np.ones((6, 1)), np.ones((4, 1))) for member in ship.members]
    both = Simulator(ship, compiled=False).rates(np.ones((6, 1)), np.ones((4, 1)))
    np.testing.assert_allclose(np.mean(alone, axis=0), both, rtol=0, atol=1e-12)


# Distances


SIGNS = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]])
"""Of u, v, r of four particles: uncorrelated, of variance 1."""


def hand_made() -> tuple[np.ndarray, np.ndarray]:
    """Particles (3, 6, 4) and truth (3, 6): in u, v, r independent, with deviations 1, 2 and 0.5 about 1."""
    paths, truth = np.zeros((3, 6, 4)), np.zeros((3, 6))
    paths[:, 3:] = 1.0 + np.array([[1.0], [2.0], [0.5]]) * SIGNS
    truth[:, 3:] = 1.0
    truth[1, 3:] += (1.0, 2.0, 0.0)
    truth[2, 3:] += (0.0, 0.0, 1.5)
    return paths, truth


def test_distances_by_hand() -> None:
    """Rows after the start: 1 + 1 and 2.25 / 0.25; a row that was not measured counts nothing; three members: none."""
    paths, truth = hand_made()
    assert mahalanobis(paths, truth) == pytest.approx((2 + 9) / 2)
    truth[1, 4] = math.nan
    assert mahalanobis(paths, truth) == pytest.approx(9)
    assert math.isnan(mahalanobis(paths[:, :, :3], truth))


def test_distances_see_correlated_states() -> None:
    """u and v that move together make an error across the line dear: e = (1, -1), Cov = [[1, .5], [.5, 1]] -> 4."""
    root = np.linalg.cholesky(np.array([[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]]))
    paths, truth = np.zeros((2, 6, 4)), np.zeros((2, 6))
    paths[:, 3:], truth[1, 3:] = root @ SIGNS, (1, -1, 0)
    assert mahalanobis(paths, truth) == pytest.approx(4.0)


# Predictions


@pytest.mark.slow
@pytest.mark.parametrize("sampling", ["ts1", "ts-infinity"])
def test_a_prediction_by_members_has_their_mean_and_their_spread(sampling: str) -> None:
    limit, own = np.full(len(hybrids.ship().features), np.inf), hybrids.ship().actuators
    trial = hybrids.trials(hybrids.ship(), 1, 60)[0]
    four = hybrids.ship().with_network(to_network(random_residuals(4), own, -limit, limit))
    windows, notes = predict_members(four, trial, 20.0, 20.0, True, sampling, 1)
    assert [(w.first, w.last) for w in windows] == [(0, 20), (20, 40), (40, 60)] and len(notes) == 1
    alone = [predict_all(Simulator(m, compiled=False), [trial], 20.0, 20.0)[0][0] for m in four.members]
    for k, window in enumerate(windows):
        assert window.std is not None and (window.std[0] < 1e-12).all() and (window.std[1:, 3:] > 0).all()
        if sampling == "ts-infinity":
            paths = np.array([own[k].states for own in alone])
            np.testing.assert_allclose(window.states, paths.mean(axis=0), rtol=0, atol=2e-3)
            np.testing.assert_allclose(window.std, paths.std(axis=0), rtol=0, atol=2e-3)
    with pytest.raises(UnknownName):
        predict_members(four, trial, 20.0, 20.0, True, "ts2")


def test_members_log_by_the_instruments_of_the_campaign_of_the_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_CC", "none")  # a compiler takes longer than these windows
    ship = hybrids.lacking().with_effect("gyro")
    ship = replace(ship, campaigns={"spring": {"gyro.T": 3.0}, "autumn": {"gyro.T": 0.5}})
    trial = replace(hybrids.trials(hybrids.ship(), 1, 40)[0], meta={"campaign": "spring"})
    (window, *_), _ = predict_members(ship, trial, 20.0, 20.0, True)
    (expected, *_), _ = predict_all(Simulator(ship, compiled=False), [trial], 20.0, 20.0)[0]
    np.testing.assert_allclose(window.states, expected.states, rtol=0, atol=2e-3)
    (other, *_), _ = predict_members(ship, replace(trial, meta={"campaign": "autumn"}), 20.0, 20.0, True)
    assert np.abs(other.states - window.states)[:, 5].max() > 2e-3


# Training


def test_members_of_a_black_box_differ_by_seed_and_come_back_the_same() -> None:
    trials = hybrids.trials(hybrids.ship(), 5, 60)
    settings = BlackBoxSettings(kind="rnn-window", seeds=2, epochs=2, width=6, step=1.0, curriculum=((10.0, 1.0),))
    tasks = tasks_of(BOX_KIND, hybrids.ship(), trials, settings, trials, judged_apart=False)
    box = box_of(tasks[0], [train_one(task) for task in tasks])
    (one, _), (again, _) = (predict_members(box, trials[0], 20.0, 20.0, True, "ts1", 3) for _ in range(2))
    np.testing.assert_array_equal(one[0].states, again[0].states)
    assert one[0].std is not None and (one[0].std[1:, 3:] > 0).all()
    kept = predict_members(box, trials[0], 20.0, 20.0, True)[0]
    np.testing.assert_allclose(kept[0].states[1:], predict_all(box, trials[:1], 20.0, 20.0)[0][0][0].states[1:])
