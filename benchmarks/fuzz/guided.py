"""The readers under atheris, which looks for inputs that reach new lines.

python -m benchmarks.fuzz.guided READER [options of libFuzzer, such as -runs=100000 -max_len=4000]: stops at the first
unexpected outcome and writes its input to a file. Needs atheris: ``pip install -e '.[fuzz]'`` (Linux).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

OURS = ["benchmarks", "cases", "diagnosis", "fitting", "mmg", "residual"]
"""Packages whose lines are counted, beside the standard modules that parse."""
PARSERS = ["tomllib", "json", "csv"]


def main() -> None:
    try:
        import atheris
    except ImportError:
        sys.exit("benchmarks.fuzz.guided needs atheris (Linux): pip install -e '.[fuzz]'")
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    name = sys.argv.pop(1)
    with atheris.instrument_imports(include=OURS + PARSERS):
        from benchmarks.fuzz.damage import numbered
        from benchmarks.fuzz.outcome import outcome, strict_warnings
        from benchmarks.fuzz.readers import readers
    with tempfile.TemporaryDirectory() as scratch:
        known = readers(Path(scratch) / "files")
        if name not in known:
            sys.exit(f"{name} is no reader: {', '.join(known)}")
        reader, corpus = known[name], Path(scratch) / "corpus"
        corpus.mkdir()
        for k, content in enumerate((*reader.seeds, *(numbered(name, k, reader.seeds) for k in range(200)))):
            (corpus / str(k)).write_bytes(content)

        def one(content: bytes) -> None:
            words, _ = outcome(reader, content)
            if words not in ("read", "refused"):
                raise RuntimeError(words)

        with strict_warnings():
            atheris.Setup([*sys.argv, str(corpus)], one)
            atheris.Fuzz()


if __name__ == "__main__":
    main()
