"""What a model remembers besides its motion: lags, delays, play and rate limits, smooth for optimisation.

Effects and actuators ask a ``Memory`` for states; the assembled model integrates them with the six of the ship.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca


@dataclass
class Memory:
    """Internal states that effects and actuators ask for: each follows a target with a time constant.

    names, symbols: of the states; rates: their derivatives; targets: what they start from; sizes: their typical size.
    """

    names: list[str] = field(default_factory=list)
    symbols: list[ca.SX] = field(default_factory=list)
    rates: list[Any] = field(default_factory=list)
    targets: list[Any] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)

    def state(self, name: str, target: Any, size: float) -> ca.SX:
        """A new state that starts at ``target``; its rate is to be given by ``moves``."""
        self.names.append(name)
        self.symbols.append(ca.SX.sym(name))
        self.targets.append(target)
        self.sizes.append(size)
        return self.symbols[-1]

    def moves(self, *rates: Any) -> None:
        """The rates [1/s] of the newest states, in the order in which they were made."""
        self.rates.extend(rates)

    def low_pass(self, name: str, target: Any, time: Any, size: float) -> ca.SX:
        """A state that follows ``target`` with time constant ``time`` [s]."""
        state = self.state(name, target, size)
        self.moves((target - state) / time)
        return state


def lagged(memory: Memory, name: str, x: Any, T: Any, least: float, size: float) -> Any:
    """x after a first-order lag of T >= 0 [s]: exactly x at T = 0, and smooth in T there.

    (1 - kappa) x + kappa x_tau with x_tau lagged by tau = sqrt(T^2 + least^2) and kappa = T / tau, so the mean lag is
    T and no time constant is shorter than ``least`` [s], which an explicit integrator needs.
    memory, name, size: of the state.
    """
    tau = ca.sqrt(T * T + least * least)  # never shorter, and with a slope of 0 in T at T = 0
    return x - T / tau * (x - memory.low_pass(name, x, tau, size))


def delayed(memory: Memory, name: str, x: Any, T: Any, least: float, size: float) -> Any:
    """x after a delay of T >= 0 [s], by the all-pass (1 - tau s / 2) / (1 + tau s / 2) (Pade), mixed as in ``lagged``.

    Phase and amplitude are those of the delay up to frequencies of about 1 / T; steps get a short kick the wrong way.
    memory, name, size: of the state; least: as there [s].
    """
    tau = ca.sqrt(T * T + least * least)
    # x - 2 (x - x_lp) is (1 - tau s / 2) / (1 + tau s / 2) x for the low pass of tau / 2
    return x - 2 * T / tau * (x - memory.low_pass(name, x, 0.5 * tau, size))


# Doublings of the power q = 2^k of the clip x b / (|x|^q + b^q)^(1/q), 16 and 32: of a play, and of what draws the
# remembered position along. Set by hand; the second must be sharper, or the remembered position would creep back inside
# the play.
SHARP, SHARPER = 4, 5


def clip(x: Any, b: Any, softest: float, doublings: int = SHARP) -> Any:
    """x limited to +-b, smooth, exactly zero for b = 0; ``softest`` is the size of x that keeps it smooth there.
    doublings: k of the power 2^k, which squares and square roots make faster than a library's power."""
    power, of_b = (x / softest) ** 2, (b / softest) ** 2  # squares first: even, so that no |x| is needed
    for _ in range(doublings - 1):
        power, of_b = power * power, of_b * of_b
    root = power + of_b + 1.0  # 1: no root of zero, whose slope is infinite
    for _ in range(doublings):
        root = ca.sqrt(root)
    return b * x / softest / root


def played(memory: Memory, name: str, x: Any, b: Any, time: float, softest: float, size: float) -> Any:
    """x behind a play (backlash) of half width b >= 0: rests until x has moved by b off its middle; x at b = 0.

    The result is x less the smooth clip of its distance to a remembered position, which is drawn along, within
    about ``time`` [s], once the distance exceeds b. memory, name, size: of the state; softest: as for ``clip``.
    """
    position = memory.state(name, x, size)
    memory.moves((x - position - clip(x - position, b, softest, SHARPER)) / time)
    return x - clip(x - position, b, softest)


def rate_limited(memory: Memory, name: str, x: Any, rate: Any, time: Any, size: float) -> Any:
    """A position that follows x with y' = rate tanh((x - y) / (rate time)): at most ``rate`` [1/s], near x as a lag.

    Smooth form of the sloped step of Wakita et al. (2025, Eqs. 39-40); ``time`` [s] is the lag near x.
    memory, name, size: of the state.
    """
    y = memory.state(name, x, size)
    memory.moves(rate * ca.tanh((x - y) / (rate * time)))
    return y
