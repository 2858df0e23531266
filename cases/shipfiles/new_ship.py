"""A starting ship from its main particulars: regressions of the literature with wide priors.

What is not given follows from rules of thumb, each named in the notices and in the ``source`` of its coefficient.

The linear derivatives are means of six regressions. Common factors (CORRECTIONS) bring turning circles and zigzags of
the ships in benchmarks/literature to the published ones as far as one set for all ships can; they are determined by
``benchmarks.own_ships`` of 5f878e7, which also leaves out each ship in turn. The standard deviations are as wide as the
errors of the ships left out demand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from cases.shipfiles.particulars import BY_RULE, impossible, unusual, wrong_particulars
from mmg.components import empirical, friction
from mmg.components.catalogue import coefficient_table, required_particulars
from mmg.components.coefficients import ENGINE, PARTICULARS, Coefficient
from mmg.components.propeller.b_series import thrust_parabola
from mmg.components.propeller.wake import ASYMMETRY
from mmg.effects.wind_force import upper_works
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, UnknownName, finite, refusing, unknown
from mmg.messages import Message
from mmg.motion.flow import PODS, pods
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

STARTING = "starting ship from main particulars"  # Description of a starting ship
Estimate = tuple[float, float, str]  # Value, standard deviation as a share of it, source.
LINEAR = ("Y_v", "Y_r", "N_v", "N_r")
# Hull -> factor on a coefficient, the same for all ships, from ships of the literature (benchmarks.own_ships of
# 5f878e7).
CORRECTIONS = {
    "unified": {"N_v": 1.6, "C_rN": 1.55, "gamma_R": 0.9, "epsilon": 0.93, "kappa": 0.93},
    "polynomial": {"N_v": 1.4, "N_r": 1.5, "Y_vrr": 2.1, "gamma_R": 1.05, "epsilon": 0.83},
}
CORRECTIONS["harbour"] = CORRECTIONS["unified"]
# Hull -> factor on the standard deviations of the literature and of experience. With those of the unified hull, 90 %
# intervals hold nine in ten figures of ships left out; the polynomial's are wider, so that captive tests lie within. Of
# ferries and other craft with pods (harbour) the regressions have seen none: set by hand.
WIDENING = {"unified": 0.65, "polynomial": 1.0, "harbour": 1.5}
FULL = 0.7  # Block coefficient from which a ship counts as full. Set by hand.
# Hull, full or fine -> root mean square errors of lengths and of overshoots [%] of ships left out, how many ships
# (benchmarks.own_ships of 5f878e7).
ERRORS = {
    ("unified", True): (26, 39, 4),
    ("unified", False): (25, 39, 2),
    ("polynomial", True): (25, 42, 4),
    ("polynomial", False): (33, 42, 2),
}


def resistance(p: Mapping[str, float]) -> float:
    """R_0' [-] for particulars ``p`` [SI]: viscous resistance at the service speed by 1/2 rho L d U^2.

    ITTC-57 friction on the wetted surface of Mumford, S = 1.7 L d + vol/d, with Watanabe's form factor
    k = -0.095 + 25.6 C_b / ((L/B)^2 sqrt(B/d)) and 0.0004 for roughness and waves; 24 % low for the KVLCC2 model.
    """
    L, B, d, C_b = (p[name] for name in ("L", "B", "d", "C_b"))
    C_F = friction.friction_line(p["U_0"] * L / friction.viscosity(p["rho"]))
    surface = friction.wetted_surface(L, B, d, C_b) / (L * d)
    return surface * (C_F * (1 + friction.form_factor(L, B, d, C_b)) + 4e-4)


def is_starting_ship(ship: Ship) -> bool:
    """Whether ``ship`` is as ``mmg ships --new`` made it: its standard deviations are priors."""
    return ship.description == STARTING and all(c.prior_value is None for c in ship.coefficients.values())


def trust(p: Mapping[str, float], hull: str) -> str:
    """How far a starting ship can be trusted, in a sentence. p: particulars [SI]; hull: of HULLS."""
    full = p["C_b"] >= FULL
    lengths, angles, count = ERRORS["unified" if hull == "harbour" else hull, full]
    kind = f"full ships (C_b of {FULL:g} and more)" if full else f"fine ships (C_b below {FULL:g})"
    words = (
        f"a starting ship: of {count} {kind} of the literature, each left out in turn, advance and tactical diameter "
        f"were missed by {lengths} %, overshoots by {angles} % (root mean square). Its standard deviations are as "
        "wide: mmg imo shows the intervals"
    )
    if "y_P" in p or p.get("A_R", 0.0) == 0.0:
        words += "; none of them had two screws, pods or no rudder"
    return words


def spread(p: Mapping[str, float], m_x: float) -> dict[str, float]:
    """Standard deviation of the regressions of the literature about their mean, as a share of it, by symbol.

    Linear derivatives of the six regressions; added masses: deviation of Clarke's from Motora's charts. p: particulars
    [SI]; m_x: added mass in MMG primes.
    """
    L, B, d, C_b = (p[name] for name in ("L", "B", "d", "C_b"))
    regressions = empirical.linear_derivatives(L, B, d, C_b, m_x).values()
    rows = {s: np.array([each[s] for each in regressions]) for s in LINEAR}
    shares = {s: float(values.std() / abs(values.mean())) for s, values in rows.items()}
    mass, clarke = empirical.motora_added_mass(L, B, d, C_b), empirical.clarke_1983(L, B, d, C_b)
    shares["m_y"] = abs(-clarke["Y_vdot"] / mass["m_y"] - 1)
    return shares | {"J_z": abs(-clarke["N_rdot"] / mass["J_z"] - 1)}


def estimates(p: Mapping[str, float], hull: str) -> dict[str, Estimate]:
    """Symbol -> value, standard deviation as a share of it, source. p: all particulars [SI]; hull: of HULLS."""
    L, B, d, C_b = (p[name] for name in ("L", "B", "d", "C_b"))
    mass = empirical.motora_added_mass(L, B, d, C_b)
    regression = empirical.yoshimura_masumoto_2012(L, B, d, C_b, mass["m_x"], mass["m_y"], p["x_G"])
    scatter = spread(p, mass["m_x"])
    mixed = empirical.linear_derivatives(L, B, d, C_b, mass["m_x"])
    radius = 0.25**2 * p["m"] / (0.5 * p["rho"] * L**2 * d)  # I_zG' of a radius of gyration of 0.25 L
    R_0 = resistance(p)
    k_0, k_1, k_2 = thrust_parabola(p.get("pitch_ratio", PITCH_RATIO))
    wake = 0.5 * C_b - 0.05 if "y_P" not in p else max(0.55 * C_b - 0.20, 0.05)
    gyration = "radius of gyration 0.25 L, J_z from Motora's charts"
    motora = "Motora's charts, regression of Zhou et al. (1983)"
    b_series = "Wageningen B-series (4 blades, area ratio 0.6)"
    source, friction = "Yoshimura & Masumoto (2012) on L, B, d, C_b", "ITTC-57 friction with a form factor"
    mean = {s: float(np.mean([each[s] for each in mixed.values()])) for s in LINEAR}
    six = f"mean of {len(mixed)} regressions: {', '.join(mixed)}"
    linear = {s: (mean[s], max(0.25, scatter[s]), six) for s in LINEAR}
    estimated: dict[str, Estimate] = {
        "m_x": (mass["m_x"], 0.3, motora),
        "m_y": (mass["m_y"], max(0.15, scatter["m_y"]), motora),
        "I_J_z": (radius + mass["J_z"], max(0.15, 0.3 * scatter["J_z"]), gyration),
        "k_0": (k_0, 0.1, b_series),
        "k_1": (k_1, 0.15, b_series),
        "k_2": (k_2, 0.3, b_series),
        "w_P0": (wake, 0.25, "0.5 C_b - 0.05, twin screw 0.55 C_b - 0.20"),
        "t_R": (regression["t_R"], 0.3, source),
        "ell_R": (regression["ell_R"], 0.2, source),
        "gamma_R_plus": (regression["gamma_R"], 0.3, source),
        "gamma_R_minus": (regression["gamma_R"], 0.3, source),
        "epsilon": (1.09, 0.23, "default of the standard rudder model"),
        "kappa": (0.50, 0.24, "default of the standard rudder model"),
        "a_H": (max(regression["a_H"], 0.05), 0.4, "Quadvlieg (2013): 0.627 C_b - 0.153"),
    }
    if hull == "polynomial":
        derivatives = {s: (value, 0.5, source) for s, value in regression.items() if s[0] in "XYN" and "_" in s}
        return _corrected(estimated | {"R_0": (R_0, 0.3, friction)} | derivatives | linear, hull, scatter)
    low = empirical.yoshimura_2009_low_speed(L, B, d)
    rows = estimated | {
        "X_0F": (-R_0, 0.3, friction),
        "X_0A": (-1.3 * R_0, 0.4, "1.3 times the resistance ahead"),
        **linear,
        "C_D": (min(max(low["C_D"], 0.4), 1.2), 0.3, "Yoshimura et al. (2009) on L/d, within 0.4 to 1.2"),
        "C_rY": (min(max(low["C_rY"], 0.8), 2.4), 0.3, "Yoshimura et al. (2009) on L/B, within 0.8 to 2.4"),
        "C_rN": (min(max(low["C_rN"], 0.4), 1.5), 0.3, "Yoshimura et al. (2009) on L/d, within 0.4 to 1.5"),
    }
    return _corrected(rows, hull, scatter)


def _corrected(rows: Mapping[str, Estimate], hull: str, scatter: Mapping[str, float]) -> dict[str, Estimate]:
    """``rows`` with the factors of CORRECTIONS and shares times WIDENING, linear ones no less than their scatter."""
    corrected = {}
    for symbol, (value, share, source) in rows.items():
        factor = CORRECTIONS[hull].get(symbol.removesuffix("_plus").removesuffix("_minus"), 1.0)
        words = f"{source}; times {factor:g} by ships of the literature (benchmarks/own_ships.py of 5f878e7)"
        least = scatter[symbol] if symbol in LINEAR else 0.0
        corrected[symbol] = (factor * value, max(WIDENING[hull] * share, least), source if factor == 1.0 else words)
    return corrected


# Main particulars in the order in which they may be given without names; the first four are needed.
ORDER = ("L", "B", "d", "C_b", "D_P", "pitch_ratio", "A_R", "U_0")
LEAST = ORDER[:4]
# Other spellings of particulars.
WORDS = {"Cb": "C_b", "CB": "C_b", "T": "d", "Lpp": "L", "P/D": "pitch_ratio", "DP": "D_P", "AR": "A_R", "V": "U_0"}
PITCH_RATIO = 0.75  # Of propellers of slow merchant ships [-]. Set by hand.
POD = ("D_az", "x_az", "y_az")  # Particulars of a ship that pods drive in place of propeller and rudder
SCREW = ("D_P", "pitch_ratio", "A_R", "aspect_ratio", "x_R", "y_P")  # Particulars of propeller and rudder
# Particulars that may be added as NAME=VALUE.
OPTIONAL = (
    "rho", "x_G", "m", "aspect_ratio", "x_R", "y_P", "A_T", "A_L", "A_OD", "C", "C_BR", "H_BR", "H_C", "rho_a",
    "D_BT", "x_BT", "D_ST", "x_ST", "rudder_rate", "rudder_delay", "propeller_rate", *ENGINE, *POD,
    *(f"{place}_{i}" for i in range(2, PODS + 1) for place in POD[1:]),
)  # fmt: skip
HULLS = ("unified", "harbour", "polynomial")


def parse_particulars(words: Sequence[str]) -> dict[str, float]:
    """Particulars [SI] from ``words`` such as "320 58 20.8 C_b=0.81 D_P=9.86". Numbers in the order of ORDER, then
    NAME=VALUE. Raises UserError for anything else."""
    given: dict[str, float] = {}
    for i, word in enumerate(word for part in words for word in part.replace(",", " ").split()):
        name, equals, number = word.rpartition("=")
        if not equals:  # a number without a name has the name of its place, as long as none had one before
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


# Rules of thumb of particulars that trials replace by what they show.
RULES = {"U_0": "service speed typical of C_b", "D_P": "usual share of the draught"}


def complete(given: Mapping[str, float]) -> tuple[dict[str, float], list[str]]:
    """All particulars [SI] of a ship from those ``given``, and sentences on the rules that filled the gaps."""
    v, notices = dict(given), []

    def default(name: str, value: float, rule: str) -> None:
        if name not in v:
            v[name] = float(f"{value:.6g}")
            notices.append(f"{name} = {value:.4g} by default: {rule}")

    L, B, d, C_b = (v[name] for name in LEAST)
    default("rho", 1025.0 if L > 20 else 1000.0, "sea water" if L > 20 else "fresh water, as it is a model")
    default("U_0", (0.15 + 0.5 * max(0.81 - C_b, 0.0)) * reference_speed(L), RULES["U_0"])
    froude = v["U_0"] / reference_speed(L)
    default(
        "x_G", L * min(max(8.80 - 38.9 * froude, -3.0), 3.5) / 100, "usual centre of buoyancy at this Froude number"
    )
    default("m", v["rho"] * L * B * d * C_b, "rho L B d C_b")
    if not podded(v):
        default("D_P", 0.45 * d if "y_P" not in v else 0.35 * d, RULES["D_P"])
        default("pitch_ratio", PITCH_RATIO, "usual for slow merchant ships")
        rudders = 2 if v.get("y_P", 0.0) > 0 else 1
        default("A_R", 0.01 * L * d * (1 + 25 * (B / L) ** 2) / rudders, "class rule on the rudder area")
    if v.get("A_R", 0.0) > 0:
        default("aspect_ratio", (0.7 * d) ** 2 / v["A_R"], "rudder height 0.7 d")
        default("x_R", -0.5 * L, "at the aft perpendicular")
    upper = vars(upper_works(SimpleNamespace(**v)))
    missing = [name for name in ("A_T", "A_L", "A_OD", "C", "C_BR", "H_BR", "H_C", "rho_a") if name not in v]
    v.update({name: float(f"{upper[name]:.4g}") for name in missing})
    if "A_T" in missing or "A_L" in missing:
        notices.append("upper works (A_T, A_L, ...) by default: those of a loaded tanker of this L and B")
    for name, place in (("BT", 0.42), ("ST", -0.42)):
        if f"D_{name}" in v:
            default(f"x_{name}", place * L, "usual place of the thruster")
    return v, notices


def podded(given: Mapping[str, float]) -> bool:
    """Whether pods drive the ship of particulars ``given`` [SI], not a propeller before a rudder."""
    return "D_az" in given


@refusing
def new_ship(name: str, given: Mapping[str, float], hull: str | None = None) -> Ship:
    """A ship from main particulars (at least LEAST), ready to be simulated and calibrated.

    name: of the ship; given: particulars [SI]; hull: "unified" (Yoshimura et al. 2009, any drift angle, default),
    "harbour" (the same with linear damping, default of a ship with pods) or "polynomial" (Yoshimura & Masumoto 2012,
    ahead). Single screw or, with y_P, twin; A_R = 0: without a rudder; D_az, x_az, y_az, x_az_2, ...: pods in place of
    both. Raises UserError for particulars that no ship has.
    """
    given = {WORDS.get(key, key): finite(f"--new: {key}", value) for key, value in dict(given).items()}
    if strange := [key for key in given if key not in (*ORDER, *OPTIONAL, *PARTICULARS)]:
        raise UnknownName(f"--new: {unknown('particular', strange[0], (*ORDER, *OPTIONAL))}")
    hull = hull or ("harbour" if podded(given) else "unified")
    if hull not in HULLS:
        raise UnknownName(f"--hull {hull}: known are {', '.join(HULLS)}")
    lacking = [key for key in POD if key not in given]
    if len(lacking) < len(POD) and lacking:
        raise Missing(f"--new: {', '.join(lacking)} missing; a ship with pods needs {', '.join(POD)}")
    if podded(given) and (strange := [key for key in SCREW if key in given]):
        raise Conflict(f"--new: {', '.join(strange)}: pods (D_az) take the place of propeller and rudder")
    if lacking := [key for key in LEAST if key not in given]:
        raise Missing(f"{', '.join(lacking)} missing; a ship needs at least {', '.join(LEAST)}")
    check_plausible(given)  # first what was given, so that no rule of thumb is blamed for it
    p, notices = complete(given)
    check_plausible(p)
    warnings = [Message(sentence, "unusual_particular") for sentence in unusual(given)]
    components = {"hull": hull} | ({"azimuth": "azimuth"} if podded(p) else {"propeller": "hachii"})
    components |= {"rudder": "standard"} if p.get("A_R", 0.0) > 0 else {}
    components |= {"wind": "fujiwara"}
    components |= {"bow_thruster": "kobayashi"} if "D_BT" in p else {}
    components |= {"stern_thruster": "kobayashi"} if "D_ST" in p else {}
    kept = (
        *required_particulars(components),
        "C_b",
        "U_0",
        *(name for name in ("y_P", "rudder_rate", "rudder_delay", "propeller_rate", *ENGINE) if name in p),
        *(place + i for i in pods(p) for place in POD[1:]),
    )
    particulars = {key: p[key] for key in dict.fromkeys(kept)}
    table, words = coefficient_table(components, particulars), STARTING
    ship = Ship(
        name,
        particulars,
        components,
        table,
        description=words,
        notices=(*warnings, *notices, Message(trust(p, hull), "starting_ship")),
        sources={name: BY_RULE + rule for name, rule in RULES.items() if name in p and name not in given},
    )
    rows = {}
    for symbol, (value, share, source) in estimates(p, hull).items():
        if symbol in ship.coefficients:
            row, value = ship.coefficients[symbol], float(f"{value:.5g}")  # digits that a regression is good for
            std = float(f"{share * abs(value):.3g}")
            lower, upper = _widened(row, value, 3 * std)
            rows[symbol] = row.with_(value=value, std=std, lower=lower, upper=upper, source=source)
    # with the wake alike from both sides 102 of 126 figures lay inside for 116 (benchmarks/yards.py, e84d556)
    rows |= {c.symbol: c.with_(fixed=False) for c in ASYMMETRY if c.symbol in ship.coefficients}
    return ship.with_coefficients(rows)


def _widened(row: Coefficient, value: float, reach: float) -> tuple[float, float]:
    """Bounds of the model widened to ``value`` +- ``reach``, but not across zero where they have one sign."""
    lower, upper = min(row.lower, value - reach), max(row.upper, value + reach)
    return max(lower, 0.0) if row.lower >= 0 else lower, min(upper, 0.0) if row.upper <= 0 else upper
