"""Ship files: reading, checking and writing them, and the ships that come with the package.

A ship file is TOML: ``[ship]`` particulars (SI), ``[model]`` the force model of each role, and one table
``[coefficients.NAME]`` per coefficient with ``value``, ``std``, ``lower``, ``upper``, ``unit`` or ``prime``, ``fixed``,
``source``, and after a fit ``verdict``, ``prior_value`` and ``prior_std``. ``[calibration]`` says which fit that was;
``[sources]`` where particulars are from that nobody stated; ``[campaigns.NAME]`` holds values that the trials of a
campaign have for themselves. A coefficient that is left out takes the default of its force model; for the wind model
that is the regression on the particulars. A table ``[network]`` holds the learned residual of a hybrid ship
(``network_table``).

A ship as JSON: the tables of a ship file, with unit and words beside every number, bounds that are infinite as null.

``{"format": "mmg ship 1", "ship": {name, description, reference}, "particulars": {L: {value, unit, description}},
"model": {hull: ..., effects: [...]}, "coefficients": {Y_v: {value, unit, prime, ...}}, "inputs": [...], "network":
null or its table}``. ``inputs`` is for the reader alone. What ``prime`` stands for is said under "primes".
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field, create_model

from cases.io.toml_file import Name, Section, checked, header, number, parse_toml, read_toml, refuse
from cases.shipfiles.network_file import (
    NETWORK,
    Bound,
    NetworkTable,
    is_black_box,
    load_network,
    network_of,
    network_table,
    network_text,
)
from cases.shipfiles.particulars import RATES, wrong_particulars
from mmg.components.catalogue import ROLES, coefficient_table, derived, model_names, required_particulars
from mmg.components.coefficients import ENGINE, PARTICULARS, Coefficient
from mmg.components.own import PLUG_IN
from mmg.effects import EFFECTS, GONE, present_name
from mmg.errors import BadValue, OutOfRange, UnknownName, UserError, refusing, unknown
from mmg.messages import Message
from mmg.motion.flow import INPUTS
from mmg.ship import CalibrationMark, Ship

LIBRARY = Path(__file__).parents[1] / "ships"
# Particulars that no force model needs but every ship file may state.
OPTIONAL = ("C_b", "U_0", "y_P", "pitch", *RATES, "scale", "stopping_resistance")


Finite = Annotated[float, Field(allow_inf_nan=False)]
Present = Annotated[str, AfterValidator(present_name)]


class CoefficientEntry(Section):
    """One coefficient: value, prior or standard error (std), bounds, unit or prime, source; more after a fit."""

    value: float = Field(description="give the value that the model uses")
    unit: str = ""
    prime: Literal["", "mmg"] = ""
    std: float | None = Field(None, ge=0)
    lower: Bound | None = None
    upper: Bound | None = None
    fixed: bool = False
    source: str = ""
    description: str = ""
    verdict: str = ""
    prior_value: float | None = None
    prior_std: float | None = Field(None, ge=0)
    monomial: str = ""


class _Words(Section):
    """it holds the particulars, such as L = 3.0"""

    name: Name = ""
    description: str = ""
    reference: str = ""


class _Effects(Section):
    """it names the force model of each role: hull, propeller, rudder, wind"""

    effects: list[Present] = Field(default_factory=list)
    registered: dict[str, str] = Field(default_factory=dict)


def _known_to(role: str) -> AfterValidator:
    """Refuses a force model that ``role`` does not have."""

    def known(name: str) -> str:
        if name not in (names := model_names(role)):
            choices = ", ".join(json.dumps(each) for each in names)
            raise ValueError(f"must be {choices} or one that @mi.force has registered")
        return name

    return AfterValidator(known)


class CalibrationSection(Section):
    """it says which calibration the ship is of: name, date, data, start"""

    name: Name = ""
    date: str = ""
    data: str = ""
    start: str = ""


if TYPE_CHECKING:
    ShipSection = _Words
    ModelSection = _Effects
else:
    _quantities = {name: (float | None, number(unit, None)) for name, (_, unit) in PARTICULARS.items()}
    ShipSection = create_model("ShipSection", __base__=_Words, __doc__=_Words.__doc__, **_quantities)
    _roles = {role: (Annotated[str, _known_to(role)] | None, None) for role in ROLES}
    ModelSection = create_model("ModelSection", __base__=_Effects, __doc__=_Effects.__doc__, **_roles)


class ShipFile(Section):
    """A whole ship file."""

    ship: ShipSection
    model: ModelSection
    coefficients: dict[Present, CoefficientEntry] = Field(default_factory=dict)
    sources: dict[Present, str] = Field(default_factory=dict)
    calibration: CalibrationSection | None = None
    campaigns: dict[Name, dict[Present, Finite]] = Field(default_factory=dict)


def model_table(ship: Ship) -> dict[str, Any]:
    """The table [model] of a ``ship``: force models by role, effects, and where those are from that are no part of the
    library."""
    more = {"effects": list(ship.effects), "registered": {model.name: model.origin for model in ship.own}}
    return {**ship.components, **{key: value for key, value in more.items() if value}}


def library() -> dict[str, Path]:
    """Ships that come with the package: name -> file."""
    return {path.stem: path for path in sorted(LIBRARY.glob("*.toml"))}


@refusing
def load_ship(where: str | Path) -> Ship:
    """The ship ``where``: a library name, a ship file, or a run folder (its ``ship.toml``, and network if it has one).

    Raises UserError when the file is missing, is not TOML, or contradicts itself, or the network is another ship's.
    """
    path, network = library().get(str(where)) or Path(where), None
    if is_black_box(path):
        raise BadValue(f"{where}: is a black box of mmg train, no ship: mmg predict and mmg score take it")
    if path.is_dir():
        path, network = path / "ship.toml", path / NETWORK
    if not path.is_file():
        names = ", ".join(library())
        raise UnknownName(f"{where}: no such ship: give a ship file, a run folder, or one of {names}")
    ship = _ship(read_toml(path), str(path))
    return ship.with_network(load_network(network, ship)) if network and network.exists() else ship


def parse_ship(text: str, where: str = "ship file") -> Ship:
    """The ship in the ``text`` of a ship file; ``where`` names it in messages. Raises UserError, in one line, for all
    that is wrong with it."""
    return _ship(parse_toml(text, where), where)


def _ship(data: dict[str, Any], where: str) -> Ship:
    """The ship in the tables of a file."""
    network = data.get("network")
    ship = _plain_ship({key: value for key, value in data.items() if key != "network"}, where)
    if network is None:
        return ship
    table, problems = checked(NetworkTable, network)
    refuse(where, [f"[network] {sentence}" for sentence in problems])
    assert table is not None
    try:
        return ship.with_network(network_of(table, ship))
    except UserError as error:
        raise type(error)(f"{where}: {error}") from None


def _plain_ship(data: dict[str, Any], where: str) -> Ship:
    """The ship in the tables of a file, without a network."""
    content, problems = checked(ShipFile, data)
    if content is None:
        refuse(where, problems)
    assert content is not None
    chosen = {role: getattr(content.model, role) for role in ROLES}
    components = {role: name for role, name in chosen.items() if name is not None}
    problems += _not_registered(content.model.registered)
    given = {key: getattr(content.ship, key) for key in data["ship"] if key in content.ship.model_fields_set}
    particulars = {key: value for key, value in given.items() if key in PARTICULARS}
    contradictions = _contradictions(data["model"], components, data["ship"], particulars)
    problems += contradictions
    # keys that the schema refused are not among the given ones
    if contradictions or len(given) < len(data["ship"]) or len(content.model.model_fields_set) < len(data["model"]):
        refuse(where, problems)  # what the coefficients can be is not known then
    try:
        table = coefficient_table(components, particulars)
        rows, wrong, further = dict[str, Coefficient](), list[str](), tuple[str, ...]()
        if {"expansion", "azimuth"} & components.keys() or any(c.monomial for c in content.coefficients.values()):
            from cases.shipfiles.generated_ship import optional_particulars  # late: few ships are so

            rows, wrong = generated_terms(content.coefficients, components, table)
            further = optional_particulars(components)
        problems += wrong
        ship = Ship("", particulars, components, {**table, **rows})
    except (ZeroDivisionError, OverflowError):  # of the regressions behind default coefficients
        out_of_proportion = "[ship] the particulars are out of all proportion; check their units (SI)"
        raise OutOfRange(f"{where}: {'; '.join([*problems, out_of_proportion])}") from None
    gone = [name for name in content.model.effects if name in GONE]
    given_rows = {s: c for s, c in content.coefficients.items() if s.partition(".")[0] not in gone}
    for name in dict.fromkeys(e for e in content.model.effects if e not in gone):
        lacking = _lacking(ship, name)
        ship = ship.with_effect(name) if not lacking else ship
        problems += [f"[model] effects: {lacking}"] if lacking else []
    defaults = ship.coefficients
    follows = derived(components, particulars)  # regressions on the particulars: no default that a user should know of
    left_out = [s for s in defaults if s not in given_rows and s not in follows]
    used = (*required_particulars(components), *OPTIONAL, *ENGINE, *further)
    unused = [k for k in particulars if k not in used]
    texts = ((f"not in the ship file, so at the model's default: {', '.join(left_out)}", "model_default", left_out),
             (f"[ship] {', '.join(unused)}: not used by any model", "unused_particular", unused),
             (f"effect {', '.join(gone)} is gone: the ship moves as without it", "effect_gone", gone))  # fmt: skip
    notices = [Message(text, code) for text, code, any_of in texts if any_of]
    changed = {}
    strange = [symbol for symbol in given_rows if symbol not in defaults]
    if len(strange) == 1:  # alone it may be a misspelling, for which the nearest name is said
        problems.append(unknown("coefficient", strange[0], defaults, f"with {_models(components)}"))
    elif strange:
        words = f"unknown coefficients {', '.join(strange)} with {_models(components)}"
        problems.append(f"{words}; remove them, or name the model that has them under [model]")
    for symbol, entry in given_rows.items():
        if symbol in strange:
            continue
        changed[symbol], wrong, repairs = _coefficient(entry, defaults[symbol])
        problems += [f"{header('coefficients', symbol)} {sentence}" for sentence in wrong]
        notices += repairs
    problems += _strange_campaigns(content.campaigns, {**defaults, **changed})
    refuse(where, problems)
    return Ship(
        name=content.ship.name or Path(where).stem, description=content.ship.description,
        particulars=particulars, components=components, coefficients={**defaults, **changed},
        reference=content.ship.reference, notices=tuple(notices), effects=ship.effects,
        mark=CalibrationMark(**vars(content.calibration)) if content.calibration else None,
        campaigns=content.campaigns, sources=content.sources,
    )  # fmt: skip


def generated_terms(
    entries: Mapping[str, CoefficientEntry], components: Mapping[str, str], table: Mapping[str, Coefficient]
) -> tuple[dict[str, Coefficient], list[str]]:
    """Rows for the coefficients among ``entries`` that state a monomial, and sentences on what is wrong with them.
    components: role -> model; table: coefficients of the ship's other models, whose symbols are taken."""
    from mmg.components.expansion.words import parse_monomial  # late: few ships are polynomials

    rows, wrong = {}, []
    for symbol, entry in entries.items():
        if not entry.monomial:
            continue
        where = header("coefficients", symbol)
        try:
            parse_monomial(entry.monomial)
        except ValueError as error:
            wrong.append(f"{where} monomial = '{entry.monomial}': {error}")
            continue
        if "expansion" not in components:
            wrong.append(f'{where} states a monomial, but [model] has no expansion; add expansion = "smooth_submodels"')
        elif symbol in table:
            wrong.append(f"{where} states a monomial, but {symbol} is a coefficient of another model; rename it")
        elif not (symbol[:1] in "XYN" and symbol[1:2] == "_" and symbol.isidentifier()):
            wrong.append(f"{where} states a monomial; its symbol must begin with X_, Y_ or N_, the force it adds to")
        elif entry.std is None:
            wrong.append(f"{where} states a monomial, so give its std as well: there is no default")
        else:
            rows[symbol] = Coefficient(symbol, entry.value, entry.std, monomial=entry.monomial)
    if "expansion" in components and not rows and not wrong:
        wrong.append(
            "[model] expansion: no coefficient states a monomial, so there is no term; generate them (mmg select)"
        )
    return rows, wrong


def _not_registered(origins: Mapping[str, str]) -> list[str]:
    """Sentences on the models of users that a ship was saved with and that are not known here: where they were made."""
    registered = {*EFFECTS, *(name for role in ROLES for name in model_names(role))}
    advice = {True: "install it", False: "register it by @mi.force or @mi.effect before the ship is read"}
    return [
        f"{name} is a model of {origin}: {advice[origin.startswith(PLUG_IN)]}"
        for name, origin in origins.items()
        if name not in registered
    ]


def _strange_campaigns(campaigns: dict[str, dict[str, float]], known: dict[str, Coefficient]) -> list[str]:
    """Sentences on values of ``campaigns`` that are no coefficients of the ship or lie outside their bounds."""
    sentences = []
    for name, values in campaigns.items():
        where = header("campaigns", name)
        for symbol, value in values.items():
            c = known.get(symbol)
            if c is None:
                sentences.append(f"{where} {unknown('coefficient', symbol, known)}")
            elif not c.lower <= value <= c.upper:
                sentences.append(f"{where} {symbol} = {value:g}: outside its bounds [{c.lower:g}, {c.upper:g}]")
    return sentences


def check_needs(ship: Ship, name: str, where: str) -> None:
    """Raises UserError, naming ``where``, when the effect ``name`` does not exist or ``ship`` lacks what it changes."""
    refuse(where, [_lacking(ship, name)] if _lacking(ship, name) else [])


def _lacking(ship: Ship, name: str) -> str:
    """The sentence on an effect that does not exist or lacks the force model it changes; "" when it can be used."""
    if name in GONE:
        return f"effect {name} is gone: leave it out; random forces are told from the ship by mmg diagnose"
    if name not in EFFECTS:
        return unknown("effect", name, sorted(EFFECTS))
    lacking = EFFECTS[name].lacking(ship.components)
    return f"effect {name} needs {lacking}, which {ship.name or 'the ship'} lacks" if lacking else ""


def _models(components: dict[str, str]) -> str:
    return ", ".join(f"{role} {name}" for role, name in components.items())


def _contradictions(
    roles: dict[str, Any], components: dict[str, str], stated: dict[str, Any], particulars: dict[str, float]
) -> list[str]:
    """Sentences on force models and particulars that do not go together. roles, stated: keys of [model] and [ship] as
    they stand in the file; components, particulars: those of them that are right in themselves."""
    sentences = []
    if not set(roles) & set(ROLES):
        sentences.append("[model] names no force model; give at least that of the hull")
    if components.get("hull") == "abkowitz" and {"propeller", "rudder"} & set(roles):
        sentences.append("[model] hull abkowitz holds propeller and rudder already; leave out those roles")
    if "rudder" in roles and "propeller" not in roles:
        sentences.append("[model] has a rudder but no propeller; the rudder model needs its slipstream")
    if particulars.get("y_P", 0.0) > 0 and ("propeller" not in roles or components.get("rudder") == "vectwin"):
        sentences.append(f"[ship] y_P makes two screws with a rudder each; {_models(components)} cannot have them")
    missing = [key for key in required_particulars(components) if key not in stated]
    if missing:
        sentences.append(f"[ship] lacks {', '.join(missing)}, needed by {_models(components)}")
    return sentences + [f"[ship] {sentence}" for sentence in wrong_particulars(particulars)]


def _coefficient(entry: CoefficientEntry, default: Coefficient) -> tuple[Coefficient, list[str], list[Message]]:
    """A coefficient from its table, completed from the default; sentences on what is wrong; notices about repairs."""
    given = {key: value for key, value in entry.model_dump(exclude_unset=True).items() if value is not None}
    c = default.with_(**given)
    if c.upper < c.lower:
        return c, [f"upper = {c.upper:g}: must not lie below lower = {c.lower:g}"], []
    notices, symbol = [], c.symbol
    if not c.lower <= c.value <= c.upper:
        margin = max(abs(c.value), 3 * c.std, 1e-6)  # room for a fit to move in
        repaired = c.with_(lower=min(c.lower, c.value - margin), upper=max(c.upper, c.value + margin))
        text = (
            f"{symbol}: the bounds [{c.lower:g}, {c.upper:g}] exclude their own value {c.value:g}; "
            f"repaired to [{repaired.lower:g}, {repaired.upper:g}]"
        )
        notices, c = [Message(text, "bounds_repaired")], repaired
    if c.std == 0 and not entry.fixed:
        notices.append(Message(f"{symbol}: std = 0 fixes it", "fixed_by_std"))
    return c.with_(fixed=entry.fixed or c.std == 0 or c.lower == c.upper), [], notices


def dump_whole_ship(ship: Ship, comment: str = "") -> str:
    """As ``dump_ship``, with the network of a hybrid ``ship`` in a table of its own. comment: words at the top."""
    text = dump_ship(ship, comment)
    return text if ship.network is None else f"{text.rstrip()}\n\n{network_text(ship.network)}"


def dump_ship(ship: Ship, comment: str = "") -> str:
    """The text of the ship file of ``ship``, under a ``comment``; ``parse_ship`` of it gives back the same ship. Its
    network is left out, as a run folder keeps that in a file of its own."""
    import tomlkit

    document = tomlkit.document()
    for line in comment.splitlines():
        document.add(tomlkit.comment(line).indent(0))
    if comment:
        document.add(tomlkit.nl())
    stated = tomlkit.table()
    for key in ("name", "description", "reference"):
        if key == "name" or getattr(ship, key):
            stated.add(key, getattr(ship, key))
    for key, value in ship.particulars.items():
        number = tomlkit.item(float(value))
        if key in PARTICULARS:  # what it is and its unit, for who edits the file
            number.comment("{} [{}]".format(*PARTICULARS[key])).trivia.comment_ws = "  "
        stated.add(key, number)
    document.add("ship", stated)
    if ship.sources:
        document.add("sources", dict(ship.sources))
    document.add("model", model_table(ship))
    if ship.mark:
        document.add("calibration", dict(vars(ship.mark)))
    document.add("coefficients", {symbol: _entry(c) for symbol, c in ship.coefficients.items()})
    if ship.campaigns:
        own = {name: {s: float(value) for s, value in values.items()} for name, values in ship.campaigns.items()}
        document.add("campaigns", own)
    return document.as_string()


def _entry(c: Coefficient) -> dict[str, Any]:
    """The table of a coefficient: its numbers, and of the rest what is said."""
    given = {key: getattr(c, key) for key in CoefficientEntry.model_fields}
    numbers = {k: float(v) for k, v in given.items() if isinstance(v, float | int) and not isinstance(v, bool)}
    return {key: numbers.get(key, value) for key, value in given.items() if key in numbers or value}


FORMAT = "mmg ship 1"
PRIMES = {
    "mmg": "made dimensionless with 1/2 rho L d U^2 (forces), 1/2 rho L^2 d U^2 (moments), 1/2 rho L^2 d (masses), "
    "1/2 rho L^4 d (moments of inertia), lengths L, v' = v/U, r' = r L/U (Yasukawa & Yoshimura 2015)"
}
CONVENTIONS = (
    "SI and radians. Earth frame x north, y east, psi clockwise; origin midship; a positive rudder turns to starboard; "
    "n in 1/s, positive ahead; std is the standard error of the estimate, before a calibration that of the prior."
)
WIND_INPUTS = {name: f"velocity of the air over ground, to the {name[5:]}" for name in ("wind_north", "wind_east")}


def dump_ship_json(ship: Ship, more: Mapping[str, Any] | None = None) -> str:
    """The text of the JSON of ``ship``. more: further keys for the reader, plain values."""
    words = {"name": ship.name, "description": ship.description, "reference": ship.reference}
    particulars = {}
    for name, value in ship.particulars.items():
        what, unit = PARTICULARS.get(name, ("", ""))
        particulars[name] = {"value": float(value), "unit": unit, "description": what}
    coefficients = {}
    for symbol, c in ship.coefficients.items():
        coefficients[symbol] = {key: _number(getattr(c, key)) for key in CoefficientEntry.model_fields}
    network = network_table(ship.network) if ship.network is not None else None
    if network is not None:
        network |= {key: [_number(x) for x in network[key]] for key in ("lower", "upper")}
    inputs = []
    for name in ship.inputs:
        what, unit = INPUTS.get(name) or ((WIND_INPUTS[name], "m/s") if name in WIND_INPUTS else ("time", "s"))
        inputs.append({"name": name, "unit": unit, "description": what})
    content = {
        "format": FORMAT, "conventions": CONVENTIONS, "primes": PRIMES, "ship": words, "particulars": particulars,
        "model": {**model_table(ship), "effects": list(ship.effects)}, "coefficients": coefficients, "inputs": inputs,
        "calibration": dict(vars(ship.mark)) if ship.mark else None,
        "network": network, **({"campaigns": ship.campaigns} if ship.campaigns else {}),
        **({"sources": dict(ship.sources)} if ship.sources else {}), **(more or {}),
    }  # fmt: skip
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _number(value: Any) -> Any:
    """``value`` as JSON can hold it."""
    return None if isinstance(value, float) and isinf(value) else value


def ship_of(model: Any) -> Ship:
    """The ship of a ``model``. Raises UserError for what is none."""
    if isinstance(model, (str, Path)):
        return load_ship(model)
    ship = model if isinstance(model, Ship) else getattr(model, "ship", None)
    if not isinstance(ship, Ship):
        raise BadValue(f"{type(model).__name__} is no model: give a ship, its name or file, a run folder, or a result")
    return ship
