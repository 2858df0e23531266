"""The equations of a ship in torch, from its one CasADi expression: points with gradients, and whole rollouts.

Tensors are (rows, M), points contiguous, M best a multiple of 8: they are then handed over without a copy. Gradients
are those of CasADi; there are no second derivatives. A training spends its time in ``FusedRollout``: seven times less
than in rollouts of single operators (13.6 s and 1.9 s of processor time for two seeds of six epochs on the trials of
``mmg demo``); these are its reference and serve where there is no compiler.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any

import casadi as ca
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from mmg.compile.batch import BatchFunction, batch_functions, padded, source
from mmg.compile.cache import UNIT, load_library
from mmg.model import assemble, states_behind
from mmg.ship import Ship


def _evaluated(batch: BatchFunction, inputs: Sequence[Tensor]) -> list[Tensor]:
    """Outputs (rows, M), float64, of inputs (rows, M), or (rows, 1) for all points; without gradients."""
    M, arrays = max(a.shape[-1] for a in inputs), []
    for i, a in enumerate(inputs):
        rows = batch.function.nnz_in(i)  # nonzeros are rows, as every function here is dense
        if a.shape not in ((rows, M), (rows, 1)):
            raise ValueError(f"tensor {tuple(a.shape)}; needed: ({rows}, {M}) or ({rows}, 1)")
        # ``BatchFunction`` takes a value for all points as a vector
        arrays.append(a.detach().numpy() if a.shape[1] == M else a.detach().numpy()[:, 0])
    return [torch.from_numpy(a).contiguous() for a in batch.at(*arrays)]


class Operator:
    """An SXFunction of columns as a torch operator: forward and reverse as compiled code, made when first used.

    Call it with tensors (rows, M), or (rows, 1) for all points (these have no gradient). Outputs come in the type of
    the first input, gradients in that of theirs.
    """

    def __init__(self, function: ca.Function, compiled: bool = True) -> None:
        self.function, self.compiled = dense(function), compiled
        # by the inputs that need a gradient: code for the others would be compiled and computed for nothing
        self._reverse: dict[tuple[int, ...], BatchFunction] = {}

    @cached_property
    def forward(self) -> BatchFunction:
        """The function itself."""
        return batch_functions([self.function], self.compiled)[0][0]

    def adjoint(self, wanted: tuple[int, ...]) -> ca.Function:
        """(inputs, one seed (rows,) per output) -> products of the seeds with the Jacobians by the wanted inputs."""
        f = self.function
        inputs, seeds = f.sx_in(), [ca.SX.sym(f"seed{j}", f.nnz_out(j)) for j in range(f.n_out())]  # one an output
        chosen = ca.vertcat(*[inputs[i] for i in wanted])
        # one reverse sweep over all outputs costs a few evaluations; Jacobians would cost one sweep an output
        products = ca.jtimes(ca.vertcat(*f.call(inputs)), chosen, ca.vertcat(*seeds), True)
        ends = [0, *accumulate(f.nnz_in(i) for i in wanted)]
        return dense(ca.Function(f"{f.name()}_reverse", [*inputs, *seeds], ca.vertsplit(products, ends)))

    def reverse(self, wanted: tuple[int, ...]) -> BatchFunction:
        """``adjoint`` at many points."""
        if wanted not in self._reverse:
            (self._reverse[wanted],), _ = batch_functions([self.adjoint(wanted)], self.compiled)
        return self._reverse[wanted]

    def __call__(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        return _Apply.apply(self, *inputs)


def dense(function: ca.Function) -> ca.Function:
    """The same ``function`` with dense outputs and common parts computed once."""
    inputs = function.sx_in()
    # densified first: sparse outputs of unlike patterns could not be stacked as rows
    outputs = ca.cse([ca.densify(e) for e in function.call(inputs)])
    return ca.Function(function.name(), inputs, outputs, {"cse": True})


class _Apply(torch.autograd.Function):
    """One call of an Operator in torch's graph."""

    @staticmethod
    def forward(ctx: Any, operator: Operator, *inputs: Tensor) -> tuple[Tensor, ...]:
        ctx.operator = operator
        ctx.save_for_backward(*inputs)  # the points alone: the reverse code evaluates the function anew
        return tuple(a.to(inputs[0].dtype) for a in _evaluated(operator.forward, inputs))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *seeds: Tensor) -> tuple[Any, ...]:
        inputs, needed = ctx.saved_tensors, ctx.needs_input_grad[1:]
        wanted = tuple(i for i, need in enumerate(needed) if need)
        products = iter(_evaluated(ctx.operator.reverse(wanted), (*inputs, *seeds)))
        # one gradient per argument of ``forward``, of which the first, the operator, has none
        return None, *[next(products).to(a.dtype) if need else None for a, need in zip(inputs, needed, strict=True)]


class Physics:
    """The right-hand side of a ship, with its network if it has one, in torch.

    States z are (S, M), inputs (C, M), logged columns (6, M), SI; features (F, M) are what a network on this ship sees,
    rows ``ship.features``; accelerations that it adds to the rates of u, v, r (3, M). Gradients go to all of them. It
    computes in float64 on the processor whatever the type of the tensors. symbols: coefficients whose values are the
    last of the inputs.
    """

    def __init__(self, ship: Ship, compiled: bool = True, symbols: Sequence[str] = ()) -> None:
        self.ship, self.model = ship, assemble(ship, symbols)
        self.inputs = len(self.model.controls) + len(symbols)  # C, with the values of ``symbols`` last
        self._compiled = compiled
        self._operators: dict[str, Operator] = {}

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """What it computes, by name, as functions of columns."""
        S, C = len(self.model.states), len(self.model.controls)
        z, c, a, h = ca.SX.sym("z", S), ca.SX.sym("c", self.inputs), ca.SX.sym("a", 3), ca.SX.sym("h")
        base = ca.SX.sym("base", S)
        rates, features = self.model.rates(z, c[:C], c[C:]), self.model.features(z, c[:C], c[C:])
        # one stage of a Runge-Kutta step: base + h f(z, c), the accelerations a on the rates of u, v, r alone
        advanced = base + h * (rates + ca.vertcat(ca.SX(3, 1), a, ca.SX(S - 6, 1)))
        table = {
            "features": ([z, c], [features]),
            "rates_and_features": ([z, c], [rates, features]),
            "columns": ([z, c], [self.model.columns(z, c[C:])]),
            "advance": ([base, z, a, c, h], [advanced]),
        }
        return {name: ca.Function(f"physics_{name}", *both) for name, both in table.items()}

    def call(self, name: str, *inputs: Tensor) -> tuple[Tensor, ...]:
        """The outputs of one of ``functions`` at inputs (rows, M), or (rows, 1) for all points."""
        if name not in self._operators:
            self._operators[name] = Operator(self.functions[name], self._compiled)
        return self._operators[name](*inputs)

    def rates(self, z: Tensor, controls: Tensor) -> Tensor:
        """d state / dt (S, M)."""
        return self.call("rates_and_features", z, controls)[0]

    def features(self, z: Tensor, controls: Tensor) -> Tensor:
        """What a network on this ship sees, (F, M)."""
        return self.call("features", z, controls)[0]

    def logged_features(self, logged: Tensor, controls: Tensor) -> Tensor:
        """What a network on this ship sees at logged columns (6, M) under inputs (C, M), (F, M); without gradient."""
        return self.features(self.start(logged, controls), controls)

    def columns(self, z: Tensor, controls: Tensor | None = None) -> Tensor:
        """The six columns as they are logged, (6, M); under any inputs where none is a coefficient."""
        if not self.model.measured:  # without instruments the columns are the states themselves
            return z[:6]
        return self.call("columns", z, z.new_zeros(self.inputs, 1) if controls is None else controls)[0]

    def start(self, logged: Tensor, controls: Tensor) -> Tensor:
        """States (S, M) logged as (6, M) under inputs (C, M), their memory settled; without gradient."""
        six, inputs = (a.detach().cpu().double().numpy() for a in (logged, controls))
        # measured effects are inverted and memory settled in numpy: a start is data, which needs no gradient
        C = len(self.model.controls)
        return torch.from_numpy(states_behind(self.model, six, inputs[:C], inputs[C:])).to(logged)


# No contraction, as in mmg.compile.batch; rollout.c allows it in the products of the network alone.
FLAGS = ("-O2", "-ftree-vectorize", "-ffp-contract=off", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math")
# Arrays of the C struct Run: inputs, then results; T evaluations of the network, points contiguous.
# W1 (H, F) ... b3 (3,): the layers, transposed (F, H), (H, H), (H, 3) for backward; seeds (N + 1, S, M): gradients at
# the states out; Z (T, S, M): states at which it was evaluated; X (T, F, M), T1, T2 (T, H, M): features, hidden layers;
# G1, G2 (T, H, M), GA (T, 3, M): gradients at the inputs of the layers and at the accelerations; first (S, M): at the
# start.
_ARRAYS = (
    "start", "controls", "W1", "b1", "W2", "b2", "W3", "b3", "seeds",
    "out", "Z", "X", "T1", "T2", "G1", "G2", "GA", "first",
)  # fmt: skip
_LOOP = Path(__file__).with_name("rollout.c")  # The loop over the steps, forward and backward; @names@ are filled in


class _Run(ctypes.Structure):
    """The struct Run of the C code."""

    _fields_ = (  # in the order of rollout.c
        [(name, ctypes.c_longlong) for name in ("points", "steps", "euler")]
        + [("h", ctypes.c_double)]
        + [(name, ctypes.c_void_p) for name in _ARRAYS]
    )


class FusedRollout:
    """Rollouts of a ship with a residual of one width, compiled when first used."""

    def __init__(self, physics: Physics, width: int) -> None:
        self.physics = physics
        self.S, self.C = len(physics.model.states), physics.inputs
        self.F, self.H = len(physics.ship.features), width

    @cached_property
    def library(self) -> ctypes.CDLL | None:
        """The compiled code; None where that is not possible."""
        advance, features = (Operator(self.physics.functions[name]) for name in ("advance", "features"))
        parts = [advance.function, features.function, advance.adjoint((1, 2)), features.adjoint((0,))]
        text = _LOOP.read_text(encoding="utf-8").replace("@arrays@", " ".join(f"double* {name};" for name in _ARRAYS))
        for name in "SCFH":
            text = text.replace(f"@{name}@", str(getattr(self, name)))
        # the loop calls the functions of the first unit inline and must be compiled with them
        first, *units = source(parts).split(UNIT)
        return load_library(UNIT.join([first + text, *units]), FLAGS)[0]

    def __call__(
        self, start: Tensor, controls: Tensor, h: float, layers: Sequence[Tensor], method: str = "rk4"
    ) -> Tensor:
        """States (N + 1, S, M) from start (S, M) under inputs (N, C, M) held over steps of h [s], float64.

        layers: W1 (H, F), b1, W2 (H, H), b2, W3 (3, H), b3 of ``residual.hybrid.Layered.plain``; gradients go to them
        and to the start. method: "rk4" or "euler". Raises ValueError for other shapes. There must be a ``library``.
        """
        M = start.shape[1]
        if start.shape != (self.S, M) or controls.shape[1:] != (self.C, M) or layers[0].shape != (self.H, self.F):
            raise ValueError(f"start {tuple(start.shape)}, inputs {tuple(controls.shape)} or weights do not fit")
        # the last point is repeated: any valid state will do, and zeros could be where a ship never is
        extra = padded(M) - M
        if extra:
            start, controls = (torch.cat([a, a[..., -1:].expand(*a.shape[:-1], extra)], -1) for a in (start, controls))
        states = _Rollout.apply(self, controls, h, method == "euler", start, *layers)
        return states[..., :M] if extra else states


class _Rollout(torch.autograd.Function):
    """A rollout in torch's graph."""

    @staticmethod
    def forward(ctx: Any, fused: FusedRollout, controls: Tensor, h: float, euler: bool, *given: Tensor) -> Tensor:
        N, M = len(controls), controls.shape[2]
        T = N if euler else 4 * N  # evaluations: RK4 has four stages a step
        sizes = {"Z": (T, fused.S), "X": (T, fused.F), "T1": (T, fused.H), "T2": (T, fused.H)}
        names = ("controls", "start", "W1", "b1", "W2", "b2", "W3", "b3")
        arrays = {name: a.detach().contiguous() for name, a in zip(names, (controls, *given), strict=True)}
        arrays["out"] = torch.empty((N + 1, fused.S, M), dtype=torch.float64)
        arrays |= {name: torch.empty((*size, M), dtype=torch.float64) for name, size in sizes.items()}
        # kept on the context: ``save_for_backward`` is for inputs and outputs, which most of these are not
        ctx.fused, ctx.settings = fused, (M, N, euler, h)
        _run(fused, "forward", ctx.settings, arrays)
        out = arrays.pop("out")  # a result that the context held would hold the context: neither would be freed
        ctx.arrays = arrays
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, seeds: Tensor) -> tuple[Any, ...]:
        fused, kept, (M, N, euler, _) = ctx.fused, ctx.arrays, ctx.settings
        if not kept:
            raise RuntimeError("a fused rollout goes backward once; simulate again")
        T = N if euler else 4 * N
        arrays = {"seeds": seeds.contiguous(), **{name: kept[name] for name in ("controls", "Z", "T1", "T2")}}
        # transposed once here, so that the loop backward reads rows one after the other
        arrays |= {name: kept[name].T.contiguous() for name in ("W1", "W2", "W3")}
        arrays["first"] = torch.empty((fused.S, M), dtype=torch.float64)
        sizes = ("G1", fused.H), ("G2", fused.H), ("GA", 3)
        arrays |= {name: torch.empty((T, rows, M), dtype=torch.float64) for name, rows in sizes}
        _run(fused, "backward", ctx.settings, arrays)
        gradients: list[Tensor] = []  # of W1, b1, W2, b2, W3, b3
        for at, given in (("G1", "X"), ("G2", "T1"), ("GA", "T2")):
            # products of all evaluations at once by the linear algebra library, faster than sums within the loop
            gradients += [(arrays[at] @ kept[given].transpose(1, 2)).sum(0), arrays[at].sum((0, 2))]
        kept.clear()  # a long rollout holds hundreds of megabytes, which the next windows need
        return None, None, None, None, arrays["first"], *gradients


def _run(fused: FusedRollout, which: str, settings: Sequence[Any], arrays: dict[str, Tensor]) -> None:
    """Call the C function on tensors by name; those that it does not touch are null."""
    if any(a.dtype != torch.float64 or not a.is_cpu for a in arrays.values()):
        raise ValueError("fused rollouts need float64 tensors on the processor")
    pointers = [arrays[name].data_ptr() if name in arrays else None for name in _ARRAYS]
    getattr(fused.library, which)(ctypes.byref(_Run(*settings, *pointers)))
