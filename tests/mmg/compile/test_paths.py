"""Paths gone along in C against numpy, of a small made-up system with memory, inputs and a force."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from mmg.compile import paths as along
from mmg.compile.batch import BatchFunction, batch_functions
from mmg.compile.paths import Entries, WindowPaths

S, C, ALL = 4, 2, 7
FORCE = np.array([4, 5, 6])


@pytest.fixture(scope="module")
def functions() -> dict[str, BatchFunction]:
    """Rates, their Jacobian by states and coefficients, what is logged, and weighted second derivatives."""
    q, c, p = ca.SX.sym("q", S), ca.SX.sym("c", C), ca.SX.sym("p", ALL)
    rates = ca.vertcat(
        q[1] + p[4],
        -p[0] * ca.sin(q[0]) * q[1] + c[0] + p[5] * q[2],
        p[1] * ca.tanh(q[1]) - q[2] + p[6] * c[1],
        (q[1] - q[3]) / (1 + p[2] ** 2),
    )
    logged = ca.vertcat(q[0] * p[3], q[1] + q[3], ca.cos(q[0]), q[2], q[3] ** 2, p[3] * q[1])
    J, H = ca.jacobian(rates, ca.vertcat(q, p)), ca.jacobian(logged, ca.vertcat(q, p))
    B, E = ca.jacobian(rates, ca.vertcat(q, p[4:])), ca.jacobian(logged, q)
    wb, we = ca.SX.sym("wb", B.nnz()), ca.SX.sym("we", E.nnz())
    second = [ca.densify(ca.gradient(ca.dot(w, M.nz[:]), p)) for w, M in ((wb, B), (we, E))]
    made = [
        ca.Function("rates", [q, c, p], [rates]),
        ca.Function("jacobian", [q, c, p], [rates, J]),
        ca.Function("logged_jacobian", [q, p], [logged, H]),
        ca.Function("of_rates", [q, c, p, wb], [second[0]]),
        ca.Function("of_logged", [q, p, we], [second[1]]),
    ]
    batch, why = batch_functions(made)
    if why:
        pytest.skip(why)
    return {f.name(): b for f, b in zip(made, batch, strict=True)}


def at(function: BatchFunction, output: int) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = (np.array(a, dtype=int) for a in function.function.sparsity_out(output).get_triplet())
    return rows, columns


def paths(K: int, R: int, changes: bool, by_window: bool, force: bool) -> WindowPaths:
    rng = np.random.default_rng(10 * K + R)
    theta = rng.random((ALL, R) if by_window else ALL)
    inputs = rng.standard_normal((K, R, 2 * C if changes else C))
    push = rng.standard_normal((K, R, 3)) if force else None
    return WindowPaths(rng.standard_normal((K + 1, R, S)), inputs, theta, 0.1, C, push, FORCE)


CASES = pytest.mark.parametrize(
    "given",
    [(11, 3, True, True, True), (8, 9, False, False, True), (1, 1, True, False, False), (17, 2, False, True, False)],
    ids=["changes, by window", "held", "one step", "no force"],
)


@CASES
def test_steps_and_their_derivatives(
    functions: dict[str, BatchFunction], given: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    active, chosen = np.array([0, 1, 2]), np.array([0, 1, 4, 5, 6])  # nothing depends on the fourth state
    row, column = np.full(S, -1), np.full(S + ALL, -1)
    row[active] = column[active] = np.arange(3)
    column[S + chosen] = 3 + np.arange(5)
    wanted = Entries.chosen(at(functions["jacobian"], 1), row, column)
    rest = (functions["jacobian"], wanted, 3, np.array([3, 4, 3]), np.array([5, 6, 7]))
    found = along.steps(paths(*given), *rest)
    monkeypatch.setattr(along, "path_code", lambda: None)
    for a, b in zip(found, along.steps(paths(*given), *rest), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


@CASES
def test_the_derivatives_of_what_is_logged_are_those_of_differences(
    functions: dict[str, BatchFunction], given: tuple
) -> None:
    here, kernel = paths(*given), functions["logged_jacobian"]
    column = np.array([0, 1, -1, 2, -1, -1, -1, 3, -1, -1, -1])  # three states, and the fourth coefficient
    wanted = Entries.chosen(at(kernel, 1), np.arange(6), column)
    y, H, D = along.logged(here, kernel, wanted, 3, 1)
    e, ahead, more = 1e-6, here.z.copy(), np.array(here.theta)
    ahead[..., 3] += e
    more[3] += e
    moved = [along.logged(way, kernel, wanted, 3, 1)[0] for way in (replace(here, z=ahead), replace(here, theta=more))]
    for found, expected in ((H[..., 2], moved[0]), (D[..., 0], moved[1])):
        np.testing.assert_allclose(found, (expected - y) / e, atol=1e-5)
    assert D.any()


@CASES
@pytest.mark.parametrize("name", ["of_rates", "of_logged"])
def test_weighted_second_derivatives_are_sums_by_window(
    functions: dict[str, BatchFunction], given: tuple, name: str
) -> None:
    here, of_rates = paths(*given), name == "of_rates"
    count = functions[name].function.numel_in(3 if of_rates else 2)
    rng = np.random.default_rng(1)
    weight = rng.standard_normal((len(here.z) - of_rates, here.z.shape[1], 3, count))
    source = rng.permutation(3 * count)[:count]
    whole = along.weighted(here, functions[name], of_rates, weight, source)
    source[0] = -1
    part = along.weighted(here, functions[name], of_rates, weight, source)
    assert whole.shape == (here.z.shape[1], functions[name].function.nnz_out(0)) and np.abs(whole - part).max() > 0


@CASES
def test_paths_simulated_in_part_or_whole(
    functions: dict[str, BatchFunction], given: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = paths(*given)
    K, R = here.inputs.shape[:2]
    carried, whole = np.array([False, False, True, True]), np.random.default_rng(2).random((K, R)) < 0.5
    for marks in (whole, np.zeros((K, R), dtype=bool)):
        found = along.follow(here, functions["rates"], carried, marks)
        with monkeypatch.context() as without:
            without.setattr(along, "path_code", lambda: None)
            expected = along.follow(here, functions["rates"], carried, marks)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
        assert np.array_equal(found[1:][~marks][:, :2], here.z[1:][~marks][:, :2]), "given states were overwritten"


def test_steps_that_do_not_exist_are_left_out(functions: dict[str, BatchFunction]) -> None:
    here, count = paths(11, 3, True, True, True), np.array([11, 0, 6])
    row, column = np.array([0, 1, 2, -1]), np.full(S + ALL, -1)
    column[[0, 1, 2, S, S + 1, S + 4, S + 5, S + 6]] = np.arange(8)
    wanted = Entries.chosen(at(functions["jacobian"], 1), row, column)
    rest = functions["jacobian"], wanted, 3, np.array([3, 4, 3]), np.array([5, 6, 7])
    for whole, part in zip(along.steps(here, *rest), along.steps(replace(here, count=count), *rest), strict=True):
        exist = np.arange(len(whole))[:, None] < count
        np.testing.assert_array_equal(part[exist], whole[exist])
        assert not part[~exist].any() and np.isfinite(part).all()
