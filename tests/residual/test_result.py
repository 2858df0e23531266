"""The result of a training: nothing of it needs torch before a network is trained."""

from __future__ import annotations

import subprocess
import sys

MODULES = ("residual.settings", "residual.result", "residual.report.page", "fitting.calibrate")


def test_reading_and_calibrating_need_no_torch() -> None:
    lines = [f"import {module}; assert 'torch' not in sys.modules, '{module}'" for module in MODULES]
    done = subprocess.run([sys.executable, "-c", "\n".join(["import sys", *lines])], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
