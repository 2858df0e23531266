"""Links of README, CONTRIBUTING, CHANGELOG and docs lead to files that exist and to headings that they have."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT


def without_code(text: str) -> str:
    return re.sub(r"(?ms)^```.*?^```|`[^`\n]*`", "", text)


def anchors(path: Path) -> set[str]:
    """Anchors of a page: of its headings, as GitHub and MyST make them, and those that are written."""
    text = re.sub(r"(?ms)^```.*?^```", "", path.read_text(encoding="utf-8"))
    made = {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in re.findall(r"(?m)^#+ (.*)$", text)}
    return made | set(re.findall(r'<a id="([^"]+)">', text))


@pytest.mark.parametrize("path", [*PAGES, *ROOT.glob("C*.md")], ids=lambda p: p.name)
def test_links_of_a_page_lead_somewhere(path: Path) -> None:
    broken = []
    for target, heading in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", without_code(path.read_text(encoding="utf-8"))):
        page = (path.parent / target) if target else path
        if "://" in target or target.startswith("mailto:"):
            continue
        if not page.exists() or (heading and heading not in anchors(page)):
            broken.append(f"{target}#{heading}")
    assert not broken


def test_every_page_is_led_to_by_the_index() -> None:
    index = ROOT / "docs" / "index.md"
    led_to = {(index.parent / target).resolve() for target in re.findall(r"\]\(([^)#\s]+)", index.read_text())}
    kinds = ("tutorials", "how-to", "reference", "explanation")
    assert [p for p in PAGES if p.parent.name in kinds and p.resolve() not in led_to] == []


@pytest.mark.parametrize("path", [p for p in PAGES if p.parent.parent.name == "docs"], ids=lambda p: p.name)
def test_a_page_begins_with_what_it_answers(path: Path) -> None:
    text = re.sub(r"(?s)\A---\n.*?\n---\n", "", path.read_text(encoding="utf-8")).strip()
    title, answer = text.split("\n")[:3:2]
    assert title.startswith("# ") and answer[:1] not in ("", "#", "|", "*", ":")
    assert not answer.startswith("```") and len(answer) < 200
