"""An interrupted calibration: whether it may go on with these trials and options, and where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.trial import Trial
from fitting.calibration import Calibration
from fitting.record import SolveRow
from fitting.result import FitResult
from mmg.errors import Conflict
from mmg.ship import Ship


def check_resumable(earlier: FitResult, ship: Ship, trials: Sequence[Trial], constants: Sequence[str] = ()) -> None:
    """Raises UserError unless ``earlier`` was of the same ``trials``, free coefficients of ``ship`` and ``constants``.

    constants: symbols of which each run has its own.
    """
    where = earlier.folder
    if set(earlier.coefficients) != set(ship.free) - _by_campaign(earlier):
        raise Conflict(f"{where}: --resume needs the same --without, --fix and --only as the interrupted run")
    if {symbol for rows in (earlier.per_run or {}).values() for symbol in rows} != set(constants):
        raise Conflict(f"{where}: --resume needs the same --per-run as the interrupted run")
    if sorted(row.sha256 or "" for row in earlier.data) != sorted(t.sha256 for t in trials):
        raise Conflict(f"{where}: --resume needs the same trial files as the interrupted run")


def iterate_of(earlier: FitResult, model: Ship) -> dict[str, np.ndarray] | None:
    """Where the interrupted run ``earlier`` goes on: at its iterate; with values by campaign at the coefficients that
    all runs of ``model`` share, "p" (P,), from which these values are found again; None where it begins anew."""
    own = _by_campaign(earlier)
    if earlier.iterate is None or not own:
        return earlier.iterate
    return None if own & set(model.free) else {"p": np.asarray(earlier.iterate["p"])[: len(model.free)]}


def _by_campaign(earlier: FitResult) -> set[str]:
    """Symbols of the constants that have a value in each campaign."""
    rows = (earlier.campaigns or {}).get("values") or {}
    return {symbol for row in rows.values() for symbol in row}


def earlier_passes(resumed: FitResult | None, found: Calibration) -> Sequence[SolveRow]:
    """Rows of the solves of an interrupted run, ``resumed``, that came before those of the calibration ``found``."""
    count = int(found.resumption.number[0]) + 1 - len(found.passes)
    return resumed.passes[:count] if resumed else ()
