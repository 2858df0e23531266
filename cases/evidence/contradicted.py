"""Columns that others contradict: some stand still over a whole record, some are inputs in a unit that does not go with
how quickly the ship turns, whatever her size.

Two numbers without dimension hardly depend on the ship: the revolutions that her propeller makes while her turn rate
changes, n tau, and how far she turns in this time per rudder angle, r tau / delta. From ships of 3 m to 320 m, models
and real ones, mild zigzags to berthing, they are 16 to 130 and 0.1 to 1.6. Factors of 60 and of 57 lie far outside.
"""

from __future__ import annotations

import math

import numpy as np

from cases.evidence.signals import STEPS, signals
from cases.inputs import integral
from cases.trial import RUDDERS, Trial

TURNED = 0.1
"""rad; a heading turns at least so far before its own column, or that of the turn rate, must have shown it."""

QUARTER = math.pi / 2
"""rad; turn of a track that no ship makes on one heading."""

MERIDIANS = 1e-3
"""rad; within it a frozen heading changes where it is made one of a local frame, over some kilometres."""

VARIED = 0.05
"""Share of the speed by which the velocity of the track varies before u must have shown it; half of it for v."""

STANDS = 0.98
"""Share of the rows with one value, from which a column stands still."""


def standing(trial: Trial) -> dict[str, str]:
    """Column -> what says that it must have moved, of ``trial``, in words."""
    psi, r = trial.psi_unwrapped, trial["r"]
    still = {name for name in ("psi", "u", "v", "r", "x", "y") if name in trial and _stands(trial[name])}
    frozen = _stands(psi, MERIDIANS)
    out: dict[str, str] = {}
    if not (still or frozen) or len(trial) < 20:
        return out
    made = integral(trial.t, np.nan_to_num(r))
    integrated = _range(made)
    if "r" in still and _range(psi - made) > TURNED:  # in a steady circle the heading goes with the one turn rate
        out["r"] = f"the heading turns by {_range(psi):.2g} rad and not by {integrated:.2g}"
    if "psi" in still and integrated > TURNED:
        out["psi"] = f"the turn rate makes {integrated:.2g} rad"
    if frozen and {"x", "y"} <= set(trial.columns) and not {"x", "y"} & still:
        course = _range(np.unwrap(np.angle(_track(trial))))
        if course > QUARTER:
            out["psi"] = f"the track turns by {course:.2g} rad"
    speed = float(np.sqrt(np.nanmean(trial["u"] ** 2 + trial["v"] ** 2)))
    if {"x", "y"} <= still and speed * trial.duration > 1.0:
        out |= dict.fromkeys(("x", "y"), f"the ship runs at {speed:.2g} m/s")
    elif still and "x" in trial and "y" in trial and not {"x", "y", "psi"} & still:
        track = _track(trial)
        size = float(np.sqrt(np.mean(np.abs(track) ** 2)))
        if "u" in still and float(np.std(track.real)) > VARIED * size:
            out["u"] = f"the speed of the track varies by {float(np.ptp(track.real)):.2g} m/s"
        if "v" in still and float(np.std(track.imag)) > 0.5 * VARIED * size:
            out["v"] = f"the track drifts by up to {float(np.abs(track.imag).max()):.2g} m/s"
    return out


def _stands(values: np.ndarray, within: float = 0.0) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.mean(np.abs(known - np.median(known)) <= within)) >= STANDS


def _range(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _track(trial: Trial) -> np.ndarray:
    """Velocity of the track in body axes (M,), of pieces of a fiftieth of the record."""
    place, psi = trial["x"] + 1j * trial["y"], trial.psi_unwrapped
    good = np.isfinite(place) & np.isfinite(psi)
    t, place, psi = trial.t[good], place[good], psi[good]
    rows = max(len(t) // 50, 1)
    middle = psi[rows // 2 : rows // 2 + len(t) - rows]
    return np.asarray((place[rows:] - place[:-rows]) / (t[rows:] - t[:-rows]) * np.exp(-1j * middle))


REVOLUTIONS = (3.0, 600.0)
"""Least and greatest n tau of rightly labelled revolutions."""

RESPONSE = (0.025, 6.0)
"""Least and greatest r tau / delta of a rightly labelled rudder, of a ship that follows her rudder."""

FOLLOWS = 0.7
"""Correlation of turn rate and rudder from which a ship follows it."""

TURNS = 0.05
"""rad; a heading that varies less says nothing of how quickly the ship turns."""


def wrong_inputs(trial: Trial, turning: float | None) -> list[tuple[str, float, str]]:
    """(column, factor that makes it true, sentence) of revolutions and rudders of ``trial`` in a wrong unit.

    turning: correlation of the turn rate with the rudder, None where it is not known.
    """
    s = signals(trial)
    if s is None or not s.good.any() or float(np.std(s.psi[s.good])) < TURNS:
        return []
    span = STEPS * s.step
    use = s.good[STEPS:-STEPS]
    rate = (s.psi[STEPS:] - s.psi[:-STEPS]) / span
    change = (rate[STEPS:] - rate[:-STEPS]) / span
    known = use[: len(change)]
    if known.sum() < 10 or not float(np.mean(change[known] ** 2)) > 0:
        return []
    tau = float(np.std(rate) / np.sqrt(np.mean(change[known] ** 2)))
    out = []
    for name in ("n", "n_2"):
        n = np.abs(trial[name][np.isfinite(trial[name])]) if name in trial else np.zeros(1)
        if np.sum(n > 0) >= max(0.5 * len(n), 1):
            made = float(np.median(n[n > 0])) * tau
            out += _outside(name, made, REVOLUTIONS, ("rps", "rpm", 60.0), "revolutions while the ship begins to turn")
    size = float(np.sqrt(np.nanmean(trial.rudder**2))) if np.isfinite(trial.rudder).any() else 0.0
    if turning is not None and abs(turning) >= FOLLOWS and size > 0:
        response = tau * float(np.sqrt(np.mean(rate**2))) / size
        for name in [name for name in RUDDERS if name in trial]:
            out += _outside(name, response, RESPONSE, ("degrees", "rad", math.pi / 180), "times the rudder is her turn")
    return out


def _outside(
    name: str, value: float, limits: tuple[float, float], units: tuple[str, str, float], what: str
) -> list[tuple[str, float, str]]:
    """What is said of the column ``name`` where a ``value`` of ``what`` lies outside the ``limits``.

    units: the first that it holds where the value is too small, though labelled as the second, and the factor of that.
    """
    low, high = limits
    if low <= value <= high:
        return []
    small, large, factor = units
    held, labelled, by = (small, large, factor) if value < low else (large, small, 1 / factor)
    return [(name, by, f"{name} holds {held} but is labelled {labelled}: there would be {value:.3g} {what}")]
