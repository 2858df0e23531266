"""The run folder: everything a calibration leaves behind, complete enough to reproduce and to continue it.

``ship.toml`` (the calibrated ship), ``start.toml`` (the ship it started from), ``result.json`` (settings, versions,
seeds, data hashes, objective, timings, coefficients, warnings), ``iterate.safetensors`` (scaled coefficients, node
states and noise, from which ``--resume`` continues), ``figures/``, ``report.html``. A folder appears whole or not at
all: it is written beside its place under another name and renamed.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file, save_file

from cases.shipfiles.network_file import NETWORK, save_network
from cases.shipfiles.ship_file import dump_ship
from cases.trial import STATES, UNITS, Trial
from fitting.calibration import Calibration
from fitting.identifiability.analysis import at_bound
from fitting.prediction.score import Score
from fitting.settings import settings_dict
from mmg.errors import UserError
from mmg.ship import Ship

RESULT, SHIP, START, ITERATE = "result.json", "ship.toml", "start.toml", "iterate.safetensors"


def versions() -> dict[str, str]:
    """Versions of the program, of Python and of the libraries that decide the numbers."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in ("mmg-ident", "casadi", "numpy", "scipy", "pandas"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def check_target(folder: Path) -> None:
    """UserError unless ``folder`` is free and can be created."""
    if folder.exists():
        raise UserError(f"{folder}: already exists; choose another --out, or continue an interrupted run with --resume")
    parent = folder.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise UserError(f"{folder}: cannot be written ({parent} is not a writable folder); choose another --out")


def write_whole(folder: Path, fill: Callable[[Path], None], replace: bool = False) -> None:
    """Create ``folder`` by filling a temporary one beside it and renaming; on failure nothing is left.

    ``replace`` allows an existing folder, which is swapped out only once the new one is complete.
    """
    folder = folder.absolute()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as error:
        raise UserError(f"{folder}: cannot be written ({error.strerror}); choose another --out") from None
    try:
        fill(scratch)
        scratch.chmod(0o755)
        if replace and folder.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name}.old.", dir=folder.parent))
            os.replace(folder, old / "run")
            os.replace(scratch, folder)
            shutil.rmtree(old, ignore_errors=True)
        else:
            os.replace(scratch, folder)
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise


def write_json(path: Path, data: Any) -> None:
    """JSON with numbers that are not finite written as null, atomically."""
    text = json.dumps(plain(data), indent=2, allow_nan=False) + "\n"
    scratch = path.with_name(f".{path.name}.part")
    scratch.write_text(text, encoding="utf-8")
    os.replace(scratch, path)


def plain(value: Any) -> Any:
    """Values that JSON knows: arrays as lists, numbers that are not finite as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value


def coefficient_rows(calibration: Calibration) -> dict[str, dict]:
    """What became of each free coefficient, by symbol."""
    prior, rows = calibration.prior, {}
    for i, symbol in enumerate(prior.symbols):
        c = calibration.ship.coefficients[symbol]
        rows[symbol] = {
            "value": c.value,
            "std": c.std,
            "prior_value": c.prior_value,
            "prior_std": c.prior_std,
            "lower": c.lower,
            "upper": c.upper,
            "at_bound": at_bound(
                calibration.p[i],
                (prior.lower[i] - prior.mean[i]) / prior.std[i],
                (prior.upper[i] - prior.mean[i]) / prior.std[i],
            )
            or None,
            "prior_share": float(calibration.covariance[i, i]),
            "verdict": c.verdict,
            "description": c.description,
            "unit": c.unit,
            "prime": c.prime,
        }
    return rows


def data_rows(trials: Sequence[Trial]) -> list[dict]:
    """Name, file, hash, length and rate of each trial."""
    return [
        {
            "name": t.name,
            "path": str(t.path) if t.path else None,
            "sha256": t.sha256,
            "samples": len(t),
            "duration_s": t.duration,
            "dt_s": t.dt,
            "kind": t.kind,
            "has_position": t.has_position,
            "has_wind": t.has_wind,
            "notices": list(t.notices),
        }
        for t in trials
    ]


def score_rows(score: Score) -> dict:
    """Both metrics as plain values, per trial and pooled, with their sigma."""
    return {
        "sigma": dict(zip(STATES, score.sigma.tolist(), strict=True)),
        "sigma_from": score.sigma_from,
        "paper": score.paper,
        "window": score.window,
        "trials": [
            {
                "name": t.name,
                "paper": t.paper,
                "paper_by_state": dict(zip(STATES, t.paper_by_state.tolist(), strict=True)),
                "window": t.window,
                "window_by_state": dict(zip(STATES, t.window_by_state.tolist(), strict=True)),
                "windows": t.windows,
            }
            for t in score.trials
        ],
        "notes": list(score.notes),
    }


def result(
    calibration: Calibration,
    trials: Sequence[Trial],
    validation: Sequence[Trial],
    scores: dict[str, dict],
    command: str,
    extra: dict | None = None,
) -> dict:
    """The content of ``result.json``. ``scores``: name -> {"before": ..., "after": ...} as of ``score_rows``."""
    s = calibration.solution
    noise, seg = calibration.noise, calibration.segments
    free = list(calibration.prior.symbols)
    return {
        "kind": "calibration",
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": command,
        "ship": calibration.ship.name,
        "converged": s.converged,
        "status": s.status,
        "advice": s.advice,
        "objective": s.objective,
        "constraint_violation": s.violation,
        "condition_number": calibration.condition_number,
        "iterations": s.iterations,
        "passes": list(calibration.passes),
        "starts": [vars(start) for start in calibration.starts],
        "settings": settings_dict(calibration.settings),
        "seed": calibration.settings.seed,
        "versions": versions(),
        "compiled": not any("without compiled code" in n for n in calibration.notices),
        "timings_s": calibration.timings,
        "data": data_rows(trials),
        "validation_data": data_rows(validation),
        "windows": len(seg.run),
        "intervals": seg.intervals,
        "seconds_used": seg.duration,
        "sigma": dict(zip(STATES, calibration.sigma.tolist(), strict=True)),
        "noise": {
            state: {"rms": noise.rms[i], "correlation_time_samples": noise.tau[i], "unit": UNITS[state]}
            for i, state in enumerate(STATES)
        },
        "coefficients": coefficient_rows(calibration),
        **({"per_run": calibration.constants.rows()} if calibration.constants else {}),
        "fixed": [s for s in calibration.ship.symbols if s not in free],
        "correlation": {"symbols": free, "matrix": np.round(calibration.identifiability.correlation, 4).tolist()},
        "scores": scores,
        "warnings": list(calibration.warnings),
        "notices": list(calibration.notices),
        **(extra or {}),
    }


def write_run(
    folder: Path,
    calibration: Calibration,
    start: Ship,
    content: dict,
    decorate: Callable[[Path], None] | None = None,
    replace: bool = False,
) -> None:
    """Write a run folder; ``decorate(folder)`` adds figures and the report before the folder appears."""

    def fill(scratch: Path) -> None:
        state = "calibrated" if calibration.converged else "NOT CONVERGED, best iterate"
        note = f"{calibration.ship.name}, {state} by mmg fit; std is the standard error of each estimate."
        (scratch / SHIP).write_text(dump_ship(calibration.ship, note), encoding="utf-8")
        (scratch / START).write_text(dump_ship(start, "The ship before calibration."), encoding="utf-8")
        save_file(
            {
                "p": np.ascontiguousarray(calibration.iterate),
                "nodes": np.ascontiguousarray(calibration.nodes),
                "sigma": np.ascontiguousarray(calibration.sigma),
            },
            scratch / ITERATE,
        )
        (scratch / ITERATE).chmod(0o644)
        if calibration.ship.network is not None:
            save_network(scratch / NETWORK, calibration.ship.network, calibration.ship)
        write_json(scratch / RESULT, content)
        if decorate:
            decorate(scratch)

    write_whole(folder, fill, replace)


def read_result(folder: Path) -> dict:
    """``result.json`` of a run folder; UserError when it is none."""
    try:
        return json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"{folder}: is no run folder (no {RESULT} in it)") from None
    except (OSError, ValueError) as error:
        raise UserError(f"{folder / RESULT}: cannot be read ({error})") from None


def read_iterate(folder: Path) -> dict[str, np.ndarray]:
    """The arrays from which ``--resume`` continues."""
    try:
        return dict(load_file(folder / ITERATE))
    except Exception as error:
        raise UserError(f"{folder / ITERATE}: cannot be read ({error}); start again without --resume") from None
