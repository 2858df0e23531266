"""Evaluation of CasADi functions at many points: compiled where a C compiler is found, interpreted elsewhere."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import casadi as ca
import numpy as np

from mmg.compile import batch_source, codegen, staged_lanes, stages, vector_math
from mmg.compile.cache import LateSource, load_library
from mmg.compile.codegen import LANES
from mmg.compile.self_test import differences, finite_points, require_values

FLAGS: tuple[str, ...] = (
    "-O1", "-ftree-vectorize", "-ffp-contract=off", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-w"
)  # fmt: skip
"""-ftree-vectorize makes vectors of the loops over lanes (square roots). Without contraction a product and a sum are
rounded one by one whatever stands beside them, so equal expressions give equal bits; its cost is not measurable."""

GENERATORS = (batch_source, codegen, staged_lanes, stages, vector_math)
"""Modules that the source of batch kernels comes from."""


@dataclass
class BatchFunction:
    """A CasADi function over many points.

    Call it with one array per input, shape (rows, points) or, shared by all points, (rows,); a matrix input is
    given by the nonzeros it has as a column-major vector. It returns one array (nonzeros, points) per output.
    ``points`` must be a multiple of LANES (``padded`` gives the next one).
    """

    function: ca.Function
    library: ctypes.CDLL | None
    _mapped: dict = field(default_factory=dict, repr=False)

    def __call__(self, *inputs: np.ndarray, outputs: Sequence[bool] | None = None) -> list[np.ndarray | None]:
        points = max((a.shape[1] for a in inputs if a.ndim == 2), default=LANES)
        return self._compiled(points, inputs, outputs) if self.library else self._interpreted(points, inputs)

    def at(self, *inputs: np.ndarray) -> list[np.ndarray]:
        """All outputs, (nonzeros, m) each, at any number m >= 1 of points: inputs (rows, m), or (rows,) for all."""
        m = next(a.shape[1] for a in inputs if a.ndim == 2)
        outputs = self(*[filled(a, padded(m)) if a.ndim == 2 else a for a in inputs])
        return [a[:, :m] for a in outputs if a is not None]

    def _compiled(
        self, points: int, inputs: Sequence[np.ndarray], outputs: Sequence[bool] | None
    ) -> list[np.ndarray | None]:
        if points % LANES:
            raise ValueError(f"{points} points is not a multiple of {LANES}")
        f = self.function
        arrays = [np.ascontiguousarray(a, dtype=float) for a in inputs]
        wanted = outputs or [True] * f.n_out()
        results = [np.empty((f.nnz_out(j), points)) if wanted[j] else None for j in range(f.n_out())]
        arg = (ctypes.c_void_p * len(arrays))(*[a.ctypes.data for a in arrays])
        ld = (ctypes.c_longlong * len(arrays))(*[points if a.ndim == 2 else 0 for a in arrays])
        res = (ctypes.c_void_p * len(results))(*[None if a is None else a.ctypes.data for a in results])
        getattr(self.library, f.name())(ctypes.c_longlong(points), arg, ld, res)
        return results

    def _interpreted(self, points: int, inputs: Sequence[np.ndarray]) -> list[np.ndarray | None]:
        """The same by CasADi's virtual machine, zero-copy buffers, one map over the points."""
        f = self.function
        shared = tuple(a.ndim == 1 for a in inputs)
        key = (points, shared)
        if key not in self._mapped:
            mapped = f.map(f.name(), "serial", points, [i for i, s in enumerate(shared) if s], [])
            self._mapped[key] = (mapped, *mapped.buffer())
        mapped, buffer, trigger = self._mapped[key]
        arrays = [np.ascontiguousarray(a if a.ndim == 1 else a.T, dtype=float) for a in inputs]
        results = [np.zeros((points, f.nnz_out(j))) for j in range(f.n_out())]
        for i, a in enumerate(arrays):
            buffer.set_arg(i, a.reshape(-1).data)
        for j, a in enumerate(results):
            buffer.set_res(j, a.reshape(-1).data)
        trigger()
        return [np.ascontiguousarray(a.T) for a in results]


def padded(points: int) -> int:
    """Number of points in whole vectors: ``points`` rounded up to a multiple of LANES, at least LANES."""
    return max(LANES, -(-points // LANES) * LANES)


def filled(array: np.ndarray, points: int) -> np.ndarray:
    """``array`` (..., m) with its last point repeated, (..., points); as it is where it has them."""
    missing = points - array.shape[-1]
    return np.concatenate([array, np.repeat(array[..., -1:], missing, axis=-1)], axis=-1) if missing > 0 else array


def batch_functions(
    functions: Sequence[ca.Function], compiled: bool = True, what: str = "equations"
) -> tuple[list[BatchFunction], str]:
    """Batch versions of SXFunctions, compiled into one cached library if possible.

    Returns them with a sentence on why they run interpreted, or "" when compiled.
    functions: with distinct names; compiled: False interprets; what: they are, for people.
    """
    library, reason = None, "compilation switched off"
    if compiled:
        try:
            text = LateSource.of(functions, partial(batch_source.source, functions), *GENERATORS)
            library, reason = load_library(text, FLAGS, partial(_faults, functions), what)
        except NotImplementedError as error:
            reason = str(error)
    return [BatchFunction(f, library) for f in functions], reason


def _faults(functions: Sequence[ca.Function], library: ctypes.CDLL) -> str:
    """Which of these ``functions`` a new ``library`` gets wrong, "" for none."""
    every: list[np.ndarray] = []
    for number, f in enumerate(functions):
        inputs, expected = finite_points(f, LANES, 100 * number)
        found = [a for a in BatchFunction(f, library)(*inputs) if a is not None]
        if differences(found, expected):
            return f"{f.name()} differs from that of the portable path"
        every += expected
    require_values(every)
    return ""
