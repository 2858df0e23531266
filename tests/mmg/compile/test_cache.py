"""Compiled code: where it is kept, whom it is taken from, and life without a compiler."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.compile import cache
from mmg.compile.batch import FLAGS, batch_functions
from mmg.compile.cache import UNIT, LateSource, cache_folder, compile_library, compiler, load_library
from mmg.compile.codegen import LANES
from mmg.rollout import Simulator
from tests.support.wrong_compiler import use_wrong_compiler

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def simple(name: str, factor: float) -> ca.Function:
    """The function x + factor y."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    return ca.Function(name, [x, y], [x + factor * y])


# Without a compiler


def why_interpreted(compiled: bool = True) -> str:
    """Why a simulator of a ship is interpreted."""
    return Simulator(load_ship("esso_osaka_3m"), compiled).interpreted_because


@pytest.mark.parametrize("name", ["none", "no-such-compiler-anywhere"])
def test_without_a_compiler_it_works_and_says_so(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MMG_CC", name)
    monkeypatch.setenv("MMG_CACHE", str(tmp_path))
    reason = why_interpreted()
    assert compiler() is None and reason.startswith("no C compiler") and repr(name) in reason
    assert list(tmp_path.iterdir()) == [] and "switched off" in why_interpreted(compiled=False)


def script(folder: Path, body: str) -> str:
    """An executable shell script that stands in for a compiler."""
    path = folder / "cc.sh"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("echo fatal: broken >&2; echo second line >&2; exit 3", "cc.sh failed: fatal: broken"),
        ("exit 1", "cc.sh failed"),
        ("echo 'code.c: In function f' >&2; echo 'c.c:1: error: why' >&2; exit 1", "failed: c.c:1: error: why"),
        (r"printf 'error: \351\377 \033[2J\n' >&2; exit 1", "cc.sh failed: error"),
        ("exit 0", "cc.sh made no library"),
        pytest.param("kill -9 $$", "signal 9", marks=pytest.mark.skipif(os.name != "posix", reason="signals")),
    ],
)
def test_a_broken_compiler_is_reported_in_one_sentence(
    body: str, sentence: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("MMG_CC", script(tmp_path, body))
    monkeypatch.setenv("MMG_CACHE", str(tmp_path / "cache"))
    path, reason = compile_library("int x;", FLAGS)
    assert path is None
    assert sentence in reason and "\n" not in reason
    assert list((tmp_path / "cache").iterdir()) == []
    assert sentence in why_interpreted()


def test_a_library_that_does_not_load_is_reported_and_interpreted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A compiler that ends well but writes rubbish to the file after -o."""
    body = 'while [ "$1" != "-o" ]; do shift; done; echo rubbish > "$2"'
    monkeypatch.setenv("MMG_CC", script(tmp_path, body))
    monkeypatch.setenv("MMG_CACHE", str(tmp_path / "cache"))
    assert why_interpreted()


def test_a_cache_that_cannot_be_written_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("MMG_CC", script(tmp_path, "exit 0"))
    monkeypatch.setenv("MMG_CACHE", str(tmp_path / "file"))
    path, reason = compile_library("int x;", FLAGS)
    assert path is None and reason


# Cache


@needs_compiler
def test_the_same_code_is_compiled_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A stand-in that counts its calls; other code or other flags compile again."""
    real, log = compiler(), tmp_path / "calls"
    monkeypatch.setenv("MMG_CC", script(tmp_path, f'echo called >> {log}\nexec {real} "$@"'))
    monkeypatch.setenv("MMG_CACHE", str(tmp_path / "cache"))

    def calls_and_files() -> tuple[int, int]:
        return log.read_text().count("called"), len(list((tmp_path / "cache").iterdir()))

    for _ in range(3):
        assert batch_functions([simple("add", 1)])[1] == ""
        assert calls_and_files() == (1, 1)
    batch_functions([simple("subtract", -1)])
    assert calls_and_files() == (2, 2)
    compile_library("int x;", FLAGS)
    compile_library("int x;", ("-shared", "-fPIC"))
    assert calls_and_files() == (4, 4)


def test_code_made_of_other_c_files_is_other_code(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A release that differs in a C file alone does not take the libraries of the one before."""
    assert {"functions.h", "vector.h", "rollout.c", "codegen.py"} <= {path.name for path in cache.SOURCES}
    monkeypatch.setattr(cache, "SOURCES", (tmp_path / "loops.c",))
    keys = set()
    for text in ("a", "b", "a"):
        (tmp_path / "loops.c").write_text(text)
        keys.add(LateSource.of([simple("add", 1)], str).made_from)
    assert len(keys) == 2


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A library that was compiled into a new cache."""
    monkeypatch.setenv("MMG_CACHE", str(tmp_path / "cache"))
    path, reason = compile_library(SEVEN, FLAGS)
    assert path and not reason
    return path


SEVEN = "int seven(void) { return 7; }"


@needs_compiler
def test_only_the_user_can_write_to_the_cache(kept: Path) -> None:
    assert kept.parent.stat().st_mode & 0o777 == 0o700
    assert kept.stat().st_mode & 0o077 == 0


@needs_compiler
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_a_cache_that_others_can_write_to_is_not_used(kept: Path, mode: int) -> None:
    kept.parent.chmod(mode)
    path, reason = compile_library(SEVEN, FLAGS)
    assert path is None and "chmod 700" in reason
    kept.parent.chmod(0o755)
    assert compile_library(SEVEN, FLAGS) == (kept, "")


@needs_compiler
def test_a_cache_of_another_user_is_not_used(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    path, reason = compile_library(SEVEN, FLAGS)
    assert path is None and reason


@needs_compiler
def test_a_planted_library_is_not_run(kept: Path) -> None:
    """Of the right name but other content, or that others can write: compiled anew, never loaded."""
    good = kept.read_bytes()
    other, _ = compile_library("int seven(void) { return 8; }", FLAGS)
    assert other
    kept.write_bytes(other.read_bytes())
    library, _ = load_library(SEVEN, FLAGS)
    assert library and library.seven() == 7 and kept.read_bytes() == good
    kept.chmod(0o722)
    assert compile_library(SEVEN, FLAGS)[0] == kept and kept.stat().st_mode & 0o022 == 0


@needs_compiler
@pytest.mark.parametrize("left", [0, 1, 500, -100])
def test_a_truncated_library_is_compiled_anew(kept: Path, left: int) -> None:
    """Loading it would end the process with SIGBUS."""
    good = kept.read_bytes()
    kept.write_bytes(good[:left])
    library, reason = load_library(SEVEN, FLAGS)
    assert library and not reason and library.seven() == 7
    assert kept.read_bytes() == good and list(kept.parent.iterdir()) == [kept]


@needs_compiler
def test_the_cache_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Absolute, relative, unset, and an empty or relative folder of XDG."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MMG_CACHE", str(tmp_path / "here"))
    assert cache_folder() == tmp_path / "here"
    monkeypatch.setenv("MMG_CACHE", ".")
    tmp_path.chmod(0o700)
    assert cache_folder() == tmp_path and load_library(SEVEN, FLAGS)[0]
    monkeypatch.setenv("MMG_CACHE", "")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for unset in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", unset)
        assert cache_folder() == tmp_path / "home" / ".cache" / "mmg-ident"


def test_without_a_home_there_is_no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    """HOME unset, and no entry in passwd."""

    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("MMG_CACHE", raising=False)
    monkeypatch.setenv("MMG_CC", "true")
    monkeypatch.setattr(Path, "home", homeless)
    library, why = compile_library(SEVEN, FLAGS)
    assert library is None and "MMG_CACHE" in why


@needs_compiler
def test_code_that_gives_wrong_numbers_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = use_wrong_compiler("s/void store(double. p, V x) {/& x *= 1.001;/", tmp_path, monkeypatch)
    (batch,), reason = batch_functions([simple("wrong", 3.0)])
    assert batch.library is None and "cc.sh" in reason and not list(folder.glob("*.so"))
    np.testing.assert_array_equal(batch(*np.ones((2, 1, LANES)))[0], 4.0)


@needs_compiler
def test_one_line_of_a_process_says_what_is_compiled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("MMG_CACHE", str(tmp_path))
    # the first of a process, a second one, and the first one of another process from the cache
    for said, factor, announced in ((1, 1, []), (0, 2, ["first"]), (0, 1, [])):
        caplog.clear()
        monkeypatch.setattr(cache, "announced", announced)
        with caplog.at_level(logging.INFO):
            batch_functions([simple("add", factor)])
        assert [str(tmp_path) in r.message for r in caplog.records if "compiling" in r.message] == [True] * said


@needs_compiler
def test_units_are_linked_to_one_library_and_an_error_in_one_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("MMG_CACHE", str(tmp_path))
    first, second = "int more(int); int two(void) { return more(1); }", "int more(int a) { return a + 1; }"
    library, reason = load_library(UNIT.join([first, second]), FLAGS)
    assert library is not None and library.two() == 2, reason
    path, reason = compile_library(UNIT.join([first, "int more(int a) { return b; }"]), FLAGS)
    assert path is None and "failed" in reason and "undeclared" in reason
    assert len(list(tmp_path.iterdir())) == 1
