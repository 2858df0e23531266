"""Log scale: the logged speed ahead u is off by a share."""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Columns, Effect, Parameter
from mmg.motion.flow import Flow
from mmg.motion.memory import Memory


class LogScale(Effect):
    """Gain error of the log."""

    name, enters = "log_scale", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return (Parameter("share", 0.0, 0.01, -0.5, 0.5, "", "logged u larger than the true one by this share"),)

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        return [y[0], y[1], y[2], y[3] * (1 + e.share), y[4], y[5]]
