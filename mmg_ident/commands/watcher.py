"""Ctrl-C is answered within two seconds, also while a library neither returns nor fails.

Python runs its handlers of signals between two instructions of its own. A library that computes for long, or that spins
because memory does not suffice, keeps them waiting. The interpreter's handler in C writes each signal to a pipe all the
same. A second process reads it there, says what is to be said, and ends the first one where nothing can be lost. It
ends with the first one, whatever becomes of that.
"""

from __future__ import annotations

import os
import select
import signal
import time

# Seconds within which a signal is answered, and within which a command that has nothing to keep must have ended. Set by
# hand: half a second less, and a second more, than the two seconds of the rule for Ctrl-C.
ANSWER, END = 1.5, 3.0
# What the first process tells, as a byte that no signal has.
WORDS = {"held": 200, "released": 201, "noted": 202, "ending": 203}
SIGNALS = (signal.SIGINT, signal.SIGTERM)

_WAITS = b"mmg: interrupted: stopping as soon as the present step is done; Ctrl-C again ends at once\n"
_ENDS = b"mmg: interrupted; ending\n"
_ENDED = b"mmg: interrupted; ended, as a library did not answer; nothing was written\n"


class _Pipe:
    """The end of the pipe that the first process writes to; none before ``watch``."""

    end: int | None = None  # descriptor, None where nobody watches


def watch() -> None:
    """Start the second process, once, where there are processes of this kind (not on Windows)."""
    if _Pipe.end is not None or not hasattr(os, "fork"):
        return
    read, write = os.pipe()
    first = os.getpid()
    try:
        child = os.fork()
    except OSError:  # no more processes: signals are answered as Python does
        os.close(read)
        os.close(write)
        return
    if child == 0:
        status = 0
        try:
            os.close(write)  # or the read end would never see that the first process has gone
            _attend(read, first)
        except BaseException:
            status = 1
        os._exit(status)  # never back into the program of the first process
    os.close(read)
    os.set_blocking(write, False)  # the interpreter asks for it: a handler in C must not wait for a full pipe
    _Pipe.end = write
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)


def tell(word: str) -> None:
    """Tell the second process, where there is one, a word of WORDS: whether signals are held, noted, or end all."""
    if _Pipe.end is not None:
        try:
            os.write(_Pipe.end, bytes([WORDS[word]]))
        except OSError:  # it is gone
            _Pipe.end = None


def _attend(pipe: int, first: int) -> None:
    """Read the ``pipe`` until the process ``first`` has ended."""
    for number in SIGNALS:  # a terminal sends Ctrl-C to all its processes
        signal.signal(number, signal.SIG_IGN)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)  # who reads the output of the first process must see its end
    held, ending, pressed, began = False, False, 0, 0.0
    due: float | None = None  # when something must be said or done
    while True:
        if select.select([pipe], [], [], None if due is None else max(due - time.monotonic(), 0.0))[0]:
            if not (data := os.read(pipe, 64)):  # the first process has ended
                return
            for byte in data:
                if byte in (WORDS["held"], WORDS["released"]):
                    held, pressed = byte == WORDS["held"], 0
                elif byte == WORDS["noted"] and pressed < 2:  # a second Ctrl-C means: at once
                    due = None  # it has said so itself
                elif byte == WORDS["ending"]:
                    ending = True
                elif byte in SIGNALS:
                    pressed, ending, began = pressed + 1, False, time.monotonic()
                    due = began + ANSWER
        elif held and pressed < 2:  # something would be lost: it is asked once more
            os.write(2, _WAITS)
            due = None
        elif ending and time.monotonic() < began + END - 0.1:  # Python is on its way out; time until END is left
            os.write(2, _ENDS)
            due = began + END
        else:
            os.write(2, _ENDED)
            os.kill(first, signal.SIGKILL)
            return
