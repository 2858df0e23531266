"""Propeller side force: side force and moment of the reversing propeller are those of the model times a factor.

A propeller model without a side force gets the factor on that of Hachii (2004) with its published coefficients
(mmg/components/propeller/hachii.py), of two screws each in the mirror of the other; its neutral factor is 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace

from mmg.components import twin
from mmg.components.catalogue import module, twin_screw
from mmg.components.propeller import hachii
from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force


class PropellerSideForce(Effect):
    """Propeller walk by a factor."""

    name, enters, needs = "propeller_side_force", "force", ("propeller",)
    form_error = 0.03

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        neutral = 1.0 if "propeller" in components and _has_side_force(components) else 0.0
        return (Parameter("factor", neutral, 1.0, -5.0, 10.0, "", "factor on side force and moment of the propeller"),)

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        old = parts["propeller"]
        if _has_side_force(at.components):
            new = Force(old.X, e.factor * old.Y, e.factor * old.N)  # the rudder has had its slipstream by now
        else:
            pitched = SimpleNamespace(**{"pitch_ratio": 0.7, **vars(at.p)})  # 0.7: set by hand, where she has none
            published = SimpleNamespace(**{row.symbol: row.value for row in hachii.COEFFICIENTS})
            flows = twin.mirrored_flows(flow, at.p) if twin_screw(vars(at.p)) else (flow,)
            # without their thrusts, whose moments are the model's own
            sides = [replace(hachii.force(each, pitched, published, at.s), X=0.0) for each in flows]
            side = twin.combined(sides[0], sides[1], at.p) if len(sides) == 2 else sides[0]
            new = Force(old.X, old.Y + e.factor * side.Y, old.N + e.factor * side.N)
        return {**parts, "propeller": new}


def _has_side_force(components: Mapping[str, str]) -> bool:
    return getattr(module("propeller", components["propeller"]), "SIDE_FORCE", False)
