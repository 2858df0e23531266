"""Particulars of a new ship that contradict each other, and unusual ones: a wrong unit shows in ratios."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mmg.motion.froude import reference_speed

KNOT = 1852 / 3600
"""m/s."""

RANGES = (
    ("L / B", ("L",), ("B",), 3.5, 10.0),
    ("B / d", ("B",), ("d",), 1.8, 6.0),
    ("L / d", ("L",), ("d",), 9.0, 40.0),
    ("D_P / d", ("D_P",), ("d",), 0.25, 0.95),
    ("A_R / (L d)", ("A_R",), ("L", "d"), 0.008, 0.045),
)
"""Ratio in words, what it divides by what, and between which values nearly all merchant ships lie (own judgement from
the ships of benchmarks/literature and textbooks)."""


def usual_froude(C_b: float) -> float:
    """Froude number of the service speed that goes with ``C_b`` [-]: (1.08 - C_b) / 1.68, at least 0.12.

    Alexander's formula with K = 1.08, as quoted in textbooks.
    """
    return max((1.08 - C_b) / 1.68, 0.12)


def impossible(p: Mapping[str, float]) -> list[str]:
    """A sentence for each pair of ``p`` [SI] (L, B, d, C_b and more) that no ship has."""
    wrong = []
    if "U_0" in p and p["C_b"] >= 0.7:
        froude, most = p["U_0"] / reference_speed(p["L"]), 1.5 * usual_froude(p["C_b"])
        if froude > most:
            wrong.append(
                f"U_0 = {p['U_0']:g} m/s is Froude number {froude:.2f}, which no ship of C_b = {p['C_b']:g} reaches "
                f"(at most {most:.2f}); speeds are in m/s: {p['U_0']:g} kn are U_0={p['U_0'] * KNOT:.3g}"
            )
    if "m" in p:
        block = p.get("rho", 1025.0 if p["L"] > 20 else 1000.0) * p["L"] * p["B"] * p["d"] * p["C_b"]
        if not 0.8 <= p["m"] / block <= 1.2:
            wrong.append(
                f"m = {p['m']:g} kg is {p['m'] / block:.2f} of rho L B d C_b = {block:.4g} kg: they contradict "
                "each other; check C_b, d and the unit of m"
            )
    return wrong


def unusual(p: Mapping[str, float]) -> Iterator[str]:
    """A sentence for each particular among those given in ``p`` [SI] that few ships have."""
    if "U_0" in p:
        froude, usual = p["U_0"] / reference_speed(p["L"]), usual_froude(p["C_b"])
        if froude > 1.25 * usual:
            yield (
                f"U_0 = {p['U_0']:g} m/s is Froude number {froude:.2f}, fast for C_b = {p['C_b']:g} (usually about "
                f"{usual:.2f}); if it was meant in knots, give U_0={p['U_0'] * KNOT:.3g}"
            )
        elif froude < 0.05:
            yield f"U_0 = {p['U_0']:g} m/s is Froude number {froude:.3f}, slow for a service speed; it is in m/s"
    for words, above, below, low, high in RANGES:
        if all(name in p for name in (*above, *below)) and all(p[name] > 0 for name in above):
            ratio = 1.0
            for name in above:
                ratio *= p[name]
            for name in below:
                ratio /= p[name]
            total = 2 if above == ("A_R",) and p.get("y_P", 0.0) > 0 else 1
            if not low <= total * ratio <= high:
                customary = f"{low:g} to {high:g} of merchant ships"
                yield f"{words} = {total * ratio:.3g} is unusual ({customary}); check {above[0]} and its unit"
    if not 0.4 <= p["C_b"] <= 0.9:
        yield f"C_b = {p['C_b']:g} is unusual (0.4 to 0.9 of merchant ships)"
    if "m" in p:
        block = p.get("rho", 1025.0 if p["L"] > 20 else 1000.0) * p["L"] * p["B"] * p["d"] * p["C_b"]
        if not 0.96 <= p["m"] / block <= 1.04:
            yield f"m = {p['m']:g} kg is {p['m'] / block:.3f} of rho L B d C_b; check C_b, d and m"
