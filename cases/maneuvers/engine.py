"""The main engine of a ship that is stopped or reversed: the revolutions that follow an order, by the torques.

2 pi I n' = Q_E - Q_P - Q_F, made dimensionless by the torque Q_MCR at maximum continuous rating. The propeller's torque
Q_P is that of the four-quadrant series of van Lammeren et al. (1969), scaled so that it is (n / n_MCR)^2 in the steady
approach (propeller law); its advance ratios are those of the ship's propeller, by where her thrust is zero.

A direct-reversible engine obeys an order astern in steps. After ``delay`` the fuel is cut, and the propeller turns on
in the wake (windmilling). Only when it has slowed to ``restart`` of n_MCR starting air can brake it; engines do so at
20 to 40 % (Mariner's Voice 2021, "crash stop"). Then the engine fires astern, and its revolutions rise at n_MCR in
``rise`` as far as its torque reaches, up to ``astern_revolutions`` of n_MCR: class rules ask for 70 % of the
revolutions ahead (IACS UR M25 as quoted, UNVERIFIED). A motor ship of 14,000 t is reversed after about 3 minutes and
runs at 60 % of her power after about 5 (Knowledge of Sea, "emergency stop manoeuvre").
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mmg.components.particulars import ENGINE
from mmg.components.propeller.four_quadrant import A_Q, A_T, B_Q, B_T
from mmg.errors import OutOfRange
from mmg.ship import Ship

SMALLEST = 50.0
"""Length [m] from which a ship is taken to have a diesel engine; shorter ones are models with an electric motor."""
MCR = 0.965
"""Revolutions at U_0 by n_MCR where the ship file gives none: 90 % of the power, by the propeller law."""
FRICTION, AIR, GAIN = 0.05, 0.4, 8.0
"""Of the shaft line and the starting air, in Q_MCR; of the governor, in Q_MCR by n_MCR: estimates of this library."""
STEP = 0.25
"""Integration step of the shaft [s]."""

USUAL: Mapping[str, tuple[float, float, float, float]] = {
    "engine_delay": (10.0, 5.0, 0.0, 600.0),
    "restart": (0.30, 0.06, 0.01, 1.0),
    "astern_revolutions": (0.70, 0.08, 0.05, 1.2),
    "astern_torque": (0.80, 0.12, 0.05, 2.0),
    "engine_rise": (60.0, 25.0, 0.1, 1800.0),
    "engine_inertia": (3.0, 0.8, 0.2, 100.0),
}
"""Particular of a ship file -> what is assumed where it is not given, its standard deviation, and what it may be."""

_ANGLES = np.linspace(-math.pi, math.pi, 1441)


def _series(A: tuple[float, ...], B: tuple[float, ...]) -> np.ndarray:
    """C*(beta) of van Lammeren et al. (1969) at ``_ANGLES``."""
    k = np.arange(len(A))[:, None]
    return np.asarray(np.array(A) @ np.cos(k * _ANGLES) + np.array(B) @ np.sin(k * _ANGLES))


_TORQUE = _series(A_Q, B_Q)
_FIRST = (_ANGLES > 0.1) & (_ANGLES < 0.9)
ZERO_THRUST = 0.7 * math.pi * math.tan(float(np.interp(0.0, -_series(A_T, B_T)[_FIRST], _ANGLES[_FIRST])))
"""Advance ratio of the series at which its thrust is zero [-]."""


@dataclass(frozen=True)
class Engine:
    """An engine, or M of them: numbers, or arrays (M,).

    n_mcr: revolutions at maximum continuous rating [1/s]; speed [m/s], n [1/s]: of the approach, where its torque is
    known; advance: tangent of the advance angle there, on the scale of the series; engine_delay: from the order until
    the fuel is cut [s]; restart: share of n_mcr below which air brakes; astern_revolutions, astern_torque: most astern,
    shares of n_mcr and Q_MCR; engine_rise: time in which the revolutions may rise by n_mcr [s]; engine_inertia:
    2 pi I n_mcr / Q_MCR [s]; assumed: particulars that the ship file does not give.
    """

    n_mcr: float
    speed: float
    n: float
    advance: float
    engine_delay: float | np.ndarray
    restart: float | np.ndarray
    astern_revolutions: float | np.ndarray
    astern_torque: float | np.ndarray
    engine_rise: float | np.ndarray
    engine_inertia: float | np.ndarray
    assumed: tuple[str, ...] = ()

    def drawn(self, count: int, seed: int, itself: bool = False) -> Engine:
        """``count`` engines, (count,) each: what is assumed is drawn from its normal distribution within its limits.
        seed: of the draws; itself: goes first, as one more."""
        rng = np.random.default_rng([31, seed])
        values: dict[str, Any] = {}
        for name, (_, std, low, high) in USUAL.items():
            draw = rng.standard_normal(count)
            own = np.full(count, float(getattr(self, name)))
            values[name] = np.clip(own + std * draw, low, high) if name in self.assumed else own
            if itself:
                values[name] = np.append(own[:1], values[name])
        return replace(self, **values)

    def repeated(self, copies: int) -> Engine:
        """The M engines one after the other, ``copies`` times: (copies M,)."""
        tiled: dict[str, Any] = {n: np.tile(np.atleast_1d(getattr(self, n)), copies) for n in USUAL}
        return replace(self, **tiled)

    def torque(self, share: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Q_P / Q_MCR (M,) at n = ``share`` n_mcr and u [m/s], (M,) each."""
        a = self.n / self.n_mcr
        x, y = share / a, self.advance * u / self.speed
        full = float(np.interp(math.atan(self.advance), _ANGLES, _TORQUE)) * (1 + self.advance**2)
        return np.asarray(a * a * (x * x + y * y) * np.interp(np.arctan2(y, x), _ANGLES, _TORQUE) / full)

    def shaft(self, ships: int = 1) -> Shaft:
        """The shaft lines of so many ``ships``, turning at the approach."""
        return Shaft(self, np.full(ships, self.n / self.n_mcr))


@dataclass(frozen=True)
class Shaft:
    """M shaft lines at a moment. share: n / n_mcr (M,); waited: time since the order [s], below 0 before it; ran: time
    for which each engine has run as ordered [s] (M,), below 0 before."""

    engine: Engine
    share: np.ndarray
    waited: float = -1.0
    ran: np.ndarray = field(default_factory=lambda: np.array(-1.0))

    @property
    def n(self) -> np.ndarray:
        """Revolutions (M,) [1/s]."""
        return self.share * self.engine.n_mcr

    def moved(self, order: float, u: np.ndarray, dt: float) -> tuple[Shaft, np.ndarray]:
        """The shafts after ``dt`` [s] under an ``order`` [1/s] at speeds u (M,) [m/s], and mean revolutions (M,) on the
        way. An order that is the approach's is held by the governor."""
        e, wanted = self.engine, order / self.engine.n_mcr
        if self.waited < 0 and math.isclose(order, e.n, rel_tol=1e-9):
            return self, self.n
        share, waited = self.share, max(self.waited, 0.0)
        ran = np.broadcast_to(self.ran, share.shape)
        parts = max(1, math.ceil(dt / STEP - 1e-9))
        h, total = dt / parts, np.zeros_like(share)
        limit = np.minimum(abs(wanted), e.astern_revolutions)
        for _ in range(parts):
            q_p = e.torque(share, u)
            begun = ran >= 0
            if wanted < 0:
                target = -np.minimum(limit, np.maximum(ran, 0.0) / e.engine_rise)
                running = np.clip(q_p - FRICTION + GAIN * (target - share), -np.asarray(e.astern_torque), 0.0)
                air = np.where(share <= e.restart, -AIR, 0.0)
                q_e = np.where(begun, running, air)
            else:
                q_e = np.zeros_like(share)
            rate = (q_e - q_p - FRICTION * np.tanh(share / 0.02)) / e.engine_inertia
            after = np.where(waited >= e.engine_delay, share + h * rate, share)
            ran = np.where(begun, ran + h, np.where((wanted < 0) & (after <= 0), 0.0, ran))
            total += 0.5 * h * (share + after)
            share, waited = after, waited + h
        return Shaft(e, share, waited, ran), total / dt * e.n_mcr


def engine_of(ship: Ship, speed: float, n: float) -> Engine | None:
    """The engine of a ``ship`` whose approach is at ``speed`` [m/s] with n [1/s]; None for a model, which has an
    electric motor, and for a ship without a propeller of fixed pitch on a shaft.

    The particulars of ``USUAL`` and n_MCR [1/s] may stand in the ship file; a ship that gives any of them has an
    engine whatever her length. Raises UserError for one that makes no sense.
    """
    p = ship.particulars
    given = [name for name in ENGINE if name in p]
    shafts = "n" in ship.actuators and "pitch" not in ship.actuators and "actuators" not in ship.components
    if not shafts or not (speed > 0 and n > 0) or (p["L"] < SMALLEST and not given):
        return None
    for name, (_, _, low, high) in USUAL.items():
        if name in p and not low <= p[name] <= high:
            raise OutOfRange(f"{ship.name}: {name} = {p[name]:g} must be between {low:g} and {high:g}")
    at_rating = n * p.get("U_0", speed) / speed / MCR  # by the propeller law: U_0 takes 90 % of the power
    n_mcr = p.get("n_MCR", 0.0) or at_rating
    if not 0.2 * n < n_mcr < 20 * n:
        raise OutOfRange(f"{ship.name}: n_MCR = {n_mcr:g} 1/s does not fit n = {n:.3g} 1/s at {speed:.3g} m/s")
    values = {name: p.get(name, usual[0]) for name, usual in USUAL.items()}
    assumed = tuple(name for name in USUAL if name not in p)
    return Engine(n_mcr=n_mcr, speed=speed, n=n, advance=_advance(ship, speed, n), assumed=assumed, **values)


def stopping_factors(ship: Ship) -> dict[str, float]:
    """Symbol -> factor on coefficients of the resistance where the ``ship`` is stopped: her particular
    ``stopping_resistance``, of a ship whose coefficients are those of a model at its own self-propulsion point.
    Raises UserError for a share that makes no sense.
    """
    share = ship.particulars.get("stopping_resistance", 1.0)
    if not 0.1 <= share <= 10:
        raise OutOfRange(f"{ship.name}: stopping_resistance = {share:g} must be between 0.1 and 10")
    return {} if share == 1.0 else {s: share for s in ("R_0", "X_0F") if s in ship.coefficients}


def engine_words(engine: Engine) -> str:
    """What is assumed of an ``engine``, in a sentence; "" where all is given."""
    if not engine.assumed:
        return ""
    units = {"engine_delay": " s", "engine_rise": " s", "engine_inertia": " s"}
    listed = ", ".join(f"{name} {getattr(engine, name):g}{units.get(name, '')}" for name in engine.assumed)
    return f"a direct-reversible diesel engine is assumed ({listed}; n_MCR {engine.n_mcr:.3g} 1/s)"


def _advance(ship: Ship, speed: float, n: float) -> float:
    """Tangent of the advance angle of the approach at ``speed`` [m/s] with ``n`` [1/s], on the scale of the series."""
    c = {symbol: one.value for symbol, one in ship.coefficients.items()}
    J = speed * (1 - c.get("w_P0", 0.0)) / (n * ship.particulars["D_P"])
    return J * ZERO_THRUST / _zero_thrust(ship, c) / (0.7 * math.pi)


def _zero_thrust(ship: Ship, c: Mapping[str, float]) -> float:
    """Advance ratio at which the thrust of the ship's propeller is zero, by her coefficients ``c`` or her pitch."""
    if {"k_0", "k_1", "k_2"} <= set(c):
        roots = np.roots([c["k_2"], c["k_1"], c["k_0"]])
        real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real
        if len(real):
            return float(real.min())
    if "k_J" in c:
        return ZERO_THRUST * c["k_J"]
    return ZERO_THRUST * ship.particulars.get("pitch_ratio", 0.75)
