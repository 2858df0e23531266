"""A vehicle class for the Python Vehicle Simulator (Fossen): the ship projected on the form of its tanker.

With bis-like factors, as in that class (Van Berlekom & Goddard 1972, SNAME Trans. 80), beta = v/u:
m11 L u' = Xuu u^2 + L d11 v r + Xvv v^2 + Xccdd c^2 delta^2 + Xccbd c^2 beta delta + L g_T (1 - t)
m22 L v' = Yuv u v + Yvv |v| v + Yccd c^2 delta + L d22 u r + Yccbbd c^2 |beta| beta |delta| + YT L g_T
m33 L^2 r' = Nuv u v + L Nvr |v| r + Nccd c^2 delta + L d33 u r + Nccbbd c^2 |beta| beta |delta| + NT L g_T
g_T = Tuu u^2/L + Tun u n + L Tnn |n| n, c^2 = c_uu u^2 + c_un u n + c_nn n^2 (c_uu is an addition: 0 in that class).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from delivery.dictionaries import projection
from delivery.product import Product, filled
from mmg.errors import Unsupported
from mmg.messages import Message
from mmg.motion.froude import time_scale

TEMPLATE = Path(__file__).parent / "templates" / "vehicle.py.j2"
SIMULATOR = "the Python Vehicle Simulator"


def write_vehicle(product: Product, target: Path) -> list[Message]:
    """Write the vehicle class of ``product`` to the Python file ``target``; returns what is to be said of the error.

    Raises UserError for what the form cannot hold.
    """
    if "n" not in product.ship.actuators or "propeller" not in product.ship.components:
        name = product.ship.name
        raise Unsupported(
            f"{SIMULATOR} needs a propeller of its own; {name} has none beside its hull model: {projection.EXACT}"
        )
    samples = projection.motions(product, SIMULATOR)
    p, errors = project(samples)
    messages = samples.messages(errors, SIMULATOR, f"the tanker of {SIMULATOR}")
    L = samples.ship.particulars["L"]
    scale, speed = time_scale(L), float(samples.u.max())
    # gain 1.5 and lead time L/U of the autopilot, ten seconds of a 3 m model before a step of rudder: set by hand
    words: dict[str, Any] = {
        "called": repr(f"{product.ship.title}, projected by mmg-ident"), "title": _in_docstring(product.ship.title),
        "name": product.identifier, "said": [_in_docstring(str(line)) for line in (*messages, *product.caveats)],
        "parameters": "{\n" + "".join(f'    "{name}": {value!r},\n' for name, value in p.items()) + "}",
        "rpm": round(60 * float(samples.n.max()), 3), "speed": speed, "length": L,
        "delta_max": round(math.degrees(float(np.abs(samples.delta).max())), 3),
        "delta_rate": round(math.degrees(projection.RATE) / scale, 3), "gain": 1.5, "time": round(L / speed, 3),
        "lead": round(10 * scale, 1),
    }  # fmt: skip
    target.write_text(filled(TEMPLATE, product, **words), encoding="utf-8")
    return messages


def _in_docstring(text: str) -> str:
    """A ``text`` that no name in it can end: a ship may be called anything."""
    return text.replace("\\", "/").replace('"', "'")  # a backslash would escape, three quotes would end it


def _shared(samples: projection.Motions, p: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """beta, c^2 and g_T (M,) of the form."""
    L, n, u = samples.ship.particulars["L"], samples.n, samples.u
    c2 = p["c_uu"] * u * np.abs(u) + p["c_un"] * u * n + p["c_nn"] * np.abs(n) * n
    thrust = p["Tuu"] * u**2 / L + p["Tun"] * u * n + L * p["Tnn"] * np.abs(n) * n
    return samples.v / u, np.maximum(c2, 0.0), thrust  # a square of a speed, whatever its three parts add up to


def terms(samples: projection.Motions, p: Mapping[str, float]) -> dict[str, dict[str, np.ndarray]]:
    """Terms of the three equations by letter and parameter, (M,) each, in m^2/s^2 (yaw: by L). samples: motions; p: has
    c_uu, c_un, c_nn and the thrust's."""
    L, u, v, r, delta = samples.ship.particulars["L"], samples.u, samples.v, samples.r, samples.delta
    beta, c2, thrust = _shared(samples, p)
    turned = c2 * np.abs(beta) * beta * np.abs(delta)
    return {
        "X": {"Xuu": u**2, "d11": L * v * r, "Xvv": v**2, "Xccdd": c2 * delta**2, "Xccbd": c2 * beta * delta},
        "Y": {
            "Yuv": u * v, "Yvv": np.abs(v) * v, "Yccd": c2 * delta, "d22": L * u * r, "Yccbbd": turned,
            "YT": L * thrust,
        },
        "N": {
            "Nuv": u * v, "Nvr": L * np.abs(v) * r, "Nccd": c2 * delta, "d33": L * u * r, "Nccbbd": turned,
            "NT": L * thrust,
        },
    }  # fmt: skip


def project(samples: projection.Motions) -> tuple[dict[str, float], tuple[projection.ChannelError, ...]]:
    """Parameters of the form and the errors, by ``samples``: motions of the ship."""
    P, mass = samples.ship.particulars, samples.mass
    L, m, u, n = P["L"], P["m"], samples.u, samples.n
    # 0.2: thrust deduction of a usual ship, set by hand; the factors of g_T take up what it is off
    t = samples.ship.coefficients["t_P"].value if "t_P" in samples.ship.coefficients else 0.2
    p = {"m11": (m + mass.m_x) / m, "m22": (m + mass.m_y) / m, "m33": mass.I_z / (m * L**2), "t": t}
    pull = {"Tuu": u**2 / L, "Tun": u * n, "Tnn": L * np.abs(n) * n}
    p |= projection.linear_parameters(pull, samples.forces["propeller"][0] / (m * (1 - t)))
    rates = np.array([p["m11"], p["m22"], p["m33"] * L])[:, None] * L * samples.rates  # left-hand sides (3, M)
    D2 = P.get("D_P", 0.03 * L) ** 2  # 3 % of the length: a usual screw, set by hand

    def with_slipstream(x: np.ndarray) -> dict[str, float]:
        """All parameters for shares ``x`` of u^2 and u n D in c^2."""
        q = p | {"c_uu": float(x[0]), "c_un": float(x[1]) * math.sqrt(D2), "c_nn": D2}
        remainder = rates.copy()
        # the thrust is the propeller's own, fitted before; all else of each equation is linear in its factors
        remainder[0] -= L * (1 - t) * _shared(samples, q)[2]
        for row, factors_of in zip(remainder, terms(samples, q).values(), strict=True):
            q |= projection.linear_parameters(factors_of, row)
        return q

    def residual(x: np.ndarray) -> np.ndarray:
        q = with_slipstream(x)
        off = form(samples, q) - rates
        return (off / np.sqrt(np.mean(rates**2, axis=1))[:, None]).ravel()

    # two shares by iteration, the linear factors inside
    shares = projection.fit_parameters(residual, {"uu": 0.5, "un": 0.5}, {"uu": (0.0, 20.0), "un": (-2.0, 20.0)})
    parameters = with_slipstream(np.array(list(shares.values())))
    needed = samples.needed_force(replace(mass, moment=0.0))  # the form couples v' and r' by no mass
    unit = np.array([m / L, m / L, m])[:, None]  # of an equation to a force [N], a moment [N m]
    return parameters, projection.channel_errors(needed, needed + unit * (form(samples, parameters) - rates))


def form(samples: projection.Motions, p: Mapping[str, float]) -> np.ndarray:
    """Right-hand sides of the three equations (3, M), that of yaw by L. samples: motions; p: all parameters."""
    sums = np.array([sum(p[name] * values for name, values in row.items()) for row in terms(samples, p).values()])
    sums[0] += samples.ship.particulars["L"] * (1 - p["t"]) * _shared(samples, p)[2]
    return sums
