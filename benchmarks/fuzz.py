"""Damaged files for every reader: only the project's own error may come out, soon and in one line.

python -m benchmarks.fuzz --inputs N --seed S [--reader NAME]: N damaged inputs per reader; prints a table of counts and
each unexpected outcome with the number by which it can be made again (``--inputs 1 --seed THAT``).
"""

from __future__ import annotations

import argparse
import contextlib
import random
import re
import resource
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from cases.checks import check
from cases.io.controls import read_controls
from cases.io.read import read_trial
from cases.io.site import read_site
from cases.shipfiles.network_file import NETWORK, save_network
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from fitting.nlp.captive import read_captive
from fitting.pipeline import FitOptions, calibrate
from fitting.report.run_folder import ITERATE, RESULT
from fitting.result import read_fit
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.network import Layers, Network, features_of

SLOW = 5.0
"""Seconds after which a reader counts as hung."""
TOKENS = (
    b"\0", b"\r", b"\n", b'"', b",", b"[", b"]", b"{", b"}", b"=", b"#", b"nan", b"inf", b"-", b"1e300", b"1e-310",
    b"9" * 400, b"9" * 5000, b"[" * 3000, b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[2J", b"../../evil", b"null", b"true",
    b"999999999999999999", b"\xff" * 8, b"a" * 70_000,
)  # fmt: skip
"""What is put into files beside single bytes."""
REPRODUCERS: dict[str, tuple[bytes, ...]] = {
    "trial": (b"", b"\n", b"\r", b'"', b"t [s]\n", b"x" * 140_000, b",".join([b"c"] * 100_000), b"\xff\xfet\0 \0"),
    "parquet": (b"PAR1", b"PAR1PAR1", b"PAR1" + b"\xff" * 8 + b"PAR1"),
    "sidecar": (
        b"[default]\nreference_point = {x = nan}", b"[default]\nreference_point = {x = 1e300}", b"a = " + b"[" * 3000,
        b"[default]\nname = '../../evil'", b"a = " + b"9" * 5000, b"\xff\xfe[\0", b"\xef\xbb\xbf[default]\n",
    ),
    "site": (b"[bank]\ny = nan", b"[water]\ndepth = -1", b"[bank]\ny = " + b"9" * 4000),
    "ship": (b"[ship]", b"[ship]\nL = 1e300\n[model]\nhull = 'unified'", b"[ship]\nname = '../../evil'\n[model]\n"),
    "result": (
        b"[]", b'"x"', b"{}", b"[" * 200_000, b'{"converged": true}', b'{"kind": "calibration"}', b"NaN",
        b'{"kind": "calibration", "schema_version": 1, "objective": ' + b"9" * 400 + b"}",
    ),
    "iterate": (b"", b"\xff" * 8, b"\x02\0\0\0\0\0\0\0{}"),
    "network": (b"", b"\xff" * 8, b"\x02\0\0\0\0\0\0\0{}"),
    "captive": (b"u [m/s]\n1\n", b"u [m/s],v [m/s],r [rad/s],n [rps],delta [rad],X [N],Y [N],N [N m]\n1,1,1,1,1,,,\n"),
}  # fmt: skip
"""Inputs that once did harm, or are the least of their kind, by reader."""


@dataclass(frozen=True)
class Reader:
    """One reader. path: of the file that is damaged; read: what reads it; seeds: good and harmful contents."""

    path: Path
    read: Callable[[], object]
    seeds: tuple[bytes, ...]


def readers(folder: Path) -> dict[str, Reader]:
    """All readers by name, on good files that are made in ``folder``."""
    folder.mkdir(exist_ok=True)
    ship, runs = load_ship("esso_osaka_3m"), demo_trials(1, dt=0.5)[0]
    found: dict[str, Reader] = {}

    def add(name: str, path: Path, read: Callable[[], object]) -> None:
        path.parent.mkdir(exist_ok=True)
        seeds = (path.read_bytes(),) if path.exists() else ()
        found[name] = Reader(path, read, (*seeds, *REPRODUCERS[name]))

    for name, file in (("trial", "a.csv"), ("parquet", "b.parquet"), ("sidecar", "side.csv")):
        path = folder / name / file
        path.parent.mkdir()
        write_trial(runs[0], path)
        target = path.with_name("trials.toml") if name == "sidecar" else path
        add(name, target, partial(_read_both, path))
    (folder / "sidecar" / "trials.toml").write_text(_SIDECAR, encoding="utf-8")
    add("sidecar", folder / "sidecar" / "trials.toml", found["sidecar"].read)
    (folder / "site.toml").write_text(_SITE, encoding="utf-8")
    add("site", folder / "site.toml", lambda: read_site([], ship, folder / "site.toml"))
    (folder / "ship.toml").write_text(dump_ship(ship), encoding="utf-8")
    add("ship", folder / "ship.toml", lambda: load_ship(folder / "ship.toml"))
    run = folder / "run"
    few = ship.fixing([s for s in ship.symbols if s not in ("X_0F", "Y_v")])
    options = FitOptions(next_trial=False, instruments=())
    calibrate(few, runs[:1], (), Settings(passes=1, max_iterations=2), options).save(run)
    for name, file in (("result", RESULT), ("iterate", ITERATE)):
        add(name, run / file, lambda: read_fit(run))
    hybrid = folder / "hybrid"
    hybrid.mkdir()
    (hybrid / "ship.toml").write_text(dump_ship(ship), encoding="utf-8")
    save_network(hybrid / NETWORK, _network(features_of(ship.actuators)), ship)
    add("network", hybrid / NETWORK, lambda: load_ship(hybrid))
    (folder / "captive.csv").write_text(_CAPTIVE, encoding="utf-8")
    add("captive", folder / "captive.csv", lambda: read_captive(folder / "captive.csv"))
    return found


_SIDECAR = """[default]
kind = "zigzag"
reference_point = { x = 1.2, y = 0.0, applies_to = "both" }
units = { u = "m/s" }
sign = { r = -1 }
[files."side.csv"]
name = "first"
role = "train"
"""
_SITE = '[bank]\ny = -6.0\nwater_side = "greater"\n[shelf]\nx = 10.0\nshallow_side = "greater"\n[water]\ndepth = 2.0\n'
_CAPTIVE = "u [m/s],v [m/s],r [rad/s],n [rps],delta [rad],X [N],Y [N],N [N m]\n0.3,0,0,9,0.1,1,2,3\n0.2,0,0,8,0,1,,1\n"


def _network(features: Sequence[str]) -> Network:
    F, rng = len(features), np.random.default_rng(0)
    layers = Layers((rng.normal(size=(4, F)), rng.normal(size=(3, 4))), (rng.normal(size=4),))
    return Network(tuple(features), np.ones(F), (layers,), np.ones(3), -np.ones(F), np.ones(F))


def _read_both(path: Path) -> None:
    """A file as inputs of a simulation, and as a trial with its checks. Raises UserError where it is no trial."""
    with contextlib.suppress(UserError):
        read_controls(path)
    check([read_trial(path)])


@cache
def _numbers(content: bytes) -> list[tuple[int, int]]:
    return [match.span() for match in re.finditer(rb"-?\d+\.?\d*(e-?\d+)?", content[:20_000])]


def damaged(draw: random.Random, seeds: Sequence[bytes]) -> bytes:
    """One of the ``seeds``, mostly the first, with one to four damages that ``draw`` chooses."""
    content = seeds[0] if draw.random() < 0.8 else draw.choice(seeds)
    for _ in range(draw.randint(1, 4)):
        at, token = draw.randint(0, len(content)), draw.choice(TOKENS)
        kind = draw.randint(0, 6)
        if kind == 0:
            content = content[:at]
        elif kind == 1:
            content = content[:at] + bytes([draw.randint(0, 255)]) + content[at + 1 :]
        elif kind == 2:
            content = content[:at] + content[at + draw.randint(1, 40) :]
        elif kind == 3:
            content = content[:at] + token + content[at:]
        elif kind == 4:
            end = at + draw.randint(1, 200)
            content = content[:end] + content[at:]
        elif kind == 5 and (spans := _numbers(content)):
            first, last = draw.choice(spans)
            content = content[:first] + token + content[last:]
        else:
            head = draw.randint(0, min(len(content), 400))
            content = content[:head] + token + content[head + 1 :]
    return content


def outcome(reader: Reader, content: bytes) -> tuple[str, float]:
    """ "read", "refused" or what else happened, in words, when ``reader`` meets ``content``; and seconds."""
    reader.path.write_bytes(content)
    began = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            reader.read()
        result = "read"
    except UserError as error:
        result = "refused" if "\n" not in str(error) and len(str(error)) < 5000 else f"{len(str(error))} characters"
    except Exception as error:
        result = f"{type(error).__name__}: {str(error)[:100]}"
    seconds = time.perf_counter() - began
    return (result if seconds < SLOW else f"took {seconds:.0f} s"), seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", choices=sorted(REPRODUCERS))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        print("| reader | inputs | read | refused | unexpected | slowest [s] |\n|---|---|---|---|---|---|")
        for name, reader in readers(Path(scratch) / "fuzz").items():
            if given.reader in (None, name):
                _report(name, reader, range(given.seed, given.seed + given.inputs))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory {peak:.0f} MB")


def _report(name: str, reader: Reader, numbers: Sequence[int]) -> None:
    counts, longest = {"read": 0, "refused": 0}, 0.0
    strange: dict[str, int] = {}
    for number in numbers:
        words, seconds = outcome(reader, damaged(random.Random(f"{name} {number}"), reader.seeds))
        longest = max(longest, seconds)
        if words in counts:
            counts[words] += 1
        else:
            strange.setdefault(words, number)
    reader.path.write_bytes(reader.seeds[0])
    rest = len(numbers) - sum(counts.values())
    print(f"| {name} | {len(numbers)} | {counts['read']} | {counts['refused']} | {rest} | {longest:.2f} |", flush=True)
    for words, number in strange.items():
        print(f"{name}, --seed {number}: {words}", flush=True)


def reproducers() -> Iterator[tuple[str, bytes]]:
    """Every one of ``REPRODUCERS``: reader, content."""
    return ((name, content) for name, contents in REPRODUCERS.items() for content in contents)


if __name__ == "__main__":
    main()
