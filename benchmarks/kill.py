"""Commands that are ended at random moments: what is left is whole or absent, and resumed it is as if nothing happened.

python -m benchmarks.kill --kills N --seed S [--verb NAME]... [--record]: each time a signal (SIGKILL, SIGTERM, SIGINT)
at a random moment, then the same command once more with --resume (or --force, where there is nothing to resume), and
what it made against what a run that was left alone made: the values of its JSON, the bytes of other files. Prints a row
per verb and signal. Without /proc, orphan processes are not looked for.
"""

from __future__ import annotations

import contextlib
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
from hashlib import sha256
from pathlib import Path
from typing import Any

from safetensors import safe_open

from benchmarks.record import Figure, parser_of, report, table
from benchmarks.toml import tables
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
TIMES = {"created", "command", "timings_s", "timings", "seconds", "rollout_s", "took_s", "path", "calibration", "wall"}
"""Keys of JSON files that may differ: times, and where things lie."""
VERBS: dict[str, str] = tables(Path(__file__).with_suffix(".toml"))
"""Commands in the folder of the trials."""
ERRORS = "errors.txt"
"""What the last command wrote to stderr, in the folder of the trials."""
AGAIN = {"predict": "--force", "simulate": "--force", "export": "--force"}
"""What goes on with a command; else it is --resume."""


@dataclass(frozen=True)
class Ended:
    """What was left of a command. faults: what must not be, in words; fraction: of its time after which it ended."""

    verb: str
    name: str
    faults: tuple[str, ...]
    fraction: float


def values(content: Any) -> Any:
    """The ``content`` of a JSON file without what may differ between equal runs."""
    if isinstance(content, dict):
        return {key: values(value) for key, value in content.items() if key not in TIMES}
    return [values(value) for value in content] if isinstance(content, list) else content


def trials(folder: Path) -> None:
    """Two short trials in ``folder``/trials, one in ``folder``/others, and a ship with few free coefficients."""
    from cases.shipfiles.effects import reduced_ship
    from cases.shipfiles.ship_file import dump_ship, load_ship

    made = demo_trials(3, dt=0.5)[0][:3]
    for trial, name in zip(made, ("trials", "trials", "others"), strict=True):
        (folder / name).mkdir(parents=True, exist_ok=True)
        write_trial(trial, folder / name / f"{trial.name}.csv")
    few = reduced_ship(load_ship("esso_osaka_3m"), only=["X_0F", "Y_v", "N_r", "k_0"])
    (folder / "small.toml").write_text(dump_ship(few, "few free coefficients"), encoding="utf-8")


def started(folder: Path, verb: str, out: str, *more: str) -> subprocess.Popen[bytes]:
    """The process of a ``verb``, of a session of its own, whose errors go to the file ERRORS. folder: with the trials;
    out: what it writes; more: options."""
    words = [*VERBS[verb].replace("OUT", out).split(), *more]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    where = {"cwd": folder, "env": environment, "stdout": subprocess.DEVNULL, "start_new_session": True}
    with (folder / ERRORS).open("wb") as errors:
        return subprocess.Popen([sys.executable, "-m", "mmg_ident.commands.main", *words], stderr=errors, **where)


def ended_with(process: subprocess.Popen[bytes], seconds: float) -> int | None:
    """The exit status, negative for a signal, or None where it has not ended after so many seconds."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(seconds)
    return None


def said(folder: Path) -> str:
    """What the last process in a ``folder`` wrote to stderr."""
    return (folder / ERRORS).read_text(encoding="utf-8", errors="replace")


def alone(folder: Path, verb: str, out: str) -> tuple[Any, float]:
    """What a ``verb`` that is left alone makes as ``out`` in ``folder``, and its seconds. Raises RuntimeError where it
    fails."""
    began, process = time.perf_counter(), started(folder, verb, out)
    if ended_with(process, 600.0) != 0:
        raise RuntimeError(said(folder))
    return made(folder, out), time.perf_counter() - began


def ended(folder: Path, verb: str, number: signal.Signals, fraction: float, whole: Any, seconds: float) -> Ended:
    """A ``verb`` in ``folder`` to which the signal ``number`` is sent after a ``fraction`` of its ``seconds``, and
    which is then made once more; whole: what it makes when it is left alone."""
    out, faults = f"{verb}_{number.name}_{round(1e6 * fraction)}", []
    process = started(folder, verb, out)
    if ended_with(process, fraction * seconds) is None:
        os.kill(process.pid, number)
        if ended_with(process, 60 + 2 * seconds) is None:
            faults.append("deaf")
            os.killpg(process.pid, signal.SIGKILL)
            ended_with(process, 5.0)
    if "Traceback" in (error := said(folder)):
        faults.append(f"traceback: {error.strip().splitlines()[-1][:100]}")
    until = time.monotonic() + 30.0  # a process that is still importing notices it late
    while (living := list(_in_session(process.pid))) and time.monotonic() < until:
        time.sleep(0.1)
    if living:
        faults.append("orphan process")
        os.killpg(process.pid, signal.SIGKILL)
    left = made(folder, out)
    if _complete(left) and left != whole:
        faults.append("passes for finished")
    again = started(folder, verb, out, AGAIN.get(verb, "--resume"))
    code = ended_with(again, 60 + 6 * seconds)
    error = said(folder)
    if code != 0:
        faults.append(f"not resumed: {error.strip().splitlines()[-1][:100] if error.strip() else code}")
    elif made(folder, out) != whole:
        faults.append("other values")
    if hidden := [p.name for p in [*folder.glob(f".{out}*"), *folder.glob(f"{out}/**/.*")]]:
        faults.append(f"left: {', '.join(hidden)}")
    return Ended(verb, number.name, tuple(faults), fraction)


def made(folder: Path, out: str) -> Any:
    """The files that a command made as ``out`` in ``folder``: values of JSON, text without times, else bytes, in
    which ``out`` may stand: a ship has the name of its run. {} where there is nothing."""
    place = folder / out
    files = [p for p in (place.rglob("*") if place.is_dir() else folder.glob(f"{out}.*")) if p.is_file()]
    found: dict[str, Any] = {}
    for path in files:
        name = str(path.relative_to(place)) if place.is_dir() else path.suffix
        if path.suffix == ".json":
            found[name] = values(json.loads(path.read_text(encoding="utf-8")))
        elif path.suffix in (".html", ".png"):
            found[name] = "there"
        elif path.suffix == ".safetensors" and "training" not in name:
            found[name] = _numbers(path)
        elif "training" not in name and "entries" not in name:
            found[name] = sha256(path.read_bytes().replace(out.encode(), b"OUT")).hexdigest()
    return found


def _numbers(path: Path) -> dict[str, Any]:
    """Arrays and words of a file of safetensors, whose order is not fixed."""
    with safe_open(str(path), "numpy") as file:
        arrays = {name: sha256(file.get_tensor(name).tobytes()).hexdigest() for name in file.keys()}  # noqa: SIM118
        return arrays | dict(file.metadata() or {})


def _complete(left: dict[str, Any]) -> bool:
    """Whether what is left of a command says that it is all there."""
    if not left:
        return False
    result = left.get("result.json")
    if result is None:
        return "training/settings.json" not in left and "entries/settings.json" not in left
    if result.get("interrupted"):
        return False
    if "messages" in result:
        codes = {row.get("code") for row in result["messages"]}
        return bool(result.get("converged", True)) and not codes & {"parts_left_out", "seeds_stopped", "seeds_missing"}
    return bool(result.get("complete", result.get("figures", True)))


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
    parser = parser_of("kill", __doc__)
    parser.add_argument("--kills", type=int, default=6, help="per verb")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verb", choices=sorted(VERBS), action="append")
    given = parser.parse_args()
    draw, found = random.Random(given.seed), []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        trials(folder)
        for verb in given.verb or VERBS:
            alone(folder, verb, f"{verb}_first")  # compiles what it needs
            whole, seconds = alone(folder, verb, f"{verb}_whole")
            for k in range(given.kills):
                one = ended(folder, verb, SIGNALS[k % 3], draw.uniform(0.02, 1.0), whole, seconds)
                found.append(one)
                words = f"{verb} {k + 1}/{given.kills} {one.name} at {one.fraction:.3f}"
                print(f"{words}: {one.faults or 'ok'}", flush=True)
    print("\n".join(table(["command", "signal", "ended", "as it must be", "faults"], rows(found))))
    good = sum(not e.faults for e in found)
    made = {"kill": Figure("commands ended at a random moment, whole after it", good, of=len(found))}
    report(made, f"kill --kills {given.kills} --seed {given.seed}", given.record)


if __name__ == "__main__":
    main()
