"""Evaluation of CasADi functions at many points: compiled where a C compiler is found, interpreted elsewhere.

Compiled libraries are cached by a hash of their source, compiler, flags and processor, in the user's cache folder
(``MMG_CACHE`` overrides it).
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np

from mmg.compile.codegen import LANES, source

FLAGS: tuple[str, ...] = (
    "-O1", "-ftree-vectorize", "-ffp-contract=off", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-w"
)  # fmt: skip
"""-ftree-vectorize makes vectors of the loops over lanes (square roots). Without contraction a product and a sum are
rounded one by one whatever stands beside them, so equal expressions give equal bits; its cost is not measurable."""
NATIVE = "-march=native"
"""Tried first; compilers that do not know it compile for the generic processor."""


def cache_folder() -> Path:
    """Folder of compiled code: MMG_CACHE, else the platform's user cache."""
    if os.environ.get("MMG_CACHE"):
        return Path(os.environ["MMG_CACHE"])
    if platform.system() == "Windows":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "mmg-ident"
    if platform.system() == "Darwin":
        return Path.home() / "Library" / "Caches" / "mmg-ident"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "mmg-ident"


def compiler() -> str | None:
    """The C compiler to use: MMG_CC, else gcc, clang or cc on the path; None if there is none.

    ``MMG_CC=none`` switches compilation off.
    """
    wanted = os.environ.get("MMG_CC")
    if wanted:
        return None if wanted == "none" else shutil.which(wanted)
    return next((found for name in ("gcc", "clang", "cc") if (found := shutil.which(name))), None)


def _processor() -> str:
    """Text that changes when ``-march=native`` would mean something else."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("flags"):
                return line
    except OSError:
        pass
    return platform.processor() + platform.machine()


def compile_library(text: str, flags: Sequence[str] = FLAGS) -> tuple[Path | None, str]:
    """Compile C source into a cached shared library; returns (path, ""), or (None, why it was not possible). text: the
    source; flags: of the compiler."""
    cc = compiler()
    if cc is None:
        if os.environ.get("MMG_CC"):
            return None, f"no C compiler, because MMG_CC is {os.environ['MMG_CC']!r}"
        return None, "no C compiler found (gcc or clang)"
    key = hashlib.sha256("\n".join([text, cc, *flags, _processor(), platform.platform()]).encode()).hexdigest()[:24]
    suffix = ".dll" if platform.system() == "Windows" else ".so"
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        library = folder / f"{key}{suffix}"
        if library.exists():
            return library, ""
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            code = Path(scratch) / "code.c"
            code.write_text(text)
            built = Path(scratch) / f"code{suffix}"
            for extra in ((NATIVE,), ()):
                command = [cc, *flags, *extra, str(code), "-o", str(built), "-lm"]
                run = subprocess.run(command, capture_output=True, text=True)
                if run.returncode == 0:
                    break
            if run.returncode:
                lines = run.stderr.strip().splitlines() or ["no message"]
                return None, f"{cc} failed: {next((line for line in lines if 'error' in line), lines[0])}"
            os.replace(built, library)
        return library, ""
    except OSError as error:
        return None, f"no cache folder for compiled code ({error})"


def load_library(text: str, flags: Sequence[str] = FLAGS) -> tuple[ctypes.CDLL | None, str]:
    """The library of C source, compiled or from the cache; (None, why) where that is not possible. text: the source;
    flags: of the compiler."""
    path, reason = compile_library(text, flags)
    if path is None:
        return None, reason
    try:
        return ctypes.CDLL(str(path)), ""
    except OSError as error:
        return None, f"compiled code does not load ({error})"


@dataclass
class BatchFunction:
    """A CasADi function over many points.

    Call it with one array per input, shape (rows, points) or, shared by all points, (rows,); a matrix input is
    given by the nonzeros it has as a column-major vector. It returns one array (nonzeros, points) per output.
    ``points`` must be a multiple of LANES (``padded`` gives the next one).
    """

    function: ca.Function
    library: ctypes.CDLL | None
    _mapped: dict = field(default_factory=dict, repr=False)

    def __call__(self, *inputs: np.ndarray, outputs: Sequence[bool] | None = None) -> list[np.ndarray | None]:
        points = max((a.shape[1] for a in inputs if a.ndim == 2), default=LANES)
        return self._compiled(points, inputs, outputs) if self.library else self._interpreted(points, inputs)

    def at(self, *inputs: np.ndarray) -> list[np.ndarray]:
        """All outputs, (nonzeros, m) each, at any number m >= 1 of points: inputs (rows, m), or (rows,) for all."""
        m = next(a.shape[1] for a in inputs if a.ndim == 2)
        outputs = self(*[filled(a, padded(m)) if a.ndim == 2 else a for a in inputs])
        return [a[:, :m] for a in outputs if a is not None]

    def _compiled(
        self, points: int, inputs: Sequence[np.ndarray], outputs: Sequence[bool] | None
    ) -> list[np.ndarray | None]:
        if points % LANES:
            raise ValueError(f"{points} points is not a multiple of {LANES}")
        f = self.function
        arrays = [np.ascontiguousarray(a, dtype=float) for a in inputs]
        wanted = outputs or [True] * f.n_out()
        results = [np.empty((f.nnz_out(j), points)) if wanted[j] else None for j in range(f.n_out())]
        arg = (ctypes.c_void_p * len(arrays))(*[a.ctypes.data for a in arrays])
        ld = (ctypes.c_longlong * len(arrays))(*[points if a.ndim == 2 else 0 for a in arrays])
        res = (ctypes.c_void_p * len(results))(*[None if a is None else a.ctypes.data for a in results])
        getattr(self.library, f.name())(ctypes.c_longlong(points), arg, ld, res)
        return results

    def _interpreted(self, points: int, inputs: Sequence[np.ndarray]) -> list[np.ndarray | None]:
        """The same through CasADi's virtual machine, zero-copy buffers, one map over the points."""
        f = self.function
        shared = tuple(a.ndim == 1 for a in inputs)
        key = (points, shared)
        if key not in self._mapped:
            mapped = f.map(f.name(), "serial", points, [i for i, s in enumerate(shared) if s], [])
            self._mapped[key] = (mapped, *mapped.buffer())
        mapped, buffer, trigger = self._mapped[key]
        arrays = [np.ascontiguousarray(a if a.ndim == 1 else a.T, dtype=float) for a in inputs]
        results = [np.zeros((points, f.nnz_out(j))) for j in range(f.n_out())]
        for i, a in enumerate(arrays):
            buffer.set_arg(i, a.reshape(-1).data)
        for j, a in enumerate(results):
            buffer.set_res(j, a.reshape(-1).data)
        trigger()
        return [np.ascontiguousarray(a.T) for a in results]


def padded(points: int) -> int:
    """Number of points in whole vectors: ``points`` rounded up to a multiple of LANES, at least LANES."""
    return max(LANES, -(-points // LANES) * LANES)


def filled(array: np.ndarray, points: int) -> np.ndarray:
    """``array`` (..., m) with its last point repeated, (..., points); as it is where it has them."""
    missing = points - array.shape[-1]
    return np.concatenate([array, np.repeat(array[..., -1:], missing, axis=-1)], axis=-1) if missing > 0 else array


def batch_functions(functions: Sequence[ca.Function], compiled: bool = True) -> tuple[list[BatchFunction], str]:
    """Batch versions of SXFunctions, compiled into one cached library if possible.

    Returns them with a sentence on why they run interpreted, or "" when compiled.
    functions: with distinct names; compiled: False interprets.
    """
    library, reason = None, "compilation switched off"
    if compiled:
        try:
            library, reason = load_library(source(functions))
        except NotImplementedError as error:
            reason = str(error)
    return [BatchFunction(f, library) for f in functions], reason
