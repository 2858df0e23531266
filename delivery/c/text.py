"""Words and tables of a product as C: strings, comments, arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

LONGEST_STRING = 4000
"""Most bytes of a string constant: C99 promises 4095."""


def quoted(text: str, most: int = LONGEST_STRING) -> str:
    """C string constant of ``text`` in UTF-8, of which at most ``most`` bytes are kept."""
    content = text.encode()[:most]
    plain = {ord('"'): '\\"', ord("\\"): "\\\\", ord("?"): "\\?", ord("\n"): "\\n"}
    return '"' + "".join(plain.get(b) or (chr(b) if 32 <= b < 127 else f"\\{b:03o}") for b in content) + '"'


def comment(lines: Iterable[str]) -> str:
    """C comment of these ``lines``: characters that are not ASCII become ?, and nothing in them ends it early."""
    safe = [line.encode("ascii", "replace").decode().replace("*/", "* /").replace("/*", "/ *") for line in lines]
    safe = [line.replace("??", "? ?").rstrip("\\").rstrip() for line in safe]
    return "/* " + "\n * ".join(safe) + "\n */\n"


def number(value: float | None) -> str:
    """C text of the double ``value``; unknown (None) is -1, an infinite one DBL_MAX."""
    if value is None or math.isnan(value):
        return "-1.0"
    if math.isinf(value):
        return "DBL_MAX" if value > 0 else "-DBL_MAX"
    return repr(float(value))


def rows(values: Sequence[str]) -> str:
    """The ``values`` between braces, one a line."""
    return "{\n  " + ",\n  ".join(values) + "}"
