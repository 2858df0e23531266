"""Steady and gusty true wind: one-dimensional Ornstein-Uhlenbeck filters for speed and direction.

dU = -alpha_u (U - U_mean) dt + sigma_u dW, dgamma = -alpha_g sin(gamma - gamma_mean) dt + sigma_g dW; the
filter of the speed matches Hino's spectrum at f = 0 and 0.5 Hz, that of the direction a spread of 32 U^(-3/4)
degrees (Maki et al. 2022). The time scale is that of real wind, for models too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cases.quantities import as_number
from mmg.errors import BadValue, OutOfRange

REFERENCE_FREQUENCY = 0.5  # Hz at which filter and spectrum agree, besides zero (Maki et al. 2022)
HEIGHT = 15.0  # m above the sea, for which Hino's spectrum is taken: that of the published check values
STRONGEST = 115.0  # m/s; the strongest gust ever measured has 113 (Barrow Island, 1996)


@dataclass(frozen=True)
class GustFilter:
    """Rates alpha [1/s] and intensities sigma [m/s / sqrt(s), rad / sqrt(s)] of the two filters."""

    alpha_u: float
    sigma_u: float
    alpha_direction: float
    sigma_direction: float


def hino_spectrum(f: float, mean: float) -> float:
    """Two-sided spectrum of the wind speed [m^2/s] at f [Hz] for a mean speed [m/s] > 0 at HEIGHT."""
    drag, exponent = 0.001, 1.0 / 8.0  # of the sea surface, and of the power law of the speed by height [-]
    variance = 6 * drag * mean**2
    beta = 1.169e-3 * mean * exponent / math.sqrt(drag) * (HEIGHT / 10) ** (4 * exponent - 1)
    return 0.2382 * variance / beta * (1 + (f / beta) ** 2) ** (-5 / 6)


def gust_filter(mean: float) -> GustFilter:
    """The filters for a mean wind speed [m/s] > 0."""
    at_zero, at_reference = hino_spectrum(0.0, mean), hino_spectrum(REFERENCE_FREQUENCY, mean)
    alpha = 2 * math.pi * REFERENCE_FREQUENCY * math.sqrt(at_reference / (at_zero - at_reference))
    # stationary spread sigma / sqrt(2 alpha) of the direction: 32 U^(-3/4) deg; its intensity [deg / sqrt(s)] is fixed
    spread = 2.3
    return GustFilter(
        alpha_u=alpha,
        sigma_u=math.sqrt(at_zero) * alpha,  # S(f) = sigma^2 / (alpha^2 + (2 pi f)^2)
        alpha_direction=spread**2 * mean**1.5 / (2 * 32.0**2),
        sigma_direction=math.radians(spread),
    )


@dataclass(frozen=True)
class Wind:
    """True wind over ground: mean speed [m/s], mean direction it comes from [rad], gusty or steady."""

    speed: float
    direction: float = 0.0
    gusty: bool = False

    def series(self, t: np.ndarray, seed: int = 0) -> np.ndarray:
        """Speed [m/s], never negative, and direction [rad in 0..2 pi], (N, 2), at rising times t (N,) [s].

        Gusts start from the mean and are reproducible by ``seed``. The update of the speed is exact for any step, that
        of the direction is exact for small deviations (its rate is frozen at alpha sin(e) / e over a step).
        """
        mean = np.full(len(t), self.speed)
        direction = np.full(len(t), self.direction)
        if self.gusty and self.speed > 0:
            filters = gust_filter(self.speed)
            draws = np.random.default_rng([1, seed]).standard_normal((len(t), 2))
            deviation, turn = 0.0, 0.0
            for k, dt in enumerate(np.diff(t), start=1):
                deviation = _advance(deviation, filters.alpha_u, filters.sigma_u, dt, draws[k, 0])
                turn = math.remainder(turn, 2 * math.pi)  # the pull goes with its sine: the same after a whole turn
                rate = filters.alpha_direction * (math.sin(turn) / turn if abs(turn) > 1e-9 else 1.0)
                turn = _advance(turn, max(rate, 0.0), filters.sigma_direction, dt, draws[k, 1])
                mean[k] += deviation
                direction[k] += turn
        return np.column_stack([np.maximum(mean, 0.0), np.mod(direction, 2 * math.pi)])


def _advance(value: float, alpha: float, sigma: float, dt: float, draw: float) -> float:
    """Exact step of an Ornstein-Uhlenbeck process about zero; a random walk where alpha is zero."""
    growth = -math.expm1(-2 * alpha * dt) / (2 * alpha) if alpha * dt > 1e-12 else dt
    return value * math.exp(-alpha * dt) + sigma * math.sqrt(growth) * draw


def parse_wind(text: str) -> Wind:
    """A wind from "speed:direction" or "speed:direction:gusty", m/s and degrees it comes from. Raises UserError when
    the text is anything else."""
    if not isinstance(text, str):
        words = 'give "speed:direction" [m/s, deg it comes from]; one that changes is given to simulate at times, as'
        raise BadValue(f"wind: {type(text).__name__} is no text; {words} wind_speed [m/s] and wind_direction [rad]")
    parts = [part.strip() for part in text.split(":")]
    speed, direction = (as_number(part) for part in (*parts, "", "")[:2])
    fits = len(parts) == 2 or (len(parts) == 3 and parts[2] == "gusty")
    if not (fits and math.isfinite(direction) and 0 <= speed < math.inf):
        raise BadValue(
            f"wind '{text}': write speed:direction or speed:direction:gusty in m/s and degrees it "
            "comes from, such as 1.5:60:gusty"
        )
    if speed > STRONGEST:
        raise OutOfRange(f"wind '{text}': {speed:g} m/s is more than any wind; at most {STRONGEST:g} m/s")
    return Wind(speed, math.radians(direction) % (2 * math.pi), len(parts) == 3)
