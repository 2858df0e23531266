"""What is said: notices and warnings as sentences with a code for programs, tables for a notebook, progress.

A callback of long work takes a ``Progress``. Its sentences for a person go to ``LOGGER``, to which the command line
attaches a handler; in a notebook ``logging.basicConfig(level="INFO")`` shows them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape


def printable(text: str) -> str:
    """``text`` with what would steer a terminal (escape sequences, control characters) written as \\x1b and the like;
    line ends and tabs stay."""
    if text.isprintable():  # most texts are: in one pass
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


class Message(str):
    """A sentence with a ``code``, such as ``Message("calm air is assumed in run7", "no_wind")``.

    It is a string, so it can be printed, joined and written as it is. Programs compare ``code`` and never the words.
    text: the sentence, shown as ``printable``; code: lower-case words joined by underscores, which stay the same when
    the sentence changes.
    """

    code: str

    def __new__(cls, text: str, code: str) -> Message:
        message = super().__new__(cls, printable(text))
        message.code = code
        return message

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]  # copies and pickles keep the code
        return str(self), self.code


def listed(names: Sequence[str], most: int = 3) -> str:
    """The first ``most`` of ``names``, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def has_code(messages: Iterable[str], code: str) -> bool:
    """Whether one of ``messages`` carries ``code``."""
    return any(isinstance(m, Message) and m.code == code for m in messages)


def as_messages(sentences: Iterable[str], code: str) -> list[Message]:
    """``sentences`` as messages: those that are none yet get ``code``."""
    return [m if isinstance(m, Message) else Message(m, code) for m in sentences]


def message_rows(messages: Iterable[str]) -> list[dict[str, str]]:
    """Rows {"code", "text"} of ``messages`` for JSON; a plain string has the code "other"."""
    return [{"code": getattr(m, "code", "other"), "text": str(m)} for m in messages]


def messages_from(rows: Iterable[dict[str, str]]) -> tuple[Message, ...]:
    """The messages behind ``rows``, as ``message_rows`` wrote them."""
    return tuple(Message(row["text"], row["code"]) for row in rows)


MOST_ROWS = 20  # Rows of a table in a notebook, about as many as a screen holds. Set by hand.


def html_table(caption: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table as HTML, of at most MOST_ROWS rows; the number of those left out is said.

    caption: above the table; header: (C,) names of the columns; rows: of C cells each, floats shown with four digits.
    """

    def cell(value: object) -> str:
        return escape("" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value))

    every = list(rows)
    body = "".join("<tr>" + "".join(f"<td>{cell(v)}</td>" for v in row) + "</tr>" for row in every[:MOST_ROWS])
    more = f"<p>{len(every) - MOST_ROWS} more rows</p>" if len(every) > MOST_ROWS else ""
    names = "".join(f"<th>{cell(name)}</th>" for name in header)
    return (
        f"<table><caption>{cell(caption)}</caption><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>{more}"
    )


LOGGER = logging.getLogger("mmg_ident")  # Takes the sentences that long work says on its way, at level INFO


@dataclass(frozen=True)
class Progress:
    """Where long work stands.

    task: what is being done, such as "noise pass 2" or "seed 3"; step: iterations, epochs or parts done so far; of: how
    many there are in all, None where that is not known; values: what is watched, such as {"objective": 12.3}.
    """

    task: str
    step: int
    of: int | None = None
    values: Mapping[str, float] = field(default_factory=dict)


OnProgress = Callable[[Progress], None]
"""What ``progress=`` takes: called with each event, in the process and thread that does the work."""
