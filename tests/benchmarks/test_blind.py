"""The blind benchmark: a generator independent of what it tests, right and readable; answers, and sealed keys."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import record
from benchmarks.blind import __main__ as blind
from benchmarks.blind.cases import Case as OpenedCase
from benchmarks.blind.cases import Pair, answer, dealt, figures, folders, misses, opened, scored
from benchmarks.blind.generator.cases import LIBRARY, Case, Hand, Runs, deal, run
from benchmarks.blind.generator.controls import SETS
from benchmarks.blind.generator.effect import Drawn, Effect
from benchmarks.blind.generator.foreign import STRANGERS, foreign
from benchmarks.blind.generator.library import follow
from benchmarks.blind.generator.plant import parts_of, plant_of, rates
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
from benchmarks.record import Record
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from mmg.effects import EFFECTS as PACKAGE_EFFECTS
from mmg.errors import UserError
from mmg.model import assemble

ROOT = Path(__file__).parents[2]
EFFECTS: tuple[Effect, ...] = (*LIBRARY, *STRANGERS)
CONTRACT = (
    "current wind_force wind_sensor_bias shallow_water bank wave_drift rudder_lag rudder_backlash rudder_offset "
    "propeller_side_force rudder_stall fouling draft antenna_offset heading_bias log_scale control_delay gnss_delay "
    "hull_memory tow"
)


SHORTER = replace(WORLDS["pond"], duration=65.0)


def prepared(hand: Hand = (), seed: int = 5, world: World = WORLDS["pond"]) -> Case:
    return Case.prepared(hand, np.random.SeedSequence(seed), world)


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


AHEAD = {"n": (-12, 12), "delta": (-35, 35)}
TWIN = {"n": (-4, 12), "delta_starboard": (-35, 105), "delta_port": (-105, 35), "n_bow": (-40, 40)}


@pytest.mark.parametrize(
    ("world", "motion", "inputs", "count", "most", "usual"),
    [
        (WORLDS["pond"], ((-0.2, 0.5), (-0.15, 0.15), (-0.08, 0.08)), AHEAD, 300, 2e-3, 1e-4),
        # by Froude's law, as the ship of 3 m is integrated; the package rounds the change from side to side
        (WORLDS["kvlcc2"], ((0.25, 0.6), (-0.1, 0.1), (-0.08, 0.08)), AHEAD | {"n": (5, 13)}, 200, 0.03, 2e-4),
        # two rudders outwards, a bow thruster, ahead and astern, branch by branch
        (replace(WORLDS["vectwin"], soft=0.0), ((-0.2, 0.7), (-0.2, 0.2), (-0.1, 0.1)), TWIN, 3000, 1e-6, 1e-9),
    ],
    ids=["pond", "kvlcc2", "vectwin"],
)
def test_a_ship_is_accelerated_as_the_package_has_it(
    world: World, motion: tuple, inputs: dict, count: int, most: float, usual: float
) -> None:
    ours, theirs, size = rates_of_both(world, 2, count, motion, **inputs)
    off = (np.abs(ours - theirs) / (np.abs(theirs) + 0.1 * size))[3 * (world.name == "kvlcc2") :]
    assert np.median(off) < usual and off.max() < most


def test_a_world_has_the_noise_that_it_says() -> None:
    world = WORLDS["basin"]
    errors = sensor_errors(world, 4000, 4, np.random.default_rng(0))
    np.testing.assert_allclose(errors.std(axis=(0, 2)), world.noise, rtol=0.1)
    next_to = [np.corrcoef(errors[1:, i, 0], errors[:-1, i, 0])[0, 1] for i in range(6)]
    low, high = (0.5 * np.exp(-world.sample / tau) for tau in world.colour)
    assert np.abs(next_to[:3]).max() < 0.08 and low - 0.08 < min(next_to[3:]) <= max(next_to[3:]) < high + 0.08


def test_a_wide_world_draws_every_case_anew_over_the_whole_ranges() -> None:
    world, rng, drawn = WORLDS["kvlcc2_wide"], np.random.default_rng(0), []
    for _ in range(400):
        own, conditions = own_world(world, rng)
        train, test = own_runs(SETS["ahead"], conditions, rng)
        assert 0.0 < own.step <= STEP and own.sample == pytest.approx(own.step * own.every)
        assert own.sample * np.sqrt(world.scale) == pytest.approx(conditions["sample"])
        assert min(len(train), len(test)) >= 1 and len(train) + len(test) == conditions["runs"]
        assert own.duration * np.sqrt(world.scale) * conditions["runs"] <= TOTAL and own.duration > 30.0
        drawn.append(conditions)
    for key, (low, high) in RANGES.items():
        values = np.array([one[key] for one in drawn])
        assert low <= values.min() < low * (high / low) ** 0.1 and low * (high / low) ** 0.9 < values.max() <= high


def test_the_library_effects_are_those_of_the_contract() -> None:
    assert sorted(effect.name for effect in LIBRARY) == sorted(CONTRACT.split())
    assert len(STRANGERS) >= 15 and len({effect.name for effect in EFFECTS}) == len(EFFECTS)


@pytest.mark.longest
@pytest.mark.slow
def test_a_neutral_effect_leaves_a_trial_as_it_is_and_a_medium_one_changes_it() -> None:
    cases, runs = with_each_effect()
    plain = alone()
    each = np.split(runs.columns, len(cases), axis=2)
    np.testing.assert_allclose(each[0], plain.columns, atol=1e-9)
    np.testing.assert_allclose(runs.delta[:, : plain.plant.runs], plain.delta, atol=1e-12)
    for effect, changed in zip(EFFECTS, each[1:], strict=True):
        size = np.sqrt(np.mean((changed - plain.columns) ** 2, axis=(0, 2)))
        assert np.max(size / np.array(WORLDS["pond"].noise)) > 0.5, effect.name


def test_the_lag_of_a_ramp_is_its_time_constant() -> None:
    y, x, T = np.zeros(1), 0.0, np.array([0.4])
    for _ in range(200):
        y, x = follow(y, np.array([x]), np.array([x + 0.05]), T, 0.05), x + 0.05
    assert float(x - y[0]) == pytest.approx(0.4, rel=1e-6)


def test_a_world_scales_the_size_of_a_stranger_and_of_nothing_else() -> None:
    world, limit = WORLDS["kvlcc2"], next(one for one in STRANGERS if one.name == "rudder_rate_limit")
    hand = ((limit, "medium"),)
    here, plain = prepared(hand, world=world), prepared(hand, world=replace(world, sizes={}))
    for where in ("key", "inside"):
        one, other = (getattr(case.drawn[0][1], where)["size"] for case in (here, plain))
        assert one == pytest.approx(world.sizes["rudder_rate_limit"] * other)
    np.testing.assert_array_equal(here.force, plain.force)


def test_a_twin_has_the_same_chance_and_hides_nothing() -> None:
    limit = next(one for one in STRANGERS if one.name == "rudder_rate_limit")
    case = prepared(((limit, "medium"),))
    twin = case.twin
    assert case.drawn and not twin.drawn and not twin.hand and twin.coefficients == case.coefficients
    np.testing.assert_array_equal(twin.force, case.force)
    np.testing.assert_array_equal(twin.noise, case.noise)


def test_the_effects_of_the_library_are_dealt_alike_in_all_strengths() -> None:
    hands = deal("library", 60, np.random.default_rng(0))
    assert len({(hand[0][0].name, hand[0][1]) for hand in hands}) == 60


@pytest.mark.longest
@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(written: tuple[Path, str], tmp_path: Path) -> None:
    folder, digest = written
    assert generate(tmp_path / "again", 2, 11, "library") == digest
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            assert (tmp_path / "again" / path.relative_to(folder)).read_bytes() == path.read_bytes()
    with pytest.raises(FileExistsError):
        generate(folder, 1, 1, "null")


@pytest.mark.slow
def test_the_package_reads_the_trials(written: tuple[Path, str]) -> None:
    for case in sorted(written[0].glob("case_*")):
        for role, count in (("train", 7), ("test", 5)):
            trials = read_trials(case / role)
            assert len(trials) == count
            for trial in trials:
                assert trial.kind and trial.has_wind and len(trial) == 301 and trial.dt == pytest.approx(0.5)
                speed = np.hypot(np.diff(trial["x"]), np.diff(trial["y"])) / trial.dt
                assert abs(np.mean(speed) - np.mean(np.hypot(trial["u"], trial["v"]))) < 0.05


# Strangers: dealt alike, and nothing that the package knows spells one
def test_strangers_are_dealt_alike_and_only_where_the_ship_can_have_them() -> None:
    hands = deal("strangers", 2 * len(STRANGERS), np.random.default_rng(0))
    dealt = {(hand[0][0].name, hand[0][1]) for hand in hands}
    assert len(dealt) == len(hands) and {level for _, level in dealt} == {"medium", "strong"}
    left = deal("strangers", 200, np.random.default_rng(0), WORLDS["kvlcc2"].without)
    assert {hand[0][0].name for hand in left} == {e.name for e in STRANGERS} - {"lee_of_a_wall"}


def form_columns(s: SimpleNamespace) -> dict[str, np.ndarray]:
    """Products of state, inputs and wind as a dictionary of unnamed forces would hold them."""
    a = np.hypot(s.a_x, s.a_y)
    named = {"u": s.u, "v": s.v, "r": s.r, "n": s.n, "delta": s.delta, "|v|": np.abs(s.v), "|r|": np.abs(s.r)}
    pairs = {f"{i} {j}": x * y for i, x in named.items() for j, y in named.items()}
    more = {
        "1": 0 * s.u + 1, "x": s.x, "y": s.y, "t": s.t, "u|u|": s.u * np.abs(s.u), "uuu": s.u**3,
        "back": np.minimum(s.n, 0), "delta nn": s.delta * s.n**2, "delta uu": s.delta * s.u**2,
        "delta|delta|": s.delta * np.abs(s.delta), "cos": np.cos(s.psi), "sin": np.sin(s.psi),
        "cos 2": np.cos(2 * s.psi), "sin 2": np.sin(2 * s.psi), "air x": s.a_x * a, "air y": s.a_y * a,
        "air xy": s.a_x * s.a_y,
    }  # fmt: skip
    return named | pairs | more


@foreign("forces", (0.02, 0.04, 0.10))
def yaw_damping(parts: Any, m: Any, e: Any, z: np.ndarray, p: Any) -> None:
    """Quadratic in the yaw rate, which is one of the forms."""
    N = -e.size * m.r * np.abs(m.r)
    parts["yaw_damping"] = (0.0 * N, 0.0 * N, N)


def test_no_single_form_spells_a_stranger() -> None:
    """Of random states no product of two of them, nor the action of an input by a shape, goes with its force."""
    rng, count = np.random.default_rng(6), 4000
    world = WORLDS["pond"]
    particulars, nominal = scaled_ship(world)
    u, v, r = rng.uniform(0.02, 0.45, count), rng.uniform(-0.12, 0.12, count), rng.uniform(-0.06, 0.06, count)
    six = [*rng.normal(0, 6, (2, count)), rng.uniform(-3.1, 3.1, count), u, v, r]
    n, delta, t = rng.uniform(4, 12, count), np.radians(rng.uniform(-35, 35, count)), rng.uniform(0, 150, count)
    north, east = rng.normal(0, 1.5, (2, count))

    def force(effects: list[tuple[Effect, Drawn]], off: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        plant = plant_of(particulars, [nominal], [effects], count, world)
        memory = rng.normal(0, 0.3, (plant.states, count))
        real = n + off[0], delta + off[1]
        for effect, e in plant.effects:
            real = effect.actuators(real[0][None], real[1][None], 0, 0.05, e, {})
        parts, *_ = parts_of(plant, np.vstack([*six, memory]), (*real, north, east), t)
        return np.stack([sum(part[i] for part in parts.values()) for i in range(3)])

    cosine, sine = np.cos(six[2]), np.sin(six[2])
    air = {"a_x": north * cosine + east * sine - u, "a_y": east * cosine - north * sine - v}
    at = SimpleNamespace(x=six[0], y=six[1], psi=six[2], u=u, v=v, r=r, n=n, delta=delta, t=t, **air)
    forms, plain = form_columns(at), force([])
    actions = [force([], off) - plain for off in ((1e-3, 0.0), (0.0, 1e-4))]
    shapes = [forms[k] for k in ("1", "u", "v", "r", "|r|", "delta", "n")]
    spelled = {}
    for effect in (*STRANGERS, yaw_damping):
        change = force([(effect, effect.draw("medium", rng, count))]) - plain
        main = int(np.argmax(np.abs(change).mean(axis=1) / np.array([0.05, 0.2, 0.15])))
        columns = [*forms.values(), *(action[main] * shape for action in actions for shape in shapes)]
        if np.abs(change).max() > 1e-9:  # else it is in the past of the actuators, or in the sensors
            spelled[effect.name] = max(abs(np.corrcoef(change[main], c)[0, 1]) for c in columns if c.std() > 0)
    assert spelled.pop(yaw_damping.name) > 0.999
    assert len(spelled) > 20 and max(spelled.values()) < 0.97, spelled
    assert not {effect.name for effect in STRANGERS} & {*PACKAGE_EFFECTS}


# What an answer got right, and keys that are read only as they were sealed
Parameters = Mapping[str, Mapping[str, float]]
TOW = {"tow": {"X": 0.1, "Y": 0.0, "N": 0.0}}
DRAFT = {"draft": {"share": 0.2}}


def row(verdict: str, *names: str, left: bool = False, first: str = "") -> dict[str, Any]:
    """A row of the record; ``first``: the candidate that leads the ranking where nothing is named."""
    order = list(dict.fromkeys([n for n in (*names, first, "tow", "draft", "bank", "current") if n]))
    evidence = {"candidates": [[n, 20.0, 0.1, 1.0] for n in order]}
    return {"answer": [verdict, list(names), left], "evidence": evidence, "processor": 2.0}


def pair(kind: str, truth: Parameters, given: dict[str, Any], strength: str = "weak") -> Pair:
    hidden, strength = {name: dict(values) for name, values in truth.items()}, "" if kind == "null" else strength
    return OpenedCase("pond", kind, Path("case_0000"), hidden, " + ".join(truth) or kind, strength), given


def pairs() -> list[Pair]:
    failed = {"answer": ["error", [], False], "evidence": {"error": "UserError: no"}, "processor": 9.0}
    return [
        pair("library", TOW, row("named", "tow")),  # right
        pair("library", TOW, row("named", "draft"), "strong"),  # wrong name
        pair("library", DRAFT, row("none", first="tow")),
        pair("library", DRAFT, failed),
        pair("null", {}, row("none")),
        pair("null", {}, row("unknown")),
        pair("null", {}, row("named", "bank")),
        pair("strangers", {}, row("unknown")),
        pair("strangers", {}, row("named", "tow", left=True), "strong"),
        pair("strangers", {}, row("named", "tow"), "strong"),
        pair("strangers", {}, row("none")),
        pair("pair", TOW | DRAFT, row("named", "tow", "draft")),
        pair("pair", TOW | DRAFT, row("named", "tow", "draft", "bank")),
        pair("pair", TOW | DRAFT, row("named", "tow")),
    ]


def test_figures_are_those_counted_by_hand() -> None:
    made = {name: (figure.value, figure.of) for name, figure in figures(pairs(), "basin").items()}
    assert made == {
        "blind_null_basin": (1, 3), "blind_foreign_basin": (2, 4), "blind_pair_basin": (1, 3),
        "blind_library_weak_basin": (1, 3), "blind_library_strong_basin": (0, 1),
        "blind_wrong_basin": (3, 14),
    }  # fmt: skip


def test_misses_are_listed_with_their_first_candidates() -> None:
    lines = misses(pairs())
    assert len(lines) == 2 + 9 and "| failed | 1 of 14 |" in scored(pairs(), "basin")
    assert any("| library | draft | weak | none | tow > draft > bank |" in line for line in lines)
    assert "median 2, most 9" in scored(pairs(), "basin")[0]


@pytest.mark.slow
def test_a_key_is_read_only_as_it_was_sealed(tmp_path: Path) -> None:
    folder = tmp_path / "cases"
    digest = dealt(folder, "pond", "library", 1, 11)
    assert dealt(folder, "pond", "library", 1, 11) == digest
    (case,) = opened(folder, digest)
    assert case.kind == "library" and case.label in case.truth
    trial = next((case.folder / "train").iterdir())
    before = trial.read_bytes()
    trial.write_text("another")
    with pytest.raises(UserError, match=trial.name):
        opened(folder, digest)
    trial.write_bytes(before)
    (folder / "key.json").write_text((folder / "key.json").read_text() + " ")
    with pytest.raises(UserError, match=r"key\.json"):
        opened(folder, digest)


def test_a_case_that_fails_is_an_answer() -> None:
    def ask() -> Any:
        raise ValueError("singular")

    assert answer(ask) == ("error", [], False, {"error": "ValueError: singular"})


def test_a_record_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, "code_version", lambda: "abc")
    kept, asked = Record(tmp_path / "answers.jsonl"), []

    def work(case: str) -> dict[str, Any]:
        asked.append(case)
        return row("none")

    tasks = [({"case": name}, (name,)) for name in ("a", "b")]
    kept.measure(work, tasks[:1], 1)
    Record(kept.path).measure(work, tasks, 1)
    assert asked == ["a", "b"] and len(Record(kept.path).of(code="abc")) == 2


@pytest.mark.longest
@pytest.mark.slow
def test_the_whole_run_on_two_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(blind, "answered", lambda case: row("none"))
    arguments = ["--cases", "2", "--seed", "910", "--workers", "1", "--kinds", "null", "--out", str(tmp_path)]
    assert blind.main(arguments) == 0
    said = capsys.readouterr().out
    assert said.index("SHA-256") < said.index("case_0000, none")
    assert "none | 2 of 2 |" in said
    (folder,) = (path for path in tmp_path.iterdir() if path.is_dir())
    next((folders(folder)[0] / "train").iterdir()).write_text("another")
    assert blind.main(arguments) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert json.loads((folder / "key.json").read_text())["kind"] == "null"
