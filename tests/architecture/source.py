"""The source as data: modules, imports, functions and classes of the seven packages, tests and benchmarks."""

from __future__ import annotations

import ast
import gc
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
FLOORS = ("mmg", "cases", "fitting", "residual", "diagnosis", "delivery", "mmg_ident")
"""From the ground up: a module imports from its own floor and from those before it."""
BESIDE = ("tests", "benchmarks")


Function = ast.FunctionDef | ast.AsyncFunctionDef


def _functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, Function]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            if not isinstance(child, ast.ClassDef):
                yield prefix + child.name, child
            yield from _functions(child, f"{prefix}{child.name}.")
        elif not isinstance(child, ast.expr):
            yield from _functions(child, prefix)


@dataclass(frozen=True)
class Source:
    """One Python file: its dotted module name, its path, whether it is a package's ``__init__``, text and tree."""

    name: str
    path: Path
    is_package: bool
    text: str
    tree: ast.Module

    @property
    def floor(self) -> str:
        return self.name.split(".")[0]

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """Every node of the tree."""
        return list(ast.walk(self.tree))

    @cached_property
    def functions(self) -> list[tuple[str, Function]]:
        """Functions and methods at every depth, with their dotted name inside the module."""
        return list(_functions(self.tree, ""))


@cache
def sources(folders: tuple[str, ...] = FLOORS) -> dict[str, Source]:
    """Files below ``folders`` by module name."""
    found = {}
    gc.disable()  # it would look through the million nodes again and again, which all stay
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            is_package = parts[-1] == "__init__"
            name = ".".join(parts[:-1] if is_package else parts)
            text = path.read_text()
            found[name] = Source(name, path, is_package, text, ast.parse(text))
    gc.freeze()
    gc.enable()
    return found


@cache
def known(name: str) -> bool:
    """Whether ``name`` is a module of this repository."""
    path = ROOT.joinpath(*name.split("."))
    return name.split(".")[0] in (*FLOORS, *BESIDE) and (path.with_suffix(".py").exists() or path.is_dir())


def imports(source: Source) -> Iterator[tuple[str, str | None, str]]:
    """Rows (module, name or None, name it is bound to) of every import, those in functions included."""
    for node in source.nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, None, alias.asname or alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = source.name.split(".")
                kept = parts[: len(parts) - node.level + (1 if source.is_package else 0)]
                base = ".".join([*kept, *([node.module] if node.module else [])])
            for alias in node.names:
                yield base, alias.name, alias.asname or alias.name


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__") and name != "_"


def arguments(function: Function) -> list[ast.arg]:
    """Arguments of ``function`` without self, cls and names that begin with an underscore."""
    spec = function.args
    every = [*spec.posonlyargs, *spec.args, *spec.kwonlyargs, *([spec.vararg] if spec.vararg else [])]
    every += [spec.kwarg] if spec.kwarg else []
    return [a for a in every if a.arg not in ("self", "cls") and not a.arg.startswith("_")]


def mentions(text: str, word: str) -> bool:
    """Whether ``word`` stands in ``text`` as a word of its own."""
    return re.search(rf"(?<![A-Za-z0-9_]){re.escape(word)}(?![A-Za-z0-9_])", text) is not None
