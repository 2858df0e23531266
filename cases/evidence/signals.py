"""The columns of a trial on a coarse clock, and the misfit of what is integrated over windows of it, piece by piece."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cases.inputs import integral
from cases.trial import Trial, unwrapped

# A record speaks once in each of so many pieces, however many samples it has: neighbours say the same.
PIECES = 12  # set by hand (4, 2)
# Least length of a window in rows of the record and in seconds. Set by hand (1, 0 and 0, 1).
WINDOW_ROWS, WINDOW_S = 5, 1.1
# A window is so long that the noise of two positions is at most this share of the way made in it.
NOISE = 0.01  # set by hand (1, 1)
LONGEST = 40  # At most this part of the record is one window. Set by hand.
FLOOR = 0.02  # Relative error that instruments leave in any case: compass, log and clocks are no better. Set by hand.
AT_REST = 0.01  # Share of the mean square of a record that counts as motion in each piece. Set by hand.
STEPS = 4  # Steps of the coarse clock in a window. Set by hand (1, 0).
MARGIN = 32  # Rows beyond the ends of a record by which it goes on where it is shifted. Set by hand.
FEW = 0.3  # A piece with fewer windows than this share of the fullest one says nothing by itself. Set by hand.
MAD = 1.4826  # Standard deviation of a normal law over its median absolute deviation (Hampel 1974)


class Stats(NamedTuple):
    """Per piece (..., PIECES): sum of |measured|^2, of measured times the conjugate of the predicted, of |predicted|^2,
    and number of windows."""

    measured: np.ndarray
    both: np.ndarray
    predicted: np.ndarray
    windows: np.ndarray


@dataclass(frozen=True)
class Signals:
    """A record on a uniform clock of ``step`` [s]: arrays (M,), missing samples filled by straight lines; or several
    such records that differ in some of the arrays, which are (..., M).

    place: x + i y [m], NaN where none is logged or a relative of u and v; psi: unwrapped [rad]; w: u + i v [m/s]; r
    [rad/s]; good: rows that were measured; has_turn: whether heading and turn rate are no relatives.
    """

    step: float
    place: np.ndarray
    psi: np.ndarray
    w: np.ndarray
    r: np.ndarray
    good: np.ndarray
    has_turn: bool = True

    @property
    def has_track(self) -> bool:
        """Whether positions, heading and velocities are there, and the ship moves."""
        ways = np.abs(np.diff(self.place))
        return len(ways) >= 3 * STEPS and bool(np.isfinite(ways).all()) and float(ways.sum()) > 1e-6

    def summed(self, rate: np.ndarray) -> np.ndarray:
        """Integral of a ``rate`` (..., M) over each window (..., M - STEPS)."""
        total = np.zeros(rate.shape, dtype=np.result_type(rate, float))
        np.cumsum(0.5 * (rate[..., 1:] + rate[..., :-1]), axis=-1, out=total[..., 1:])  # trapezoids, 0 at the first row
        total *= self.step
        return over_windows(total)

    def stats(self, measured: np.ndarray, predicted: np.ndarray) -> Stats:
        """Sums per piece of two quantities of windows (..., M - STEPS); windows with missing rows do not count."""
        use, edges, windows = self._counted
        a, b = np.where(use, measured, 0.0), np.where(use, predicted, 0.0)
        parts = _squared(a), a * np.conj(b), _squared(b)
        own, both, other = (np.add.reduceat(part, edges, axis=-1) for part in parts)
        return Stats(own, both, other, windows)

    @cached_property
    def _counted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Windows without missing rows (..., M - STEPS), where the pieces begin, and how many such windows each has."""
        bad = np.zeros((*self.good.shape[:-1], self.good.shape[-1] + 1), dtype=int)
        np.cumsum(~self.good, axis=-1, out=bad[..., 1:])
        use = bad[..., STEPS + 1 :] == bad[..., : -STEPS - 1]  # no bad row was counted between both ends
        edges = np.linspace(0, use.shape[-1], PIECES + 1).astype(int)[:-1]
        return use, edges, np.add.reduceat(use.astype(float), edges, axis=-1)

    def shifted(self, seconds: float | np.ndarray, *names: str) -> Signals:
        """These signals with the arrays ``names`` as they were so many ``seconds`` (...) later: what is late, mended.
        Those arrays and ``good`` are then (..., M)."""
        rows, later = np.arange(len(self.psi)), np.asarray(seconds)[..., None] / self.step
        at = rows + later
        inside = (at >= 0) & (at <= len(rows) - 1)
        # a shifted sample rests on both rows around its place
        low, high = (np.clip(side(at).astype(int), 0, len(rows) - 1) for side in (np.floor, np.ceil))
        arrays: dict[str, Any] = {name: _advanced(getattr(self, name), later) for name in names}
        return replace(self, **arrays, good=self.good & inside & self.good[low] & self.good[high])


# Comparison -> the columns of one side, and those whose integral is the other.
COMPARED = {"track": (("x", "y"), ("u", "v")), "turn": (("psi",), ("r",))}


def independent(trial: Trial, comparison: str) -> bool:
    """Whether the two sides of a ``comparison`` of ``trial`` are there and no relatives: neither was derived from the
    other, from what the other was derived from, or assumed."""
    sides = COMPARED[comparison]
    if any(name not in trial for side in sides for name in side):
        return False
    one, other = (trial.roots(*side) for side in sides)
    return all(trial.roots(name) for side in sides for name in side) and not one & other


def over_windows(values: np.ndarray) -> np.ndarray:
    """What ``values`` (..., M) grow by over each window (..., M - STEPS)."""
    return np.asarray(values[..., STEPS:] - values[..., :-STEPS])


def _advanced(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Real or complex ``values`` (M,) so many ``rows`` (..., 1) later, by Fourier's series of what goes on
    point-symmetrically at both ends. Straight lines between rows would damp noise by up to a half, most between two
    rows: a record whose noise is what misfits then fits best with a lag of half a row."""
    pad = min(len(values) - 1, MARGIN + math.ceil(np.abs(rows).max()))
    # point-symmetric about its ends: value and slope go on without a jump
    before, after = 2 * values[0] - values[pad:0:-1], 2 * values[-1] - values[-2 : -pad - 2 : -1]
    padded = np.concatenate([before, values, after])
    count = np.arange(len(padded))
    # a straight line is taken off: Fourier's series repeats itself
    slope = (padded[-1] - padded[0]) / (len(padded) - 1)
    line = slope * (count + rows)
    # a shift turns the phase of each frequency (cycles per row)
    if np.iscomplexobj(values):
        turn = np.exp(2j * np.pi * rows * np.fft.fftfreq(len(padded)))
        shifted = np.asarray(np.fft.ifft(np.fft.fft(padded - slope * count) * turn))
    else:
        turn = np.exp(2j * np.pi * rows * np.fft.rfftfreq(len(padded)))
        shifted = np.asarray(np.fft.irfft(np.fft.rfft(padded - slope * count) * turn, len(padded)))
    return np.asarray(shifted + line)[..., pad : pad + len(values)]


def _squared(values: np.ndarray) -> np.ndarray:
    """Squares of the sizes of real or complex ``values``."""
    return np.asarray(values.real**2 + values.imag**2 if np.iscomplexobj(values) else values * values)


def signals(trial: Trial, degrees: float = 1.0) -> Signals | None:
    """The signals of ``trial``, its heading times ``degrees``; None where it is too short."""
    seconds = window(trial)
    step = seconds / STEPS
    count = int(trial.duration / step) + 1
    if count < 6 * STEPS or len(trial) < 20:
        return None
    clock = trial.t[0] + step * np.arange(count)
    columns = {name: trial[name] for name in ("x", "y", "u", "v", "r") if name in trial}
    columns["psi"] = unwrapped(trial["psi"] * degrees)
    used = {name: values for name, values in columns.items() if np.isfinite(values).sum() >= 2}
    if not {"u", "v", "r", "psi"} <= set(used):
        return None
    valid = np.all([np.isfinite(values) for values in used.values()], axis=0)
    on = {name: _coarse(trial.t, values, clock, step) for name, values in used.items()}
    nothing = np.full(count, np.nan)
    track, turn = (independent(trial, comparison) for comparison in COMPARED)
    place = on.get("x", nothing) + 1j * on.get("y", nothing) if track else nothing + 0j
    good = np.interp(clock, trial.t, valid.astype(float)) > 0.999  # both neighbours are known, but for rounding
    good[[0, -1]] = False  # means of half a step, which lie a quarter of it further in
    gap = np.flatnonzero(np.diff(trial.t) > max(3 * trial.dt, seconds))
    for i in gap:
        good &= ~((clock > trial.t[i]) & (clock < trial.t[i + 1]))
    return Signals(step, place, on["psi"], on["u"] + 1j * on["v"], on["r"], good, turn)


def window(trial: Trial) -> float:
    """Length [s] of the windows in which the motion of ``trial`` is looked at: short for the motion, long for the noise
    and the rounding of its positions."""
    least = max(WINDOW_ROWS * trial.dt, WINDOW_S)
    longest = max(trial.duration / LONGEST, WINDOW_ROWS * trial.dt)
    if not trial.has_position:
        return min(least, longest)
    place = trial["x"] + 1j * trial["y"]
    place = place[np.isfinite(place)]
    if len(place) < 20:
        return min(least, longest)
    rows = max(len(place) // LONGEST, 1)
    speed = float(np.median(np.abs(place[rows:] - place[:-rows]))) / (rows * trial.dt)
    thirds = np.abs(np.diff(place, n=3))  # the motion leaves little in third differences
    # of white noise in the plane: Rayleigh's median sqrt(2 ln 2), of a variance 1 + 9 + 9 + 1 of third differences
    noise = float(np.median(thirds)) / math.sqrt(40 * math.log(2))
    steps = np.abs(np.diff(trial["x"]))
    steps = steps[steps > 0]
    # few different steps are those of rounding, whose error is uniform: variance 1/12 of its square
    grain = float(np.quantile(steps, 0.01)) / math.sqrt(12) if len(steps) and len(np.unique(steps)) < 50 else 0.0
    # both ends of a way have that noise; NOISE is its share of the way made at this speed
    wanted = math.sqrt(2) * max(noise, grain) / (NOISE * speed) if speed > 0 else least
    return min(max(least, wanted), longest)


def evidence(misfit: np.ndarray, floor: float = FLOOR) -> np.ndarray:
    """What mean square relative ``misfit`` (..., PIECES) is worth in nats (...); less is better. Misfits below
    ``floor`` are none, and what misses by more than all explains nothing."""
    return np.asarray(np.sum(np.log(np.clip(misfit, 0.0, 1.0) + floor**2), axis=-1))


def relative(stats: Stats, factor: complex | np.ndarray) -> np.ndarray:
    """Mean square misfit per piece (..., PIECES) of ``factor`` (...) times what is predicted in ``stats``, over the
    measured."""
    (a, b, c, windows), by = stats, np.asarray(factor)[..., None]
    rest = np.maximum(a - 2 * np.real(np.conj(by) * b) + np.abs(by) ** 2 * c, 0.0)
    usual = _total(a) / np.maximum(_total(windows), 1.0)
    share = rest / (a + AT_REST * usual * windows + 1e-30)  # of a piece at rest a misfit is noise over nothing
    # pieces with few windows have the misfit of all the others
    full = windows >= FEW * np.maximum(windows.max(axis=-1, keepdims=True), 1.0)
    return np.asarray(np.where(full, share, _total(np.where(full, rest, 0)) / (_total(np.where(full, a, 0)) + 1e-30)))


def _total(of_pieces: np.ndarray) -> np.ndarray:
    """Sums (..., 1) over all pieces (..., PIECES)."""
    return np.asarray(of_pieces.sum(axis=-1, keepdims=True))


def _coarse(t: np.ndarray, values: np.ndarray, clock: np.ndarray, step: float) -> np.ndarray:
    """``values`` (N,) at ``t`` [s] as means over a ``step`` [s] around each point of the ``clock`` (M,)."""
    good = np.isfinite(values)
    t, values = t[good], values[good]
    total = integral(t, values)
    low, high = np.clip(clock - step / 2, t[0], t[-1]), np.clip(clock + step / 2, t[0], t[-1])
    inside = high - low > 0.25 * step  # at the ends less than a step is left to be averaged
    mean = (np.interp(high, t, total) - np.interp(low, t, total)) / np.where(inside, high - low, 1.0)
    return np.where(inside, mean, np.interp(clock, t, values))


def densest(values: np.ndarray, share: float = 0.35) -> float:
    """Middle of the shortest interval that holds this ``share`` of the ``values`` (N,)."""
    ordered, count = np.sort(values), max(1, int(share * len(values)))
    widths = ordered[count:] - ordered[:-count]
    at = int(np.argmin(widths)) if len(widths) else 0
    return float(0.5 * (ordered[at] + ordered[min(at + count, len(ordered) - 1)]))


def white_noise(stretches: Sequence[np.ndarray], needed: slice = slice(None)) -> np.ndarray:
    """Standard deviation (6,) of the white noise of logged states, each in its own unit; 0 where it is not known.

    stretches: neighbouring samples (N, 6) each; needed: columns without which a sample does not count. Robust: by the
    median size of third differences, in which the motion leaves little: 0.6745 sqrt(20) for white noise of size 1.
    """
    thirds = [np.diff(stretch, n=3, axis=0) for stretch in stretches if len(stretch) > 3]
    d = np.vstack([*thirds, np.empty((0, 6))])
    d = d[np.isfinite(d[:, needed]).all(axis=1)]
    valid = np.isfinite(d).any(axis=0)
    noise = np.zeros(6)
    noise[valid] = np.nanmedian(np.abs(d[:, valid]), axis=0) / 0.6745 / np.sqrt(20.0)  # 20: of 1, -3, 3, -1
    return noise


def jackknife(N: np.ndarray, h: np.ndarray, ridge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (P,) of the normal equations N (G, P, P), h (G, P) of G groups of rows, with a ``ridge`` (P, P), and their
    standard errors (P,) by the values without each group in turn (Kunsch 1989), as neighbouring rows err alike."""
    values = np.linalg.solve(N.sum(axis=0) + ridge, h.sum(axis=0))
    without = np.linalg.solve(N.sum(axis=0) - N + ridge, (h.sum(axis=0) - h)[..., None])[..., 0]
    return values, np.sqrt((len(N) - 1) * without.var(axis=0))
