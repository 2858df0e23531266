"""Ctrl-C during long work: the first asks it to stop at the next safe point, the second ends it."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, TypeVar

from mmg.messages import Message

LEFT_OUT = "parts_left_out"
"""Code of the warning that Ctrl-C left out parts of a calibration, which can be made by resuming it."""
Value = TypeVar("Value")

INTERRUPTED = SimpleNamespace(active=False, requested=False, breaks=False, finishing=False)
"""Whether Ctrl-C is being held (active), has been pressed since (requested), is raised all the same (breaks), and does
not stop a solver because it came before the last step began (finishing)."""

OBSERVER = SimpleNamespace(told=lambda word: None)
"""told: called with "held" and "released" when Ctrl-C begins and ends to be held, with "noted" when it is pressed, with
"ending" when it ends all."""


@contextmanager
def interrupts_noted(on_interrupt: Callable[[], None] | None = None) -> Iterator[None]:
    """Within this (in the main thread), Ctrl-C is noted instead of raised, so that a run is still written.

    The solver stops at its next iterate; whatever runs outside it is finished, but for what ``unless_interrupted``
    does. A second Ctrl-C is raised as usual.
    In a process of ``fitting.parallel``, which holds Ctrl-C back, it is let through while this is active.
    on_interrupt: called at the first Ctrl-C.
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

    INTERRUPTED.active, INTERRUPTED.requested, INTERRUPTED.breaks = True, False, False
    previous, held_back = signal.signal(signal.SIGINT, note), False
    OBSERVER.told("held")
    if hasattr(signal, "pthread_sigmask"):
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


@contextmanager
def finishing() -> Iterator[None]:
    """While it lasts, a solver is not stopped by a Ctrl-C that was noted before: for the short end of what is already
    there. The next one ends all, as usual."""
    before, INTERRUPTED.finishing = INTERRUPTED.finishing, INTERRUPTED.requested
    try:
        yield
    finally:
        INTERRUPTED.finishing = before


class Later:
    """What follows the estimate, unless Ctrl-C is pressed; left_out: what it left out, as a warning; seconds: that each
    part took, by name."""

    def __init__(self) -> None:
        self.missing: list[str] = []
        self.seconds: dict[str, float] = {}

    def made(self, name: str, work: Callable[[], Value], otherwise: Value) -> Value:
        """The value of ``work``, or ``otherwise`` where Ctrl-C came first; name: what it makes, in words."""
        began = time.perf_counter()
        value = unless_interrupted(lambda: (work(),))
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began
        if value is None:
            self.missing = [*dict.fromkeys([*self.missing, name])]
            return otherwise
        return value[0]

    @property
    def left_out(self) -> list[Message]:
        """A warning, if something was left out."""
        return [left_out_message(self.missing)] if self.missing else []


def left_out_message(names: Sequence[str]) -> Message:
    """What to say where Ctrl-C left out the parts ``names`` that follow an estimate."""
    words = f"interrupted, so these are missing: {', '.join(names)}; the same command with --resume makes them"
    return Message(words, LEFT_OUT)
