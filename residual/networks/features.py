"""What a black box sees and what it needs no data for: features of motion, inputs and air; the kinematics."""

from __future__ import annotations

import torch


def features(logged: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
    """u, v, r, actuators, a_x, a_y, (F, M), from columns ``logged`` (6, M) and ``controls`` (F - 3, M), the air last.

    a_x, a_y [m/s]: velocity of the air relative to the hull in body axes, minus w' of Wakita et al. (2022), Eq. 6.
    """
    _, _, psi, u, v, _ = logged
    c, s = torch.cos(psi), torch.sin(psi)
    north, east = controls[-2], controls[-1]
    air = torch.stack([c * north + s * east - u, c * east - s * north - v])
    return torch.cat([logged[3:6], controls[:-2], air])


def kinematics(logged: torch.Tensor) -> torch.Tensor:
    """Rates of x, y, psi (3, M) at columns ``logged`` (6, M): Wakita et al. (2022), Eq. 5."""
    _, _, psi, u, v, r = logged
    c, s = torch.cos(psi), torch.sin(psi)
    return torch.stack([u * c - v * s, u * s + v * c, r])


def advance_columns(logged: torch.Tensor, accelerations: torch.Tensor, h: float, method: str) -> torch.Tensor:
    """Columns ``logged`` (6, M) a step of ``h`` [s] later under ``accelerations`` (3, M) that are held over it.

    method: "euler": Wakita et al. (2022), Eq. 20 to 22; "rk4": kinematics by the midpoint rule, with an error of third
    order.
    """
    velocities = logged[3:6] + h * accelerations
    if method == "euler":
        return torch.cat([logged[:3] + h * kinematics(logged), velocities])
    turned = logged[2] + 0.5 * h * (logged[5] + 0.25 * h * accelerations[2])
    middle = torch.cat([logged[:2], turned[None], logged[3:6] + 0.5 * h * accelerations])
    return torch.cat([logged[:3] + h * kinematics(middle), velocities])
