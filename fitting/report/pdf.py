"""A report page as PDF, by WeasyPrint (an optional library): the same HTML, its rules for paper, nothing loaded."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

from mmg.errors import UserError

MISSING = "a PDF needs WeasyPrint and its library Pango"


def needs_weasyprint() -> None:
    """Raises UserError where WeasyPrint, or a library that it needs, is missing."""
    try:
        import weasyprint  # noqa: F401
    except ImportError:
        raise UserError(f"{MISSING}: pip install 'mmg-ident[pdf]', or print the HTML page in a browser") from None
    except OSError as error:
        why = str(error).splitlines()[0]
        raise UserError(
            f"{MISSING}, which cannot be loaded ({why}); the HTML page can be printed by a browser"
        ) from None


def _inside() -> Any:
    """What fetches for a page: nothing but pictures that it holds itself."""
    from weasyprint import urls

    if hasattr(urls, "URLFetcher"):  # of WeasyPrint 68 and newer
        return urls.URLFetcher(allowed_protocols=("data",), allow_redirects=False)
    return _held_by_the_page


def _held_by_the_page(url: str, *_: Any, **__: Any) -> dict[str, Any]:
    """The same as a function, for older versions."""
    from weasyprint import default_url_fetcher

    if not url.startswith("data:"):
        raise ValueError(f"{url[:80]} is outside of the page")
    found: dict[str, Any] = default_url_fetcher(url)
    return found


def write_pdf(text: str, out: Path) -> None:
    """Write the page ``text`` as PDF to ``out``, whole or not at all. Raises UserError where that cannot be done."""
    needs_weasyprint()
    from weasyprint import HTML

    content = HTML(string=text, url_fetcher=_inside()).write_pdf()
    scratch = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        scratch.write_bytes(content)
        os.replace(scratch, out)
    except OSError as error:
        raise UserError(f"{out}: cannot be written ({error.strerror}); choose another --out") from None
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink()
