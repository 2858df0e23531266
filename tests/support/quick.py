"""Of many like cases one in a shorter run, the others in a longer one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first_quick(cases: Iterable[Any], mark: pytest.MarkDecorator = pytest.mark.slow) -> list[Any]:
    """The first of the ``cases``, and the others with a ``mark``: "slow" or, for those that are slow themselves,
    "longest"."""
    first, *others = cases
    return [first, *(pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=mark) for case in others)]
