"""Run folders for tests of the interactive page: a calibration, a hybrid and a diagnosis of it, and their trials."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.read import read_trials
from cases.simulation.simulate import write_trial
from delivery.view.page import MISSING
from diagnosis.result import MISSING_FORCE, MissingForce, missing_force_text
from fitting.record import FitRecord
from fitting.report.run_folder import RESULT, data_rows, read_result, write_json
from tests.diagnosis.report.test_report import case
from tests.support.calibrated import small_result


def campaign(folder: Path) -> Path:
    """A run folder of the small calibration whose trials lie as files in ``folder``/trials; returns it."""
    result = small_result()
    assert result.objects is not None
    pools = {"data": result.objects.trials, "validation_data": result.objects.validation}
    (folder / "trials").mkdir(parents=True)
    rows: dict[str, Any] = {}
    for key, pool in pools.items():
        paths = [folder / "trials" / f"{trial.name}.csv" for trial in pool]
        for trial, path in zip(pool, paths, strict=True):
            write_trial(trial, path)
        rows[key] = data_rows(read_trials(paths))
    content = result.to_dict() | rows
    names = {"ship": "ship_name"}
    record = FitRecord.of({names.get(key, key): value for key, value in content.items()})
    replace(result, objects=None, data=record.data, validation_data=record.validation_data).save(folder / "run")
    return folder / "run"


def with_diagnosis(run: Path, name: str = "diagnosis") -> Path:
    """A diagnosis of the first trial of ``run``, in a folder ``name`` beside it; its missing force is made up."""
    folder = run.parent / name
    row = read_result(run)["data"][0]
    case("unknown").save(folder)
    content = json.loads((folder / RESULT).read_text())
    write_json(folder / RESULT, content | {"data": [row]})
    t = np.arange(0.0, 40.0, 0.5)
    force = np.column_stack([np.full_like(t, 0.3), np.sin(t), 0.2 * np.cos(t)])
    (folder / MISSING_FORCE).write_text(missing_force_text({row["name"]: MissingForce(t, force)}))
    return folder


# Columns of numbers of an interactive page, read back
def unpacked(column: list[Any]) -> np.ndarray:
    """The values (N,) of a ``column`` of ``packed``, NaN where it has none."""
    offset, scale, text = column
    steps = np.frombuffer(base64.b64decode(text), dtype="<i2").astype(float)
    return np.where(steps == MISSING, np.nan, offset + scale * steps)
