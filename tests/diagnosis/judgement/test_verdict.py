"""The five lines of the verdict, sizes that an effect cannot have, and what a diagnosis says of its own limits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from cases.trial_set import TrialSet
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.noise_sizes import least_noise
from diagnosis.estimation.parameters import priors_of_effects
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import TESTS
from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.hypotheses.refit import refit
from diagnosis.judgement.verdict import another_ship, impossible_size, limits, verdict_of
from diagnosis.prepare import InputReading, Prepared
from mmg.effects import EFFECTS
from tests.support.diagnosis_cases import candidate, full_model, pushed_problem, pushed_trials

RUNS = (("zigzag:20/20", 40.0), ("turning:-20", 40.0))


@cache
def ready() -> Prepared:
    problem, null = pushed_problem(1, runs=RUNS, h=1.0)
    trials, reading = TrialSet.of(pushed_trials(1, runs=RUNS)), InputReading(False, None, 0.1, 3.0)
    return Prepared(trials, problem, full_model(), null, reading, 1, (), tests=trials)


@pytest.mark.parametrize(
    ("named", "left", "measures", "is_random", "expected"),
    [
        ([], [0.9 * ODDS], [], True, ("none", 0, False)),
        ([], [1.1 * ODDS], [], True, ("unknown", 0, False)),
        ([], [-1.0], [], False, ("unknown", 0, False)),
        ([4.0], [9.0, -0.1], [False], True, ("named", 1, False)),
        ([40.0], [50.0, 0.1], [False], True, ("named", 1, True)),
        ([40.0], [50.0, -1.0], [False], False, ("named", 1, True)),
        ([40.0], [50.0, 41.0], [False], True, ("unknown", 0, False)),  # a free force beside it explains more
        ([5.0, 40.0], [50.0, 45.0, -1.0], [False] * 2, True, ("named", 2, False)),  # the second explains the rest
        ([40.0, 5.0], [50.0, 9.0, 6.0], [False] * 2, True, ("named", 1, True)),
        ([5.0, 5.0], [50.0, 9.0, 6.0], [False] * 2, True, ("unknown", 0, False)),
        ([9.0, 9.0], [50.0, 9.0, -1.0], [True, True], True, ("none", 2, False)),  # instruments make no verdict
        ([9.0, 9.0], [50.0, 9.0, 1.1 * ODDS], [True, True], True, ("unknown", 2, False)),
        ([9.0, 9.0], [50.0, 9.0, 0.1], [True, False], True, ("named", 2, True)),
    ],
)
def test_the_verdict_follows_from_the_evidence(
    named: list[float], left: list[float], measures: list[bool], is_random: bool, expected: tuple[str, int, bool]
) -> None:
    assert verdict_of(named, left.__getitem__, measures, is_random) == expected


def off(*p: float) -> Estimate:
    """The fit with its first coefficients so many prior standard deviations off, the others at their priors."""
    null = ready().null
    return replace(null, p=np.array([*p, *np.zeros(len(null.p) - len(p))]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("p", "is_named", "expected"),
    [
        ((2.0, -1.0), True, False),
        ((0.0, -5.2), True, True),
        ((0.0, -5.2), False, False),
        ((8.5,), False, True),
        ((3.5, -3.0, 3.0, 3.2), True, True),  # none of them by itself
        ((3.5, -3.0, 3.0, 3.2), False, False),
    ],
)
def test_no_effect_is_named_where_the_ship_is_another_one(p: tuple[float, ...], is_named: bool, expected: bool) -> None:
    found = another_ship(off(*p), ready().full.ship, is_named)
    assert (found.code if found else "") == ("not_described" if expected else "")


@pytest.mark.slow
def test_a_calibration_is_measured_by_the_priors_before_it() -> None:
    fit, ship = off(8.5), ready().full.ship
    symbol, std = fit.free.symbols[0], fit.free.std[0]
    wider = ship.with_coefficients({symbol: ship.coefficients[symbol].with_(prior_std=4 * std, prior_value=0.0)})
    assert another_ship(fit, ship, True) and another_ship(fit, wider, True) is None


def said(null: Estimate, budget: object = SimpleNamespace(by=TESTS)) -> dict[str, str]:
    """Sentences on what these trials cannot tell, by code, with this fit without effects."""
    found = SimpleNamespace(searches=[SimpleNamespace(scores=())])
    rows = limits(replace(ready(), null=null), found, budget)  # type: ignore[arg-type]
    return {row.code: str(row) for row in rows}


@pytest.mark.slow
def test_a_fit_that_is_not_what_the_tests_take_it_for_is_doubted() -> None:
    null, least = ready().null, least_noise(ready().full.ship)
    sound = replace(null, noise=null.noise.with_(tau=5.0))
    assert said(sound) == {} and list(said(sound, None)) == ["tests_too_short"]
    p, white = null.p.copy(), null.noise.white.copy()
    p[1], white[[2, 5]] = -4.2, least.white[[2, 5]]
    far = said(replace(null, p=p))["far_from_prior"]
    assert f"{null.free.symbols[1]} (-4.2)" in far and null.free.symbols[0] not in far
    assert " psi, r, " in said(replace(null, noise=null.noise.with_(white=white)))["no_noise"]
    short = said(replace(null, noise=null.noise.with_(tau=20.0)))["short_trials"]
    assert "40" in short and "remembers 20 s" in short


@pytest.mark.slow
def test_a_refit_whose_first_values_make_the_ship_explode_begins_nearer_to_neutral(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    p, null, effect = ready().problem, ready().null, candidate("current")
    begun: list[float] = []
    advance = TransitionModel.linearise

    def exploding(
        self: TransitionModel, z: np.ndarray, inputs: np.ndarray, theta: np.ndarray, *rest: np.ndarray
    ) -> object:
        begun.append(float(theta[self.ship.symbols.index("current.x")]))
        if begun[-1] > 0.1:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        return advance(self, z, inputs, theta, *rest)

    monkeypatch.setattr(TransitionModel, "linearise", exploding)
    found = refit(p, null, [effect], {effect.columns[0]: 0.3, effect.columns[1]: 0.0})
    assert begun[:2] == pytest.approx([0.3, 0.09]) and abs(found.value("current.x")) < 0.05


SIZES = [
    ("rudder_stall", (-0.144,), 0.02, True),
    ("rudder_stall", (-0.03,), 0.02, False),
    ("rudder_stall", (0.4,), 0.02, False),
    ("rudder_stall", (1.1,), 0.02, True),
    ("shallow_water", (-0.3,), 0.05, True),
    ("shallow_water", (-0.3,), 0.24, False),
    ("wind_force", (1.0, -0.5, 1.0), 0.1, True),
    ("wind_force", (1.0, 1.0, -0.5), 0.1, False),
    ("antenna_offset", (1.8, 0.0), 0.1, True),
    ("antenna_offset", (-1.4, 0.2), 0.01, False),
    ("fouling", (-0.3,), 0.1, True),
    ("fouling", (-0.15,), 0.1, False),
    ("draft", (-0.3,), 0.01, False),
    ("draft", (-0.6,), 0.03, True),  # where the range of a fit ends
    ("control_delay", (0.0,), 0.1, False),  # the end that is neutral
    ("current", (-0.3, 0.2), 0.01, False),
]
"""Effect, its parameters, their standard error, and whether no such effect is possible; for a ship of 3 m."""


def fit_with(effects: list[Candidate], values: list[float], std: float) -> Estimate:
    """A fit in which these parameters of the ``effects`` have these values, each with this standard error."""
    own, null = priors_of_effects(effects, 1.0), ready().null
    covariance = np.diag([*np.zeros(len(null.p)), *(std / own.std) ** 2])
    p = np.array([*null.p, *(np.array(values) - own.mean) / own.std])
    return replace(null, free=null.free + own, p=p, covariance=covariance)


@pytest.mark.parametrize(("effect", "values", "std", "expected"), SIZES)
def test_no_effect_is_surely_outside_what_it_can_be(
    effect: str, values: tuple[float, ...], std: float, expected: bool
) -> None:
    c = candidate(effect)
    words = impossible_size(full_model(), fit_with([c], list(values), std), c)
    assert bool(words) is expected and words.startswith(f"{effect} (" if expected else "")


@pytest.mark.parametrize(("share", "expected"), [(-0.45, False), (-0.75, True)])
def test_a_calibrated_ship_may_have_lost_the_fouling_that_she_had(share: float, expected: bool) -> None:
    ship = full_model().ship
    symbol = ship.free[0]
    row = ship.coefficients[symbol].with_(prior_std=1.0, prior_value=0.0)
    full, c = replace(full_model(), ship=ship.with_coefficients({symbol: row})), candidate("fouling")
    assert bool(impossible_size(full, fit_with([c], [share], 0.1), c)) is expected


def test_every_effect_can_be_absent() -> None:
    ship = full_model().ship
    for name, effect in EFFECTS.items():
        for p in effect.parameters(ship.namespace, dict(ship.components)):
            assert p.held or max(p.least, p.lower) <= p.neutral <= min(p.most, p.upper), (name, p.symbol)
