"""A compiler that makes wrong code: it changes a text of each source before it compiles it."""

from __future__ import annotations

from pathlib import Path

import pytest

from mmg.compile.cache import compiler


def use_wrong_compiler(change: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """From now on ``cc.sh`` in ``folder`` compiles, after sed's ``change`` of the sources, into the cache that is
    returned."""
    wrong, cache = folder / "cc.sh", folder / "cache"
    edited = f"for a; do case $a in *.c) sed -i '{change}' $a;; esac; done"
    wrong.write_text(f'#!/bin/sh\n{edited}\nexec {compiler()} "$@"\n')
    wrong.chmod(0o700)
    monkeypatch.setenv("MMG_CC", str(wrong))
    monkeypatch.setenv("MMG_CACHE", str(cache))
    return cache
