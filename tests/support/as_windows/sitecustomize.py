"""Python as it is on Windows, as far as that can be simulated: in PYTHONPATH, this is run before anything else.

Modules and functions of POSIX are not there, open files are neither replaced nor removed, nothing is moved from the
drive of the temporary folder to another, there is no compiler, locks are those of msvcrt, and the console knows the
characters of cp1252 alone.
"""

import errno
import fcntl
import os
import signal
import subprocess  # noqa: F401  (it takes the system for Windows where msvcrt can be imported)
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

HANDLES = Path("/proc/self/fd")


def locking(handle, mode, size, flock=fcntl.flock):
    """The function of msvcrt: a lock of the open file, which another holds (EACCES) or not."""
    assert mode == 2 and size == 1, "only what is used is simulated"
    try:
        flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise PermissionError(errno.EACCES, "simulated Windows: locked") from None


sys.modules["msvcrt"] = SimpleNamespace(locking=locking, LK_NBLCK=2)
for name in ("fcntl", "resource", "pwd", "grp", "termios", "tty"):
    sys.modules[name] = None
for name in ("getuid", "geteuid", "getgid", "getegid", "fork", "forkpty", "setsid", "killpg", "getpgid"):
    if hasattr(os, name):
        delattr(os, name)
for name in ("SIGKILL", "SIGALRM", "SIGHUP", "setitimer", "alarm", "pthread_sigmask"):
    if hasattr(signal, name):
        delattr(signal, name)
os.environ["MMG_CC"] = "none"
other_drive = os.path.realpath(tempfile.gettempdir())


def open_files():
    """Real paths of the files that this process holds open."""
    found = set()
    for handle in HANDLES.iterdir():
        try:
            found.add(str(handle.readlink()))
        except OSError:
            continue
    return found


def refusing(function, pair):
    """The function of os, which fails as on Windows. pair: whether it takes two paths."""

    def called(*paths, **options):
        real = [os.path.realpath(path) for path in paths[: 2 if pair else 1]]
        held = open_files()
        for path in real:
            if "dir_fd" not in options and any(f == path or f.startswith(path + os.sep) for f in held):
                raise PermissionError(errno.EACCES, "simulated Windows: it is open", path)
        if pair and len({path.startswith(other_drive + os.sep) for path in real}) > 1:
            raise OSError(errno.EXDEV, "simulated Windows: another drive", real[0])
        return function(*paths, **options)

    return called


if HANDLES.is_dir():
    for name, pair in (("replace", True), ("rename", True), ("unlink", False), ("remove", False)):
        setattr(os, name, refusing(getattr(os, name), pair))
for stream in (sys.stdout, sys.stderr):
    stream.reconfigure(encoding="cp1252")
