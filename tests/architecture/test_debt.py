"""What is known to break a rule of this folder may only become less."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Callable, Iterable

from tests.architecture import test_docstrings, test_floor_plan, test_imports, test_sizes, test_words
from tests.architecture.source import BESIDE, DEBT, FLOORS, by_floor, sources


def underscore_names() -> list[str]:
    both = [s for group in (FLOORS, BESIDE) for s in sources(group).values()]
    return [f"{s.floor}: {x}" for s in both for x in test_imports.borrowed(s)]


RULES: dict[str, Callable[[], Iterable[str]]] = {
    "upward import": test_imports.upward,
    "circle": test_imports.circles,
    "underscore name": underscore_names,
    "long function": test_sizes.long_functions,
    "many arguments": test_sizes.wide_functions,
    "long file": test_sizes.long_files,
    "unnamed argument": test_docstrings.unnamed_arguments,
    "silent about return": test_docstrings.silent_about_return,
    "silent about errors": test_docstrings.silent_about_errors,
    "array without shape": test_docstrings.arrays_without_shape,
    "class without docstring": test_docstrings.undocumented_classes,
    "class name used twice": test_words.shared_class_names,
    "text that is not shipped": test_words.references_elsewhere,
    "private word": test_words.private_names,
    "crowded floor": test_floor_plan.crowded,
}


def present(rules: Iterable[str] = RULES) -> dict[str, Counter[str]]:
    """Violations of these rules as they stand."""
    found = {rule: by_floor(RULES[rule]()) for rule in rules}
    return {rule: entries for rule, entries in found.items() if entries}


def test_debt_that_is_paid_is_no_longer_listed() -> None:
    listed = {rule: Counter(entries) for rule, entries in json.loads(DEBT.read_text()).items()}
    now = present(listed)
    paid = {rule: dict(entries - now.get(rule, Counter())) for rule, entries in listed.items()}
    assert not {rule: entries for rule, entries in paid.items() if entries}


if __name__ == "__main__":  # python -m tests.architecture.test_debt: count what is left
    left = {rule: dict(sorted(entries.items())) for rule, entries in present().items()}
    if "--write" in sys.argv:
        DEBT.write_text(json.dumps(left, indent=1) + "\n")
    print({rule: sum(entries.values()) for rule, entries in left.items()})
