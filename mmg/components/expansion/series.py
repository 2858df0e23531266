"""The force of a generated polynomial: the sum of its terms at a motion.

X = 1/2 rho L d V^2 sum c_i w_i m_i, Y alike, N = 1/2 rho L^2 d V^2 sum c_i w_i m_i with V = 0.1 sqrt(g L), the
monomials m_i and conditions w_i of ``words``. V is a constant of the ship, so nothing is divided by the speed, all is
smooth at rest, and the coefficients hold for similar ships by Froude's law (Kose et al. 1985 have the same idea).

A polynomial says nothing beyond the motions that it was fitted to. Where the particulars give their range (u_ahead,
u_astern, v_most, r_most), the monomials take what lies beyond as its edge, and the rest is damped in proportion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.expansion.words import Monomial, Word, parse_monomial
from mmg.motion.flow import INPUTS, Flow, Force
from mmg.motion.froude import reference_speed
from mmg.motion.smooth import Exact, Smoothing

# Nominal stall angle [rad] where a ship file has no delta_stall: that of Kang et al. (2008) for fish-tail rudders.
STALL = 0.6545
# Width of a scaled modulus, set by hand: 11 mm/s, 0.2 rps of a 3 m model; a change of angle is twice it [rad].
WIDTH = 0.02
# Revolutions are by this times V/L: 9 rps at 3 m. Set by hand, so that the scaled number is about 1.
REVOLUTIONS = 50.0

# Resistance to motion beyond the range, by 1/2 rho L d V^2 (of r by L more) for one scaled velocity: the usual size of
# derivatives of a hull.
DAMPING = {"u": 0.1, "v": 0.3, "r": 0.1}
# Particulars that give the range: magnitudes on the negative and on the positive side [m/s, rad/s].
RANGE = {"u": ("u_astern", "u_ahead"), "v": ("v_most", "v_most"), "r": ("r_most", "r_most")}


def speed_scale(length: float) -> float:
    """V [m/s] by which velocities are divided for a ship of ``length`` [m]: 0.1 sqrt(g L), 0.54 at 3 m."""
    return 0.1 * reference_speed(length)


def series_force(
    flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing, monomials: Mapping[str, str], hard: bool
) -> Force:
    """Force [N, N, N m] of the terms ``monomials``: symbol of the coefficient, which begins with X, Y or N, -> text.

    hard: conditions are switched at once instead of blended; flow, p, c, s: as in mmg/motion/flow.py.
    """
    switch: Smoothing = Exact() if hard else s  # of conditions alone: moduli are smooth in either model
    cache: dict[Any, Any] = {}  # hundreds of terms share a few dozen factors
    flow, total = _within(flow, p, s)
    for symbol, text in monomials.items():
        term = parse_monomial(text)
        product = _product(term, flow, p, (s, switch), cache)
        total[symbol[0]] = total[symbol[0]] + getattr(c, symbol) * product
    unit = 0.5 * p.rho * p.L * p.d * speed_scale(p.L) ** 2
    return Force(unit * total["X"], unit * total["Y"], unit * p.L * total["N"])


def _within(flow: Flow, p: SimpleNamespace, s: Smoothing) -> tuple[Flow, dict[str, Any]]:
    """The flow with motions put back to the edge of their range, and the scaled damping of what lies beyond."""
    inside, damping = {}, {}
    for (name, (low, high)), force in zip(RANGE.items(), "XYN", strict=True):
        damping[force] = 0.0
        if not (hasattr(p, low) and hasattr(p, high)):
            continue
        scale = speed_scale(p.L) / (p.L if name == "r" else 1.0)
        x, lowest, highest = getattr(flow, name) / scale, -getattr(p, low) / scale, getattr(p, high) / scale
        beyond = s.positive(x - highest, WIDTH) - s.positive(lowest - x, WIDTH)  # 0 inside, signed outside
        inside[name] = scale * (x - beyond)
        damping[force] = -DAMPING[name] * beyond
    return flow.with_(**inside), damping


def variable(word: Word, flow: Flow, L: float) -> Any:
    """The scaled value of the variable ``word`` at ``flow``, for a ship of length ``L`` [m]."""
    V = speed_scale(L)
    if not word.parts:
        scale = {"u": V, "v": V, "r": V / L}.get(word.name)
        if scale is None:
            scale = REVOLUTIONS * V / L if INPUTS[word.name][1] == "rps" else 1.0
        return getattr(flow, word.name) / scale
    x = [variable(part, flow, L) for part in word.parts]
    if word.name in ("sin", "cos"):
        return ca.sin(x[0]) if word.name == "sin" else ca.cos(x[0])
    if word.name in ("mean", "half"):
        return 0.5 * (x[0] + x[1]) if word.name == "mean" else 0.5 * (x[0] - x[1])
    thrust = x[0] * ca.sqrt(x[0] * x[0] + WIDTH**2)  # n |n|, smooth at n = 0
    return thrust * (ca.cos(x[1]) if word.name == "push" else ca.sin(x[1]))


def _product(
    term: Monomial, flow: Flow, p: SimpleNamespace, by: tuple[Smoothing, Smoothing], cache: dict[Any, Any]
) -> Any:
    s, switch = by
    values = []
    for condition in term.conditions:
        if condition not in cache:
            cache[condition] = _weight(condition, flow, p, switch)
        values.append(cache[condition])
    for word, bars in term.factors:
        if (word, bars) not in cache:
            x = variable(word, flow, p.L)
            cache[word, bars] = s.absolute(x, WIDTH) if bars else x
        values.append(cache[word, bars])
    return math.prod(values[1:], start=values[0])


def _weight(condition: Word, flow: Flow, p: SimpleNamespace, s: Smoothing) -> Any:
    """Where a condition holds: 1, elsewhere 0."""
    scaled = [variable(part, flow, p.L) for part in condition.parts]  # angles have the scale 1
    if condition.name in ("ahead", "astern"):
        u = flow.u / speed_scale(p.L)
        # u = 0 counts as ahead where conditions switch; a blend is half there
        ahead = s.step_or_zero(u, WIDTH) if isinstance(s, Exact) else s.step(u, WIDTH)
        return ahead if condition.name == "ahead" else 1 - ahead
    if condition.name in ("driving", "reversing"):
        driving = s.step_or_zero(sum(scaled) / len(scaled), WIDTH)
        return driving if condition.name == "driving" else 1 - driving
    limit = getattr(p, "delta_stall", STALL)
    # several rudders: attached where all of them are
    attached = math.prod((s.step(limit - s.magnitude(x, WIDTH), 2 * WIDTH) for x in scaled), start=1.0)
    return attached if condition.name == "attached" else 1 - attached
