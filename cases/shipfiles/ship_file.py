"""Ship files: reading, checking and writing them, and the ships that come with the package.

A ship file is TOML: ``[ship]`` particulars (SI), ``[model]`` the force model of each role, and one table
``[coefficients.NAME]`` per coefficient with ``value``, ``std``, ``lower``, ``upper``, ``unit`` or ``prime``, ``fixed``,
``source``, and after a fit ``verdict``, ``prior_value`` and ``prior_std``. A coefficient that is left out takes the
default of its force model; for the wind model that is the regression on the particulars.
"""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

from cases.shipfiles.network_file import NETWORK, is_black_box, load_network
from cases.shipfiles.particulars import check_particulars
from mmg.components.catalogue import ROLES, coefficient_table, derived, module, required_particulars
from mmg.components.coefficients import Coefficient
from mmg.components.particulars import PARTICULARS
from mmg.effects import EFFECTS
from mmg.errors import UserError
from mmg.ship import Ship

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

LIBRARY = Path(__file__).parents[1] / "ships"
_KEYS = {f for f in Coefficient.__dataclass_fields__ if f != "symbol"}
OPTIONAL = ("C_b", "U_0", "y_P", "pitch", "rudder_rate", "scale")
"""Particulars that no force model needs but every ship file may state."""
_WORDS = ("name", "description", "reference")


def library() -> dict[str, Path]:
    """Ships that come with the package: name -> file."""
    return {path.stem: path for path in sorted(LIBRARY.glob("*.toml"))}


def load_ship(where: str | Path) -> Ship:
    """A ship by library name, from a ship file, or from a run folder: its ``ship.toml`` and network, if it has one.

    Raises UserError when the file is missing, is not TOML, or contradicts itself, or the network is another ship's.
    """
    path, network = library().get(str(where)) or Path(where), None
    if is_black_box(path):
        raise UserError(f"{where}: is a black box of mmg train, no ship: mmg predict and mmg score take it")
    if path.is_dir():
        path, network = path / "ship.toml", path / NETWORK
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        names = ", ".join(library())
        raise UserError(f"{where}: no such ship: give a ship file, a run folder, or one of {names}") from None
    ship = parse_ship(text, str(path))
    return ship.with_network(load_network(network, ship)) if network and network.exists() else ship


def parse_ship(text: str, where: str = "ship file") -> Ship:
    """A ship from the text of a ship file; ``where`` names it in messages."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{where}: not a valid TOML file: {error}") from None
    for key in data:
        if key not in ("ship", "model", "coefficients"):
            raise UserError(f"{where}: unknown table [{key}]; known: [ship], [model], [coefficients.NAME]")
    components, effects = _components(data.get("model"), where)
    ship = data.get("ship")
    if not isinstance(ship, dict):
        raise UserError(f"{where}: table [ship] with the particulars is missing")
    particulars = _particulars(ship, components, where)
    try:
        defaults = coefficient_table(components, particulars)
    except (ZeroDivisionError, OverflowError):
        raise UserError(f"{where}: [ship] the particulars are out of all proportion; check their units (SI)") from None
    bare = Ship("", particulars, components, defaults)
    for name in effects:
        check_needs(bare, name, f"{where}: [model] effects")
        bare = bare.with_effect(name)
    defaults = dict(bare.coefficients)
    given = data.get("coefficients", {})
    if not isinstance(given, dict):
        raise UserError(f"{where}: [coefficients] must hold one table per coefficient")
    coefficients = dict(defaults)
    left_out = [s for s in defaults if s not in given and s not in derived(components, particulars)]
    notices = [f"not in the ship file, so at the model's default: {', '.join(left_out)}"] if left_out else []
    unknown = [k for k in particulars if k not in (*required_particulars(components), *OPTIONAL)]
    notices += [f"[ship] {', '.join(unknown)}: not used by any model"] if unknown else []
    for symbol, entry in given.items():
        if symbol not in defaults:
            raise UserError(
                f"{where}: unknown coefficient {symbol!r} for {_models(components)}; known: {', '.join(defaults)}"
            )
        coefficients[symbol], notice = _coefficient(symbol, entry, defaults[symbol], where)
        notices += notice
    return Ship(
        name=str(ship.get("name", Path(where).stem)),
        particulars=particulars,
        components=components,
        coefficients=coefficients,
        description=str(ship.get("description", "")),
        reference=str(ship.get("reference", "")),
        notices=tuple(notices),
        effects=bare.effects,
    )


def check_needs(ship: Ship, name: str, where: str) -> None:
    """Raises UserError for an effect that does not exist or lacks the force model it changes."""
    if name not in EFFECTS:
        raise UserError(f"{where}: unknown effect '{name}'; known: {', '.join(sorted(EFFECTS))}")
    missing = [role for role in EFFECTS[name].needs if role not in ship.components]
    if missing:
        raise UserError(f"{where}: effect {name} needs a {missing[0]} model, which {ship.name or 'the ship'} lacks")


def _models(components: dict[str, str]) -> str:
    return ", ".join(f"{role} {name}" for role, name in components.items())


def _components(model: Any, where: str) -> tuple[dict[str, str], list[str]]:
    """Force models by role, and the names of effects."""
    if not isinstance(model, dict) or not model:
        raise UserError(f"{where}: table [model] is missing; it names the force model of hull, propeller, rudder, wind")
    effects = model.get("effects", [])
    if not isinstance(effects, list) or not all(isinstance(name, str) for name in effects):
        raise UserError(f'{where}: [model] effects must be a list of names, such as ["current"]')
    model = {role: name for role, name in model.items() if role != "effects"}
    for role, name in model.items():
        try:
            module(role, str(name))
        except KeyError as error:
            raise UserError(f"{where}: [model] {error.args[0]}") from None
    if model.get("hull") == "abkowitz" and {"propeller", "rudder"} & set(model):
        raise UserError(f"{where}: [model] hull abkowitz holds propeller and rudder already; leave out those roles")
    if "rudder" in model and "propeller" not in model:
        raise UserError(f"{where}: [model] has a rudder but no propeller; the rudder model needs its slipstream")
    return {role: str(model[role]) for role in ROLES if role in model}, list(dict.fromkeys(effects))


def _particulars(ship: dict[str, Any], components: dict[str, str], where: str) -> dict[str, float]:
    particulars = {}
    for key, value in ship.items():
        if key in _WORDS:
            continue
        if not re.fullmatch(r"[A-Za-z0-9_-]+", key):
            raise UserError(f"{where}: [ship] key {key!r} must be letters, digits and underscores")
        number = _number(ship, key, None, f"{where}: [ship]")
        if number is None or not math.isfinite(number):
            raise UserError(f"{where}: [ship] {key} = {value!r} is not a finite number")
        particulars[key] = number
    if particulars.get("y_P", 0.0) > 0 and ("propeller" not in components or components.get("rudder") == "vectwin"):
        raise UserError(
            f"{where}: [ship] y_P makes two screws with a rudder each; {_models(components)} cannot have them"
        )
    missing = [key for key in required_particulars(components) if key not in particulars]
    if missing:
        raise UserError(f"{where}: [ship] lacks {', '.join(missing)}, needed by {_models(components)}")
    check_particulars(particulars, f"{where}: [ship]")
    return particulars


def _number(entry: dict[str, Any], key: str, default: float | None, where: str) -> float | None:
    value = entry.get(key, default)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        raise UserError(f"{where}: {key} = {value!r} is not a number")
    try:
        return float(value)
    except OverflowError:
        raise UserError(f"{where}: {key} is too large a number") from None


def _coefficient(symbol: str, entry: Any, default: Coefficient, where: str) -> tuple[Coefficient, list[str]]:
    """A coefficient from its table, completed from the default, and notices about repairs."""
    place = f"{where}: [coefficients.{symbol}]"
    if not isinstance(entry, dict):
        raise UserError(f"{place} must be a table with at least a value")
    for key in entry:
        if key not in _KEYS:
            raise UserError(f"{place} has an unknown key {key!r}; known: {', '.join(sorted(_KEYS))}")
    if "value" not in entry:
        raise UserError(f"{place} has no value")
    value = _number(entry, "value", None, place)
    assert value is not None
    if not math.isfinite(value):
        raise UserError(f"{place}: value = {value} is not finite")
    lower, upper = _number(entry, "lower", default.lower, place), _number(entry, "upper", default.upper, place)
    std = _number(entry, "std", default.std, place)
    assert lower is not None and upper is not None and std is not None
    if upper < lower:
        raise UserError(f"{place}: upper bound {upper:g} lies below lower bound {lower:g}")
    if std < 0:
        raise UserError(f"{place}: std = {std:g} is negative")
    notices = []
    if not lower <= value <= upper:
        margin = max(abs(value), 3 * std, 1e-6)
        repaired = (min(lower, value - margin), max(upper, value + margin))
        notices.append(
            f"{symbol}: the bounds [{lower:g}, {upper:g}] exclude their own value {value:g}; "
            f"repaired to [{repaired[0]:g}, {repaired[1]:g}]"
        )
        lower, upper = repaired
    if entry.get("prime", "") not in ("", "mmg"):
        raise UserError(f'{place}: prime = {entry["prime"]!r} is unknown; use "mmg" or leave it out')
    if std == 0 and not entry.get("fixed", False):
        notices.append(f"{symbol}: std = 0 fixes it")
    fixed = entry.get("fixed", False)
    if not isinstance(fixed, bool):
        raise UserError(f"{place}: fixed = {fixed!r} must be true or false")
    return default.with_(
        value=value,
        std=std,
        lower=lower,
        upper=upper,
        fixed=fixed or std == 0 or lower == upper,
        unit=str(entry.get("unit", default.unit)),
        prime=str(entry.get("prime", default.prime)),
        source=str(entry.get("source", default.source)),
        description=str(entry.get("description", default.description)),
        verdict=str(entry.get("verdict", "")),
        prior_value=_number(entry, "prior_value", None, place),
        prior_std=_number(entry, "prior_std", None, place),
    ), notices


def dump_ship(ship: Ship, comment: str = "") -> str:
    """The text of a ship file; ``parse_ship`` of it gives the same ship back, to the last digit."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()] + ([""] if comment else [])
    lines += ["[ship]", f"name = {_text(ship.name)}"]
    lines += [f"{key} = {_text(getattr(ship, key))}" for key in ("description", "reference") if getattr(ship, key)]
    lines += [f"{key} = {_float(value)}{_remark(key)}" for key, value in ship.particulars.items()]
    lines += ["", "[model]"] + [f"{role} = {_text(name)}" for role, name in ship.components.items()]
    lines += [f"effects = [{', '.join(_text(name) for name in ship.effects)}]"] if ship.effects else []
    for symbol, c in ship.coefficients.items():
        key = _text(symbol) if "." in symbol else symbol
        lines += ["", f"[coefficients.{key}]", f"value = {_float(c.value)}"]
        lines += [f"unit = {_text(c.unit)}"] if c.unit else []
        lines += [f"prime = {_text(c.prime)}"] if c.prime else []
        lines += [f"std = {_float(c.std)}", f"lower = {_float(c.lower)}", f"upper = {_float(c.upper)}"]
        lines += ["fixed = true"] if c.fixed else []
        for key in ("source", "description", "verdict"):
            lines += [f"{key} = {_text(getattr(c, key))}"] if getattr(c, key) else []
        for key in ("prior_value", "prior_std"):
            number = getattr(c, key)
            lines += [f"{key} = {_float(number)}"] if number is not None else []
    return "\n".join(lines) + "\n"


def _remark(particular: str) -> str:
    """A comment with meaning and unit of a particular."""
    words, unit = PARTICULARS.get(particular, ("", ""))
    return f"  # {words} [{unit}]" if words else ""


def _float(value: float) -> str:
    return repr(float(value))


def _text(words: str) -> str:
    """A TOML basic string: JSON's escapes are TOML's, but for DEL."""
    return json.dumps(words, ensure_ascii=False).replace("\x7f", "\\u007f")


__all__ = ["dump_ship", "library", "load_ship", "parse_ship"]
