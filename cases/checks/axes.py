"""Which axes and signs the logged velocities have, judged by the track; heading offset; lever arm."""

from __future__ import annotations

import math

import numpy as np

from cases.checks.motion import Motion
from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, Found

BLOCK = 10.0
"""s; differences are averaged over blocks this long before a slope and its standard error are taken."""

UNITS_MISTAKEN = {
    "knots labelled m/s": 1.943844,
    "m/s labelled kn": 1 / 1.943844,
    "time in milliseconds labelled s": 1000.0,
    "km/h labelled m/s": 3.6,
    "m/s labelled km/h": 1 / 3.6,
}
"""What was mistaken -> logged velocity over that of the track."""

PIECES, MOST = 12, 0.7
"""A hypothesis is believed where it is better in most of so many pieces of a record."""

HYPOTHESES = {
    "body": ("u, v are body-axes velocities", "", ""),
    "earth": (
        "u, v are earth-fixed velocities (north, east)",
        'set velocity_frame = "earth" in trials.toml',
        "velocity_frame",
    ),
    "earth_swapped": (
        "u, v are earth-fixed velocities (east, north)",
        'map the columns the other way round and set velocity_frame = "earth" in trials.toml',
        "velocity_frame",
    ),
    "v_to_port": ("v is positive to port", "set sign = { v = -1 } in trials.toml", "sway_sign"),
    "mirrored": (
        "y is positive to port, or psi and v both are",
        "set sign = { y = -1 } or { psi = -1, v = -1, r = -1 } in trials.toml",
        "mirrored_frame",
    ),
    "psi_counter_clockwise": (
        "psi is positive counter-clockwise",
        "set sign = { psi = -1 } in trials.toml",
        "heading_sign",
    ),
    "u_astern": ("u is positive astern", "set sign = { u = -1 } in trials.toml", "u_sign"),
    "positions_swapped": (
        "x is east and y is north",
        "map the columns the other way round: columns = { x = HEADER OF y, y = HEADER OF x } in trials.toml",
        "swapped_positions",
    ),
    "psi_from_east": (
        "psi is counted from east, counter-clockwise",
        "give the compass heading, 90 deg - psi, instead",
        "heading_from_east",
    ),
    "psi_from_east_clockwise": (
        "psi is counted from east, clockwise",
        "give the compass heading, psi + 90 deg, instead",
        "heading_from_east",
    ),
}
"""Reading of the columns -> what it means, what to do about it, and the code of the finding."""


def frame_misfits(m: Motion) -> tuple[dict[str, float | None], list[Found]]:
    """Per hypothesis: RMS of (track velocity - logged velocity) of ``m`` over RMS of its track velocity.

    "scaled" is "body" times the factor that fits best. Returns them with a warning when another reading of the columns
    explains the track far better, or none does.
    """
    good = np.all([np.isfinite(a) for a in (m.north, m.east, m.u, m.v, m.psi)], axis=0)
    track, w, turn = (m.north + 1j * m.east)[good], (m.u + 1j * m.v)[good], np.exp(1j * m.psi[good])
    guesses = {
        "body": w * turn,
        "earth": w,
        "earth_swapped": w.imag + 1j * w.real,
        "v_to_port": w.conj() * turn,
        "mirrored": (w * turn).conj(),
        "psi_counter_clockwise": w * turn.conj(),
        "u_astern": -w.conj() * turn,
        "positions_swapped": 1j * (w * turn).conj(),
        "psi_from_east": 1j * w * turn.conj(),
        "psi_from_east_clockwise": 1j * w * turn,
    }
    power = float(np.sum(np.abs(w) ** 2))
    scale = float(np.vdot(w * turn, track).real) / power if power > 0 else 0.0
    guesses["scaled"] = w * turn * scale
    size = math.sqrt(float(np.mean(np.abs(track) ** 2))) if len(track) else 0.0
    if size < 1e-6:
        return dict.fromkeys(guesses), []
    misfit = {name: math.sqrt(float(np.mean(np.abs(track - guess) ** 2))) / size for name, guess in guesses.items()}
    best, body = min(HYPOTHESES, key=lambda name: misfit[name]), misfit["body"]
    findings: list[Found] = []
    unit = next((words for words, factor in UNITS_MISTAKEN.items() if abs(scale * factor - 1) < 0.05), "")
    if unit and misfit["scaled"] < 0.4 * min(body, misfit[best]):
        text = f"u and v are {1 / scale:.3g} times the velocity of the track: {unit}? Give units in trials.toml."
        findings = [(CONTRADICTORY, "unit", text)]
    elif misfit[best] < 0.6 * body and _throughout(np.abs(track - guesses[best]), np.abs(track - guesses["body"])):
        meaning, remedy, code = HYPOTHESES[best]
        text = f"The track says that {meaning}: misfit {misfit[best]:.0%} against {body:.0%} as labelled; {remedy}."
        findings = [(CONTRADICTORY, code, text)]
    elif body > 0.8 and misfit["scaled"] > 0.5:
        text = (
            f"Velocities and positions disagree (misfit {body:.0%}) and no other frame or sign explains it; "
            "check units, clocks and axes."
        )
        findings = [(CONTRADICTORY, "velocity_mismatch", text)]
    return {**misfit}, findings


def _throughout(better: np.ndarray, body: np.ndarray) -> bool:
    """Whether errors (N,) of a hypothesis are smaller than those of ``body`` (N,) in most of a record's pieces, rather
    than in a few samples of it."""
    pieces = zip(np.array_split(better, PIECES), np.array_split(body, PIECES), strict=True)
    wins = [float(np.mean(a**2) < np.mean(b**2)) for a, b in pieces if len(a)]
    return len(wins) > 0 and float(np.mean(wins)) >= MOST


def heading_offset(m: Motion, aligned: np.ndarray) -> tuple[float | None, list[Found]]:
    """Angle [deg] by which the track of ``m`` is turned clockwise from its logged (u, v), given as ``aligned`` (N,).

    Returns it with a warning where it is more than 5 deg.
    """
    w = m.u + 1j * m.v
    good = np.isfinite(w) & np.isfinite(aligned)
    product = complex(np.vdot(w[good], aligned[good]))
    size = math.sqrt(float(np.sum(np.abs(w[good]) ** 2)) * float(np.sum(np.abs(aligned[good]) ** 2)))
    if good.sum() < 50 or size <= 0 or abs(product) < 0.7 * size:
        return None, []
    offset = math.degrees(math.atan2(product.imag, product.real))
    side = "clockwise" if offset > 0 else "counter-clockwise"
    text = f"The track is turned {abs(offset):.1f} deg {side} from heading and velocities: heading offset or axes?"
    return offset, [(DOUBTFUL, "heading_offset", text)] if abs(offset) >= 5.0 else []


def lever_arm(m: Motion, aligned: np.ndarray) -> tuple[dict[str, float | None], list[Found]]:
    """Where the position was measured, from midship [m], with standard errors.

    The velocity of a point (l_x, l_y) is (u - r l_y, v + r l_x): the differences between track and logged
    velocities are regressed on the turning rate of the heading, through the origin, over 10 s blocks. In a
    steady turn a gain error of v, or a lag of arm / u seconds, looks much the same. None where the ship
    hardly turns. m: the motion; aligned: (N,) velocity of its track in body axes, complex [m/s]. Returns the numbers,
    and a sentence per axis along which the arm is at least 5 cm and four standard errors.
    """
    numbers: dict[str, float | None] = dict.fromkeys(("x_m", "x_std_m", "y_m", "y_std_m"))
    findings: list[Found] = []
    across, along = aligned.imag - m.v, m.u - aligned.real
    words = (("x", across, "forward of", "aft of"), ("y", along, "to starboard of", "to port of"))
    for axis, difference, ahead, behind in words:
        fit = _slope(m.turn, difference, max(round(BLOCK / m.dt), 5))
        if fit is None:
            continue
        arm, std = numbers[f"{axis}_m"], numbers[f"{axis}_std_m"] = fit
        if abs(arm) >= max(4 * std, 0.05):
            text = (
                f"The position fits a measured point {abs(arm):.2f} +- {std:.2f} m {ahead if arm > 0 else behind} "
                "midship (lever arm; reference_point in trials.toml moves it)."
            )
            findings.append((INFO, "lever_arm", text))
    return numbers, findings


def _slope(x: np.ndarray, y: np.ndarray, block: int) -> tuple[float, float] | None:
    """Slope of y on x through the origin and its standard error, from block means; None when undetermined."""
    count = len(x) // block
    good = np.isfinite(x) & np.isfinite(y)
    if count < 4 or good.sum() < 4 * block or float(np.sqrt(np.mean(x[good] ** 2))) < 1e-4:
        return None

    def blocks(values: np.ndarray) -> np.ndarray:
        return np.where(good, values, 0.0)[: count * block].reshape(count, block).sum(axis=1)

    weight = blocks(np.ones(len(x)))
    use = weight > block / 2
    if use.sum() < 4:
        return None
    mean_x, mean_y = blocks(x)[use] / weight[use], blocks(y)[use] / weight[use]
    power = float(mean_x @ mean_x)
    slope = float(mean_x @ mean_y) / power
    error = mean_y - slope * mean_x
    return slope, math.sqrt(float(error @ error) / (len(mean_x) - 1) / power)
