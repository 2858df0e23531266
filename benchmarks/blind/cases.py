"""Cases of the blind benchmark: generated and sealed, answered without their key, opened, and scored."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.generator.world import WORLDS
from benchmarks.blind.generator.write import generate
from benchmarks.record import Figure, table
from cases.io.read import read_trials
from cases.io.site import read_site
from cases.shipfiles.ship_file import load_ship
from diagnosis.diagnose import diagnose
from diagnosis.estimation.candidates import FITTED_ALONG
from diagnosis.findings import Findings
from mmg.errors import UserError
from mmg.ship import Ship

PRIOR, LEAST = 0.08, 1e-5
"""Prior standard deviation of the ship's coefficients: this share of their value, at least ``LEAST``."""
FOREIGN = "strangers"
"""Kind of the cases with a cause that the library does not hold."""


@dataclass(frozen=True)
class Case:
    """An opened case: world, kind, folder; truth: parameters of the hidden effects that the library holds; label: all
    of them in words; strength."""

    world: str
    kind: str
    folder: Path
    truth: dict[str, dict[str, float]]
    label: str
    strength: str


@cache
def blind_ship(name: str = "esso_osaka_3m") -> Ship:
    """The ship as the diagnosis gets it: nominal coefficients, each known to 8 %."""
    ship = load_ship(name)
    rows = {s: ship.coefficients[s] for s in ship.free}
    return ship.with_coefficients({s: c.with_(std=max(PRIOR * abs(c.value), LEAST)) for s, c in rows.items()})


def dealt(folder: Path, world: str, kind: str, count: int, seed: int) -> str:
    """Generate ``count`` cases of a ``kind`` in ``folder``, unless they are there; returns the SHA-256 of their key."""
    if not (folder / "key.json").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        return generate(folder, count, seed, kind, WORLDS[world])
    return hashlib.sha256((folder / "key.json").read_bytes()).hexdigest()


def folders(folder: Path) -> list[Path]:
    """The case folders of a benchmark, in order."""
    return sorted(p for p in folder.glob("case_*") if p.is_dir())


def opened(folder: Path, digest: str) -> list[Case]:
    """The cases of a ``folder``. UserError unless its key, and all files that this commits to, are those of the
    ``digest``."""
    content = (folder / "key.json").read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise UserError(f"{folder / 'key.json'} is not the key whose hash was printed ({digest}): nothing is scored")
    key, found = json.loads(content), []
    for entry in key["cases"]:
        case = folder / entry["case"]
        for name, wanted in entry["sha256"].items():
            path = case / name
            if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != wanted:
                raise UserError(f"{path} was changed after the key was sealed: nothing is scored")
        effects = entry["effects"]
        truth = {e["name"]: e["parameters"] for e in effects if key["kind"] != FOREIGN}
        label, strength = " + ".join(e["name"] for e in effects), effects[0]["strength"] if effects else ""
        found.append(Case(key["world"], key["kind"], case, truth, label, strength))
    return found


def question(case: Path) -> Callable[[], Findings]:
    """The diagnosis of a ``case``: of its folders ``train`` and ``test`` and perhaps ``site.toml``, and no key."""
    ship = blind_ship(json.loads((case.parent / "ship.json").read_text(encoding="utf-8"))["ship"])
    site, (train, test) = read_site([case], ship), (read_trials(case / part) for part in ("train", "test"))
    return partial(diagnose, ship, train, test, site)


def answer(ask: Callable[[], Findings]) -> tuple[str, list[str], bool, dict[str, Any]]:
    """Verdict, names, remainder and evidence of a diagnosis; the verdict "error" where it fails, in any way.

    An instrument that was found to be off counts as a name, but for what is fitted along in any case."""
    try:
        found = ask()
    except Exception as error:  # a wrong answer, and the other cases go on
        return "error", [], False, {"error": f"{type(error).__name__}: {error}"}
    evidence = {
        "candidates": [[c.name, c.delta_bic, c.p_value, c.score] for c in found.candidates if c.delta_bic is not None],
        "unnamed": dict(found.unnamed),
    }
    off = [f.name for f in found.instruments if f.name not in FITTED_ALONG]
    names = [e.name for e in found.effects] + off
    verdict = "named" if off and found.verdict == "none" else found.verdict
    return verdict, names, bool(found.remainder), evidence


def answered(case: Path) -> dict[str, Any]:
    """The row of a record with the answer to a ``case``, and what led to it."""
    used = time.process_time()
    *said, evidence = answer(question(case))
    return {"answer": said, "evidence": evidence, "processor": round(time.process_time() - used, 1)}


# What the answers to opened cases got right: counts by kind and strength, and the misses
STRENGTHS = ("weak", "medium", "strong")
Answer = Sequence[Any]
"""Verdict, names, whether something is left over."""
Pair = tuple[Case, Mapping[str, Any]]
"""A case, and the row of its answer."""
KINDS = {"null": "nothing there: none", FOREIGN: "a cause without a name: unknown or a remainder",
         "pair": "two effects: both named, nothing else", "library": "an effect: named"}  # fmt: skip
"""What each kind is to be answered."""
ANCHORS = {FOREIGN: "foreign"}
"""Words of the anchors of figures where they are not the kind."""


def is_right(kind: str, truth: Sequence[str], answer: Answer) -> bool:
    """Whether an ``answer`` is as it should be: nothing said of nothing, something without a name seen of a stranger,
    both of a pair, else the first name that of the truth."""
    verdict, names, left = answer
    if kind == "null":
        return bool(verdict == "none")
    if kind == FOREIGN:
        return verdict == "unknown" or (verdict == "named" and left)
    return verdict == "named" and (set(names) == set(truth) if kind == "pair" else names[0] in truth)


def is_wrong(kind: str, truth: Sequence[str], answer: Answer) -> bool:
    """Whether a name that is not there is given with nothing left over."""
    verdict, names, left = answer
    return verdict == "named" and not left and names[0] not in truth


def right(pair: Pair) -> bool:
    """Whether a case is answered as it should be."""
    return is_right(pair[0].kind, tuple(pair[0].truth), pair[1]["answer"])


def wrong(pair: Pair) -> bool:
    """Whether a case is given a name that is not there."""
    return is_wrong(pair[0].kind, tuple(pair[0].truth), pair[1]["answer"])


def misses(pairs: Sequence[Pair]) -> list[str]:
    """A table of the cases that were not answered as they should be."""
    lines = []
    for case, row in (p for p in pairs if not right(p)):
        verdict, names, left = row["answer"]
        said = " + ".join(names) + (" and more" if left else "") if names else verdict
        first = " > ".join(c[0] for c in row["evidence"].get("candidates", [])[:3])
        lines.append([case.folder.name, case.kind, case.label, case.strength, said, first])
    return (
        table(["case", "kind", "truth", "strength", "answer", "first three candidates"], lines) if lines else ["none"]
    )


def scored(pairs: Sequence[Pair], name: str) -> list[str]:
    """The score of the world ``name`` in markdown: how long it took, the counts, and the misses."""
    spent = [row["processor"] for _, row in pairs]
    rows = [[f.what, f"{f.value:g} of {f.of}"] for f in figures(pairs, name).values()]
    rows += [["failed", f"{sum(row['answer'][0] == 'error' for _, row in pairs)} of {len(pairs)}"]]
    head = f"{len(pairs)} cases; seconds of processor per case: median {np.median(spent):.0f}, most {max(spent):.0f}."
    return [head, "", *table(["measure", "count"], rows), "", "Not answered as they should be:", "", *misses(pairs)]


def figures(pairs: Sequence[Pair], name: str) -> dict[str, Figure]:
    """Figures for the record, their anchors ending with ``name``: what each kind is to be answered."""
    made = {}
    for kind, words in KINDS.items():
        some = [p for p in pairs if kind == p[0].kind]
        for strength in STRENGTHS if kind == "library" else ("",):
            part = [p for p in some if strength in ("", p[0].strength)]
            if part:
                mark = "_".join(word for word in ("blind", ANCHORS.get(kind, kind), strength, name) if word)
                what = f"blind cases, {name}: {strength + ' ' if strength else ''}{words}"
                made[mark] = Figure(what, sum(map(right, part)), of=len(part))
    what = f"blind cases, {name}: a name that is not there"
    return made | {f"blind_wrong_{name}": Figure(what, sum(map(wrong, pairs)), of=len(pairs))}
