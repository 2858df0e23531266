"""Imports go down the floors, never in a circle, and take no name that begins with an underscore."""

from __future__ import annotations

import ast

from tests.architecture.source import BESIDE, FLOORS, Source, imports, is_private, known, sources


def target(module: str, name: str | None) -> str:
    """The module that an import reads: ``from package import module`` reads the module."""
    return f"{module}.{name}" if name and known(f"{module}.{name}") else module


def upward() -> list[str]:
    found = []
    for source in sources().values():
        for module, name, _, _ in imports(source):
            floor = target(module, name).split(".")[0]
            if floor in BESIDE or (floor in FLOORS and FLOORS.index(floor) > FLOORS.index(source.floor)):
                found.append(f"{source.floor}: {source.name} imports {target(module, name)}")
    return found


def circles() -> list[str]:
    """Groups of modules that import each other, directly or through others (Tarjan's strong components)."""
    graph = {
        source.name: sorted({target(m, n) for m, n, _, _ in imports(source) if known(target(m, n))} - {source.name})
        for source in sources().values()
    }
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    groups = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in order:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], order[other])
        if low[node] == order[node]:
            group = [stack.pop()]
            while group[-1] != node:
                group.append(stack.pop())
            if len(group) > 1:
                groups.append("product: " + " and ".join(sorted(group)))

    for node in graph:
        if node not in order:
            visit(node)
    return groups


def dotted(node: ast.AST) -> str:
    """``a.b.c`` of an attribute chain, empty where it is not one of names alone."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        base = dotted(node.value)
        return f"{base}.{node.attr}" if base else ""
    return ""


def own_names(source: Source) -> set[str]:
    """Underscore names that the module itself defines or assigns, as variables or as attributes."""
    own = set()
    for node in source.nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            own.add(node.name)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            own.add(node.attr)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            own.add(node.id)
    return own


NOT_PRIVATE = {"_replace", "_asdict", "_fields", "_make", "_exit", "_repr_html_", "_run_finalizers"}
"""Public names of named tuples, of os, what a notebook calls, and what multiprocessing has no public name for."""


def borrowed(source: Source) -> list[str]:
    """Underscore names of other modules that ``source`` imports, reads, or patches by their text."""
    found = []
    bound: dict[str, str] = {}
    for module, name, local, _ in imports(source):
        bound[local] = target(module, name)
        for part in [*module.split("."), name or ""]:
            if is_private(part):
                found.append(f"{part} of {module}")
    own = own_names(source)
    for node in source.nodes:
        if isinstance(node, ast.Attribute) and is_private(node.attr) and node.attr not in NOT_PRIVATE:
            base = dotted(node.value)
            if bound.get(base) or (base not in ("self", "cls") and node.attr not in own):
                found.append(f"{node.attr} of {bound.get(base, base or 'an object')}")
        elif isinstance(node, ast.Call) and dotted(node.func).split(".")[-1] in ("setattr", "getattr", "delattr"):
            texts = [a.value for a in node.args[:2] if isinstance(a, ast.Constant) and isinstance(a.value, str)]
            found += [f"{t} by its text" for t in texts if is_private(t.split(".")[-1]) and t not in NOT_PRIVATE]
    return found


def test_imports_go_down_the_floors() -> None:
    assert upward() == []


def test_no_modules_import_each_other() -> None:
    assert circles() == []


def test_no_module_takes_an_underscore_name_of_another() -> None:
    found = [
        f"{source.floor}: {x}" for s in (FLOORS, BESIDE) for source in sources(s).values() for x in borrowed(source)
    ]
    assert found == []
