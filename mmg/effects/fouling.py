"""Fouling: the resistance is larger by a share, that of the hull in straight motion at the same speed."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

from mmg.components.catalogue import module
from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force

REPORTED = 1.0  # Heavy calcareous fouling costs a frigate up to 86 % of her power (Schultz 2007, Biofouling 23:331-341)


class Fouling(Effect):
    """Larger resistance."""

    name, enters, needs = "fouling", "force", ("hull",)
    form_error = 0.03

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        words = "resistance larger by this share"
        lost = REPORTED / (1 + REPORTED)  # by a ship that was calibrated as foul as any and is clean now
        return (Parameter("share", 0.0, 0.3, -0.6, 5.0, "", words, least=0.0, lost=lost),)

    def lacking(self, components: Mapping[str, str]) -> str:
        # such a hull's X in straight motion is resistance less thrust: zero at the service speed
        inside = "hull" in components and "propeller" in getattr(module("hull", components["hull"]), "HOLDS", ())
        return "a resistance apart from the propeller's thrust" if inside else super().lacking(components)

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        hull = module("hull", at.components["hull"])
        # straight motion at the same u; delta counts in hulls that hold the rudder
        resistance = hull.force(flow.with_(v=0.0, r=0.0, delta=0.0), at.p, at.c, at.s).X
        old = parts["hull"]
        return {**parts, "hull": Force(old.X + e.share * resistance, old.Y, old.N)}
