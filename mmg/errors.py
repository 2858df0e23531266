"""The one error that users meet: a line that says what is wrong, where, and what to do; and the check of names."""

from __future__ import annotations

import os
from pathlib import PureWindowsPath

from mmg.messages import printable

LONGEST_NAME = 200
"""Most bytes of a name: file systems take 255, and suffixes are added."""


DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{port}{i}" for port in ("COM", "LPT") for i in range(1, 10))}
"""What files cannot be called on Windows, whatever follows after a dot."""
WINDOWS = os.name == "nt"

LONGEST = 4000
"""Most characters of the text of an error; of a longer one the middle is left out."""


class UserError(Exception):
    """Bad input or an impossible request.

    The command line prints its text as one line and exits with code 2; the library raises it.
    The text says what is wrong, where (file, column, row, key), and what to do about it; words of a file that would
    steer a terminal or begin another line are shown escaped. Of more than LONGEST characters the middle is left out.
    """

    def __init__(self, text: object = "") -> None:
        words = printable(str(text)).replace("\n", "\\n")
        super().__init__(words if len(words) <= LONGEST else f"{words[: LONGEST - 500]} ... {words[-490:]}")


def needs_torch(what: str) -> None:
    """Raises UserError where torch, which ``what`` needs, is missing or broken."""
    try:
        import torch  # noqa: F401
    except (ImportError, OSError) as error:
        raise UserError(f"{what} needs torch, which cannot be imported ({error}); pip install torch") from None


def name_fault(name: str) -> str:
    """What keeps ``name`` from being the name of a trial, ship or run; "" when it is plain words.

    A name may become that of a file on any system, so it holds no path, no drive, nothing that cannot be printed.
    """
    if PureWindowsPath(name).name != name or name == "..":
        return "must be plain words, no path: without / and \\"
    if any("\udc80" <= c <= "\udcff" for c in name):
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
        raise UserError(f"{where}: name = '{name}': {fault}")
