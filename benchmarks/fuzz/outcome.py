"""What happens to an input: read, refused in one line, or something that must not be."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from benchmarks.fuzz.readers import Reader
from mmg.errors import LONGEST, UserError

SLOW = 5.0
"""Seconds of processor after which a reader counts as hung."""


@contextmanager
def strict_warnings() -> Iterator[None]:
    """Within it a RuntimeWarning, such as those of numpy, is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def outcome(reader: Reader, content: bytes) -> tuple[str, float]:
    """ "read", "refused" or what else happened, in words, when ``reader`` meets ``content``; and seconds."""
    began = time.process_time()
    try:
        reader.read(content)
        result = "read"
    except UserError as error:
        words = str(error)
        good = "\n" not in words and 0 < len(words) <= LONGEST
        result = "refused" if good else f"an error of {len(words)} characters in {words.count(chr(10)) + 1} lines"
    except Exception as error:
        result = f"{type(error).__name__}: {' '.join(str(error).split())[:100]}"
    seconds = time.process_time() - began
    return (result if seconds < SLOW else f"took {seconds:.0f} s"), seconds
