"""Small faults of a Python text, as a programmer makes them: a wrong sign, operator, number, function or order.

Not made in rows of coefficient tables (calls of ``table`` and ``Parameter``, and tuples that begin with the name of a
coefficient): those are starting values and bounds with their sources, not equations.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

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
        line, faulty = (
            lines[row - 1].strip(),
            (text[starts[row - 1] : begin] + new + text[end : starts[end_row]]).splitlines()[0].strip(),
        )
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
