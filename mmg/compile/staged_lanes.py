"""C statements on vectors of LANES points for a program in stages: what an early stage gives is made once and kept.

The values of a ship's right-hand side that hang on the coefficients alone need no second evaluation within an interval,
those of the inputs none within a step. Each stage becomes the body of a C function; what it hands on lies in arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mmg.compile.codegen import constant, expression
from mmg.compile.stages import CONSTANT, Program

FUNCTION_SIZE = 800
"""Instructions in one C function: registers are given out in more than twice the time for twice as many. Of 11,000
instructions gcc 12 makes code in 1.4 s, in 2.4 s with 3,000 a function, and that code is as fast to some per cent."""
UNIT_TEXT = 150_000
"""Characters of such functions that are compiled together: each start of a compiler takes some .02 s."""


@dataclass(frozen=True)
class StagedBody:
    """C statements of one stage, and the number of values that it hands on."""

    text: str
    handed: int


@dataclass(frozen=True)
class DividedCode:
    """C functions of a program whose last stage is divided among several.

    early: bodies of the stages before the last one; functions: C text of each part of the last stage; declared: what a
    caller has to know of them; call: statements that call them one after the other, with the names that they were made
    with and an array d for the results.
    """

    early: dict[int, StagedBody]
    functions: list[str]
    declared: str
    call: str


def divided_code(
    name: str, program: Program, outputs: Sequence[int], arguments: Mapping[int, str], arrays: Mapping[int, str]
) -> DividedCode:
    """Code for some ``outputs`` of a ``program``, its last stage in functions NAME_0, NAME_1, ... of at most
    FUNCTION_SIZE instructions. name: NAME; arguments, arrays: as of ``staged_bodies``, arrays for early stages only."""
    last = max(arrays, default=CONSTANT) + 1
    mine = program.divided(outputs, last, FUNCTION_SIZE)
    parts = max([last, *(value.stage for value in mine.values)]) + 1 - last
    between = {last + i: f"(M + {i} * {name}_most)" for i in range(parts - 1)}
    bodies = staged_bodies(mine, outputs, arguments, {**arrays, **between}, "d")
    most = max([bodies[stage].handed for stage in between], default=0) + 1
    given = [*arguments.values(), *arrays.values()]
    taken = ", ".join([*(f"const V* {one}" for one in given), "V* M", "V* d"])
    heads = [f"HIDDEN void {name}_{i}({taken})" for i in range(parts)]
    size = f"#define {name}_most {most}\n"
    functions = [
        f"{size}{head} {{\n  {bodies[last + i].text}\n}}\n#undef {name}_most\n" for i, head in enumerate(heads)
    ]
    calls = " ".join(f"{name}_{i}({', '.join([*given, 'M', 'd'])});" for i in range(parts))
    declared = "".join(f"{head};\n" for head in heads)
    return DividedCode({stage: bodies[stage] for stage in arrays}, functions, declared, f"V M[{most * parts}]; {calls}")


def units_of(head: str, functions: Sequence[str]) -> list[str]:
    """C ``functions`` in units of about UNIT_TEXT characters, each behind the same ``head``."""
    units: list[str] = []
    size = UNIT_TEXT
    for text in functions:
        if size + len(text) > UNIT_TEXT:
            units.append(head)
            size = 0
        units[-1] += text
        size += len(text)
    return units


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
