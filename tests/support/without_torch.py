"""Where torch is not installed, a test that would import it is skipped instead of failing."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import sys
from types import ModuleType
from typing import Any

import pytest


class Skipping(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds torch, and skips the test, or the file of tests, that loads it."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        """A spec for torch and no other name. path, target: not needed."""
        return importlib.machinery.ModuleSpec(name, self) if name.partition(".")[0] == "torch" else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        """Raises the exception with which pytest skips."""
        pytest.skip("torch is not installed", allow_module_level=True)

    def exec_module(self, module: ModuleType) -> None:
        """Never reached."""


def skip_what_needs_torch() -> None:
    """From now on importing torch skips a test, unless torch is installed."""
    if importlib.util.find_spec("torch") is None:
        sys.meta_path.append(Skipping())
