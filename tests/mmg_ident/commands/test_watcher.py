"""A library that does not return (here: a sum in C) does not keep Ctrl-C waiting."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mmg_ident.commands import main

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")

DEAF = """
import itertools, signal, sys
from mmg_ident.commands.watcher import tell, watch
signal.signal(signal.SIGINT, signal.default_int_handler)
watch()
if sys.argv[1] == "held":
    tell("held")
print("ready", flush=True)
sum(itertools.repeat(1, 2 * 10**10))
"""


def deaf(state: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", DEAF, state]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    time.sleep(0.5)  # until it is in the sum
    return process


@pytest.mark.slow
def test_a_command_with_nothing_to_keep_is_ended_with_a_line() -> None:
    process = deaf("free")
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=20)
    assert process.returncode == -signal.SIGKILL and error.count("\n") == 1


@pytest.mark.slow
def test_one_with_something_to_keep_is_let_go_on_until_the_second() -> None:
    process = deaf("held")
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None and process.stderr.readline()
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    assert process.returncode == -signal.SIGKILL


def test_the_second_process_ends_with_the_first_and_holds_no_output_open() -> None:
    process = deaf("free")
    process.kill()
    began = time.monotonic()
    assert process.communicate(timeout=20) == ("", "")  # both ends of output are closed
    assert time.monotonic() - began < 20


LOST = """
import signal, time
from mmg_ident.commands import main
main.answer_signals()
signal.signal(signal.SIGINT, main.note_interruption)
class Deleted:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
try:
    one = Deleted()
    del one
    for _ in range(100):
        time.sleep(0.02)
except KeyboardInterrupt:
    print("raised")
"""


def test_ctrl_c_that_python_drops_while_an_object_is_deleted_is_raised_once_more() -> None:
    made = subprocess.run([sys.executable, "-c", LOST], capture_output=True, text=True, check=False)
    assert made.stdout == "raised\n" and "Traceback" not in made.stderr


def test_sigterm_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second signal would end at once what has something to keep."""
    called: list[int] = []
    monkeypatch.setattr(signal, "raise_signal", lambda number: pytest.fail("sent once more"))
    before = signal.signal(signal.SIGINT, lambda number, _: called.append(number))
    try:
        main.terminated(signal.SIGTERM, None)
    finally:
        signal.signal(signal.SIGINT, before)
    assert called == [signal.SIGINT]


CHILD = """
from mmg_ident.commands.main import run

if __name__ == "__main__":
    from fitting.parallel import run_all

    print(run_all(abs, [-1, -2], 2))
"""


def test_a_process_of_the_command_ends_without_a_word(tmp_path: Path) -> None:
    """It reads the script again, whose name is that of the command."""
    script = tmp_path / "mmg"
    script.write_text(CHILD)
    made = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert (made.stdout, made.stderr, made.returncode) == ("[1, 2]\n", "", 0)


HELD = """
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from mmg_ident.commands import main

if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, get_context("spawn"))
    if {call}:
        main.taken_back()
    os._exit(130)
"""


@pytest.mark.parametrize(("call", "warned"), [(True, False), (False, True)])
def test_semaphores_of_a_pool_that_is_still_held_at_the_end_are_taken_back(
    call: bool, warned: bool, tmp_path: Path
) -> None:
    script = tmp_path / "script.py"
    script.write_text(HELD.format(call=call))
    made = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert made.returncode == 130 and ("resource_tracker" in made.stderr) == warned
