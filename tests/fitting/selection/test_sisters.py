"""Widths of sisters: recovered where they are known, near zero for identical ones, and worth having."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.selection.sisters import Marginal, SisterEvidence, sister_widths

P, DIFFER = 24, 8


def sisters(count: int, width: float, rows: int, seed: int) -> tuple[list[SisterEvidence], np.ndarray]:
    """Ships whose first DIFFER coefficients differ by ``width``, each seen by so many ``rows``; and the truth."""
    rng = np.random.default_rng(seed)
    size = np.where(np.arange(P) < DIFFER, width, 0.0)
    mean = 0.5 * rng.normal(size=P)
    truth = mean + size * rng.normal(size=(count, P))
    found = []
    for c in truth:
        J = rng.normal(size=(rows, P)) * np.geomspace(5.0, 0.2, P)
        y = J @ c + rng.normal(size=rows)
        found.append(SisterEvidence(tuple(f"c{k}" for k in range(P)), np.zeros(P), np.ones(P), J.T @ J, J.T @ y))
    return found, truth


def alone(ships: list[SisterEvidence]) -> np.ndarray:
    return np.array([np.linalg.solve(s.A + np.eye(P), s.b) for s in ships])


def test_a_known_width_is_recovered_the_error_falls_and_standard_errors_hold_the_truth() -> None:
    found, gains, z = [], [], []
    for seed in range(6):
        ships, truth = sisters(10, 0.4, 30, seed)
        w = sister_widths(ships)
        found.append(np.sqrt((w.width[:DIFFER] ** 2).mean()))
        gains.append(((w.estimate - truth) ** 2).mean() / ((alone(ships) - truth) ** 2).mean())
        z.append((w.estimate - truth) / w.std)
        assert np.median(w.width[DIFFER:]) < 0.1
    assert np.mean(found) == pytest.approx(0.4, rel=0.15)
    assert np.mean(gains) < 0.6 and max(gains) < 0.9 and 0.8 < np.std(z) < 1.2


def test_identical_sisters_have_widths_near_zero_and_one_value() -> None:
    for seed in range(4):
        ships, truth = sisters(5, 0.0, 30, seed)
        w = sister_widths(ships)
        assert w.common < 0.03 and w.width.max() < 0.1
        assert ((w.estimate - truth) ** 2).mean() < 0.6 * ((alone(ships) - truth) ** 2).mean()


def test_a_ship_that_is_no_sister_is_told() -> None:
    ships, _ = sisters(8, 0.1, 60, 3)
    ships[2] = replace(ships[2], b=ships[2].b + 3.0 * ships[2].A[:, 1])  # one coefficient three units off
    found = sister_widths(ships)
    assert np.argmin(found.p_alike) == 2 == np.argmax(np.abs(found.from_others[:, 1]))


def test_the_slope_of_the_likelihood_agrees_with_differences_and_units_do_not_matter() -> None:
    ships, _ = sisters(4, 0.4, 15, 1)
    A, b = np.array([s.A for s in ships]), np.array([s.b for s in ships])
    square, h = np.full(P, 0.09), 1e-5
    slope = Marginal.of(A, b, np.sqrt(square)).slope()
    for j in (0, 7, 20):
        step = h * (np.arange(P) == j)
        ends = [Marginal.of(A, b, np.sqrt(square + sign * step)).log_likelihood for sign in (1, -1)]
        assert slope[j] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-4, abs=1e-6)
    centre, unit = np.linspace(-1, 1, P), np.linspace(0.5, 2, P)
    back = ships[1].in_units(centre, unit).in_units(ships[1].centre, ships[1].unit)
    assert np.allclose(back.A, ships[1].A) and np.allclose(back.b, ships[1].b)
