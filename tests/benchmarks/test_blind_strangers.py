"""Strangers of the blind benchmark: dealt alike, and nothing that the package knows spells one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind.generator.deal import deal
from benchmarks.blind.generator.effect import Drawn, Effect
from benchmarks.blind.generator.foreign import FOREIGN, NEW, SPELLED, STRANGERS
from benchmarks.blind.generator.plant import parts_of, plant_of
from benchmarks.blind.generator.world import WORLDS, scaled_ship
from mmg.effects import EFFECTS as PACKAGE_EFFECTS
from tests.benchmarks.test_blind_generator import EFFECTS, SHORTER, alone, with_each_effect


def test_strangers_are_dealt_alike_and_only_where_the_ship_can_have_them() -> None:
    hands = deal("strangers", 2 * len(STRANGERS), np.random.default_rng(0))
    dealt = {(hand.effects[0][0].name, hand.effects[0][1]) for hand in hands}
    assert len(dealt) == len(hands) and {level for _, level in dealt} == {"medium", "strong"}
    assert {hand.kind for hand in hands} == {"foreign"}
    left = deal("strangers", 200, np.random.default_rng(0), WORLDS["kvlcc2"].without)
    assert {hand.effects[0][0].name for hand in left} == {e.name for e in STRANGERS} - {"lee_of_a_wall"}
    assert {h.effects[0][0].name for h in deal("foreign", 200, np.random.default_rng(0))} == {e.name for e in FOREIGN}


def form_columns(s: SimpleNamespace) -> dict[str, np.ndarray]:
    """Products of state, inputs and wind as a dictionary of unnamed forces would hold them."""
    a = np.hypot(s.a_x, s.a_y)
    named = {"u": s.u, "v": s.v, "r": s.r, "n": s.n, "delta": s.delta, "|v|": np.abs(s.v), "|r|": np.abs(s.r)}
    pairs = {f"{i} {j}": x * y for i, x in named.items() for j, y in named.items()}
    more = {
        "1": 0 * s.u + 1, "x": s.x, "y": s.y, "t": s.t, "u|u|": s.u * np.abs(s.u), "uuu": s.u**3,
        "back": np.minimum(s.n, 0), "delta nn": s.delta * s.n**2, "delta uu": s.delta * s.u**2,
        "delta|delta|": s.delta * np.abs(s.delta), "cos": np.cos(s.psi), "sin": np.sin(s.psi),
        "cos 2": np.cos(2 * s.psi), "sin 2": np.sin(2 * s.psi), "air x": s.a_x * a, "air y": s.a_y * a,
        "air xy": s.a_x * s.a_y,
    }  # fmt: skip
    return named | pairs | more


def test_no_single_form_spells_a_stranger() -> None:
    """Of random states no product of two of them, nor the action of an input by a shape, goes with its force."""
    rng, count = np.random.default_rng(6), 4000
    world = WORLDS["pond"]
    particulars, nominal = scaled_ship(world)
    u, v, r = rng.uniform(0.02, 0.45, count), rng.uniform(-0.12, 0.12, count), rng.uniform(-0.06, 0.06, count)
    six = [*rng.normal(0, 6, (2, count)), rng.uniform(-3.1, 3.1, count), u, v, r]
    n, delta, t = rng.uniform(4, 12, count), np.radians(rng.uniform(-35, 35, count)), rng.uniform(0, 150, count)
    north, east = rng.normal(0, 1.5, (2, count))

    def force(effects: list[tuple[Effect, Drawn]], off: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        plant = plant_of(particulars, [nominal], [effects], count, world)
        memory = rng.normal(0, 0.3, (plant.states, count))
        real = n + off[0], delta + off[1]
        for effect, e in plant.effects:
            real = effect.actuators(real[0][None], real[1][None], 0, 0.05, e, {})
        parts, *_ = parts_of(plant, np.vstack([*six, memory]), (*real, north, east), t)
        return np.stack([sum(part[i] for part in parts.values()) for i in range(3)])

    cosine, sine = np.cos(six[2]), np.sin(six[2])
    air = {"a_x": north * cosine + east * sine - u, "a_y": east * cosine - north * sine - v}
    at = SimpleNamespace(x=six[0], y=six[1], psi=six[2], u=u, v=v, r=r, n=n, delta=delta, t=t, **air)
    forms, plain = form_columns(at), force([])
    actions = [force([], off) - plain for off in ((1e-3, 0.0), (0.0, 1e-4))]
    shapes = [forms[k] for k in ("1", "u", "v", "r", "|r|", "delta", "n")]
    spelled = {}
    for effect in (*FOREIGN, *NEW):
        change = force([(effect, effect.draw("medium", rng, count))]) - plain
        main = int(np.argmax(np.abs(change).mean(axis=1) / np.array([0.05, 0.2, 0.15])))
        columns = [*forms.values(), *(action[main] * shape for action in actions for shape in shapes)]
        if np.abs(change).max() > 1e-9:  # else it is in the past of the actuators, or in the sensors
            spelled[effect.name] = max(abs(np.corrcoef(change[main], c)[0, 1]) for c in columns if c.std() > 0)
    assert spelled.pop(SPELLED[0]) > 0.999
    assert len(spelled) > 20 and max(spelled.values()) < 0.97, spelled
    assert not {effect.name for effect in STRANGERS} & {*PACKAGE_EFFECTS, *SPELLED}


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.parametrize("name", ("rudder_rate_limit", "jammed_bearing", "steering_dropout"))
def test_no_single_delay_spells_a_slow_rudder(name: str) -> None:
    _, runs = with_each_effect()
    B = alone().plant.runs
    i = 1 + [effect.name for effect in EFFECTS].index(name)
    logged = runs.delta[:, i * B : (i + 1) * B]
    off = runs.signals.delta[:: SHORTER.every, i * B : (i + 1) * B] - logged
    for seconds in (0.5, 1.0, 2.0, 4.0):
        late = np.maximum(np.arange(len(logged)) - round(seconds / SHORTER.sample), 0)
        assert abs(np.corrcoef(off.ravel(), (logged[late] - logged).ravel())[0, 1]) < 0.95
