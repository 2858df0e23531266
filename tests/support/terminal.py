"""A command on a terminal of its own, and a person who answers its questions (POSIX)."""

from __future__ import annotations

import os
import select
import sys
import time
from pathlib import Path

PROGRAM = "import sys; from mmg_ident.commands.main import main; sys.exit(main(sys.argv[1:]))"
ROOT = Path(__file__).parents[2]


def talk(arguments: list[str], answers: list[str], folder: Path, quiet: float = 120.0) -> tuple[int, str, list[str]]:
    """Exit code, what ``mmg`` with these ``arguments`` shows in ``folder``, and the answers that it did not ask for.

    An answer is typed when the shown text ends with a colon; ``quiet``: seconds without a word after which it is ended.
    """
    import pty

    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        os.environ.update(PYTHONPATH=str(ROOT), OMP_NUM_THREADS="1", TERM="xterm", COLUMNS="120")
        os.execv(sys.executable, [sys.executable, "-c", PROGRAM, *arguments])
    shown, left, last = b"", list(answers), time.monotonic()
    while time.monotonic() - last < quiet:
        ready, _, _ = select.select([terminal], [], [], 0.3)
        if ready:
            try:
                piece = os.read(terminal, 4096)
            except OSError:
                break
            if not piece:
                break
            shown, last = shown + piece, time.monotonic()
        elif shown.endswith(b": ") and left:
            os.write(terminal, (left.pop(0) + "\n").encode())
            last = time.monotonic()
    else:
        os.kill(child, 9)
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    return os.waitstatus_to_exitcode(status), shown.decode(errors="replace").replace("\r\n", "\n"), left
