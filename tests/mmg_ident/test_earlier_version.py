"""Result folders of version 0.1.0 are read by the present code, which predicts the same with them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from delivery.export import export_ship
from fitting.calibrate import FitOptions
from mmg_ident import calibrate, load_run, load_ship, predict, read_trials, score, write_report
from tests.support.commands import shown

pytestmark = pytest.mark.usefixtures("blank_figures")

FOLDERS = Path(__file__).parents[1] / "fixtures" / "version_0_1"
RUNS = ("fit", "campaigns", "train", "auto", "horizon")  # Also with options that are gone
CALIBRATED = (*RUNS, "interrupted", "fleet/ships/one", "fleet/ships/two", "months")
EXPECTED: dict[str, Any] = json.loads((FOLDERS / "expected.json").read_text(encoding="utf-8"))


def numbers_of(folder: Path) -> dict[str, Any]:
    """What a result folder says and predicts: estimates and their standard errors, scores, and the last row of the
    first window of a run with its standard deviations."""
    held, run = read_trials(FOLDERS / "trials" / "held"), load_run(folder) if folder.name != "months" else None
    ship, window = load_ship(folder), predict(folder, held[:1])[0].windows[0]
    return {
        "converged": getattr(run, "converged", None),
        "estimates": {s: [ship.coefficients[s].value, ship.coefficients[s].std] for s in ship.free},
        "scores": {t.name: [t.window, t.paper] for t in score(folder, held).trials},
        "predicted": window.states[-1].tolist(),
        "std": None if window.std is None else window.std[-1].tolist(),
    }


def same(found: Any, expected: Any, tolerance: float) -> None:
    """Fails unless both hold the same, numbers to a relative ``tolerance``."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key, value in expected.items():
            same(found[key], value, tolerance)
    elif isinstance(expected, list):
        np.testing.assert_allclose(found, expected, rtol=tolerance, atol=1e-9)
    else:
        assert found == expected


@pytest.mark.slow
@pytest.mark.parametrize("name", CALIBRATED)
def test_a_calibration_predicts_the_same(name: str) -> None:
    """Numbers to 3e-5: the blends where the thrust changes its sign are wider since then."""
    same(numbers_of(FOLDERS / name), EXPECTED[name], 3e-5)


@pytest.mark.parametrize("name", (*RUNS, "interrupted"))
def test_a_report_is_written_of_it_and_c_exported(name: str, tmp_path: Path) -> None:
    """What was interrupted is no product."""
    write_report(FOLDERS / name, tmp_path / "report.html", imo=False)
    assert (tmp_path / "report.html").stat().st_size > 10_000
    if name in RUNS:
        export_ship(FOLDERS / name, "c", tmp_path / "c")
        assert list((tmp_path / "c").glob("*.c"))


@pytest.mark.longest
@pytest.mark.slow
def test_an_interrupted_fit_goes_on_to_the_same_estimate(tmp_path: Path) -> None:
    """It was stopped after two iterations of each solve, with loss and run weight left open."""
    shutil.copytree(FOLDERS / "interrupted", tmp_path / "run")
    earlier = load_run(tmp_path / "run")
    trials = read_trials(FOLDERS / "trials" / "spring")
    found = calibrate(earlier.start, trials, options=FitOptions(next_trial=False, resume=earlier), compiled=False)
    assert found.converged
    same({s: [found.ship.coefficients[s].value] for s in found.ship.free}, EXPECTED["resumed"], 1e-3)


def test_a_diagnosis_says_the_same() -> None:
    """Verdict, candidates and verdicts of the ship."""
    found = load_run(FOLDERS / "diagnose").to_dict()
    best = {c["name"]: [c["delta_bic"]] for c in found["candidates"][:3]}
    same({"verdict": found["verdict"], "candidates": best}, EXPECTED["diagnose"], 1e-12)


@pytest.mark.slow
def test_commands_take_it() -> None:
    folders = [str(FOLDERS / name) for name in ("fit", "train", "horizon")]
    assert {*folders} <= {*shown("score", *folders, FOLDERS / "trials" / "held")["models"]}
