"""Ctrl-C during long work: the first asks it to stop at the next safe point, the second ends it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


class Interrupts:
    """While active (in the main thread), Ctrl-C is noted instead of raised, so that a run is still written.

    The solver stops at its next iterate; whatever runs outside it is finished. A second Ctrl-C is raised as usual.
    In a process of ``fitting.parallel``, which holds Ctrl-C back, it is let through while this is active.
    on_interrupt: called at the first Ctrl-C.
    """

    def __init__(self, on_interrupt: Callable[[], None] | None = None) -> None:
        self.on_interrupt = on_interrupt
        self.previous: Any = None
        self.nested = False
        self.held_back = False

    def __enter__(self) -> None:
        self.nested = threading.current_thread() is not threading.main_thread() or INTERRUPTED.active
        if not self.nested:
            INTERRUPTED.active, INTERRUPTED.requested = True, False
            self.previous = signal.signal(signal.SIGINT, self._note)
            if hasattr(signal, "pthread_sigmask"):
                self.held_back = signal.SIGINT in signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

    def _note(self, *_: Any) -> None:
        if INTERRUPTED.requested:
            raise KeyboardInterrupt
        INTERRUPTED.requested = True
        if self.on_interrupt:
            self.on_interrupt()

    def __exit__(self, *_: Any) -> None:
        if not self.nested:
            if self.held_back:
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            signal.signal(signal.SIGINT, self.previous)
            INTERRUPTED.active = False


@dataclass
class _Interrupted:
    """Whether Ctrl-C is being held (active) and has been pressed since (requested)."""

    active: bool = False
    requested: bool = False


INTERRUPTED = _Interrupted()
