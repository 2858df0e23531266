"""Files of arrays have the same bytes whenever they hold the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from safetensors import safe_open
from safetensors.numpy import load_file

from cases.shipfiles.network_file import save_tensors


def test_equal_content_gives_equal_bytes_whatever_its_order(tmp_path: Path) -> None:
    arrays = {"w": np.arange(6.0).reshape(2, 3).T, "b": np.array([1.5], dtype=np.float32)}
    about = {name: f"{name} of ä ship" for name in ("format", "ship", "members", "features", "ship_hash", "h")}
    contents = set()
    for k, words in enumerate((about, dict(reversed(about.items())))):
        path = tmp_path / f"{k}.safetensors"
        save_tensors(path, arrays, words)
        contents.add(path.read_bytes())
        with safe_open(path, framework="numpy") as file:
            assert file.metadata() == about
        found = load_file(path)
        assert set(found) == {"w", "b"} and all(np.array_equal(found[name], arrays[name]) for name in found)
        assert found["b"].dtype == np.float32
    assert len(contents) == 1
