"""What may end long work early: Ctrl-C, a limit of time or of iterations, a file that appears; and who is told of it.

The first Ctrl-C asks the work to stop at the next safe point, the second ends it.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

from mmg.errors import UserError
from mmg.messages import Message, OnProgress, Progress

# Code of the warning that Ctrl-C left out parts of a calibration, which can be made by resuming it.
LEFT_OUT = "parts_left_out"
Value = TypeVar("Value")

# Of this process: whether Ctrl-C is held (active), was pressed since (requested), is raised all the same (breaks).
INTERRUPTED = SimpleNamespace(active=False, requested=False, breaks=False)

# told: called with "held" and "released" when Ctrl-C begins and ends to be held, "noted" when it is pressed, "ending"
# when it ends all.
OBSERVER = SimpleNamespace(told=lambda word: None)


class OutOfTimeError(UserError):
    """The time limit was reached."""


@dataclass(frozen=True)
class Control:
    """What may end work early, handed to whatever solves, trains or searches.

    progress: called at each step, under the name ``task``; seconds: limit of time [s]; end: when it is over, by
    ``time.time``, which processes and machines have in common [s]; iterations: most of a solver; stop: a file that ends
    it.
    """

    progress: OnProgress | None = None
    task: str = "solve"
    seconds: float = math.inf
    end: float = math.inf
    iterations: int = 300  # as of ``Settings.max_iterations``
    stop: Path | None = None

    @classmethod
    def within(cls, seconds: float | None, progress: OnProgress | None = None, iterations: int = 300) -> Control:
        """The control of work that begins now and may take so many ``seconds``, None: any, but no more than that in
        force has left; the others as the fields."""
        limit = math.inf if seconds is None else seconds
        control, outer = cls(progress, seconds=limit, end=time.time() + limit, iterations=iterations), _IN_FORCE.get()
        return (
            control
            if outer is None or control.end <= outer.end
            else replace(control, seconds=outer.seconds, end=outer.end)
        )

    def of(self, task: str) -> Control:
        """The same under the name of a ``task``."""
        return replace(self, task=task)

    @property
    def left(self) -> float:
        """Seconds until the limit of time, infinite without one."""
        return self.end - time.time()

    @property
    def out_of_time(self) -> OutOfTimeError:
        """What to raise beyond the limit of time."""
        return OutOfTimeError(f"the time limit of {self.seconds:g} s was reached")

    @property
    def stops(self) -> bool:
        """Whether the work is to stop: after Ctrl-C, beyond the limit of time, where the file is there."""
        return bool(INTERRUPTED.requested) or self.left < 0 or (self.stop is not None and self.stop.exists())

    def tell(self, number: int, **values: float) -> None:
        """Calls ``progress`` with the number of a step and its ``values``."""
        if self.progress:
            self.progress(Progress(self.task, number, values=values))

    @contextmanager
    def in_force(self) -> Iterator[None]:
        """Within this, ``check_time`` raises OutOfTimeError beyond the limit of time."""
        before = _IN_FORCE.set(self)
        try:
            yield
        finally:
            _IN_FORCE.reset(before)

    def note(self, event: Progress) -> None:
        """Passes an ``event`` on to ``progress``. Raises OutOfTimeError as ``check_time``."""
        if self.progress:
            self.progress(event)
        check_time()


_IN_FORCE: ContextVar[Control | None] = ContextVar("_IN_FORCE", default=None)


def check_time() -> None:
    """Raises OutOfTimeError where the time of the control in force is over."""
    control = _IN_FORCE.get()
    if control and control.left < 0:
        raise control.out_of_time


@contextmanager
def interrupts_noted(on_interrupt: Callable[[], None] | None = None) -> Iterator[None]:
    """Within this (in the main thread), Ctrl-C is noted instead of raised, so that a run is still written.

    The solver stops at its next iterate; whatever runs outside it is finished, but for what ``unless_interrupted``
    does. A second Ctrl-C is raised as usual. on_interrupt: called at the first Ctrl-C.
    """
    if threading.current_thread() is not threading.main_thread() or INTERRUPTED.active:
        yield
        return

    def note(*_: Any) -> None:
        if INTERRUPTED.requested:
            OBSERVER.told("ending")
            raise KeyboardInterrupt
        INTERRUPTED.requested = True
        OBSERVER.told("noted")
        if on_interrupt:
            on_interrupt()
        if INTERRUPTED.breaks:
            raise KeyboardInterrupt

    OBSERVER.told("held")  # first: it raises where a Ctrl-C before this was lost
    INTERRUPTED.active, INTERRUPTED.requested, INTERRUPTED.breaks = True, False, False
    previous, held_back = signal.signal(signal.SIGINT, note), False
    if hasattr(signal, "pthread_sigmask"):  # a process of ``fitting.parallel`` has it blocked, but for this
        held_back = signal.SIGINT in signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if held_back:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, previous)
        INTERRUPTED.active = False
        OBSERVER.told("released")


def unless_interrupted(work: Callable[[], Value]) -> Value | None:
    """The value of ``work``, or None where Ctrl-C was noted before its end, which is then not waited for.

    Outside ``interrupts_noted`` Ctrl-C is raised as usual.
    """
    if not INTERRUPTED.active:
        return work()
    if INTERRUPTED.requested:
        return None
    try:
        INTERRUPTED.breaks = True
        value = work()
    except BaseException:
        if not INTERRUPTED.requested:
            raise
        return None
    finally:
        INTERRUPTED.breaks = False
    return None if INTERRUPTED.requested else value


@contextmanager
def unbroken() -> Iterator[None]:
    """While it lasts, Ctrl-C is only noted: nothing is raised through a library of another language. It is afterwards,
    where ``unless_interrupted`` asks for it."""
    breaks, INTERRUPTED.breaks = INTERRUPTED.breaks, False
    try:
        yield
    finally:
        INTERRUPTED.breaks = breaks
    if breaks and INTERRUPTED.requested:
        raise KeyboardInterrupt


def left_out_message(names: Sequence[str]) -> Message:
    """What to say where Ctrl-C left out the parts ``names`` that follow an estimate."""
    words = f"interrupted, so these are missing: {', '.join(names)}; the same command with --resume makes them"
    return Message(words, LEFT_OUT)


class Made(dict[str, Any]):
    """Values of named parts of long work; seconds: that each took; missing: names of those that Ctrl-C left out."""

    def __init__(self) -> None:
        super().__init__()
        self.seconds: dict[str, float] = {}

    @property
    def missing(self) -> list[str]:
        return [name for name in self.seconds if name not in self]


def make_in_turn(parts: Mapping[str, Callable[[], Any]], made: Made) -> None:
    """Add the values of the ``parts`` by name to what is ``made``, one after the other, unless Ctrl-C came first.
    Raises OutOfTimeError as ``check_time``."""
    for name, part in parts.items():
        check_time()
        began = time.perf_counter()
        value = unless_interrupted(partial(_boxed, part))
        made.seconds[name] = time.perf_counter() - began  # also of a part that was left out: ``missing``
        if value is not None:
            made[name] = value[0]


def _boxed(part: Callable[[], Any]) -> tuple[Any]:
    return (part(),)  # None of a part is a value too
