"""What tells of states that were derived from one another, as integrals cannot: how a ship moves.

She makes headway with revolutions ahead. On straight legs both ways her sway is a share of her surge where the heading
is off, and an earth-fixed vector where there is a current; in turns it is against the turn, -x r at a distance x abaft
the pivot point (Yasukawa & Yoshimura 2015). A true wind does not turn with her.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cases.checks.report import DOUBTFUL, INFO, Found
from cases.evidence.scale import SIGMAS
from cases.evidence.signals import PIECES, independent
from cases.trial import Trial

AHEAD = 0.5
"""Share of the greatest speed from which a ship goes ahead, and share of the time that counts as most of it."""

STRAIGHT = 0.2
"""Share of the greatest turn rate within which a ship goes straight."""

APART = 0.1
"""Least eigenvalue of the correlations of surge, turn and heading, from which an offset is no current: about that of
legs in directions a quarter turn apart."""

MOSTLY = 0.9
"""Share of the rows with revolutions ahead in which sternway is no manoeuvre."""

OFFSET = math.radians(2.0)
"""A compass is right within it (IMO A.424: 1 deg times the secant of the latitude)."""

COST = 8.0
"""Nats by which wind is likelier to turn with the ship."""

WOULD = {
    "track": "a speed log, or a receiver of its own for course and speed over ground",
    "turn": "a rate gyro",
}
"""Comparison -> what would make it."""


def not_checked(trial: Trial) -> list[Found]:
    """A note for each comparison of ``trial`` whose sides are relatives, and what would check them."""
    out: list[Found] = []
    for comparison, rest, of in (("track", "positions", ("u", "v")), ("turn", "heading", ("r",))):
        if independent(trial, comparison) or (comparison == "track" and not trial.has_position):
            continue
        made = [name for name in (*of, "x", "y", "psi") if name in trial.ancestors]
        roots = sorted({root for name in made for root in trial.roots(name)} - set(of))
        come = f"{', '.join(made)} come from {', '.join(roots)}" if roots else f"{', '.join(made)} were assumed"
        also = " and runs in both directions" if comparison == "track" else ""
        text = f"Not checked: {', '.join(of)} against the {rest}, as {come}; {WOULD[comparison]}{also} would check it."
        out.append((INFO, "not_checked", text))
    return out


class Sway(NamedTuple):
    """Of v = offset u - pivot r + a current across: offset [rad], pivot [m] ahead of the point whose velocities are
    known, their standard errors; NaN where the runs do not tell."""

    offset: float
    pivot: float
    offset_std: float
    pivot_std: float


def sway(trials: Sequence[Trial]) -> Sway:
    """What the sway of ``trials`` of one ship going ahead says together: the offset where she goes straight, the pivot
    everywhere."""
    values, std, least = _regressed(trials, STRAIGHT)
    offset, offset_std = (values[0], std[0]) if least > APART else (math.nan, math.nan)
    values, std, _ = _regressed(trials, math.inf)
    return Sway(float(offset), float(values[1]), float(offset_std), float(std[1]))


def _regressed(trials: Sequence[Trial], most: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Offset, pivot and current (north, east), (4,), their standard errors, and the least eigenvalue of what they are
    regressed on, over rows ahead with a turn rate of at ``most`` so much of the greatest; NaN without any."""
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    for trial in trials:
        u, v, r, psi = trial["u"], trial["v"], trial["r"], trial["psi"]
        good = np.isfinite(u) & np.isfinite(v) & np.isfinite(r) & np.isfinite(psi)
        if not good.any():
            continue
        good &= np.nan_to_num(u) > AHEAD * float(np.quantile(np.hypot(u[good], v[good]), 0.95))
        good &= np.abs(np.nan_to_num(r)) <= most * float(np.nanquantile(np.abs(r), 0.95))
        A = np.stack([u, -r, -np.sin(psi), np.cos(psi)], axis=1)
        for rows in np.array_split(np.flatnonzero(good), PIECES):
            blocks.append((A[rows].T @ A[rows], A[rows].T @ v[rows]))
    nothing = np.full(4, math.nan)
    if not blocks:
        return nothing, nothing, 0.0
    N, h = (np.stack(some) for some in zip(*blocks, strict=True))
    size = np.sqrt(np.diag(N.sum(axis=0))) + 1e-12
    N, h = N / np.outer(size, size), h / size
    flat = 1e-6 * np.eye(4)
    values = np.linalg.solve(N.sum(axis=0) + flat, h.sum(axis=0)) / size
    without = np.linalg.solve(N.sum(axis=0) - N + flat, (h.sum(axis=0) - h)[..., None])[..., 0] / size
    return values, np.sqrt((len(N) - 1) * without.var(axis=0)), float(np.linalg.eigvalsh(N.sum(axis=0))[0])


def sway_findings(pivots: Sway) -> list[Found]:
    """Doubts about heading and reference point, from the sway of all files of a folder."""
    out: list[Found] = []
    off, ahead = pivots.offset, pivots.pivot
    if abs(off) > max(SIGMAS * pivots.offset_std, OFFSET):
        side = "starboard" if off > 0 else "port"
        text = (
            f"On all headings the ship goes {abs(math.degrees(off)):.1f} deg to {side} of hers (standard error "
            f"{math.degrees(pivots.offset_std):.1g}): the heading is off, by a mounting or by a variation"
        )
        out.append((DOUBTFUL, "heading_offset", text))
    if -ahead > SIGMAS * pivots.pivot_std:
        text = (
            f"The stern does not swing out: sway goes with the turn, as {-ahead:.3g} m ahead of the pivot point "
            f"(standard error {pivots.pivot_std:.1g}): velocities or positions are those of an antenna far forward "
            "(reference_point), or v has the other sign"
        )
        out.append((DOUBTFUL, "lever_arm", text))
    return out


def sternway(trial: Trial) -> list[Found]:
    """A doubt where a ship with revolutions ahead goes astern throughout ``trial``."""
    names = [name for name in ("n", "n_azimuth") if name in trial]
    if not names or "n_azimuth" in names:  # a pod may push either way
        return []
    u, n = trial["u"], trial["n"]
    known = np.isfinite(u) & np.isfinite(n)
    driven = known & (n > 0.1 * np.nanmax(np.abs(n), initial=1e-9))
    if known.sum() < PIECES or driven.sum() < AHEAD * known.sum() or np.mean(u[driven] < 0) < MOSTLY:
        return []
    text = (
        f"With revolutions ahead the ship goes astern in {np.mean(u[driven] < 0):.0%} of the rows: n is positive "
        "astern, u is, or the heading is turned by 180 deg"
    )
    return [(DOUBTFUL, "u_sign", text)]


def turning_wind(trial: Trial) -> tuple[float | None, list[Found]]:
    """Nats by which the true wind of ``trial`` turns with the ship, and a doubt where it does."""
    if not trial.has_wind:
        return None, []
    air = (trial.wind_vector @ [1.0, 1j]) * np.exp(-1j * trial["psi"])
    known = np.isfinite(air)
    if known.sum() < 10 * PIECES:
        return None, []
    body, turn = air[known], np.exp(1j * trial["psi"][known])
    fixed, turning = (float(np.mean(np.abs(w - w.mean()) ** 2)) for w in (body * turn, body))
    nats = PIECES * math.log((fixed + 1e-12) / (turning + 1e-12))
    if nats < COST or turning > 0.5 * fixed:
        return nats, []
    text = (
        "The true wind turns with the ship: its direction is counted from the bow, or the angle of the apparent "
        f"wind it was derived from has another sign or zero (log odds {nats:.0f})"
    )
    return nats, [(DOUBTFUL, "wind_direction", text)]
