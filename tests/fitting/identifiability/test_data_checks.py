"""Trials and priors that do not belong into a calibration are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, add_noise, simulate
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.identifiability.data_checks import contradictions, refuse_outliers, unexcited_astern
from fitting.nlp.problem import Prior
from fitting.nlp.windows import cut
from fitting.settings import Settings, Start
from fitting.solvers.solve import disagreement
from mmg.errors import TooFewData, UserError
from tests.support.synthetic_runs import runs

ESSO = load_ship("esso_osaka_3m")
FAST = Settings(passes=2)
NOISE = vars(SensorNoise.for_length(3.0))


def scrambled(trial: Trial) -> Trial:
    """Every sample an outlier."""
    rng = np.random.default_rng(0)
    sizes = {"x": 3.0, "y": 3.0, "psi": 0.3, "u": 0.2, "v": 0.1, "r": 0.05}
    return trial.with_columns(**{s: trial[s] + size * rng.normal(size=len(trial)) for s, size in sizes.items()})


def foreign(trial: Trial) -> Trial:
    """A run of another ship under the same name: one that turns the other way and much faster."""
    other = ESSO.with_values({s: k * ESSO.coefficients[s].value for s, k in (("N_r", 0.2), ("Y_v", 0.3), ("k_0", 1.5))})
    plan = parse_maneuver("zigzag:20/20", ESSO, n=10.0, duration=120.0)
    run = add_noise(simulate(other, plan, 0.1, None, 1), SensorNoise.for_length(3.0), 1)
    return Trial(trial.name, {**run.columns, "delta": -run["delta"]})


def named(trials: list[Trial]) -> list[str]:
    return [w for w in estimate_coefficients(ESSO, trials, FAST).warnings if "leave it out" in w]


@pytest.mark.slow
def test_runs_that_belong_are_not_named() -> None:
    assert named(list(runs()[0])) == []


def test_a_run_that_is_all_outliers_is_refused_by_name_before_the_fit() -> None:
    trials = list(runs()[0])
    bad = replace(scrambled(trials[4]), name="spoilt")
    with pytest.raises(UserError, match=r"^spoilt \(\d+"):
        estimate_coefficients(ESSO, [*trials[:4], bad, *trials[5:]], FAST)
    refuse_outliers(trials, 1.0)
    refuse_outliers([bad, trials[0]], 1.0)  # two runs: nobody knows which


@pytest.mark.slow
def test_a_run_whose_residuals_are_white_is_called_outliers() -> None:
    trials = list(runs()[0])
    rng = np.random.default_rng(1)
    noisy = {name: trials[4][name] + 7 * sd * rng.normal(size=len(trials[4])) for name, sd in NOISE.items()}
    mild = replace(trials[4].with_columns(**noisy), name="noisy")
    words = [w for w in estimate_coefficients(ESSO, [*trials[:4], mild, *trials[5:]], FAST).warnings if "noisy" in w]
    assert len(words) == 1


@pytest.mark.longest
@pytest.mark.slow
def test_a_run_of_another_ship_is_named_as_such() -> None:
    trials = list(runs()[0])[:4]
    words = named([*trials, replace(foreign(trials[0]), name="stranger")])
    assert len(words) == 1


def test_astern_coefficients_without_astern_motion_are_named_or_alone_refused_also_with_an_instrument() -> None:
    ahead = [t for t in runs()[0] if t["u"].min() > 0.05 and t["n"].min() >= 0]
    assert ahead
    astern = ("A_5", "B_5", "C_6", "C_7", "A_6")
    segments = cut(ahead, 1.0, 50.0, 5)
    only = ESSO.fixing([s for s in ESSO.symbols if s not in astern])
    for alone in (only, freeing_effects(only, ["velocity_filter"])):
        with pytest.raises(TooFewData, match="A_5, A_6, B_5"):
            unexcited_astern(alone, ahead, cut(ahead, 1.0, 50.0, 5, inputs=alone.inputs))
    words = unexcited_astern(ESSO, ahead, segments)
    assert len(words) == 1 and all(s in words[0] for s in astern)
    assert not any(s in words[0].split(":")[0].split(", ") for s in ("Y_v", "N_r", "k_0", "X_0F", "ell_R"))


def test_priors_that_contradict_themselves_are_said() -> None:
    prior = Prior.of(ESSO)
    assert contradictions(prior) == []
    is_Y_v = np.array(prior.symbols) == "Y_v"
    lower = np.where(is_Y_v, prior.mean + 4 * prior.std, prior.lower)
    words = contradictions(replace(prior, lower=lower, upper=np.maximum(prior.upper, lower + prior.std)))
    assert len(words) == 1 and words[0].startswith("Y_v") and "4.0" in words[0]
    with pytest.raises(UserError, match="Y_v"):
        contradictions(replace(prior, std=np.where(is_Y_v, 0.0, prior.std)))


def test_starts_that_disagree_say_how_far() -> None:
    starts = [Start(0, 100.0, True, 0.0), Start(1, 130.0, True, 2.5, True, {"Y_v": -2.5, "N_r": 0.4}),
              Start(2, 1e9, False, 9.0)]  # fmt: skip
    words = disagreement(starts, 100.0)
    assert len(words) == 2 and "100" in words[0] and "Y_v by 2.5, N_r by 0.4" in words[0]
    assert disagreement(starts[:1], 100.0) == []
