"""Whether the effects that were found are likelier with the actuators read the other way.

How samples of the actuators are read is chosen by the fits without any effect. Held samples act half a sample later
than joined ones, so that an effect which makes the ship answer late passes there for held samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.trial import Trial
from diagnosis.estimation.gridded_trials import grid_trials
from diagnosis.estimation.map_estimate import estimate
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.hypotheses.refit import refit
from diagnosis.prepare import CLEAR, MAX_FITS, Prepared
from mmg.errors import UserError


def read_otherwise(ready: Prepared, trials: Sequence[Trial], found: Selection) -> Prepared | None:
    """The problem with the actuators read the other way, where the effects ``found`` are clearly likelier so.

    ready: the problem as it was read; trials: as they were logged. Returns None where that is not so, or where there
    was no choice, half a sample does not matter, or the ship cannot be followed with the actuators read so.
    """
    if not found.effects or not ready.reading.is_doubtful:
        return None
    p, straight = ready.problem, not ready.reading.straight
    length = float(p.steps.ship.particulars["L"])
    try:
        data = grid_trials(trials, p.steps.ship.inputs, length, p.data.h, straight).thinned(ready.gap)
        start = {x: found.final.value(*x) for c in found.effects for x in c.columns}
        with_them = refit(p.steps, data, p.base, found.final, found.effects, start)
        gain = found.final.nll - with_them.nll
        if not gain > CLEAR:
            return None
        null = estimate(p.steps, data, found.null, MAX_FITS)
        null = null if null.converged else estimate(p.steps, data, null, MAX_FITS)
    except (UserError, np.linalg.LinAlgError):
        return None
    reading = replace(ready.reading, straight=straight, gain=gain)
    known = [m for m in ready.notices if m.code != "coarse_samples"]
    return replace(ready, problem=replace(p, data=data), null=null, reading=reading, notices=(*known, *reading.notices))
