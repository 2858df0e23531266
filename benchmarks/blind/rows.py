"""Cases with their truth and their answer, and what an answer got right.

``sealed/case_*.json`` holds the floor: the error of the true model, with its hidden effects and real actuators, over
30 s windows that begin every 30 s at the *true* state, without the random force. The diagnosis measures windows that
begin every 15 s at the *logged* row, whose noise makes its number 1.2 to 2.6 times greater for the true model too, so
closure by the floor is a bound from below. It counts what is handed over: an error stays as it was unless the verdict
is "named".
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SAME = 6.0
"""Candidates within this of the best in BIC form the equivalence class where nothing is named."""
GAP = 1.15
"""Error before / floor above which there is a gap to close."""
Z90 = 1.645
MISFIT = "misfit"


class Refused(Exception):
    """The key or what it commits to is not what it was when the hash was printed."""


@dataclass(frozen=True)
class Row:
    """A case: its truth from the key (effects that the library holds: name -> parameters), its answer, its floor.

    label: the truth in words; floor: the sealed one.
    """

    case: str
    kind: str
    label: str
    strength: str
    truth: Mapping[str, Mapping[str, float]]
    answer: Mapping[str, Any]
    floor: float

    @property
    def verdict(self) -> str:
        return "error" if "error" in self.answer else self.answer["verdict"]

    @property
    def named(self) -> tuple[str, ...]:
        return tuple(e["name"] for e in self.answer["effects"]) if self.verdict == "named" else ()

    @property
    def ranking(self) -> list[Mapping[str, Any]]:
        return [] if self.verdict == "error" else list(self.answer["candidates"])

    @property
    def remainder(self) -> bool:
        return bool(self.answer.get("remainder"))

    @property
    def group(self) -> tuple[str, ...]:
        """The names that the answer leaves possible."""
        if self.named:
            return (self.named[0], *(n for n in self.answer["equivalence_class"] if n != self.named[0]))
        refitted = {c["name"]: c["delta_bic"] for c in self.ranking if c["delta_bic"] is not None}
        return tuple(n for n, gain in refitted.items() if gain > max(refitted.values()) - SAME)

    @property
    def before(self) -> float | None:
        """Held-out error without any effect."""
        held = self.answer.get("held_out")
        return None if held is None else held["mse_before"]


def opened(folder: Path, digest: str) -> dict[str, Any]:
    """The key of a benchmark folder; Refused unless it and all files it commits to are those behind ``digest``."""
    content = (folder / "key.json").read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise Refused(f"{folder / 'key.json'} is not the key whose hash was printed ({digest}): nothing is scored")
    key: dict[str, Any] = json.loads(content)
    for entry in key["cases"]:
        for name, wanted in entry["sha256"].items():
            path = folder / ("sealed" if name == "sealed" else entry["case"])
            path = path / (f"{entry['case']}.json" if name == "sealed" else name)
            if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != wanted:
                raise Refused(f"{path} was changed after the key was sealed: nothing is scored")
    return key


def rows_of(folder: Path, digest: str, answers: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """All cases of a benchmark with their answers; Refused if one has none, or if the key is not the sealed one."""
    key, rows = opened(folder, digest), []
    for entry in key["cases"]:
        name, effects = entry["case"], entry["effects"]
        if name not in answers:
            raise Refused(f"{name} has no answer: the key stays closed until all cases are solved")
        truth = {e["name"]: e["parameters"] for e in effects if entry["kind"] != "foreign" and e["name"] != MISFIT}
        sealed = json.loads((folder / "sealed" / f"{name}.json").read_text(encoding="utf-8"))
        strength = effects[0]["strength"] if effects else ""
        label = " + ".join(e["name"] for e in effects)
        rows.append(Row(name, entry["kind"], label, strength, truth, answers[name], sealed["floor"]))
    return rows


def top1(row: Row) -> bool:
    """Whether the first candidate is an effect of the truth."""
    return bool(row.ranking) and row.ranking[0]["name"] in row.truth


def rightly_named(row: Row) -> bool:
    return bool(row.named) and row.named[0] in row.truth


def in_group(row: Row) -> bool:
    return any(n in row.truth for n in row.group)


def wrongly_named(row: Row) -> bool:
    """Named for sure (nothing left over) what is not there."""
    return bool(row.named) and not row.remainder and row.named[0] not in row.truth


def one_too_many(row: Row) -> bool:
    """Whether any of the names is not there, also behind a right one."""
    return not set(row.named) <= set(row.truth)


def unnamed_seen(row: Row) -> bool:
    """Whether the answer says that something without a name is there."""
    return row.verdict == "unknown" or (row.verdict == "named" and row.remainder)


def right(row: Row) -> bool:
    """Whether a case is answered as it should be; the others are listed as misses."""
    if row.kind == "null":
        return row.verdict == "none"
    if row.kind == "foreign":
        return unnamed_seen(row)
    return set(row.named) == set(row.truth) if row.kind == "pair" else rightly_named(row)


def closure(row: Row) -> float | None:
    """Share of the held-out error above the floor that the named takes away; None without a gap."""
    if row.before is None or row.before / row.floor <= GAP:
        return None
    after = row.answer["held_out"]["mse_after"] if row.named else row.before
    return float((row.before - after) / (row.before - row.floor))


def shared(row: Row) -> list[tuple[str, str, float, float, float]]:
    """Effect, parameter, truth, estimate, standard error of what the truth and the named effects both hold."""
    return [
        (e["name"], s, row.truth[e["name"]][s], p["value"], p["std"])
        for e in (row.answer["effects"] if row.named else [])
        for s, p in e["parameters"].items()
        if s in row.truth.get(e["name"], {})
    ]


def covered(rows: Sequence[Row]) -> tuple[int, int]:
    """How many true parameters lie inside the 90 % intervals, of how many."""
    inside = [abs(value - true) <= Z90 * std for r in rows for _, _, true, value, std in shared(r)]
    return sum(inside), len(inside)
