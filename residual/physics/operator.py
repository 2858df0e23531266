"""The equations of a ship as torch operators with exact gradients, made from its one CasADi expression.

On a processor an operator is a pair of C functions (forward, and the product of a vector with the Jacobian), eight
points per vector; without a compiler CasADi's virtual machine runs both. Tensors are (rows, M), points contiguous, M
best a multiple of 8: they are then handed over without a copy. Gradients are those of CasADi; there are no second
derivatives.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any

import casadi as ca
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from mmg.compile.batch import batch_functions, padded
from mmg.model import assemble, states_behind
from mmg.ship import Ship


class _Kernel:
    """An SXFunction with dense outputs on tensors, without gradients.

    Inputs are (rows, M), or (rows, 1) for all points, of any floating type; it computes in float64.
    """

    def __init__(self, function: ca.Function, compiled: bool) -> None:
        (self.batch,), self.interpreted_because = batch_functions([function], compiled)
        self.rows = [function.nnz_out(j) for j in range(function.n_out())]
        self.rows_in = [function.nnz_in(i) for i in range(function.n_in())]
        library, n_in = self.batch.library, function.n_in()
        self.code = getattr(library, function.name()) if library else None
        self._pointers, self._strides = ctypes.c_void_p * n_in, ctypes.c_longlong * n_in
        self._results = ctypes.c_void_p * len(self.rows)

    def __call__(self, inputs: Sequence[Tensor]) -> list[Tensor]:
        """Outputs (rows, M), float64."""
        M = max(a.shape[-1] for a in inputs)
        points = padded(M)
        given = [_laid_out(a, rows, M, points) for a, rows in zip(inputs, self.rows_in, strict=True)]
        if self.code is None:
            arrays = [a.numpy() if a.shape[1] == points else a.numpy()[:, 0] for a in given]
            results = [torch.from_numpy(a) for a in self.batch(*arrays) if a is not None]
        else:
            results = [torch.empty((rows, points), dtype=torch.float64) for rows in self.rows]
            self.code(
                ctypes.c_longlong(points),
                self._pointers(*[a.data_ptr() for a in given]),
                self._strides(*[points if a.shape[1] == points else 0 for a in given]),
                self._results(*[a.data_ptr() for a in results]),
            )
        return results if points == M else [a[:, :M].contiguous() for a in results]


def _laid_out(a: Tensor, rows: int, M: int, points: int) -> Tensor:
    """The input as contiguous float64 (rows, points), the last point repeated, or (rows, 1) for all points."""
    if a.shape not in ((rows, M), (rows, 1)) or not a.is_cpu:
        raise ValueError(
            f"tensor {tuple(a.shape)} on {a.device}; needed: ({rows}, {M}) or ({rows}, 1) on the processor"
        )
    a = a.detach()
    if a.dtype != torch.float64:
        a = a.double()
    if a.shape[1] == points or a.shape[1] == 1 < M:
        return a if a.is_contiguous() else a.contiguous()
    return torch.cat([a, a[:, -1:].expand(-1, points - a.shape[1])], dim=1)


class Operator:
    """An SXFunction of columns as a torch operator: forward and reverse as compiled code, made when first used.

    Call it with tensors (rows, M), or (rows, 1) for all points (these have no gradient). Outputs come in the
    type of the first input, gradients in that of theirs.
    """

    def __init__(self, function: ca.Function, compiled: bool = True) -> None:
        self.function = dense(function)
        self.compiled = compiled
        self._reverse: dict[tuple[int, ...], _Kernel] = {}

    @cached_property
    def forward(self) -> _Kernel:
        """The function itself."""
        return _Kernel(self.function, self.compiled)

    def adjoint(self, wanted: tuple[int, ...]) -> ca.Function:
        """(inputs, one seed (rows,) per output) -> products of the seeds with the Jacobians by the wanted inputs."""
        f = self.function
        inputs, seeds = f.sx_in(), [ca.SX.sym(f"seed{j}", f.nnz_out(j)) for j in range(f.n_out())]
        chosen = ca.vertcat(*[inputs[i] for i in wanted])
        products = ca.jtimes(ca.vertcat(*f.call(inputs)), chosen, ca.vertcat(*seeds), True)
        ends = [0, *accumulate(f.nnz_in(i) for i in wanted)]
        return dense(ca.Function(f"{f.name()}_reverse", [*inputs, *seeds], ca.vertsplit(products, ends)))

    def reverse(self, wanted: tuple[int, ...]) -> _Kernel:
        """``adjoint`` on tensors."""
        if wanted not in self._reverse:
            self._reverse[wanted] = _Kernel(self.adjoint(wanted), self.compiled)
        return self._reverse[wanted]

    def __call__(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        return _Apply.apply(self, *inputs)


def dense(function: ca.Function) -> ca.Function:
    """The same ``function`` with dense outputs and common parts computed once."""
    inputs = function.sx_in()
    outputs = ca.cse([ca.densify(e) for e in function.call(inputs)])
    return ca.Function(function.name(), inputs, outputs, {"cse": True})


class _Apply(torch.autograd.Function):
    """One call of an Operator in torch's graph."""

    @staticmethod
    def forward(ctx: Any, operator: Operator, *inputs: Tensor) -> tuple[Tensor, ...]:
        ctx.operator = operator
        ctx.save_for_backward(*inputs)
        return tuple(a.to(inputs[0].dtype) for a in operator.forward(inputs))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *seeds: Tensor) -> tuple[Any, ...]:
        inputs, needed = ctx.saved_tensors, ctx.needs_input_grad[1:]
        wanted = tuple(i for i, need in enumerate(needed) if need)
        products = iter(ctx.operator.reverse(wanted)((*inputs, *seeds)))
        return None, *[next(products).to(a.dtype) if need else None for a, need in zip(inputs, needed, strict=True)]


class Physics:
    """The right-hand side of a ship, with its network if it has one, in torch.

    States z are (S, M), inputs (C, M), logged columns (6, M), SI; features (F, M) are what a network on this ship sees,
    rows ``ship.features``; accelerations that it adds to the rates of u, v, r (3, M). Gradients go to all of them. It
    computes in float64 on the processor whatever the type of the tensors.
    """

    def __init__(self, ship: Ship, compiled: bool = True) -> None:
        self.ship, self.model = ship, assemble(ship, ())
        self._compiled = compiled
        self._made: dict[str, Callable[..., tuple[Tensor, ...]]] = {}

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """What it computes, by name, as functions of columns."""
        S, C = len(self.model.states), len(self.model.controls)
        z, c, a, h = ca.SX.sym("z", S), ca.SX.sym("c", C), ca.SX.sym("a", 3), ca.SX.sym("h")
        base = ca.SX.sym("base", S)
        rates, features = self.model.rates(z, c, []), self.model.features(z, c, [])
        advanced = base + h * (rates + ca.vertcat(ca.SX(3, 1), a, ca.SX(S - 6, 1)))
        table = {
            "rates": ([z, c], [rates]),
            "features": ([z, c], [features]),
            "rates_and_features": ([z, c], [rates, features]),
            "columns": ([z], [self.model.columns(z, [])]),
            "advance": ([base, z, a, c, h], [advanced]),
        }
        return {name: ca.Function(f"physics_{name}", *both) for name, both in table.items()}

    def make(self, name: str) -> Callable[..., tuple[Tensor, ...]]:
        """One of ``functions`` as a callable on tensors: an operator of compiled code."""
        return Operator(self.functions[name], self._compiled)

    def call(self, name: str, *inputs: Tensor) -> tuple[Tensor, ...]:
        """The outputs of one of ``functions`` at inputs (rows, M), or (rows, 1) for all points."""
        if name not in self._made:
            self._made[name] = self.make(name)
        return self._made[name](*inputs)

    def rates(self, z: Tensor, controls: Tensor) -> Tensor:
        """d state / dt (S, M)."""
        return self.call("rates", z, controls)[0]

    def features(self, z: Tensor, controls: Tensor) -> Tensor:
        """What a network on this ship sees, (F, M)."""
        return self.call("features", z, controls)[0]

    def logged_features(self, logged: Tensor, controls: Tensor) -> Tensor:
        """What a network on this ship sees at logged columns (6, M) under inputs (C, M), (F, M); without gradient."""
        return self.features(self.start(logged, controls), controls)

    def rates_and_features(self, z: Tensor, controls: Tensor) -> tuple[Tensor, Tensor]:
        """Both at once, (S, M) and (F, M)."""
        rates, features = self.call("rates_and_features", z, controls)
        return rates, features

    def columns(self, z: Tensor) -> Tensor:
        """The six columns as they are logged, (6, M)."""
        return self.call("columns", z)[0] if self.model.measured else z[:6]

    def start(self, logged: Tensor, controls: Tensor) -> Tensor:
        """States (S, M) logged as (6, M) under inputs (C, M), their memory settled; without gradient."""
        six, inputs = (a.detach().cpu().double().numpy() for a in (logged, controls))
        return torch.from_numpy(states_behind(self.model, six, inputs, self.ship.values[:0])).to(logged)
