"""Self-propulsion: the revolutions that hold a speed, and the speed they give, by a ship's surge balance; and the main
engine of a ship that is stopped or reversed: the revolutions that follow an order, by the torques.

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
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from cases.shipfiles.particulars import BY_RULE
from mmg.components.coefficients import ENGINE
from mmg.components.propeller.four_quadrant import A_Q, A_T, B_Q, B_T
from mmg.errors import Conflict, Missing, NoSolution, OutOfRange
from mmg.model import assemble
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

# Length [m] from which a ship is taken to have a diesel engine; shorter ones are models with an electric motor.
SMALLEST = 50.0  # set by hand
# Revolutions at U_0 by n_MCR where the ship file gives none: 90 % of the power, by the propeller law. Set by hand:
# .9^(1/3).
MCR = 0.965
# Of the shaft line and the starting air, in Q_MCR; of the governor, in Q_MCR by n_MCR: estimates of this library.
FRICTION, AIR, GAIN = 0.05, 0.4, 8.0  # set by hand
STEP = 0.25  # Integration step of the shaft [s]. Set by hand.
# Particular of a ship file -> what is assumed where it is not given (see above), its standard deviation, and what it
# may be: these are set by hand.
USUAL: Mapping[str, tuple[float, float, float, float]] = {
    "engine_delay": (10.0, 5.0, 0.0, 600.0),
    "restart": (0.30, 0.06, 0.01, 1.0),
    "astern_revolutions": (0.70, 0.08, 0.05, 1.2),
    "astern_torque": (0.80, 0.12, 0.05, 2.0),
    "engine_rise": (60.0, 25.0, 0.1, 1800.0),
    "engine_inertia": (3.0, 0.8, 0.2, 100.0),
}
_ANGLES = np.linspace(-math.pi, math.pi, 1441)  # beta [rad], every quarter of a degree


def _series(A: tuple[float, ...], B: tuple[float, ...]) -> np.ndarray:
    """C*(beta) of van Lammeren et al. (1969) at ``_ANGLES``."""
    k = np.arange(len(A))[:, None]
    return np.asarray(np.array(A) @ np.cos(k * _ANGLES) + np.array(B) @ np.sin(k * _ANGLES))


_TORQUE = _series(A_Q, B_Q)
_FIRST = (_ANGLES > 0.1) & (_ANGLES < 0.9)  # where the thrust of a propeller ahead falls through zero, once
# Advance ratio of the series at which its thrust is zero [-].
ZERO_THRUST = 0.7 * math.pi * math.tan(float(np.interp(0.0, -_series(A_T, B_T)[_FIRST], _ANGLES[_FIRST])))


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
            plain = np.full(count, float(getattr(self, name)))
            values[name] = np.clip(plain + std * draw, low, high) if name in self.assumed else plain
            if itself:
                values[name] = np.append(plain[:1], values[name])
        return replace(self, **values)

    def repeated(self, copies: int) -> Engine:
        """The M engines one after the other, ``copies`` times: (copies M,)."""
        tiled: dict[str, Any] = {n: np.tile(np.atleast_1d(getattr(self, n)), copies) for n in USUAL}
        return replace(self, **tiled)

    def torque(self, share: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Q_P / Q_MCR (M,) at n = ``share`` n_mcr and u [m/s], (M,) each."""
        a = self.n / self.n_mcr
        # Q_P = 1/2 rho (u_a^2 + (0.7 pi n D)^2) (pi/4) D^3 C_Q*(beta), by its value in the approach (x = 1, u = speed)
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

    @np.errstate(over="ignore", invalid="ignore")  # of a drawn ship that runs away
    def moved(self, order: float, u: np.ndarray, dt: float) -> tuple[Shaft, np.ndarray]:
        """The shafts after ``dt`` [s] under an ``order`` [1/s] at speeds u (M,) [m/s], and mean revolutions (M,) on the
        way. An order that is the approach's is held by the governor."""
        e, wanted = self.engine, order / self.engine.n_mcr
        if self.waited < 0 and math.isclose(order, e.n, rel_tol=1e-9):
            return self, self.n
        share, waited = self.share, max(self.waited, 0.0)
        ran = np.broadcast_to(self.ran, share.shape)
        parts = max(1, math.ceil(dt / STEP - 1e-9))
        h, total = dt / parts, np.zeros_like(share)  # explicit Euler; the mean by the trapezoidal rule
        limit = np.minimum(abs(wanted), e.astern_revolutions)
        for _ in range(parts):
            q_p = e.torque(share, u)
            begun = ran >= 0
            if wanted < 0:
                target = -np.minimum(limit, np.maximum(ran, 0.0) / e.engine_rise)
                running = np.clip(q_p - FRICTION + GAIN * (target - share), -np.asarray(e.astern_torque), 0.0)
                air = np.where(share <= e.restart, -AIR, 0.0)
                q_e = np.where(begun, running, air)  # it fires once the shaft has stopped
            else:
                q_e = np.zeros_like(share)
            # friction is smooth about zero, so that a shaft that stands does not swing from step to step
            rate = (q_e - q_p - FRICTION * np.tanh(share / 0.02)) / e.engine_inertia
            after = np.where(waited >= e.engine_delay, share + h * rate, share)
            ran = np.where(begun, ran + h, np.where((wanted < 0) & (after <= 0), 0.0, ran))
            total += 0.5 * h * (share + after)
            share, waited = after, waited + h
        return Shaft(e, share, waited, ran), total / dt * e.n_mcr


def has_engine(ship: Ship) -> bool:
    """Whether a ``ship`` has an engine that is stopped or reversed: not a model, whose electric motor obeys at once,
    nor one without a propeller of fixed pitch on a shaft."""
    p = ship.particulars
    shafts = "n" in ship.actuators and "pitch" not in ship.actuators and "actuators" not in ship.components
    return shafts and (p["L"] >= SMALLEST or any(name in p for name in ENGINE))


def engine_of(ship: Ship, speed: float, n: float) -> Engine | None:
    """The engine of a ``ship`` whose approach is at ``speed`` [m/s] with n [1/s]; None for one that has none.

    The particulars of ``USUAL`` and n_MCR [1/s] may stand in the ship file; a ship that gives any of them has an
    engine whatever her length. Raises UserError for one that makes no sense.
    """
    p = ship.particulars
    if not (has_engine(ship) and speed > 0 and n > 0):
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
    ``stopping_resistance``, of a ship whose coefficients are those of a model at its own self-propulsion point. Raises
    UserError for a share that makes no sense."""
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
            return float(real.min())  # K_T = k_0 + k_1 J + k_2 J^2 falls from the bollard pull: its first zero counts
    if "k_J" in c:  # a model of the series itself, with its advance ratios scaled
        return ZERO_THRUST * c["k_J"]
    return ZERO_THRUST * ship.particulars.get("pitch_ratio", 0.75)


FROUDE = 0.07  # Froude number of the default approach: harbour speed, 7.7 kn for 320 m, 0.38 m/s for 3 m. Set by hand.
# Froude number of the test speed of a ship whose file gives none: 15.5 kn for 320 m. That of KVLCC2 at design speed
# (SIMMAN 2008).
TEST_FROUDE = 0.142
# Blade angle [rad] of a controllable-pitch propeller ahead, where the ship file gives no particular ``pitch``. Set by
# hand.
DESIGN_PITCH = math.radians(20.0)


def actuator_positions(ship: Ship, n: Any, delta: Any) -> dict[str, Any]:
    """Positions of all actuators under one order: both propellers and both rudders alike, thrusters at rest.

    A controllable-pitch propeller turns ahead all the time: its blades reverse instead, as far on the other side of
    the zero-thrust pitch. A ship without a propeller is
    driven by its azimuth thruster, which also steers where there is no rudder: aft of midship it pushes to port then.
    n [1/s], delta [rad]: numbers, or arrays of one shape; ship: gives the names.
    """
    positions: dict[str, Any] = dict.fromkeys(ship.actuators, 0.0)
    for name in positions:
        if name in ("n", "n_2"):
            positions[name] = abs(n) if "pitch" in positions else n
        elif name.startswith("delta"):
            positions[name] = delta
        elif name == "pitch":
            ahead, zero = ship.particulars.get("pitch", DESIGN_PITCH), ship.coefficients["theta_0"].value
            positions[name] = np.where(n >= 0, ahead, 2 * zero - ahead)
    rudders = any(name.startswith("delta") for name in positions)
    for name in [name for name in positions if name.startswith("n_azimuth") and "n" not in positions]:
        positions[name], angle = n, name.removeprefix("n_")
        if not rudders and angle in positions:
            place = ship.particulars.get(angle.replace("azimuth", "x_az"), -1.0)  # m ahead of midship
            positions[angle] = np.copysign(delta, delta * place)
    return positions


def surge_balance(ship: Ship) -> Callable[[float, float], float]:
    """Surge acceleration [m/s^2] of a ``ship`` at u [m/s] and n [1/s]: straight, rudder midships, calm, still water."""
    still = ship
    for name in ship.effects:
        still = still if name in ("fouling", "draft") else still.without_effect(name)
    model = assemble(still, symbols=())

    @cache  # the same speeds are asked for again and again
    def surge(u: float, n: float) -> float:
        positions = actuator_positions(still, n, 0.0)
        inputs = [float(positions.get(name, 0.0)) for name in still.inputs]
        return float(model.rates(model.initial([0.0, 0.0, 0.0, u, 0.0, 0.0], inputs, []), inputs, [])[3])

    return surge


def revolutions_for(ship: Ship, u: float) -> float:
    """Revolutions ahead [1/s] at which a ``ship`` holds u > 0 [m/s]. Raises UserError when no revolutions do."""
    surge = surge_balance(ship)
    first = u / ship.particulars.get("D_P", 0.03 * ship.particulars["L"])
    return _root(lambda n: surge(u, n), first, f"no revolutions hold {u:g} m/s with {ship.name}")


def speed_for(ship: Ship, n: float) -> float:
    """Steady speed [m/s] at n > 0 [1/s]. Raises UserError when the ship does not settle."""
    surge = surge_balance(ship)
    first = n * ship.particulars.get("D_P", 0.03 * ship.particulars["L"])
    return _root(lambda u: -surge(u, n), first, f"{ship.name} finds no steady speed at n = {n:g} rps")


def diameter_for(ship: Ship, u: float, n: float) -> float:
    """Diameter of the propeller [m] with which a ``ship`` holds u > 0 [m/s] at n > 0 [1/s]. Raises UserError when none
    does."""

    def surge(diameter: float) -> float:
        return surge_balance(replace(ship, particulars={**ship.particulars, "D_P": diameter}))(u, n)

    return _root(surge, ship.particulars["D_P"], f"no propeller holds {u:g} m/s at {n:g} 1/s with {ship.name}")


def _root(function: Callable[[float], float], first: float, failure: str) -> float:
    """Root of a function that is negative at small positive arguments and positive at large ones. To 1e-12 of it by the
    Illinois method (Dowell & Jarratt 1971): scipy's root finders are slow to import."""
    low, high = 1e-3 * first, first
    for _ in range(8):  # doubles the upper end until the function is positive there
        if function(high) > 0:
            break
        low, high = high, 2 * high
    below, above = function(low), function(high)
    if not below < 0 < above:
        raise NoSolution(f"{failure}; check thrust and resistance, or give both n and speed")
    last = 0  # side on which the last secant ended: an end that stays is halved, else it would stay for long
    for _ in range(200):
        if high - low <= 1e-12 * high:
            break
        at = (low * above - high * below) / (above - below)
        value = function(at)
        if value == 0 or not low < at < high:
            return at
        if value < 0:
            low, below, above = at, value, above / 2 if last < 0 else above
        else:
            high, above, below = at, value, below / 2 if last > 0 else below
        last = -1 if value < 0 else 1
    return high


def own_speed(ship: Ship, froude: float = FROUDE) -> float:
    """Approach speed of a ``ship`` [m/s], as of ``known_speed`` with a number ``froude``."""
    return known_speed(ship, froude)[0]


def known_speed(ship: Ship, froude: float) -> tuple[float, str]:
    """Approach speed of a ``ship`` where none is asked for [m/s], and where it is from. Her U_0 where it was stated,
    else the approach speed of her trials, else a U_0 by rule, else that of a number ``froude``."""
    p, source = ship.particulars, ship.sources.get("U_0", "")
    if p.get("U_0", 0.0) > 0 and not source.startswith(BY_RULE):
        return p["U_0"], "U_0 of the ship file"
    if "approach_speed" in p:
        return p["approach_speed"], f"approach speed, {ship.sources.get('approach_speed', 'of the ship file')}"
    if p.get("U_0", 0.0) > 0:
        return p["U_0"], f"U_0 by {source}"
    words = f"Froude number {froude:g} by rule: the ship file gives no U_0"
    return froude * reference_speed(p["L"]), words


def approach(ship: Ship, n: float | None, speed: float | None, at_rest: bool = False) -> tuple[float, float]:
    """(speed [m/s], n [1/s]) at the start of a manoeuvre; what is not given follows from the surge balance.
    ``at_rest``: the ship starts with speed 0 whatever n is. Raises UserError for numbers that make no approach."""
    for name, value in (("n", n), ("speed", speed)):
        if value is not None and not math.isfinite(value):
            raise OutOfRange(f"{name} = {value} is not a finite number")
    if not {"n", "n_azimuth"} & set(ship.actuators):
        if n is not None or at_rest:
            raise Missing(f"{ship.name} has no propeller in its model: give a speed, not n or a start at rest")
        u, revolutions = own_speed(ship) if speed is None else speed, 0.0
    elif n is None:
        if speed is not None and speed <= 0:
            raise OutOfRange(f"speed = {speed:g} m/s: the approach must be ahead; give n as well for anything else")
        u = own_speed(ship) if speed is None else speed
        u, revolutions = (0.0 if at_rest else u), revolutions_for(ship, u)
    elif at_rest and speed is not None:
        raise Conflict("an acceleration starts from rest: give n or the speed to reach, not both")
    elif n <= 0 and speed is None and not at_rest:
        raise OutOfRange(f"n = {n:g} rps gives no steady approach ahead; give a positive n, or a speed as well")
    else:
        u, revolutions = 0.0 if at_rest else speed_for(ship, n) if speed is None else speed, n
    froude = u / reference_speed(ship.particulars["L"])
    if abs(froude) > 1:
        words = f"an approach at {u:g} m/s is Froude number {froude:.2g}, outside this model; give a lower speed or n"
        raise OutOfRange(words)
    return u, revolutions
