"""Ctrl-C during long work: the first asks it to stop at the next safe point, the second ends it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

INTERRUPTED = SimpleNamespace(active=False, requested=False)
"""Whether Ctrl-C is being held (active) and has been pressed since (requested)."""


@contextmanager
def interrupts_noted(on_interrupt: Callable[[], None] | None = None) -> Iterator[None]:
    """Within this (in the main thread), Ctrl-C is noted instead of raised, so that a run is still written.

    The solver stops at its next iterate; whatever runs outside it is finished. A second Ctrl-C is raised as usual.
    In a process of ``fitting.parallel``, which holds Ctrl-C back, it is let through while this is active.
    on_interrupt: called at the first Ctrl-C.
    """
    if threading.current_thread() is not threading.main_thread() or INTERRUPTED.active:
        yield
        return

    def note(*_: Any) -> None:
        if INTERRUPTED.requested:
            raise KeyboardInterrupt
        INTERRUPTED.requested = True
        if on_interrupt:
            on_interrupt()

    INTERRUPTED.active, INTERRUPTED.requested = True, False
    previous, held_back = signal.signal(signal.SIGINT, note), False
    if hasattr(signal, "pthread_sigmask"):
        held_back = signal.SIGINT in signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if held_back:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, previous)
        INTERRUPTED.active = False
