"""Shallow water: hull forces and added masses grow with draught over depth, everywhere or beyond a shelf line.

Each is multiplied by 1 + a g, g = (d/h) / (1 - d/h), with one a per quantity (GROWTH; own form,
UNVERIFIED numbers chosen so that added mass in sway doubles at about h/d = 1.6; published factors are
in ``benchmarks/shallow_factors.py`` of 5f878e7). Beyond the shelf line means x cos(bearing) + y sin(bearing) > line.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.rigid_body import Inertia
from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

# Growth [-] of hull forces and added masses with g; UNVERIFIED: added mass in sway doubles at about h/d = 1.6.
GROWTH = {"X": 0.15, "Y": 0.5, "N": 0.5, "m_x": 0.2, "m_y": 0.65, "J_z": 0.3}

EVERYWHERE = -1e6  # Line [m] of a shelf that is under the whole area. Set by hand: farther than any trial goes.


def growth(flow: Flow, e: SimpleNamespace) -> Any:
    """g at the ship's place. flow: where the ship is; e: parameters."""
    beyond = flow.x * ca.cos(e.bearing) + flow.y * ca.sin(e.bearing) - e.line
    ratio = e.d_h * 0.5 * (1 + ca.tanh(beyond / e.width))
    return ratio / (1 - ratio)


class ShallowWater(Effect):
    """Finite depth."""

    name, enters, needs = "shallow_water", "force and inertia", ("hull",)
    surroundings = True
    form_error = 0.03

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return (
            Parameter("d_h", 0.0, 0.3, -0.5, 0.9, "", "draught over depth of the water", least=0.0),
            Parameter("line", EVERYWHERE, p.L, -2e6, 2e6, "m", "shelf line from the origin along bearing", held=True),
            Parameter("bearing", 0.0, 0.1, -7.0, 7.0, "rad", "direction from deep to shallow water", held=True),
            Parameter("width", 0.5 * p.L, 0.2 * p.L, 0.01 * p.L, 100 * p.L, "m", "width of the shelf", held=True),
        )

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        g, old = growth(flow, e), parts["hull"]
        X, Y, N = (1 + GROWTH[axis] * g for axis in ("X", "Y", "N"))
        return {**parts, "hull": Force(X * old.X, Y * old.Y, N * old.N)}

    def inertia(self, inertia: Inertia, flow: Flow, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Inertia:
        g = growth(flow, e)
        # I_z of the ship herself about midship, radius of gyration L / 4: what remains is the added inertia J_z
        hull = 0.0625 * p.L**2 * p.m + p.x_G**2 * p.m
        return replace(
            inertia,
            m_x=inertia.m_x * (1 + GROWTH["m_x"] * g),
            m_y=inertia.m_y * (1 + GROWTH["m_y"] * g),
            I_z=inertia.I_z + GROWTH["J_z"] * g * (inertia.I_z - hull),
        )
