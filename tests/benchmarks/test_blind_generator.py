"""The generator of the blind benchmark: independent of what it tests, right physics, reproducible, readable."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.generator.cases import WINDOW, Case, Runs, floors, run
from benchmarks.blind.generator.controls import SETS
from benchmarks.blind.generator.deal import LIBRARY, NULL_SHARE, Hand, deal
from benchmarks.blind.generator.effect import Effect
from benchmarks.blind.generator.foreign import FOREIGN, NEW, STRANGERS
from benchmarks.blind.generator.library import follow
from benchmarks.blind.generator.plant import plant_of, rates
from benchmarks.blind.generator.world import (
    RANGES,
    STEP,
    TOTAL,
    WORLDS,
    World,
    own_runs,
    own_world,
    scaled_ship,
    sensor_errors,
    true_coefficients,
)
from benchmarks.blind.generator.write import generate
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from mmg.model import assemble

ROOT = Path(__file__).parents[2]
EFFECTS: tuple[Effect, ...] = (*LIBRARY, *FOREIGN, *NEW)
NULL = Hand("null", ())
CONTRACT = (
    "current wind_force wind_sensor_bias shallow_water bank wave_drift rudder_lag rudder_backlash rudder_offset "
    "propeller_side_force rudder_stall fouling draft antenna_offset heading_bias log_scale control_delay gnss_delay "
    "hull_memory tow"
)


SHORTER = replace(WORLDS["pond"], duration=65.0)


def prepared(hand: Hand = NULL, seed: int = 5, chosen: str = "mixed", world: World = WORLDS["pond"]) -> Case:
    return Case.prepared(hand, chosen, np.random.SeedSequence(seed), world)


@cache
def with_each_effect() -> tuple[list[Case], Runs]:
    """The same case without an effect, then with each of them at medium, in one batch: every hook sees every run."""
    plain, rng = prepared(world=SHORTER), np.random.default_rng(1)
    drawn = [[(effect, effect.draw("medium", rng, len(plain.kinds)))] for effect in EFFECTS]
    cases = [plain, *(replace(plain, drawn=one) for one in drawn)]
    return cases, run(cases)


@cache
def alone() -> Runs:
    return run([prepared(world=SHORTER)])


@cache
def benchmark(folder: Path) -> str:
    return generate(folder, 2, 11, "library")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("blind") / "out"
    return folder, benchmark(folder)


def test_it_imports_nothing_of_what_it_tests() -> None:
    code = (
        "import sys, benchmarks.blind.generator.write;"
        "print([m for m in sys.modules if m.split('.')[0] in ('mmg', 'cases', 'fitting', 'diagnosis', 'residual',"
        " 'commands', 'casadi', 'torch')])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def rates_of_both(
    world: World, seed: int, count: int, motion: tuple[tuple[float, float], ...], **limits: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rates (6, count) of random states by the generator and by the package, whose ship may be larger, and their usual
    size (6, 1). motion: ends of u, v, r; limits: those of the inputs in the order of the generator, rps or degrees."""
    rng, root = np.random.default_rng(seed), np.sqrt(world.scale)
    particulars, nominal = scaled_ship(world)
    true = true_coefficients(nominal, rng, world.drawn)
    u_v_r = [rng.uniform(*ends, count) for ends in motion]
    state = np.stack([*rng.normal(0, 10, (2, count)), rng.uniform(-4, 4, count), *u_v_r])
    drawn = {name: rng.uniform(*ends, count) * (1 if name[0] == "n" else np.pi / 180) for name, ends in limits.items()}
    (n, first, *more), wind = drawn.values(), rng.normal(0, 1.5 if world.scale == 1 else 0.0, (2, count))
    plant = plant_of(particulars, [true], [[]], count, world)
    ours = rates(plant, state, (n, first, *wind, *more), np.zeros((3, count)), np.zeros(count))[:6]
    ship = load_ship(world.ship).with_values({name: true[name] for name in world.drawn})
    drawn |= {name: values / root for name, values in drawn.items() if name[0] == "n"}
    inputs = np.stack([(drawn | dict(zip(("wind_north", "wind_east"), wind, strict=True)))[k] for k in ship.inputs])
    large = state * np.array([world.scale, world.scale, 1.0, root, root, 1 / root])[:, None]
    theirs = np.array(assemble(ship, (), exact=True).rates.map(count)(large, inputs, np.zeros((0, count))))
    theirs *= np.array([1 / root, 1 / root, root, 1.0, 1.0, world.scale])[:, None]
    return ours, theirs, np.median(np.abs(theirs), axis=1)[:, None]


def test_the_accelerations_are_those_of_the_package() -> None:
    motion = ((-0.2, 0.5), (-0.15, 0.15), (-0.08, 0.08))
    ours, theirs, size = rates_of_both(WORLDS["pond"], 2, 300, motion, n=(-12, 12), delta=(-35, 35))
    assert np.max(np.abs(ours - theirs) / (np.abs(theirs) + 0.1 * size)) < 2e-3
    assert np.median(np.abs(ours - theirs) / size) < 1e-4


def test_the_second_ship_moves_as_the_package_has_it_by_froudes_law() -> None:
    """The ship of 3 m that is integrated, against the KVLCC2 of 7 m: accelerations of translation are the same."""
    motion = ((0.25, 0.6), (-0.1, 0.1), (-0.08, 0.08))
    ours, theirs, size = rates_of_both(WORLDS["kvlcc2"], 3, 200, motion, n=(5, 13), delta=(-35, 35))
    off = (np.abs(ours - theirs) / (np.abs(theirs) + 0.1 * size))[3:]
    assert np.median(off) < 2e-4 and off.max() < 0.03  # the package rounds the change from side to side


def test_the_third_ship_moves_as_the_package_has_it() -> None:
    """Two rudders to 105 degrees outwards, a bow thruster, ahead and astern, branch by branch."""
    motion = ((-0.2, 0.7), (-0.2, 0.2), (-0.1, 0.1))
    inputs = {"n": (-4, 12), "delta_starboard": (-35, 105), "delta_port": (-105, 35), "n_bow": (-40, 40)}
    ours, theirs, size = rates_of_both(replace(WORLDS["vectwin"], soft=0.0), 4, 3000, motion, **inputs)
    assert np.max(np.abs(ours - theirs) / size) < 1e-9


def test_a_world_has_the_noise_that_it_says() -> None:
    world = WORLDS["basin"]
    errors = sensor_errors(world, 4000, 4, np.random.default_rng(0))
    np.testing.assert_allclose(errors.std(axis=(0, 2)), world.noise, rtol=0.1)
    next_to = [np.corrcoef(errors[1:, i, 0], errors[:-1, i, 0])[0, 1] for i in range(6)]
    low, high = (0.5 * np.exp(-world.sample / tau) for tau in world.colour)
    assert np.abs(next_to[:3]).max() < 0.08 and low - 0.08 < min(next_to[3:]) <= max(next_to[3:]) < high + 0.08


@pytest.mark.parametrize("name", ("basin_wide", "kvlcc2_wide"))
def test_a_wide_world_draws_every_case_anew_over_the_whole_ranges(name: str) -> None:
    world, rng = WORLDS[name], np.random.default_rng(0)
    clock = np.sqrt(world.scale)
    drawn = []
    for _ in range(400):
        own, conditions = own_world(world, rng)
        train, test = own_runs(SETS["ahead"], conditions, rng)
        assert 0.0 < own.step <= STEP and own.sample == pytest.approx(own.step * own.every)
        assert own.sample * clock == pytest.approx(conditions["sample"])
        assert own.memory[0] * clock == pytest.approx(conditions["memory"]) and own.spread == conditions["spread"]
        assert own.force[1] == pytest.approx(conditions["force"] * world.force[1])
        ratios = np.array(own.noise) / world.noise
        assert ratios.min() > 0.0999 and ratios.max() < 10.001 and len(set(np.round(ratios, 9))) > 1
        assert len(train) >= 1 and len(test) >= 1 and len(train) + len(test) == conditions["runs"]
        assert own.duration * clock * conditions["runs"] <= TOTAL and own.duration > WINDOW
        assert (own.rows - 1) % own.every == 0
        drawn.append(conditions)
    for key, (low, high) in RANGES.items():
        values = np.array([one[key] for one in drawn])
        assert low <= values.min() < low * (high / low) ** 0.1 and low * (high / low) ** 0.9 < values.max() <= high
        assert 0.4 < np.mean(values < np.sqrt(np.prod(RANGES[key]))) < 0.6


def test_the_library_effects_are_those_of_the_contract() -> None:
    assert sorted(effect.name for effect in LIBRARY) == sorted(CONTRACT.split())
    assert len(STRANGERS) >= 15 and len({effect.name for effect in EFFECTS}) == len(EFFECTS)


@pytest.mark.longest
@pytest.mark.slow
def test_neutral_effects_leave_a_trial_as_it_is() -> None:
    _, runs = with_each_effect()
    plain = alone()
    B = plain.plant.runs
    np.testing.assert_allclose(runs.columns[:, :, :B], plain.columns, atol=1e-9)
    np.testing.assert_allclose(runs.delta[:, :B], plain.delta, atol=1e-12)


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(EFFECTS)), ids=[effect.name for effect in EFFECTS])
def test_a_medium_effect_changes_the_trials(index: int) -> None:
    _, runs = with_each_effect()
    plain = alone()
    B = plain.plant.runs
    changed = runs.columns[:, :, (index + 1) * B : (index + 2) * B]
    assert np.isfinite(changed).all()
    size = np.sqrt(np.mean((changed - plain.columns) ** 2, axis=(0, 2)))
    assert np.max(size / np.array([0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006])) > 0.5


@pytest.mark.longest
@pytest.mark.slow
def test_the_true_model_predicts_better_with_its_effects() -> None:
    cases, runs = with_each_effect()
    floor, without = floors(cases, runs), floors(cases, runs, with_effects=False)
    assert np.all(floor > 0) and np.all(floor < 0.3)
    assert np.all(without[1:] > 0.8 * floor[1:]) and np.mean(without[1:] > 1.1 * floor[1:]) > 0.6
    assert without[0] == pytest.approx(floor[0], rel=0.05)


@pytest.mark.slow
def test_without_random_force_the_floor_is_the_noise() -> None:
    case = prepared()
    quiet = replace(case, force=0 * case.force)
    noise = quiet.noise[:, :, quiet.training :]
    expected = np.mean((noise / np.array([0.3, 0.3, np.radians(5), 0.05, 0.05, 0.01])[:, None]) ** 2)
    assert floors([quiet], run([quiet]))[0] == pytest.approx(expected, rel=0.05)


def test_the_lag_of_a_ramp_is_its_time_constant() -> None:
    y, x, T = np.zeros(1), 0.0, np.array([0.4])
    for _ in range(200):
        y, x = follow(y, np.array([x]), np.array([x + 0.05]), T, 0.05), x + 0.05
    assert float(x - y[0]) == pytest.approx(0.4, rel=1e-6)


def test_a_world_scales_the_size_of_a_stranger_and_of_nothing_else() -> None:
    world, limit = WORLDS["kvlcc2"], next(one for one in NEW if one.name == "rudder_rate_limit")
    hand = Hand("foreign", ((limit, "medium"),))
    here, plain = prepared(hand, world=world), prepared(hand, world=replace(world, sizes={}))
    for where in ("key", "inside"):
        one, other = (getattr(case.drawn[0][1], where)["size"] for case in (here, plain))
        assert one == pytest.approx(world.sizes["rudder_rate_limit"] * other)
    np.testing.assert_array_equal(here.force, plain.force)
    known = {effect.name for effect in STRANGERS}
    older = {effect.name for effect in FOREIGN}
    assert set(world.sizes) <= known - older  # older causes keep their cases
    assert set(WORLDS["vectwin"].sizes) <= known and not WORLDS["pond"].sizes and not WORLDS["basin"].sizes


@pytest.mark.slow
def test_a_twin_has_the_same_chance_and_hides_nothing() -> None:
    limit = next(one for one in NEW if one.name == "rudder_rate_limit")
    case = prepared(Hand("foreign", ((limit, "medium"),)))
    twin = case.twin
    assert case.drawn and not twin.drawn and not twin.hand.effects and twin.coefficients == case.coefficients
    np.testing.assert_array_equal(twin.force, case.force)
    np.testing.assert_array_equal(twin.noise, case.noise)
    assert floors([twin], run([twin])) < floors([case], run([case]), with_effects=False)


def test_the_mix_is_dealt_in_its_shares() -> None:
    hands = deal("mix", 100, np.random.default_rng(0))
    kinds = [hand.kind for hand in hands]
    assert (kinds.count("null"), kinds.count("foreign"), kinds.count("library")) == (round(100 * NULL_SHARE), 15, 75)
    named = {(hand.effects[0][0].name, hand.effects[0][1]) for hand in hands if hand.kind == "library"}
    assert len(named) >= 60


@pytest.mark.slow
def test_the_hash_is_that_of_the_key_and_the_key_of_all_files(written: tuple[Path, str]) -> None:
    folder, digest = written
    content = (folder / "key.json").read_bytes()
    assert hashlib.sha256(content).hexdigest() == digest == (folder / "key.sha256").read_text().split()[0]
    for entry in json.loads(content)["cases"]:
        assert entry["effects"][0]["name"] in CONTRACT
        for name, expected in entry["sha256"].items():
            path = folder / "sealed" / f"{entry['case']}.json" if name == "sealed" else folder / entry["case"] / name
            assert hashlib.sha256(path.read_bytes()).hexdigest() == expected
        truth = json.loads((folder / "sealed" / f"{entry['case']}.json").read_text())
        assert truth["floor"] > 0 and set(WORLDS["pond"].drawn) <= set(truth["nominal_true_coefficients"])


@pytest.mark.longest
@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(written: tuple[Path, str], tmp_path: Path) -> None:
    folder, digest = written
    assert generate(tmp_path / "again", 2, 11, "library") == digest
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            assert (tmp_path / "again" / path.relative_to(folder)).read_bytes() == path.read_bytes()
    with pytest.raises(FileExistsError):
        generate(folder, 1, 1)


@pytest.mark.slow
def test_the_package_reads_the_trials(written: tuple[Path, str]) -> None:
    folder, _ = written
    for case in sorted(folder.glob("case_*")):
        for role, count in (("train", 7), ("test", 5)):
            trials = read_trials(case / role)
            assert len(trials) == count
            for trial in trials:
                assert trial.kind and len(trial) == 301 and trial.dt == pytest.approx(0.5)
                assert trial.duration == pytest.approx(150.0)
                assert np.abs(trial["u"]).max() < 0.8 and np.abs(trial["delta"]).max() < np.radians(35.1)
                speed = np.hypot(np.diff(trial["x"]), np.diff(trial["y"])) / trial.dt
                assert abs(np.mean(speed) - np.mean(np.hypot(trial["u"], trial["v"]))) < 0.05
                assert {"wind_speed", "wind_direction"} <= set(trial.columns)


@pytest.mark.parametrize("chosen", ("zigzag", "turn", "random", "berthing"))
def test_a_manoeuvre_set_holds_only_its_kind(chosen: str) -> None:
    case = prepared(chosen=chosen)
    assert set(case.kinds) == {chosen} and len(case.kinds) == 12 and case.orders.n.shape == (case.world.rows, 12)
