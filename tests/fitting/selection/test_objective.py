"""The objective: against a plain loop, its guard and penalties, and its derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.selection.learning import (
    LIMIT,
    Penalties,
    SubsequenceObjective,
    acceleration_limits,
    extremes_of,
    regression,
    spread_of,
    subsequences,
)
from mmg.errors import OutOfRange, UserError
from mmg.model import assemble
from mmg.runge_kutta import rk4_step
from tests.fitting.selection.paper_problems import ESSO, harbour, problem


def plain_error(one: SubsequenceObjective, p: np.ndarray) -> float:
    """E by a loop over subsequences and steps, one state at a time."""
    ship = one.ship_at(p)
    model, total, count = assemble(ship), 0.0, 0
    for trial in harbour()[:2]:
        N, h = len(one.train.controls), one.train.h
        rows = np.column_stack([trial[name] for name in ("u", "v", "r")])
        actuators = np.column_stack([trial[name] for name in ship.actuators])
        for first in range(0, len(trial) - 1, N):
            z, out = np.array([0, 0, trial["psi"][first], *rows[first]]), False
            for k in range(first, min(first + N, len(trial) - 1)):
                c = np.array([*actuators[k], 0.0, 0.0])
                with np.errstate(all="ignore"):
                    z = rk4_step(lambda s, at, c=c: np.array(model.rates(s, c, ship.values)).reshape(-1), z, h)
                    e = (z[3:] - rows[k + 1]) / one.sigma
                out = out or not (np.abs(e) < LIMIT).all()
                total += 3 * LIMIT**2 if out else float(e @ e)
                count += 3
                z = np.where(np.isfinite(z), z, 0.0) if out else z
    return total / count


@pytest.mark.slow
def test_the_error_is_that_of_a_plain_loop_for_each_candidate_of_a_population() -> None:
    one = problem()
    p = 0.3 * np.random.default_rng(0).normal(size=(one.P, 3)) + regression(one, harbour()[:2])[:, None]
    p[:, 2] *= -6.0  # this one runs away
    found = one.errors(p, one.train)
    assert found == pytest.approx([plain_error(one, column) for column in p.T], rel=1e-7)
    assert found[2] > 20 * found[0]


def test_a_runaway_has_a_finite_error_that_grows_the_earlier_it_leaves() -> None:
    one = problem()
    astray = np.where([s == "X_n_1" for s in one.prior.symbols], 1.0, 0.0)
    values = one.errors(np.outer(astray, [2.0, 20.0, 200.0, 1e6]), one.train)
    assert np.isfinite(values).all()
    assert (np.diff(values) > 0).all()
    assert values[-1] == pytest.approx(LIMIT**2)


def test_vectwin_has_the_1350_combinations_of_the_paper() -> None:
    vectwin = load_ship("vectwin_3m")
    rng = np.random.default_rng(0)
    t = np.arange(50.0)
    names = ("psi", "u", "v", "r", "n", "delta_port", "delta_starboard")
    trial = Trial("one", {"t": t, **{name: rng.normal(size=50) for name in names}})
    far = extremes_of(vectwin, [trial])
    assert far.state.shape == (6, 1350)
    assert len(np.unique(np.vstack([far.state, far.controls]).T, axis=0)) == 1350
    assert far.state[3].max() == pytest.approx(1.2 * trial["u"].max())
    assert not far.controls[[vectwin.inputs.index(name) for name in ("wind_north", "wind_east")]].any()


def test_acceleration_limits_are_of_differences_over_a_second() -> None:
    t = np.arange(0, 100, 0.1)
    trial = Trial("one", {"t": t, "u": 0.3 * t, "v": 0.1 * (-1.0) ** np.arange(len(t)), "r": 0 * t})
    assert acceleration_limits([trial], 1.0) == pytest.approx([0.3, 0.0, 0.0], abs=1e-12)


def test_the_deviation_counts_accelerations_beyond_their_limits() -> None:
    one = problem(penalties=Penalties(deviation=0.5))
    p = np.random.default_rng(1).normal(size=one.P)
    model, far, values = assemble(one.ship_at(p)), one.extremes, one.ship_at(p).values
    excess = [
        max(abs(a) / limit - 1, 0.0) ** 2
        for z, c in zip(far.state.T, far.controls.T, strict=True)
        for a, limit in zip(np.array(model.rates(z, c, values)).reshape(-1)[3:], far.limit, strict=True)
    ]
    assert np.mean(excess) > 0
    assert one.deviations(p[:, None])[0] == pytest.approx(np.mean(excess), rel=1e-9)
    assert one.values(p[:, None])[0] == pytest.approx(one.errors(p[:, None], one.train)[0] + 0.5 * np.mean(excess))


def test_the_sparsity_penalises_generated_terms_only() -> None:
    one = problem(penalties=Penalties(deviation=0.0, sparsity=0.01))
    p = 0.1 * np.ones(one.P)
    added = one.values(p[:, None])[0] - one.errors(p[:, None], one.train)[0]
    assert added == pytest.approx(0.001 * len(one.ship.monomials))
    assert len(one.ship.monomials) < one.P


def test_derivatives_agree_with_differences() -> None:
    one = problem("sm2-order2", Penalties(deviation=0.3))
    rng = np.random.default_rng(2)
    p = regression(one, harbour()[:2]) + 0.01 * rng.normal(size=one.P)
    gradient, hessian = one.quadratic(p)
    assert one.deviations(p[:, None])[0] > 0
    for _ in range(4):
        d, h = rng.normal(size=one.P) / np.sqrt(one.P), 1e-5
        high, low = one.values(np.transpose([p + h * d, p - h * d]))
        assert gradient @ d == pytest.approx((high - low) / (2 * h), rel=1e-4, abs=1e-7)
    assert np.linalg.eigvalsh(hessian)[0] > -1e-9 * np.trace(hessian)


def test_the_domain_is_that_of_the_ship_file_and_p_0_the_ship() -> None:
    one = problem()
    assert one.ship_at(np.zeros(one.P)).values == pytest.approx(one.ship.values)
    first = one.ship.free[0]
    assert one.ship_at(one.upper).coefficients[first].value == pytest.approx(one.ship.coefficients[first].upper)


def test_subsequences_follow_each_other_and_the_last_one_is_shorter() -> None:
    run = harbour()[0]
    found = subsequences([run], 1.0, 100.0, ESSO.inputs)
    assert found.count == 3
    assert found.weight.sum(axis=0).tolist() == [100, 100, 20]
    assert found.start[3, 1] == run["u"][100]
    assert found.measured[9, 0, 2] == pytest.approx(run["u"][210])


def test_a_step_longer_than_a_subsequence_and_still_trials_are_refused() -> None:
    with pytest.raises(OutOfRange):
        subsequences(harbour(), 300.0, 100.0, ESSO.inputs)
    still = Trial("still", {"t": np.arange(9.0), "u": np.ones(9), "v": np.zeros(9), "r": np.arange(9.0)})
    with pytest.raises(UserError, match="u, v"):
        spread_of([still])
