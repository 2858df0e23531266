"""An effect of a user: a function that is one hook of ``Effect``."""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from types import SimpleNamespace
from typing import Any, ClassVar

from mmg.components.catalogue import as_force
from mmg.components.own import Own
from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow

# Where an effect enters -> the method of ``Effect`` whose arguments, but for self, the function takes.
HOOKS = {
    "force": "forces",
    "inflow": "water",
    "air": "air",
    "actuator path": "actuators",
    "inertia": "inertia",
    "particulars": "particulars",
    "measurement": "columns",
}


class OwnEffect(Own, Effect):
    """An effect that is a function of a user.

    function: with the arguments of the hook of HOOKS for ``enters``; one that enters as a force may also return X, Y
    [N], N [N m], which are added to the others. rows: its parameters. needs, surroundings: as of ``Effect``.
    """

    stated: ClassVar[tuple[str, ...]] = (*Own.stated, "enters", "rows", "needs", "surroundings")
    rows: tuple[Parameter, ...]

    def __init__(self, function: Callable[..., Any], **stated: Any) -> None:
        super().__init__(function, **stated)
        # on the instance, where it stands before the hook of the class
        setattr(self, HOOKS[self.enters], self._forces if self.enters == "force" else function)

    @property
    def names(self) -> MutableMapping[str, Any]:
        """The effects."""
        from mmg.effects import EFFECTS  # late: they find this one there

        return EFFECTS

    @property
    def summary(self) -> str:
        """The docstring of the function, which begins with a sentence."""
        return (self.function.__doc__ or f"{self.name.replace('_', ' ')}, an effect of {self.origin}").strip()

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return self.rows

    def _forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        """The forces by role, as the function changed them or with what it adds."""
        result = self.function(parts, flow, e, at)
        return result if isinstance(result, dict) else {**parts, self.name: as_force(result, f"effect {self.name}")}
