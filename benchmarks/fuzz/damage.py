"""How contents are damaged: bytes, tokens, lines, numbers, words of the reader in wrong places; what once did harm."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator, Sequence
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


# Inputs that once did harm, or are the least of their kind, by reader

_TABLES = (b"", b"\n", b"\r", b'"', b"t [s]\n", b"x" * 140_000, b",".join([b"c"] * 100_000), b"\xff\xfet\0 \0")
_SAFETENSORS = (b"", b"\xff" * 8, b"\x02\0\0\0\0\0\0\0{}")
_RESULTS = (b"[]", b'"x"', b"{}", b"[" * 200_000, b'{"converged": true}', b"NaN", b"\xff\xfe{\0}\0", b'{"kind": 1}')
_TOML = (b"a = " + b"[" * 3000, b"a = " + b"9" * 5000, b"\xff\xfe[\0", b"\xef\xbb\xbf[default]\n", b"a = 1e400")
_HEAD = b"t [s],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad]\n"
_CONTROLS = b"t [s],n [rps],delta [rad]\n"

REPRODUCERS: dict[str, tuple[bytes, ...]] = {
    "trial": (
        *_TABLES, _HEAD + b"1e-310,0,1,0,0,1,0\n2e-310,0,1,0,0,1,0\n", _HEAD + b"0,0,1,0,0,1,0\n1e300,0,1,0,0,1,0\n",
        _HEAD + b"0,0,1,0,0,1,0\n1," + b"9" * 400 + b",1,0,0,1,0\n", _HEAD.replace(b"psi", b"\x1b[2J\x1b]0;x\x07psi"),
        _HEAD.replace(b"\n", b"\r") + b"0,0,1,0,0,1,0\r1,0,1,0,0,1,0\r",
        _HEAD + b"0,0,1,0,0,1," + b"7" * 130_000 + b"\n",
    ),
    "controls": (*_TABLES, _CONTROLS + b"0,1,0\n", _CONTROLS + b"0,1,0\n1,,\n", _CONTROLS + b"0,,\n1,1,0\n"),
    "parquet": (b"PAR1", b"PAR1PAR1", b"PAR1" + b"\xff" * 8 + b"PAR1"),
    "sidecar": (
        b"[default]\nreference_point = {x = nan}", b"[default]\nreference_point = {x = 1e300}",
        b"[default]\nname = '../../evil'", *_TOML,
    ),
    "site": (b"[bank]\ny = nan", b"[water]\ndepth = -1", b"[bank]\ny = " + b"9" * 4000, *_TOML),
    "ship": (
        b"[ship]", b"[ship]\nL = 1e300\n[model]\nhull = 'unified'", b"[ship]\nname = '../../evil'\n[model]\n", *_TOML,
    ),
    "fit": (
        *_RESULTS, b'{"kind": "calibration"}',
        b'{"kind": "calibration", "schema_version": 1, "objective": ' + b"9" * 400 + b"}",
    ),
    "training": (
        *_RESULTS, b'{"kind": "training"}', b'{"kind": "training", "model": "hybrid", "decision": []}',
        b'{"kind": "training", "model": "fnn", "settings": {"curriculum": 1}}',
    ),
    "diagnosis": (*_RESULTS, b'{"schema_version": 1}', b'{"schema_version": 1, "verdict": "named"}'),
    "iterate": _SAFETENSORS,
    "network": _SAFETENSORS,
    "black_box": _SAFETENSORS,
    "captive": (
        b"u [m/s]\n1\n", *_TABLES,
        b"u [m/s],v [m/s],r [rad/s],n [rps],delta [rad],X [N],Y [N],N [N m]\n1,1,1,1,1,,,\n",
    ),
    "log": (*_TABLES, b"t;x\n1;2\n", b"t;psi;n;delta\n" + b"1e308;1e308;1;1\n" * 12, b"t,psi\n" + b"nan,inf\n" * 12),
    "long_log": (*_TABLES, b"t;x\n1;2\n", b"t,psi\n" + b"nan,inf\n" * 12, b"t;psi\n#1;2\n" + b"1;2\n" * 30 + b"0;2\n"),
    "nmea": (b"$GPRMC", b"$GPRMC," + b"9" * 5000, b"$" * 3000, b"!AIVDM,1,1,,A,\xff*00\n"),
    "robot_bag": (b"#ROSBAG V2.0\n", b"#ROSBAG V2.0\n" + b"\xff" * 40),
    "robot_mcap": (b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + b"\xff" * 40),
    "can_bus": (b"(1.0) can0 09F8010A#FF\n" * 5, b"(1.0) can0 09F11223#0102FF7F0000FFFC\n" * 4, b"<0x18> [1] 05\n" * 4),
    "canboat": (b'{"pgn": 1}\n' * 4, b'{"pgn": 127250, "src": 1, "timestamp": "x", "fields": {}}\n' * 4),
    "signal_k": (b'{"updates": 1}\n' * 3, b'{"updates": [[]]}\n' * 3, b"[" * 90_000),
    "iso19848": (b'{"Package": 1}', b'{"Package": {"TimeSeriesData": [[]]}}', b'{"Package": ' + b"[" * 90_000),
    "matlab": (b"MATLAB 5.0 MAT-file", b"MATLAB 5.0 MAT-file" + b"\xff" * 200),
    "hdf5": (b"\x89HDF\r\n\x1a\n", b"\x89HDF\r\n\x1a\n" + b"\xff" * 100),
    "long_table": (b"time,name,value\n1,2,3\n", b"time,name,value,unit\n" + b"1,psi,0.1,rad\n1,psi,0.2,deg\n" * 12),
    "import_map": (b"origin = [nan, 1e300]", b"step = nan", b"[columns]\nt = 1", b"sentinels = [1e400]", *_TOML),
    "groups": (
        b"", b"day", b"30-Feb-2020", b"99999999", b"2020-13-01", b"0000-00-00", "٢٠٢٠-٠١-٠١".encode(), b"\0",
        b"a" * 70_000,
    ),
    "effect": (
        b"", b":", b"current:x=nan", b"current:x=1e400", b"current:x=" + b"9" * 5000, b"current:x", b"\0:\x1b[2J",
        b"current\n:x=2",
    ),
    "maneuver": (
        b"", b":", b"turning:nan", b"random:" + b"9" * 5000, "random:٣".encode(), "random:²".encode(), b"random:-1",
        b"zigzag:1e-300/1e300", b"spiral:15/1e-9", b"spiral:15/1e-310", b"spiral:15/5e-324", b"crash-stop:inf",
    ),
    "wind": (b"", b":", b"nan:nan", b"1e308:1e308", b"1:60:gusty:gusty", b"-0:inf", b"5:" + b"9" * 5000),
}  # fmt: skip
"""Reader -> contents."""


def reproducers() -> Iterator[tuple[str, bytes]]:
    """Every one of ``REPRODUCERS``: reader, content."""
    return ((name, content) for name, contents in REPRODUCERS.items() for content in contents)
