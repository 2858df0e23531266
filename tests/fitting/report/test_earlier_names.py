"""Run folders of earlier releases, in which an effect had another name."""

from __future__ import annotations

import json
from pathlib import Path

from fitting.report.run_folder import read_result


def test_a_run_of_an_earlier_release_is_read_with_present_names(tmp_path: Path) -> None:
    """Else the errors of its coefficients would not find the ship's, and its prediction bands would be too narrow."""
    old = {
        "kind": "fit",
        "coefficients": {"velocity_lag.tau": {"std": 0.1}, "Y_v": {"std": 0.2}},
        "correlation": {"symbols": ["Y_v", "velocity_lag.tau"], "matrix": [[1.0, 0.5], [0.5, 1.0]]},
        "settings": {"words": "the velocity_lag. stays"},
    }
    (tmp_path / "result.json").write_text(json.dumps(old), encoding="utf-8")
    found = read_result(tmp_path)
    assert list(found["coefficients"]) == ["velocity_filter.tau", "Y_v"] and found["settings"] == old["settings"]
    assert found["correlation"]["symbols"] == ["Y_v", "velocity_filter.tau"]
