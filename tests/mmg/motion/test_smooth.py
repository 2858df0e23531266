"""The smooth blends: what they are at zero and one width from it, and the branches that they become far away."""

from __future__ import annotations

import math

import pytest

from mmg.motion.smooth import Exact, Smooth

S, E = Smooth(0.02), Exact()
NEAR, FAR = 0.3, 1e4


def test_at_a_distance_of_one_width_they_have_their_formula() -> None:
    w = NEAR
    assert float(S.absolute(w, w)) == pytest.approx(w / math.sqrt(2)) and float(S.absolute(0.0, w)) == 0
    assert float(S.magnitude(w, w)) == pytest.approx(w * math.sqrt(2)) and float(S.magnitude(0.0, w)) == pytest.approx(
        w
    )
    assert float(S.step(w, w)) == pytest.approx(1 / (1 + math.exp(-2))) and float(S.step(0.0, w)) == 0.5
    assert float(S.step_or_zero(0.0, w)) == pytest.approx(1 / (1 + math.exp(-3)))
    assert float(S.step_or_zero(-1.5 * w, w)) == pytest.approx(0.5)
    assert float(S.sign(w, w)) == pytest.approx(1 / math.sqrt(2)) and float(S.sign(0.0, w)) == 0
    assert float(S.positive(0.0, w)) == pytest.approx(w / 2)
    assert float(S.positive(w, w)) - float(S.positive(-w, w)) == pytest.approx(w)
    assert float(S.root(0.0, w)) == pytest.approx(w) and float(S.root(3 * w * w, w)) == pytest.approx(2 * w)
    assert float(S.signed_root(1e-6, w)) == pytest.approx(1e-6 / w)
    assert float(S.signed_root(w * w, w)) == pytest.approx(w / 2**0.25)
    assert float(S.divide(3.0, 0.0, w)) == pytest.approx(3 / w) and float(S.divide(3.0, w, w)) == pytest.approx(
        3 / w / math.sqrt(2)
    )
    assert float(S.angle(1.0, 0.0, w)) == pytest.approx(math.atan(w)) and float(S.angle(0.0, 5.0, w)) == pytest.approx(
        math.pi / 2
    )


@pytest.mark.parametrize("x", [-FAR, -1.0, 1.0, FAR])
def test_far_from_zero_they_are_the_branches(x: float) -> None:
    for name in ("absolute", "magnitude", "step", "step_or_zero", "sign", "positive", "signed_root"):
        smooth, exact = (float(getattr(s, name)(x, 1e-3)) for s in (S, E))
        assert smooth == pytest.approx(exact, rel=1e-5, abs=1e-5), name
    assert float(E.positive(x, 1.0)) == max(x, 0.0) and float(E.absolute(x, 1.0)) == abs(x)
    assert float(E.sign(x, 1.0)) == math.copysign(1.0, x) and float(E.step(x, 1.0)) == (x > 0)
    assert float(E.signed_root(x, 1.0)) == pytest.approx(math.copysign(math.sqrt(abs(x)), x))
    assert float(E.angle(x, -2.0, 1.0)) == pytest.approx(abs(math.atan2(-2.0, x)))
    assert float(E.angle(x, 2.0, 1.0)) == pytest.approx(float(S.angle(x, 2.0, 1e-6)))


def test_the_branches_at_zero() -> None:
    assert (float(E.step(0.0, 1.0)), float(E.step_or_zero(0.0, 1.0)), float(E.divide(2.0, 0.0, 1.0))) == (0, 1, 0)
    assert float(E.step(-1.0, 1.0)) == 0 == float(E.step_or_zero(-1.0, 1.0))
    assert float(E.divide(2.0, 4.0, 1.0)) == 0.5 and float(E.root(9.0, 1.0)) == 3
    assert 0 < float(E.magnitude(0.0, 1.0)) < 1e-200


def test_widths_grow_with_the_speed_of_the_ship() -> None:
    """By Froude: 10 mm/s for a model of 3 m, ten times that for a ship a hundred times as long."""
    assert Smooth.for_length(3.0).speed == pytest.approx(0.01)
    assert Smooth.for_length(300.0).speed == pytest.approx(0.1)
