"""Settings by name: fields of a dataclass are options of a verb, keys of --settings FILE.toml and keywords of Python.

Each field that a user may turn carries in its ``metadata`` the words of its "help" and its limits: "choices", or "gt",
"ge", "lt", "le" of a number or each of several. "option" is the name on the command line where that is not the field's
own, and "alias" another one.
"""

from __future__ import annotations

import functools
import inspect
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, fields
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from mmg.errors import BadValue, UnknownName, by_name, check_kinds, finite, is_several, refusing, unknown, whole

if TYPE_CHECKING:
    from cases.io.toml_file import Section

# Options that went with this version, and what to do instead. The table is emptied with the next one.
_CHOICE = "the Gaussian loss is the default; choose --window or --loss yourself, or compare models with mmg select"
_INSTRUMENTS = "it no longer differs by campaign; choose among gyro, log_scale, or none"
_NOT_BY_CAMPAIGN = "velocity_filter antenna_offset heading_bias wind_sensor_bias fouling draft rudder_offset"

# Field, or field and value -> the sentence.
GONE: dict[str | tuple[str, str], str] = {
    "auto": f"--auto is gone: {_CHOICE}",
    "auto_limit": f"--auto-limit is gone with --auto: {_CHOICE}",
    "try_disturbance": "--try-disturbance is gone: it made no left-out run better; mmg predict --adapt and mmg "
    "diagnose estimate a slowly varying force",
    "horizon": "--horizon is gone: give --window, as long as what is to be predicted; that gains as much",
    "optimizer": "--optimizer is gone: CMA-ES found no lower objective in 20 times as many simulations",
    ("loss", "auto"): "--loss auto is gone: the Gaussian loss is the default; huber and student suit outliers",
    **{("per_campaign", name): f"--per-campaign {name}: is gone: {_INSTRUMENTS}" for name in _NOT_BY_CAMPAIGN.split()},
}

LIMITS = ("gt", "ge", "lt", "le")  # Keys of ``metadata`` that pydantic knows by the same names

F = TypeVar("F", bound=Callable[..., Any])


def settings_of(kind: type) -> dict[str, Field[Any]]:
    """The fields of the dataclass ``kind`` that a user may turn, by name."""
    return {f.name: f for f in fields(kind) if "help" in f.metadata}


def option_of(field: Field[Any]) -> str:
    """The name of a ``field`` on the command line."""
    return str(field.metadata.get("option") or f"--{field.name.replace('_', '-')}")


@functools.cache
def schema_of(kind: type) -> type[Section]:
    """The ``settings_of`` the dataclass ``kind`` as a section of a file, with their types and limits."""
    from pydantic import create_model

    from cases.io.toml_file import Section

    hints, keys = get_type_hints(kind), {}
    for name, field in settings_of(kind).items():
        hint = Literal[field.metadata["choices"]] if "choices" in field.metadata else _hint_in_file(hints[name], field)
        keys[name] = (hint, field.default)
    return create_model(kind.__name__, __base__=Section, **keys)  # type: ignore[call-overload, no-any-return]


def _hint_in_file(hint: Any, field: Field[Any]) -> Any:
    """The type ``hint`` of a ``field``, or of a part of it, as a file may give it, with the limits of the field."""
    from pydantic import AfterValidator
    from pydantic import Field as Key

    parts = tuple(p if p is Ellipsis else _hint_in_file(p, field) for p in get_args(hint))
    if get_origin(hint) in (Union, UnionType):
        return functools.reduce(operator.or_, parts)
    if get_origin(hint) is tuple:  # TOML knows lists only, which strictly are no tuples
        filled = AfterValidator(functools.partial(_filled, field.default))
        return Annotated[tuple[parts], Key(strict=False), filled]  # type: ignore[valid-type]
    limits = {limit: field.metadata[limit] for limit in LIMITS if limit in field.metadata}
    return Annotated[hint, Key(**limits)] if hint in (int, float) else hint


def _filled(default: Any, value: tuple[Any, ...]) -> tuple[Any, ...]:
    """The ``value`` of a field with this ``default``; ValueError where it is empty and the default is not."""
    if default and not value:
        raise ValueError("must not be empty")
    return value


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

    fields_of = settings_of(kind)
    values = checked_settings(kind, read_toml(file), str(file)) if file else {}
    _, problems = checked(schema_of(kind), dict(line))
    if problems:  # "name = value: ..." of a file becomes "--name value: ..." of the line
        name, _, rest = problems[0].strip().partition(" = ")
        raise BadValue(f"{option_of(fields_of[name])} {rest}" if name in fields_of else problems[0])
    return values | dict(line)


def refuse_gone(values: Mapping[str, Any]) -> None:
    """Raises UserError for the first of the ``values`` by name that is gone."""
    for name, value in values.items():
        sentence = GONE.get(name) or (GONE.get((name, value)) if isinstance(value, str) else None)
        if sentence:
            raise UnknownName(sentence)


def refuse_gone_options(arguments: list[str]) -> None:
    """Raises UserError for the first option of the command line ``arguments`` that is gone."""
    for i, argument in enumerate(arguments):
        option, _, value = argument.partition("=")
        if option.startswith("--"):  # --name=value, or the value is the next argument
            following = value or (arguments[i + 1] if i + 1 < len(arguments) else "")
            refuse_gone({option[2:].replace("-", "_"): following})


def keywords(*kinds: type, also: str = "", others: bool = False) -> Callable[[F], F]:
    """A decorator of a function for notebooks: its signature shows the settings that it takes as ``**values``, for
    completions, and a keyword that it does not have or a number that is none is a UserError.

    kinds: dataclasses of whose ``settings_of`` they are; also: further names, separated by spaces, those of numbers
    with a "#" behind, those of True or False with a "?", paths with a "/"; others: whether the function judges further
    ones itself.
    """
    marks = {"#": "float | None", "?": "bool | None", "/": "str | Path | None"}
    names = {name.rstrip("#?/"): marks.get(name[-1], "") for name in also.split()}
    names |= {name: "" for kind in kinds for name in settings_of(kind) if name not in names}

    def shown(function: F) -> F:
        signature = inspect.signature(function)
        written = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        more = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind or Any)
                for name, kind in names.items() if name not in signature.parameters]  # fmt: skip
        full, checked = signature.replace(parameters=[*written, *more]), refusing(function)

        @functools.wraps(function)
        def called(*given: Any, **values: Any) -> Any:
            refuse_gone(values)  # with their own sentence
            for name in values:
                if name not in full.parameters and not others:
                    raise UnknownName(f"{function.__name__}: {unknown('keyword', name, full.parameters)}")
            check_kinds(full.parameters, function.__globals__, given, values)
            for name, value in (*zip(full.parameters, given, strict=False), *values.items()):
                annotation = full.parameters[name].annotation if name in full.parameters else ""
                if annotation == "int" or (annotation == "int | None" and value is not None):
                    whole(name, value, 0)
            return checked(*given, **values)

        called.__signature__ = full  # type: ignore[attr-defined]
        return called  # type: ignore[return-value]

    return shown


def taken(values: dict[str, Any], names: str) -> dict[str, Any]:
    """Those of the keyword arguments ``values`` whose ``names``, separated by spaces, are given, removed from there."""
    given = {name: values.pop(name) for name in names.split() if name in values}
    return {name: value for name, value in given.items() if value is not None}  # None: as if it were not given


def listed(value: Any) -> tuple[str, ...]:
    """Names whose ``value`` is one text or several. Raises UserError for what is none."""
    names = tuple(value) if is_several(value) else (value,)
    for name in names:
        if not isinstance(name, str):
            raise BadValue(f"{value!r}: is no name; give one text, or a list of them")
    return names


def names_of(value: str | Iterable[str] | None) -> list[str]:
    """Names whose ``value`` is one text with commas between them, or several such texts; None: none. Raises UserError
    for what is none."""
    texts = () if value is None else listed(value)
    return [name.strip() for text in texts for name in text.split(",") if name.strip()]


def effects_of(value: Any) -> tuple[str, ...]:
    """Effects as "NAME:key=value", whose ``value`` is one such text or several, or a mapping: name -> values by
    parameter. Raises UserError for what is none."""
    value = by_name(value)
    if not isinstance(value, dict):
        return listed(value)
    texts = []
    for name, given in value.items():
        if not isinstance(parameters := by_name(given), dict):
            raise BadValue(f"{name}: {given!r} is no parameter by name; give such as {{'current': {{'x': 0.1}}}}")
        values = ",".join(f"{key}={finite(f'{name}.{key}', x)!r}" for key, x in parameters.items())
        texts.append(f"{name}:{values}")
    return tuple(texts)
