"""An exported ship compiled and called from Python, shared by the tests of delivery/."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from delivery.c.source import c_files
from delivery.product import Product, product_of
from mmg.ship import Ship

STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion")
COMPILERS = {
    "gcc, C": ("gcc", "-std=c99"),
    "clang, C": ("clang", "-std=c99"),
    "gcc, C++": ("g++", "-std=c++11", "-x", "c++"),
    "clang, C++": ("clang++", "-std=c++11", "-x", "c++"),
}
HELD = {"u": (0.1, 0.9), "v": (-0.2, 0.2), "r": (-0.1, 0.1), "beta": (-0.4, 0.4)}


def product(ship: Ship | str, held: dict[str, tuple[float, float]] | None = None) -> Product:
    """A product of a ship as if the trials had held the range ``held``."""
    found = load_ship(ship) if isinstance(ship, str) else ship
    return Product(
        found,
        found.name.replace("-", "_") or "ship",
        HELD if held is None else held,
        {"source": "test", "kind": "test"},
        (),
    )


def library_product(name: str) -> Product:
    """The product of a ship of the library, by force."""
    return product_of(name, force=True)


def compiler(which: str) -> Sequence[str]:
    """The command of a compiler; the test is skipped where it is missing."""
    command = COMPILERS[which]
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is missing")
    return command


def write_files(of: Product, folder: Path) -> Path:
    """Header and source in ``folder``; returns the path of the source."""
    for name, text in c_files(of).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder / f"{of.identifier}.c"


@dataclass
class Compiled:
    """A compiled ship: its functions on numpy arrays."""

    of: Product
    library: ctypes.CDLL
    real: Any
    model: Any

    def _call(self, name: str, *given: Any, shapes: Sequence[Any] = ()) -> tuple[int, list[np.ndarray]]:
        """What a function returns, and its arrays: those ``given``, and those of these ``shapes`` that it fills."""
        plain = (int, ctypes.c_double, type(None))
        arguments = [a if isinstance(a, plain) else np.array(a, dtype=self.real) for a in given]
        arguments += [np.full(shape, np.nan, dtype=self.real) for shape in shapes]
        pointers = [a.ctypes.data_as(ctypes.c_void_p) if isinstance(a, np.ndarray) else a for a in arguments]
        code = getattr(self.library, f"{self.of.identifier}_{name}")(self.model, *pointers)
        return code, [a for a in arguments if isinstance(a, np.ndarray)]

    def init(self, coefficients: np.ndarray | None = None) -> None:
        self._call("init", coefficients)

    def settle(self, columns: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        return self._call("settle", columns, inputs, shapes=[len(self.of.model.states)])[1][-1]

    def rates(self, state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        return self._call("rates", state, inputs, shapes=[len(self.of.model.states)])[1][-1]

    def forces(self, state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        return self._call("forces", state, inputs, shapes=[(len(self.of.model.roles), 3)])[1][-1]

    def columns(self, state: np.ndarray) -> np.ndarray:
        return self._call("columns", state, shapes=[6])[1][-1]

    def jacobians(self, state: np.ndarray, inputs: np.ndarray) -> list[np.ndarray]:
        S, C = len(self.of.model.states), len(self.of.model.controls)
        return self._call("jacobians", state, inputs, shapes=[(S, S), (S, C)])[1][-2:]

    def step(self, state: np.ndarray, inputs: np.ndarray, h: float) -> tuple[np.ndarray, int]:
        """The next state, and what the step returns."""
        code, (found, _) = self._call("step", state, inputs, ctypes.c_double(h))
        return found, code

    def step_many(self, states: np.ndarray, inputs: np.ndarray, h: float) -> tuple[np.ndarray, int]:
        """The next states (M, S) of ships with inputs (M, C), and what the step returns."""
        code, (found, _) = self._call("step_many", len(states), states, inputs, ctypes.c_double(h))
        return found, code


def compiled(
    of: Product, folder: Path, which: str = "gcc, C", flags: Sequence[str] = ("-O0",), single: bool = False
) -> Compiled:
    """The product as a shared library of the C compiler ``which``, initialised with its own coefficients.

    It is linked without ``flags``: GCC before 13 would put code into a library linked with -ffast-math that takes
    subnormal numbers away from the whole process that loads it."""
    command = compiler(which)
    source, target = write_files(of, folder), folder / f"ship{len(list(folder.iterdir()))}.so"
    more = [f"-D{of.identifier.upper()}_SINGLE"] if single else []
    made = target.with_suffix(".o")
    subprocess.run([*command, *flags, *more, "-fPIC", "-c", str(source), "-o", str(made)], check=True)
    subprocess.run([command[0], "-shared", str(made), "-lm", "-o", str(target)], check=True)
    real = np.float32 if single else np.float64
    ship = Compiled(of, ctypes.CDLL(str(target)), real, ctypes.create_string_buffer(1 << 20))
    ship.init()
    return ship
