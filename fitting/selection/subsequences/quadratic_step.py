"""The minimum of a quadratic plus weighted moduli within a box: one step of a proximal Newton method.

Accelerated proximal gradients with restarts (Beck & Teboulle 2009; O'Donoghue & Candes 2015) in variables scaled by the
diagonal find which coefficients are zero or at a bound; the others are then solved for exactly.
"""

from __future__ import annotations

import numpy as np

ROUNDS, STEPS, FACES = 12, 20, 10
"""Most rounds, gradient steps in each, and exact solutions after these, each with further coefficients held."""


def minimise_quadratic(
    H: np.ndarray, g: np.ndarray, p: np.ndarray, box: tuple[np.ndarray, np.ndarray], weight: np.ndarray
) -> np.ndarray:
    """The point x (P,) that makes g (x - p) + 1/2 (x - p) H (x - p) + sum weight |x| least within ``box``.

    H: (P, P), positive definite; g, p, weight: (P,); p within the box. The value found is never above that of p.
    """
    scale = 1 / np.sqrt(np.diag(H))
    A, b = H * np.outer(scale, scale), scale * g
    low, high, lam, origin = box[0] / scale, box[1] / scale, weight * scale, p / scale
    largest = _largest_eigenvalue(A)

    def value(x: np.ndarray) -> float:
        d = x - origin
        return float(b @ d + 0.5 * d @ (A @ d) + lam @ np.abs(x))

    direct = np.clip(_shrunk(origin - np.linalg.solve(A, b), lam / largest), low, high)
    best, least = min(((x, value(x)) for x in (direct, origin)), key=lambda pair: pair[1])
    for _ in range(ROUNDS):
        before = least
        x = y = best
        t = 1.0
        for _ in range(STEPS):
            new = np.clip(_shrunk(y - (b + A @ (y - origin)) / largest, lam / largest), low, high)
            t = 1.0 if (y - new) @ (new - x) > 0 else t
            later = 0.5 * (1 + np.sqrt(1 + 4 * t * t))
            y, x, t = new + (t - 1) / later * (new - x), new, later
        for _ in range(FACES):
            for point in (x, faced := _on_face(A, b, origin, x, (low, high), lam)):
                if (found := value(point)) < least:
                    best, least = point, found
            if np.array_equal(faced != 0, x != 0) and np.array_equal(faced <= low, x <= low):
                break
            x = faced
        if before - least <= 1e-9 * max(value(origin) - least, 1e-300):
            break
    return best * scale


def _shrunk(x: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Soft threshold."""
    return np.sign(x) * np.maximum(np.abs(x) - by, 0)


def _largest_eigenvalue(A: np.ndarray) -> float:
    """An upper estimate by the power method."""
    x = np.ones(len(A))
    for _ in range(30):
        x = A @ x
        x /= np.linalg.norm(x)
    return 1.05 * float(x @ (A @ x))


def _on_face(
    A: np.ndarray, b: np.ndarray, origin: np.ndarray, x: np.ndarray, box: tuple[np.ndarray, np.ndarray], lam: np.ndarray
) -> np.ndarray:
    """The minimum with the zeros, bounds and signs of ``x`` kept; x itself goes that way as far as they hold."""
    sign = np.sign(x)
    free = (x > box[0]) & (x < box[1]) & ((x != 0) | (lam == 0))
    if not free.any():
        return x
    gradient = b + A @ (x - origin) + lam * sign
    step = np.zeros_like(x)
    step[free] = -np.linalg.solve(A[np.ix_(free, free)], gradient[free])
    low, high = np.where((sign > 0) & (lam > 0), 0.0, box[0]), np.where((sign < 0) & (lam > 0), 0.0, box[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(step > 0, (high - x) / step, np.where(step < 0, (low - x) / step, np.inf))
    share = float(room.min())
    if share >= 1:
        return x + step
    moved = x + share * step
    stopped = room <= share * (1 + 1e-12)
    moved[stopped] = np.where(step > 0, high, low)[stopped]
    return np.clip(moved, low, high)
