"""Keeps benchmark results in RESULTS.md, one section per benchmark, with the command that made it."""

from __future__ import annotations

import json
import platform
import re
from datetime import date
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).with_name("RESULTS.md")


def machine() -> str:
    """Processor and core count in words."""
    import os

    model = platform.processor() or platform.machine()
    try:
        found = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text())
        model = found.group(1) if found else model
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"


def record(title: str, command: str, lines: list[str]) -> None:
    """Print a section and put it into RESULTS.md in place of the one with the same title."""
    body = "\n".join([f"## {title}", "", f"`{command}` on {date.today()}, {machine()}", "", *lines, ""])
    print(body)
    text = RESULTS.read_text(encoding="utf-8") if RESULTS.exists() else "# Benchmark results\n\n"
    pattern = re.compile(rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", re.S | re.M)
    text = pattern.sub(lambda _: body + "\n", text) if pattern.search(text) else text.rstrip() + "\n\n" + body + "\n"
    RESULTS.write_text(text, encoding="utf-8")


def kept_row(path: Path, name: str) -> dict[str, Any] | None:
    """The row called ``name`` among the JSON lines of the file at ``path``; None without one."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return next((dict(row) for row in map(json.loads, lines) if row["name"] == name), None)


def table(header: list[str], rows: list[list[str]]) -> list[str]:
    """Lines of a markdown table."""
    return [
        "| " + " | ".join(header) + " |",
        "|" + "---|" * len(header),
        *["| " + " | ".join(row) + " |" for row in rows],
    ]
