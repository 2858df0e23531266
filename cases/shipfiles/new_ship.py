"""A starting ship from its main particulars: regressions of the literature with wide priors.

What is not given follows from rules of thumb, each named in the notices and in the ``source`` of its coefficient.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

from cases.shipfiles.estimates import STARTING, estimates, trust
from cases.shipfiles.particulars import impossible, unusual, wrong_particulars
from mmg.components.catalogue import coefficient_table, required_particulars
from mmg.components.coefficients import Coefficient
from mmg.components.particulars import ENGINE
from mmg.effects.wind_force import upper_works
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, UnknownName
from mmg.messages import Message
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

ORDER = ("L", "B", "d", "C_b", "D_P", "pitch_ratio", "A_R", "U_0")
"""Main particulars in the order in which they may be given without names; the first four are needed."""

LEAST = ORDER[:4]
WORDS = {"Cb": "C_b", "CB": "C_b", "T": "d", "Lpp": "L", "P/D": "pitch_ratio", "DP": "D_P", "AR": "A_R", "V": "U_0"}
"""Other spellings of particulars."""

OPTIONAL = (
    "rho", "x_G", "m", "aspect_ratio", "x_R", "y_P", "A_T", "A_L", "A_OD", "C", "C_BR", "H_BR", "H_C", "rho_a",
    "D_BT", "x_BT", "D_ST", "x_ST", *ENGINE,
)  # fmt: skip
"""Particulars that may be added as NAME=VALUE."""

HULLS = ("unified", "polynomial")


def parse_particulars(words: Sequence[str]) -> dict[str, float]:
    """Particulars [SI] from ``words`` such as "320 58 20.8 C_b=0.81 D_P=9.86".

    Numbers in the order of ORDER, then NAME=VALUE. Raises UserError for anything else.
    """
    given: dict[str, float] = {}
    for i, word in enumerate(word for part in words for word in part.replace(",", " ").split()):
        name, equals, number = word.rpartition("=")
        if not equals:
            if i >= len(ORDER) or i != len(given):
                raise BadValue(
                    f"--new: '{word}' has no name; give numbers in the order {' '.join(ORDER)}, then NAME=VALUE"
                )
            name = ORDER[i]
        name = WORDS.get(name.strip(), name.strip())
        if name not in (*ORDER, *OPTIONAL):
            raise UnknownName(f"--new: unknown particular '{name}'; known: {', '.join((*ORDER, *OPTIONAL))}")
        if name in given:
            raise Conflict(f"--new: {name} is given twice")
        try:
            given[name] = float(number)
        except ValueError:
            raise BadValue(f"--new: {name} = '{number}' is not a number") from None
    missing = [name for name in LEAST if name not in given]
    if missing:
        raise Missing(
            f"--new: {', '.join(missing)} missing; give at least L B d C_b, such as --new 320 58 20.8 0.81 D_P=9.86"
        )
    return given


def check_plausible(p: Mapping[str, float]) -> None:
    """Raises UserError, naming the value, for particulars ``p`` [SI] that no ship has or no regression knows."""
    if p.get("A_R") == 0.0:
        p = {name: value for name, value in p.items() if name != "A_R"}
    wrong = wrong_particulars(p)
    if wrong:
        raise OutOfRange(f"--new: {'; '.join(wrong)}")
    for sentence in impossible(p):
        raise OutOfRange(f"--new: {sentence}")


def complete(given: Mapping[str, float]) -> tuple[dict[str, float], list[str]]:
    """All particulars [SI] of a ship from those ``given``, and sentences on the rules that filled the gaps."""
    v, notices = dict(given), []

    def default(name: str, value: float, rule: str) -> None:
        if name not in v:
            v[name] = float(f"{value:.6g}")
            notices.append(f"{name} = {value:.4g} by default: {rule}")

    L, B, d, C_b = (v[name] for name in LEAST)
    default("rho", 1025.0 if L > 20 else 1000.0, "sea water" if L > 20 else "fresh water, as it is a model")
    default("U_0", (0.15 + 0.5 * max(0.81 - C_b, 0.0)) * reference_speed(L), "service speed typical of C_b")
    froude = v["U_0"] / reference_speed(L)
    default(
        "x_G", L * min(max(8.80 - 38.9 * froude, -3.0), 3.5) / 100, "usual centre of buoyancy at this Froude number"
    )
    default("m", v["rho"] * L * B * d * C_b, "rho L B d C_b")
    default("D_P", 0.45 * d if "y_P" not in v else 0.35 * d, "usual share of the draught")
    default("pitch_ratio", 0.75, "usual for slow merchant ships")
    rudders = 2 if v.get("y_P", 0.0) > 0 else 1
    default("A_R", 0.01 * L * d * (1 + 25 * (B / L) ** 2) / rudders, "class rule on the rudder area")
    if v["A_R"] > 0:
        default("aspect_ratio", (0.7 * d) ** 2 / v["A_R"], "rudder height 0.7 d")
        default("x_R", -0.5 * L, "at the aft perpendicular")
    whole = vars(upper_works(SimpleNamespace(**v)))
    missing = [name for name in ("A_T", "A_L", "A_OD", "C", "C_BR", "H_BR", "H_C", "rho_a") if name not in v]
    v.update({name: float(f"{whole[name]:.4g}") for name in missing})
    if "A_T" in missing or "A_L" in missing:
        notices.append("upper works (A_T, A_L, ...) by default: those of a loaded tanker of this L and B")
    for name, place in (("BT", 0.42), ("ST", -0.42)):
        if f"D_{name}" in v:
            default(f"x_{name}", place * L, "usual place of the thruster")
    return v, notices


def new_ship(name: str, given: Mapping[str, float], hull: str = "unified") -> Ship:
    """A ship from main particulars (at least LEAST), ready to be simulated and calibrated.

    name: of the ship; given: particulars [SI]; hull: "unified" (Yoshimura et al. 2009, any drift angle, harbour) or
    "polynomial" (Yoshimura & Masumoto 2012, ahead). Single screw or, with y_P, twin; A_R = 0: without a
    rudder. Raises UserError for particulars that no ship has.
    """
    if hull not in HULLS:
        raise UnknownName(f"--hull {hull}: known are {', '.join(HULLS)}")
    check_plausible(given)
    p, notices = complete(given)
    check_plausible(p)
    warnings = [Message(sentence, "unusual_particular") for sentence in unusual(given)]
    components = {"hull": hull, "propeller": "hachii"} | ({"rudder": "standard"} if p["A_R"] > 0 else {})
    components |= {"wind": "fujiwara"}
    components |= {"bow_thruster": "kobayashi"} if "D_BT" in p else {}
    components |= {"stern_thruster": "kobayashi"} if "D_ST" in p else {}
    kept = (*required_particulars(components), "C_b", "U_0", *(name for name in ("y_P", *ENGINE) if name in p))
    particulars = {key: p[key] for key in dict.fromkeys(kept)}
    table, words = coefficient_table(components, particulars), STARTING
    ship = Ship(
        name,
        particulars,
        components,
        table,
        description=words,
        notices=(*warnings, *notices, Message(trust(p, hull), "starting_ship")),
    )
    rows = {}
    for symbol, (value, share, source) in estimates(p, hull).items():
        if symbol in ship.coefficients:
            row, value = ship.coefficients[symbol], float(f"{value:.5g}")
            std = float(f"{share * abs(value):.3g}")
            lower, upper = _widened(row, value, 3 * std)
            rows[symbol] = row.with_(value=value, std=std, lower=lower, upper=upper, source=source)
    return ship.with_coefficients(rows)


def _widened(row: Coefficient, value: float, reach: float) -> tuple[float, float]:
    """Bounds of the model widened to ``value`` +- ``reach``, but not across zero where they have one sign."""
    lower, upper = min(row.lower, value - reach), max(row.upper, value + reach)
    return max(lower, 0.0) if row.lower >= 0 else lower, min(upper, 0.0) if row.upper <= 0 else upper
