"""One meaning per class name, words of the field in names, and no reference to texts that do not ship."""

from __future__ import annotations

import ast
import re
from collections import Counter

from tests.architecture.source import BESIDE, FLOORS, ROOT, arguments, sources

ELSEWHERE = re.compile(
    r"\bthe contract\b|\bthe house\b|\bphysics(?:\.md|,? (?:section )?[A-Z]\.?\d)|\bpaper 0\d\d\b|\bmethod_gap\b"
    r"|rooms\.md|house\.md|(?<![\w.])/work/|/tmp/wt"
)
"""References to texts that a reader of the package does not have."""

PRIVATE = """told wide seen bend asked begun sides look_around recipe executes reached facts hum echo placed
in_tank odd"""
"""Names that once had a meaning inside this project only."""
PRIVATE_WORDS = set(PRIVATE.split())


def shared_class_names() -> list[str]:
    count = Counter(n.name for s in sources().values() for n in s.nodes if isinstance(n, ast.ClassDef))
    return sorted(f"product: {name}" for name, times in count.items() if times > 1)


def references_elsewhere() -> list[str]:
    here = ROOT / "tests" / "architecture"
    texts = [s for group in (FLOORS, BESIDE) for s in sources(group).values() if here not in s.path.parents]
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md"), *(ROOT / "benchmarks").glob("*.md")]
    files = [(s.path, s.text) for s in texts] + [(p, p.read_text()) for p in pages]
    return [
        f"{path.relative_to(ROOT).parts[0]}: {match[0]}" for path, text in files for match in ELSEWHERE.finditer(text)
    ]


def private_names() -> list[str]:
    """Modules, classes and arguments that carry a private word as their whole name."""
    found = []
    for source in sources().values():
        names = [source.name.split(".")[-1], *(n.name for n in source.nodes if isinstance(n, ast.ClassDef))]
        for name, function in source.functions:
            names += [name.split(".")[-1], *(a.arg for a in arguments(function))]
        found += [f"{source.floor}: {n}" for n in names if n.strip("_").lower() in PRIVATE_WORDS]
    return found


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


def compared_prose() -> list[str]:
    """Tests that compare sentences: what they need are codes, names, options and numbers."""
    found = []
    for source in sources(("tests",)).values():
        functions = source.functions if not source.name.startswith("tests.cases") else []  # those are being replaced
        for name, function in functions:
            parts = [part for node in ast.walk(function) for part in compared(node)]
            texts = [str(n.value) for part in parts for n in ast.walk(part) if isinstance(n, ast.Constant)]
            if name.startswith("test_") and name not in GOLDEN and any(map(PROSE.search, texts)):
                found.append(f"{source.name}.{name}")
    return found


def test_no_two_classes_share_a_name() -> None:
    assert shared_class_names() == []


def test_no_text_refers_to_one_that_is_not_shipped() -> None:
    assert references_elsewhere() == []


def test_tests_compare_codes_and_no_prose() -> None:
    assert compared_prose() == []


def test_names_are_words_of_the_field() -> None:
    assert private_names() == []
