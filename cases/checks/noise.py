"""Noise of logged columns, from third differences of neighbouring samples, in which the motion leaves little."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def white_noise(stretches: Sequence[np.ndarray], needed: slice = slice(None)) -> np.ndarray:
    """Standard deviation (6,) of the white noise of logged states, each in its own unit; 0 where it is not known.

    stretches: neighbouring samples (N, 6) each; needed: columns without which a sample does not count. Robust: by the
    median size of third differences, which is 0.6745 sqrt(20) for white noise of standard deviation 1.
    """
    thirds = [np.diff(stretch, n=3, axis=0) for stretch in stretches if len(stretch) > 3]
    d = np.vstack([*thirds, np.empty((0, 6))])
    d = d[np.isfinite(d[:, needed]).all(axis=1)]
    known = np.isfinite(d).any(axis=0)
    noise = np.zeros(6)
    noise[known] = np.nanmedian(np.abs(d[:, known]), axis=0) / 0.6745 / np.sqrt(20.0)
    return noise
