"""Settings by name: fields of a dataclass are options of a verb, keys of --settings FILE.toml and keywords of Python.

Each field that a user may turn carries in its ``metadata`` the words of its "help" and its limits ("gt", "ge", "lt",
"le", or "choices"); "option" is the name on the command line where that is not the field's own.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import Field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_type_hints

from mmg.errors import BadValue
from mmg_ident.gone import refuse_gone

if TYPE_CHECKING:
    from cases.io.toml_file import Section

LIMITS = ("gt", "ge", "lt", "le")


def settings_of(kind: type) -> dict[str, Field[Any]]:
    """The fields of the dataclass ``kind`` that a user may turn, by name."""
    return {f.name: f for f in fields(kind) if "help" in f.metadata}


def option_of(field: Field[Any]) -> str:
    """The name of a ``field`` on the command line."""
    return str(field.metadata.get("option") or f"--{field.name.replace('_', '-')}")


@functools.cache
def schema_of(kind: type) -> type[Section]:
    """The ``settings_of`` the dataclass ``kind`` as a section of a file, with their types and limits."""
    from pydantic import Field as Key
    from pydantic import create_model

    from cases.io.toml_file import Section

    hints, keys = get_type_hints(kind), {}
    for name, field in settings_of(kind).items():
        limits = {limit: field.metadata[limit] for limit in LIMITS if limit in field.metadata}
        hint = Literal[field.metadata["choices"]] if "choices" in field.metadata else hints[name]
        strict = None if "tuple" not in str(hint) else False  # TOML knows lists only
        keys[name] = (hint, Key(field.default, strict=strict, **limits))
    return create_model(kind.__name__, __base__=Section, **keys)  # type: ignore[call-overload, no-any-return]


def checked_settings(kind: type, values: Mapping[str, Any], where: str = "settings") -> dict[str, Any]:
    """The ``values`` by name of ``settings_of`` the dataclass ``kind``. Raises UserError, which begins with ``where``,
    for an unknown name, a value of another type or outside its limits, and a name that is gone."""
    from cases.io.toml_file import validated

    refuse_gone(values)
    return validated(schema_of(kind), dict(values), where).model_dump(exclude_unset=True)


def check_settings(settings: Any) -> None:
    """Raises UserError where the values of ``settings``, an instance of a dataclass, lie outside their limits."""
    values = {name: getattr(settings, name) for name in settings_of(type(settings))}
    checked_settings(type(settings), values, type(settings).__name__)


def given_settings(kind: type, line: Mapping[str, Any], file: Path | None) -> dict[str, Any]:
    """What the options of a command ``line`` and a settings ``file`` say of the fields of ``kind``; the line wins.

    Raises UserError for what ``checked_settings`` refuses.
    """
    from cases.io.toml_file import checked, read_toml

    known = settings_of(kind)
    values = checked_settings(kind, read_toml(file), str(file)) if file else {}
    _, problems = checked(schema_of(kind), dict(line))
    if problems:
        name, _, rest = problems[0].strip().partition(" = ")
        raise BadValue(f"{option_of(known[name])} {rest}" if name in known else problems[0])
    return values | dict(line)
