"""Every reader meets damaged files: it reads them or refuses them in one line, and soon."""

from __future__ import annotations

import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz import REPRODUCERS, Reader, damaged, outcome, readers, reproducers
from mmg.errors import LONGEST, UserError

FOUND: dict[str, Reader] = {}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Reader]:
    FOUND.update(readers(tmp_path_factory.mktemp("fuzz") / "files"))
    return FOUND


def test_every_reader_reads_the_good_file(made: dict[str, Reader]) -> None:
    assert set(made) == set(REPRODUCERS)
    assert {name: outcome(reader, reader.seeds[0])[0] for name, reader in made.items()} == dict.fromkeys(made, "read")


@pytest.mark.parametrize(("name", "content"), list(reproducers()))
def test_what_once_did_harm_is_answered(name: str, content: bytes, made: dict[str, Reader]) -> None:
    assert outcome(made[name], content)[0] in ("read", "refused")


@pytest.mark.parametrize("name", sorted(REPRODUCERS))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(number=st.integers(0, 2**32))
def test_damaged_files_are_read_or_refused(name: str, number: int, made: dict[str, Reader]) -> None:
    content = damaged(random.Random(number), made[name].seeds)
    assert outcome(made[name], content)[0] in ("read", "refused")


def test_an_error_says_no_more_than_anyone_reads() -> None:
    text = str(UserError("a" * 100_000 + "end"))
    assert len(text) <= LONGEST and text.startswith("aaa") and " ... " in text and text.endswith("end")
