"""Commands that are ended at random moments: what is left is whole or absent, and resumed it is as if nothing happened.

python -m benchmarks.kill --kills N --seed S [--verb fit|train]: each time a signal (SIGKILL, SIGTERM, SIGINT) at a
random moment, once more the same command with --resume, and the values of its result.json against those of a run that
was left alone. Prints a row per verb and signal. Without /proc, orphan processes are not looked for.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.record import table
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
TIMES = {"created", "command", "timings_s", "seconds", "rollout_s", "path", "calibration"}
"""Keys of result.json that may differ: times, and where things lie."""
FEW = "--only X_0F,Y_v,N_r,k_0,gamma_P,Y_A1 --no-next-trial --measurement none --window 5"
VERBS = {
    "fit": f"fit esso_osaka_3m trials {FEW} --out OUT",
    "train": "train esso_osaka_3m trials --seeds 2 --epochs 2 --width 4 --workers 2 --out OUT",
}
"""Commands in the folder of the trials; --resume goes on with each."""


@dataclass(frozen=True)
class Ended:
    """What was left of a command. faults: what must not be, in words; fraction: of its time after which it ended."""

    verb: str
    name: str
    faults: tuple[str, ...]
    fraction: float


def values(content: Any) -> Any:
    """The ``content`` of result.json without what may differ between equal runs."""
    if isinstance(content, dict):
        return {key: values(value) for key, value in content.items() if key not in TIMES}
    return [values(value) for value in content] if isinstance(content, list) else content


def trials(folder: Path) -> None:
    """Two short trials in ``folder``/trials."""
    (folder / "trials").mkdir(parents=True)
    for trial in demo_trials(3, dt=0.5)[0][:2]:
        write_trial(trial, folder / "trials" / f"{trial.name}.csv")


def started(folder: Path, verb: str, out: str, *more: str) -> subprocess.Popen[str]:
    """The process of a ``verb`` in a group of its own. folder: with the trials; out: its run; more: options."""
    words = VERBS[verb].replace("OUT", out).split()
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    command = [sys.executable, "-m", "mmg_ident.commands.main", *words, *more]
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def alone(folder: Path, verb: str) -> tuple[Any, float]:
    """Values and seconds of a ``verb`` that is left alone in ``folder``. Raises RuntimeError where it fails."""
    began = time.perf_counter()
    process = started(folder, verb, f"{verb}_whole")
    _, error = process.communicate()
    if process.returncode:
        raise RuntimeError(error)
    return _values_of(folder / f"{verb}_whole"), time.perf_counter() - began


def ended(folder: Path, verb: str, number: signal.Signals, fraction: float, whole: Any, seconds: float) -> Ended:
    """A ``verb`` in ``folder`` to which the signal ``number`` is sent after a ``fraction`` of its ``seconds``, and
    which is then resumed; whole: its values when it is left alone."""
    out, faults = f"{verb}_{number.name}_{fraction:.6f}", []
    process = started(folder, verb, out)
    try:
        process.wait(timeout=fraction * seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
    _, error = process.communicate(timeout=60 + 2 * seconds)
    if "Traceback" in error:
        faults.append("traceback")
    time.sleep(1.0)
    if any(_in_session(process.pid)):
        faults.append("orphan process")
        os.killpg(process.pid, signal.SIGKILL)
    content = _values_of(folder / out)
    if content is not None and content.get("converged") and content != whole:
        faults.append("passes for finished")
    again = started(folder, verb, out, "--resume")
    _, error = again.communicate(timeout=60 + 4 * seconds)
    if again.returncode:
        faults.append(f"not resumed: {error.strip().splitlines()[-1][:100] if error.strip() else again.returncode}")
    elif _values_of(folder / out) != whole:
        faults.append("other values")
    if hidden := [p.name for p in folder.glob(f".{out}*")]:
        faults.append(f"left: {', '.join(hidden)}")
    return Ended(verb, number.name, tuple(faults), fraction)


def _values_of(run: Path) -> Any:
    path = run / "result.json"
    return values(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else None


def _in_session(session: int) -> Iterator[int]:
    """Living processes of a session."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, its = path.read_text().rpartition(")")[2].split()[:4]
        except (OSError, ValueError):
            continue
        if int(its) == session and state != "Z":
            yield int(path.parent.name)


def rows(found: Sequence[Ended]) -> list[list[str]]:
    """A row per verb and signal of those ``found``: how many, and what was wrong."""
    pairs = dict.fromkeys((e.verb, e.name) for e in found)
    groups = {pair: [e for e in found if (e.verb, e.name) == pair] for pair in pairs}
    return [
        [verb, name, str(len(some)), str(sum(not e.faults for e in some)),
         "; ".join(f"{fault} (at {e.fraction:.3f})" for e in some for fault in e.faults)]
        for (verb, name), some in groups.items()
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=6, help="per verb")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verb", choices=sorted(VERBS))
    given = parser.parse_args()
    draw, found = random.Random(given.seed), []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        trials(folder)
        for verb in VERBS if given.verb is None else (given.verb,):
            whole, seconds = alone(folder, verb)
            for k in range(given.kills):
                found.append(ended(folder, verb, SIGNALS[k % 3], draw.uniform(0.05, 1.0), whole, seconds))
    print("\n".join(table(["verb", "signal", "ended", "as it must be", "faults"], rows(found))))


if __name__ == "__main__":
    main()
