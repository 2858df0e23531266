"""Shared libraries of an FMU for several platforms, by the C compilers that are there."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mmg.compile.cache import compiler
from mmg.errors import Conflict, NotInstalled, ProgramFailed, UnknownName, UserError

# The one file to compile: it includes the others. File names with a hyphen cannot be those of a ship.
MAIN = "fmu-main.c"
# Without errno and traps, which the C never reads: with them a compiler may not make plain instructions of roots.
FLAGS: tuple[str, ...] = ("-std=c99", "-O2", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fvisibility=hidden")


@dataclass(frozen=True)
class FmuPlatform:
    """A platform: its folders in FMI 2.0 and 3.0, the suffix of its libraries, names of compilers for it alone, and
    how zig calls it."""

    folder_2: str
    folder_3: str
    suffix: str
    compilers: tuple[str, ...]
    zig: str


# By their names in FMI 3.0; 2.17 in zig's name of a target is the oldest glibc that loads its libraries.
PLATFORMS = {
    p.folder_3: p
    for p in (
        FmuPlatform("linux64", "x86_64-linux", ".so", ("x86_64-linux-gnu-gcc",), "x86_64-linux-gnu.2.17"),
        FmuPlatform("aarch64-linux", "aarch64-linux", ".so", ("aarch64-linux-gnu-gcc",), "aarch64-linux-gnu.2.17"),
        FmuPlatform("win64", "x86_64-windows", ".dll", ("x86_64-w64-mingw32-gcc",), "x86_64-windows-gnu"),
        FmuPlatform("win32", "x86-windows", ".dll", ("i686-w64-mingw32-gcc",), "x86-windows-gnu"),
        FmuPlatform("darwin64", "x86_64-darwin", ".dylib", (), "x86_64-macos"),
        FmuPlatform("darwin64", "aarch64-darwin", ".dylib", (), "aarch64-macos"),
    )
}
NONE = "none"  # What is said for an FMU of sources alone


def this_platform() -> str:
    """Name of the platform of this process, as in PLATFORMS; "" for one that is not among them."""
    machine = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}
    processor = machine.get(platform.machine().lower(), platform.machine().lower())
    if processor == "x86_64" and sys.maxsize < 2**32:  # a 32-bit Python on a 64-bit system loads 32-bit libraries
        processor = "x86"
    name = f"{processor}-{platform.system().lower()}"
    return name if name in PLATFORMS else ""


def platforms_of(names: Sequence[str], version: int) -> list[str]:
    """Platforms of PLATFORMS meant by ``names``, which may be those of FMI 2.0 as well; empty for "none".

    version: of FMI. Raises UserError for an unknown one, and for two that FMI 2.0 cannot tell apart.
    """
    if list(names) == [NONE]:
        return []
    # reversed: of two with one folder in FMI 2.0 the first is meant
    names_3 = {**{p.folder_2: name for name, p in reversed(PLATFORMS.items())}, **{name: name for name in PLATFORMS}}
    for name in names:
        if name not in names_3:
            raise UnknownName(f"--platforms {name}: no such platform; choose of {', '.join(PLATFORMS)}, or {NONE}")
    platforms = list(dict.fromkeys(names_3[name] for name in names))
    folders = [PLATFORMS[name].folder_2 for name in platforms]
    if version == 2 and len(set(folders)) < len(folders):
        raise Conflict("--platforms: FMI 2.0 has one folder for macOS; choose one of its platforms, or --format fmu3")
    return platforms


def build(sources: dict[str, str], identifier: str, names: Sequence[str]) -> dict[str, bytes]:
    """The library of each platform of ``names``, made of ``sources`` and named by ``identifier``.

    Raises UserError where there is no compiler for one of them, or it fails.
    """
    return {name: _built(sources, identifier, name, _command(name)) for name in names}


def build_here(sources: dict[str, str], identifier: str) -> tuple[dict[str, bytes], str]:
    """The library for this platform, or none and the reason. sources, identifier: as for ``build``."""
    name = this_platform()
    if not name:
        return {}, f"{platform.system()} on {platform.machine()} is no platform that this program knows"
    try:
        return build(sources, identifier, [name]), ""
    except UserError as error:
        return {}, str(error)


def _command(name: str) -> list[str]:
    """The compiler for a platform, with the flags that only it needs."""
    chosen, zig = PLATFORMS[name], shutil.which("zig")
    # of Windows: no DLL of the compiler beside the library, and no time in it, so that equal sources give equal bytes
    alone = ["-static-libgcc", "-Wl,--no-insert-timestamp"]
    position, last = ([], alone) if name.endswith("windows") else (["-fPIC"], [])
    if name == this_platform():
        if os.environ.get("MMG_CC") == NONE:
            raise NotInstalled(f"--platforms {name}: no C compiler, because MMG_CC is {NONE!r}")
        if local_compiler := compiler():
            return [local_compiler, *position, *last]
    for other in chosen.compilers:
        if path := shutil.which(other):
            return [path, *position, *last]
    if zig or importlib.util.find_spec("ziglang"):
        command = [zig] if zig else [sys.executable, "-m", "ziglang"]
        return [*command, "cc", "-target", chosen.zig, "-s", *position]
    wanted = [*chosen.compilers, "zig (pip install ziglang)"]
    raise NotInstalled(f"--platforms {name}: no C compiler for it; install {' or '.join(wanted)}, or leave it out")


def _built(sources: dict[str, str], identifier: str, name: str, command: Sequence[str]) -> bytes:
    """The library, compiled in a folder of its own under names that do not change from run to run."""
    library = f"{identifier}{PLATFORMS[name].suffix}"
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        full_command = [*command, *FLAGS, "-I.", MAIN, "-o", library, "-lm"]
        run = subprocess.run(full_command, cwd=folder, capture_output=True, encoding="utf-8", errors="replace")
        if run.returncode:
            lines = run.stderr.strip().splitlines() or ["no message"]
            error = next((line for line in lines if "error" in line), lines[0])  # warnings may stand before it
            raise ProgramFailed(f"--platforms {name}: {command[0]} failed ({error})")
        return (folder / library).read_bytes()
