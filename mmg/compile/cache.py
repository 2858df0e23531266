"""Compiled C code: the compiler, and the folder that keeps what it made.

A library is loaded, and so run, only from a folder and a file that belong to the user and that no one else can write,
and only while its content has the hash in its name, which also depends on source, compiler, flags and processor.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import casadi as ca

from mmg.messages import LOGGER

# Flags tried in this order: compilers that do not know the first ones compile for the generic processor in the end.
# Without the width some make vectors of half the registers, whose halves are stored and then read as a whole, which
# costs more than all the arithmetic.
NATIVE = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ())

# Stands between the units of C source that are compiled side by side and linked to one library.
UNIT = "\n/* next unit */\n"
# Begins a unit of second derivatives: with -Og a compiler takes two thirds of the time of -O1 for as fast a code.
LONG = "/* long code without loops */\n"
# Files that make C code or are put into it: it is another where one of them has changed.
SOURCES = (*sorted(Path(__file__).parent.glob("*.[ch]")), *sorted(Path(__file__).parent.glob("*.py")),
           Path(__file__).parents[1] / "runge_kutta.py")  # fmt: skip


def cache_folder() -> Path:
    """Folder of compiled code: MMG_CACHE, else the platform's user cache. Raises OSError where there is no home."""
    if os.environ.get("MMG_CACHE"):
        return Path(os.environ["MMG_CACHE"]).absolute()
    try:
        home = Path.home()
    except RuntimeError:
        raise OSError("there is no home folder; set MMG_CACHE") from None
    if platform.system() == "Windows":
        return Path(os.environ.get("LOCALAPPDATA") or home) / "mmg-ident"
    if platform.system() == "Darwin":
        return home / "Library" / "Caches" / "mmg-ident"
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else home / ".cache") / "mmg-ident"


def compiler() -> str | None:
    """The C compiler to use: MMG_CC, else gcc, clang or cc on the path; None if there is none.

    ``MMG_CC=none`` switches compilation off.
    """
    wanted = os.environ.get("MMG_CC")
    if wanted:
        return None if wanted == "none" else shutil.which(wanted)
    return next(filter(None, map(shutil.which, ("gcc", "clang", "cc"))), None)


def _processor() -> str:
    """Text that changes when ``-march=native`` would mean something else."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith(("flags", "Features")):  # as x86 and as ARM call the list of their instructions
                return line
    except OSError:  # no such file but on Linux
        pass
    return platform.processor() + platform.machine()


def _is_private(status: os.stat_result) -> bool:
    """Whether a file or folder belongs to the user and no one else can write to it."""
    if not hasattr(os, "geteuid"):  # Windows
        return True
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _trusted(path: Path) -> bool:
    """Whether a cached library is the user's and has the content that its name says; removed where it is not."""
    try:
        with path.open("rb") as file:  # one handle for owner and content: the file cannot be exchanged in between
            good = _is_private(os.fstat(file.fileno())) and hashlib.sha256(file.read()).hexdigest() in path.name
    except OSError:
        return False
    if not good:
        path.unlink()
    return good


Check = Callable[[ctypes.CDLL], str]  # Says what is wrong with a newly compiled library, "" for nothing


@dataclass(frozen=True)
class LateSource:
    """C source that is made only where it has to be compiled. made_from: what determines it; make: makes it."""

    made_from: str
    make: Callable[[], str]

    @classmethod
    def of(cls, functions: Sequence[ca.Function], make: Callable[[], str], kind: str = "") -> LateSource:
        """Source of a ``kind`` that ``make`` makes of CasADi ``functions``."""
        made_by = hashlib.sha256(b"".join(file.read_bytes() for file in SOURCES)).hexdigest()
        return cls("\n".join([made_by, kind, *(f.serialize() for f in functions)]), make)


Text = str | LateSource

CHARACTERS_A_SECOND = 400_000  # Of C source that gcc 12 compiles on one processor of 2023 (600 kB in 1.5 s)
announced: list[str] = []  # What this process has said that it compiles: the first thing alone, one line of a command


def _announce(what: str, text: str, folder: Path) -> None:
    """Say, once in a process, that ``what`` is compiled from a ``text`` into a ``folder``."""
    if not announced:
        seconds = 1 + len(text) // CHARACTERS_A_SECOND
        LOGGER.info("compiling %s, about %d s (once, kept in %s)", what, seconds, folder)
        announced.append(what)


def compile_library(
    text: Text, flags: Sequence[str], check: Check | None = None, what: str = "equations"
) -> tuple[Path | None, str]:
    """Compile C source into a cached shared library; returns (path, ""), or (None, why it was not possible). text: the
    source; flags: of the compiler; check: asked of a new library before it is kept; what: it is, for people."""
    cc = compiler()
    if cc is None:
        if os.environ.get("MMG_CC"):
            return None, f"no C compiler, because MMG_CC is {os.environ['MMG_CC']!r}"
        return None, "no C compiler found (gcc or clang)"
    made_from = text.made_from if isinstance(text, LateSource) else text
    all_of_it = "\n".join([made_from, cc, *flags, *NATIVE[0], _processor(), platform.platform()])
    key = hashlib.sha256(all_of_it.encode()).hexdigest()[:24]  # 96 bits: no two sources share a key by chance
    suffix = ".dll" if platform.system() == "Windows" else ".so"
    try:
        folder = cache_folder()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_private(folder.stat()):
            whose = f"the cache {folder} is another user's or others can write to it"
            return None, f"{whose}; chmod 700 it or set MMG_CACHE"
        kept = next(filter(_trusted, folder.glob(f"{key}-*{suffix}")), None)
        if kept:
            return kept, ""
        source = text.make() if isinstance(text, LateSource) else text
        _announce(what, source, folder)
        return _built(folder, source, [cc, *flags], key, suffix, check)
    except OSError as error:
        return None, f"no cache folder for compiled code ({error})"


def _built(
    folder: Path, text: str, command: Sequence[str], key: str, suffix: str, check: Check | None
) -> tuple[Path | None, str]:
    """The library of C source, newly compiled by a command without its files; or (None, why not)."""
    # beside the libraries, on the same file system: os.replace is then one step for every process that looks
    with tempfile.TemporaryDirectory(dir=folder, ignore_cleanup_errors=True) as scratch:
        built = Path(scratch) / f"code{suffix}"
        units = [Path(scratch) / f"code_{i}.c" for i in range(text.count(UNIT) + 1)]
        for path, part in zip(units, text.split(UNIT), strict=True):
            path.write_text(part, encoding="utf-8")
        for extra in NATIVE:
            run = _compiled([*command, *extra], units, built)
            if run.returncode == 0 and built.is_file():
                break
        else:
            return None, _failed(command[0], run)
        built.chmod(0o700)
        try:
            wrong = check(_copied(built)) if check else ""
        except OSError as error:
            return None, f"compiled code does not load ({error})"
        if wrong:
            return None, f"what {Path(command[0]).name} made of the equations is wrong: {wrong}"
        library = folder / f"{key}-{hashlib.sha256(built.read_bytes()).hexdigest()}{suffix}"
        os.replace(built, library)
    return library, ""


def _compiled(command: Sequence[str], units: Sequence[Path], built: Path) -> subprocess.CompletedProcess[str]:
    """What the compiler said of the ``units``, compiled side by side, one at a time for each processor, and linked."""

    def run(*more: object) -> subprocess.CompletedProcess[str]:
        # compilers answer in the bytes of their own locale
        return subprocess.run([*command, *map(str, more)], capture_output=True, encoding="utf-8", errors="replace")

    if len(units) == 1:
        return run(units[0], "-o", built, "-lm")

    def compiled(unit: Path) -> subprocess.CompletedProcess[str]:
        level = ["-Og"] if unit.read_text(encoding="utf-8").startswith(LONG) else []
        return run("-c", *level, unit, "-o", unit.with_suffix(".o"))

    with ThreadPoolExecutor(min(len(units), os.cpu_count() or 1)) as pool:
        runs = list(pool.map(compiled, units))
    failed = next((one for one in runs if one.returncode), None)
    return failed or run(*(unit.with_suffix(".o") for unit in units), "-o", built, "-lm")


def _failed(cc: str, run: subprocess.CompletedProcess[str]) -> str:
    """Why a run of the compiler ``cc`` gave nothing."""
    if run.returncode < 0:  # POSIX: minus the number of the signal
        return f"{cc} was ended by signal {-run.returncode}"
    if run.returncode == 0:
        return f"{cc} made no library"
    lines = run.stderr.strip().splitlines() or ["no message"]
    return f"{cc} failed: {next((line for line in lines if 'error' in line), lines[0])}"


def _copied(built: Path) -> ctypes.CDLL:
    """A copy of a library, loaded: Windows does not let go of a file that is loaded."""
    copy = built.with_stem("tried")
    shutil.copy2(built, copy)
    return ctypes.CDLL(str(copy))


def load_library(
    text: Text, flags: Sequence[str], check: Check | None = None, what: str = "equations"
) -> tuple[ctypes.CDLL | None, str]:
    """The library of C source, compiled or from the cache; (None, why) where that is not possible, which is said once
    where there is a compiler. text, flags, check, what: as of ``compile_library``."""
    try:
        path, reason = compile_library(text, flags, check, what)
        if path is not None:
            return ctypes.CDLL(str(path)), ""
    except NotImplementedError as error:  # an operation of CasADi without C
        reason = str(error)
    except OSError as error:
        reason = f"compiled code does not load ({error})"
    if compiler():
        _warn(what, reason)
    return None, reason


@cache
def _warn(what: str, reason: str) -> None:
    """Say, once in a process, why ``what`` is not compiled."""
    LOGGER.warning("%s: not compiled, several times slower: %s", what, reason)
