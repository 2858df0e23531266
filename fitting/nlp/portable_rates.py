"""Rates of a ship and their derivatives without compiled code, for ``portable_intervals``."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from mmg.compile.batch import BatchFunction


class Functions:
    """Rates of a ship with their derivatives at many points, interpreted.

    whole: SXFunction (q (Q,), inputs, coefficients, multipliers (S,)) -> rates (S,), their Jacobian (S, Q + P) to q and
    the P free coefficients, upper triangle of the Hessian of multipliers . rates. ``jacobian_at`` and ``hessian_at``:
    row and column of each nonzero.
    """

    def __init__(self, whole: ca.Function) -> None:
        self.S, self.Q = whole.size1_out(0), whole.size1_in(0)
        self.P = whole.size2_out(1) - self.Q
        self._given = whole.sx_in()
        k, J, self._hessian = whole(*self._given)
        self.rates, self.jacobian = self._batch("f_rates", 3, k), self._batch("f_jacobian", 3, k, J)
        both = (np.array(A.sparsity().get_triplet(), dtype=int) for A in (J, self._hessian))
        self.jacobian_at, self.hessian_at = both

    @cached_property
    def hessian(self) -> BatchFunction:
        """Of the multipliers . rates; made when it is first asked for, as it takes longer than the rest together."""
        return self._batch("f_hessian", 4, self._hessian)

    def _batch(self, name: str, arguments: int, *results: ca.SX) -> BatchFunction:
        return BatchFunction(ca.Function(name, self._given[:arguments], list(results), {"cse": True}), None)
