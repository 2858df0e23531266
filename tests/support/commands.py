"""Commands of mmg as a test runs them: what they print as JSON, and their one line where they refuse."""

from __future__ import annotations

import contextlib
import io
import json
from typing import Any

import pytest

from mmg_ident.commands.main import main


def shown(verb: str, *arguments: object) -> dict[str, Any]:
    """Run a command with --json; its document."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main([verb, *(str(a) for a in arguments), "--json"]) == 0
    return json.loads(out.getvalue())


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Run a command that must be refused; returns its one line, beside which it may say that it compiles."""
    capsys.readouterr()
    assert main([str(a) for a in arguments]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("compiling ")]
    assert len(lines) == 1 and lines[0].startswith("mmg: "), lines
    return lines[0]
