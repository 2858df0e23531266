"""The projection of a ship on the form of another simulator: motions, least squares, and how good it is.

The ship is simulated in calm air and water under rudder steps at several revolutions ahead; samples outside the range
of its trials are left out. What a projection must reproduce is the force that the target's own equations of motion
need to move as the ship does. Its error is said by channel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from cases.maneuvers.self_propulsion import revolutions_for, speed_for
from cases.simulation.simulate import longest_step
from delivery.product import Product
from mmg.components.coefficients import names
from mmg.components.rigid_body import Inertia, inertia
from mmg.effects import effect
from mmg.errors import Unsupported
from mmg.messages import Message
from mmg.model import Model, assemble
from mmg.motion.froude import reference_speed, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

# Largest rudder angle [rad] where no range is known (SOLAS II-1, 29), and rudder rate [rad/s] of a 3 m model: that of
# ``mmg simulate``.
RUDDER, RATE = math.radians(35.0), math.radians(20.0)
SPEEDS = (0.5, 0.75, 1.0)  # Approach speeds [-, by the design speed] where no range is known. Set by hand.
RUNS, SAMPLES, KEPT = 8, 500, 1500  # Runs per approach speed, samples of each, motions kept at most: bounds of time
LIMITED = ("u", "v", "r", "n", "delta", "beta")  # Quantities of the trials' range by which motions are left out
# Share [-] of a range by which a motion may exceed it: judgement, rounding of the range aside. Set by hand.
MARGIN = 0.02
WORST = 0.5  # Share [-] of a channel's force (RMS) beyond which a projection is refused: judgement. Set by hand.
# Weight [-] with which a parameter is drawn to where it starts, by that of an error as large as the force: judgement,
# little enough to leave what the motions determine. Set by hand.
PULL = 0.1
EXACT = "export the ship as c, casadi or fmu, which hold it exactly"  # What to do instead of a projection


@dataclass(frozen=True)
class ChannelError:
    """How far a projection is off in one channel over M motions.

    force, error: RMS [N or N m] of the force that the target needs, and of what its form lacks of it.
    """

    channel: str
    unit: str
    force: float
    error: float

    @property
    def share(self) -> float:
        """Error by force [-]."""
        return self.error / self.force if self.force > 0 else 0.0


@dataclass(frozen=True)
class Motions:
    """M motions of a ship and the accelerations that they bring.

    u, v, r, n, delta: (M,) SI. rates: (3, M) of u, v, r. forces: role -> X, Y, N of it (3, M). limits: quantity ->
    range of these motions. left_out: sentences on what of the ship takes no part.
    """

    ship: Ship
    u: np.ndarray
    v: np.ndarray
    r: np.ndarray
    n: np.ndarray
    delta: np.ndarray
    rates: np.ndarray
    forces: Mapping[str, np.ndarray]
    limits: Mapping[str, tuple[float, float]]
    left_out: tuple[str, ...]

    @cached_property
    def mass(self) -> Inertia:
        """Masses about midship of the ship, as numbers."""
        values = {s: c.value for s, c in self.ship.coefficients.items() if "." not in s}
        return inertia(self.ship.namespace, names(values))

    def needed_force(self, mass: Inertia | None = None) -> np.ndarray:
        """X, Y [N], N [N m] (3, M) with which a body of this ``mass`` about midship, its own by default, moves as the
        ship does."""
        return np.array((mass or self.mass).net_force((self.u, self.v, self.r), self.rates))

    def messages(self, errors: Sequence[ChannelError], target: str, form: str) -> list[Message]:
        """What is to be said of a projection: error per channel, range, what is left out.

        errors: by channel; target, form: words on both. Raises UserError where a channel's error is too large a share.
        """
        worst = max(errors, key=lambda e: e.share)  # one useless channel makes the motion useless
        if worst.share > WORST:
            raise Unsupported(
                f"{target} cannot hold this ship: the error in {worst.channel} is {100 * worst.share:.0f} % of the "
                f"force (RMS), more than {100 * WORST:.0f} %; {EXACT}"
            )
        shares = ", ".join(f"{e.channel} {100 * e.share:.1f} %" for e in errors)
        limits = ", ".join(f"{name} {low:.3g} .. {high:.3g}" for name, (low, high) in self.limits.items())
        line = f"projected on {form}: error by net force (RMS) {shares}, over {len(self.u)} motions"
        messages = [Message(line, "projection_error"), Message(f"range of the projection (SI): {limits}", "range")]
        return messages + [Message(line, "left_out") for line in self.left_out]


def horizontal_ship(product: Product, target: str) -> tuple[Ship, tuple[str, ...]]:
    """The ship of ``product`` as a model of forces in calm air and water, and sentences on what is left out.

    Raises UserError for what the ``target`` cannot hold: an effect of the surroundings or one that remembers, and any
    actuators but one propeller and one rudder.
    """
    ship, left_out = product.ship, []
    for name in product.ship.effects:
        if effect(name).measures:
            ship = ship.without_effect(name)
            left_out.append(f"the effect {name} belongs to the instruments and is left out")
        elif effect(name).surroundings or len(assemble(ship).states) > len(assemble(ship.without_effect(name)).states):
            why = "belongs to the surroundings" if effect(name).surroundings else "remembers"
            raise Unsupported(
                f"{target} cannot hold the effect {name}, which {why}; leave it out with --without {name}, or export "
                "the ship as c, casadi or fmu"
            )
    left_out += [f"the effect {name} is a part of the forces" for name in ship.effects]
    for role in ("actuators", "roll"):
        if role in ship.components:
            ship = replace(ship, components={k: v for k, v in ship.components.items() if k != role})
            left_out.append(f"the model of {role} is left out")
    thrusters = [name for name in ship.actuators if name in ("n_bow", "n_stern")]
    if thrusters:
        left_out.append(f"thrusters ({', '.join(thrusters)}) are at rest")
    others = set(ship.actuators) - {"n", "delta", *thrusters}
    if others or "waves" in ship.components:
        what = ", ".join(sorted(others)) or "waves"
        raise Unsupported(
            f"{target} holds one fixed-pitch propeller and one rudder, and calm water; {ship.name} has {what}: export "
            "it as c, casadi or fmu"
        )
    if "wind" in ship.components:
        left_out.append("wind is left out, but for the air that the ship's own motion meets")
    return ship, tuple(left_out)


def motions(product: Product, target: str, seed: int = 0) -> Motions:
    """Motions of the ship of ``product`` within the range of its trials, for a projection on the model ``target``.

    Raises UserError for what the target cannot hold, and where the range leaves no motion ahead. seed: of the rudder.
    """
    ship, left_out = horizontal_ship(product, target)
    model, rng = assemble(ship, symbols=()), np.random.default_rng(seed)
    step = longest_step(ship)
    revolutions, speeds = _approaches(ship, product.ranges)
    widest = max(map(abs, product.ranges.get("delta", (0.0, RUDDER))))
    n, M = np.repeat(revolutions, RUNS), RUNS * len(revolutions)
    delta = _rudder(rng, M, widest, RATE / time_scale(ship.particulars["L"]) * step)
    controls = np.zeros((SAMPLES, len(model.controls), M))
    for name, values in (("n", np.broadcast_to(n, (SAMPLES, M))), ("delta", delta)):
        if name in model.controls:
            controls[:, model.controls.index(name)] = values
    start = np.zeros((6, M))
    start[3] = np.repeat(speeds, RUNS)
    # interpreted: to compile takes longer than these runs. The last state belongs to no input
    states = Simulator(ship, compiled=False).run(start, controls, step)[:-1]
    flat = states[:, 3:6].transpose(1, 0, 2).reshape(3, -1)
    inputs = controls.transpose(1, 0, 2).reshape(len(model.controls), -1)
    n, delta = np.broadcast_to(n, (SAMPLES, M)).ravel(), delta.ravel()
    inside = _inside(product.ranges, *flat, n, delta)
    if inside.sum() < 100:  # too few for the factors of a form; set by hand
        raise Unsupported(
            f"{target} needs motions ahead to be projected on; the range of the trials leaves {int(inside.sum())} of "
            f"{len(inside)}: export the ship as c, casadi or fmu"
        )
    rows = np.flatnonzero(inside)
    # drawn, not the first ones: all runs and the whole of each are in it
    rows = rows if len(rows) <= KEPT else np.sort(rng.choice(rows, KEPT, replace=False))
    return _evaluated(model, flat[:, rows], inputs[:, rows], n[rows], delta[rows], left_out)


def _evaluated(
    model: Model, nu: np.ndarray, inputs: np.ndarray, n: np.ndarray, delta: np.ndarray, left_out: tuple[str, ...]
) -> Motions:
    """Motions with the accelerations and forces of the model; nu (3, M), inputs (C, M), n, delta (M,)."""
    states = np.vstack([np.zeros((3, nu.shape[1])), nu])  # place and heading are no matter in calm air and water
    rates = np.array(model.rates(states, inputs, np.zeros((0, 1))))[3:6]
    forces = np.array(model.forces.map(nu.shape[1])(states, inputs, np.zeros((0, nu.shape[1]))))
    by_role = forces.reshape(len(model.roles), nu.shape[1], 3).transpose(0, 2, 1)  # (roles, 3, M)
    values = dict(zip(LIMITED, (*nu, n, delta, np.arctan2(-nu[1], nu[0])), strict=True))
    limits = {name: (float(a.min()), float(a.max())) for name, a in values.items()}
    return Motions(
        model.ship, nu[0], nu[1], nu[2], n, delta, rates, dict(zip(model.roles, by_role, strict=True)), limits, left_out
    )


def _approaches(ship: Ship, ranges: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Revolutions [1/s] and steady speeds [m/s] of the approaches: three each."""
    L = ship.particulars["L"]
    if "n" not in ship.actuators:  # the hull model holds its propeller: speeds about that of its coefficients
        return np.zeros(3), np.array([0.9, 1.0, 1.1]) * ship.particulars["U_0"]
    low, high = ranges.get("n", (0.0, 0.0))
    if high > 0:
        # ahead alone, from 40 % of the greatest on: slower runs say little of the forces; set by hand
        revolutions = np.linspace(max(low, 0.4 * high), high, 3)
        return revolutions, np.array([speed_for(ship, n) for n in revolutions])
    design = ship.particulars.get("U_0", 0.07 * reference_speed(L))  # 0.07: Froude number [-], set by hand
    speeds = np.array(SPEEDS) * design
    return np.array([revolutions_for(ship, u) for u in speeds]), speeds


def _rudder(rng: np.random.Generator, M: int, widest: float, change: float) -> np.ndarray:
    """Rudder angles (SAMPLES, M) [rad]: steps held for 20 to 160 samples, first to one side, then to the other, moved
    by at most ``change`` per sample."""
    delta, row = np.zeros((SAMPLES, M)), np.zeros(M)
    orders = np.zeros((SAMPLES, M))
    for m in range(M):
        k, side = 5, 1.0 if m % 2 else -1.0  # five samples straight ahead first
        while k < SAMPLES:
            hold = int(rng.integers(20, 160))
            # three in ten hard over, of which a uniform draw has hardly any; set by hand
            orders[k : k + hold, m] = side * widest * (1.0 if rng.random() < 0.3 else rng.random())
            k, side = k + hold, -side
    for k in range(SAMPLES):
        row = row + np.clip(orders[k] - row, -change, change)
        delta[k] = row
    return delta


def _inside(ranges: Mapping[str, tuple[float, float]], *values: np.ndarray) -> np.ndarray:
    """Whether each motion lies in the range of the trials and goes ahead; values: u, v, r, n, delta (M,)."""
    u, v = values[:2]
    named = dict(zip(LIMITED, (*values, np.arctan2(-v, u)), strict=True))  # beta: drift, bow to starboard of the course
    good = (u > 0.05 * np.max(u)) & np.isfinite(v)  # the forms divide by u or U; 5 % by hand
    for name, (low, high) in ranges.items():
        if name in named:
            margin = MARGIN * (high - low)
            good &= (named[name] >= low - margin) & (named[name] <= high + margin)
    return good


def channel_errors(needed: np.ndarray, projected: np.ndarray) -> tuple[ChannelError, ...]:
    """Errors in surge, sway and yaw. needed, projected: X, Y, N (3, M): needed by the target, and given by its form."""
    force, error = (np.sqrt(np.mean(a**2, axis=1)) for a in (needed, projected - needed))
    rows = zip(("surge", "sway", "yaw"), ("N", "N", "N m"), force, error, strict=True)
    return tuple(ChannelError(channel, unit, float(f), float(e)) for channel, unit, f, e in rows)


def fit_parameters(
    residual: Callable[[np.ndarray], np.ndarray], start: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """Parameters by name that make ``residual`` (a function of their values, (P,) -> (R,)) small in the mean square.

    start: values; bounds: of each; a parameter that the residual hardly knows stays near its start.
    """
    names, x0 = list(start), np.array(list(start.values()), dtype=float)
    low, high = (np.array([bounds[name][side] for name in names]) for side in (0, 1))
    size = high - low  # by which the steps are counted: parameters of unlike size count alike
    x0 = np.clip(x0, low + 1e-9 * size, high - 1e-9 * size)  # ``least_squares`` wants a start inside its bounds

    def weighted(z: np.ndarray) -> np.ndarray:
        errors = residual(x0 + size * z)
        # by the root of their number: the sum of squares is the mean, whatever the number of motions
        return np.concatenate([errors / np.sqrt(len(errors)), PULL * z])

    solution = least_squares(weighted, np.zeros(len(x0)), bounds=((low - x0) / size, (high - x0) / size), x_scale="jac")
    return dict(zip(names, (x0 + size * solution.x).tolist(), strict=True))


def linear_parameters(terms: Mapping[str, np.ndarray], force: np.ndarray) -> dict[str, float]:
    """Factors of ``terms`` (name -> (M,)) that add up to ``force`` (M,) in the least-squares sense."""
    columns = np.array(list(terms.values())).T
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0] = 1.0  # a term that never acts
    # by size, so that rcond compares like with like; directions below 1e-6 get no factor: nothing determines them
    factors = np.linalg.lstsq(columns / size, force, rcond=1e-6)[0] / size
    return dict(zip(terms, factors.tolist(), strict=True))
