"""Results as tables in a notebook (``_repr_html_``), with everything escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def html_table(caption: str, header: Sequence[str], rows: Iterable[Sequence[object]], most: int = 60) -> str:
    """A table as HTML.

    caption: above the table; header: (C,) names of the columns; rows: of C cells each, floats shown with four digits;
    most: rows shown, the number of those left out is said.
    """

    def cell(value: object) -> str:
        return escape("" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value))

    every = list(rows)
    body = "".join("<tr>" + "".join(f"<td>{cell(v)}</td>" for v in row) + "</tr>" for row in every[:most])
    more = f"<p>{len(every) - most} more rows</p>" if len(every) > most else ""
    names = "".join(f"<th>{cell(name)}</th>" for name in header)
    return (
        f"<table><caption>{cell(caption)}</caption><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>{more}"
    )
