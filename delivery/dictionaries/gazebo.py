"""The hydrodynamics plugin of Gazebo Sim: the hull projected on added mass, linear and quadratic damping.

``gz::sim::systems::Hydrodynamics`` with its cross terms (from 7.3): force = sum of factor times velocity, factor times
|velocity| velocity (xUabsU, yVabsR, ...) and factor times two velocities (xVR, yUR, ...), factors with the signs of
SNAME (1950), a drag negative, and xDotU u' and so on, added masses negative; its Coriolis terms are switched off, as
they differ between versions, and stand in xVR, yUR and nUV. In axes forward, port, up all these factors are those of
forward, starboard, down.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from delivery.dictionaries.projection import ChannelError, Motions, channel_errors, linear_parameters, motions
from delivery.product import Product, filled
from mmg.errors import Unsupported
from mmg.messages import Message

TEMPLATE = Path(__file__).parent / "templates" / "hull.sdf.j2"
# Radii of gyration: in yaw [-, by L] (Yasukawa & Yoshimura 2015); more yaw inertia is added mass. In roll [-, by B]: a
# usual value, set by hand, as nothing of the projection rolls.
GYRATION, ROLL_GYRATION = 0.25, 0.4
# Factors of the plugin by channel.
TERMS = {
    "X": ("xU", "xUabsU", "xVR", "xVV", "xRR"),
    "Y": ("yV", "yR", "yVabsV", "yVabsR", "yRabsV", "yRabsR", "yUV", "yUR"),
    "N": ("nV", "nR", "nVabsV", "nVabsR", "nRabsV", "nRabsR", "nUV", "nUR"),
}
SIMULATOR, TARGET = "Gazebo Sim", "the hydrodynamics plugin of Gazebo Sim"


def write_hull(product: Product, target: Path) -> list[Message]:
    """Write the hull of ``product`` as SDF to the file ``target``; returns what is to be said.

    Raises UserError where it cannot be held.
    """
    if "propeller" not in product.ship.components:
        raise Unsupported(
            f"{SIMULATOR} takes the hull alone, and that of {product.ship.name} holds its propeller and rudder: export "
            "the ship as fmu or c"
        )
    samples = motions(product, SIMULATOR)
    factors, errors = project(samples)
    messages = samples.messages(errors, TARGET, f"the hull in {TARGET}")
    P, mass = samples.ship.particulars, samples.mass
    coefficient, error = thrust_coefficient(samples)
    # rigid body and added mass are told apart by the radius of gyration: the ship has their sum I_z alone
    hull_inertia = P["m"] * (GYRATION * P["L"]) ** 2
    # I_z is about midship, the link's inertia about the centre of gravity: less moment x_G = m x_G^2 (Steiner)
    added = {"xDotU": mass.m_x, "yDotV": mass.m_y, "nDotR": max(mass.I_z - mass.moment * P["x_G"] - hull_inertia, 0.0)}
    parameters: dict[str, Any] = {name: repr(-value) for name, value in added.items()}  # negative: SNAME
    parameters |= {name: repr(value) for name, value in factors.items()}
    parameters |= {"disable_coriolis": "true", "water_density": P["rho"]}
    content: dict[str, Any] = {
        # no two hyphens in a row: they end a comment in XML
        "title": product.ship.title.replace("--", "- -"),
        "said": [str(line).replace("--", "- -") for line in (*messages, *product.caveats)],
        "name": product.identifier, "diameter": P["D_P"], "density": P["rho"], "thrust": f"{coefficient:.6g}",
        "thrust_error": f"{100 * error:.1f}", "x_G": P["x_G"], "mass": P["m"],
        "ixx": repr(P["m"] * (ROLL_GYRATION * P.get("B", 0.15 * P["L"])) ** 2), "iyy": repr(hull_inertia),
        "izz": repr(mass.I_z - mass.moment * P["x_G"] - added["nDotR"]), "parameters": parameters,
    }  # fmt: skip
    target.write_text(filled(TEMPLATE, product, markup=True, **content), encoding="utf-8")
    return messages


def wanted_force(samples: Motions) -> np.ndarray:
    """What the plugin's velocity terms must give (3, M): the force on the hull, without propeller and rudder, with what
    its added masses leave of the equations of motion. samples: motions."""
    mass = samples.mass
    driving = [samples.forces[role] for role in ("propeller", "rudder") if role in samples.forces]
    force = samples.needed_force() - sum(driving, np.zeros((3, len(samples.u))))
    # its added masses act on u' and v' alone: m_y v r and m_x u r of the ship are left
    force[0] += mass.m_y * samples.v * samples.r
    force[1] -= mass.m_x * samples.u * samples.r
    return force


def term(name: str, velocities: dict[str, np.ndarray]) -> np.ndarray:
    """Values (M,) of the term whose factor is called ``name``, such as xUabsU. velocities: U, V, R (M,)."""
    first, rest = velocities[name[1]], name[2:]
    if rest.startswith("abs"):
        return first * np.abs(velocities[rest[3:]])
    return first * (velocities[rest] if rest else 1.0)


def project(samples: Motions) -> tuple[dict[str, float], tuple[ChannelError, ...]]:
    """Factors by name and the errors, by the hull's force. samples: motions."""
    velocities = {"U": samples.u, "V": samples.v, "R": samples.r}
    wanted, projected = wanted_force(samples), []
    factors: dict[str, float] = {}
    for names, row in zip(TERMS.values(), wanted, strict=True):
        terms = {name: term(name, velocities) for name in names}
        row_factors = linear_parameters(terms, row)
        factors |= row_factors
        projected.append(np.sum([row_factors[name] * values for name, values in terms.items()], axis=0))
    return factors, channel_errors(wanted, np.array(projected))


def thrust_coefficient(samples: Motions) -> tuple[float, float]:
    """T / (rho D^4 omega^2), omega in rad/s, of the propeller's push, and its error (RMS) by that push.

    samples: motions of the ship.
    """
    P, X = samples.ship.particulars, samples.forces["propeller"][0]
    unit = P["rho"] * P["D_P"] ** 4 * (2 * math.pi * samples.n) ** 2
    factor = float(unit @ X / (unit @ unit))  # least squares by one factor
    return factor, float(np.sqrt(np.mean((factor * unit - X) ** 2) / np.mean(X**2)))
