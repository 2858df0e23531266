"""C statements on vectors of LANES points for a program in stages: what an early stage gives is made once and kept.

The values of a ship's right-hand side that hang on the coefficients alone need no second evaluation within an interval,
those of the inputs none within a step. Each stage becomes the body of a C function; what it hands on lies in arrays.
"""

from __future__ import annotations

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
    program: Program, outputs: Sequence[int], arguments: Mapping[int, str], arrays: Mapping[int, str], result: str
) -> dict[int, StagedBody]:
    """Bodies by stage for some ``outputs`` of a ``program``.

    arguments: argument -> name of its C array; arrays: stage, from the first to the one before the last -> name of the
    array for what it hands on; the last stage is one more. result: name of the array to which the last stage writes the
    nonzeros of the outputs, one output after the other. Raises NotImplementedError for an operation without C.
    """
    stages = [*arrays, max(arrays) + 1]
    place: dict[int, str] = {}
    bodies = {}
    for stage in stages:
        last = stage == stages[-1]
        lines: list[str] = []
        known: set[int] = set()
        for at in program.needed(outputs):
            value = program.values[at]
            if value.stage != stage or value.argument is not None:
                continue
            for operand in value.operands:
                lines += _known(program, operand, stage, arguments, place, known)
            known.add(at)
            operands = [f"a{i}" for i in value.operands]
            lines.append(f"const V a{at} = {expression(value.operation, operands)};")
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
