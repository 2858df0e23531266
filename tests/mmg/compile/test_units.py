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
from mmg.compile import batch, cache, stages
from mmg.compile.batch import batch_functions
from mmg.compile.cache import UNIT, compiler
from mmg.model import assemble
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def derivatives(ship: Ship) -> list[ca.Function]:
    """Rates, their Jacobian, and the gradient of a sum of all second derivatives by the state."""
    model = assemble(ship)
    q, c, theta = (ca.SX.sym(name, model.rates.size1_in(i)) for i, name in enumerate("qcp"))
    k = model.rates(q, c, theta)
    J = ca.jacobian(k, ca.vertcat(q, theta))
    total = ca.gradient(ca.sum1(ca.vertcat(*J.nonzeros())), ca.vertcat(q, theta))
    each = (("rates", k), ("jacobian", J), ("second", total))
    return [ca.Function(name, [q, c, theta], [value], {"cse": True}) for name, value in each]


@pytest.mark.slow
def test_a_function_in_parts_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ship = load_ship("mariner")
    functions, rng, theta, found = derivatives(ship), np.random.default_rng(0), ship.values, []
    inputs = [0.1 * rng.standard_normal((functions[0].nnz_in(j), 24)) for j in range(2)]
    for size in (10**6, 150):
        monkeypatch.setattr(stages, "FUNCTION_SIZE", size)
        monkeypatch.setenv("MMG_CACHE", str(tmp_path / str(size)))
        batches, reason = batch_functions(functions)
        assert not reason
        found.append([part for f in batches for part in f(*inputs, theta)])
    for whole, parts in zip(*found, strict=True):
        np.testing.assert_array_equal(whole, parts)


@pytest.mark.slow
def test_no_function_has_more_instructions_than_a_compiler_likes() -> None:
    functions = derivatives(true_ship("pods"))
    assert max(f.n_instructions() for f in functions) > 2 * stages.FUNCTION_SIZE
    units = batch.source(functions).split(UNIT)
    parts = [part for unit in units for part in unit.split("HIDDEN void ")[1:] if "{" in part]
    operation = re.compile(r"^ *const V a\d+ = (?!x\d|fill\(|\(M \+)", re.MULTILINE)
    constants = re.compile(r"^ *const V a\d+ = -?a\d+;", re.MULTILINE)
    sizes = [len(operation.findall(part)) - len(constants.findall(part)) for part in parts]
    assert len(units) > 2 and 0 < max(sizes) <= stages.FUNCTION_SIZE
    assert max(len(unit) for unit in units[1:]) < 2 * stages.UNIT_TEXT


@pytest.mark.slow
def test_one_line_says_what_is_compiled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("MMG_CACHE", str(tmp_path))
    rates, jacobian, _ = derivatives(load_ship("mariner"))
    # the first of a process, a second one, and the first one of another process from the cache
    for said, function, anew in ((1, rates, True), (0, jacobian, False), (0, rates, True)):
        caplog.clear()
        if anew:
            monkeypatch.setattr(cache, "announced", [])
        with caplog.at_level(logging.INFO):
            batch_functions([function], True, "the mariner")
        lines = [r.message for r in caplog.records if "compiling" in r.message]
        assert len(lines) == said and all(str(tmp_path) in line for line in lines)


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss in kilobytes")
def test_a_compiler_of_four_pods_takes_less_than_half_a_gigabyte(tmp_path: Path) -> None:
    code = (
        "import resource; from tests.mmg.compile.test_units import *;"
        "from fitting.nlp.shooting import Kernels;"
        "model = assemble(true_ship('pods'));"
        "reason = Kernels(model, np.arange(len(model.symbols))).interpreted_because;"
        "print(reason or resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )  # in a process of its own, which has had no other children
    environment = {**os.environ, "MMG_CACHE": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert 0 < float(done.stdout) < 200e3
