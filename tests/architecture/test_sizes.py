"""Functions that fit on a screen, with few arguments. The command line is exempt: its arguments are its options."""

from __future__ import annotations

from tests.architecture.source import Source, arguments, sources

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
