"""White, learned and named models side by side: shares of a known gap, their intervals, what a network's accelerations
are explained by."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cases.shipfiles.effects import with_effects
from cases.trial import Trial
from diagnosis.findings import TESTS, Budget
from diagnosis.validation.gap import BOTH, FLOOR, LEARNED, NAMED, REFITTED, GapRow, compared, sentence_of, witnessed
from mmg.errors import TooFewData
from mmg.network import Layers, Network
from mmg.ship import Ship
from tests.support.diagnosis_cases import FEW, RUNS, pushed_trials

CURRENT = "current:x=0.04,y=0.02"


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    """Runs in a current."""
    return pushed_trials(7, [CURRENT], RUNS)


def budget(left: float) -> Budget:
    """Of a diagnosis whose floor is this share of the error with what was named."""
    units = {"position_m": (1.0, 0.5, 0.5 * math.sqrt(left)), "heading_deg": (1.0, 0.5, 0.5 * math.sqrt(left))}
    return Budget("30 s", TESTS, 1.0, 0.5, 0.5 * left, (), None, units, None, (0.9 * left, left))


def test_the_true_effect_closes_all_and_a_half_of_it_three_quarters(trials: list[Trial]) -> None:
    """Errors grow with the square of what is missing: half a current leaves a quarter, but for the noise."""
    half, whole = (with_effects(FEW, [text]) for text in ("current:x=0.02,y=0.01", CURRENT))
    rows, run = compared({REFITTED: FEW, LEARNED: half, NAMED: whole}, trials, 30.0, budget(1.0))
    by_name = {row.name: row for row in rows}
    assert by_name[NAMED].closes == pytest.approx(1.0) and by_name[LEARNED].closes == pytest.approx(0.75, abs=0.06)
    low, high = by_name[LEARNED].closes_90 or (0.0, 0.0)
    assert low < by_name[LEARNED].closes < high
    assert by_name[FLOOR].position_m == pytest.approx(by_name[NAMED].position_m)
    drift = 30 * math.hypot(0.04, 0.02)  # what the calibrated ship misses
    assert by_name[REFITTED].position_m == pytest.approx(drift, rel=0.25)
    assert set(run.tolist()) == {0, 1, 2}


def test_trials_without_positions_are_compared_by_what_they_measure(trials: list[Trial]) -> None:
    bare = [replace(t, columns={k: v for k, v in t.columns.items() if k not in ("x", "y")}) for t in trials]
    whole, row = (compared({REFITTED: FEW}, some, 30.0, None)[0][0] for some in (trials, bare))
    assert row.heading_deg == pytest.approx(whole.heading_deg) and row.position_m == 0.0 < row.error < 1.0
    assert " m and" not in sentence_of([row], (), "none", 30.0) and " m and" in sentence_of([whole], (), "none", 30.0)


def test_without_a_floor_or_a_gap_nothing_is_shared_out(trials: list[Trial]) -> None:
    whole = with_effects(FEW, [CURRENT])
    without = compared({REFITTED: FEW, NAMED: whole}, trials, 30.0, None)[0]
    assert [row.name for row in without] == [REFITTED, NAMED] and without[1].closes is None
    quiet = compared({REFITTED: whole, LEARNED: whole}, trials, 30.0, budget(1.0))[0]
    # below a floor that leaves nothing to avoid: of such a network "closes 100 %" was said
    below = compared({REFITTED: FEW, LEARNED: whole}, trials, 30.0, budget(1.0))[0]
    assert all(row.closes is None for row in (*quiet, *below))
    assert "%" not in sentence_of(quiet, (), "none", 30.0)
    with pytest.raises(TooFewData):
        compared({REFITTED: FEW}, trials, 3000.0, None)


def test_the_sentence_tells_shares_and_what_was_declined() -> None:
    ends = (0.1, 0.2)
    row = GapRow(REFITTED, 0.2, ends, 0.6, ends, 7.0, ends)
    rows = [
        row,
        replace(row, name=LEARNED, closes=0.41, closes_90=(0.3, 0.5), kept=True),
        replace(row, name=NAMED, closes=0.56, closes_90=(0.5, 0.6)),
        replace(row, name=BOTH, closes=0.58, closes_90=(0.5, 0.6), kept=False),
        replace(row, name=FLOOR, position_m=0.3),
    ]
    words = sentence_of(rows, ["wind_force"], "named", 30.0)
    for number in ("41 % [30, 50]", "56 % [50, 60]", "58 % [50, 60]", "0.3"):
        assert number in words


def learning(ship: Ship, size: float) -> Ship:
    """The ``ship`` with a network that adds ``size`` tanh(u / 0.5) [m/s2] in surge alone."""
    W1 = np.zeros((1, len(ship.features)))
    W1[0, ship.features.index("u")] = 1.0
    layers = Layers((W1, np.eye(1), np.array([[1.0], [0.0], [0.0]])), (np.zeros(1), np.zeros(1)))
    scales, limit = np.full(len(ship.features), 0.5), np.full(len(ship.features), np.inf)
    return ship.with_network(Network(ship.features, scales, (layers,), np.array([size, 1.0, 1.0]), -limit, limit))


@pytest.mark.slow
def test_a_network_is_explained_by_the_effect_that_it_imitates(trials: list[Trial]) -> None:
    fouled = with_effects(FEW, ["fouling:share=0.4"])
    witness, channels = witnessed(learning(FEW, -1e-3), fouled, ["fouling"], trials)
    assert [one.effect for one in witness] == ["fouling"]
    assert witness[0].share["surge"] > 0.8 and witness[0].slope["surge"] > 0
    assert witness[0].share["sway"] == witness[0].share["yaw"] == 0.0
    assert channels["surge"].feature == "u" and channels["surge"].explained > 0.95
    assert channels["surge"].rms == pytest.approx(1e-3 * np.tanh(np.tanh(0.8)), rel=0.3)
    assert len(channels["surge"].at) == len(channels["surge"].learned) == len(channels["surge"].named) > 3
    nothing, alone = witnessed(learning(FEW, -1e-3), FEW, [], trials)
    assert nothing == () and set(alone["surge"].named) == {0.0}
