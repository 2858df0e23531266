"""A limit of time within which a diagnosis must end: looked at between the steps of its fits."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from mmg.errors import UserError
from mmg.progress import OnProgress, Progress

_END: ContextVar[tuple[float, float]] = ContextVar("_END", default=(float("inf"), float("inf")))


class OutOfTimeError(UserError):
    """The time limit was reached."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Within this, ``check_time`` raises OutOfTimeError after so many ``seconds``; None: never."""
    if seconds is None:
        yield
        return
    before = _END.set((time.monotonic() + seconds, seconds))
    try:
        yield
    finally:
        _END.reset(before)


def check_time() -> None:
    """Raises OutOfTimeError where the time of the innermost ``time_limit`` is over."""
    end, seconds = _END.get()
    if time.monotonic() > end:
        raise OutOfTimeError(f"the time limit of {seconds:g} s was reached")


def timed(progress: OnProgress | None) -> OnProgress:
    """What calls ``progress`` with each event, and raises OutOfTimeError where the time is over."""

    def note(event: Progress) -> None:
        if progress is not None:
            progress(event)
        check_time()

    return note
