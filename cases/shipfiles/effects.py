"""The model of a ship changed before a fit: effects from text such as "current:x=0.02,y=-0.01" put on her and freed,
components left out, coefficients fixed, instruments that her trials show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cases.evidence.kinematics import kinematics_of
from cases.quantities import as_number
from cases.shipfiles.ship_file import check_needs
from cases.trial import Trial
from mmg.effects import EFFECTS, Parameter, present_name
from mmg.errors import Conflict, Missing, OutOfRange, UnknownName
from mmg.ship import Ship


def parameters(ship: Ship, name: str) -> tuple[Parameter, ...]:
    """The parameters of the effect ``name`` for a ``ship``."""
    return EFFECTS[name].parameters(ship.namespace, dict(ship.components))


def parse_effect(text: str, ship: Ship, option: str) -> tuple[str, dict[str, float], list[str]]:
    """(name, values by parameter, parameters named without a value) of "NAME:key=value,key".

    text: of the option; ship: for whose size bounds hold; option: names the place in messages. Raises UserError for
    an unknown effect or parameter, a value that is no number or lies outside the parameter's bounds, and a ship
    that lacks what the effect changes.
    """
    name, _, rest = text.strip().partition(":")
    name = present_name(name)
    where = f"{option} {text}"
    check_needs(ship, name, where)
    table = {p.symbol: p for p in parameters(ship, name)}
    values, named = {}, []
    for item in filter(None, (part.strip() for part in rest.split(","))):
        key, equals, word = (part.strip() for part in item.partition("="))
        if key not in table:
            raise UnknownName(f"{where}: {name} has no parameter '{key}'; it has {', '.join(table)} (see mmg effects)")
        if key in values or key in named:
            raise Conflict(f"{where}: {key} is given twice")
        if not equals:
            named.append(key)
            continue
        p, values[key] = table[key], as_number(word)  # NaN lies within no bounds
        if not p.lower <= values[key] <= p.upper:
            wanted = f"must be a number from {p.lower:g} to {p.upper:g} {p.unit}"
            raise OutOfRange(f"{where}: {p.symbol} = {word} {wanted}".rstrip())
    return name, values, named


def with_effects(ship: Ship, texts: Iterable[str]) -> Ship:
    """The ``ship`` with the effects of ``texts`` ("NAME:key=value") switched on. One without values gets its typical
    size. Raises UserError as ``parse_effect`` does, for an effect given twice and a parameter without value."""
    given: set[str] = set()
    for text in texts:
        name, values, named = parse_effect(text, ship, "--effect")
        if name in given:
            raise Conflict(f"--effect {text}: {name} is given twice; write its parameters in one, NAME:a=1,b=2")
        given.add(name)
        if named:
            raise Missing(f"--effect {text}: give {named[0]} a value, such as {name}:{named[0]}=0.1")
        if not values:
            values = {p.symbol: p.neutral + p.typical for p in parameters(ship, name) if not p.held}
        ship = ship.with_effect(name, values)
    return ship


def freeing_effects(ship: Ship, texts: Iterable[str]) -> Ship:
    """The ``ship`` with the effects of ``texts`` to be fitted.

    Parameters free, but held ones only if named without value. Raises UserError as ``parse_effect`` does. A value is
    what a free parameter's prior is centred on, and what a held one is held at.
    """
    for text in texts:
        name, values, named = parse_effect(text, ship, "--with")
        ship = ship.with_effect(name, values)
        for p in parameters(ship, name):
            row = ship.coefficients[f"{name}.{p.symbol}"].with_(fixed=p.held and p.symbol not in named)
            # of the prior, not of an earlier fit
            row = row.with_(std=p.coefficient(name).std) if p.symbol in values else row
            ship = ship.with_coefficients({row.symbol: row})
    return ship


# Effects of ship and instruments that differ from day to day, as those of the surroundings do.
VARIES = ("rudder_offset", "heading_bias", "log_scale", "fouling", "draft")


def varies(name: str) -> bool:
    """Whether each run may have its own constants of the effect ``name``."""
    return name in VARIES or EFFECTS[name].surroundings


def varying_effects(ship: Ship, texts: Iterable[str]) -> tuple[Ship, tuple[str, ...]]:
    """The ``ship`` with the effects of ``texts``, of which each run gets its own constants, and the symbols of those.

    "NAME" takes the parameters that are not held, "NAME:a,b" those named; a value is what the prior of a constant is
    centred on (its standard deviation is the typical size), or where another parameter stays. All are fixed in the
    ship, which does not have them: they belong to the runs. Raises UserError for an effect that is in the model
    already or cannot differ by run.
    """
    constants: list[str] = []
    for text in texts:
        name, values, named = parse_effect(text, ship, "--per-run")
        where = f"--per-run {text}"
        if name in ship.effects:
            raise Conflict(
                f"{where}: {name} is in the model already; name it once, in --with, --measurement or --per-run"
            )
        if not varies(name):
            known = ", ".join(e for e in EFFECTS if varies(e))
            raise UnknownName(
                f"{where}: {name} belongs to the ship, use --with {name}; each run may have its own {known}"
            )
        ship = ship.with_effect(name, values)
        rows = {}
        for p in parameters(ship, name):
            symbol = f"{name}.{p.symbol}"
            rows[symbol] = ship.coefficients[symbol].with_(std=abs(p.typical), fixed=True)
            if (p.symbol in named) if named else not p.held:
                constants.append(symbol)
        ship = ship.with_coefficients(rows)
    return ship, tuple(constants)


def calm_and_deep(ship: Ship) -> tuple[Ship, list[str]]:
    """The ``ship`` without effects of its surroundings and of its instruments, and the names of those."""
    left_out = [e for e in ship.effects if EFFECTS[e].surroundings or EFFECTS[e].measures]
    for name in left_out:
        ship = ship.without_effect(name)
    return ship, left_out


# What the source of a parameter says that a calibration freed by itself.
SUSPECT = "the trials speak for it, put in by mmg fit"


def with_suspects(ship: Ship, symbols: Iterable[str]) -> Ship:
    """The ``ship`` with nuisance parameters that her trials speak for, which a diagnosis judges anew. symbols: of
    parameters of effects that she lacks, such as "current.x"; they are free, and SUSPECT is their source."""
    chosen = tuple(symbols)
    for name in dict.fromkeys(s.partition(".")[0] for s in chosen):
        ship = ship.with_effect(name)
        symbols_of_effect = (f"{name}.{p.symbol}" for p in parameters(ship, name))
        rows = {s: ship.coefficients[s].with_(fixed=s not in chosen, source=SUSPECT) for s in symbols_of_effect}
        ship = ship.with_coefficients(rows)
    return ship


def suspects_in(ship: Ship) -> tuple[str, ...]:
    """Symbols of the free parameters that ``with_suspects`` put into the ``ship``."""
    return tuple(s for s in ship.free if SUSPECT in ship.coefficients[s].source)


def without_suspects(ship: Ship, surroundings_only: bool = False) -> Ship:
    """The ``ship`` without the effects that ``with_suspects`` put in; surroundings_only: faults of her instruments
    stay."""
    for name in dict.fromkeys(s.partition(".")[0] for s in suspects_in(ship)):
        if EFFECTS[name].surroundings or not surroundings_only:
            ship = ship.without_effect(name)
    return ship


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
