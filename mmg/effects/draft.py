"""Draft: the ship lies deeper by a share than its file says, so draught, mass and hull forces are larger by it.

The primed coefficients stay as they are: hull forces scale with L d, added masses with L^2 d.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter


class Draft(Effect):
    """Larger draught."""

    name, enters = "draft", "particulars: draught and mass, thus inertia and hull forces"
    form_error = 0.03

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return (Parameter("share", 0.0, 0.1, -0.6, 1.5, "", "draught and mass larger by this share"),)

    def particulars(self, p: SimpleNamespace, e: SimpleNamespace) -> SimpleNamespace:
        return SimpleNamespace(**{**vars(p), "d": p.d * (1 + e.share), "m": p.m * (1 + e.share)})
