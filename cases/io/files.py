"""Files: ordinary ones are read whole, texts are written whole or not at all, JSON is an object, and locks end with the
process that holds them (of fcntl on POSIX, of msvcrt on Windows)."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import json
import os
import re
import secrets
import shutil
import stat
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mmg.errors import BadValue, Missing, NotWritable, OutOfRange, TargetExists, Unreadable

try:
    import fcntl
except ImportError:  # Windows has no locks of this kind
    fcntl = None  # type: ignore[assignment]
try:
    import msvcrt
except ImportError:  # POSIX
    msvcrt = None  # type: ignore[assignment]

HELD = (BlockingIOError, PermissionError)  # What the operating systems raise where another process has the lock
LARGEST = 256 * 2**20  # Most bytes of a file that is read; several times as much memory is needed. Set by hand.


def check_file(path: Path, largest: int = LARGEST) -> None:
    """Raises UserError unless ``path`` is an ordinary file that can be read and has no more than ``largest`` bytes."""
    try:
        status = path.stat()
    except FileNotFoundError:
        raise Missing(f"{path}: no such file or folder; check the path") from None
    except OSError as error:
        raise Unreadable(f"{path}: cannot be read ({error.strerror or error}); check the path") from None
    except ValueError:
        raise BadValue(f"{str(path)!r}: is no path") from None
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "not an ordinary file"
        raise BadValue(f"{path}: is {kind}; give the file itself")
    if status.st_size > largest:
        raise OutOfRange(f"{path}: has {status.st_size / 2**20:.0f} MB, more than {largest // 2**20}; divide it")


def read_bytes(path: Path) -> bytes:
    """The content of the ordinary file ``path``. Raises UserError as ``check_file`` does."""
    check_file(path)
    with opened(path) as stream:
        return stream.read()


def opened(path: Path) -> BinaryIO:
    """The bytes of the file ``path`` as a stream. Raises UserError where it cannot be read."""
    try:
        return path.open("rb")
    except OSError as error:
        raise Unreadable(f"{path}: cannot be read ({error.strerror or error}); check the path") from None


def file_hash(path: Path, largest: int = LARGEST) -> str:
    """The SHA-256 of the ordinary file ``path``, read in pieces. largest: most bytes that it may have. Raises UserError
    as ``check_file`` does."""
    check_file(path, largest)
    return lines_and_hash(path)[1]


def lines_and_hash(path: Path) -> tuple[int, str]:
    """How many lines the file ``path`` has, whatever system ended them, and the SHA-256 of its bytes."""
    digest, new, old, end = hashlib.sha256(), 0, 0, b""
    with opened(path) as stream:
        while piece := stream.read(2**22):
            digest.update(piece)
            new, old, end = new + piece.count(b"\n"), old + piece.count(b"\r"), piece[-1:]
    # Windows ends a line with both, old Macs with "\r" alone.
    return max(new, old) + (end not in (b"\n", b"\r")), digest.hexdigest()


def decoded(content: bytes, where: object) -> str:
    """The text of ``content``, UTF-8 with or without a mark. Raises UserError, which names ``where``, for others."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise BadValue(f"{where}: is encoded in UTF-16; save it in UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadValue(f"{where}: is not encoded in UTF-8 (byte {error.start + 1}); save it in UTF-8") from None


def parse_json(text: str) -> Any:
    """The value that ``text`` is as JSON. Raises ValueError where it is none, however deep it is nested."""
    try:  # Python refuses integers of more than 4300 digits, and 20 are more than 64 bits hold
        return json.loads(text, parse_int=lambda digits: int(digits) if len(digits) < 20 else float(digits))
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_json(path: Path) -> dict[str, Any]:
    """The JSON object in the file ``path``. Raises UserError where there is none."""
    try:
        content = parse_json(decoded(read_bytes(path), path))
    except ValueError as error:
        raise BadValue(f"{path}: cannot be read as JSON ({error})") from None
    if not isinstance(content, dict):
        raise BadValue(f"{path}: holds no JSON object with keys")
    return content


def file_key(name: str) -> str:
    """What ``name`` has in common with those that are one file on Windows or macOS: no case, accents in one form."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def replace_text(path: Path, text: str) -> None:
    """Write ``text`` to ``path``, atomically. Raises OSError, and leaves nothing behind, when it cannot be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A file beside ``path`` to write to, which takes its place at the end. Raises OSError where that is not possible.
    Where the writing fails nothing is left behind, and what processes have left that were killed here is removed."""
    if not path.name:
        raise IsADirectoryError(f"{path} is a folder")
    _remove_leftovers(path)
    scratch = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")  # beside it: only there a rename is atomic
    lock = os.open(scratch, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
    try:
        if fcntl:  # the lock ends with this process, and tells others that the file is no leftover
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield scratch
        if not fcntl:  # Windows renames no open file
            os.close(lock)
            lock = -1
        os.replace(scratch, path)
    finally:
        if lock >= 0:
            os.close(lock)
        with contextlib.suppress(OSError):
            scratch.unlink()


@contextlib.contextmanager
def filled(folder: Path, force: bool) -> Iterator[Path]:
    """A folder beside ``folder`` to write to, whose files come to it at the end: all, or none where the writing fails.
    force: files of the same names in a folder that holds some are replaced. Raises UserError where it holds some and
    ``force`` is false, and where it cannot be written."""
    if folder.exists() and not folder.is_dir():
        raise BadValue(f"--out {folder}: is a file; name a folder")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise TargetExists(f"--out {folder}: holds files already; choose another name or add --force")
    scratch = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.part")
    try:
        scratch.mkdir(parents=True)
        yield scratch
        if folder.is_dir():  # a folder that holds files cannot be replaced in one step
            for path in scratch.iterdir():
                os.replace(path, folder / path.name)
        else:
            os.replace(scratch, folder)
    except OSError as error:
        raise NotWritable(f"--out {folder}: cannot be written ({error.strerror or error}); check the path") from None
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(scratch)


def _remove_leftovers(path: Path) -> None:
    """Remove files of ``replaced`` whose process was killed: no other one holds them."""
    for leftover in path.parent.glob(f".{glob.escape(path.name)}.*.part"):
        if not re.fullmatch(r"[0-9a-f]{8}\.part", leftover.name[len(path.name) + 2 :]):
            continue
        with contextlib.suppress(OSError):
            if not fcntl:
                leftover.unlink()  # fails on Windows while it is open
                continue
            handle = os.open(leftover, os.O_RDONLY)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                leftover.unlink()
            finally:
                os.close(handle)


@contextlib.contextmanager
def alone(mark: Path) -> Iterator[bool]:
    """While it lasts, no other process gets True for the file ``mark``, which is made, and removed at the end. Yields
    False where another one has it. A file system that knows no locks keeps nobody out. Raises OSError where the file
    cannot be made."""
    while True:
        handle = os.open(mark, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            mine = _taken(handle)
            valid = not mine or _same(handle, mark)
        except BaseException:
            os.close(handle)
            raise
        if valid:
            break
        os.close(handle)  # its last owner removed it in between
    try:
        yield mine
    finally:
        if mine and fcntl:
            with contextlib.suppress(OSError):
                mark.unlink()  # before the lock ends: afterwards it may be another process's
        os.close(handle)
        if mine and not fcntl:
            with contextlib.suppress(OSError):
                mark.unlink()  # Windows removes no open file; fails where another process has opened it by now


def _taken(handle: int) -> bool:
    """Whether this process has the lock of the open file ``handle`` now."""
    try:
        if fcntl:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif msvcrt:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except HELD:
        return False
    except OSError:
        return True  # no locks there
    return True


def _same(handle: int, mark: Path) -> bool:
    """Whether the open file ``handle`` is still the one called ``mark``."""
    try:
        return os.path.samestat(os.fstat(handle), mark.stat())
    except OSError:
        return False
