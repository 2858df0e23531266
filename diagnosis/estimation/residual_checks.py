"""Checks after a fit: correlation time of the latent force, whiteness of the residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import TransitionModel
from mmg.motion.froude import time_scale

# Of a spectrum. Set by hand.
LEAST_ROWS = 24  # Samples that a piece of a window needs
BINS = 30  # Bands at most
NEIGHBOURS = 3  # Bands on either side that a line is compared with, without those next to it
SLOWEST = 4  # Bands of the longest periods that are not looked at: the latent force follows them


IN_ANOTHER = 1e-3  # Probability of a line in a second sensor below which it is none of one sensor alone. Set by hand.
# Power of a line over that beside it, and the probability that one with less has at least: many samples show surely
# what a sensor or a random force of another shape makes, a hill of the spectrum, which is not as high. Set by hand.
TWICE, RARE = 2.0, 1e-6
# Ratio of the shortest periods of spectra that follow each other; each begins to look at SLOWEST times its own.
COARSER = 4.0  # set by hand
# Error of a velocity over a step, in the noise of its sensor, that the latent force may make by being held over it.
HELD = 0.3  # set by hand
FINEST = 4  # Parts into which a step is divided at most. Set by hand.


def finer_step(
    steps: TransitionModel, data: GriddedTrials, fit: Estimate, sample: float, divisible: bool = False
) -> float | None:
    """The step [s] at which the ``fit`` of ``steps`` to ``data`` should be repeated, or None.

    sample: sampling time of the trials [s], of which the step stays a multiple; divisible: or becomes a part. The mean
    over a step h of a process of first order is off the line through its ends by its size times sqrt(h / (6 tau)),
    which moves a velocity by that share of its response. Beyond quiet sensors it would pass for an effect with memory.
    """
    active = active_states(steps, fit.free.symbols, fit.theta)
    force = linearise_and_filter(steps, data, fit.fixed(), active).linear.force[:, :, 3:6]

    moved = force * fit.noise.force * np.sqrt(data.h / (6 * fit.noise.tau))  # (K, R, 3, 3) of u, v, r by X, Y, N
    if data.gusts is not None:
        blown = force @ data.gusts * fit.noise.gust * np.sqrt(data.h / (6 * fit.noise.gust_tau))
        moved = np.concatenate([moved, blown], axis=3)
    error = np.sqrt((moved[data.inside] ** 2).sum(axis=2).mean(axis=0)) / fit.noise.white[3:]
    worst = float(error.max())
    # the error goes with h^(3/2): h of the force, sqrt(h) of its change
    share = max((HELD / max(worst, 1e-9)) ** (2 / 3), 1 / FINEST)
    samples = max(1, int(data.h * share / sample + 1e-6))
    parts = int(np.ceil(sample / (data.h * share) - 1e-6)) if divisible and samples == 1 else 1
    finer = samples * sample / max(1, parts)
    return finer if worst > HELD and finer < 0.9 * data.h else None


FURTHEST = 0.7  # Most that a parabola changes the logarithm of a correlation time: a factor of two. Set by hand.
SHORTER = 4  # Parabolas at most. Set by hand: bounds time.


@np.errstate(all="ignore")
def with_correlation_time(steps: TransitionModel, data: GriddedTrials, fit: Estimate, least: float = 0.0) -> Estimate:
    """The ``fit`` of the model ``steps`` to ``data`` with the most likely correlation time of the latent force.

    The likelihood is taken as a parabola through three values of the logarithm of the time. Where its top lies at a
    shorter time than the parabola can tell, it is sought again from there: a force taken to remember for too long
    leaves residuals that pass for an effect. Not so for longer times, which an effect that is missing asks for. It
    stays as it is where the parabola promises a gain in log likelihood of no more than ``least``.
    """
    for _ in range(SHORTER):
        better, ends = _better_correlation_time(steps, data, fit, least)
        if ends:
            return better
        fit = better
    return fit


def _better_correlation_time(
    steps: TransitionModel, data: GriddedTrials, fit: Estimate, least: float
) -> tuple[Estimate, bool]:
    """One step of ``with_correlation_time``, and whether it was the last."""
    now = fit.noise
    # between equal size and equal change over a second
    a, b = _parabola(
        steps, data, fit, 0.6, lambda x: now.with_(tau=float(now.tau * np.exp(x)), force=now.force * np.exp(0.25 * x))
    )
    if not a > 0 or b**2 / (4 * a) <= least:  # not >: nan; a top that opens downwards is none
        return fit, True
    shift = float(np.clip(-b / (2 * a), -FURTHEST, FURTHEST))  # the top of the parabola
    tau = float(now.tau * np.exp(shift))
    if not 2 * data.h <= tau <= 60 * data.h:  # shorter is white, longer is constant
        return fit, True
    better = estimate(steps, data, replace(fit, noise=now.with_(tau=tau)), iterations=6)
    return better, shift > -FURTHEST or not better.nll < fit.nll


def _parabola(
    steps: TransitionModel, data: GriddedTrials, fit: Estimate, apart: float, changed: Callable[[float], NoiseModel]
) -> tuple[float, float]:
    """Curvature a and slope b of the negative log likelihood a x^2 + b x + c of ``fit`` through three points, x being
    0 and ``apart`` on either side, with the noise that is ``changed`` by x."""
    active, at = active_states(steps, fit.free.symbols, fit.theta), (-apart, 0.0, apart)
    linear, nlls = None, []
    for x in at:
        here = linearise_and_filter(steps, data, replace(fit.fixed(), noise=changed(x)), active, linear=linear)
        linear = here.linear
        nlls.append(here.nll)
    a, b, _ = np.polyfit(at, nlls, 2)
    return float(a), float(b)


# Shortest and longest memory of gusts [s of a 3 m model]: slower ones the anemometer shows, or they pass for an effect
# of the wind. Set by hand.
GUST_MEMORY = (0.25, 4.0)
WORTH = 1.0  # Gain in log likelihood for which it pays to fit with another memory. Set by hand.


@np.errstate(all="ignore")
def with_gust_memory(steps: TransitionModel, data: GriddedTrials, fit: Estimate) -> Estimate:
    """The ``fit`` of the model ``steps`` to ``data`` with the most likely memory of gusts, where there are any.

    As ``with_correlation_time``, by one parabola.
    """
    if data.gusts is None:
        return fit
    now = fit.noise
    # the longer they last, the smaller they are
    a, b = _parabola(
        steps, data, fit, 0.7,
        lambda x: now.with_(gust_tau=float(now.gust_tau * np.exp(x)), gust=now.gust * np.exp(-0.25 * x)),
    )  # fmt: skip
    if not a > 0 or b**2 / (4 * a) < WORTH:
        return fit
    low, high = (factor * time_scale(float(steps.ship.particulars["L"])) for factor in GUST_MEMORY)
    tau = float(np.clip(now.gust_tau * np.exp(np.clip(-b / (2 * a), -2 * FURTHEST, 2 * FURTHEST)), low, high))
    better = estimate(steps, data, replace(fit, noise=now.with_(gust_tau=tau)), iterations=6)
    return better if better.nll < fit.nll else fit


@np.errstate(all="ignore")
def residuals(steps: TransitionModel, data: GriddedTrials, fit: Estimate) -> np.ndarray:
    """Whitened residuals (K + 1, R, 6) of the ``fit`` of ``steps`` to ``data``, 0 where nothing is compared."""
    active = active_states(steps, fit.free.symbols, fit.theta)
    return np.where(data.good, linearise_and_filter(steps, data, fit.fixed(), active).left, 0.0)


def lag_correlation(data: GriddedTrials, w: np.ndarray) -> float:
    """Largest correlation of whitened residuals w (K + 1, R, 6) of ``data`` one or two samples apart, over sensors."""
    w = w[data.good.any(axis=(1, 2))][4:]  # the first samples of a filter hardly say anything
    square = (w**2).sum(axis=(0, 1))
    # autocorrelation by sensor at lags 1 and 2
    pairs = [np.abs((w[lag:] * w[:-lag]).sum(axis=(0, 1))) / np.maximum(square, 1e-300) for lag in (1, 2)]
    return float(np.max(pairs)) if len(w) > 4 else 0.0


def spectral_line(
    data: GriddedTrials, w: np.ndarray, dense: tuple[GriddedTrials, np.ndarray] | None = None
) -> tuple[float, float]:
    """(p, period [s]) of the sharpest line in the spectrum of whitened residuals w (K + 1, R, 6) of ``data``.

    dense: the same trials with all samples compared, and their residuals. Where ``data`` resolve a period (twice their
    spacing), both must show a line, since a line above that has an alias below it. A shorter period counts where
    ``dense`` shows it in two sensors, as waves do that move the ship; in one it is the sensor's. p: probability of such
    a line by chance, 1 where too few samples are left. Periodograms are summed over windows and bands; by chance that
    of a band over the mean of neighbouring bands has an F distribution. It must stand out of those on either side, so
    that a coloured spectrum has no lines, and clearly (TWICE), so that a hill of it is none. The slowest bands are left
    out: the latent force follows them. A periodic force, as of waves, it cannot follow.
    """
    spacing, pieces = _equally_spaced(data)
    if not pieces:
        return 1.0, float("inf")
    shortest, bands = 2 * spacing * data.h, _bands(pieces)
    p = _band_probabilities(data.h * spacing, w, pieces, shortest, bands)
    if dense is None:
        return _sharpest(p, shortest)
    every, dense_pieces = _equally_spaced(dense[0])
    step, finest, parts = dense[0].h * every, 2 * dense[0].h * every, _bands(dense_pieces)
    p = np.maximum(p, _band_probabilities(step, dense[1], dense_pieces, shortest, bands))  # both must show a line
    lines, down_to = [_sharpest(p, shortest)], finest
    while down_to < shortest:
        q = _band_probabilities(step, dense[1], dense_pieces, down_to, parts)
        slow = down_to * parts / (np.arange(parts) + 0.5) > shortest
        q[slow | (np.partition(q, 1, axis=1)[:, 1] > IN_ANOTHER)] = 1.0
        lines.append(_sharpest(q, down_to))
        down_to *= COARSER
    least, period = min(lines)
    return min(1.0, least * len(lines)), period  # Bonferroni over the spectra


def _bands(pieces: list[tuple[int, np.ndarray]]) -> int:
    """Number of bands that the shortest piece can fill."""
    return min(BINS, (min(len(rows) for _, rows in pieces) - 1) // 2)


def _sharpest(p: np.ndarray, shortest: float) -> tuple[float, float]:
    """Probability by chance of the least of ``p`` (bands, 6), and the period [s] of its band, down to ``shortest``."""
    band = int(np.argmin(p.min(axis=1)))
    return min(1.0, p[SLOWEST:].size * float(p.min())), shortest * len(p) / (band + 0.5)


def _equally_spaced(data: GriddedTrials) -> tuple[int, list[tuple[int, np.ndarray]]]:
    """The usual spacing [grid times] of what is compared, and windows and rows of all pieces that keep it and are long
    enough; the first rows of a window are left out."""
    compared = np.asarray(data.good.any(axis=2))
    every = [np.flatnonzero(compared[:, r])[4:] for r in range(compared.shape[1])]
    gaps = np.concatenate([np.diff(rows) for rows in every])
    if not len(gaps):
        return 1, []
    spacing = int(np.bincount(gaps).argmax())
    parts = [
        (r, part)
        for r, rows in enumerate(every)
        for part in np.split(rows, 1 + np.flatnonzero(np.diff(rows) != spacing))
    ]
    return spacing, [(r, rows) for r, rows in parts if len(rows) >= LEAST_ROWS]


def periodogram(x: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (F,) [1/s] of x (N, ...), N samples every ``step`` [s], and the mean square (F, ...) of x less its
    mean at each, as ``scipy.signal.periodogram`` scales a spectrum: that takes half a second to import."""
    power = np.abs(np.fft.rfft(x - x.mean(axis=0), axis=0) / len(x)) ** 2
    power[1 : (len(x) + 1) // 2] *= 2.0  # the negative frequencies; that of two samples a period has none
    return np.fft.rfftfreq(len(x), step), power


def _band_probabilities(
    step: float, w: np.ndarray, pieces: list[tuple[int, np.ndarray]], shortest: float, bands: int
) -> np.ndarray:
    """Probability (bands, 6) by chance of the power in each of so many bands of the spectrum of w (K + 1, R, 6) down to
    periods of ``shortest`` [s], beside its neighbours on either side; 1 for the slowest. step: between rows [s]."""
    total, count = np.zeros((bands, w.shape[2])), np.zeros(bands)
    for r, rows in pieces:
        frequency, power = periodogram(w[rows, r], step)
        inside = (np.arange(len(power)) > 0) & (frequency < (1 - 1e-9) / shortest)
        power = power[inside] / np.maximum(power[inside].mean(axis=0), 1e-300)  # pieces count alike
        at = (frequency[inside] * shortest * bands).astype(int)
        np.add.at(total, at, power)
        count += np.bincount(at, minlength=bands)
    away = np.abs(np.subtract.outer(np.arange(bands), np.arange(bands)))  # bands between any two
    near = np.argsort(np.where(away < 2, bands, away), axis=1, kind="stable")[:, : 2 * NEIGHBOURS]
    neighbour_power, size = total[near].sum(axis=1), count[near].sum(axis=1)
    ratio = (total * size[:, None]) / np.maximum(neighbour_power * count[:, None], 1e-300)
    # a periodogram is chi-squared of 2 degrees
    p = np.asarray(fdtrc(2 * np.maximum(count, 1)[:, None], 2 * np.maximum(size, 1)[:, None], ratio))
    p = np.where(ratio < TWICE, np.maximum(p, RARE), p)
    p[:SLOWEST] = 1.0
    return p
