"""Long functions are compiled in parts: with the same bits, in little memory, and not in silence."""

from __future__ import annotations

import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.compile import batch_source
from mmg.compile.batch import batch_functions
from mmg.compile.cache import UNIT, compiler
from mmg.model import assemble
from mmg.ship import Ship

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

PODS = """[ship]
name = "four pods"
L = 33.9
B = 9.6
d = 2.7
m = 543790.0
x_G = 0.0
rho = 1025.0
D_az = 1.9
x_az = -16.0
y_az = 2.7
x_az_2 = -16.0
y_az_2 = -2.7
x_az_3 = 14.0
y_az_3 = 2.0
x_az_4 = 14.0
y_az_4 = -2.0

[model]
hull = "unified"
azimuth = "azimuth"
"""


def ship_of_four_pods(folder: Path) -> Ship:
    file = folder / "pods.toml"
    file.write_text(PODS)
    return load_ship(file)


def derivatives(ship: Ship) -> list[ca.Function]:
    """Rates, their Jacobian, and the gradient of a sum of all second derivatives by the state."""
    model = assemble(ship)
    q, c, theta = (ca.SX.sym(name, model.rates.size1_in(i)) for i, name in enumerate("qcp"))
    k = model.rates(q, c, theta)
    J = ca.jacobian(k, ca.vertcat(q, theta))
    total = ca.gradient(ca.sum1(ca.vertcat(*J.nonzeros())), ca.vertcat(q, theta))
    each = (("rates", k), ("jacobian", J), ("second", total))
    return [ca.Function(name, [q, c, theta], [value], {"cse": True}) for name, value in each]


def test_a_function_in_parts_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ship = load_ship("mariner")
    functions, rng, theta, found = derivatives(ship), np.random.default_rng(0), ship.values, []
    inputs = [0.1 * rng.standard_normal((functions[0].nnz_in(j), 24)) for j in range(2)]
    for size in (10**6, 150):
        monkeypatch.setattr(batch_source, "UNIT_SIZE", size)
        monkeypatch.setenv("MMG_CACHE", str(tmp_path / str(size)))
        batches, reason = batch_functions(functions)
        assert not reason
        found.append([part for f in batches for part in f(*inputs, theta)])
    for whole, parts in zip(*found, strict=True):
        np.testing.assert_array_equal(whole, parts)


def test_no_unit_has_more_instructions_than_a_compiler_likes(tmp_path: Path) -> None:
    functions = derivatives(ship_of_four_pods(tmp_path))
    counts = [f.n_instructions() for f in functions]
    assert max(counts) > 2 * batch_source.UNIT_SIZE
    units = batch_source.source(functions).split(UNIT)
    instruction = re.compile(r"^ *(w\d+ = |w\[\d+\] = (?!w\d+;)|OUT\()", re.MULTILINE)
    own = [len(instruction.findall(unit)) for unit in units]
    assert len(units) > 2 and max(own) <= batch_source.UNIT_SIZE
    assert sum(own) == sum(counts)


def test_compiling_in_units_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(batch_source, "UNIT_SIZE", 50)
    monkeypatch.setenv("MMG_CACHE", str(tmp_path))
    functions = derivatives(load_ship("mariner"))[:1]
    units = len(batch_source.source(functions).split(UNIT))
    for said in (1, 0):  # from the cache in silence
        caplog.clear()
        with caplog.at_level(logging.INFO):
            batch_functions(functions)
        assert len([r for r in caplog.records if "compiling" in r.message and f"{units} files" in r.message]) == said


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss in kilobytes")
def test_a_compiler_of_four_pods_takes_less_than_half_a_gigabyte(tmp_path: Path) -> None:
    code = (
        "import pathlib, resource; from tests.mmg.compile.test_units import *;"
        "_, reason = batch_functions(derivatives(ship_of_four_pods(pathlib.Path(sys.argv[1]))));"
        "print(reason or resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )  # in a process of its own, which has had no other children
    environment = {**os.environ, "MMG_CACHE": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert 0 < float(done.stdout) < 500e3
