"""Commands of mmg as a test runs them: what they print as JSON, and their one line where they refuse."""

from __future__ import annotations

import contextlib
import io
import json
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from mmg_ident.commands.main import main


def printed(*arguments: object) -> str:
    """Run a command that must succeed; what it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([*map(str, arguments)]) == 0
    return out.getvalue()


def shown(verb: str, *arguments: object) -> dict[str, Any]:
    """Run a command with --json; its document."""
    return json.loads(printed(verb, *arguments, "--json"))


def refusal(*arguments: object) -> str:
    """Run a command that must be refused; returns its one line, beside which it may say that it compiles."""
    with contextlib.redirect_stderr(io.StringIO()) as err:
        assert main([*map(str, arguments)]) == 2
    lines = [line for line in err.getvalue().splitlines() if not line.startswith("compiling ")]
    assert len(lines) == 1 and lines[0].startswith("mmg: "), lines
    return lines[0]


# Commands that get Ctrl-C with all their processes, and what is left of these
def interrupted(arguments: list[str], seconds: float) -> tuple[int, str, list[int]]:
    """Exit code, words and processes left of a command that gets Ctrl-C, with all its processes, after a while.

    The while is of processor time: on a busy machine an interpreter may need long for its first steps."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mmg_ident.commands.main", *arguments],
        stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2], start_new_session=True,
    )  # fmt: skip
    while process.poll() is None and processor_time(process.pid) < seconds:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, words = process.communicate(timeout=60)
    left = still_there(process.pid)
    for _ in range(100):  # what was told to end may need a moment for it
        if not left:
            break
        time.sleep(0.1)
        left = still_there(process.pid)
    return process.returncode, words, left


def processes_of(session: int) -> dict[int, list[str]]:
    """Processes of a session, and of each what /proc/PID/stat says after its name."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            stat = path.read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        if int(stat[3]) == session:
            found[int(path.parent.name)] = stat
    return found


def still_there(session: int) -> list[int]:
    """Processes of a session that have not ended."""
    return [pid for pid, stat in processes_of(session).items() if stat[0] != "Z"]


def processor_time(session: int) -> float:
    """Seconds that the processes of a session have worked."""
    ticks = sum(int(stat[11]) + int(stat[12]) for stat in processes_of(session).values())
    return ticks / os.sysconf("SC_CLK_TCK")


# A command on a terminal of its own, and a person who answers its questions (POSIX)
PROGRAM = "import sys; from mmg_ident.commands.main import main; sys.exit(main(sys.argv[1:]))"
ROOT = Path(__file__).parents[2]


def talk(arguments: list[str], answers: list[str], folder: Path) -> tuple[int, str, list[str]]:
    """Exit code, what ``mmg`` with these ``arguments`` shows in ``folder``, and the answers that it did not ask for.

    An answer is typed when the shown text ends with a colon. It is ended after two minutes without a word.
    """
    import pty

    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        os.environ.update(PYTHONPATH=str(ROOT), OMP_NUM_THREADS="1", TERM="xterm", COLUMNS="120")
        os.execv(sys.executable, [sys.executable, "-c", PROGRAM, *arguments])
    shown, left, last = b"", list(answers), time.monotonic()
    while time.monotonic() - last < 120.0:
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
