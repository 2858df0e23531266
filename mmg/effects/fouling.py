"""Fouling: the resistance is larger by a share, that of the hull in straight motion at the same speed."""

from __future__ import annotations

from types import SimpleNamespace

from mmg.components import module
from mmg.effects.effect import Effect, Parameter
from mmg.flow import Flow, Force
from mmg.memory import Memory
from mmg.smooth import Smoothing


class Fouling(Effect):
    """Larger resistance."""

    name, enters, needs = "fouling", "force", ("hull",)

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return (Parameter("share", 0.0, 0.3, -0.6, 5.0, "", "resistance larger by this share"),)

    def forces(
        self,
        parts: dict[str, Force],
        flow: Flow,
        memory: Memory,
        e: SimpleNamespace,
        p: SimpleNamespace,
        ship: SimpleNamespace,
        s: Smoothing,
    ) -> dict[str, Force]:
        hull = module("hull", ship.components["hull"])
        resistance = hull.force(flow.with_(v=0.0, r=0.0, delta=0.0), p, ship.c, s).X
        old = parts["hull"]
        return {**parts, "hull": Force(old.X + e.share * resistance, old.Y, old.N)}


EFFECT = Fouling()
