"""Parameter sets of shipmmg (Python package, MIT): its 3-DOF MMG model, by least squares.

The form, as shipmmg 0.0.11 evaluates it: U = sqrt(u^2 + v_G^2), beta = asin(-v_G / U) with v_G = v - x_G r, the sign
that it gives the centre of gravity, v' = v/U, r' = r L/U, w_P = w_P0 exp(-4 (beta - x_P' r')^2),
J = u (1 - w_P)/(n D), K_T = k_0 + k_1 J + k_2 J^2, beta_R = beta - l_R' r', v_R = U gamma_R beta_R,
u_R = eps u (1 - w_P) sqrt{ eta [1 + kappa (sqrt(1 + 8 K_T/(pi J^2)) - 1)]^2 + 1 - eta }, and the hull polynomial,
rudder forces and equations of motion of Yasukawa & Yoshimura (2015), J Mar Sci Technol 20:37-52.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from unicodedata import normalize

import numpy as np

from delivery.dictionaries import projection
from delivery.product import Product
from mmg.errors import Missing, Unsupported
from mmg.messages import Message

# Symbols of the hull polynomial by channel; powers of v' and r' as their letters say (Yasukawa & Yoshimura 2015).
HULL = {
    "X": ("R_0", "X_vv", "X_vr", "X_rr", "X_vvvv"),
    "Y": ("Y_v", "Y_r", "Y_vvv", "Y_vvr", "Y_vrr", "Y_rrr"),
    "N": ("N_v", "N_r", "N_vvv", "N_vvr", "N_vrr", "N_rrr"),
}
# Parameters of the propeller: where a fit starts if the ship has none of that name, and its bounds. Set by hand.
SCREW: dict[str, tuple[float, float, float]] = {
    "k_0": (0.3, 0.05, 0.8), "k_1": (-0.28, -1.0, 0.2), "k_2": (-0.14, -1.0, 0.5), "w_P0": (0.4, 0.0, 0.85),
    "x_P": (-0.5, -1.5, 0.0), "t_P": (0.2, 0.0, 0.6),
}  # fmt: skip
# The same of the rudder.
BLADE: dict[str, tuple[float, float, float]] = {
    "t_R": (0.35, -0.5, 0.95), "a_H": (0.3, -0.5, 1.5), "x_H": (-0.45, -1.5, 0.5), "l_R": (-0.8, -2.5, 0.5),
    "gamma_R_plus": (0.45, 0.02, 1.5), "gamma_R_minus": (0.45, 0.02, 1.5), "kappa": (0.5, 0.0, 2.0),
    "epsilon": (1.1, 0.4, 2.5), "f_alpha": (2.7, 0.3, 8.0),
}  # fmt: skip
# Their symbols in the ship, where these differ.
OTHER_NAMES = {"l_R": "ell_R", "gamma_R_plus": "gamma_N", "gamma_R_minus": "gamma_P"}
# Their names in shipmmg, where these differ.
BASIC = {"epsilon": "ϵ", "kappa": "κ", "f_alpha": "f_α", "gamma_R_plus": "γ_R_plus", "gamma_R_minus": "γ_R_minus"}


def write_shipmmg(product: Product, target: Path) -> list[Message]:
    """Write the parameter sets of ``product`` as JSON to ``target``; returns what is to be said of the error.

    Raises UserError for what shipmmg cannot hold.
    """
    samples = shipmmg_motions(product)
    p, errors = project(samples)
    messages = samples.messages(errors, "shipmmg", "shipmmg's 3-DOF MMG model")
    basic, maneuvering = dictionaries(samples, p)
    content = {
        "format": "shipmmg 0.0.11",
        "ship": product.ship.name,
        "title": product.ship.title,
        "rho": samples.ship.particulars["rho"],
        "basic_params": basic,
        "maneuvering_params": maneuvering,
        "approach": {"u0": float(samples.u.max()), "nps": float(samples.n.max())},
        "projection": [
            {"channel": e.channel, "force_rms": e.force, "error_rms": e.error, "unit": e.unit, "share": e.share}
            for e in errors
        ],
        "range": {name: list(pair) for name, pair in samples.limits.items()},
        "remarks": [*messages, *(str(words) for words in product.caveats)],
    }
    target.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return messages


def shipmmg_motions(product: Product) -> projection.Motions:
    """Motions of the ship of ``product``; UserError where it lacks what shipmmg needs."""
    for role in ("propeller", "rudder"):
        if role not in product.ship.components:
            raise Unsupported(f"shipmmg needs a {role} of its own; {product.ship.name} has none: {projection.EXACT}")
    missing = [name for name in ("D_P", "A_R", "aspect_ratio", "x_R", "B") if name not in product.ship.particulars]
    if missing:
        raise Missing(
            f"shipmmg needs a propeller and a rudder; the ship file of {product.ship.name} lacks {', '.join(missing)}: "
            "add them, or export the ship as c, casadi or fmu"
        )
    return projection.motions(product, "shipmmg")


def _inflow(samples: projection.Motions) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """U [m/s], beta [rad], v' and r' (M,) as shipmmg takes them."""
    P = samples.ship.particulars
    across = samples.v - samples.r * P["x_G"]
    U = np.hypot(samples.u, across)
    return U, np.arcsin(-across / U), samples.v / U, samples.r * P["L"] / U


def propeller(samples: projection.Motions, p: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """X_P [N], 1 - w_P and K_T (M,). samples: motions; p: parameters by symbol."""
    P, (_, beta, _, r1) = samples.ship.particulars, _inflow(samples)
    one_minus_w = 1 - p["w_P0"] * np.exp(-4 * (beta - p["x_P"] * r1) ** 2)
    J = one_minus_w * samples.u / (samples.n * P["D_P"])
    K_T = p["k_0"] + p["k_1"] * J + p["k_2"] * J**2
    return (1 - p["t_P"]) * P["rho"] * K_T * samples.n**2 * P["D_P"] ** 4, one_minus_w, K_T


def rudder(samples: projection.Motions, p: Mapping[str, float], one_minus_w: np.ndarray, K_T: np.ndarray) -> np.ndarray:
    """X_R, Y_R [N], N_R [N m] (3, M). samples: motions; p: parameters; one_minus_w, K_T: of the propeller (M,)."""
    P, (U, beta, _, r1) = samples.ship.particulars, _inflow(samples)
    eta = P["D_P"] / math.sqrt(P["A_R"] * P["aspect_ratio"])
    J = one_minus_w * samples.u / (samples.n * P["D_P"])
    beta_R = beta - p["l_R"] * r1
    v_R = U * np.where(beta_R < 0, p["gamma_R_minus"], p["gamma_R_plus"]) * beta_R
    # no root of a negative number where the propeller brakes hard
    jet = 1 + p["kappa"] * (np.sqrt(np.maximum(1 + 8 * K_T / (np.pi * J**2), 0.0)) - 1)
    u_R = p["epsilon"] * samples.u * one_minus_w * np.sqrt(eta * jet**2 + 1 - eta)
    sine = np.sin(samples.delta - np.arctan2(v_R, u_R))  # of the angle of attack
    F = 0.5 * P["rho"] * P["A_R"] * p["f_alpha"] * (u_R**2 + v_R**2) * sine
    cosine = F * np.cos(samples.delta)
    lever = P["x_R"] + p["a_H"] * p["x_H"] * P["L"]
    return np.array([-(1 - p["t_R"]) * F * np.sin(samples.delta), -(1 + p["a_H"]) * cosine, -lever * cosine])


def hull_terms(samples: projection.Motions) -> dict[str, dict[str, np.ndarray]]:
    """Terms of the hull polynomial by letter and symbol, (M,) each [N, N m]. samples: motions."""
    P, (U, _, v1, r1) = samples.ship.particulars, _inflow(samples)
    unit = 0.5 * P["rho"] * P["L"] * P["d"] * U**2
    columns: dict[str, dict[str, np.ndarray]] = {}
    for letter, symbols in HULL.items():
        lever = P["L"] if letter == "N" else 1.0
        columns[letter] = {}
        for symbol in symbols:
            powers = "" if symbol == "R_0" else symbol[2:]  # the letters behind "X_": X_vvvv is v'^4
            sign = -1.0 if symbol == "R_0" else 1.0
            columns[letter][symbol] = sign * lever * unit * v1 ** powers.count("v") * r1 ** powers.count("r")
    return columns


def force(samples: projection.Motions, p: Mapping[str, float]) -> np.ndarray:
    """X, Y [N], N [N m] (3, M) of the whole model. samples: motions; p: parameters by symbol."""
    thrust, one_minus_w, K_T = propeller(samples, p)
    total = rudder(samples, p, one_minus_w, K_T)
    total[0] += thrust
    for k, terms in enumerate(hull_terms(samples).values()):
        total[k] += sum(p[symbol] * values for symbol, values in terms.items())
    return total


def project(samples: projection.Motions) -> tuple[dict[str, float], tuple[projection.ChannelError, ...]]:
    """Parameters by symbol and the errors. Propeller and rudder are fitted to the ship's own, the hull to what is left,
    and then all together to the whole force. samples: motions of the ship."""
    needed = samples.needed_force()
    values = {s: c.value for s, c in samples.ship.coefficients.items()}
    start = {name: values.get(name, values.get(OTHER_NAMES.get(name, ""), row[0])) for name, row in _OWN.items()}
    if "epsilon" in values and "k_x" in values:  # k_x = epsilon kappa: what the race adds
        start["kappa"] = values["k_x"] / values["epsilon"]
    bounds = {name: row[1:] for name, row in _OWN.items()}
    fixed = {"t_P": start.pop("t_P")}  # the thrust alone does not tell it from k_0
    own_X, own_R = samples.forces["propeller"][0], samples.forces["rudder"]  # (M,), (3, M)
    size_X, size_R = _rms(own_X), np.array([_rms(row) for row in own_R])[:, None]

    def screw(x: np.ndarray) -> np.ndarray:
        return (propeller(samples, fixed | dict(zip(first, x, strict=True)))[0] - own_X) / size_X

    first = {name: start[name] for name in SCREW if name in start}
    parameters = fixed | projection.fit_parameters(screw, first, bounds)
    _, one_minus_w, K_T = propeller(samples, parameters)

    def blade(x: np.ndarray) -> np.ndarray:
        return ((rudder(samples, dict(zip(second, x, strict=True)), one_minus_w, K_T) - own_R) / size_R).ravel()

    second = {name: start[name] for name in BLADE}
    parameters |= projection.fit_parameters(blade, second, bounds)
    return _together(samples, parameters, needed, bounds, own_X)


_OWN = SCREW | BLADE


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) or 1.0


def _remainder(
    samples: projection.Motions, p: Mapping[str, float], needed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What propeller and rudder leave of the force (3, M), and the thrust X_P (M,)."""
    thrust, one_minus_w, K_T = propeller(samples, p)
    remainder = needed - rudder(samples, p, one_minus_w, K_T)
    remainder[0] -= thrust
    return remainder, thrust


def _together(
    samples: projection.Motions,
    start: dict[str, float],
    needed: np.ndarray,
    bounds: Mapping[str, tuple[float, float]],
    own_thrust: np.ndarray,
) -> tuple[dict[str, float], tuple[projection.ChannelError, ...]]:
    """All parameters, the hull's linear ones inside, and the errors. The propeller's thrust is held to the ship's."""
    size = np.array([_rms(row) for row in needed])[:, None]
    terms = hull_terms(samples)
    columns = [np.array(list(row.values())).T for row in terms.values()]
    # what the hull's linear terms cannot hold of a remainder is its part outside their span (variable projection,
    # Golub and Pereyra 1973): they need no place among the parameters that iterate
    bases = [np.linalg.qr(a)[0] for a in columns]
    free = {name: start[name] for name in _OWN if name != "t_P"}

    def residual(x: np.ndarray) -> np.ndarray:
        remainder, thrust = _remainder(samples, start | dict(zip(free, x, strict=True)), needed)
        off = [(row - Q @ (Q.T @ row)) / s for row, Q, s in zip(remainder, bases, size, strict=True)]
        # 0.3, set by hand: enough that resistance and thrust do not drift away together, which the sum would not see
        return np.concatenate([*off, 0.3 * (thrust - own_thrust) / _rms(own_thrust)])

    parameters = start | projection.fit_parameters(residual, free, bounds)
    remainder, _ = _remainder(samples, parameters, needed)
    for row, letter in zip(remainder, terms, strict=True):
        parameters |= projection.linear_parameters(terms[letter], row)
    return parameters, projection.channel_errors(needed, force(samples, parameters))


def dictionaries(samples: projection.Motions, p: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Arguments of Mmg3DofBasicParams and of Mmg3DofManeuveringParams. samples: motions; p: parameters by symbol."""
    P, mass = samples.ship.particulars, samples.mass
    basic = {
        "L_pp": P["L"], "B": P["B"], "d": P["d"], "x_G": P["x_G"], "D_p": P["D_P"], "m": P["m"],
        # I_z holds the added inertia, which therefore is 0 beside it
        "I_zG": mass.I_z - P["x_G"] ** 2 * P["m"], "A_R": P["A_R"], "m_x": mass.m_x, "m_y": mass.m_y, "J_z": 0.0,
        "η": P["D_P"] / math.sqrt(P["A_R"] * P["aspect_ratio"]), "x_R": P["x_R"],
    }  # fmt: skip
    for name in (*BLADE, "t_P", "w_P0", "x_P"):
        basic[BASIC.get(name, name)] = p[name] * (P["L"] if name == "x_H" else 1.0)  # x_H alone in metres there
    maneuvering = {name: p[name] for name in ("k_0", "k_1", "k_2")}
    maneuvering |= {f"{symbol}_dash": p[symbol] for symbols in HULL.values() for symbol in symbols}
    # Python reads names in this form: ϵ becomes ε, as the arguments of the class are called
    return {normalize("NFKC", name): float(value) for name, value in basic.items()}, maneuvering
