"""Imports go down the floors in no circle, docs/explanation/architecture.md and the folders tell the same story, the
tests mirror the rooms, and what a reader has before him is of a size that he can take in."""

from __future__ import annotations

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

from tests.architecture.source import BESIDE, FLOORS, ROOT, Source, arguments, imports, is_private, known, sources


def target(module: str, name: str | None) -> str:
    """The module that an import reads: ``from package import module`` reads the module."""
    return f"{module}.{name}" if name and known(f"{module}.{name}") else module


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
    for module, name, local in imports(source):
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
    found = []
    for source in sources().values():
        for module, name, _ in imports(source):
            floor = target(module, name).split(".")[0]
            if floor in BESIDE or (floor in FLOORS and FLOORS.index(floor) > FLOORS.index(source.floor)):
                found.append(f"{source.floor}: {source.name} imports {target(module, name)}")
    assert found == []


def test_no_modules_import_each_other() -> None:
    """Directly or through others."""
    graph = {
        source.name: {target(m, n) for m, n, _ in imports(source) if known(target(m, n))} - {source.name}
        for source in sources().values()
    }
    TopologicalSorter(graph).prepare()  # names the modules of a circle


def test_no_module_takes_an_underscore_name_of_another() -> None:
    found = [
        f"{source.floor}: {x}" for s in (FLOORS, BESIDE) for source in sources(s).values() for x in borrowed(source)
    ]
    assert found == []


# The page of the architecture and the folders
ENTRIES = 14
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
BESIDE_THE_ROOMS = {"architecture", "benchmarks", "docs", "support"}


def rooms() -> list[str]:
    """Sub-packages at the top of each floor, as ``cases/io``."""
    return sorted(name.replace(".", "/") for name, s in sources().items() if s.is_package and name.count(".") == 1)


def listed() -> list[str]:
    """Rooms that the page gives a line of their own: ``* `cases/io/`: what it is for``."""
    return sorted(re.findall(r"^\* `([\w/]+)/`: \S", PAGE.read_text(), re.MULTILINE))


def paths_named() -> list[str]:
    """Paths of the product that the page names anywhere."""
    start = "|".join(FLOORS)
    return re.findall(rf"(?<![\w/])((?:{start})/[\w/]+(?:\.py|/))", PAGE.read_text())


def test_every_room_is_on_the_plan_and_nothing_else() -> None:
    assert listed() == rooms()


def test_every_path_on_the_plan_exists() -> None:
    assert [name for name in paths_named() if not (ROOT / Path(name)).exists()] == []


def test_no_floor_is_crowded_at_its_top() -> None:
    found = []
    for floor in FLOORS:
        entries = [p for p in (ROOT / floor).iterdir() if not p.name.startswith(("_", ".")) and p.name != "py.typed"]
        found += [f"{floor}: an entry too many"] * max(0, len(entries) - ENTRIES)
    assert found == []


def test_tests_mirror_the_rooms() -> None:
    folders = [p for p in (ROOT / "tests").rglob("*") if p.is_dir() and any(p.glob("test_*.py"))]
    inside = [p.relative_to(ROOT / "tests") for p in folders]
    assert [str(p) for p in inside if p.parts and p.parts[0] not in BESIDE_THE_ROOMS and not (ROOT / p).is_dir()] == []


# Functions that fit on a screen, with few arguments. The command line is exempt: its arguments are its options
LINES, ARGUMENTS, FILE_LINES = 80, 8, 700


def below_the_command_line() -> list[Source]:
    return [s for s in sources().values() if not s.name.startswith("mmg_ident.commands")]


def test_no_function_is_longer_than_a_screen() -> None:
    found = [
        f"{source.floor}: {name} has over {LINES} lines"
        for source in below_the_command_line()
        for name, function in source.functions
        if (function.end_lineno or 0) - function.lineno + 1 > LINES
    ]
    assert found == []


def test_no_function_takes_more_than_eight_arguments() -> None:
    found = [
        f"{source.floor}: {name} has over {ARGUMENTS} arguments"
        for source in below_the_command_line()
        for name, function in source.functions
        if len(arguments(function)) > ARGUMENTS
    ]
    assert found == []


def test_no_file_is_long() -> None:
    found = [
        f"{s.floor}: {s.name} has over {FILE_LINES} lines"
        for s in sources().values()
        if s.text.count("\n") > FILE_LINES
    ]
    assert found == []
