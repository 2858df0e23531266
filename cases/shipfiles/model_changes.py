"""The model of a ship changed before a fit: components left out, effects freed, coefficients fixed."""

from __future__ import annotations

from collections.abc import Sequence

from cases.evidence.kinematics import kinematics_of
from cases.shipfiles.effects import freeing_effects
from cases.trial import Trial
from mmg.effects import EFFECTS, present_name
from mmg.errors import UnknownName
from mmg.ship import Ship


def reduced_ship(
    ship: Ship,
    without: Sequence[str] = (),
    freed: Sequence[str] = (),
    fix: Sequence[str] = (),
    only: Sequence[str] = (),
) -> Ship:
    """The ship with components or effects ``without``, effects ``freed`` ("NAME:held=value,freed"), coefficients fixed.

    fix: symbols of coefficients to fix; only: the only ones left free, beside those of the instruments, which have
    options of their own. Raises UserError for names that the ship does not have.
    """
    ship = ship.without(*without)
    ship = freeing_effects(ship, freed)
    for option, names in (("--fix", fix), ("--only", only)):
        unknown = [name for name in names if name not in ship.coefficients]
        if unknown:
            raise UnknownName(f"{option}: unknown coefficient {', '.join(unknown)}; known: {', '.join(ship.symbols)}")
    if only:
        instruments = tuple(f"{name}." for name in ship.effects if EFFECTS[name].measures)
        ship = ship.fixing([s for s in ship.symbols if s not in only and not s.startswith(instruments)])
    return ship.fixing(fix)


def with_instruments(ship: Ship, names: Sequence[str], trials: Sequence[Trial] = ()) -> Ship:
    """The ship with the effects ``names`` of its instruments freed; those that it has already stay.

    names: or just "none", or just "shown": a velocity filter, unless the trials say that velocities are late by less
    than half a sample, within which neither instrument nor logger is sure of its instant. Fitted along without need it
    made circles of another plant a fifth worse. A satellite delay stands for the velocity filter, which is then not
    added. trials: whose logs say whether velocities are late, and in which axes. Raises UserError for an effect that is
    none of an instrument.
    """
    shown = list(names) == ["shown"]
    names = [] if list(names) == ["none"] else ["velocity_filter"] if shown else [present_name(name) for name in names]
    for name in names:
        if name not in EFFECTS or not EFFECTS[name].measures:
            known = [e for e, effect in EFFECTS.items() if effect.measures]
            words = f"{', '.join(known)}, shown or none"
            raise UnknownName(f"--measurement {name}: no effect of an instrument; known: {words}")
    present = {"velocity_filter"} if "gnss_delay" in ship.effects else set()
    new = [name for name in names if name not in {*ship.effects, *present}]
    seen = kinematics_of(trials, ship) if trials and "velocity_filter" in new else None
    if shown and seen and seen.lag_below(0.5 * min(trial.dt for trial in trials)):
        new = []
    forms = [seen.form_of(name) for name in new] if seen else new
    return freeing_effects(ship, forms)
