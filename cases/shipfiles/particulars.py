"""Particulars that no ship has, and unusual ones: signs, ratios, and units that the numbers themselves refute.

Ship files are held to ``wrong_particulars``, which leave room for odd ships, the starting ships of ``mmg ships --new``
to ``impossible`` as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from cases.quantities import KNOT
from mmg.components.coefficients import PARTICULARS
from mmg.motion.flow import PODS
from mmg.motion.froude import reference_speed, time_scale

# Particulars that trials show and no force model needs.
RATES = ("rudder_rate", "rudder_delay", "propeller_rate", "approach_speed", "neutral_rudder")
BY_RULE = "rule: "  # How the source of a particular begins that follows from a rule of thumb
PODS_ASIDE = ("y_az", "y_az_2", "y_az_3", "y_az_4")
PLACES = ("x_G", "x_R", "C", "C_BR", "x_BT", "x_ST", "x_az", "x_az_2", "x_az_3", "x_az_4")
# Particulars that may be zero or negative: places relative to midship, and an angle.
SIGNED = (*PLACES, *PODS_ASIDE, "neutral_rudder")
# Longest delay of the rudder of a 3 m model [s]: 30 s of a ship of 300 m. Set by hand, above any steering gear.
MOST_DELAY = 3.0
LONGEST = 600.0  # m; the longest ship built has 458. Seawise Giant (1979); the limit was set by hand.
# Size in SI units that no particular of a ship reaches, and the inverse of the smallest.
LARGEST = 1e12  # set by hand: bounds what a typing error can do
# Ratio in words, what it divides by what, between which values a ship can be, and nearly all merchant ships lie (own
# judgement from the ships of benchmarks/literature and textbooks).
RATIOS: tuple[tuple[str, tuple[str, ...], tuple[str, ...], tuple[float, float], tuple[float, float]], ...] = (
    ("C_b", ("C_b",), (), (0.3, 1.0), (0.4, 0.9)),
    ("L / B", ("L",), ("B",), (1.5, 15.0), (3.5, 10.0)),
    ("B / d", ("B",), ("d",), (1.0, 12.0), (1.8, 6.0)),
    ("L / d", ("L",), ("d",), (0.0, math.inf), (9.0, 40.0)),
    ("pitch_ratio", ("pitch_ratio",), (), (0.3, 1.6), (0.3, 1.6)),
    ("D_P / d", ("D_P",), ("d",), (0.1, 1.0), (0.25, 0.95)),
    ("A_R / (L d)", ("A_R",), ("L", "d"), (0.002, 0.1), (0.008, 0.045)),
    ("m / (rho L B d C_b)", ("m",), ("rho", "L", "B", "d", "C_b"), (0.8, 1.2), (0.96, 1.04)),
)


def wrong_particulars(p: Mapping[str, float]) -> list[str]:
    """A sentence, with name and value, for each particular that no ship has.

    p: some or all particulars [SI]; rules that need one that is absent are left out, and those that compare
    particulars are used where each is possible by itself.
    """
    wrong = [
        f"{name} is given without {other}: a pod needs both"
        for i in range(2, PODS + 1)
        for name, other in ((f"x_az_{i}", f"y_az_{i}"), (f"y_az_{i}", f"x_az_{i}"))
        if name in p and other not in p
    ]
    for name, value in p.items():
        if name in PARTICULARS and (not math.isfinite(value) or (name not in SIGNED and value <= 0)):
            words, unit = PARTICULARS[name]
            wanted = "a finite number" if name in SIGNED else "a positive number"
            size = f"{value:g}" if unit == "-" else f"{value:g} {unit}"
            wrong.append(f"{name} = {size} ({words}) must be {wanted}")
        elif name in PARTICULARS and (abs(value) > LARGEST or 0 < abs(value) < 1 / LARGEST):
            wrong.append(f"{name} = {value:g} {PARTICULARS[name][1]} is out of all proportion; check its unit (SI)")
    return wrong or list(_refuted(p))


def _refuted(p: Mapping[str, float]) -> Iterator[str]:
    def have(*names: str) -> bool:
        return all(name in p for name in names)

    if have("C_b") and p["C_b"] > 1:
        yield f"C_b = {p['C_b']:g}: a block coefficient is at most 1"
    if have("L") and not 0.1 <= p["L"] <= LONGEST:
        yield f"L = {p['L']:g} m is outside 0.1 to {LONGEST:g} m; check its unit"
    if have("L", "B") and p["B"] > p["L"]:
        yield f"L / B = {p['L']:g} / {p['B']:g} = {p['L'] / p['B']:.3g} is less than 1; check L and B"
    for name in ("D_P", "D_BT", "D_ST"):
        if have(name, "d") and p[name] > p["d"]:
            what = PARTICULARS[name][0].removesuffix(" diameter")
            yield f"{name} = {p[name]:g} m: the {what} is larger than the draught d = {p['d']:g} m"
    for name, least, most, what in (("rho", 500, 1500, "water"), ("rho_a", 0.5, 2.0, "air")):
        if have(name) and not least <= p[name] <= most:
            yield f"{name} = {p[name]:g} kg/m³ is no {what} density"
    if have("m", "rho", "L", "B", "d"):
        block = p["rho"] * p["L"] * p["B"] * p["d"]
        if not 0.02 * block <= p["m"] <= 1.05 * block:
            yield f"m = {p['m']:g} kg is {p['m'] / block:.3g} of rho L B d = {block:.4g} kg; check units"
    if have("A_R", "L", "d") and p["A_R"] > 0.1 * p["L"] * p["d"]:
        yield f"A_R = {p['A_R']:g} m² is more than a tenth of L d = {p['L'] * p['d']:g} m²"
    if have("A_R", "aspect_ratio", "d"):
        height = math.sqrt(p["A_R"] * p["aspect_ratio"])
        if height > 1.2 * p["d"]:
            yield (
                f"A_R = {p['A_R']:g} m² and aspect_ratio = {p['aspect_ratio']:g} give a rudder {height:.3g} m high, "
                f"more than the draught d = {p['d']:g} m"
            )
    for names, side, share in ((PLACES, "L", 0.6), (("y_P", *PODS_ASIDE), "B", 0.5)):
        for name in names:
            if have(name, side) and abs(p[name]) > share * p[side]:
                yield f"{name} = {p[name]:g} m lies off the ship ({side} = {p[side]:g} m)"
    for name, side in (("A_T", "B"), ("A_L", "L")):
        if have(name, side) and p[name] > 5 * p[side] ** 2:
            yield f"{name} = {p[name]:g} m² is more than 5 {side}² = {5 * p[side] ** 2:g} m²; check its unit"
    if have("rudder_rate", "L"):
        most = 10 * math.radians(20) / time_scale(p["L"])  # ten times the usual rate (``Limits.for_length``)
        if p["rudder_rate"] > most:
            yield f"rudder_rate = {p['rudder_rate']:g} rad/s is more than {most:.3g} rad/s; check its unit"
    if have("rudder_delay", "L") and p["rudder_delay"] > (most := MOST_DELAY * time_scale(p["L"])):
        yield f"rudder_delay = {p['rudder_delay']:g} s is more than {most:.3g} s; check its unit"


def impossible(p: Mapping[str, float]) -> list[str]:
    """A sentence for each of RATIOS, and for a service speed, among ``p`` [SI] that no displacement ship has."""
    sentences = [f"{words}; check {first} and its unit" for words, first in _outside(p, merchant=False)]
    froude, usual = _froude(p)
    most = 1.5 * usual if p["C_b"] >= 0.7 else 0.6
    if froude is not None and not 0.02 <= froude <= most:
        sentences.append(
            f"U_0 = {p['U_0']:g} m/s is Froude number {froude:.2g}, outside 0.02 to {most:.2g} of ships of C_b = "
            f"{p['C_b']:g}; speeds are in m/s: {p['U_0']:g} kn are U_0={p['U_0'] * KNOT:.3g}"
        )
    return sentences


def unusual(p: Mapping[str, float]) -> Iterator[str]:
    """A sentence for each particular among those given in ``p`` [SI] that few ships have."""
    froude, usual = _froude(p)
    if froude is not None and not 0.05 <= froude <= 1.25 * usual:
        yield (
            f"U_0 = {p['U_0']:g} m/s is Froude number {froude:.2g}, unusual for C_b = {p['C_b']:g} (usually about "
            f"{usual:.2f}); if it was meant in knots, give U_0={p['U_0'] * KNOT:.3g}"
        )
    for words, first in _outside(p, merchant=True):
        yield f"{words} of merchant ships, so it is unusual; check {first} and its unit"


def _outside(p: Mapping[str, float], merchant: bool) -> Iterator[tuple[str, str]]:
    """Words on each of RATIOS outside its limits, or those of ``merchant`` ships, and its first particular."""
    p = {"rho": 1025.0 if p["L"] > 20 else 1000.0, **p}  # kg/m^3: shorter ones are models, in fresh water
    for words, above, below, possible, usual in RATIOS:
        low, high = usual if merchant else possible
        if {*above, *below} <= set(p) and p[above[0]] > 0:
            ratio = math.prod(p[name] for name in above) / math.prod(p[name] for name in below)
            ratio *= 2 if above == ("A_R",) and merchant and p.get("y_P", 0.0) > 0 else 1  # of two rudders
            if not low <= ratio <= high:
                size = f"{above[0]} = {p[above[0]]:g} {PARTICULARS[above[0]][1]}"
                yield f"{size}: {words} = {ratio:.3g} is outside {low:g} to {high:g}", above[0]


def _froude(p: Mapping[str, float]) -> tuple[float | None, float]:
    """Froude number of the service speed in ``p`` [SI], None without, and the one that goes with its C_b. That is (1.08
    - C_b) / 1.68, at least 0.12: Alexander's formula with K = 1.08, as quoted in textbooks."""
    return p["U_0"] / reference_speed(p["L"]) if "U_0" in p else None, max((1.08 - p["C_b"]) / 1.68, 0.12)
