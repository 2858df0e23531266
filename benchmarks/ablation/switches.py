"""Switches that the product does not have: its functions and constants replaced by name, from outside."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, partial, wraps
from hashlib import blake2b
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np

PACKAGES = ("mmg", "cases", "fitting", "diagnosis")
"""Packages in which a name is replaced wherever it was imported."""
MISSING = object()


@dataclass(frozen=True)
class Switch:
    """A mechanism that can be switched off.

    name: of its row; off: what its row says; replaced: "module:name" or "module:Class.name" -> what stands there
    instead, a function that is to be called being given as it is; settings, options: fields of ``Settings`` and
    ``FitOptions`` (of a calibration); inside: names of memoised functions that the switch changes from within (of a
    diagnosis, see ``Memo``).
    """

    name: str
    off: str
    replaced: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    inside: tuple[str, ...] = ()


@cache
def modules() -> tuple[ModuleType, ...]:
    """All modules of PACKAGES, imported: one that is imported later would keep what stands there meanwhile."""
    for name in PACKAGES:
        package = importlib.import_module(name)
        for found in pkgutil.walk_packages(package.__path__, f"{name}."):
            importlib.import_module(found.name)
    return tuple(m for name, m in sorted(sys.modules.items()) if m and name.partition(".")[0] in PACKAGES)


def place_of(target: str) -> tuple[Any, str, Any]:
    """Owner, attribute and present value of a ``target``, "module:name" or "module:Class.name". Raises KeyError where
    there is none."""
    module, _, path = target.partition(":")
    try:
        owner: Any = importlib.import_module(module)
    except ModuleNotFoundError:
        raise KeyError(target) from None
    *outer, name = path.split(".")
    for part in outer:
        owner = getattr(owner, part, MISSING)
    value = getattr(owner, name, MISSING)
    if value is MISSING:
        raise KeyError(target)
    return owner, name, value


@contextmanager
def replaced(changes: Mapping[str, Any]) -> Iterator[None]:
    """While it lasts, each target of ``changes`` has its value there, wherever it was imported under its name."""
    with ExitStack() as stack:
        for target, value in changes.items():
            owner, name, present = place_of(target)
            owners = modules() if isinstance(owner, ModuleType) else ()
            for one in (owner, *(m for m in owners if m is not owner and vars(m).get(name, MISSING) is present)):
                stack.enter_context(mock.patch.object(one, name, value))
        yield


def constantly(value: Any) -> Callable[..., Any]:
    """A function of anything that gives ``value``."""
    return lambda *_, **__: value


class Memo:
    """Results of functions by the content of their arguments: a decision is replayed without the work behind it.

    A function that a switch changes from within has results of its own for that switch (``inside``).
    """

    def __init__(self) -> None:
        self.results: dict[bytes, tuple[bool, Any]] = {}
        self.kept: dict[int, tuple[Any, bytes]] = {}
        self.switch: Switch | None = None

    def of(self, target: str) -> Callable[..., Any]:
        """The function ``target`` with its results kept; what it raises is kept, too."""
        _, name, function = place_of(target)

        @wraps(function)
        def remembered(*args: Any, **kwargs: Any) -> Any:
            own = self.switch.name if self.switch and name in self.switch.inside else ""
            key = self.mark((target, own, args, kwargs))
            if key not in self.results:
                try:
                    self.results[key] = True, function(*args, **kwargs)
                except Exception as error:
                    self.results[key] = False, error
            good, result = self.results[key]
            if good:
                return result
            raise result

        return remembered

    def mark(self, value: Any) -> bytes:
        """A digest of a ``value``; an object of unknown kind counts as itself."""
        if value is None or isinstance(value, (bool, int, float, complex, str, bytes, np.generic)):
            return _digest(repr(value).encode())
        if isinstance(value, (tuple, list)):
            return _digest(type(value).__name__.encode(), *map(self.mark, value))
        if isinstance(value, (set, frozenset)):
            return _digest(b"set", *sorted(map(self.mark, value)))
        if isinstance(value, Mapping):
            return _digest(b"map", *sorted(self.mark(k) + self.mark(v) for k, v in value.items()))
        if isinstance(value, partial):
            return _digest(b"partial", self.mark((value.func, value.args, value.keywords)))
        known = self.kept.get(id(value))
        if known is None:
            known = self.kept[id(value)] = value, self._content(value)
        return known[1]

    def _content(self, value: Any) -> bytes:
        """``mark`` of an array, a dataclass or another object, which is kept so that no other takes its number."""
        if isinstance(value, np.ndarray):
            return _digest(str((value.dtype, value.shape)).encode(), np.ascontiguousarray(value).tobytes())
        if is_dataclass(value) and not isinstance(value, type):
            parts = [self.mark(getattr(value, f.name)) for f in fields(value) if f.compare or f.name == "meta"]
            return _digest(type(value).__name__.encode(), *parts)
        return _digest(b"itself", str(id(value)).encode())


def _digest(*parts: bytes) -> bytes:
    found = blake2b(digest_size=16)
    for part in parts:
        found.update(part)
    return found.digest()
