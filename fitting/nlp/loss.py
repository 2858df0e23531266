"""Cost of a residual: its square, or less than that once it is too large to be noise.

With s = e^2 / sigma^2 of one sample in one channel the objective sums 1/2 phi(s). ``gaussian``: phi = s. ``huber``: the
pseudo-Huber function phi = 2 a (sqrt(1 + s / a) - 1), convex, growing like |e| beyond sqrt(a) sigma (Charbonnier et al.
1997). ``student``: phi = (a + 1/tau) log(1 + s / a), Student's t with nu degrees of freedom (Lange et al. 1989), on
which a gross outlier has no influence. sigma is the effective one, rms sqrt(tau) (fitting/solvers/noise.py),
but an outlier is one relative to the rms: a = threshold^2 / tau (huber), nu / tau (student).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cases.evidence.signals import MAD
from fitting.settings import LOSSES

# Residual [rms] beyond which ``huber`` stops being quadratic: 96 % efficient on Gaussian noise. (Huber 1981; the table
# of efficiencies.)
THRESHOLD = 1.5
# Degrees of freedom of ``student``. By Lange et al. (1989); see the row ``student`` of benchmarks/ablation.md.
NU = 4.0
# Robust standard deviations from which on a residual says nothing of the noise: 6e-5 of Gaussian ones. Set by hand.
OUTLYING = 4.0


@dataclass(frozen=True)
class Loss:
    """Cost of residuals by channel. name: one of LOSSES; tau: (6,) correlation times of residuals [samples].

    Residuals e and w (1 / sigma^2, 0 where nothing was measured) have the channels on axis 1: (B, 6) or (K - 1, 6, M).
    """

    name: str = "gaussian"
    tau: np.ndarray = field(default_factory=lambda: np.ones(6))

    def __post_init__(self) -> None:
        if self.name not in LOSSES:
            raise ValueError(f"loss {self.name!r} is none of {', '.join(LOSSES)}")

    @property
    def robust(self) -> bool:
        return self.name != "gaussian"

    def _over(self, e: np.ndarray, value: float) -> np.ndarray:
        """value / tau, shaped to go with e."""
        return (value / self.tau).reshape(6, *([1] * (e.ndim - 2)))

    def cost(self, w: np.ndarray, e: np.ndarray) -> np.ndarray:
        """phi of each sample."""
        s = w * e * e
        if self.name == "huber":
            # 2a (sqrt(1 + s/a) - 1) without cancellation
            return 2 * s / (np.sqrt(1 + s / self._over(e, THRESHOLD**2)) + 1)
        if self.name == "student":
            return self._over(e, NU + 1) * np.log1p(s / self._over(e, NU))
        return s

    def weight(self, w: np.ndarray, e: np.ndarray) -> np.ndarray:
        """W with d(1/2 phi)/de = W e: the weight that a sample has, at most about w."""
        if self.name == "huber":
            return w / np.sqrt(1 + w * e * e / self._over(e, THRESHOLD**2))
        if self.name == "student":  # (a + 1/tau) / a = (NU + 1) / NU: tau cancels
            return w * (NU + 1) / NU / (1 + w * e * e / self._over(e, NU))
        return w

    def second_derivative(self, w: np.ndarray, e: np.ndarray) -> np.ndarray:
        """Second derivative of 1/2 phi with respect to e; negative for ``student`` beyond sqrt(a)."""
        if self.name == "huber":
            return w * (1 + w * e * e / self._over(e, THRESHOLD**2)) ** -1.5
        if self.name == "student":
            x = w * e * e / self._over(e, NU)
            return w * (NU + 1) / NU * (1 - x) / (1 + x) ** 2
        return w


def without_outliers(residuals: list[np.ndarray]) -> list[np.ndarray]:
    """The ``residuals`` of one channel, (n,) each, with those beyond OUTLYING times 1.4826 median |e| made NaN."""
    everything = np.abs(np.concatenate(residuals)) if residuals else np.zeros(0)
    everything = everything[np.isfinite(everything)]
    limit = OUTLYING * MAD * float(np.median(everything)) if len(everything) else 0.0
    return [np.where(np.abs(e) > limit, np.nan, e) for e in residuals] if limit > 0 else residuals
