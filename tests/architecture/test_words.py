"""One meaning per class name, words of the field in names, no reference to texts that do not ship, and docstrings that
say what a public function takes, returns and raises."""

from __future__ import annotations

import ast
import re
from collections import Counter

from mmg.errors import UserError
from tests.architecture.source import BESIDE, FLOORS, ROOT, Function, Source, arguments, mentions, sources

ELSEWHERE = re.compile(
    r"\bthe contract\b|\bthe house\b|\bphysics(?:\.md|,? (?:section )?[A-Z]\.?\d)|\bpaper 0\d\d\b|\bmethod_gap\b"
    r"|rooms\.md|house\.md|(?<![\w.])/work/|/tmp/wt"
)
"""References to texts that a reader of the package does not have."""

PRIVATE = """told wide seen bend asked begun sides look_around recipe executes reached facts hum echo placed
in_tank odd"""
"""Names that once had a meaning inside this project only."""
PRIVATE_WORDS = set(PRIVATE.split())


PROSE = re.compile(r"(?<![\w.'/-])[A-Za-z']{2,},? [a-z'-]{2,},? [a-z'-]{2,}\b")
"""Three words of a sentence. Not those of code, of file names and of options."""
GOLDEN = {
    "test_page_stands_alone",
    "test_all_of_a_run_is_in_the_page",
    "test_the_page_has_the_form_the_limits_and_the_advice",
}
"""Tests that read a whole page: of a diagnosis, of a calibration, of the form for IMO."""


def compared(node: ast.AST) -> list[ast.expr]:
    """What a ``node`` compares, loops over or takes as ``match=``."""
    if isinstance(node, ast.Compare):
        return [node.left, *node.comparators]
    if isinstance(node, ast.For | ast.comprehension):
        return [node.iter]
    return [node.value] if isinstance(node, ast.keyword) and node.arg == "match" else []


def test_no_two_classes_share_a_name() -> None:
    count = Counter(n.name for s in sources().values() for n in s.nodes if isinstance(n, ast.ClassDef))
    assert sorted(f"product: {name}" for name, times in count.items() if times > 1) == []


def test_no_text_refers_to_one_that_is_not_shipped() -> None:
    here = ROOT / "tests" / "architecture"
    texts = [s for group in (FLOORS, BESIDE) for s in sources(group).values() if here not in s.path.parents]
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md"), *(ROOT / "benchmarks").glob("*.md")]
    files = [(s.path, s.text) for s in texts] + [(p, p.read_text()) for p in pages]
    found = [
        f"{path.relative_to(ROOT).parts[0]}: {match[0]}" for path, text in files for match in ELSEWHERE.finditer(text)
    ]
    assert found == []


def test_tests_compare_codes_and_no_prose() -> None:
    """Tests that compare sentences: what they need are codes, names, options and numbers."""
    found = []
    for source in sources(("tests",)).values():
        functions = source.functions if not source.name.startswith("tests.cases") else []  # those are being replaced
        for name, function in functions:
            parts = [part for node in ast.walk(function) for part in compared(node)]
            texts = [str(n.value) for part in parts for n in ast.walk(part) if isinstance(n, ast.Constant)]
            if name.startswith("test_") and name not in GOLDEN and any(map(PROSE.search, texts)):
                found.append(f"{source.name}.{name}")
    assert found == []


def test_names_are_words_of_the_field() -> None:
    """Modules, classes and arguments that carry a private word as their whole name."""
    found = []
    for source in sources().values():
        names = [source.name.split(".")[-1], *(n.name for n in source.nodes if isinstance(n, ast.ClassDef))]
        for name, function in source.functions:
            names += [name.split(".")[-1], *(a.arg for a in arguments(function))]
        found += [f"{source.floor}: {n}" for n in names if n.strip("_").lower() in PRIVATE_WORDS]
    assert found == []


# Docstrings of public functions
ORDERS = """
add adds append apply ask attach bring build calibrate call check choose collect compile complete compute
copy create cut decide describe diagnose differentiate draw drop emit estimate evaluate export fill filter
find fit free generate give integrate interpolate join judge keep let list load make map mark measure merge
move open parse plot predict prepare print project put read refit remove rename repeat replace run
sample save say scale score search select show simulate smooth solve sort start stop store take tell
train turn update use validate warn weigh write
"""
"""First words of docstrings that give an order: what comes back is then to be said in words of its own."""
VERBS = set(ORDERS.split())


def public_functions() -> list[tuple[Source, Function]]:
    """Functions without underscore at the top of a module; the verbs' own are documented by their options' help."""
    return [
        (source, node)
        for source in sources().values()
        for node in source.tree.body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("_")
        and not any(part.startswith("_") for part in source.name.split("."))
    ]  # fmt: skip


def has_help(argument: ast.arg) -> bool:
    """Whether an option of the command line carries its own help, or is one that several verbs share."""
    words = ast.unparse(argument.annotation) if argument.annotation else ""
    return "help=" in words or words.startswith("o.")  # mmg_ident.commands.options


def returns_something(function: Function) -> bool:
    return function.returns is not None and ast.unparse(function.returns) not in ("None", "NoReturn")


KINDS = {kind.__name__ for kind in UserError.__subclasses__() if kind.__module__ == UserError.__module__}
"""Names of the kinds of errors that users meet: those of one module, whatever else was imported before."""


def own_raises(function: Function) -> set[str]:
    """Names of the errors that the function itself raises; those of users by their common class."""
    raised = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            raised.add("UserError" if node.exc.func.id in KINDS else node.exc.func.id)
    return raised & {"UserError", "ValueError", "KeyError", "TypeError"}


def test_every_argument_of_a_public_function_is_named_in_its_docstring() -> None:
    found = [
        f"{source.floor}: {source.name}.{function.name}({argument.arg})"
        for source, function in public_functions()
        for argument in arguments(function)
        if not has_help(argument) and not mentions(ast.get_docstring(function) or "", argument.arg)
    ]
    assert found == []


def test_every_public_function_says_what_it_returns() -> None:
    found = []
    for source, function in public_functions():
        text = ast.get_docstring(function) or ""
        order = re.match(r"\W*(\w+)", text)
        says = re.search(r"\b([Rr]eturns?|[Gg]ives?|[Yy]ields?)\b", text) or (order and order[1].lower() not in VERBS)
        if returns_something(function) and not says and not any(has_help(a) for a in arguments(function)):
            found.append(f"{source.floor}: {source.name}.{function.name}")
    assert found == []


def test_every_public_function_says_what_it_raises() -> None:
    found = [
        f"{source.floor}: {source.name}.{function.name} raises {error}"
        for source, function in public_functions()
        for error in sorted(own_raises(function))
        if not mentions(ast.get_docstring(function) or "", error) and not any(has_help(a) for a in arguments(function))
    ]
    assert found == []


def test_every_public_function_of_arrays_gives_their_shapes() -> None:
    """Functions that take or return arrays and give no shape, such as (N, 6), anywhere in their docstring."""
    found = []
    for source, function in public_functions():
        notes = [ast.unparse(a.annotation) for a in arguments(function) if a.annotation]
        notes += [ast.unparse(function.returns)] if function.returns else []
        text = ast.get_docstring(function) or ""
        if any(re.search(r"ndarray|NDArray|Array\b|Tensor", n) for n in notes) and not re.search(
            r"\((\.\.\.|[A-Za-z0-9_ +*-]+),[^()]*\)|\((?:[A-Z]|\d+)\)", text
        ):
            found.append(f"{source.floor}: {source.name}.{function.name}")
    assert found == []


def test_every_public_class_has_a_docstring() -> None:
    found = [
        f"{source.floor}: {node.name}"
        for source in sources().values()
        for node in source.tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and not ast.get_docstring(node)
    ]
    assert found == []
