"""C statements on vectors of LANES points for a program in stages: what an early stage gives is made once and kept.

The values of a ship's right-hand side that hang on the coefficients alone need no second evaluation within an interval,
those of the inputs none within a step. Each stage becomes the body of a C function; what it hands on lies in arrays.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mmg.compile.codegen import constant, expression
from mmg.compile.stages import CONSTANT, Program


@dataclass(frozen=True)
class StagedBody:
    """C statements of one stage, and the number of values that it hands on."""

    text: str
    handed: int


def staged_bodies(
    program: Program,
    outputs: Sequence[int],
    arguments: Mapping[int, str],
    arrays: Mapping[int, str],
    result: str,
    fuse: bool = False,
) -> dict[int, StagedBody]:
    """Bodies by stage for some ``outputs`` of a ``program``.

    arguments: argument -> name of its C array; arrays: stage, from the first to the one before the last -> name of the
    array for what it hands on; the last stage is one more. result: name of the array to which the last stage writes the
    nonzeros of the outputs, one output after the other; fuse: round a product and what it is added to once. Raises
    NotImplementedError for an operation without C.
    """
    stages = [*arrays, max(arrays, default=CONSTANT) + 1]
    sums, inside = program.fused_sums(outputs) if fuse else ({}, set())
    place: dict[int, str] = {}
    bodies = {}
    for stage in stages:
        last = stage == stages[-1]
        lines: list[str] = []
        known: set[int] = set()
        for at in program.needed(outputs):
            value = program.values[at]
            if value.stage != stage or value.argument is not None or at in inside:
                continue
            operands = sums[at].operands if at in sums else value.operands
            for operand in operands:
                lines += _known(program, operand, stage, arguments, place, known)
            known.add(at)
            given = [f"a{i}" for i in operands]
            text = sums[at].text.format(*given) if at in sums else expression(value.operation, given)
            lines.append(f"const V a{at} = {text};")
        if last:
            wanted = [at for j in outputs for at in program.results[j] if at is not None]
            for row, at in enumerate(wanted):
                lines += _known(program, at, stage, arguments, place, known)
                lines.append(f"{result}[{row}] = a{at};")
            bodies[stage] = StagedBody("\n  ".join(lines), len(wanted))
            continue
        handed = program.handed_on(outputs, stage)
        for row, at in enumerate(handed):
            place[at] = f"{arrays[stage]}[{row}]"
            lines.append(f"{place[at]} = a{at};")
        bodies[stage] = StagedBody("\n  ".join(lines), len(handed))
    return bodies


def side_by_side(body: str, arrays: str, vectors: int) -> str:
    """The statements of a ``body`` for several ``vectors`` at once, each for one after the other: while one waits, the
    others go on.

    arrays: letters with which the names of its arrays begin, in which element i of vector e is i * vectors + e.
    """
    if vectors == 1:
        return body
    element = re.compile(rf"\b([{arrays}]\d*)\[(\d+)\]")
    lines = []
    for line in body.splitlines():
        for e in range(vectors):

            def moved(found: re.Match[str], e: int = e) -> str:
                return f"{found[1]}[{int(found[2]) * vectors + e}]"

            lines.append(element.sub(moved, re.sub(r"\ba(\d+)\b", rf"a\1_{e}", line)))
    return "\n".join(lines)


def _known(
    program: Program, at: int, stage: int, arguments: Mapping[int, str], place: Mapping[int, str], known: set[int]
) -> list[str]:
    """Statements that name a value from outside the ``stage``, unless it is ``known``, which it is afterwards."""
    value = program.values[at]
    if at in known:
        return []
    known.add(at)
    if value.argument is not None:
        return [f"const V a{at} = {arguments[value.argument[0]]}[{value.argument[1]}];"]
    if value.stage == CONSTANT and not value.operands:
        return [f"const V a{at} = fill({constant(value.number)});"]
    if value.stage == CONSTANT:
        before = [line for i in value.operands for line in _known(program, i, stage, arguments, place, known)]
        return [*before, f"const V a{at} = {expression(value.operation, [f'a{i}' for i in value.operands])};"]
    return [f"const V a{at} = {place[at]};"]
