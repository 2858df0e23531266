"""The faults with which the tests of the physics are measured: each is one small change that still is Python."""

from __future__ import annotations

import ast

import pytest

from benchmarks.mutants import ROOT, drawn, equivalent, faults, physics, room_tests

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
    for fault in drawn(3, 100):
        ast.parse(fault.text)
        assert fault.text != (ROOT / fault.path).read_text(encoding="utf-8")
    assert all((ROOT / test).is_file() for path in physics() for test in room_tests(path))


@pytest.mark.slow
def test_a_draw_depends_on_its_seed_and_what_changes_nothing_is_there() -> None:
    keys = [fault.key for fault in drawn(1, 10**6)]
    assert keys[:20] != [fault.key for fault in drawn(2, 20)] and len(set(keys)) == len(keys) > 3000
    assert set(equivalent()) <= set(keys) and all(equivalent().values())
