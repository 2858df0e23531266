"""TOML files that people write (ships, sidecars, sites): read, checked against a schema, refused in one line.

A file is described by a ``Section``. Everything that is wrong with it is said at once, each problem with its table,
key, value and what is allowed. ``model_json_schema()`` of a section prints the schema.
"""

from __future__ import annotations

import copy
import json
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from cases.io.files import decoded, read_bytes
from mmg.errors import BadValue, name_fault, unknown

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib


class Section(BaseModel):
    """A table of a file. Unknown keys, values of another type and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def number(unit: str, default: Any = ..., **limits: float) -> Any:
    """A field of a section that holds a number in ``unit``, with its ``default`` and ``limits`` (ge, gt, le, lt)."""
    return Field(default, json_schema_extra={"unit": unit}, **limits)  # type: ignore[call-overload]


def _plain_words(name: str) -> str:
    if name and (fault := name_fault(name)):
        raise ValueError(fault)
    return name


Name = Annotated[str, AfterValidator(_plain_words)]  # Of a trial or a ship, or "": it may become that of a file
S = TypeVar("S", bound=Section)
ALLOWED = {  # Kind of an error of pydantic -> what is allowed; a unit follows numbers.
    "float_type": "must be a number", "finite_number": "must be a finite number", "string_type": "must be text",
    "bool_type": "must be true or false", "list_type": "must be a list", "tuple_type": "must be a list",
    "missing": "must list more numbers", "too_long": "must list {max_length} at most", "dict_type": "must be a table",
    "model_type": "must be a table", "greater_than": "must be above {gt:g}", "less_than": "must be below {lt:g}",
    "greater_than_equal": "must be at least {ge:g}", "less_than_equal": "must be at most {le:g}",
    "literal_error": "must be {expected}", "value_error": "{error}",
}  # fmt: skip


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of the file at ``path``. Raises UserError when it cannot be read or is no TOML in UTF-8."""
    return parse_toml(decoded(read_bytes(path), path), str(path))


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """The tables in ``text``; ``where`` names the file. Raises UserError when it is not TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadValue(f"{where}: not a valid TOML file ({' '.join(str(error).split())})") from None


def checked(schema: type[S], data: dict[str, Any]) -> tuple[S | None, list[str]]:
    """The content of ``data`` by a ``schema``, and a sentence for each thing that is wrong with it. What is wrong is
    left out of the content, so that the rest can be checked further; None where nothing is left."""
    problems: list[str] = []
    rest = copy.deepcopy(data)
    for _ in range(4):  # a value that is left out may make its table incomplete; 4 levels: set by hand
        try:
            return schema.model_validate(rest), problems
        except ValidationError as error:
            errors = error.errors(include_url=False)
        problems = problems or list(dict.fromkeys(_problem(schema, e) for e in errors))  # later ones follow from these
        for e in errors:
            *parents, last = (e["loc"][:-1] if e["type"] == "missing" else e["loc"]) or ("",)
            table: Any = rest
            for key in parents:
                table = table.get(key, {}) if isinstance(table, dict) else {}
            if isinstance(table, dict):
                table.pop(last, None)
    return None, problems


def validated(schema: type[S], data: dict[str, Any], where: str) -> S:
    """The content of ``data`` by a ``schema``. Raises UserError, naming ``where``, for all that is wrong with it."""
    content, problems = checked(schema, data)
    refuse(where, problems)
    assert content is not None
    return content


def refuse(where: str, problems: Sequence[str]) -> None:
    """Raises UserError, naming ``where``, with all ``problems`` in one line; does nothing when there are none."""
    if problems:
        raise BadValue(f"{where}: {'; '.join(problems)}")


def header(*names: str) -> str:
    """The header of a table, such as [coefficients."current.x"], from the ``names`` that lead to it."""
    return f"[{'.'.join(map(_key, names))}]"


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _problem(schema: type[Section], error: Any) -> str:
    names = [str(name) for name in error["loc"] if not re.fullmatch(r"\[.*\]", str(name))]  # without tags of unions
    section, tables = schema, 0
    while tables < len(names) and (inner := _table(section, names[tables])):
        section, depth = inner
        tables += depth
    table, keys = names[:tables], ".".join(names[tables:])
    place, kind, value = header(*table) if table else "", error["type"], error["input"]
    if kind == "extra_forbidden":
        plain = [key for key, field in section.model_fields.items()
                 if not (_table(section, key) or get_origin(field.annotation) is dict)]  # fmt: skip
        what = "key" if place or plain else "section"
        return f"{place} {unknown(what, names[-1], section.model_fields)}".strip()
    if kind == "missing" and not isinstance(error["loc"][-1], int):  # a key, no number of a list
        known = section.model_fields.get(keys)
        hint = section.__doc__ if not keys else known.description if known else f"write {names[-1]} = ..."
        return f"{place} {keys + ' ' if keys else ''}is missing; {hint}"
    field = section.model_fields.get(names[tables]) if keys else None
    unit = (field.json_schema_extra or {}).get("unit") if field and isinstance(field.json_schema_extra, dict) else None
    allowed = ALLOWED.get(kind, error["msg"]).format(**error.get("ctx", {}))
    allowed = allowed.replace("'", '"') if kind == "literal_error" else allowed
    allowed += f" in {unit}" if unit and kind in ("float_type", "finite_number") else f" {unit}" if unit else ""
    if kind == "value_error" and (not keys or "[key]" in error["loc"]):
        return f"{place} {keys + ': ' if keys else ''}{allowed}".strip()
    if not keys:
        return f"{place[1:-1]} = {shown(value)}: {allowed}, {place}"
    return f"{place} {keys} = {shown(value)}: {allowed}".strip()


def _table(section: type[Section], name: str) -> tuple[type[Section], int] | None:
    """The section that a key of a section holds, and how many names lead to it; None for a plain value."""
    field = section.model_fields.get(name)
    for kind in _kinds(field.annotation) if field else ():
        inner = get_args(kind)[-1] if get_origin(kind) is dict else kind
        if get_origin(inner) is None and isinstance(inner, type) and issubclass(inner, Section):  # list[...] of 3.10
            return inner, 1 + (get_origin(kind) is dict)
    return None


def _kinds(annotation: Any) -> list[Any]:
    """A type, and those of which it is a union."""
    parts = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else ()
    if get_origin(annotation) is Annotated:
        parts = get_args(annotation)[:1]
    return [annotation, *(kind for part in parts for kind in _kinds(part))]


def as_toml(value: Any) -> str:
    """A ``value`` on one line of TOML, numbers to six digits."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {as_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, str | bool):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Sequence):
        return "[" + ", ".join(as_toml(item) for item in value) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def shown(value: object, most: int = 60) -> str:
    """A ``value`` as TOML writes it, cut after ``most`` characters."""
    text = f"{value:.12g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= most else text[: most - 3] + "..."
