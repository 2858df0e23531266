"""Arrays in safetensors files whose bytes follow from what they hold alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cases.io.files import check_file
from mmg.errors import BadValue, Unreadable


def save_tensors(path: Path, arrays: Mapping[str, np.ndarray], about: Mapping[str, str]) -> None:
    """Write ``arrays``, such as (K, N), with the metadata ``about`` to ``path``; equal content gives equal bytes.

    The library itself writes metadata in an order that changes from run to run: here it is that of the alphabet.
    Raises OSError where the file cannot be written, SafetensorError for arrays of a kind that the format lacks.
    """
    content = save({name: np.ascontiguousarray(array) for name, array in arrays.items()}, dict(about))
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:end])
    header = {"__metadata__": dict(sorted(about.items())), **{k: v for k, v in header.items() if k != "__metadata__"}}
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)  # numbers begin at a multiple of eight bytes
    path.write_bytes(len(text).to_bytes(8, "little") + text + content[end:])
    path.chmod(0o644)


def read_tensors(path: Path, form: str, what: str) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """The metadata and the arrays, such as (K, N), of the file ``path`` of this ``form``; what: it is, in words.

    Raises UserError where it cannot be read or is of another form.
    """
    check_file(path)
    try:
        with safe_open(path, framework="numpy") as file:
            about = file.metadata() or {}
            arrays = {name: np.asarray(file.get_tensor(name), dtype=float) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, ValueError, TypeError) as error:
        raise Unreadable(f"{path}: cannot be read as a {what} ({error}); train it again") from None
    if about.get("format") != form:
        raise BadValue(f"{path}: is no {what} of this program (format {about.get('format')!r}, not {form!r})")
    return about, arrays
