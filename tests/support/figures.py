"""Run folders whose figures are composed and not rendered, which takes half a second each."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def unrendered() -> Iterator[None]:
    """Within it, a figure that is saved is a file with the first bytes of a PNG."""

    def write(_: object, target: object, **options: object) -> None:
        content = b"\x89PNG\r\n\x1a\n"
        if isinstance(target, io.BytesIO):
            target.write(content)
        else:
            Path(str(target)).write_bytes(content)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("matplotlib.figure.Figure.savefig", write)
        yield
