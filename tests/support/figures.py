"""Run folders whose figures are not drawn, which takes a tenth of a second each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

PNG = b"\x89PNG\r\n\x1a\n"


@contextmanager
def unrendered() -> Iterator[None]:
    """Within it, a figure is a file with the first bytes of a PNG, and nothing is drawn."""
    with pytest.MonkeyPatch.context() as patched:
        for module in ("plot_style", "imo_form"):
            patched.setattr(f"fitting.report.{module}.png_of", lambda draw: PNG)
        yield
