"""The errors that users meet: a line that says what is wrong, where, and what to do, and a code; and the
checks of names, keywords and numbers that are given."""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from importlib import import_module
from numbers import Real
from pathlib import PurePath, PureWindowsPath
from typing import Any, TypeVar

from mmg.messages import printable

T = TypeVar("T")

# Most bytes of a name: file systems take 255, and suffixes are added. The limit is that of ext4 and NTFS.
LONGEST_NAME = 200
# What files cannot be called on Windows, whatever follows after a dot.
DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{port}{i}" for port in ("COM", "LPT") for i in range(1, 10))}
WINDOWS = os.name == "nt"

# Most characters of the text of an error; of a longer one the middle is left out.
LONGEST = 4000  # set by hand: fifty lines of a terminal


class UserError(Exception):
    """Bad input or an impossible request.

    The command line prints its text as one line and exits with code 2; the library raises it.
    The text says what is wrong, where (file, column, row, key), and what to do about it; words of a file that would
    steer a terminal or begin another line are shown escaped. Of more than LONGEST characters the middle is left out.
    Subclasses say of which kind the fault is, for programs and tests. problems: the sentences of which it is made,
    where several files have faults; heading: then what comes before them.
    """

    problems: tuple[str, ...] = ()
    heading = ""

    def __init__(self, text: object = "") -> None:
        words = printable(str(text)).replace("\n", "\\n")
        super().__init__(words if len(words) <= LONGEST else f"{words[: LONGEST - 500]} ... {words[-490:]}")

    @property
    def code(self) -> str:
        """The kind of fault: the name of the class in lower case, such as "unknown_name"."""
        return re.sub(r"\B(?=[A-Z])", "_", type(self).__name__).lower()


def together(faults: Sequence[UserError], heading: str) -> UserError:
    """One error of the kind of the first of the ``faults``, with the words ``heading`` before all where there are
    several. Equal sentences are said once."""
    sentences = tuple(dict.fromkeys(map(str, faults)))
    error = type(faults[0])("; ".join(sentences) if len(faults) == 1 else f"{heading}: {'; '.join(sentences)}")
    if len(sentences) > 1:
        error.problems, error.heading = sentences, heading
    return error


class UnknownName(UserError):
    """A name that is none of the choices, which the text lists."""


class BadValue(UserError):
    """A value or file of another form than the one that the text describes."""


class OutOfRange(UserError):
    """A number outside of its bounds."""


class Conflict(UserError):
    """Values, options or files that exclude or contradict each other."""


class Missing(UserError):
    """A file, column, particular or part that is needed."""


class NotInstalled(UserError):
    """A package, compiler or library that is needed."""


class TargetExists(UserError):
    """A target that would be replaced."""


class Unreadable(UserError):
    """A file that cannot be opened, or is damaged."""


class TooFewData(UserError):
    """A file without rows, or trials that are too short, too few or too still for what is asked of them."""


class NoSolution(UserError):
    """A motion that diverges or misses its event, or a balance or search without a result."""


class NotWritable(UserError):
    """A place that cannot be written."""


class Unsupported(UserError):
    """A ship or effect that a format or model cannot hold."""


class NotCalibrated(UserError):
    """A ship that was never calibrated, or whose calibration did not converge."""


class ProgramFailed(UserError):
    """Another program that was called and failed."""


@contextmanager
def writing(what: object, advice: str = "choose another --out") -> Iterator[None]:
    """While it lasts, an error of the system is that of ``what`` is written: UserError, with ``advice``."""
    try:
        yield
    except OSError as error:  # strerror is without the path, which ``what`` names
        raise NotWritable(f"{what}: cannot be written ({error.strerror or error}); {advice}") from None


def reason(error: object, most: int = 120) -> str:
    """What an ``error`` of another library says, in one line of at ``most`` so many characters; else its kind."""
    return " ".join(str(error).split())[:most] or type(error).__name__


def needed(package: str, what: str) -> Any:
    """The ``package`` of the extra "import" that ``what`` needs, imported. Raises UserError where it is missing."""
    try:
        return import_module(package)
    except ImportError:
        name = package.partition(".")[0]
        raise NotInstalled(f"{what} needs {name}; pip install 'mmg-ident[import]'") from None


def needs_torch(what: str) -> None:
    """Raises UserError where torch, which ``what`` needs, is missing or broken."""
    try:
        import torch  # noqa: F401
    except (ImportError, OSError) as error:
        raise NotInstalled(f"{what} needs torch, which cannot be imported ({error}); pip install torch") from None


def name_fault(name: str) -> str:
    """What keeps ``name`` from being the name of a trial, ship or run; "" when it is plain words.

    A name may become that of a file on any system, so it holds no path, no drive, nothing that cannot be printed.
    """
    if PureWindowsPath(name).name != name or name == "..":  # knows / and \\ and drives, on any system
        return "must be plain words, no path: without / and \\"
    if any("\udc80" <= c <= "\udcff" for c in name):  # surrogates that stand for bytes (PEP 383)
        return "holds bytes that are no text in this locale; set PYTHONUTF8=1, or LC_ALL to one with UTF-8"
    if name.partition(".")[0].strip().upper() in DEVICES:
        return "is a device on Windows, where no file can be called so; choose another name"
    if WINDOWS and (bad := sorted(set(name) & set('<>:"|?*'))):
        return f"holds {' '.join(bad)}, which no file name on Windows can; choose another name"
    if not name.isprintable():
        return "must hold characters that can be printed"
    if len(name.encode(errors="replace")) > LONGEST_NAME:
        return f"must have at most {LONGEST_NAME} bytes"
    return ""


def check_name(name: str, where: str) -> None:
    """Raises UserError, which begins with ``where``, unless ``name`` is plain words or empty."""
    if name and (fault := name_fault(name)):
        raise BadValue(f"{where}: name = '{name}': {fault}")


def unknown(what: str, name: str, known: Iterable[str], context: str = "") -> str:
    """The sentence on a ``name`` that is no ``what``: the nearest of those ``known`` (in some ``context``), and all."""
    every = list(known)
    lower = {key.lower(): key for key in every}
    near = "".join(f" did you mean '{lower[key]}'?" for key in get_close_matches(str(name).lower(), lower, 1))
    return f"unknown {what} '{name}';{near} known{context and ' '}{context}: {', '.join(every)}"


def by_name(given: Any) -> Any:
    """``given`` as a dict where it has names, as a mapping, or a Series or DataFrame of pandas has; else as it is, as a
    Series is whose labels are numbers alone."""
    names = list(given.keys()) if hasattr(given, "keys") else []
    named = isinstance(given, Mapping) or any(isinstance(name, str) for name in names)
    return {name: given[name] for name in names} if named else given


def in_order(
    argument: str, given: Any, names: Sequence[str], optional: Sequence[str] = (), left_out: float = 0.0
) -> Any:
    """What is ``given`` by name as a list in the order of ``names``, those ``optional`` that lack as ``left_out``; as
    it is where it has no names. Raises UserError, with the name of the ``argument``, where its names are others."""
    given = by_name(given)
    if not isinstance(given, dict):
        return given
    for name in given:
        if name not in names:
            raise UnknownName(f"{argument}: {unknown('name', str(name), names)}")
    if lacking := [name for name in names if name not in given and name not in optional]:
        raise Missing(f"{argument}: {', '.join(lacking)} missing; give {', '.join(names)}")
    return [given.get(name, left_out) for name in names]


def finite(name: str, value: Any) -> float:
    """The argument ``name`` whose ``value`` is one finite real number. Raises UserError for any other."""
    number = value.item() if getattr(value, "shape", None) == () else value  # an array of no dimension
    if not (isinstance(number, Real) and math.isfinite(number)):
        raise BadValue(f"{name} = {value!r}: is no finite number")
    return float(number)


def whole(name: str, value: Any, least: int, most: float = math.inf) -> int:
    """The argument ``name`` whose ``value`` is a whole number from ``least`` to ``most``. Raises UserError for any
    other."""
    number = finite(name, value)
    if number != int(number) or not least <= number <= most:
        limits = f"of at least {least}" if most == math.inf else f"from {least} to {most:g}"
        raise OutOfRange(f"{name} = {value!r}: must be a whole number {limits}")
    return int(number)


def as_array(argument: str, values: Any, kind: Any = float) -> Any:
    """``values`` as an array of a ``kind``, None: of their own, with NaN where they are masked. Raises UserError, which
    begins with the ``argument``, for what is none, and for complex ones, of which a part would go lost."""
    import numpy as np  # late: most errors are of names

    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(float), math.nan)  # type: ignore[no-untyped-call]
        array = np.asarray(values)
        if np.iscomplexobj(array):
            raise TypeError
        return array if kind is None else np.asarray(array, dtype=kind)
    except (TypeError, ValueError, RuntimeError):  # RuntimeError: of a tensor of torch that requires a gradient
        raise BadValue(f"{argument}: holds what is no number") from None


def is_several(value: Any) -> bool:
    """Whether ``value`` is several things, not text, a mapping or an array without a dimension."""
    return (
        isinstance(value, Iterable)
        and not isinstance(value, (str, bytes, Mapping))
        and getattr(value, "shape", None) != ()
    )


def _is_number(value: Any) -> bool:
    return isinstance(value.item() if getattr(value, "shape", None) == () else value, Real)


def _is_flag(value: Any) -> bool:
    """Whether it is True or False, of numpy too, or a whole number, whose truth is as plain."""
    return isinstance(value, int) or type(value).__name__ in ("bool", "bool_")


# Head of an annotation -> what it asks for in words, and the class or the test of what it takes.
KINDS: dict[str, tuple[str, type | Callable[[Any], bool]]] = {
    "None": ("", type(None)), "Any": ("anything", object), "str": ("text", str), "Path": ("a path", PurePath),
    "bool": ("True or False", _is_flag),
    **dict.fromkeys(("float", "int", "Real"), ("a number", _is_number)),
    **dict.fromkeys(("Mapping", "dict", "Series"), ("a mapping", lambda value: hasattr(value, "keys"))),
    **dict.fromkeys(("Sequence", "Iterable", "tuple", "list"), ("a list", is_several)),
    **dict.fromkeys(("Callable", "OnProgress"), ("a function", callable)),
    "ndarray": ("an array", lambda value: hasattr(value, "__array__")),
}  # fmt: skip


@functools.cache
def _heads(annotation: str) -> list[tuple[str, str]]:
    """Of each alternative of an ``annotation`` the name of its kind, and what stands in its brackets."""
    return re.findall(r"(?:\w+\.)*(\w+)(?:\[((?:[^][]|\[[^][]*\])*)\])?", annotation)


def _fits(value: Any, annotation: str, names: Mapping[str, Any], deep: bool) -> bool:
    """Whether ``value`` is of an ``annotation``, whose classes are looked for in ``names``; ``deep``: and its items
    are, too. What is neither one of KINDS nor a class, as an alias is not, may be anything."""
    for head, inner in _heads(annotation):
        kind = KINDS[head][1] if head in KINDS else names.get(head)
        # by its name where it need not be loaded
        if kind is None and head.endswith(("Settings", "Options", "Axes", "FitResult")):
            matches = head in [c.__name__ for c in type(value).__mro__]
        elif isinstance(kind, type):
            matches = isinstance(value, kind)
        elif head not in KINDS:
            return True
        else:
            matches = kind(value)  # type: ignore[misc]
        if not matches:
            continue
        if not deep or not inner or head == "Callable" or isinstance(value, Iterator):
            return True
        pairs = value.items() if hasattr(value, "items") else [("", item) for item in value]
        of_items = inner.partition(", ")[2] if KINDS.get(head) == KINDS["Mapping"] else inner.removesuffix(", ...")
        if all(isinstance(key, str) and _fits(item, of_items, names, deep) for key, item in pairs):
            return True
    return False


def check_kinds(
    parameters: Mapping[str, inspect.Parameter], names: Mapping[str, Any], given: Sequence[Any],
    values: Mapping[str, Any], deep: bool = False,
) -> None:  # fmt: skip
    """Raises UserError for the first argument of a call that is not of the kind which its annotation asks for.

    parameters: of the function, with annotations as text; names: its globals; given, values: arguments by position and
    by name; deep: whether what lists and mappings hold is looked at.
    """
    others = next((p for p in parameters.values() if p.kind is p.VAR_KEYWORD), None)
    for name, value in (*zip(parameters, given, strict=False), *values.items()):
        parameter = parameters.get(name, others)
        annotation = parameter.annotation if parameter else ""
        if not isinstance(annotation, str) or not annotation or _fits(value, annotation, names, deep):
            continue
        heads = [head for head, _ in _heads(annotation)]
        asked = dict.fromkeys(KINDS[head][0] if head in KINDS else f"a {head}" for head in heads)
        shown = repr(value) if isinstance(value, (str, Real)) and len(repr(value)) < 60 else f"a {type(value).__name__}"
        raise BadValue(f"{name}: must be {' or '.join(words for words in asked if words)}, not {shown}")


def refusing(thing: T) -> T:
    """A decorator of a ``thing``, a function or a class with its constructor and its public methods: a keyword that is
    not among the parameters is a UserError, which names the nearest, and so is an argument of another kind, which it
    names."""
    made: Any = thing
    if not isinstance(thing, type):
        return _refusing(made, made.__name__)  # type: ignore[return-value]
    for name, member in list(vars(thing).items()):
        if name.startswith("_") and name not in ("__init__", "__call__"):
            continue
        if isinstance(member, classmethod):
            setattr(thing, name, classmethod(_refusing(member.__func__, name)))
        elif inspect.isfunction(member):
            setattr(thing, name, _refusing(member, thing.__name__ if name.startswith("_") else name))
    return thing


def _refusing(function: Callable[..., Any], title: str) -> Callable[..., Any]:
    parameters, names = inspect.signature(function).parameters, getattr(function, "__globals__", {})
    is_open = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    seen: set[tuple[str, type]] = set()  # arguments of a constructor and their classes that were fine before

    @functools.wraps(function)
    def called(*given: Any, **values: Any) -> Any:
        try:
            if function.__name__ == "__init__":  # a dataclass takes anything; what is wrong comes up far from here
                arguments = (*zip(parameters, given, strict=False), *values.items())
                if not seen.issuperset((name, type(value)) for name, value in arguments):
                    check_kinds(parameters, names, given, values)
                    seen.update((name, type(value)) for name, value in arguments if not hasattr(value, "shape"))
            return function(*given, **values)
        except UserError:
            raise
        except Exception as error:  # asked afterwards only: a call that succeeds costs nothing more
            strange = [name for name in values if name not in parameters]
            if strange and not is_open:
                known = [name for name in parameters if name != "self"]
                raise UnknownName(f"{title}: {unknown('keyword', strange[0], known)}") from None
            check_kinds(parameters, names, given, values, deep=True)
            if isinstance(error, OSError):  # of the system, such as a name that is too long for it
                raise Unreadable(f"{title}: {reason(error)}") from None
            raise

    return called
