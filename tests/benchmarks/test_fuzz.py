"""Every reader meets damaged files and texts: it reads them or refuses them in one line, and soon."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz.__main__ import outcome, piece, strict_warnings, table
from benchmarks.fuzz.damage import REPRODUCERS, numbered, reproducers
from benchmarks.fuzz.readers import Reader, readers
from benchmarks.fuzz.samples import GOOD
from benchmarks.kill import SIGNALS, Ended, alone, ended, rows, trials, values
from cases.importing.import_logs import SUFFIXES
from mmg.errors import LONGEST, UserError
from tests.support.figures import unrendered

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
    assert {name: outcome(reader, reader.seeds[0])[0] for name, reader in made.items()} == dict.fromkeys(made, "read")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "content"), list(reproducers()))
def test_what_once_did_harm_is_answered(name: str, content: bytes, made: dict[str, Reader]) -> None:
    assert outcome(made[name], content)[0] in ("read", "refused")


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
    assert outcome(made[name], numbered(name, number, made[name].seeds))[0] in ("read", "refused")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(number=st.integers(0, 2**32))
def test_damaged_files_are_read_or_refused(name: str, number: int, made: dict[str, Reader]) -> None:
    assert outcome(made[name], numbered(name, number, made[name].seeds))[0] in ("read", "refused")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.one_of(st.binary(max_size=300), st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
)
def test_noise_is_read_or_refused(name: str, content: bytes, made: dict[str, Reader]) -> None:
    assert outcome(made[name], content)[0] in ("read", "refused")


def test_a_reader_that_fails_is_seen() -> None:
    def fails(content: bytes) -> None:
        raise ZeroDivisionError if len(content) % 2 else UserError("one line")

    row = piece("wind", Reader(fails, (b"1.5:60",)), range(5, 45))
    assert set(row["strange"]) == {"ZeroDivisionError: "} and min(row["strange"]["ZeroDivisionError: "]) >= 5
    wrong = len(row["strange"]["ZeroDivisionError: "])
    assert row["refused"] == 40 - wrong and row["read"] == 0
    line = table([row])[2]
    assert line.startswith(f"| wind | 5 | 40 | 0 | {row['refused']} |") and line.endswith(f"| {wrong} |")


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


def test_times_are_no_values_and_faults_are_counted() -> None:
    assert values({"seconds": 1.0, "rows": [{"timings_s": {}, "x": 2}]}) == {"rows": [{"x": 2}]}
    found = [Ended("fit", "SIGINT", (), 0.1), Ended("fit", "SIGINT", ("other values",), 0.25)]
    assert rows(found) == [["fit", "SIGINT", "2", "1", "other values (at 0.250)"]]
