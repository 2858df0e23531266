"""The result of a training: nothing of it needs torch before a network is trained."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["residual.result", "residual.settings", "residual.report.page", "fitting.pipeline"])
def test_reading_and_calibrating_need_no_torch(module: str) -> None:
    code = f"import sys, {module}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
