"""Forces of captive tests as further residuals of a calibration: X, Y, N at given u, v, r, n, delta.

A point is the hydrodynamic force on the model, as in the MMG equations (m + m_x) u' - (m + m_y) v r = X and so on:
inertia and the centripetal forces of mass and added mass taken off, propeller and rudder included, no wind. One set of
points is the table of a planar-motion, oblique-towing or rotating-arm campaign.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from cases.io.read import split_header
from cases.io.trial_table import trial_table
from cases.quantities import to_si
from mmg.compile.batch import batch_functions
from mmg.errors import Missing, OutOfRange, UnknownName
from mmg.model import Model
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS

FORCES = ("X", "Y", "N")  # surge and sway force [N], yaw moment about midship [N m]: the rows of all (3, M) arrays
UNITS = {"X": ("N", "kN"), "Y": ("N", "kN"), "N": ("N m", "kN m", "Nm", "kNm")}
THRUSTERS = ("n_bow", "n_stern")  # At rest where the table has no column for them, as in trials
FLOOR = 0.03  # Standard deviation of a force when the table gives none, by its rms over the points. Set by hand.


@dataclass(frozen=True)
class Captive:
    """Captive points: motion (3, M): u, v, r; actuators by name (M,); forces and their sigma, (3, M) each, SI."""

    name: str
    motion: np.ndarray
    actuators: dict[str, np.ndarray]
    forces: np.ndarray
    sigma: np.ndarray

    def __len__(self) -> int:
        return self.motion.shape[1]


def read_captive(path: Path, sigma: tuple[float, ...] | None = None) -> Captive:
    """Points of the CSV or Parquet file ``path`` with headers such as ``u [m/s], ..., X [N], Y [N], N [N m]``.

    Columns sigma_X, sigma_Y, sigma_N give standard deviations point by point; ``sigma``, of X, Y [N] and N [N m], is
    for those that the file does not give; without either it is 3 % of the rms of the column. A force may be empty in
    some rows: it is then not used there. A tunnel thruster without a column is at rest. Raises UserError for missing
    columns, unknown units, empty motion.
    """
    if not path.exists():
        raise Missing(f"{path}: no such file; --captive takes a table of captive-test points")
    header = (table := trial_table(path)).header
    cells = {name: (i, unit) for i, (name, unit) in enumerate(split_header(cell) for cell in header)}
    present = {"delta" if name.startswith("delta") else name for name in cells}  # twin rudders: delta_port, ...
    if missing := [name for name in ("u", "v", "r", "n", *FORCES, "delta") if name not in present]:
        raise Missing(f"{path}: missing column {', '.join(missing)}; found: {', '.join(header)}")
    factors: dict[str, tuple[int, float]] = {}
    for name, (i, unit) in cells.items():
        force = name.removeprefix("sigma_")
        if force in FORCES:
            if unit not in UNITS[force]:
                raise UnknownName(f"{path}: column '{header[i]}' needs a unit out of {', '.join(UNITS[force])}")
            factors[name] = i, 1e3 if unit.startswith("k") else 1.0
        elif name in ("u", "v", "r", *INPUTS) or name.startswith(("n", "delta")):  # "n_x" is refused, "remarks" is not
            try:
                factors[name] = i, to_si(name, unit, f"{path}: column '{header[i]}'")
            except KeyError:
                raise UnknownName(f"{path}: column '{header[i]}' is no actuator that a ship can have") from None
    numbers = table.numbers([i for i, _ in factors.values()])
    columns = {name: numbers[i] * factor for name, (i, factor) in factors.items()}
    motion = np.array([columns[name] for name in ("u", "v", "r")])
    actuators = {name: columns[name] for name in columns if name in INPUTS}
    empty = ~np.isfinite(np.vstack([motion, *actuators.values()])).all(axis=0)  # a force may be missing
    if empty.any():
        row = int(np.flatnonzero(empty)[0])
        raise Missing(f"{path}: row {row + 1} lacks a motion or an actuator ({int(empty.sum())} such rows)")
    forces = np.array([columns[name] for name in FORCES])
    sizes, measured = np.empty_like(forces), np.isfinite(forces)
    for i, name in enumerate(FORCES):
        rms = float(np.sqrt(np.mean(forces[i, measured[i]] ** 2))) if measured[i].any() else 0.0
        sizes[i] = columns.get(f"sigma_{name}", sigma[i] if sigma else FLOOR * rms)
        if not (sizes[i, measured[i]] > 0).all():
            raise OutOfRange(f"{path}: the standard deviation of {name} must be positive; give it with --captive-sigma")
    # infinite where a force is missing: a weight of zero, no part in the cost
    return Captive(path.stem, motion, actuators, forces, np.where(measured, sizes, np.inf))


class CaptiveForces:
    """1/2 sum of squared residuals of a model's forces, and derivatives to the free coefficients, all exact.

    free: positions of the free coefficients among all. Arguments ``theta`` are all coefficients.
    """

    def __init__(self, model: Model, free: np.ndarray, points: Captive, compiled: bool = True) -> None:
        self.points, self.P = points, len(free)
        self._inputs = self._arrays(model, points)
        u, c = ca.SX.sym("motion", 3), ca.SX.sym("controls", len(model.controls))
        theta, mu = ca.SX.sym("theta", len(model.symbols)), ca.SX.sym("mu", 3)
        state = model.initial(ca.vertcat(0, 0, 0, u), c, theta)  # lags and memory settled
        rows = model.forces(state, c, theta)
        kept = [i for i, role in enumerate(model.roles) if role != "wind"]
        F = ca.sum1(rows[kept, :]).T  # without wind, by the head of this file
        x = ca.vertcat(*[theta[int(i)] for i in free])
        J, H = ca.jacobian(F, x), ca.triu(ca.hessian(ca.dot(mu, F), x)[0])  # H is symmetric: half of it
        self._J_at, self._H_at = (np.array(A.sparsity().get_triplet(), dtype=int) for A in (J, H))
        functions = [
            ca.Function("captive_values", [u, c, theta], [F], {"cse": True}),
            ca.Function("captive_jacobian", [u, c, theta], [J], {"cse": True}),
            ca.Function("captive_hessian", [u, c, theta, mu], [H], {"cse": True}),
        ]
        self._batch = batch_functions(functions, compiled)[0]
        self.weight = 1 / points.sigma**2
        self.measured = np.nan_to_num(points.forces)

    @staticmethod
    def _arrays(model: Model, points: Captive) -> tuple[np.ndarray, np.ndarray]:
        """Motion (3, M) and inputs (C, M) of the model: at rest relative to the air, at time 0."""
        # wind that moves with the model; psi = 0, so that axes of the body are those of the earth
        still = {"wind_north": points.motion[0], "wind_east": points.motion[1], "time": np.zeros(len(points))}
        rows = dict.fromkeys(THRUSTERS, np.zeros(len(points))) | points.actuators | still
        # one column may be that of twins
        shared = {name: name.split("_")[0] for name in model.controls if name in (*PROPELLERS, *RUDDERS)}
        controls = [rows.get(name, rows.get(shared.get(name, ""))) for name in model.controls]
        for name, row in zip(model.controls, controls, strict=True):
            if row is None:
                raise Missing(f"{points.name}: no column {name}, which {model.ship.name} has for an actuator")
        return points.motion, np.array(controls)

    def _call(self, which: int, theta: np.ndarray, *more: np.ndarray) -> np.ndarray:
        motion, controls = self._inputs
        return self._batch[which].at(motion, controls, theta, *more)[0]

    def residuals(self, theta: np.ndarray) -> np.ndarray:
        """Model minus measured forces (3, M), 0 where none was measured."""
        return np.where(self.weight > 0, self._call(0, theta) - self.measured, 0.0)

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """d forces / d free coefficients, (M, 3, P)."""
        J = np.zeros((len(self.points), 3, self.P))
        J[:, self._J_at[0], self._J_at[1]] = self._call(1, theta).T  # the kernel returns nonzeros alone
        return J

    def cost(self, theta: np.ndarray) -> float:
        return 0.5 * float((self.weight * self.residuals(theta) ** 2).sum())

    def gradient(self, theta: np.ndarray) -> np.ndarray:
        return np.einsum("im,mip->p", self.weight * self.residuals(theta), self.jacobian(theta))

    def information(self, theta: np.ndarray) -> np.ndarray:
        """Fisher information of the free coefficients, (P, P)."""
        J = self.jacobian(theta)
        return np.einsum("mip,im,miq->pq", J, self.weight, J, optimize=True)

    def hessian(self, theta: np.ndarray) -> np.ndarray:
        """Hessian of ``cost``, (P, P)."""
        H = np.zeros((self.P, self.P))
        H[self._H_at[0], self._H_at[1]] = self._call(2, theta, self.weight * self.residuals(theta)).sum(axis=1)
        return self.information(theta) + H + np.triu(H, 1).T  # J'WJ, and second derivatives of the forces by residuals


def estimate_from_captive(
    forces: CaptiveForces, base: np.ndarray, free: np.ndarray, mean: np.ndarray, std: np.ndarray, ridge: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Minimum p (P,) of the captive cost + ridge/2 |p|^2 over free = mean + std p, and its covariance (P, P).

    forces: of the points; base: all coefficients (all,); free: positions of the free ones (P,); mean, std: of their
    prior (P,); ridge: 1 for the prior as it stands, smaller for a wider one. Bounds are not regarded.
    """
    weight, prior = np.sqrt(forces.weight), np.sqrt(ridge) * np.eye(len(free))

    def at(p: np.ndarray) -> np.ndarray:
        theta = base.copy()
        theta[free] = mean + std * p
        return theta

    def residuals(p: np.ndarray) -> np.ndarray:
        return np.concatenate([(weight * forces.residuals(at(p))).ravel(), prior @ p])

    def slopes(p: np.ndarray) -> np.ndarray:
        J = weight[..., None] * np.moveaxis(forces.jacobian(at(p)), 1, 0) * std  # (3, M, P), as the residuals
        return np.vstack([J.reshape(-1, len(p)), prior])

    p = least_squares(residuals, np.zeros(len(free)), slopes, method="lm").x
    J = slopes(p)
    return p, np.linalg.inv(J.T @ J)
