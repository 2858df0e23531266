"""How many small faults in the physics the tests of its rooms notice: the mutation score.

python -m benchmarks.mutants [--sample N] [--seed S] [--least PERCENT] [--workers W] [--record]: draws N faults among
all that ``faults`` can make in the files of ROOMS, runs the tests of the file's room on each until one fails, and
prints the score and the faults that no test noticed. Exit code 1 below --least. Faults that change nothing are
named in mutants.toml with the reason and do not count. The order of the draw depends on the faulty lines alone, so that
a change elsewhere leaves the sample what it was.

A fault is one that a programmer makes: a wrong sign, operator, number, function or order. None is made in rows of
coefficient tables (calls of ``table`` and ``Parameter``, and tuples that begin with the name of a coefficient): those
are starting values and bounds with their sources, not equations.

Each fault is tested in a copy of the project.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

from benchmarks.record import Figure, done, parser_of, report
from benchmarks.toml import tables

ROOT = Path(__file__).parents[1]
KEPT = tables(Path(__file__).with_suffix(".toml"))
"""Tests by room, and faults that change nothing."""
ROOMS: dict[str, list[str]] = KEPT["rooms"]
QUIET = ("-x", "-q", "-n0", "-p", "no:cacheprovider", "--hypothesis-seed=0", "--tb=line", "-m", "not longest")
LONGEST = 240.0
"""Time [s] after which a test that does not end counts as one that fails."""

OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*"}
COMPARISONS = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
               ast.In: "not in", ast.NotIn: "in", ast.Is: "is not", ast.IsNot: "is"}  # fmt: skip
FUNCTIONS = {"sin": "cos", "cos": "sin", "tanh": "sin", "exp": "cos", "sqrt": "fabs", "min": "max", "max": "min",
             "absolute": "positive", "positive": "absolute", "step": "step_or_zero",
             "step_or_zero": "step"}  # fmt: skip
SYMMETRIC = {"min", "max"}
"""Functions that do not mind the order of their arguments."""
DATA = {"table", "Parameter", "Coefficient"}
"""Calls whose arguments are data."""


@dataclass(frozen=True)
class Fault:
    """A text with one fault. path: of the file; number: of the line; line, faulty: the line before and after; text: of
    the whole file with the fault; again: how many equal faults come before it in the file."""

    path: str
    number: int
    line: str
    faulty: str
    text: str
    again: int

    @property
    def key(self) -> str:
        """What names it as long as its line is not changed."""
        return f"{self.path}: {self.line} -> {self.faulty}" + (f" ({self.again + 1})" if self.again else "")


def faults(path: str, text: str) -> list[Fault]:
    """Every fault of the ``text`` of the file ``path``, in the order of its lines."""
    lines = text.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    found: list[Fault] = []
    seen: Counter[tuple[str, str]] = Counter()
    for (row, column), (end_row, end_column), new in sorted(set(_edits(ast.parse(text), text, lines))):
        begin, end = starts[row - 1] + column, starts[end_row - 1] + end_column
        changed = text[:begin] + new + text[end:]
        line = lines[row - 1].strip()
        faulty = (text[starts[row - 1] : begin] + new + text[end : starts[end_row]]).splitlines()[0].strip()
        found.append(Fault(path, row, line, faulty, changed, seen[line, faulty]))
        seen[line, faulty] += 1
    return found


Place = tuple[int, int]


def _edits(tree: ast.Module, text: str, lines: list[str]) -> Iterator[tuple[Place, Place, str]]:
    """Where a text is replaced, from and to (line, column), and by what."""
    for node in _code(tree):
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            yield _between(node.left, node.right, lines, OPERATORS[type(node.op)])
        elif isinstance(node, ast.AugAssign) and type(node.op) in OPERATORS:
            yield _between(node.target, node.value, lines, OPERATORS[type(node.op)] + "=")
        elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARISONS:
            yield _between(node.left, node.comparators[0], lines, COMPARISONS[type(node.ops[0])])
        elif isinstance(node, ast.BoolOp):
            word = "or" if isinstance(node.op, ast.And) else "and"
            yield _between(node.values[0], node.values[1], lines, word)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            row, column = _start(node)
            yield (row, column), (row, column + (1 if isinstance(node.op, ast.USub) else len("not "))), ""
        elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
            yield _start(node), _end(node), str(not node.value)
        elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            yield _start(node), _end(node), repr(node.value + 1)
        elif isinstance(node, ast.IfExp):
            yield _start(node), _end(node), _conditional(node, text)
        elif isinstance(node, ast.Call):
            yield from _of_call(node, text)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes below ``node`` but for data and for types."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "keywords") and not isinstance(node, ast.Call):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr) and not _is_data(child):
                yield child
                yield from _code(child)


def _is_data(node: ast.AST) -> bool:
    if isinstance(node, ast.keyword):
        return node.arg in ("strict", "frozen")
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in DATA
    first = node.elts[0] if isinstance(node, ast.Tuple) and len(node.elts) > 5 else None
    return isinstance(first, ast.Constant) and isinstance(first.value, str)


def _of_call(node: ast.Call, text: str) -> Iterator[tuple[Place, Place, str]]:
    called = node.func
    name = called.attr if isinstance(called, ast.Attribute) else called.id if isinstance(called, ast.Name) else ""
    if name in FUNCTIONS:
        row, column = _end(called)
        yield (row, column - len(name)), (row, column), FUNCTIONS[name]
    if len(node.args) >= 2 and name not in SYMMETRIC and not any(isinstance(a, ast.Starred) for a in node.args[:2]):
        one, two = (ast.get_source_segment(text, a) or "" for a in node.args[:2])
        if one != two:
            yield _start(node.args[0]), _end(node.args[1]), f"{two}, {one}"


def _conditional(node: ast.IfExp, text: str) -> str:
    body, test, other = (ast.get_source_segment(text, part) or "" for part in (node.body, node.test, node.orelse))
    return f"({other}) if ({test}) else ({body})"


def _between(left: ast.expr, right: ast.expr, lines: list[str], new: str) -> tuple[Place, Place, str]:
    """The operator between two expressions, whatever brackets and spaces stand there."""
    (row, column), (end_row, end_column) = _end(left), _start(right)
    while True:
        line = lines[row - 1]
        stop = end_column if row == end_row else len(line)
        rest = line[column:stop].split("#")[0]
        kept = rest.lstrip(" \t)\n\r\\")
        if kept:
            first = column + len(rest) - len(kept)
            last = first + len(kept.rstrip(" \t(\n\r\\"))
            return (row, first), (row, last), new
        row, column = row + 1, 0


def _start(node: ast.expr) -> Place:
    return node.lineno, node.col_offset


def _end(node: ast.expr) -> Place:
    return node.end_lineno or node.lineno, node.end_col_offset or 0


def physics() -> list[str]:
    """Files with physics, paths from the root of the repository with /."""
    found = {file for place in ROOMS for file in [ROOT / place, *(ROOT / place).rglob("*.py")] if file.suffix == ".py"}
    return sorted(file.relative_to(ROOT).as_posix() for file in found if file.name != "__init__.py")


def room_tests(path: str) -> list[str]:
    """The test files of the physics file ``path``."""
    return ROOMS[max((place for place in ROOMS if path.startswith(place)), key=len)]


@cache
def _every() -> tuple[Fault, ...]:
    """All faults of the physics."""
    return tuple(fault for path in physics() for fault in faults(path, (ROOT / path).read_text(encoding="utf-8")))


def drawn(seed: int, count: int) -> list[Fault]:
    """The first ``count`` of all faults of the physics in an order that ``seed`` makes."""
    return sorted(_every(), key=lambda fault: sha256(f"{seed} {fault.key}".encode()).digest())[:count]


def equivalent() -> dict[str, str]:
    """Faults that change nothing, by their key: the reason."""
    return {f"{row['file']}: {row['line']} -> {row['faulty']}": row["reason"] for row in KEPT["fault"]}


def noticed(fault: Fault | None, tests: Sequence[str]) -> bool:
    """Whether ``tests`` fail, or do not end in time, in a copy of the project with a ``fault``; None: without one."""
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copytree(ROOT, Path(folder) / "copy", ignore=shutil.ignore_patterns(".*", "__pycache__", "runs"))
        if fault:
            (copy / fault.path).write_text(fault.text, encoding="utf-8")
        given = {**os.environ, "PYTHONPATH": str(copy), "HYPOTHESIS_STORAGE_DIRECTORY": folder}
        command = [sys.executable, "-m", "pytest", *QUIET, *tests]
        try:
            code = subprocess.run(command, cwd=copy, env=given, capture_output=True, timeout=LONGEST).returncode
        except subprocess.TimeoutExpired:
            code = 1
    return code != 0


def main() -> int:
    """Draw, test, print; returns 1 where the score is below the least."""
    parser = parser_of("mutants", __doc__)
    for name, value in (("sample", 200), ("seed", 14), ("least", 85), ("workers", os.cpu_count() or 1)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--of", default="", help="only of files whose path begins so")
    given = parser.parse_args()
    reasons = equivalent()
    sample = [f for f in drawn(given.seed, given.sample) if f.path.startswith(given.of)]
    chosen = [fault for fault in sample if fault.key not in reasons]
    every = sorted({test for fault in chosen for test in room_tests(fault.path)})
    for test, found in done(noticed, [(test, (None, [test])) for test in every], given.workers):
        if found:
            print(f"{test} fails without any fault")
            return 1
    killed = 0
    tasks = [(number, (fault, room_tests(fault.path))) for number, fault in enumerate(chosen)]
    for number, found in done(noticed, tasks, given.workers):
        killed += found
        if not found:
            print("not noticed:", chosen[number].key, flush=True)
    print(f"{len(sample) - len(chosen)} drawn faults change nothing")
    made = {"mutants": Figure("faults in the physics that the tests notice", killed, of=len(chosen))}
    report(made, f"mutants --sample {given.sample} --seed {given.seed}", given.record)
    return 0 if 100 * killed >= given.least * len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
