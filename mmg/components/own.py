"""Force models and effects that a user registers: where they come from, and how they reach other processes.

A package that brings some names a module of it in the entry points of the group ``mmg_ident.models``; the module is
imported when a name is looked up that is none of the library's, or when all names are listed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, MutableMapping
from functools import cached_property
from importlib.metadata import entry_points
from operator import attrgetter
from pathlib import Path
from typing import Any, ClassVar

from mmg.errors import Conflict, Unsupported
from mmg.messages import LOGGER

GROUP, PLUG_IN = "mmg_ident.models", "the plug-in"  # Entry points, and how the origin of what comes by them begins
loading: list[str] = []  # Empty until plug-ins were asked for; then "", and behind it the one that is being imported


def load_plug_ins() -> None:
    """Import what other packages register, once in a process; one that fails is named in a warning."""
    if loading:
        return
    loading.append("")  # first: a plug-in that looks up a name while it is imported begins no second round
    for entry in entry_points(group=GROUP):
        loading.append(f"{PLUG_IN} {entry.dist.name} {entry.dist.version}" if entry.dist else f"{PLUG_IN} {entry.name}")
        try:
            entry.load()
        except Exception as error:  # a package of others: the library works without it
            LOGGER.warning("%s: its models are missing (%s: %s)", loading[-1], type(error).__name__, error)
        loading.pop()


def origin_of(function: Callable[..., Any]) -> str:
    """Where a registered ``function`` comes from: the plug-in with its version, else its file or module."""
    if loading and loading[-1]:
        return loading[-1]
    code = getattr(function, "__code__", None)
    file = Path(code.co_filename).name if code else ""
    # a cell of a notebook has a number in place of a file
    return file if file.endswith(".py") else "a notebook" if function.__module__ == "__main__" else function.__module__


class Own:
    """A ``function`` of a user, with what is ``stated`` about it: it is one of its kind, and copies are itself."""

    stated: ClassVar[tuple[str, ...]] = ("name", "origin")
    name: str
    origin: str

    def __init__(self, function: Callable[..., Any], **stated: Any) -> None:
        self.function = function
        vars(self).update(stated)

    def __deepcopy__(self, memo: Any) -> Own:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), {key: getattr(self, key) for key in self.stated}, self.packed)

    @property
    def names(self) -> MutableMapping[str, Any]:
        """The models or effects among which its name is; none where nobody looks it up."""
        return {}

    @property
    def place(self) -> tuple[str, str]:
        """Where the function is defined: a cell of a notebook that is run again replaces what it made before."""
        # processes that multiprocessing spawns import the main script under another name
        return self.function.__module__.replace("__mp_main__", "__main__"), self.function.__qualname__

    @cached_property
    def packed(self) -> Callable[..., Any] | bytes:
        """The function for other processes: itself where they can import it, else its code by cloudpickle.

        Raises UserError where neither is possible.
        """
        here = self.function.__module__ == "__main__"
        if not here and self._is_found_by_name:
            return self.function
        try:
            import cloudpickle
        except ImportError:
            if here and hasattr(sys.modules["__main__"], "__file__"):  # a script, which each process reads
                return self.function
            words = f"{self.name}, which is registered in {self.origin}, reaches other processes by cloudpickle alone"
            raise Unsupported(f"{words}: pip install cloudpickle, move it into a file, or use one worker") from None
        data: bytes = cloudpickle.dumps(self.function)
        return data

    @property
    def _is_found_by_name(self) -> bool:
        try:
            return attrgetter(self.function.__qualname__)(sys.modules[self.function.__module__]) is self.function
        except (AttributeError, KeyError):  # a function within another, or of a file that was run
            return False

    def register(self) -> None:
        """Makes it known. Raises UserError where another one has its name."""
        load_plug_ins()
        other = self.names.get(self.name)
        if other is not None and not (isinstance(other, Own) and other.place == self.place):
            whose = f"by {other.origin}" if isinstance(other, Own) else "in the library"
            raise Conflict(f"name: '{self.name}' is taken {whose}; give another, name=...")
        self.names[self.name] = self


def _restored(kind: type[Own], stated: dict[str, Any], packed: Callable[..., Any] | bytes) -> Own:
    """A model that comes from another process of this user, known here from now on."""
    if isinstance(packed, bytes):
        import cloudpickle

        model = kind(cloudpickle.loads(packed), **stated)  # bytes of the tasks of this product, never of files
    else:
        model = kind(packed, **stated)
    registered = model.names.get(model.name)
    if isinstance(registered, Own) and registered.packed == packed:
        return registered  # one object for all ships that come: models are compared by identity
    vars(model)["packed"] = packed  # as it came: packed anew the bytes may differ
    model.names[model.name] = model
    return model
