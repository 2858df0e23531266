"""Every public function says what it takes, what it returns and what it raises."""

from __future__ import annotations

import ast
import re

from mmg.errors import UserError
from tests.architecture.source import Function, Source, arguments, mentions, sources

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


def unnamed_arguments() -> list[str]:
    return [
        f"{source.floor}: {source.name}.{function.name}({argument.arg})"
        for source, function in public_functions()
        for argument in arguments(function)
        if not has_help(argument) and not mentions(ast.get_docstring(function) or "", argument.arg)
    ]


def returns_something(function: Function) -> bool:
    return function.returns is not None and ast.unparse(function.returns) not in ("None", "NoReturn")


def silent_about_return() -> list[str]:
    found = []
    for source, function in public_functions():
        text = ast.get_docstring(function) or ""
        order = re.match(r"\W*(\w+)", text)
        says = re.search(r"\b([Rr]eturns?|[Gg]ives?|[Yy]ields?)\b", text) or (order and order[1].lower() not in VERBS)
        if returns_something(function) and not says and not any(has_help(a) for a in arguments(function)):
            found.append(f"{source.floor}: {source.name}.{function.name}")
    return found


KINDS = {kind.__name__ for kind in UserError.__subclasses__() if kind.__module__ == UserError.__module__}
"""Names of the kinds of errors that users meet: those of one module, whatever else was imported before."""


def own_raises(function: Function) -> set[str]:
    """Names of the errors that the function itself raises; those of users by their common class."""
    raised = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            raised.add("UserError" if node.exc.func.id in KINDS else node.exc.func.id)
    return raised & {"UserError", "ValueError", "KeyError", "TypeError"}


def silent_about_errors() -> list[str]:
    return [
        f"{source.floor}: {source.name}.{function.name} raises {error}"
        for source, function in public_functions()
        for error in sorted(own_raises(function))
        if not mentions(ast.get_docstring(function) or "", error) and not any(has_help(a) for a in arguments(function))
    ]


def arrays_without_shape() -> list[str]:
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
    return found


def undocumented_classes() -> list[str]:
    return [
        f"{source.floor}: {node.name}"
        for source in sources().values()
        for node in source.tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and not ast.get_docstring(node)
    ]


def test_every_argument_of_a_public_function_is_named_in_its_docstring() -> None:
    assert unnamed_arguments() == []


def test_every_public_function_says_what_it_returns() -> None:
    assert silent_about_return() == []


def test_every_public_function_says_what_it_raises() -> None:
    assert silent_about_errors() == []


def test_every_public_function_of_arrays_gives_their_shapes() -> None:
    assert arrays_without_shape() == []


def test_every_public_class_has_a_docstring() -> None:
    assert undocumented_classes() == []
