"""Faults that benchmarks plant, into physics, trial files and all that is read, and what is made of them."""

from __future__ import annotations

import ast
import os
import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks import mutants
from benchmarks.file_faults.__main__ import broken, judged
from benchmarks.file_faults.faults import FAULTS
from benchmarks.file_faults.plant import SETS, Hull, Plant, Weather, circle, drawn, run
from benchmarks.fuzz.__main__ import outcome, strange, strict_warnings
from benchmarks.fuzz.damage import REPRODUCERS, numbered, reproducers
from benchmarks.fuzz.readers import GOOD, Reader, readers
from benchmarks.kill import SIGNALS, VERBS, Ended, alone, ended, rows, trials, values
from benchmarks.mutants import ROOT, equivalent, faults, physics, room_tests
from cases.importing.import_logs import SUFFIXES
from mmg.errors import LONGEST, UserError
from tests.support.figures import unrendered

# The faults with which the tests of the physics are measured: each is one small change that still is Python
TEXT = '''"""Not 1 + 1."""
ROW = ("Y_v", -0.3, 0.1, -1.0, 0.0, "mmg", "a starting value")
def force(u: int, v=(1.5), *, n: float = 2) -> float:
    x = -(u + v) * f.sin(n)
    x -= max(u, v) if u < 0 and not v else g(u, v, strict=True)
    return table("source", 1 + 1) or x ** 2
'''


def test_faults_are_those_of_equations() -> None:
    found = {(fault.number, fault.faulty) for fault in faults("a.py", TEXT)}
    assert found == {
        (3, "def force(u: int, v=(2.5), *, n: float = 2) -> float:"),
        (3, "def force(u: int, v=(1.5), *, n: float = 3) -> float:"),
        (4, "x = (u + v) * f.sin(n)"),
        (4, "x = -(u - v) * f.sin(n)"),
        (4, "x = -(u + v) / f.sin(n)"),
        (4, "x = -(u + v) * f.cos(n)"),
        (5, "x += max(u, v) if u < 0 and not v else g(u, v, strict=True)"),
        (5, "x -= min(u, v) if u < 0 and not v else g(u, v, strict=True)"),
        (5, "x -= max(u, v) if u <= 0 and not v else g(u, v, strict=True)"),
        (5, "x -= max(u, v) if u < 1 and not v else g(u, v, strict=True)"),
        (5, "x -= max(u, v) if u < 0 or not v else g(u, v, strict=True)"),
        (5, "x -= max(u, v) if u < 0 and v else g(u, v, strict=True)"),
        (5, "x -= max(u, v) if u < 0 and not v else g(v, u, strict=True)"),
        (5, "x -= (g(u, v, strict=True)) if (u < 0 and not v) else (max(u, v))"),
        (6, 'return table("source", 1 + 1) and x ** 2'),
        (6, 'return table("source", 1 + 1) or x * 2'),
        (6, 'return table("source", 1 + 1) or x ** 3'),
    }


@pytest.mark.slow
def test_faults_of_the_physics_are_python_and_their_tests_are_there() -> None:
    for fault in mutants.drawn(3, 100):
        ast.parse(fault.text)
        assert fault.text != (ROOT / fault.path).read_text(encoding="utf-8")
    assert all((ROOT / test).is_file() for path in physics() for test in room_tests(path))


@pytest.mark.slow
def test_a_draw_depends_on_its_seed_and_what_changes_nothing_is_there() -> None:
    keys = [fault.key for fault in mutants.drawn(1, 10**6)]
    assert keys[:20] != [fault.key for fault in mutants.drawn(2, 20)] and len(set(keys)) == len(keys) > 3000
    assert set(equivalent()) <= set(keys) and all(equivalent().values())


# The plant of the benchmark behaves as a ship, and its faults are judged as they should be
NAME = "7 m tanker, mild, 2 Hz"


def test_the_plant_turns_to_starboard_drifts_outward_and_mirrors() -> None:
    hull = Hull(100.0, 16.0, 6.0, 0.75, 7.0, 2.0, 0.05)
    sides = []
    for side in (1.0, -1.0):
        plant = Plant(hull, Weather(), np.random.default_rng(0))
        sides.append(run(plant, circle(side * 35, 0.0, 30.0), 400.0, 1.0, 0.0))
    starboard, port = sides
    assert starboard["r"][-1] > 0 > starboard["v"][-1] and starboard["u"][-1] < 0.9 * hull.speed
    assert np.allclose(starboard["y"], -port["y"], atol=1e-3 * hull.length)


@pytest.mark.slow
def test_sound_files_are_quiet_and_a_fault_of_one_file_is_named() -> None:
    truth = drawn(NAME, 5)
    assert judged(truth, truth, None)[0] == "quiet"
    title = "one file: earth-fixed"
    assert judged(broken(truth, FAULTS[title], NAME, 5, title), truth, FAULTS[title])[0] == "named"


def test_there_are_30_faults_or_more_and_8_sets() -> None:
    assert len(FAULTS) >= 30 and len(SETS) == 8
    lengths = [some.hull.length for some in SETS.values()]
    assert min(lengths) == pytest.approx(3.0) and max(lengths) == pytest.approx(320.0)


# Every reader meets damaged files and texts: it reads them or refuses them in one line, and soon
LOGS = [path.stem for path in (GOOD / "logs").iterdir() if path.suffix in SUFFIXES]
NAMES = sorted({*REPRODUCERS, *LOGS})
FOUND: dict[str, Reader] = {}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Reader]]:
    with unrendered():
        FOUND.update(readers(tmp_path_factory.mktemp("fuzz") / "files"))
    with strict_warnings():
        yield FOUND


@pytest.mark.slow
def test_every_reader_reads_the_good_file(made: dict[str, Reader]) -> None:
    assert set(REPRODUCERS) | set(LOGS) == set(made)
    assert {name: outcome(reader, reader.seeds[0]) for name, reader in made.items()} == dict.fromkeys(made, "read")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "content"), list(reproducers()))
def test_what_once_did_harm_is_answered(name: str, content: bytes, made: dict[str, Reader]) -> None:
    assert outcome(made[name], content) in ("read", "refused")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("parquet", 29816),
        ("parquet", 35374),
        ("diagnosis", 28),
        ("import_map", 105),
    ],
)
def test_what_fuzzing_found_is_answered(name: str, number: int, made: dict[str, Reader]) -> None:
    """Columns of different lengths; statistics of a column that abort the process; brackets without end."""
    assert outcome(made[name], numbered(name, number, made[name].seeds)) in ("read", "refused")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(number=st.integers(0, 2**32))
def test_damaged_files_are_read_or_refused(name: str, number: int, made: dict[str, Reader]) -> None:
    assert outcome(made[name], numbered(name, number, made[name].seeds)) in ("read", "refused")


def test_a_reader_that_fails_is_seen() -> None:
    def fails(content: bytes) -> None:
        raise ZeroDivisionError if len(content) % 2 else UserError("one line")

    found = strange("wind", Reader(fails, (b"1.5:60",)), range(5, 45))
    assert set(found) == {"ZeroDivisionError: "} and 5 <= min(found["ZeroDivisionError: "]) <= 44


def test_an_error_says_no_more_than_anyone_reads() -> None:
    text = str(UserError("a" * 100_000 + "end"))
    assert len(text) <= LONGEST and text.startswith("aaa") and " ... " in text and text.endswith("end")


# A fit that is ended at a random moment leaves a whole folder or none, and resumed it has the values of another
@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_sample_of_kills_leaves_nothing_half_written(tmp_path: Path) -> None:
    trials(tmp_path)
    whole, seconds = alone(tmp_path, "fit", "whole")
    draw = random.Random(3)
    found = [ended(tmp_path, "fit", number, draw.uniform(0.1, 0.9), whole, seconds) for number in SIGNALS]
    assert [e.faults for e in found] == [()] * 3


def test_commands_of_each_kind_are_ended() -> None:
    assert {words.split()[0] for words in VERBS.values()} >= {"fit", "train", "diagnose", "select", "export"}
    assert all("OUT" in words for words in VERBS.values())


def test_times_are_no_values_and_faults_are_counted() -> None:
    assert values({"seconds": 1.0, "rows": [{"timings_s": {}, "x": 2}]}) == {"rows": [{"x": 2}]}
    found = [Ended("fit", "SIGINT", (), 0.1), Ended("fit", "SIGINT", ("other values",), 0.25)]
    assert rows(found) == [["fit", "SIGINT", "2", "1", "other values (at 0.250)"]]
