"""The ship as a co-simulation wants it: the current is an input, a delay of the actuators is left to the wrapper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import casadi as ca

from delivery.product import Product, ProductCoefficient
from mmg.effects import effect
from mmg.errors import Unsupported
from mmg.model import Model, assemble
from mmg.ship import AIR, Ship

# Inputs in place of the coefficients CURRENT: velocity of the water over ground [m/s].
WATER = ("current_north", "current_east")
CURRENT = ("current.x", "current.y")
RATES = ("current.x_rate", "current.y_rate")  # Of a current that changes with the time, [m/s^2]
TIME = "time"
LATE_LOG, AXES = "velocity_filter.tau", "velocity_filter.body_axes"
# Effects of instruments with which the lateness of the logged velocity is exact: none acts before it.
AFTER_LATE = ("velocity_filter", "heading_bias", "log_scale", "gyro")


def _logs_late_alone(ship: Ship) -> bool:
    """Whether the logged velocity of ``ship`` is late and all else that its instruments do depends on the moment."""
    measuring = [name for name in ship.effects if effect(name).measures]
    gyro = ship.coefficients.get("gyro.T")
    # the wrapper delays the velocity in axes of the earth
    late = "velocity_filter" in measuring and ship.coefficients[AXES].value == 0
    return late and set(measuring) <= set(AFTER_LATE) and (gyro is None or gyro.value == 0)


@dataclass(frozen=True, eq=False)
class CoSimulatedShip(Product):
    """A product whose model has the current among its inputs and no delay of its actuators.

    plain: the product as it was given. water: current [m/s] north, east at which these inputs start. late: the
    coefficient of the delay of the actuators that was taken out, or None; late_log: that of the logged velocity.
    steady: whether the current has no rates of its own.
    """

    plain: Product
    water: tuple[float, float]
    late: ProductCoefficient | None
    late_log: ProductCoefficient | None
    steady: bool

    @classmethod
    def of(cls, product: Product) -> CoSimulatedShip:
        """The co-simulated form of a ``product``. Raises UserError where two effects delay the actuators."""
        ship, late, coefficients = product.ship, None, {c.symbol: c for c in product.coefficients}
        for name in ship.effects:
            if effect(name).input_delay(ship.parameters_of(name)) is None:
                continue
            symbols = [symbol for symbol in ship.coefficients if symbol.startswith(f"{name}.")]
            if late is not None or len(symbols) != 1:  # the wrapper has one queue of inputs, by one coefficient
                raise Unsupported(f"the effect {name}: an FMU holds one delay of the actuators; use --without")
            late, ship = coefficients[symbols[0]], ship.without_effect(name)
        late_log = None
        if _logs_late_alone(ship):
            late_log, ship = coefficients[LATE_LOG], ship.without_effect(LATE_LOG.split(".")[0])
        steady = "current" not in ship.effects  # else the effect keeps its rates, and the inputs start at its values
        ship = ship.with_effect("current") if steady else ship
        x, y = (ship.coefficients[symbol].value for symbol in CURRENT)
        given = {f.name: getattr(product, f.name) for f in fields(Product)}
        return cls(**{**given, "ship": ship}, plain=product, water=(x, y), late=late, late_log=late_log, steady=steady)

    @cached_property
    def model(self) -> Model:
        return self.model_of(self.ship)

    def model_of(self, ship: Ship) -> Model:
        """The model of ``ship``, this one or its form without network, with the inputs of ``inputs_of``."""
        model = assemble(ship)
        symbols = tuple(s for s in model.symbols if s not in CURRENT and not (self.steady and s in RATES))
        controls = self.inputs_of(model.controls)
        c, theta = ca.SX.sym("controls", len(controls)), ca.SX.sym("coefficients", len(symbols))
        inputs = dict(zip(controls, ca.vertsplit(c), strict=True))
        values = dict(zip(symbols, ca.vertsplit(theta), strict=True))
        values |= dict(zip(CURRENT, (inputs[name] for name in WATER), strict=True))
        # arguments of the ship's own functions; zero is what these lack: the time, and the rates of a steady current
        old_c = ca.vertcat(*[inputs.get(name, ca.SX(0)) for name in model.controls])
        old_theta = ca.vertcat(*[values.get(name, ca.SX(0)) for name in model.symbols])
        z, six = ca.SX.sym("state", len(model.states)), ca.SX.sym("state", 6)

        def changed(function: ca.Function) -> ca.Function:
            name, state = function.name(), six if function.name() == "initial" else z
            if name == "columns":
                return ca.Function(name, [z, theta], [function(z, old_theta)], {"cse": True})
            return ca.Function(name, [state, c, theta], [function(state, old_c, old_theta)], {"cse": True})

        names = ("rates", "forces", "initial", "columns", "features")  # of ``Model``, all that take coefficients
        functions: dict[str, Any] = {name: changed(getattr(model, name)) for name in names}
        return replace(model, symbols=symbols, controls=controls, **functions)

    def inputs_of(self, names: Sequence[str]) -> tuple[str, ...]:
        """Inputs of the model: actuators, air, water, and the time where an effect besides the current needs it.
        names: those of the ship."""
        others = [name for name in self.ship.effects if name != "current" or not self.steady]
        timed = (TIME,) if any(effect(name).needs_time for name in others) else ()
        return (*(name for name in names if name not in (*AIR, TIME)), *AIR, *WATER, *timed)

    @property
    def late_columns(self) -> list[str]:
        """Effects of its instruments that log late, which the model of the columns approximates."""
        instruments = [name for name in self.ship.effects if effect(name).measures]
        late = [name for name in instruments if any(state.startswith(f"{name}.") for state in self.model.states)]
        gyro = self.ship.coefficients.get("gyro.T")
        return [name for name in late if name != "gyro" or gyro is None or gyro.value != 0]

    @property
    def delays(self) -> tuple[ProductCoefficient, ...]:
        """Coefficients of delays that are not in the model but in the wrapper."""
        return tuple(c for c in (self.late, self.late_log) if c is not None)

    @property
    def coefficients(self) -> tuple[ProductCoefficient, ...]:
        kept = set(self.model.symbols)
        return tuple(c for c in super().coefficients if c.symbol in kept)
