"""What many tasks need, such as a model with its trials: read once in each process, however many tasks it does."""

from __future__ import annotations

import hashlib
import pickle
from collections import OrderedDict
from typing import Any, Generic, TypeVar

Value = TypeVar("Value")

KEPT = 4
"""Values that a process keeps."""
_HELD: OrderedDict[str, Any] = OrderedDict()


class Shared(Generic[Value]):
    """A ``value`` that travels with every task and is unpickled by the first of them in each process.

    In the process that made it ``value`` is the same object. It must not be changed by tasks.
    """

    def __init__(self, value: Value) -> None:
        self._own: Value | None = value
        self._data, self._key = b"", ""

    def __getstate__(self) -> dict[str, Any]:
        if not self._key:
            self._data = pickle.dumps(self._own)
            self._key = hashlib.sha256(self._data).hexdigest()
        return {"_data": self._data, "_key": self._key, "_own": None}

    @property
    def value(self) -> Value:
        """The value, made once in this process."""
        if self._own is None:
            if self._key not in _HELD:
                _HELD[self._key] = pickle.loads(self._data)  # of our own tasks, never of files
                while len(_HELD) > KEPT:
                    _HELD.popitem(last=False)
            self._own = _HELD[self._key]
        return self._own
