"""Where the nonzeros of the constraint Jacobian and of the Lagrangian's Hessian of a calibration lie."""

from __future__ import annotations

import casadi as ca
import numpy as np

from fitting.nlp.run_constants import Columns
from fitting.nlp.windows import Segments

Pattern = tuple[ca.Sparsity, np.ndarray]
"""A compressed-column pattern, and the order that sorts values, as they are assembled, into it."""


def sparsity_patterns(seg: Segments, S: int, P: int, columns: Columns) -> tuple[Pattern, Pattern]:
    """Patterns of the Jacobian (S M, S B + P) and of the upper triangle of the Hessian, over the intervals of ``seg``.

    S, P: numbers of states and coefficients. Nodes and intervals border on the ``columns`` of their group.
    """
    M, B = seg.intervals, len(seg.nodes)
    n, m = S * B + P, S * M
    i, j = np.meshgrid(np.arange(S), np.arange(S), indexing="ij")
    rows = S * np.arange(M)[:, None, None]
    block = (rows + i, S * seg.start[:, None, None] + j)
    ends = (S * np.arange(M)[:, None] + np.arange(S), S * seg.end[:, None] + np.arange(S))
    at = columns.at[columns.interval][:, None, :]
    dense = np.broadcast_arrays(rows + np.arange(S)[:, None], S * B + at)
    r = np.concatenate([part[0].reshape(-1) for part in (block, ends, dense)])
    c = np.concatenate([part[1].reshape(-1) for part in (block, ends, dense)])
    jacobian = _sparsity(r, c, m, n)
    iu, ju = np.triu_indices(S)
    own = (S * np.arange(B)[:, None] + iu, S * np.arange(B)[:, None] + ju)
    at = columns.at[columns.node][:, None, :]
    border = np.broadcast_arrays(S * np.arange(B)[:, None, None] + np.arange(S)[:, None], S * B + at)
    pu, qu = np.triu_indices(P)
    r = np.concatenate([own[0].reshape(-1), border[0].reshape(-1), S * B + pu])
    c = np.concatenate([own[1].reshape(-1), border[1].reshape(-1), S * B + qu])
    return jacobian, _sparsity(r, c, n, n)


def upper_triangle(nodes: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Values of the Hessian's upper triangle in the order in which its pattern assembles them: of rows of the nodes
    (B, S, S + L) and of the coefficients ``shared`` (P, P)."""
    S = nodes.shape[1]
    i, j = np.triu_indices(S)
    parts = (nodes[:, i, j], nodes[:, :, S:], shared[np.triu_indices(len(shared))])
    return np.concatenate([part.reshape(-1) for part in parts])


def _sparsity(rows: np.ndarray, columns: np.ndarray, n: int, m: int) -> Pattern:
    """CasADi's compressed-column pattern of distinct triplets and the order that sorts their values into it."""
    order = np.lexsort((rows, columns))
    counts = np.bincount(columns, minlength=m)
    pointers = np.concatenate([[0], np.cumsum(counts)])
    return ca.Sparsity(n, m, pointers.tolist(), rows[order].tolist()), order
