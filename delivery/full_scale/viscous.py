"""What Froude's law leaves out: friction, wake and rudder inflow at another Reynolds number.

All follow the 1978 ITTC performance prediction method (ITTC 7.5-02-03-01.4), applied to the coefficients of the
manoeuvring model at one speed:
  resistance  C_Ts = (1 + k) (C_Fs - C_Fm) + C_Tm + allowances of the ship
  wake        w_s = (t + 0.04) + (w_m - t - 0.04) [(1 + k) C_Fs + allowances] / [(1 + k) C_Fm], never above w_m
  rudder      1 - w_R = epsilon (1 - w_P0), with w_R scaled as the wake at the propeller; what the race adds, kappa
              epsilon (k_x), is momentum theory and stays
The form factor of a free-running model is not measured. Where none is given, the resistance is the mean of two readings
of the model's own: all of it grows with friction (no waves below Froude number 0.16); or friction with Watanabe's
form factor, and a remainder that stays where there is one. Half their difference is its standard deviation, with
that of a form factor known to 0.05.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.report.sections import component_of
from mmg.components import friction
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

# Froude number [-] up to which wave resistance is left out: within the runs at 0.1 to 0.2 from which Prohaska's method
# (ITTC 7.5-02-02-01) takes the form factor.
WAVELESS = 0.16
RUDDER_WAKE = 0.04  # Part of the wake that a rudder makes and that does not scale (ITTC 7.5-02-03-01.4)
RESISTANCE = ("R_0", "X_0F")  # The coefficient of resistance, as a drag and as a force


@dataclass(frozen=True)
class HullInWater:
    """A hull in water at one speed.

    L, B, d [m]; C_b [-]; speed [m/s]; density [kg/m^3]; roughness [m].
    """

    L: float
    B: float
    d: float
    C_b: float
    speed: float
    density: float
    roughness: float = friction.ROUGHNESS

    @property
    def reynolds(self) -> float:
        """U L / nu [-]."""
        return self.speed * self.L / friction.viscosity(self.density)

    @property
    def froude(self) -> float:
        """U / sqrt(g L) [-]."""
        return self.speed / reference_speed(self.L)

    @property
    def C_F(self) -> float:
        """Friction of a plate by 1/2 rho S U^2 [-]."""
        return friction.friction_line(self.reynolds)

    @property
    def allowance(self) -> float:
        """Roughness and correlation allowances by 1/2 rho S U^2 [-]."""
        return friction.allowance(self.L, self.reynolds, self.roughness)

    @property
    def surface(self) -> float:
        """Wetted surface by L d [-]."""
        return friction.wetted_surface(self.L, self.B, self.d, self.C_b) / (self.L * self.d)

    @property
    def watanabe(self) -> float:
        """Form factor of the regression [-]."""
        return friction.form_factor(self.L, self.B, self.d, self.C_b)


@dataclass(frozen=True)
class Change:
    """From the water of a model to that of the ship. form_factor: k where it is known, None for an estimate."""

    model: HullInWater
    ship: HullInWater
    form_factor: float | None = None

    def resistance(self, R: float) -> float:
        """R_0' [-] of the ship from that of the model, ``R``."""
        total = R / self.model.surface - self.model.allowance  # R_0' is by 1/2 rho L d U^2, friction by the surface
        remainder, friction_alone = self._readings(total)
        kept = remainder
        if self.form_factor is None and self.model.froude <= WAVELESS:
            kept = 0.5 * (remainder + friction_alone)
        return self.ship.surface * (kept + self.ship.allowance)

    def resistance_std(self, R: float) -> float:
        """Standard deviation [-] of ``resistance(R)`` for a known R: the form factor's, and half the allowances."""
        remainder, friction_alone = self._readings(R / self.model.surface - self.model.allowance)
        form = 0.05 * (self.model.C_F - self.ship.C_F)  # of a form factor known to 0.05
        if self.form_factor is None:
            form = math.hypot(form, 0.5 * (remainder - friction_alone))
        return self.ship.surface * math.hypot(form, 0.5 * (self.ship.allowance - self.model.allowance))

    def _readings(self, total: float) -> tuple[float, float]:
        """Resistance of the ship without allowances by 1/2 rho S U^2, from ``total`` of the model: with a form factor
        and a remainder that stays, and all of it by friction. The remainder is not negative unless k was given."""
        k = self.model.watanabe if self.form_factor is None else self.form_factor
        rest, friction_alone = total - (1 + k) * self.model.C_F, total * self.ship.C_F / self.model.C_F
        if rest < 0 and self.form_factor is None:  # the estimated form factor is too large for this resistance
            return friction_alone, friction_alone
        return (1 + k) * self.ship.C_F + rest, friction_alone

    def wake(self, w: float, t: float) -> float:
        """Wake fraction of the ship from that of the model, ``w``; t: thrust deduction [-]."""
        k = self.model.watanabe if self.form_factor is None else self.form_factor
        thick = [(1 + k) * side.C_F + side.allowance for side in (self.ship, self.model)]
        still = min(t + RUDDER_WAKE, w)  # a wake below that part has nothing that friction makes, and stays
        return still + (w - still) * thick[0] / thick[1]

    @property
    def fading(self) -> float:
        """0 at one length, towards 1 for ships of very different size: weight of standard deviations by judgement."""
        # so that a ship at her own length is as well known as before
        return 1 - min(self.model.L, self.ship.L) / max(self.model.L, self.ship.L)


def ship_values(values: Mapping[str, float], change: Change) -> dict[str, float]:
    """The coefficients that change, symbol -> value of the ship, from the ``values`` of the model [-].

    change: of the water. Only symbols that the model has are in it.
    """
    v, scaled_values = values, {}
    for symbol, sign in zip(RESISTANCE, (1.0, -1.0), strict=True):  # R_0' is a drag, X_0F a force ahead
        if symbol in v:
            scaled_values[symbol] = sign * change.resistance(sign * v[symbol])
            if symbol == "X_0F" and "X_0A" in v:
                # astern the same change; at least half of it stays, so that it remains a drag: set by hand
                scaled_values["X_0A"] = min(v["X_0A"] + scaled_values[symbol] - v[symbol], 0.5 * v["X_0A"])
    if "w_P0" not in v:
        if {"a_0", "c_0"} <= v.keys():  # the wake 1 - w = a_0 + a_1 J_s + ... of Kang et al. (2008), 1 - t = c_0 + ...
            scaled_values["a_0"] = 1 - change.wake(1 - v["a_0"], 1 - v["c_0"])
        return scaled_values
    t = v.get("t_P", 0.0)
    w = change.wake(v["w_P0"], t)
    scaled_values["w_P0"] = w
    for symbol in ("tau", "tau_a", "C_P"):  # the change of wake in a drift is a share of the wake
        if symbol in v:  # without a wake it stays
            scaled_values[symbol] = v[symbol] * (w / v["w_P0"] if v["w_P0"] > 0 else 1.0)
    if "epsilon" in v:
        behind = change.wake(1 - v["epsilon"] * (1 - v["w_P0"]), t)  # w_R, as the wake at the propeller
        scaled_values["epsilon"] = (1 - behind) / (1 - w)
        if "kappa" in v:  # kappa epsilon stays
            scaled_values["kappa"] = v["kappa"] * v["epsilon"] / scaled_values["epsilon"]
    return scaled_values


@dataclass(frozen=True)
class Doubt:
    """What scaling leaves open in a coefficient: standard deviation [unit of it], and where it comes from."""

    std: float
    source: str


JUDGEMENT = "judgement: not known from public measurements"
# Coefficients, or groups of them, that similarity keeps: standard deviation by value, and why.
SHARES = {
    "t_P": (0.05, "share of itself: thrust deduction is taken as that of the model (ITTC 7.5-02-03-01.4)"),
    "k_0": (0.02, "share of itself: propeller friction is not corrected, some % for a small model propeller"),
    "gamma": (0.10, f"share of itself: flow straightening is taken as that of the model; {JUDGEMENT}"),
    "k_x": (0.05, f"share of itself: what the race adds is taken as that of the model; {JUDGEMENT}"),
    "ell_R": (0.05, f"share of itself: taken as that of the model; {JUDGEMENT}"),
    "a_H": (0.10, f"share of itself: taken as that of the model; {JUDGEMENT}"),
    "t_R": (0.10, f"share of itself: taken as that of the model; {JUDGEMENT}"),
    "I_J_z": (0.03, "share of itself: the ship is taken to be loaded as the model is ballasted"),
    "hull": (0.05, f"share of itself: hull forces are taken as those of the model; {JUDGEMENT}"),
}


def doubts(ship: Ship, values: Mapping[str, float], scaled: Mapping[str, float], change: Change) -> dict[str, Doubt]:
    """Standard deviations that scaling adds, by symbol.

    ship: the model; values: of its coefficients; scaled: those of the ship that change (``ship_values``); change: of
    the water.
    """
    doubt_of: dict[str, Doubt] = {}
    for symbol in RESISTANCE:
        if symbol in scaled:
            words = "form factor: 0.05, and two readings of the model's resistance; half the allowances"
            if change.form_factor is not None:
                words = "0.05 of the form factor, and half the allowances"
            doubt_of[symbol] = Doubt(change.resistance_std(abs(values[symbol])), words)
    published = "0.03, and a quarter of the change (ITTC's 0.32 for KVLCC2 against the published 0.35)"
    for symbol in sorted({"w_P0", "a_0"} & scaled.keys()):
        # independent: how well a wake is known, and how far the method carries it
        std = math.hypot(0.03 * change.fading, 0.25 * (scaled[symbol] - values[symbol]))
        doubt_of[symbol] = Doubt(std, published)
    if "epsilon" in scaled:
        doubt_of["epsilon"] = _rudder_doubt(values, scaled, change)
    if "kappa" in scaled:
        share, words = SHARES["k_x"]  # what the race adds, under another name
        doubt_of["kappa"] = Doubt(share * change.fading * scaled["kappa"], f"{share:.0%}: {words}")
    part = component_of(ship)
    for symbol in (s for s in ship.symbols if s not in scaled):
        # its own share, that of its group, or that of its force model: "hull"
        key = symbol if symbol in SHARES else "gamma" if symbol.startswith("gamma") else part.get(symbol, "")
        if key in SHARES:
            share, words = SHARES[key]
            doubt_of[symbol] = Doubt(share * change.fading * abs(values[symbol]), f"{share:.0%}: {words}")
    return doubt_of


def _rudder_doubt(values: Mapping[str, float], scaled: Mapping[str, float], change: Change) -> Doubt:
    """That of epsilon: a tenth of it, and half the way to the model's epsilon, which Yasukawa & Yoshimura (2015) keep
    for KVLCC2, as far as the rudder does not see less wake than thrust deduction and rudder make."""
    behind = 1 - values["epsilon"] * (1 - values["w_P0"])
    still = min(behind, values.get("t_P", 0.0) + RUDDER_WAKE)
    kept = min(values["epsilon"], (1 - still) / (1 - scaled["w_P0"]))
    std = math.hypot(0.1 * change.fading * scaled["epsilon"], 0.5 * (kept - scaled["epsilon"]))
    return Doubt(std, f"10 % of itself ({JUDGEMENT}), and half the way to the model's, kept by some")
