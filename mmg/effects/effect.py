"""What an effect is: parameters with a neutral value, and where it enters the model.

An effect is one file of this folder: a docstring with its physics, and a subclass of ``Effect`` that overrides the
hooks through which it enters. At its neutral value every hook returns what it was given, to the last bit. The same
object serves the synthetic generator, the fit and the diagnosis. In the hooks ``e`` holds the effect's parameters by
attribute, ``p`` the particulars.
"""

from __future__ import annotations

import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from mmg.components.coefficients import Coefficient
from mmg.components.rigid_body import Inertia
from mmg.errors import refusing
from mmg.motion.flow import Flow, Force
from mmg.motion.memory import Memory
from mmg.motion.smooth import Smoothing


@refusing
@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    neutral: the value at which the effect is absent; typical: a size that shows in a trial (an offset from neutral);
    lower, upper: bounds of a fit; held: not freed unless asked for by name (places, widths); form: of another form of
    the effect, which a diagnosis asks about in place of the usual one; least, most: what it can be in nature [unit],
    where a fit may go further: a diagnosis names nothing that is surely less or more; lost: by how much less than
    ``least`` it can be of a calibrated ship, which may have had and lost it; choice: which of two models holds (0 or
    1), of which no data tell a size.
    """

    symbol: str
    neutral: float
    typical: float
    lower: float
    upper: float
    unit: str
    description: str
    held: bool = False
    form: str = ""
    least: float = -math.inf
    most: float = math.inf
    lost: float = 0.0
    choice: bool = False

    def coefficient(self, effect: str) -> Coefficient:
        """The coefficient ``effect.symbol`` of a ship, at its neutral value, with a wide prior."""
        return Coefficient(
            symbol=f"{effect}.{self.symbol}",
            value=self.neutral,
            std=3.0 * abs(self.typical),
            lower=self.lower,
            upper=self.upper,
            unit=self.unit,
            fixed=self.held,
            source="neutral value of the effect",
            description=self.description,
        )


Columns = list[Any]  # The columns x, y, psi, u, v, r, as expressions or as samples (N,) each
Parts = dict[str, Force]  # Forces by role of the ship, and by name of the effect that adds one


@dataclass(frozen=True)
class Setting:
    """What a force may look at besides the flow.

    p: particulars; components: force models by role; c: coefficients of the ship; memory, s: of the model.
    """

    p: SimpleNamespace
    components: Mapping[str, str]
    c: SimpleNamespace
    memory: Memory
    s: Smoothing


class Effect(ABC):
    """An effect that enters nowhere: the base of all others."""

    name: str = ""
    enters: str = ""  # where: "inflow", "force", "inertia", "actuator path" or "measurement", in words
    needs_time: bool = False  # whether it changes with the time [s] since the start of a run
    needs: tuple[str, ...] = ()  # roles that the ship must have
    surroundings: bool = False  # whether it belongs to a place or a day, not to the ship
    # Standard uncertainty of its sizes, as a share of them, since its formula is one of several that are possible:
    # beside what the trials leave open. No published value: chosen by the misses of ``benchmarks.blind`` on development
    # seeds, whose generator has shapes of its own, so that its coverage is no test of them.
    form_error: float = 0.0
    moves: tuple[str, ...] = ()  # inputs that ``acted`` moves: of an effect of one parameter, a time
    acts_before: bool = False  # whether a negative time has a meaning: inputs that act before they are logged

    @property
    def summary(self) -> str:
        """What it is, with its equations and their source: the docstring of its file, which begins with a sentence."""
        return (sys.modules[type(self).__module__].__doc__ or "").strip().replace("``", "")

    @property
    def measures(self) -> bool:
        """Whether it belongs to the instruments: it enters in ``columns`` alone."""
        return self.enters == "measurement"

    def lacking(self, components: Mapping[str, str]) -> str:
        """What a ship of these force models, by role, lacks for it, in words with their article; "" for nothing."""
        role = next((role for role in self.needs if role not in components), "")
        return f"a {role} model" if role else ""

    @abstractmethod
    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        """Parameters for a ship of these particulars and force models."""

    def particulars(self, p: SimpleNamespace, e: SimpleNamespace) -> SimpleNamespace:
        """The particulars as the ship really is."""
        return p

    def water(self, flow: Flow, e: SimpleNamespace) -> tuple[Any, Any, Any, Any] | None:
        """Velocity of the water over ground, north and east [m/s], and its rates [m/s^2]."""
        return None

    def air(self, north: Any, east: Any, e: SimpleNamespace) -> tuple[Any, Any]:
        """Velocity of the air over ground [m/s] from the logged one."""
        return north, east

    def actuators(self, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Flow:
        """The actuators as they are, from the logged ones."""
        return flow

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        """Forces by role, changed or added to."""
        return parts

    def inertia(self, inertia: Inertia, flow: Flow, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Inertia:
        """Masses as they really are."""
        return inertia

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        """The columns as logged, from the true ones (or those of an earlier effect)."""
        return y

    def acted(self, record: np.ndarray, step: float, time: float) -> np.ndarray:
        """Records of the inputs ``moves`` as they act, exactly: in place of ``actuators``, which a fit needs.

        record: (N, ...) means over parts of a ``step`` [s]; time: its parameter [s]. Returns (N, ...). What was before
        the first part is taken as that.
        """
        return record

    def input_delay(self, e: SimpleNamespace) -> float | None:
        """Time [s] by which the generator holds back rudder and revolutions, exactly, in place of ``actuators``."""
        return None

    def samples(self, t: np.ndarray, y: Columns, flow: Flow, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        """``columns`` of the generator: at its samples t (N,) [s], exact where those of a fit remember and approximate.

        To be overridden by an effect whose ``columns`` need a memory.
        """
        return self.columns(y, flow, Memory(), e, p)

    def corrected(self, t: np.ndarray, y: Columns, e: SimpleNamespace, p: SimpleNamespace) -> Columns | None:
        """The true columns from logged samples (N,) at t (N,) [s], None where that takes more than the samples."""
        return None
