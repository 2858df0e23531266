"""The pages as data: blocks of code, commands with the output that a page shows, and a place to run them."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cases.io.read import read_trials
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from tests.support.trial_files import write_trials

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts)]


@dataclass(frozen=True)
class Command:
    """A command of a page: its page, words without "mmg", and the lines that the page shows as its output."""

    page: str
    words: tuple[str, ...]
    shown: tuple[str, ...]


def blocks(path: Path, language: str) -> list[str]:
    """Fenced blocks of a page in ``language``, "" for plain ones."""
    return [m[2] for m in re.finditer(r"(?ms)^```([^\n]*)\n(.*?)^```", path.read_text()) if m[1] == language]


def commands(path: Path) -> list[Command]:
    """Commands of ``path``, in their order. In a block with "$ mmg ..." the other lines are output."""
    found = []
    for block in blocks(path, ""):
        lines = block.replace("\\\n", " ").splitlines()
        prompt = "$ mmg " if any(line.startswith("$ mmg ") for line in lines) else "mmg "
        starts = [i for i, line in enumerate(lines) if line.startswith(prompt)]
        for i, end in zip(starts, [*starts, len(lines)][1:], strict=True):
            words = shlex.split(lines[i].removeprefix("$ "), comments=True)[1:]
            shown = tuple(lines[i + 1 : end]) if prompt.startswith("$") else ()
            found.append(Command(path.name, tuple(words), shown))
    return found


@cache
def small_trials() -> tuple[Trial, ...]:
    """Runs of 60 s of the hidden ship of the demo, two samples a second."""
    train, held_out = demo_trials(7, dt=0.5)
    return tuple(
        Trial(t.name, {name: values[:121] for name, values in t.columns.items()}) for t in (*train[:4], *held_out[1:2])
    )


def make_workspace(folder: Path, with_trials: bool = True) -> None:
    """The folders and files that the pages speak of, in ``folder``: a ship, and trials unless a page makes its own."""
    from cases.shipfiles.ship_file import dump_ship, load_ship

    (folder / "ship.toml").write_text(dump_ship(load_ship("esso_osaka_3m")))
    if not with_trials:
        (folder / "trials").mkdir()
        return
    trials = small_trials()
    for name, chosen in (("trials", trials[:3]), ("held_out", trials[4:]), ("next_year", trials[3:4])):
        write_trials(folder / name, chosen)
    (folder / "logs").mkdir()
    trials[0].to_pandas().to_csv(folder / "logs" / "day1.txt", index=False, sep=";", decimal=",")
    write_trial(trials[4], folder / "held_out" / "run7.csv")
    (folder / "held_out" / f"{trials[4].name}.csv").unlink()
    write_trial(trials[3], folder / "held_out.csv")
    (folder / "next_year_test").mkdir()
    write_trial(trials[4], folder / "next_year_test" / "run8.csv")
    assert len(read_trials([folder / "trials"])) == 3


QUICK = {
    "fit": ["--step", "0.5", "--max-iterations", "40"],
    "train": ["--validate", "held_out/run7.csv", "--seeds", "1", "--epochs", "1", "--width", "4", "--workers", "1"],
    "diagnose": ["--workers", "1"],
}
"""What is added to a command whose output is not shown, so that it is quick; the last value of an option counts."""


def arguments(command: Command) -> list[str]:
    """The words of a command as the shell would give them, patterns expanded in the working folder, made quick."""
    words: list[str] = []
    for word in command.words:
        words += sorted(str(p) for p in Path().glob(word)) if "*" in word else [word]
    return words + ([] if command.shown else QUICK.get(words[0], []))


def missing(shown: tuple[str, ...], printed: str) -> list[str]:
    """Lines that a page shows and that were not printed, in this order; "..." stands for any lines."""
    lines = iter([line.rstrip() for line in printed.splitlines()])
    absent = []
    for line in shown:
        wanted = line.rstrip()
        if wanted.strip() in ("", "..."):
            continue
        start = wanted.removesuffix("...").rstrip()
        if not any(p == wanted or (wanted.endswith("...") and p.startswith(start)) for p in lines):
            absent.append(wanted)
    return absent
