"""VecTwin: two fish-tail rudders behind one propeller, from 35 deg inwards to 105 deg outwards (Kang et al. 2008).

s = starboard, p = port; both positive to starboard turns; J = u_P/(n D); slip sigma = 1 - u_P/(n P) in [0, 1.2];
Q(c) = c_0 + c_1 sigma + c_2 sigma^2. For starboard (port alike, outward is then delta_p < 0):
 1 delta_s1 = delta_s - (bs_0 + bs_1 sigma)
 2 delta_s2 = delta_s1 - [Q(ds) delta_p + Q(es) delta_p^2] (|cos delta_s1| for delta_s1 > 0, else 1)
 3 1 - w_Rs = as_0 + as_1 delta_s + as_2 delta_s^2 + as_3 delta_s^3;
   u_R0 = sqrt{eta [(1 - w_Rs) u + k_x (sqrt(u_P^2 + 8 K_T n^2 D^2/pi) - u_P)]^2 + (1 - eta) [(1 - w_Rs) u]^2}
 4 u_R = f u_R0, f = min(1, Q(gs) + Q(hs) delta_s2 + Q(ks) delta_s2^2) for delta_s2 > 0, else 1
 5 gamma = (r_i + r_i+1 |beta| + (r_i+2 + r_i+3 |beta|) delta_s2) |beta|, beta = atan2(-v, u), clipped to [0, 0.8]
   (outward with the flow from that side: 1.0); i = 0, 4, 8, 12 by the signs of beta and delta_s2, see GAMMA
 6 v_R = -gamma v - C_j x_R r, j = 0..3 by the signs of r and delta_s2
 7 F_N = k_N 1/2 rho A_R C_N(alpha) (u_R^2 + v_R^2), alpha = delta_s2 - atan2(v_R, u_R), C_N see ``normal_coefficient``
 8 t_R = e(J); a_H = f(J) in [0.016, 0.60556]; x_H' = g(J) in [-0.4344, -0.159], quadratic polynomials:
   X_R = -(1 - t_R) sum F_N sin delta, Y_R = -(1 + a_H) sum F_N cos delta,
   N_R = -(x_R + a_H x_H' L) sum F_N cos delta; the distance of the stocks from the centre plane is neglected.
Kang et al. (2008), Hasegawa et al. (2006) as in a public code, single lineage; that code's slip of x_H' (taken from
a_H) is not copied. k_gamma (times gamma before the clip) and k_N are 1 as published; they are for calibration.

Where the source ends (UNVERIFIED): for n < 0 or K_T <= 0 it has u_R = 0; here the loading is held at 0 and u_R tends
to f (1 - w_R) u. At n = 0 it has sigma = 1.2; here 1. For u < 0 it has no force; here u_R takes the sign of the sum of
signed squares with the jet sqrt(u_P^2 + ...) - |u_P|, and the force is multiplied by k_A (0 as published, 1 default).
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import Coefficient, table
from mmg.components.propeller.kang import advance_ratio, clip
from mmg.components.rudder.inflow import THRUST_WIDTH, share_in_slipstream, slipstream, thrust_scale
from mmg.motion.flow import Blade, Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_P", "pitch_ratio", "A_R", "aspect_ratio", "x_R")
INPUTS = ("delta_port", "delta_starboard")

STALL = 0.65450  # Angle of attack [rad] at which the normal-force law changes from sine to parabola (Kang et al. 2008).
_PARABOLA = (0.6387, 2.0621, -0.8449)  # C_N [-] beyond STALL as a polynomial of |a| [rad] (Kang et al. 2008).
_SLOPE = 2.6252  # C_N [-] by sin a below STALL (Kang et al. 2008).
# Angle of attack [rad] beyond which the water comes from behind, and C_N by sin a there (UNVERIFIED, see below).
_BACK = ca.pi - STALL
_BACK_SLOPE = float((_PARABOLA[0] + _PARABOLA[1] * _BACK + _PARABOLA[2] * _BACK**2) / ca.sin(STALL))

_SOURCE = "default of the VecTwin model: values of Kang et al. (2008), single public lineage"

# Symbol of the docstring above and side, s or p -> coefficients from power 0 on; of r four for each row of GAMMA.
_POLYNOMIALS: dict[str, tuple[float, ...]] = {
    "as": (0.665, 0.19, 0.051, -0.095), "ap": (0.665, -0.19, 0.051, 0.095),
    "bs": (0.015, -0.164), "bp": (-0.008, 0.114),
    "ds": (0.088, -0.11, 0.162), "dp": (0.14, 0.0, 0.0),
    "es": (0.129, -0.259, 0.343), "ep": (-0.18, 0.085, -0.226),
    "gs": (1.791, -1.861, 1.348), "gp": (1.0, 0.0, 0.0),
    "hs": (-2.489, 5.243, -4.159), "hp": (0.343, -0.151, 0.657),
    "ks": (1.399, -3.239, 2.598), "kp": (0.011, 0.176, 0.38),
    "rs": (0.615, -1.068, -7.823, 11.07, 2.66, -3.611, 2.971, -2.602,
           -0.864, 2.719, 15.43, -44.18, 2.781, -3.55, -3.787, 4.834),
    "rp": (6.256, -12.3, 8.759, -18.38, 10.07, -30.62, 13.36, -43.29,
           6.559, -13.77, -8.238, 20.25, 9.064, -24.76, -4.256, 25.31),
    "Cs": (0.0, 0.2, 0.6, 0.4), "Cp": (0.4, 0.6, 0.2, 0.0),
}  # fmt: skip
_WORDS = {
    "a": "1 - w_R, power {} of the rudder angle",
    "b": "shift of the neutral angle, power {} of the slip",
    "d": "turn of the flow by the other rudder, linear, power {} of the slip",
    "e": "turn of the flow by the other rudder, quadratic, power {} of the slip",
    "g": "speed lost at outward angles, constant, power {} of the slip",
    "h": "speed lost at outward angles, linear, power {} of the slip",
    "k": "speed lost at outward angles, quadratic, power {} of the slip",
    "r": "flow straightening, term {}",
    "C": "effective lever of yaw by x_R, quadrant {} of yaw rate and angle",
}


def _detail() -> tuple[Coefficient, ...]:
    """The coefficients of inflow and interaction, fixed: free runs hardly tell them apart."""
    rows = []
    for letters, values in _POLYNOMIALS.items():
        side = "starboard" if letters[1] == "s" else "port"
        for i, value in enumerate(values):
            std = max(0.2 * abs(value), 0.05)
            words = f"{_WORDS[letters[0]].format(i)}, {side}"
            rows.append((f"{letters}_{i}", value, std, value - 10 * std, value + 10 * std, "", words))
    return table(_SOURCE, *rows, fixed=True)


COEFFICIENTS = (
    *table(
        _SOURCE,
        ("k_x", 0.6, 0.15, 0.05, 1.5, "", "propeller acceleration at the rudder"),
        ("k_N", 1.0, 0.15, 0.3, 2.0, "", "factor on the normal force"),
        ("k_gamma", 1.0, 0.3, 0.0, 3.0, "", "factor on the flow straightening"),
        ("k_A", 1.0, 0.3, 0.0, 2.0, "", "factor on the rudder force with sternway (a guess; 0 as published)"),
        ("e_0", 0.06, 0.06, -0.2, 0.6, "", "steering resistance deduction, constant"),
        ("e_1", 0.0, 0.1, -1.0, 1.0, "", "steering resistance deduction, linear in J"),
        ("e_2", 0.0, 0.1, -1.0, 1.0, "", "steering resistance deduction, quadratic in J"),
        ("f_0", 0.016, 0.1, -0.5, 1.0, "", "rudder force increase on the hull, constant"),
        ("f_1", 1.69, 0.4, -4.0, 4.0, "", "rudder force increase on the hull, linear in J"),
        ("f_2", -1.179, 0.4, -4.0, 4.0, "", "rudder force increase on the hull, quadratic in J"),
        ("g_0", -0.159, 0.1, -0.6, 0.2, "", "position of the additional lateral force by L, constant"),
        ("g_1", -1.065, 0.3, -3.0, 2.0, "", "position of the additional lateral force by L, linear in J"),
        ("g_2", 1.01, 0.3, -2.0, 3.0, "", "position of the additional lateral force by L, quadratic in J"),
    ),
    *_detail(),
)

# First of the four flow-straightening coefficients, whether beta < 0, whether delta_2 >= 0.
GAMMA = ((0, False, False), (4, True, False), (8, False, True), (12, True, True))
A_H_RANGE, X_H_RANGE = (0.016, 0.60556), (-0.4344, -0.159)  # Bounds of a_H and x_H' [-] (Kang et al. 2008).


def normal_coefficient(sine: Any, cosine: Any, s: Smoothing) -> Any:
    """C_N [-] of the fish-tail section from sine and cosine of the angle of attack (Kang et al. 2008).

    2.6252 sin a up to |a| = 0.6545 rad, then sgn(a) (0.6387 + 2.0621 |a| - 0.8449 a^2): a step of 0.03, blended over
    0.02 in cos a. Beyond pi - 0.6545 the parabola would change sign and leave a jump at 180 deg; there C_N is the
    sine through its value at that angle, 0.889 sin a (UNVERIFIED). s: smoothing.
    """
    edge = ca.cos(STALL)  # by the cosine, which has no jump at 180 deg as the angle has
    stalled, backward = s.step(edge - cosine, 0.02), s.step(-edge - cosine, 0.02)
    size = s.angle(cosine, sine, 0.01)
    parabola = _PARABOLA[0] + _PARABOLA[1] * size + _PARABOLA[2] * size**2
    sines = (_SLOPE * (1 - stalled) + _BACK_SLOPE * backward) * sine
    return sines + (stalled - backward) * s.sign(sine, 0.01) * parabola


def _values(c: SimpleNamespace, letters: str) -> tuple[Any, ...]:
    return tuple(getattr(c, f"{letters}_{i}") for i in range(len(_POLYNOMIALS[letters])))


def _power(terms: Sequence[Any], x: Any) -> Any:
    return sum((term * x**i for i, term in enumerate(terms[1:], start=1)), terms[0])


def _straightening(flow: Flow, angle: Any, port: bool, c: SimpleNamespace, s: Smoothing) -> Any:
    """gamma [-] at the corrected rudder angle ``angle`` = delta_2."""
    beta = s.angle(flow.u, flow.v, 0.1 * s.speed)  # |beta|; its sign is that of -v
    to_starboard, positive = s.step(flow.v, 0.5 * s.speed), s.step_or_zero(angle, 0.02)
    r = _values(c, "rp" if port else "rs")
    total: Any = 0.0
    for i, negative_beta, positive_angle in GAMMA:
        gamma = c.k_gamma * (r[i] + r[i + 1] * beta + (r[i + 2] + r[i + 3] * beta) * angle) * beta
        upper = 1.0 if i == (0 if port else 12) else 0.8  # 1.0: outward with the flow from that side
        weight = (to_starboard if negative_beta else 1 - to_starboard) * (positive if positive_angle else 1 - positive)
        total = total + weight * clip(gamma, 0.0, upper, 0.01, s)
    return total


def _lever(flow: Flow, angle: Any, port: bool, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Any:
    """Lever ell_R [m] of the yaw rate in the inflow."""
    C = _values(c, "Cp" if port else "Cs")
    to_starboard, positive = s.step_or_zero(0.5 * p.L * flow.r, 0.5 * s.speed), s.step_or_zero(angle, 0.02)
    one, other = (positive * C[j] + (1 - positive) * C[j + 1] for j in (0, 2))  # r >= 0, r < 0
    return p.x_R * (to_starboard * one + (1 - to_starboard) * other)


def inflow(flow: Flow, port: bool, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> tuple[Any, Any, Any]:
    """(u_R, v_R) [m/s] and the corrected angle delta_2 [rad] of one rudder. port: which one; flow, p, c: as in
    mmg/motion/flow.py."""
    wash = slipstream(flow)
    side, outward = ("p", -1) if port else ("s", 1)
    angle_here, other = (flow.delta_port, flow.delta_starboard) if port else (flow.delta_starboard, flow.delta_port)
    small = 0.1 * s.speed
    slip = clip(1 - advance_ratio(wash.u_P, flow.n * p.D_P, s) / p.pitch_ratio, 0.0, 1.2, 0.01, s)

    def Q(letter: str) -> Any:
        return _power(_values(c, letter + side), slip)

    first = angle_here - Q("b")  # step 1
    outside = s.step(outward * first, 0.02)
    # step 2: the other rudder turns the flow, outward by |cos| of the angle less
    turn = (Q("d") * other + Q("e") * other**2) * (1 + outside * (s.absolute(ca.cos(first), 0.02) - 1))
    angle = first - turn
    free = _power(_values(c, "a" + side), angle_here) * flow.u  # step 3: (1 - w_R) u, of the angle as it is set
    pull = s.positive(wash.loading, THRUST_WIDTH * thrust_scale(flow, p, s))
    jet = s.root(wash.u_P**2 + 8 * pull / ca.pi, small) - s.magnitude(wash.u_P, small)
    in_wash = free + c.k_x * jet
    eta = share_in_slipstream(p)
    q = eta * in_wash * s.absolute(in_wash, small) + (1 - eta) * free * s.absolute(free, small)
    # step 4: at most 1
    slower = 1 - s.positive(1 - (Q("g") + Q("h") * angle + Q("k") * angle**2), 0.005)
    factor = 1 + s.step(outward * angle, 0.02) * (slower - 1)
    u_R = factor * s.signed_root(q, small)
    v_R = -_straightening(flow, angle, port, c, s) * flow.v - _lever(flow, angle, port, p, c, s) * flow.r
    return u_R, v_R, angle


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Force of both rudders including the effect on the hull [N, N, N m]; blades: starboard, port. flow, p, c, s: as in
    mmg/motion/flow.py."""
    wash = slipstream(flow)
    J = advance_ratio(wash.u_P, flow.n * p.D_P, s)
    t_R = _power((c.e_0, c.e_1, c.e_2), J)
    a_H = clip(_power((c.f_0, c.f_1, c.f_2), J), *A_H_RANGE, 0.005, s)
    x_H = clip(_power((c.g_0, c.g_1, c.g_2), J), *X_H_RANGE, 0.005, s)
    headway = s.step_or_zero(flow.u, s.speed)
    strength = 0.5 * p.rho * p.A_R * c.k_N * (headway + (1 - headway) * c.k_A)  # by U_R^2 C_N the normal force
    blades = []
    for port, delta in ((False, flow.delta_starboard), (True, flow.delta_port)):
        u_R, v_R, angle = inflow(flow, port, p, c, s)
        U_R = s.root(u_R**2 + v_R**2, 0.1 * s.speed)
        sine = s.divide(u_R * ca.sin(angle) - v_R * ca.cos(angle), U_R, 0.0)
        cosine = s.divide(u_R * ca.cos(angle) + v_R * ca.sin(angle), U_R, 0.0)
        F_N = strength * U_R**2 * normal_coefficient(sine, cosine, s)
        lateral = F_N * ca.cos(delta)  # in the ship's axes by the angle that is set, not the corrected one
        X, Y = -(1 - t_R) * F_N * ca.sin(delta), -(1 + a_H) * lateral
        blades.append(Blade(X, Y, -(p.x_R + a_H * x_H * p.L) * lateral, sine**2))
    one, other = blades
    return Force(one.X + other.X, one.Y + other.Y, one.N + other.N, blades=(one, other))
