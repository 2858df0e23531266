"""How contents are damaged: bytes, tokens, lines, numbers, and words of the reader in wrong places."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from functools import cache

TOKENS = (
    b"\0", b"\r", b"\n", b'"', b",", b"[", b"]", b"{", b"}", b"=", b"#", b":", b"/", b"'", b"nan", b"inf", b"-",
    b"1e300", b"1e-310", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[2J", b"../../evil", b"null", b"true", b"9" * 18,
    b"\xff" * 8, b"-1", b"0", b"1e400", b"0x10", b"\\u0000", b"\xc2\xb2", b"\xe2\x80\xae", b"CON",
)  # fmt: skip
"""What is put into contents beside single bytes."""
LARGE = (b"9" * 400, b"9" * 5000, b"[" * 3000, b"{" * 3000, b"a" * 70_000, b"," * 20_000, b"\n" * 20_000)
"""The same, seldom: each costs as much time as a hundred small ones."""
SELDOM = 0.01
FIRST = 0.8
"""How often a large token is taken, and the first seed."""


@cache
def _numbers(content: bytes) -> list[tuple[int, int]]:
    return [match.span() for match in re.finditer(rb"-?\d+\.?\d*(e-?\d+)?", content[:20_000])]


@cache
def _words(seeds: tuple[bytes, ...]) -> list[bytes]:
    """Words of the reader: those of its seeds."""
    return sorted({word for seed in seeds for word in re.findall(rb"[A-Za-z_][\w-]{0,30}", seed[:20_000])}) or [b"x"]


def damaged(draw: random.Random, seeds: Sequence[bytes]) -> bytes:
    """One of the ``seeds``, mostly the first, with one to four damages that ``draw`` chooses."""
    seeds = tuple(seeds)
    pristine = content = seeds[0] if draw.random() < FIRST else draw.choice(seeds)
    for _ in range(draw.randint(1, 4)):
        at = int(draw.random() * (len(content) + 1))
        token = draw.choice(LARGE if draw.random() < SELDOM else TOKENS)
        kind = draw.randrange(9)
        if kind == 0:
            content = content[:at]
        elif kind == 1:
            content = content[:at] + bytes([draw.randrange(256)]) + content[at + 1 :]
        elif kind == 2:
            content = content[:at] + content[at + draw.randint(1, 40) :]
        elif kind == 3:
            content = content[:at] + token + content[at:]
        elif kind == 4:
            content = content[: at + draw.randint(1, 200)] + content[at:]
        elif kind == 5 and (spans := _numbers(pristine)):
            first, last = draw.choice(spans)
            content = content[:first] + token + content[last:]
        elif kind == 6:
            content = content[:at] + draw.choice(_words(seeds)) + content[at + draw.randint(0, 8) :]
        elif kind == 7:
            lines = content.split(b"\n")
            lines.insert(draw.randrange(len(lines)), lines.pop(draw.randrange(len(lines))))
            content = b"\n".join(lines)
        else:
            head = int(draw.random() * (min(len(content), 400) + 1))
            content = content[:head] + token + content[head + 1 :]
    return content


def numbered(name: str, number: int, seeds: Sequence[bytes]) -> bytes:
    """The damaged content with this ``number`` for the reader ``name`` with these ``seeds``."""
    return damaged(random.Random(f"{name} {number}"), seeds)
