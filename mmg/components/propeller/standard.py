"""Standard MMG propeller with the wake of Yasukawa & Yoshimura (2015); thrust in four quadrants (Yasukawa 2008).

X_P = (1 - t_P) rho n^2 D^4 K_T for n >= 0, X_P = rho n^2 D^4 K_T for n < 0; Y_P = N_P = 0; J = u (1 - w_P)/(n D)
  J > J_min:   K_T = k_0 + k_1 J + k_2 J^2                       (Yasukawa & Yoshimura 2015)
  J <= J_min:  K_T = alpha_p [k_1 (J - J_min) - k_2 (J - J_min)^2] + K_T(J_min),  J_min = -0.5
  n < 0:       either branch times beta_t = 0.4811 p^2 - 1.1116 p - 0.1404, p the pitch ratio
(Yasukawa 2008 as coded in one public lineage.) All is multiplied by n^2 D^2, so nothing divides by n; with
z = u_P - J_min n D, J <= J_min is z < 0 for n > 0 and z > 0 for n < 0. The stopped propeller is a brake in both
directions: k_2 u_P^2 ahead, -alpha_p k_2 u^2 astern. There is no propeller walk in this model; see ``hachii``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import Coefficient, table
from mmg.components.propeller import wake
from mmg.motion.flow import Flow, Force, Slipstream
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_P", "pitch_ratio")
INPUTS = ("n",)

J_MIN = -0.5  # Advance ratio below which the polynomial of the first quadrant is left (Yasukawa 2008)

THRUST = (
    ("k_0", 0.30, 0.03, 0.05, 0.8, "", "open-water thrust, constant"),
    ("k_1", -0.28, 0.05, -1.0, 0.2, "", "open-water thrust, linear in J"),
    ("k_2", -0.14, 0.045, -1.0, 0.5, "", "open-water thrust, quadratic in J"),
    ("t_P", 0.22, 0.05, 0.0, 0.5, "", "thrust deduction fraction"),
)


def reversal(pitch_ratio: float) -> float:
    """beta_t [-]: thrust of the reversed propeller by that ahead at the same J (Yasukawa 2008; 0.7151 -> -0.6893).
    pitch_ratio: P/D."""
    return 0.4811 * pitch_ratio**2 - 1.1116 * pitch_ratio - 0.1404


def coefficients_with(rows: tuple[tuple, ...], p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Coefficients of thrust and of a wake model (``rows``); beta_t follows from the pitch ratio. p: particulars."""
    beta_t = reversal(p.pitch_ratio)
    return table("default of the standard propeller model", *THRUST, *rows) + table(
        "Yasukawa (2008) as coded in one public lineage",
        ("alpha_p", 1.5, 0.3, 0.3, 3.0, "", "thrust below J = -0.5, by the mirrored polynomial"),
        ("beta_t", beta_t, 0.15, -1.5, 0.0, "", "thrust of the reversed propeller by that ahead, effective"),
    )


def loading(u_P: Any, nD: Any, ahead: Any, c: SimpleNamespace, s: Smoothing) -> Any:
    """n^2 D^2 K_T [m^2/s^2] in four quadrants. u_P, nD [m/s]; ahead: weight of n >= 0. c: coefficients; s:
    smoothing."""
    z = u_P - J_MIN * nD  # (J - J_min) n D
    width = s.magnitude(0.02 * nD, 0.2 * s.speed)  # 0.02 in J
    first = c.k_0 * nD**2 + c.k_1 * nD * u_P + c.k_2 * u_P**2
    at_limit = c.k_0 + c.k_1 * J_MIN + c.k_2 * J_MIN**2
    below = c.alpha_p * (c.k_1 * nD * z - c.k_2 * z**2) + at_limit * nD**2
    low_ahead, low_astern = s.step(-z, width), s.step(z, width)
    turning_ahead = first + low_ahead * (below - first)
    turning_astern = c.beta_t * (first + low_astern * (below - first))
    return ahead * turning_ahead + (1 - ahead) * turning_astern


def force_with(wake_of: Callable[..., Any], flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Propeller force [N, N, N m] and slipstream with a wake model. wake_of: its function of flow, p, c, s, which are
    as in mmg/motion/flow.py."""
    nD, one_minus_w = flow.n * p.D_P, wake_of(flow, p, c, s)
    ahead = s.step_or_zero(nD, s.speed)
    u_P = flow.u * one_minus_w
    load = loading(u_P, nD, ahead, c, s)
    # reversed, beta_t is effective: no thrust deduction
    X = p.rho * p.D_P**2 * (1 - ahead * c.t_P) * load
    return Force(X, 0.0, 0.0, Slipstream(one_minus_w, u_P, load, ahead))


coefficients = partial(coefficients_with, wake.YASUKAWA_2015)
force = partial(force_with, wake.yasukawa_2015)
