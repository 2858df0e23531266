"""What the verbs share: messages, progress, and what counts as a model or a trial on the command line."""

from __future__ import annotations

import json
import logging
import math
import re
import shlex
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mmg.errors import BadValue, Conflict, Missing, NoSolution, OutOfRange, TargetExists, UserError

if TYPE_CHECKING:
    from fitting.prediction.score import ScorePair
    from fitting.prediction.unit_errors import UnitErrors
    from fitting.result import FitResult
    from mmg.messages import OnProgress, Progress
    from residual.result import TrainResult


FIGURES = (".png", ".svg", ".pdf")  # Endings of files of figures
RESUMED = "the same command with --resume continues"  # How to go on with what was interrupted


def command_line() -> str:
    """The command line of this process, quoted for a shell."""
    return "mmg " + shlex.join(sys.argv[1:])


def say(text: str) -> None:
    """Print ``text``, a line for a person, on stderr in place of the progress, so that stdout stays clean for data."""
    end_progress()
    print(text, file=sys.stderr)


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    """Print the ``rows`` as plain text under a ``title``; columns: their heads, those that end in "|n" to the right."""
    end_progress()
    print(*filter(None, [title]), *table_lines(columns, rows), sep="\n")


def table_lines(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a table of ``rows``; columns: as of ``print_table``."""
    heads = [head.removesuffix("|n") for head in columns]
    cells = [heads, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = []
    for row in cells:
        parts = zip(row, columns, widths, strict=True)
        lines.append("  ".join(c.rjust(w) if head.endswith("|n") else c.ljust(w) for c, head, w in parts).rstrip())
    return lines


def say_fault(error: UserError, for_machines: bool = False) -> None:
    """Say the ``error`` in one line, and before it the problems of several files as a table; for_machines: all in the
    line, with the code of the kind of fault."""
    if for_machines or not error.problems:  # whitespace in the message, line ends of a file's cell say, is one blank
        print(f"mmg: {' '.join(str(error).split())}{f' [{error.code}]' * for_machines}", file=sys.stderr)
        return
    rows = [("file", "place", "problem", "what to do"), *map(parts_of, error.problems)]
    widths = [min(24, max(len(row[i]) for row in rows)) for i in (0, 1)]  # long names are wrapped as the sentences are
    widths += [(_width() - sum(widths) - 6) // 2] * 2  # problem and advice share what three gaps of two blanks leave
    for row in rows:
        cells = [textwrap.wrap(cell, width) or [""] for cell, width in zip(row, widths, strict=True)]
        for line in zip_longest(*cells, fillvalue=""):
            text = "  ".join(part.ljust(width) for part, width in zip(line, widths, strict=True))
            print(text.rstrip(), file=sys.stderr)
    print(f"mmg: {error.heading}, as listed", file=sys.stderr)


def parts_of(problem: str) -> tuple[str, str, str, str]:
    """File, place in it, fault and advice of a ``problem``, which says them in this order (``mmg.errors.UserError``);
    "" for what it leaves out."""
    # a file by its ending, a place by the word that it begins with, advice behind the first semicolon or full stop
    file, rest = match.groups() if (match := re.match(r"(\S.*?\.\w+): (.*)", problem)) else ("", problem)
    place, rest = match.groups() if (match := re.match(r"((?:row|column|line|\[)[^:]*): (.*)", rest)) else ("", rest)
    fault, *advice = re.split(r"[;.] ", rest, maxsplit=1)
    return Path(file).name, place, fault, "".join(advice)


def _width() -> int:
    """Columns of the terminal, 100 without one, and at least 60."""
    return max(shutil.get_terminal_size((100, 24)).columns, 60)


def print_wrapped(mark: str, text: str) -> None:
    """Print ``text`` behind a ``mark``, wrapped to the width of the terminal, or of 100 columns without one."""
    print(textwrap.fill(text, _width(), initial_indent=mark, subsequent_indent=" " * len(mark), break_long_words=False))


def print_json(data: Any) -> None:
    """Print ``data`` as one JSON document on stdout."""
    from fitting.report.run_folder import plain

    end_progress()
    print(json.dumps(plain(data), indent=2))  # plain: no nan, which JSON does not have


def say_remarks(result: FitResult | TrainResult) -> None:
    """Say the warnings and notices of ``result``."""
    for line in result.warnings:
        say(f"warning: {line}")
    say_notes(result.notices)


def say_notes(notes: Iterable[str]) -> None:
    """Say each of the ``notes``."""
    for line in notes:
        say(f"note: {line}")


def those_in(folder: Path, names: str) -> str:
    """Those of the files and folders with these ``names``, separated by spaces, that are in a ``folder``, in words."""
    return ", ".join(name for name in names.split() if (folder / name).exists())


def refuse_no_score(warnings: Sequence[str], out: Path) -> None:
    """Raises UserError where one of ``warnings`` says that a score is no number; the run folder ``out`` stays."""
    from fitting.prediction.score import NO_SCORE
    from mmg.messages import has_code

    for line in warnings:
        if has_code([line], NO_SCORE):
            raise NoSolution(f"{line}; {out} is written all the same, see its result.json and mmg check")


def say_scores(scores: Mapping[str, ScorePair], what: str = "") -> None:
    """Say errors in units where they are known, and both metrics, before and after, of sets of trials.

    scores: by name of the set; what: words on the two models.
    """
    from fitting.prediction.score import in_words

    for name, pair in scores.items():
        before, after = pair.before, pair.after
        if before.units and after.units and after.units.pooled.scored:
            for line in _unit_lines(before.units, after.units, f"{name}{what}"):
                say(line)
        windows = f"30 s windows {in_words(before.window)} -> {in_words(after.window)}"
        restarts = f"100 s restarts {in_words(before.paper)} -> {in_words(after.paper)}"
        say(f"{name}{what}, normalised (Eq. 25): {windows}, {restarts}")


def _unit_lines(before: UnitErrors, after: UnitErrors, what: str) -> list[str]:
    """A table of the pooled errors of two models; what: they are scored on, in words."""
    from fitting.prediction.unit_errors import STATE_ERRORS, ratios

    heads, columns = [], []
    for key, seconds in after.seconds.items():
        first, last = before.pooled.after.get(key), after.pooled.after.get(key)
        persistence = after.persistence.pooled.after.get(key) if after.persistence else None
        if first and last and persistence:
            ratio = ratios(last, persistence)
            heads += [f"{seconds:.3g} s: before|n", "after|n", "ratio|n"]
            columns += [[f"{getattr(one, state):.3g}" for state in STATE_ERRORS] for one in (first, last)]
            columns.append([f"{ratio[state]:.2f}" for state, _ in STATE_ERRORS.values()])
    labels = [f"{state} [{unit}]" for state, unit in STATE_ERRORS.values()]
    length = "one ship length and " if len(columns) > 3 else ""  # three columns for each time
    title = f"{what}: rms errors after {length}{after.window_s:g} s; ratio to keeping the velocities"
    return [title, *table_lines(["", *heads], zip(labels, *columns, strict=True))]


def page_targets(target: Path, pdf: bool, own: Sequence[Path], force: bool = False) -> list[Path]:
    """The HTML file ``target`` and, with ``pdf``, the PDF beside it. Raises UserError where one is there, unless it is
    a page or PDF of those that a run folder holds itself, ``own``, or with ``force``."""
    targets = [target, *([target.with_suffix(".pdf")] if pdf else [])]
    if pdf and target.suffix.lower() == ".pdf":
        raise Conflict(f"{target}: is the name of the HTML file; --pdf writes one beside it, with the ending .pdf")
    made_anew = {page.absolute().with_suffix(suffix) for page in own for suffix in (".html", ".pdf")}
    for path in targets:
        refuse_target("--out", path, force or path.absolute() in made_anew)
    return targets


def refuse_target(option: str, path: Path | None, force: bool, endings: Sequence[str] = ()) -> None:
    """Raises UserError unless a file can be written to the ``path`` of ``option``, where one is given.

    force: over one that exists; endings: of its name, () for any.
    """
    if path is None:
        return
    if endings and path.suffix.lower() not in endings:
        raise BadValue(f"{option} {path}: the name must end in {' or '.join(endings)}")
    if path.exists() and (path.is_dir() or not force):  # a folder is not replaced by a file, whoever forces it
        raise TargetExists(f"{option} {path}: exists already; choose another name or add --force")
    if not path.parent.is_dir():
        raise Missing(f"{option} {path}: there is no folder {path.parent}")


def refuse_given(options: Mapping[str, object], why: str) -> None:
    """Raises UserError, with the words ``why``, for the first of the ``options`` whose value is not None."""
    for option, value in options.items():
        if value is not None:
            raise Conflict(f"{option} {why}")


class _ToStderr(logging.Handler):
    """Prints the sentences of long work, each on a line of its own."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage())


# Whether the verb that runs was asked for JSON
_for_machines: ContextVar[bool] = ContextVar("for_machines", default=False)


@contextmanager
def narration(for_machines: bool = False) -> Iterator[None]:
    """While it lasts, the sentences of ``mmg.messages.LOGGER`` go to stderr, but not ``for_machines`` (--json)."""
    from mmg.messages import LOGGER

    handler, level = _ToStderr(logging.WARNING if for_machines else logging.INFO), LOGGER.level
    before = _for_machines.set(for_machines)
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)
        LOGGER.setLevel(level)
        end_progress()
        _for_machines.reset(before)


def progress() -> OnProgress | None:
    """A one-line progress display on a terminal; None when stderr is none, and with --json."""
    return _show if _on_terminal() else None


def _show(event: Progress) -> None:
    values = "  ".join(f"{name} {value:.5g}" for name, value in event.values.items())
    # \r: to the begin of the line; \033[K: clears what a longer line before left behind its end
    sys.stderr.write(f"\r{event.task}: {event.step:3d}{f' of {event.of}' if event.of else ''}  {values} \033[K")
    sys.stderr.flush()


def _on_terminal() -> bool:
    return not _for_machines.get() and sys.stderr.isatty()


T = TypeVar("T")


def each(items: Sequence[T], task: str) -> Iterator[T]:
    """The ``items`` of long work one by one, with a line on a terminal that says how far the ``task`` has come."""
    from mmg.messages import Progress

    show = progress()
    for step, item in enumerate(items):
        if show:
            show(Progress(task, step, len(items)))
        yield item
    end_progress()


@contextmanager
def working(task: str) -> Iterator[None]:
    """While it lasts, a line on a terminal that says what is being done: the ``task``."""
    if _on_terminal():
        sys.stderr.write(f"\r{task} ...\033[K")
        sys.stderr.flush()
    try:
        yield
    finally:
        end_progress()


def end_progress() -> None:
    """Clears the line of ``progress`` on a terminal."""
    if _on_terminal():
        sys.stderr.write("\r\033[K")


def ship_names(incomplete: str) -> list[str]:
    """Names for the completion of a shell: ships of the library that begin with ``incomplete``."""
    from cases.shipfiles.ship_file import library

    return [name for name in library() if name.startswith(incomplete)]


def is_model(argument: str) -> bool:
    """Whether ``argument`` is a library ship, a ship file, or a folder with a ship.toml or a black box."""
    from cases.shipfiles.network_file import is_black_box
    from cases.shipfiles.ship_file import library

    path = Path(argument)
    if path.is_dir():  # a folder of trials has neither
        return (path / "ship.toml").exists() or is_black_box(path)
    return argument in library() or path.suffix.lower() in (".toml", ".json")  # no trial file ends so


def positive(option: str, value: float | None, or_zero: bool = False) -> None:
    """Raises UserError unless the ``value`` of ``option`` is None or a positive number, or ``or_zero``."""
    if value is not None and not (math.isfinite(value) and (value > 0 or (or_zero and value == 0))):
        raise OutOfRange(f"{option} {value:g}: must be {'0 or ' * or_zero}a positive number")


def numbers_of(text: str, count: int, what: str, mark: str = ",") -> tuple[float, ...]:
    """The ``count`` finite numbers that ``text`` lists with a ``mark`` between. Raises UserError, which begins with
    ``what``, for anything else."""
    try:
        values = tuple(float(part) for part in text.split(mark))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise BadValue(f"{what}: {text!r} is not {count} numbers with {mark!r} between them")
    return values
