"""What is estimated again once an effect was named."""

from __future__ import annotations

import numpy as np

from diagnosis.hypotheses.forward_selection import select_effects
from tests.support.diagnosis_cases import pushed_problem, quiet


def test_an_effect_that_was_missing_no_longer_lengthens_the_memory_of_the_random_force() -> None:
    truth = quiet(tau=2.0)
    problem, null = pushed_problem(1, "current:x=0.05,y=-0.04", how=truth)
    found = select_effects(problem, null)
    assert [c.effect for c in found.effects] == ["current"]
    before, after = (abs(np.log(fit.noise.tau / truth.tau)) for fit in (null, found.final))
    assert after < 0.5 < 1.5 < before
    size = np.array([truth.X, truth.Y, truth.N])
    assert (null.noise.force > 4 * size).all() and (np.abs(np.log(found.final.noise.force / size)) < 0.6).all()
