"""A program whose last stage is divided hands on what later parts need, and computes nothing twice."""

from __future__ import annotations

import casadi as ca
import pytest

from mmg.compile.stages import Program, staged_bodies


def program(terms: int) -> Program:
    """A long sum of products of the two arguments, of which the second belongs to an early stage."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    total = p[0] * p[1]
    for k in range(terms):
        total = ca.sin(total + k * x[k % 3]) * p[k % 2]
    return Program.of(ca.Function("f", [x, p], [total, x[0] * total]), (2, 1))


@pytest.mark.parametrize("size", [7, 20, 1000])
def test_each_value_is_in_one_part_and_known_where_it_is_used(size: int) -> None:
    whole = program(30)
    parted = whole.divided([0, 1], 2, size)
    last = max(value.stage for value in parted.values)
    count = len(whole.needed([0, 1], 1))
    assert last - 2 == (len([v for v in whole.values if v.stage == 2 and v.argument is None]) - 1) // size
    bodies = staged_bodies(parted, [0, 1], {0: "x", 1: "p"}, {k: f"m{k}" for k in range(1, last)}, "d")
    made = [line for body in bodies.values() for line in body.text.split("\n") if "sin" in line]
    assert len(made) == 30 and count > 90
    for stage, body in bodies.items():
        known: set[str] = set()
        for line in (line.strip() for line in body.text.split("\n")):
            if line.startswith("const V "):
                name, words = line.removeprefix("const V ").split(" = ")
                assert name not in known
                used = {w.strip("();,-") for w in words.replace("(", " ").split() if w.strip("();,-")[:1] == "a"}
                assert used <= known | {"a"}, (stage, line)
                known.add(name)
    assert whole.divided([0, 1], 2, 10**6) == whole
