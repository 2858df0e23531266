"""docs/explanation/architecture.md and the folders tell the same story, and the tests mirror the rooms."""

from __future__ import annotations

import re
from pathlib import Path

from tests.architecture.source import FLOORS, ROOT, Source, arguments, sources

ENTRIES = 14
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
BESIDE_THE_ROOMS = {"architecture", "benchmarks", "docs", "support"}


def rooms() -> list[str]:
    """Sub-packages at the top of each floor, as ``cases/io``."""
    return sorted(name.replace(".", "/") for name, s in sources().items() if s.is_package and name.count(".") == 1)


def listed() -> list[str]:
    """Rooms that the page gives a line of their own: ``* `cases/io/`: what it is for``."""
    return sorted(re.findall(r"^\* `([\w/]+)/`: \S", PAGE.read_text(), re.MULTILINE))


def paths_named() -> list[str]:
    """Paths of the product that the page names anywhere."""
    start = "|".join(FLOORS)
    return re.findall(rf"(?<![\w/])((?:{start})/[\w/]+(?:\.py|/))", PAGE.read_text())


def crowded() -> list[str]:
    found = []
    for floor in FLOORS:
        entries = [p for p in (ROOT / floor).iterdir() if not p.name.startswith(("_", ".")) and p.name != "py.typed"]
        found += [f"{floor}: an entry too many"] * max(0, len(entries) - ENTRIES)
    return found


def folders_without_a_room() -> list[str]:
    folders = [p for p in (ROOT / "tests").rglob("*") if p.is_dir() and any(p.glob("test_*.py"))]
    inside = [p.relative_to(ROOT / "tests") for p in folders]
    return [str(p) for p in inside if p.parts and p.parts[0] not in BESIDE_THE_ROOMS and not (ROOT / p).is_dir()]


def test_every_room_is_on_the_plan_and_nothing_else() -> None:
    assert listed() == rooms()


def test_every_path_on_the_plan_exists() -> None:
    assert [name for name in paths_named() if not (ROOT / Path(name)).exists()] == []


def test_no_floor_is_crowded_at_its_top() -> None:
    assert crowded() == []


def test_tests_mirror_the_rooms() -> None:
    assert folders_without_a_room() == []


# Functions that fit on a screen, with few arguments. The command line is exempt: its arguments are its options
LINES, ARGUMENTS, FILE_LINES = 80, 8, 700


def below_the_command_line() -> list[Source]:
    return [s for s in sources().values() if not s.name.startswith("mmg_ident.commands")]


def long_functions() -> list[str]:
    return [
        f"{source.floor}: {name} has over {LINES} lines"
        for source in below_the_command_line()
        for name, function in source.functions
        if (function.end_lineno or 0) - function.lineno + 1 > LINES
    ]


def wide_functions() -> list[str]:
    return [
        f"{source.floor}: {name} has over {ARGUMENTS} arguments"
        for source in below_the_command_line()
        for name, function in source.functions
        if len(arguments(function)) > ARGUMENTS
    ]


def long_files() -> list[str]:
    return [
        f"{s.floor}: {s.name} has over {FILE_LINES} lines"
        for s in sources().values()
        if s.text.count("\n") > FILE_LINES
    ]


def test_no_function_is_longer_than_a_screen() -> None:
    assert long_functions() == []


def test_no_function_takes_more_than_eight_arguments() -> None:
    assert wide_functions() == []


def test_no_file_is_long() -> None:
    assert long_files() == []
