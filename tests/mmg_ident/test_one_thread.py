"""What takes long from Python has one thread of linear algebra in every process, as the commands have."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.support.quick import first_quick
from tests.support.terminal import ROOT

CODE = """
import numpy  # before the package, as in a notebook
from threadpoolctl import threadpool_info, threadpool_limits
import {module} as module
threadpool_limits(2)
seen = []
def count(*args, **kwargs):
    seen.append({{row["num_threads"] for row in threadpool_info()}})
    raise RuntimeError("far enough")
setattr(module, {inner!r}, count)
try:
    module.{entry}(*{arguments})
except RuntimeError:
    pass
assert seen == [{{1}}], seen
assert {{row["num_threads"] for row in threadpool_info()}} == {{2}}
"""


@pytest.mark.parametrize(
    ("module", "entry", "inner", "arguments"),
    first_quick(
        [
            ("fitting.calibration", "estimate_coefficients", "prepared", "(None, [])"),
            ("diagnosis.diagnose", "diagnose", "parted", "(None, [])"),
            ("residual.pipeline", "train", "_start", "(None, [])"),
        ]
    ),
)
def test_one_thread_from_python(module: str, entry: str, inner: str, arguments: str) -> None:
    if module.startswith("residual"):
        pytest.importorskip("torch")
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {k: v for k, v in os.environ.items() if k not in names} | {"PYTHONPATH": str(ROOT)}
    code = CODE.format(module=module, entry=entry, inner=inner, arguments=arguments)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-600:]
