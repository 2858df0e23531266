"""A report page as PDF, by WeasyPrint (an optional library): the same HTML, its rules for paper, nothing loaded."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from mmg.errors import NotInstalled, NotWritable

MISSING = "a PDF needs WeasyPrint and its library Pango"


def needs_weasyprint() -> None:
    """Raises UserError where WeasyPrint, or a library that it needs, is missing."""
    try:
        import weasyprint  # noqa: F401
    except ImportError:
        raise NotInstalled(f"{MISSING}: pip install 'mmg-ident[pdf]', or print the HTML page in a browser") from None
    except OSError as error:
        why = str(error).splitlines()[0]
        raise NotInstalled(
            f"{MISSING}, which cannot be loaded ({why}); the HTML page can be printed by a browser"
        ) from None


def write_pdf(text: str, out: Path) -> None:
    """Write the page ``text`` as PDF to ``out``, whole or not at all. Raises UserError where that cannot be done."""
    needs_weasyprint()
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    inside = URLFetcher(allowed_protocols=("data",), allow_redirects=False)  # pictures that the page holds itself
    content = HTML(string=text, url_fetcher=inside).write_pdf()
    scratch = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        scratch.write_bytes(content)
        os.replace(scratch, out)
    except OSError as error:
        raise NotWritable(f"{out}: cannot be written ({error.strerror}); choose another --out") from None
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink()
