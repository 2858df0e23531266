"""Of many like cases one in the default run, the others in the slow one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first_quick(cases: Iterable[Any]) -> list[Any]:
    """The first of the ``cases``, and the others for the slow run."""
    first, *others = cases
    mark = pytest.mark.slow
    return [first, *(pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=mark) for case in others)]
