"""Options that several verbs share, options made from the fields of settings, and the panels of a verb's help."""

from __future__ import annotations

import copy
import functools
import inspect
import re
from collections.abc import Callable
from dataclasses import Field
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import typer.core
from typer import Argument, Option

from mmg.errors import UnknownName
from mmg_ident.commands.output import numbers_of, ship_names
from mmg_ident.settings import given_settings, names_of, option_of, settings_of

Ship = Annotated[
    str, Argument(help="Library ship (mmg ships), ship file or run folder.", metavar="SHIP", autocompletion=ship_names)
]
Run = Annotated[str, Argument(help="Run folder of mmg fit, ship file or library ship.", metavar="RUN")]
Trials = Annotated[list[Path], Argument(help="Trial files, or folders of them.", metavar="TRIAL...")]
Runs = Annotated[list[Path], Argument(help="Run folders of mmg fit or mmg train.", metavar="RUN...")]
RunFolder = Annotated[Path, Option(help="Run folder to write; it must not exist.")]
Validate = Annotated[list[Path] | None, Option(help="Held-out trials to judge by.", metavar="TRIAL...")]
Test = Annotated[list[Path] | None, Option(help="Trials that take no part, to check on.", metavar="TRIAL...")]
Without = Annotated[list[str] | None, Option(help="Leave a component or effect out, such as wind.")]
Campaign = Annotated[str | None, Option(help="Campaign of the trials, where nothing else says it.")]
Resume = Annotated[bool, Option("--resume", help="Go on with an interrupted run in --out.")]
Unchecked = Annotated[
    bool, Option("--unchecked", "--accept-contradictory", help="Take contradictory files and broken stretches too.")
]
NoReport = Annotated[bool, Option("--no-report", help="Draw no figures and write no page.")]
Force = Annotated[bool, Option("--force", help="Overwrite existing files.")]
Json = Annotated[bool, Option("--json", help="Print the result as JSON on stdout.")]
Seed = Annotated[int, Option(help="Seed of all random numbers.")]
Workers = Annotated[int, Option(min=1, help="Processes over which tasks are spread.")]
Scheduler = Annotated[str | None, Option(help="Dask scheduler that does the tasks: tcp://host:8786.")]
Given = dict[str, Any]  # Settings of a verb by name: those on the command line, and those in the file of --settings

T = TypeVar("T")

GENERAL = "Options"  # The panel of options that are in no other one
# Options up to which a panel reads at a glance (by the issue of step 17); a verb with no more has one panel.
MOST = 8  # set by hand
# What the name of a kind of value contains, which differs by the version of typer -> how the help calls it.
VALUES = {"int": "N", "float": "NUMBER", "path": "PATH", "str": "TEXT", "text": "TEXT"}


def _panelled(parameter: inspect.Parameter, panel: str) -> inspect.Parameter:
    """The ``parameter`` of a verb with its option in a ``panel``."""
    kind, info = get_args(parameter.annotation)
    info = copy.copy(info)  # options above are shared by several verbs
    info.rich_help_panel = panel
    return parameter.replace(annotation=Annotated[kind, info])


def _generated(kind: type, name: str) -> inspect.Parameter:
    """The option of a field of the dataclass ``kind``: None where it is not given."""
    field = settings_of(kind)[name]
    hint = get_type_hints(kind)[name]
    plain = next((t for t in (bool, int, float, str) if hint in (t, t | None)), str)  # tuples as text: 1,2,3
    flag = option_of(field)
    names = [
        f"{flag}/--no-{flag[2:]}" if plain is bool else flag,
        *filter(None, [field.metadata.get("alias")]),
    ]  # both, to turn off what the file turns on
    words = str(field.metadata["help"])
    if plain is not bool and field.default not in (None, "", ()) and "default" not in words:
        words = _with_default(words, field.default)
    is_set = field.default is not False  # the help shows the one of two flags that changes something
    option = Annotated[plain | None, Option(*names, help=words, show_default=is_set)]  # type: ignore[valid-type]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=option)


def _from_text(field: Field[Any], value: Any) -> Any:
    """The ``value`` of a ``field`` that the command line gives, of which lists are text."""
    if "count" in field.metadata:
        return numbers_of(value, field.metadata["count"], option_of(field))
    return tuple(names_of(value)) if field.default == () else value


def made(kind: type[T], settings: Given, **more: Any) -> T:
    """A ``kind`` of dataclass of its own fields among the ``settings`` of a verb, and ``more`` of them."""
    return kind(**{name: value for name, value in settings.items() if name in settings_of(kind)}, **more)


def options(*kinds: type, file: bool = True, **panels: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator that puts options of a verb into panels of its help, and makes those that its signature lacks.

    kinds: the dataclasses of which they are fields; the verb takes what is given of them as its argument ``settings``
    (``made``); file: whether --settings takes the other fields of the first one; panels: title -> names of arguments,
    separated by spaces.
    """
    kind_of = {name: kind for kind in kinds for name in settings_of(kind)}  # of a name in two kinds the last one

    def decorated(verb: Callable[..., Any]) -> Callable[..., Any]:
        panel_of = {name: title for title, names in panels.items() for name in names.split()}
        signature = inspect.signature(verb, eval_str=True)  # annotations are texts, of which typer needs the objects
        written = {name: p for name, p in signature.parameters.items() if name != "settings"}
        generated = {name: _generated(kind_of[name], name) for name in panel_of if name not in written}
        if kinds and file:
            rest = ", ".join(name for name in settings_of(kinds[0]) if name not in generated)
            words = "TOML file of settings by name" + (f": the options below, and {rest}." if rest else ".")
            option = Annotated[Path | None, Option(help=words, metavar="FILE")]
            generated["settings"] = inspect.Parameter(
                "settings", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=option
            )
        both = {**written, **generated}
        parameters = {n: p for n, p in both.items() if n not in panel_of}  # in no panel: first, under "Options"
        parameters |= {n: _panelled(both[n], panel) for n, panel in panel_of.items()}

        @functools.wraps(verb)
        def run(*given: Any, **values: Any) -> Any:
            # None: not on the command line, so that a file of --settings or the default counts
            line = {name: value for name in generated if (value := values.pop(name, None)) is not None}
            path, settings = line.pop("settings", None), dict[str, Any]()
            for kind in kinds:
                fields = {name: _from_text(f, line[name]) for name, f in settings_of(kind).items() if name in line}
                settings |= given_settings(kind, fields, path if kind is kinds[0] else None)
            return verb(*given, **values, **({"settings": settings} if kinds else {}))

        # typer reads signature and annotations; by keyword only, as the panels change the order
        shown = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters.values()]
        run.__signature__ = signature.replace(parameters=shown)  # type: ignore[attr-defined]
        run.settings = kinds[0] if kinds else None  # type: ignore[attr-defined]
        run.__annotations__ = {name: p.annotation for name, p in parameters.items()}
        return run

    return decorated


class Verb(typer.core.TyperCommand):
    """A verb whose help shows its options in panels, in plain text."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        try:
            return list(super().parse_args(ctx, args))
        except Exception as error:  # a usage error is known by its attributes, as in ``main``
            option, kind = getattr(error, "option_name", ""), getattr(self.callback, "settings", None)
            name = option.removeprefix("--").removeprefix("no-").replace("-", "_")
            if kind and name in settings_of(kind):  # an option of an earlier version
                raise UnknownName(f"{option} is a key of the file of --settings now: {name} = ...") from None
            raise

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        arguments = [p for p in self.get_params(ctx) if p.param_type_name == "argument"]
        names = [p.metavar or p.name.upper() for p in arguments]
        return ["[OPTIONS]", *(n if p.required else f"[{n}]" for n, p in zip(names, arguments, strict=True))]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        panels: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            if row := _row(parameter, ctx):
                panel = getattr(parameter, "rich_help_panel", None) or GENERAL
                panels.setdefault("Arguments" if parameter.param_type_name == "argument" else panel, []).append(row)
        first = {"Arguments": panels.pop("Arguments")} if "Arguments" in panels else {}
        if sum(map(len, panels.values())) <= MOST:
            panels = {GENERAL: [row for rows in panels.values() for row in rows]}
        for title, rows in {**first, GENERAL: panels.pop(GENERAL, []), **panels}.items():
            with formatter.section(title):
                formatter.write_dl(rows, col_max=26)


def _row(parameter: Any, ctx: Any) -> tuple[str, str] | None:
    """Name and words of an argument or option in the help; None for --help itself, and what is hidden."""
    if parameter.param_type_name == "argument":
        return parameter.metavar or parameter.name.upper(), parameter.help or ""
    record = parameter.get_help_record(ctx)
    if parameter.name == "help" or record is None:
        return None
    words, name = parameter.help or "", parameter.opts[0]
    if parameter.is_flag:  # one of --x/--no-x is enough: the one that changes the default
        opposite = parameter.secondary_opts and parameter.default in (True, None) and parameter.show_default
        return (parameter.secondary_opts[0] if opposite else name), words
    value = re.sub(r"^.*--\S+ ", "", record[0]).strip("<>").replace("FLOAT", "float").replace("INTEGER", "int")
    if parameter.required:
        words += "  [required]"
    elif parameter.default not in (None, "") and "default" not in words.lower():
        words = _with_default(words, parameter.default)
    value = next((short for part, short in VALUES.items() if value.islower() and part in value), value)
    return f"{name} {value}", words


def _with_default(words: str, default: Any) -> str:
    return f"{words.rstrip('.')}; default {f'{default:g}' if isinstance(default, float) else default}."
