"""Run folders whose figures are composed and not rendered, which takes half a second each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def unrendered() -> Iterator[None]:
    """Within it, a figure that is saved is a file with the first bytes of a PNG."""

    def write(_: object, target: object, **options: object) -> None:
        Path(str(target)).write_bytes(b"\x89PNG\r\n\x1a\n")

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("matplotlib.figure.Figure.savefig", write)
        yield
