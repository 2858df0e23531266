"""Shooting intervals by compiled code: LANES of them at once."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from mmg.compile import codegen, interval_source
from mmg.compile.batch import FLAGS, filled, padded
from mmg.compile.cache import LateSource, load_library
from mmg.compile.codegen import LANES

# Blocks of LANES intervals, at least, whose sums are made apart; 8 and 4 gain nothing (RESULTS.md of 5f878e7). As
# measured in November 2026.
SHARE = 16

Wanted = tuple[np.ndarray, np.ndarray]  # Rows (states) and columns (states, then free coefficients), by number
# Of start states and coefficients, end states and their sensitivities.
Steps = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

_SIZES = ("lanes", "steps", "groups", "extra", "middle", "changes", "tall", "wide")
_ARRAYS = (
    "start", "controls", "theta", "h", "count", "group", "slot", "interval", "given", "end", "interior", "states",
    "columns", "pull", "ends", "slope", "cost", "weight", "own", "rows", "shared",
)  # fmt: skip


class _IntervalRun(ctypes.Structure):
    """The struct Run of the C code, field by field in its order (intervals.h says what each is); absent arrays null."""

    _fields_ = [(name, ctypes.c_longlong) for name in _SIZES] + [(name, ctypes.c_void_p) for name in _ARRAYS]


@dataclass(frozen=True)
class Lanes:
    """M intervals in the order in which they are calculated, in whole vectors.

    interval: (lanes,) number of the interval of each lane; steps: (lanes,) of it, 0 where a lane only fills a vector;
    controls: (K, C, lanes) held over each step, or where an interval has ``changes`` means and changes over it (K, 2 C,
    lanes); group: (lanes,) which coefficients it has; slot: (lanes,) where what belongs to the coefficients is added
    up, -1 for none; shares: first and last block of those whose sums are made apart, at the borders of slots; M: number
    of intervals; h: step [s].
    """

    interval: np.ndarray
    steps: np.ndarray
    controls: np.ndarray
    group: np.ndarray
    slot: np.ndarray
    shares: tuple[tuple[int, int], ...]
    M: int
    h: float
    changes: bool = False

    @classmethod
    def of(
        cls,
        steps: np.ndarray,
        controls: np.ndarray,
        h: float,
        group: np.ndarray,
        slot: np.ndarray,
        changes: bool = False,
    ) -> Lanes:
        """From the steps (M,), controls (K, C, M), groups (M,) and slots (M,) of the intervals, the step h [s] and
        whether the controls have changes behind them."""
        M = len(steps)
        order = np.lexsort((-steps, slot))  # by slot, then the longest first: like lengths fill a vector
        borders = np.flatnonzero(np.diff(slot[order])) + 1
        wanted = np.arange(SHARE * LANES, M, SHARE * LANES)
        # a share ends at the first border of slots behind its size: no slot is in two shares
        near = borders[np.clip(np.searchsorted(borders, wanted), 0, len(borders) - 1)] if len(borders) else borders
        parts = np.split(order, np.unique(near))
        sizes = [padded(len(part)) for part in parts]
        # vectors are filled with copies of the last interval of their share
        interval = np.concatenate([filled(part, size) for part, size in zip(parts, sizes, strict=True)])
        is_real = np.concatenate([np.arange(size) < len(part) for part, size in zip(parts, sizes, strict=True)])
        ends = np.cumsum([size // LANES for size in sizes]).tolist()
        return cls(
            interval,
            np.where(is_real, steps[interval], 0).astype(np.int64),
            np.ascontiguousarray(controls[:, :, interval], dtype=float),
            group[interval].astype(np.int64),
            np.where(is_real, slot[interval], -1).astype(np.int64),
            tuple(pairwise([0, *ends])),
            M,
            float(h),
            changes,
        )

    @cached_property
    def position(self) -> np.ndarray:
        """Lane of each interval, (M,)."""
        lane = np.zeros(self.M, dtype=int)
        real = np.flatnonzero(self.slot >= 0)  # copies that fill a vector have slot -1
        lane[self.interval[real]] = real
        return lane

    @cached_property
    def beyond(self) -> np.ndarray:
        """Which interior states an interval does not have, (K - 1, M)."""
        return np.arange(len(self.controls) - 1)[:, None] >= self.steps[self.position]

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values (..., M) of the intervals in the order of the lanes."""
        return np.ascontiguousarray(values[..., self.interval], dtype=float)

    def parts(self, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A slot for each owner in each share: that of each lane (lanes,), -1 for none, and the owner of each of them.
        owner: (slots,) of what is added up by window."""
        share = np.repeat(np.arange(len(self.shares)), [LANES * (end - begin) for begin, end in self.shares])
        real, owners = self.slot >= 0, int(owner.max()) + 1
        pairs, number = np.unique(share[real] * owners + owner[self.slot[real]], return_inverse=True)
        part = np.full(len(share), -1, dtype=np.int64)
        part[real] = number
        return part, pairs % owners


@dataclass(frozen=True)
class IntervalKernel:
    """Compiled intervals of a right-hand side of S states and P free coefficients."""

    library: ctypes.CDLL
    S: int
    P: int

    @classmethod
    def of(
        cls, whole: ca.Function, check: Callable[[IntervalKernel], str] | None = None, what: str = "equations"
    ) -> tuple[IntervalKernel | None, str]:
        """The kernel of the function ``whole`` (see ``interval_source``), or None and why there is none.

        check: what is wrong with a kernel, "" for nothing; asked of a newly compiled one before it is kept; what: it
        is, for people.
        """

        def kernel(library: ctypes.CDLL) -> IntervalKernel:
            return cls(library, whole.size1_out(0), whole.size2_out(1) - whole.size1_in(0))

        generators = (codegen, interval_source)
        text = LateSource.of([whole], lambda: interval_source.interval_source(_without_repetition(whole)), *generators)
        library, reason = load_library(text, FLAGS, (lambda new: check(kernel(new))) if check else None, what)
        return (None if library is None else kernel(library)), reason

    def values(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, given: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K - 1, S, M) from start states (S, M) and coefficients (G, all).

        given: (K, S, M) states that replace those after each step, NaN for none, or None.
        """
        run = self._states(lanes, start, theta)
        if given is not None:
            run["given"] = lanes.spread(given)
        self._call("values", self._request(lanes, run))
        interior = run["interior"][:, :, lanes.position]
        if lanes.beyond.any():  # the kernel leaves what it does not reach unset
            interior = np.where(lanes.beyond[:, None, :], 0.0, interior)
        return run["end"][:, lanes.position], interior

    def linearise(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, wanted: Wanted | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """End states (S, M), their sensitivities (M, S, S + P) to start and free coefficients, and (M, S + P) of the
        samples' cost.

        start, theta: as of ``values``; pull: (K - 1, S, M) gradient of the cost to the interior states; wanted: rows
        and columns of the sensitivities (default: all).
        """
        run = self._sensitivities(lanes, start, theta, pull, wanted)
        self._call("linearise", self._request(lanes, run))
        return run["end"][:, lanes.position], run["ends"], run["slope"]

    def gradient(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, weight: np.ndarray
    ) -> np.ndarray:
        """Gradient (M, S + P), to start and free coefficients, of a cost of the interior states and the ends, whose own
        gradients are ``pull`` (K - 1, S, M) and ``weight`` (S, M); start, theta: as of ``values``."""
        run = self._states(lanes, start, theta) | {"pull": lanes.spread(pull), "weight": lanes.spread(weight)}
        run["slope"] = np.empty((lanes.M, self.S + self.P))
        self._call("gradient", self._request(lanes, run))
        return run["slope"]

    def curve(
        self,
        lanes: Lanes,
        start: np.ndarray,
        theta: np.ndarray,
        pull: np.ndarray,
        cost: tuple[np.ndarray, np.ndarray],
        weight: np.ndarray | None,
        slot: np.ndarray,
        middle: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The sensitivities that ``linearise`` gives, then the Hessian of weight . end + cost of the interior states:
        rows of the start nodes (M, S, S + P) and, summed by slot, the block of the coefficients (slots, P, P).

        cost: upper triangles (K - 1, n (n + 1) / 2, M), row by row, of the cost's Hessian to the n = S + O of states
        and O of the free coefficients, and the positions (O,) of these; weight: (S, M), or None for the cost's Hessian
        to first order in the states (Gauss and Newton); slot: (lanes,) as of ``lanes``, none of two shares;
        middle: take second derivatives of the rates once a step, in its middle, with the multipliers of all stages.
        """
        S, N, P = self.S, self.S + self.P, self.P
        run = self._sensitivities(lanes, start, theta, pull)
        run |= {"cost": lanes.spread(cost[0]), "own": np.ascontiguousarray(cost[1], dtype=np.int64)}
        run |= {"rows": np.empty((lanes.M, S, N)), "shared": np.zeros((int(slot.max()) + 1, P, P)), "slot": slot}
        if weight is not None:
            run["weight"] = lanes.spread(weight)
        self._call("curve", self._request(lanes, run, middle))
        shared, lower = run["shared"], np.tril_indices(P, -1)
        shared[:, lower[0], lower[1]] = shared[:, lower[1], lower[0]]  # the kernel sums the upper half alone
        return run["ends"], run["slope"], run["rows"], shared

    def _states(self, lanes: Lanes, start: np.ndarray, theta: np.ndarray) -> dict[str, np.ndarray]:
        size, K = len(lanes.interval), len(lanes.controls)
        return {
            "start": lanes.spread(start),
            "theta": np.ascontiguousarray(theta.T, dtype=float),
            "end": np.empty((self.S, size)),
            "interior": np.empty((K - 1, self.S, size)),
        }

    def _sensitivities(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, wanted: Wanted | None = None
    ) -> dict[str, np.ndarray]:
        run = self._states(lanes, start, theta) | {"pull": lanes.spread(pull)}
        rows, columns = self.S, self.S + self.P
        if wanted is not None:
            run["states"], run["columns"] = (np.ascontiguousarray(a, dtype=np.int64) for a in wanted)
            rows, columns = map(len, wanted)
        return run | {"ends": np.empty((lanes.M, rows, columns)), "slope": np.empty((lanes.M, columns))}

    def repeated(self, lanes: Lanes, theta: np.ndarray, wanted: Wanted) -> Steps:
        """``linearise`` of the same ``lanes`` of one step again and again, where setting up its arrays takes longer.

        theta: coefficients (1, all), of the same shape each time; wanted: as of ``linearise``. What is called takes
        start states (S, M) and coefficients (1, all), and what is written into ``lanes.controls``; it returns end
        states (S, M) and their sensitivities (M, rows, columns).
        """
        run = self._sensitivities(lanes, np.zeros((self.S, lanes.M)), theta, np.zeros((0, self.S, lanes.M)), wanted)
        request = self._request(lanes, run)

        def again(start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            # into the arrays whose addresses the struct holds
            run["start"][...], run["theta"][...] = start[:, lanes.interval], theta.T
            self._call("linearise", request)
            return run["end"][:, lanes.position], run["ends"].copy()

        return again

    def _call(self, name: str, request: tuple[_IntervalRun, object]) -> None:
        if getattr(self.library, name)(ctypes.byref(request[0])):  # the C code returns 1 where malloc gives nothing
            raise MemoryError("no memory for the sensitivities of a block of intervals")

    def _request(
        self, lanes: Lanes, arrays: dict[str, np.ndarray], middle: bool = False
    ) -> tuple[_IntervalRun, dict[str, np.ndarray]]:
        """The struct of a call, and the arrays that it points to: they must live as long as it."""
        by_lane = {"controls": lanes.controls, "count": lanes.steps, "group": lanes.group, "slot": lanes.slot}
        every = by_lane | {"h": np.array([lanes.h]), "interval": lanes.interval} | arrays
        tall, wide, extra = (len(arrays.get(name, ())) for name in ("states", "columns", "own"))
        sizes = (len(lanes.interval), len(lanes.controls), arrays["theta"].shape[1], extra)
        run = _IntervalRun(*sizes, middle, lanes.changes, tall, wide)
        for name, array in every.items():
            setattr(run, name, array.ctypes.data)
        return run, every


def _without_repetition(function: ca.Function) -> ca.Function:
    """The SXFunction ``function`` with no expression twice; late, as it takes longer than to find compiled code."""
    given = function.sx_in()
    return ca.Function(function.name(), given, function.call(given), {"cse": True})
